"""Draws: a servo that knows the machine file, on a plant that is not as the file says.

A draw is one plant and one random sequence of goals; planner and servo know the file's machine
alone. Its plans are made once and given to every controller. Draw k of a seed is the same whatever
the number of draws and processes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.goal import place
from mhsb_model.holding import holding_modes
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.evaluation.moves import anywhere
from mhsb_planner.online.lead import OFFLINE_LEAD
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import ONLINE_PLANNER, PlanOptions
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_planner.workers import Jobs, Prepared, results_of
from mhsb_sim.circuit.audit import energy_by_source
from mhsb_sim.servo import CONTROLLERS
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.study.draw_measures import (
    flow_suffices,
    planned_time,
    rest_error,
    spool_deviation,
    told_payload,
)
from mhsb_sim.study.headless import TimedGoal
from mhsb_sim.study.replay import Replay, replay
from mhsb_sim.study.servo_study import supply_overshoot
from mhsb_sim.study.variations import Variations, varied

GOALS = 6
SHORTEST, LONGEST = 0.4, 5.0
"""From one goal to the next [s]."""

TAIL = 2.0
"""How long a run goes on after the last motion [s]."""

LOWEST_SPEED = 1e-6
"""Of the reference's tip, that errors are related to [m/s]."""

OPTIONS = PlanOptions(planner=ONLINE_PLANNER)
REACHING = PlanOptions(planner="table")
"""Tells at once whether there is a way to a goal; the way itself is planned by OPTIONS."""


@dataclass(frozen=True)
class DrawRecord:
    """One controller in one draw; numbers are None where the run failed before there were any.

    varied                what was drawn, by the variations' names
    tip_error_…           measured tip against the servo's reference, the whole run [mm]
    supply_overshoot_mpa  as in `servo_study.supply_overshoot`, the need being the plant's
    relief_opened         whether any relief valve let oil through
    time_lost             by which the reference arrived later than the last plan says [s]
    later_percent         the same, of the time from the first plan's beginning to the last's end
    interventions         times that the guard boosted or slowed beyond the plan
    rho_s                 largest tip error over the largest speed of the reference's tip [s]
    energy_…              of all pumps, given to the oil and taken at their shafts [J]
    rest_error_mm         tip from its goal in the last second, 95 % of it
    spool_deviation_percent  as in `draw_measures.spool_deviation`
    flow_suffices         whether the main pump delivers what the plans take from this plant
    payload_kg, payload_half_interval_kg, payload_error_percent, payload_holds
                          as in `draw_measures.told_payload`; None where it is not to be told
    failure               why the draw failed, empty where it did not
    held                  why the guard held a plan until supervision would have stopped the arm,
                          which ends the run: it neither arrives nor rests; empty where it did not
    """

    controller: str
    draw: int
    varied: dict[str, float | str]
    tip_error_rms_mm: float | None = None
    tip_error_max_mm: float | None = None
    supply_overshoot_mpa: float | None = None
    relief_opened: bool | None = None
    time_lost: float | None = None
    interventions: int | None = None
    rho_s: float | None = None
    energy_hydraulic_j: float | None = None
    energy_shaft_j: float | None = None
    later_percent: float | None = None
    rest_error_mm: float | None = None
    spool_deviation_percent: float | None = None
    flow_suffices: bool | None = None
    payload_kg: float | None = None
    payload_half_interval_kg: float | None = None
    payload_error_percent: float | None = None
    payload_holds: bool | None = None
    failure: str = ""
    held: str = ""


@dataclass(frozen=True, eq=False)
class GoalSequence:
    """Plans for a random sequence of goals, and how long it lasts [s]; refused: why a goal was."""

    commands: tuple[Command, ...]
    duration: float
    refused: str

    def moment(self, share: float) -> float:
        """The time [s] when this share of all time of motion is over."""
        starts = [command.stamp_ns for command in self.commands]
        ends = [*starts[1:], self.commands[-1].trajectory.end_ns] if starts else []
        spans = [
            max(0, min(end, command.trajectory.end_ns) - start)
            for start, end, command in zip(starts, ends, self.commands, strict=True)
        ]
        left = share * sum(spans)
        for start, span in zip(starts, spans, strict=True):
            if left <= span:
                return (start + left) / SECOND_NS
            left -= span
        return 0.0


