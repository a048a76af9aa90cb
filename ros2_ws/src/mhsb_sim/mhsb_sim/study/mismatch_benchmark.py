"""The mismatch benchmark: fixed moves on drawn plants, read from config/mismatch_benchmark.yaml.

The file is the protocol, docs/benchmark.md tells what it means. Every sequence is run once on the
machine itself, then every draw on its plant; all controllers are given the same plans.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError

from mhsb_model.files.config_files import config_file
from mhsb_model.files.schema_problems import problems_of
from mhsb_model.files.yaml_files import YamlFileError, read_yaml
from mhsb_model.machine import Machine
from mhsb_model.schema import Duration, Section, Weight
from mhsb_planner.planner import ONLINE_PLANNER, PlanOptions
from mhsb_planner.search.s2_search import Weights
from mhsb_planner.workers import Jobs, Prepared, results_of
from mhsb_sim.errors import ScenarioError
from mhsb_sim.servo import CONTROLLERS
from mhsb_sim.study.draws import DrawRecord, DrawStudy, GoalSequence
from mhsb_sim.study.headless import TimedGoal
from mhsb_sim.study.variations import Variations, variations_of, varied

BENCHMARK_FILE = "mismatch_benchmark.yaml"

Coordinate = Annotated[float, Field(ge=-10.0, le=10.0)]


class BenchmarkMoves(Section):
    """Goals that come one after the other, and what their plans are to be like."""

    weights: tuple[Weight, Weight, Weight] = Field(
        description="of energy [1/J], time [1/s] and mode switches [-]"
    )
    goals: tuple[tuple[Coordinate, Coordinate, Duration], ...] = Field(
        min_length=1, description="tip x, z [m] and the time until the next goal [s]"
    )

    @property
    def options(self) -> PlanOptions:
        """Of the plans."""
        return PlanOptions(Weights(*self.weights), planner=ONLINE_PLANNER)

    @property
    def timed_goals(self) -> list[TimedGoal]:
        """The goals."""
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
    """A benchmark for a machine."""

    file: ProtocolFile
    variations: Variations


def load_protocol(machine: Machine, path: Path | None = None) -> Protocol:
    """The protocol of a file, the suite's own when left out; raises ScenarioError."""
    path = path or config_file(BENCHMARK_FILE)
    try:
        file = ProtocolFile.model_validate(read_yaml(path))
    except YamlFileError as error:
        raise ScenarioError(str(error)) from None
    except ValidationError as error:
        raise ScenarioError(f"{path}: {'; '.join(problems_of(error, ProtocolFile))}") from error
    return Protocol(file, variations_of(machine, file.variations, str(path)))


class BenchmarkStudy:
    """Runs of a protocol by number; plans are made once for each sequence."""

    def __init__(self, machine: Machine, protocol: Protocol) -> None:
        self._machine = machine
        self._protocol = protocol
        self._study = DrawStudy(machine, protocol.variations, protocol.file.seed)
        self._planned: dict[int, GoalSequence] = {}

    def exact(self, number: int) -> list[DrawRecord]:
        """Every controller in a sequence, on the machine as its file says."""
        sequence = self._sequence(number)
        return [
            self._study.record(name, number, {}, self._machine, sequence) for name in CONTROLLERS
        ]

    def records(self, draw: int) -> list[DrawRecord]:
        """Every controller in a draw."""
        file = self._protocol.file
        sequence = self._sequence(draw % len(file.sequences))
        random = np.random.default_rng((file.seed, draw))
        plant, drawn = varied(self._machine, self._protocol.variations, random, sequence.moment)
        return [self._study.record(name, draw, drawn, plant, sequence) for name in CONTROLLERS]

    def _sequence(self, number: int) -> GoalSequence:
        if number not in self._planned:
            moves = self._protocol.file.sequences[number]
            self._planned[number] = self._study.planned(moves.timed_goals, moves.options)
        return self._planned[number]


@dataclass(frozen=True)
class Results:
    """Records of some runs: `exact` of one sequence on the machine itself, or of one draw."""

    exact: bool
    records: list[DrawRecord]


def run_benchmark(
    machine: Machine, protocol: Protocol, draws: int, jobs: Jobs = None
) -> Iterator[Results]:
    """All sequences on the exact machine and so many draws, as they come, done by `jobs`."""
    sequences = len(protocol.file.sequences)
    runs = [(True, number) for number in range(sequences)]
    runs += [(False, draw) for draw in range(draws)]
    with Prepared(jobs, BenchmarkStudy, machine, protocol) as pool:
        yield from results_of(pool.submit(_run, *run) for run in runs)


MEASURES = {
    "RMS [mm]": ("tip_error_rms_mm", 1.0),
    "max [mm]": ("tip_error_max_mm", 1.0),
    "ρ [ms]": ("rho_s", 1e3),
    "overshoot [MPa]": ("supply_overshoot_mpa", 1.0),
    "later [s]": ("time_lost", 1.0),
    "energy, oil [kJ]": ("energy_hydraulic_j", 1e-3),
    "energy, shafts [kJ]": ("energy_shaft_j", 1e-3),
    "interventions": ("interventions", 1.0),
}
"""What is told of each run: its field, and the factor to the unit that it is told in."""

QUANTILES = (0.5, 0.95, 1.0)
DIGITS = 6


def summarize(records: Sequence[DrawRecord], lost: float) -> dict[str, Any]:
    """By controller: runs, failures, lost arms, opened reliefs; median, p95 and worst of each.

    lost: tip error from which on an arm counts as lost [m].
    """
    found: dict[str, Any] = {}
    for name in CONTROLLERS:
        own = [record for record in records if record.controller == name]
        errors = [r.tip_error_max_mm for r in own if r.tip_error_max_mm is not None]
        found[name] = {
            "runs": len(own),
            "failed": sum(bool(record.failure) for record in own),
            "lost": sum(error > 1e3 * lost for error in errors),
            "relief_opened": sum(bool(record.relief_opened) for record in own),
        }
        for measure, (field, factor) in MEASURES.items():
            values = [v for record in own if (v := getattr(record, field)) is not None]
            if values:
                quantiles = factor * np.quantile(values, QUANTILES)
                found[name][measure] = np.round(quantiles, DIGITS).tolist()
    return found


def as_markdown(summaries: dict[str, dict[str, Any]]) -> list[str]:
    """A table for the docs: median / p95 / worst of each controller, a block for each summary."""
    lines = []
    for title, summary in summaries.items():
        lines += [f"| {title} | " + " | ".join(summary) + " |", "|---|" + "---|" * len(summary)]
        for count in ("runs", "failed", "lost", "relief_opened"):
            cells = " | ".join(str(own[count]) for own in summary.values())
            lines.append(f"| {count.replace('_', ' ')} | {cells} |")
        for measure in MEASURES:
            cells = " | ".join(
                " / ".join(f"{value:.3g}" for value in own.get(measure, ()))
                for own in summary.values()
            )
            lines.append(f"| {measure} | {cells} |")
        lines.append("")
    return lines


def _run(study: BenchmarkStudy, exact: bool, number: int) -> Results:
    return Results(exact, study.exact(number) if exact else study.records(number))
