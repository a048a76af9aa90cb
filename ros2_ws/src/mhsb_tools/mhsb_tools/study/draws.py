"""Draws: random plants that differ from the machine file that planner and servo know.

A draw is one plant and one random sequence of goals. The plans are made for the file's machine,
once, and given to every controller. Draw k of a seed is independent of the number of draws and
processes.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from mhsb_control import REGISTERED_CONTROLLERS, select_controllers
from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.goal import format_position
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.cases.moves import draw_random_position
from mhsb_planner.executor import Jobs, SharedStateExecutor, yield_results
from mhsb_planner.online.commit_horizon import compute_offline_horizon
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import DEFAULT_PLANNER, PlanOptions
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_sim.circuit.audit import sum_energy_by_source
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.study.draw_measures import (
    compute_planned_time,
    compute_rest_error,
    flow_suffices,
    measure_spool_deviation,
    read_payload_estimate,
)
from mhsb_tools.study.headless import TimedGoal
from mhsb_tools.study.replay import Replay, replay
from mhsb_tools.study.servo_study import compute_supply_overshoot, make_hold_command, plan_goals
from mhsb_tools.study.variations import Variations, draw_machine

GOAL_COUNT = 6
"""Default number of goals in a draw."""
MIN_INTERVAL, MAX_INTERVAL = 0.4, 5.0
"""Range of the time from one goal to the next [s]."""

TAIL_TIME = 2.0
"""Time for which a run goes on after the last motion [s]."""

LOWEST_SPEED = 1e-6
"""Least tip speed of the reference by which errors are divided [m/s]."""

PLAN_OPTIONS = PlanOptions(planner=DEFAULT_PLANNER)
REACH_OPTIONS = PlanOptions(planner="table")
"""Options for a quick test whether a goal can be reached; the motion is planned with
`PLAN_OPTIONS`.
"""


@dataclass(frozen=True)
class DrawRecord:
    """Measured numbers of one controller in one draw; None if a run failed before they were known.

    Attributes:
        controller: Name of the controller.
        draw: Number of the draw.
        varied: Factor, value, time or choice that was drawn, by name of the variation.
        tip_error_rms_mm: Root mean square distance of the measured tip from the servo's reference
            [mm].
        tip_error_max_mm: Largest such distance [mm].
        supply_overshoot_mpa: Largest excess of a supply line over what the motion of the plant
            needs, see `servo_study.compute_supply_overshoot` [MPa].
        relief_opened: Whether any relief valve let oil through.
        time_lost: Time by which the reference arrived later than the last plan says [s].
        interventions: Number of times that the guard boosted or slowed beyond the plan.
        rho_s: Largest tip error over the largest tip speed of the reference [s].
        energy_hydraulic_j: Energy that all pumps gave to the oil [J].
        energy_shaft_j: Energy at all pumps' shafts [J].
        later_percent: `time_lost` as a share of the time from the first plan's beginning to the
            last plan's end [%]; None if the plan was held.
        rest_error_mm: 95 % quantile of the tip error in the last second, at rest [mm]; None if the
            plan was held.
        spool_deviation_percent: Largest standard deviation of a valve spool at rest without sensor
            noise [% of its stroke]; None if the plan was held.
        flow_suffices: Whether the plant's main pump can deliver the flow that the plans need, see
            `draw_measures.flow_suffices`.
        payload_kg: Payload estimate after some motion, see `draw_measures.read_payload_estimate`
            [kg]; None, as the next three, if there is none.
        payload_half_interval_kg: Half width of the estimate's 95 % interval [kg].
        payload_error_percent: Absolute deviation of the estimate from the true payload [%].
        payload_holds: Whether the interval contains the true payload.
        failure: Why the draw failed, or why goals were refused; empty if neither.
        held: Why the guard held a plan until supervision would have stopped the arm; empty if it
            did not. The run ends there, so that the arm neither arrives nor rests.
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
class PlannedSequence:
    """Plans for a random sequence of goals.

    Attributes:
        commands: Commands by increasing stamp.
        duration: Duration of the run [s].
        refused: Why goals were refused, in one text; empty if none was.
    """

    commands: tuple[Command, ...]
    duration: float
    refused: str

    def motion_time(self, share: float) -> float:
        """Return the time at which a given share of all motion has been made.

        The time of motion is the sum of the times in which a plan moves the arm; pauses between
        plans do not count.

        Args:
            share: Share of the time of motion, 0 … 1.

        Returns:
            Time since the start of the sequence, pauses included [s]; 0 if there are no plans.
        """
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
    """Planner and simulator for the draws of one machine; a number identifies each draw."""

    def __init__(
        self,
        machine: Machine,
        variations: Variations,
        seed: int,
        plant: Machine | None = None,
        goals: int = GOAL_COUNT,
        controllers: Sequence[str] | None = None,
    ) -> None:
        """Prepare the planner for all draws; builds the posture table if it is not cached.

        Args:
            machine: The machine that planner and servo know.
            variations: Variations (how a plant may differ from its machine file) by name.
            seed: Seed of all draws.
            plant: Machine whose values are varied to make the plants; None varies `machine`.
            goals: Number of goals in each draw.
            controllers: Names of the controllers to simulate; None takes all that work with the
                machine's sensors.

        Raises:
            EmptyTableError: No node of the posture table has a posture.
            HoldingError: Holding the start posture needs more booster modules than the machine has.
        """
        self._machine = machine
        self._plant = plant or machine
        self._variations = variations
        self._seed = seed
        self._goals = goals
        self._controllers = controllers or select_controllers(machine)
        self._replanner = Replanner(machine, load_or_build_table(machine))
        self._rest = make_hold_command(machine)

    def run_draw(self, draw: int) -> list[DrawRecord]:
        """Choose a plant and goals at random, and simulate every controller on them.

        Args:
            draw: Number of the draw.

        Returns:
            One record for each controller. An error is not raised; its text is the record's
            `failure`.
        """
        names = self._controllers
        try:
            sequence, plant, drawn = self.draw_plant(draw)
        except Exception as error:  # any failure is a result of this draw
            return [DrawRecord(name, draw, {}, failure=_reason(error)) for name in names]
        return [self.run_controller(name, draw, drawn, plant, sequence) for name in names]

    def draw_plant(self, draw: int) -> tuple[PlannedSequence, Machine, dict[str, float | str]]:
        """Draw goals and a plant at random, and plan the goals.

        Args:
            draw: Number of the draw. The study's seed and this number determine the result.

        Returns:
            Three values: plans for the machine that planner and servo know, the plant to simulate,
            and a dictionary. It has the drawn factor, value, time or choice of each variation, by
            its name.

        Raises:
            MhsbError: The variations do not fit the plant.
        """
        random = np.random.default_rng((self._seed, draw))
        sequence = self.draw_sequence(random)
        plant, drawn = draw_machine(self._plant, self._variations, random, sequence.motion_time)
        return sequence, plant, drawn

    def draw_sequence(self, random: np.random.Generator) -> PlannedSequence:
        """Draw goals at random and plan them one after the other.

        Each goal can be reached from the start posture. It may still be refused when it is planned
        from the motion before it.

        Args:
            random: Generator of random numbers; its state changes.

        Returns:
            The plans, the duration of the run, and the reasons of refused goals.
        """
        return self.plan_goals([self._draw_goal(random) for _ in range(self._goals)])

    def plan_goals(
        self, goals: Sequence[TimedGoal], options: PlanOptions = PLAN_OPTIONS
    ) -> PlannedSequence:
        """Plan goals one after the other; each plan continues the motion of the one before.

        The first plan begins at rest in the start posture. Planning is assumed to take no time. If
        a goal cannot be planned, it counts as refused, and the motion before it goes on.

        Args:
            goals: The goals with the time until the next one.
            options: Options of the plans.

        Returns:
            The plans, the duration of the run with `TAIL_TIME` at its end, and the reasons of
            refused goals.
        """
        *starts, now = itertools.accumulate((goal.time for goal in goals), initial=0.0)
        timed = zip(starts, (goal.position for goal in goals), strict=True)
        commands, refusals = plan_goals(self._machine, self._replanner, timed, options)
        refused = [
            f"goal {format_position(goal, '.3f')} is refused: {error}" for goal, error in refusals
        ]
        end = max([now, *(command.trajectory.end_ns / SECOND_NS for command in commands)])
        return PlannedSequence(tuple(commands), end + TAIL_TIME, "; ".join(refused))

    def _draw_goal(self, random: np.random.Generator) -> TimedGoal:
        """Draw a goal that can be reached from the start posture, and the time until the next goal.

        Positions in the workspace are drawn until the planner finds a motion from the start
        posture. The time is drawn uniformly from `MIN_INTERVAL` to `MAX_INTERVAL`. The method does
        not end if no position can be reached.

        Args:
            random: Generator of random numbers; its state changes.

        Returns:
            The goal with the time until the next one.
        """
        horizon = compute_offline_horizon(self._machine)
        while True:
            position = draw_random_position(self._machine, random)
            try:
                self._replanner.replan(self._rest, 0, position, horizon, REACH_OPTIONS)
            except MhsbError:
                continue
            return TimedGoal(position, random.uniform(MIN_INTERVAL, MAX_INTERVAL))

    def run_controller(
        self,
        controller: str,
        draw: int,
        drawn: dict[str, float | str],
        plant: Machine,
        sequence: PlannedSequence,
    ) -> DrawRecord:
        """Simulate one controller on a drawn plant with given plans, and measure the run.

        Args:
            controller: Name of the controller.
            draw: Number of the draw; also the seed of the sensor noise.
            drawn: What was drawn, by name of the variation; stored in the record.
            plant: The plant to simulate.
            sequence: The plans.

        Returns:
            The record. An error is not raised: its text is `failure`, and the record has no
            measured numbers. A run in which goals are refused has numbers, and their reasons as
            `failure`.
        """
        try:
            simulator = Simulator(self._machine, controller, seed=draw, plant=plant)
            run = replay(simulator, sequence.commands, sequence.duration)
            error = 1e3 * run.tip_error(plant)
            sources = sum_energy_by_source(run.energies).values()
            payload = read_payload_estimate(plant, run)
            lost = compute_time_lost(sequence.commands, run)
            planned = max(compute_planned_time(sequence.commands), run.step)
            return DrawRecord(
                controller,
                draw,
                drawn,
                tip_error_rms_mm=float(np.sqrt(np.mean(error**2))),
                tip_error_max_mm=float(error.max()),
                supply_overshoot_mpa=float(compute_supply_overshoot(plant, run).max() / 1e6),
                relief_opened=run.energies["relief_valves"] > 0.0,
                time_lost=lost,
                later_percent=None if run.hold_reason else 100.0 * lost / planned,
                interventions=run.interventions,
                held=run.hold_reason,
                rho_s=float(
                    1e-3 * error.max() / max(compute_highest_tip_speed(plant, run), LOWEST_SPEED)
                ),
                energy_hydraulic_j=sum(source["hydraulic"] for source in sources),
                energy_shaft_j=sum(source["shaft"] for source in sources),
                rest_error_mm=None if run.hold_reason else compute_rest_error(error, run.step),
                flow_suffices=flow_suffices(self._machine, plant, sequence.commands),
                payload_kg=payload.value if payload else None,
                payload_half_interval_kg=payload.half_interval if payload else None,
                payload_error_percent=payload.error_percent if payload else None,
                payload_holds=payload.holds if payload else None,
                spool_deviation_percent=None
                if run.hold_reason
                else measure_spool_deviation(simulator),
                failure=sequence.refused,
            )
        except Exception as error:  # any failure is a result of this draw
            return DrawRecord(controller, draw, drawn, failure=_reason(error))


