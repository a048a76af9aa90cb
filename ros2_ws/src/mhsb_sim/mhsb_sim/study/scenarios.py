"""Scenarios of the servo study, read from config/study_scenarios.yaml, or from a file of the
machine's own beside it, study_scenarios_NAME.yaml."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError

from mhsb_model.files.config_files import of_machine
from mhsb_model.files.schema_problems import problems_of
from mhsb_model.files.yaml_files import YamlFileError, read_yaml
from mhsb_model.goal import place
from mhsb_model.machine import Machine
from mhsb_model.schema import Coordinate, Duration, NonNegative, Section, Weight
from mhsb_model.types import Position
from mhsb_planner.search.s2_search import Weights
from mhsb_sim.errors import ScenarioError

SCENARIOS_FILE = "study_scenarios.yaml"


Place = tuple[Coordinate, Coordinate] | tuple[Coordinate, Coordinate, Coordinate]


PayloadMass = Annotated[float, Field(ge=0, le=10_000)]


class GoalSequence(Section):
    """Goals that come one after the other, whether the arm has arrived or not."""

    interval: Duration = Field(le=600, description="from one goal to the next [s]")
    weights: tuple[Weight, Weight, Weight] = Field(
        description="of energy [1/J], time [1/s] and mode switches [-]"
    )
    goals: tuple[Place, ...] = Field(min_length=1, description="tip (x, z) or (x, y, z) [m]")


class StudyConfig(Section):
    """The scenario file: every sequence with every pump lag and every payload."""

    pump_lags: Annotated[tuple[Duration, ...], Field(min_length=1, description="[s]")]
    payloads: Annotated[tuple[PayloadMass, ...], Field(min_length=1, description="[kg]")]
    tail: NonNegative = Field(
        le=1e4, description="how long a run goes on after the last interval [s]"
    )
    sequences: dict[str, GoalSequence] = Field(min_length=1)
    training: tuple[str, ...] = Field(description="scenarios that gains are tuned on")


@dataclass(frozen=True)
class Scenario:
    """Goals for an arm with a certain payload and servo pumps of a certain lag.

    goals     tip in `base_link` [m]
    interval  from one goal to the next [s]
    tail      how long the run goes on after the last interval [s]
    weights   of the planner's search
    pump_lag  of the servo pumps [s]
    payload   known to planner and servo [kg]
    held_out  whether gains have been tuned without it
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
        """Of the whole run [s]."""
        return self.interval * len(self.goals) + self.tail

    def machine(self, machine: Machine) -> Machine:
        """The machine with this scenario's payload and pump lag."""
        config = machine.changed(payload=self.payload).config
        circuit = config.circuit.model_copy(update={"servo_pump_lag": self.pump_lag})
        return Machine.from_config(config.model_copy(update={"circuit": circuit}))


def load_scenarios(file: Path | None = None, machine: Machine | None = None) -> list[Scenario]:
    """All scenarios of a file, the suite's own for a machine when left out; raises ScenarioError,
    also where its goals are not the machine's."""
    file = file or of_machine(SCENARIOS_FILE, machine.name if machine else None)
    try:
        config = StudyConfig.model_validate(read_yaml(file))
    except YamlFileError as error:
        raise ScenarioError(str(error)) from None
    except ValidationError as error:
        raise ScenarioError(f"{file}: {'; '.join(problems_of(error, StudyConfig))}") from error
    scenarios = scenarios_of(config)
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
    for goal in scenario.goals:
        if len(goal) != len(machine.axes):
            raise ScenarioError(
                f"{file}: {scenario.name}: {place(goal)} is no goal of {machine.name}, which takes "
                f"{' '.join(machine.axes)}; give a file of its own with --scenarios"
            )


def scenarios_of(config: StudyConfig) -> list[Scenario]:
    """Every sequence with every pump lag and every payload, in the file's order."""
    scenarios = []
    for sequence_name, sequence in config.sequences.items():
        for lag in config.pump_lags:
            for payload in config.payloads:
                name = f"{sequence_name}-{1e3 * lag:g}ms-{payload:g}kg"
                scenarios.append(
                    Scenario(
                        name=name,
                        goals=sequence.goals,
                        interval=sequence.interval,
                        tail=config.tail,
                        weights=Weights(*sequence.weights),
                        pump_lag=lag,
                        payload=payload,
                        held_out=name not in config.training,
                    )
                )
    return scenarios