class DrawStudy:
    """Draws of one machine with its variations: plans and runs of each, by number.

    plant: what is varied; the machine itself where left out. goals: how many in each sequence.
    controllers: those that run.
    """

    def __init__(
        self,
        machine: Machine,
        variations: Variations,
        seed: int,
        plant: Machine | None = None,
        goals: int = GOALS,
        controllers: Sequence[str] = tuple(CONTROLLERS),
    ) -> None:
        self._machine = machine
        self._plant = plant or machine
        self._variations = variations
        self._seed = seed
        self._goals = goals
        self._controllers = controllers
        self._replanner = Replanner(machine, table_for(machine))
        start = np.array(machine.config.simulation.start_posture)
        self._rest = Command.hold(0, start, holding_modes(machine, machine.piston_forces(start)))

    def records(self, draw: int) -> list[DrawRecord]:
        """Every controller in a draw; nothing that goes wrong there is left out."""
        names = self._controllers
        try:
            sequence, plant, drawn = self.drawn(draw)
        except Exception as error:  # whatever it is, it is this draw's result
            return [DrawRecord(name, draw, {}, failure=_reason(error)) for name in names]
        return [self.record(name, draw, drawn, plant, sequence) for name in names]

    def drawn(self, draw: int) -> tuple[GoalSequence, Machine, dict[str, float | str]]:
        """Plans, plant, and what was drawn for it; raises whatever goes wrong."""
        random = np.random.default_rng((self._seed, draw))
        sequence = self.sequence(random)
        plant, drawn = varied(self._plant, self._variations, random, sequence.moment)
        return sequence, plant, drawn

    def sequence(self, random: np.random.Generator) -> GoalSequence:
        """Goals anywhere that the arm could go to from its start, planned one after the other."""
        return self.planned([self._goal(random) for _ in range(self._goals)])

    def planned(
        self, goals: Sequence[TimedGoal], options: PlanOptions = OPTIONS
    ) -> GoalSequence:
        """Plans from the start posture on, each from the one before; planning takes no time."""
        command, commands, refused, now = self._rest, [], [], 0.0
        for goal in goals:
            now_ns = round(now * SECOND_NS)
            now += goal.time
            try:
                replan = self._replanner.replan(
                    command, now_ns, goal.position, OFFLINE_LEAD, options
                )
            except MhsbError as error:
                refused.append(f"goal {place(goal.position, '.3f')} is refused: {error}")
                continue
            if replan is not None:
                command = replan.command
                commands.append(command)
        end = max([now, *(command.trajectory.end_ns / SECOND_NS for command in commands)])
        return GoalSequence(tuple(commands), end + TAIL, "; ".join(refused))

    def _goal(self, random: np.random.Generator) -> TimedGoal:
        """A point of the workspace that there is a plan to from the start."""
        while True:
            position = anywhere(self._machine, random)
            try:
                self._replanner.replan(self._rest, 0, position, OFFLINE_LEAD, REACHING)
            except MhsbError:
                continue
            return TimedGoal(position, random.uniform(SHORTEST, LONGEST))

    def record(
        self,
        controller: str,
        draw: int,
        drawn: dict[str, float | str],
        plant: Machine,
        sequence: GoalSequence,
    ) -> DrawRecord:
        """A controller on a plant that was drawn; whatever goes wrong is told there."""
        try:
            simulator = Simulator(self._machine, controller, seed=draw, plant=plant)
            run = replay(simulator, sequence.commands, sequence.duration)
            error = 1e3 * run.tip_error(plant)
            sources = energy_by_source(run.energies).values()
            told, lost = told_payload(plant, run), time_lost(sequence.commands, run)
            planned = max(planned_time(sequence.commands), run.step)
            return DrawRecord(
                controller,
                draw,
                drawn,
                tip_error_rms_mm=float(np.sqrt(np.mean(error**2))),
                tip_error_max_mm=float(error.max()),
                supply_overshoot_mpa=float(supply_overshoot(plant, run).max() / 1e6),
                relief_opened=run.energies["relief_valves"] > 0.0,
                time_lost=lost,
                later_percent=None if run.held else 100.0 * lost / planned,
                interventions=run.interventions,
                held=run.held,
                rho_s=float(1e-3 * error.max() / max(highest_tip_speed(plant, run), LOWEST_SPEED)),
                energy_hydraulic_j=sum(source["hydraulic"] for source in sources),
                energy_shaft_j=sum(source["shaft"] for source in sources),
                rest_error_mm=None if run.held else rest_error(error, run.step),
                flow_suffices=flow_suffices(self._machine, plant, sequence.commands),
                payload_kg=told.value if told else None,
                payload_half_interval_kg=told.half_interval if told else None,
                payload_error_percent=told.error_percent if told else None,
                payload_holds=told.holds if told else None,
                spool_deviation_percent=None if run.held else spool_deviation(simulator),
                failure=sequence.refused,
            )
        except Exception as error:  # as above
            return DrawRecord(controller, draw, drawn, failure=_reason(error))


def highest_tip_speed(machine: Machine, run: Replay) -> float:
    """Of the reference that was followed [m/s]."""
    tips = machine.tip_in_base(run.reference[:, 0])
    return float(np.linalg.norm(np.diff(tips, axis=0), axis=1).max(initial=0.0)) / run.step


def time_lost(commands: Sequence[Command], run: Replay) -> float:
    """By how much later the reference has come to rest than the last plan has it [s]."""
    moving = np.flatnonzero(np.any(run.reference[:, 1] != 0.0, axis=1))
    if not len(moving) or not commands:
        return 0.0
    planned = commands[-1].trajectory.end_ns / SECOND_NS
    return max(0.0, float(run.time[moving[-1]]) - planned)


def run_draws(
    machine: Machine,
    variations: Variations,
    count: int,
    seed: int,
    jobs: Jobs = None,
    plant: Machine | None = None,
    goals: int = GOALS,
    controllers: Sequence[str] = tuple(CONTROLLERS),
) -> Iterator[list[DrawRecord]]:
    """Records of draws 0 … count − 1 as they come, each done by one of `jobs`.

    plant: what is varied; the machine itself where left out. goals: how many in each draw.
    """
    task = machine, variations, seed, plant, goals, tuple(controllers)
    with Prepared(jobs, DrawStudy, *task) as pool:
        yield from results_of(pool.submit(DrawStudy.records, draw) for draw in range(count))


def as_dicts(records: Sequence[DrawRecord]) -> list[dict[str, object]]:
    """Records as plain dicts, ready for JSON, in the order of the draws."""
    order = list(CONTROLLERS)
    ordered = sorted(records, key=lambda record: (record.draw, order.index(record.controller)))
    return [asdict(record) for record in ordered]


def _reason(error: Exception) -> str:
    return str(error) if isinstance(error, MhsbError) else f"{type(error).__name__}: {error}"