def compute_highest_tip_speed(machine: Machine, run: Replay) -> float:
    """Return the largest tip speed of the reference that was followed [m/s]."""
    tips = machine.tip_in_base(run.reference[:, 0])
    return float(np.linalg.norm(np.diff(tips, axis=0), axis=1).max(initial=0.0)) / run.step


def compute_time_lost(commands: Sequence[Command], run: Replay) -> float:
    """Return by how much the reference came to rest later than the last plan says.

    It is later if the guard (reference governor) has slowed the plans. The run must contain the end
    of the motion.

    Args:
        commands: Plans by increasing stamp.
        run: The record of the run.

    Returns:
        Time of the last sample at which the reference moves, minus the end of the last plan [s]. It
        is 0 if the reference arrived in time, nothing moved, or there are no commands.
    """
    moving = np.flatnonzero(np.any(run.reference[:, 1] != 0.0, axis=1))
    if not len(moving) or not commands:
        return 0.0
    planned = commands[-1].trajectory.end_ns / SECOND_NS
    return max(0.0, float(run.time[moving[-1]]) - planned)


def run_draws(
    make_study: Callable[[], DrawStudy], count: int, jobs: Jobs = None
) -> Iterator[list[DrawRecord]]:
    """Run the draws with numbers 0 … count − 1 in parallel processes.

    Args:
        make_study: Function that makes the study; it is called once in each process, so it must be
            picklable.
        count: Number of draws.
        jobs: Number of processes or a cluster; None takes one process for each processor.

    Yields:
        A list for each draw, with the records of all controllers. Draws come as they are ready, in
        any order.

    Raises:
        RequestError: The number of processes is below 1.
        ClusterError: The cluster does not answer.
    """
    with SharedStateExecutor(jobs, make_study) as pool:
        yield from yield_results(pool.submit(DrawStudy.run_draw, draw) for draw in range(count))


def group_by_controller(records: Sequence[DrawRecord]) -> dict[str, list[DrawRecord]]:
    """Return the records of each controller that has some, in the order of registration."""
    groups = {
        name: [record for record in records if record.controller == name]
        for name in REGISTERED_CONTROLLERS
    }
    return {name: group for name, group in groups.items() if group}


def as_dicts(records: Sequence[DrawRecord]) -> list[dict[str, object]]:
    """Convert records to plain dictionaries for JSON.

    Args:
        records: Records of all draws, in any order.

    Returns:
        A dictionary of all fields for each record. They are ordered by number of the draw, and
        within a draw by the order in which controllers are registered.
    """
    order = list(REGISTERED_CONTROLLERS)
    ordered = sorted(records, key=lambda record: (record.draw, order.index(record.controller)))
    return [asdict(record) for record in ordered]


def _reason(error: Exception) -> str:
    """Return an exception as text, with its type if it is none of the suite's own."""
    return str(error) if isinstance(error, MhsbError) else f"{type(error).__name__}: {error}"
