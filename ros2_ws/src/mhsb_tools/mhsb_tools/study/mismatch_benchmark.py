"""Mismatch benchmark: fixed moves on drawn plants, read from config/mismatch_benchmark.yaml.

The file is the protocol; docs/studies.md explains it. Every sequence is run once on the machine
itself, then every draw on its plant. All controllers are given identical plans.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine
from mhsb_model.schema import Duration, Section, Weight
from mhsb_planner.executor import Jobs, SharedStateExecutor, yield_results
from mhsb_planner.planner import DEFAULT_PLANNER, PlanOptions
from mhsb_planner.search.s2_search import Weights
from mhsb_tools.study.draws import DrawRecord, DrawStudy, PlannedSequence, group_by_controller
from mhsb_tools.study.headless import TimedGoal
from mhsb_tools.study.scenarios import read_study_file
from mhsb_tools.study.variations import Variations, draw_machine, validate_variations

BENCHMARK_FILE = "mismatch_benchmark.yaml"

Coordinate = Annotated[float, Field(ge=-10.0, le=10.0)]


class BenchmarkMoves(Section):
    """Goals that follow one another, and the weights of their plans."""

    weights: tuple[Weight, Weight, Weight] = Field(
        description="of energy [1/J], time [1/s] and mode switches [-]"
    )
    goals: tuple[tuple[Coordinate, Coordinate, Duration], ...] = Field(
        min_length=1, description="tip x, z [m] and the time until the next goal [s]"
    )

    @property
    def options(self) -> PlanOptions:
        """Options of the plans."""
        return PlanOptions(Weights(*self.weights), planner=DEFAULT_PLANNER)

    @property
    def timed_goals(self) -> list[TimedGoal]:
        """The goals with the time until the next one."""
        return [TimedGoal(goal[:-1], goal[-1]) for goal in self.goals]


class ProtocolFile(Section):
    """The benchmark's file."""

    version: int = Field(ge=1, le=1000)
    draws: int = Field(ge=1, le=1_000_000, description="unless told otherwise")
    seed: int = Field(ge=0, le=2**63 - 1)
    lost: float = Field(
        ge=1e-9, le=100, description="tip error from which on the arm counts as lost [m]"
    )
    sequences: tuple[BenchmarkMoves, ...] = Field(min_length=1)
    variations: dict[str, Any] = Field(min_length=1, description="as config/variations.yaml")


@dataclass(frozen=True)
class Protocol:
    """Content of the benchmark's file, with its variations checked against one machine.

    Attributes:
        file: Content of the file.
        variations: Variations by name, checked against the machine.
    """

    file: ProtocolFile
    variations: Variations


def load_protocol(machine: Machine, path: Path | None = None) -> Protocol:
    """Load the definition of the mismatch benchmark: goals, variations, seed and number of draws.

    Args:
        machine: The machine whose values are varied.
        path: YAML file; None takes the suite's file.

    Returns:
        Content of the file, with the variations checked against the machine.

    Raises:
        YamlFileError: The file cannot be read.
        ScenarioError: The file's content is invalid.
        VariationError: The variations in the file are invalid, or there are none.
        MhsbError: The machine does not have a value that a variation names, or a value with a
            factor is no number. Or a varied value would be outside its range.
    """
    path = path or find_config_file(BENCHMARK_FILE)
    file = read_study_file(path, ProtocolFile)
    return Protocol(file, validate_variations(machine, file.variations, str(path)))


class BenchmarkStudy(DrawStudy):
    """Draws with the protocol's own sequences of goals; each of them is planned only once."""

    def __init__(self, machine: Machine, protocol: Protocol) -> None:
        """Prepare planner and draws for a machine; builds the posture table if it is not cached.

        Args:
            machine: The machine that planner and servo know.
            protocol: Definition of the benchmark, loaded for this machine.
        """
        super().__init__(machine, protocol.variations, protocol.file.seed)
        self._sequences = protocol.file.sequences
        self._planned: dict[int, PlannedSequence] = {}

    def run(self, exact: bool, number: int) -> tuple[bool, list[DrawRecord]]:
        """Run one draw, or simulate every controller in one sequence on the machine as filed.

        Args:
            exact: True for a sequence of goals on the machine itself, False for a draw.
            number: Index of the sequence in the protocol, or number of the draw. It is also the
                seed of the sensor noise.

        Returns:
            `exact`, and one record for each controller with `number` in its field `draw`.
        """
        if not exact:
            return exact, self.run_draw(number)
        sequence = self._plan_sequence(number)
        return exact, [
            self.run_controller(name, number, {}, self._machine, sequence)
            for name in self._controllers
        ]

    def draw_plant(self, draw: int) -> tuple[PlannedSequence, Machine, dict[str, float | str]]:
        """Draw a plant at random, for a sequence of goals of the protocol.

        Args:
            draw: Number of the draw. It determines the sequence, since the sequences take turns.

        Returns:
            Three values: plans for the machine that planner and servo know, the plant to simulate,
            and a dictionary. It has the drawn factor, value, time or choice of each variation, by
            its name.

        Raises:
            MhsbError: The variations do not fit the machine.
        """
        sequence = self._plan_sequence(draw % len(self._sequences))
        random = np.random.default_rng((self._seed, draw))
        drawn = draw_machine(self._machine, self._variations, random, sequence.motion_time)
        return sequence, *drawn

    def _plan_sequence(self, number: int) -> PlannedSequence:
        """Return the plans of one sequence of goals.

        Args:
            number: Index of the sequence in the protocol.

        Returns:
            The plans. They are made on the first call for a sequence, and stored. If a goal cannot
            be planned, it counts as refused, and no error is raised.
        """
        if number not in self._planned:
            moves = self._sequences[number]
            self._planned[number] = self.plan_goals(moves.timed_goals, moves.options)
        return self._planned[number]


