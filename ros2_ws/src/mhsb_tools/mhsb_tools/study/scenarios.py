"""Scenarios of the servo study, read from config/study_scenarios.yaml.

A machine may have its own file beside it, study_scenarios_NAME.yaml.
"""

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import Field, ValidationError

from mhsb_model.files.config_files import find_machine_config_file
from mhsb_model.files.schema_problems import describe_validation_errors
from mhsb_model.files.yaml_files import read_yaml
from mhsb_model.goal import format_position
from mhsb_model.machine import Machine
from mhsb_model.schema import Coordinate, Duration, NonNegative, Section, Weight
from mhsb_model.types import Position
from mhsb_planner.search.s2_search import Weights
from mhsb_tools.errors import ScenarioError

SCENARIOS_FILE = "study_scenarios.yaml"


Place = tuple[Coordinate, Coordinate] | tuple[Coordinate, Coordinate, Coordinate]


PayloadMass = Annotated[float, Field(ge=0, le=10_000)]


class GoalSequence(Section):
    """Goals that follow one another at a fixed interval, whether the arm has arrived or not."""

    interval: float = Field(ge=1e-5, le=600, description="from one goal to the next [s]")
    weights: tuple[Weight, Weight, Weight] = Field(
        description="of energy [1/J], time [1/s] and mode switches [-]"
    )
    goals: tuple[Place, ...] = Field(min_length=1, description="tip (x, z) or (x, y, z) [m]")


class StudyConfig(Section):
    """The scenario file: every sequence is combined with every pump lag and every payload."""

    pump_lags: Annotated[tuple[Duration, ...], Field(min_length=1, description="[s]")]
    payloads: Annotated[tuple[PayloadMass, ...], Field(min_length=1, description="[kg]")]
    tail: NonNegative = Field(
        le=1e4, description="how long a run goes on after the last interval [s]"
    )
    sequences: dict[str, GoalSequence] = Field(min_length=1)
    training: tuple[str, ...] = Field(description="scenarios that gains are tuned on")


@dataclass(frozen=True)
class Scenario:
    """Goals for an arm with a certain payload and servo pump lag.

    Attributes:
        name: Name made of sequence, lag and payload.
        goals: Tip positions in `base_link` [m].
        interval: Time from one goal to the next [s].
        tail: Time for which the run goes on after the last interval [s].
        weights: Weights of the planner's cost.
        pump_lag: Lag of the servo pumps [s].
        payload: Payload, known to planner and servo [kg].
        held_out: Whether gains are tuned without this scenario.
    """

    name: str
    goals: tuple[Position, ...]
    interval: float
    tail: float
    weights: Weights
    pump_lag: float
    payload: float
    held_out: bool

    @property
    def duration(self) -> float:
        """Duration of the whole run [s]."""
        return self.interval * len(self.goals) + self.tail

    def apply_to(self, machine: Machine) -> Machine:
        """Return a machine with this scenario's payload and servo pump lag.

        Args:
            machine: The arm of the machine file.

        Returns:
            A changed copy of the machine.

        Raises:
            MachineFileError: A value of the scenario is not allowed for this machine.
        """
        config = machine.changed(payload=self.payload).config
        circuit = config.circuit.model_copy(update={"servo_pump_lag": self.pump_lag})
        return Machine.from_config(config.model_copy(update={"circuit": circuit}))


Content = TypeVar("Content", bound=Section)


def read_study_file(file: Path, kind: type[Content]) -> Content:
    """Read and check a YAML file of a study.

    Args:
        file: The file.
        kind: Class that describes the content of the file, such as `StudyConfig`.

    Returns:
        The content as an object of that class.

    Raises:
        YamlFileError: The file cannot be read.
        ScenarioError: The file's content is invalid.
    """
    try:
        return kind.model_validate(read_yaml(file))
    except ValidationError as error:
        problems = "; ".join(describe_validation_errors(error, kind))
        raise ScenarioError(f"{file}: {problems}") from error


def load_scenarios(file: Path | None = None, machine: Machine | None = None) -> list[Scenario]:
    """Load all scenarios of a file.

    Args:
        file: YAML file. None takes the suite's file for the name of `machine` if there is one, else
            the suite's default file.
        machine: The arm. None takes the default file if `file` is None, and does not check that the
            goals have as many coordinates as the arm needs.

    Returns:
        The scenarios in the file's order.

    Raises:
        YamlFileError: The file cannot be read.
        ScenarioError: The file's content is invalid, a training scenario does not exist, or a goal
            has the wrong number of coordinates.
    """
    file = file or find_machine_config_file(SCENARIOS_FILE, machine.name if machine else None)
    config = read_study_file(file, StudyConfig)
    scenarios = combine_scenarios(config)
    unknown = set(config.training) - {scenario.name for scenario in scenarios}
    if unknown:
        raise ScenarioError(
            f"{file}: training: there is no scenario {', '.join(sorted(unknown))}; a name is "
            f"made like {scenarios[0].name}"
        )
    if machine is not None:
        for scenario in scenarios:
            _check_goals(file, scenario, machine)
    return scenarios


def _check_goals(file: Path, scenario: Scenario, machine: Machine) -> None:
    """Check that all goals of a scenario have as many coordinates as a machine needs.

    Args:
        file: The scenario file, for the error message.
        scenario: The scenario.
        machine: The arm; goals have x, y, z if it slews, else x, z.

    Raises:
        ScenarioError: A goal has another number of coordinates.
    """
    for goal in scenario.goals:
        if len(goal) != len(machine.axes):
            raise ScenarioError(
                f"{file}: {scenario.name}: {format_position(goal)} is no goal of "
                f"{machine.name}, which takes {' '.join(machine.axes)}; "
                "give a file of its own with --scenarios"
            )


def combine_scenarios(config: StudyConfig) -> list[Scenario]:
    """Combine every sequence of goals with every pump lag and every payload.

    A scenario's name has the form SEQUENCE-LAGms-PAYLOADkg, such as `every_5s-20ms-10kg`. Gains are
    tuned on a scenario only if `config.training` has its name; otherwise `held_out` is True.

    Args:
        config: Content of a scenario file.

    Returns:
        The scenarios in the file's order; payload varies fastest.
    """
    scenarios = []
    for (name, sequence), lag, payload in product(
        config.sequences.items(), config.pump_lags, config.payloads
    ):
        full_name = f"{name}-{1e3 * lag:g}ms-{payload:g}kg"
        scenarios.append(
            Scenario(
                name=full_name,
                goals=sequence.goals,
                interval=sequence.interval,
                tail=config.tail,
                weights=Weights(*sequence.weights),
                pump_lag=lag,
                payload=payload,
                held_out=full_name not in config.training,
            )
        )
    return scenarios