def run_benchmark(
    machine: Machine, protocol: Protocol, draws: int, jobs: Jobs = None
) -> Iterator[tuple[bool, list[DrawRecord]]]:
    """Run the mismatch benchmark in parallel processes.

    Args:
        machine: The machine that planner and servo know; its values are varied in the draws.
        protocol: Definition of the benchmark.
        draws: Number of draws.
        jobs: Number of processes or a cluster; None takes one process for each processor.

    Yields:
        The records of all controllers for each sequence of goals on the exact machine, with True
        before them, and for each draw, with False. They come as they are ready, in any order.

    Raises:
        RequestError: The number of processes is below 1.
        ClusterError: The cluster does not answer.
    """
    sequences = len(protocol.file.sequences)
    runs = [(True, number) for number in range(sequences)]
    runs += [(False, draw) for draw in range(draws)]
    with SharedStateExecutor(jobs, BenchmarkStudy, machine, protocol) as pool:
        yield from yield_results(pool.submit(BenchmarkStudy.run, *run) for run in runs)


REPORTED_MEASURES = {
    "RMS [mm]": ("tip_error_rms_mm", 1.0),
    "max [mm]": ("tip_error_max_mm", 1.0),
    "ρ [ms]": ("rho_s", 1e3),
    "overshoot [MPa]": ("supply_overshoot_mpa", 1.0),
    "later [s]": ("time_lost", 1.0),
    "energy, oil [kJ]": ("energy_hydraulic_j", 1e-3),
    "energy, shafts [kJ]": ("energy_shaft_j", 1e-3),
    "interventions": ("interventions", 1.0),
}
"""Quantities of the table: field of `DrawRecord`, and factor to the printed unit."""

REPORTED_QUANTILES = (0.5, 0.95, 1.0)
"""Median, 95 % quantile and worst of each quantity."""
QUANTILE_DECIMALS = 6
"""Number of decimals to which quantiles are rounded."""


def summarize(records: Sequence[DrawRecord], lost: float) -> dict[str, Any]:
    """Compute counts and quantiles over all records of each controller.

    Args:
        records: Records of all controllers.
        lost: A run counts as lost if its largest tip error exceeds this [m].

    Returns:
        A dictionary by name of the controller. Each entry has the counts `runs`, `failed`, `lost`
        and `relief_opened`. For each key of `REPORTED_MEASURES` it has a list: median, 95 %
        quantile and largest value, in the unit that the key names. A key is left out if no record
        has a value.
    """
    found: dict[str, Any] = {}
    for name, own in group_by_controller(records).items():
        errors = [r.tip_error_max_mm for r in own if r.tip_error_max_mm is not None]
        found[name] = {
            "runs": len(own),
            "failed": sum(bool(record.failure) for record in own),
            "lost": sum(error > 1e3 * lost for error in errors),
            "relief_opened": sum(bool(record.relief_opened) for record in own),
        }
        for measure, (field, factor) in REPORTED_MEASURES.items():
            values = [v for record in own if (v := getattr(record, field)) is not None]
            if values:
                quantiles = factor * np.quantile(values, REPORTED_QUANTILES)
                found[name][measure] = np.round(quantiles, QUANTILE_DECIMALS).tolist()
    return found


def as_markdown(summaries: dict[str, dict[str, Any]]) -> list[str]:
    """Format summaries as Markdown tables with a column for each controller.

    Args:
        summaries: Results of `summarize`, by title of the table.

    Returns:
        Lines without line breaks. The first rows of a table are numbers of runs: all, failed, lost,
        and with an open relief valve. Then each of `REPORTED_MEASURES` has a row with median / 95 %
        quantile / largest value; the cell is empty if there is no value.
    """
    lines = []
    for title, summary in summaries.items():
        lines += [f"| {title} | " + " | ".join(summary) + " |", "|---|" + "---|" * len(summary)]
        for count in ("runs", "failed", "lost", "relief_opened"):
            cells = " | ".join(str(own[count]) for own in summary.values())
            lines.append(f"| {count.replace('_', ' ')} | {cells} |")
        for measure in REPORTED_MEASURES:
            cells = " | ".join(
                " / ".join(f"{value:.3g}" for value in own.get(measure, ()))
                for own in summary.values()
            )
            lines.append(f"| {measure} | {cells} |")
        lines.append("")
    return lines
