"""Benchmark of the time to a first motion, and of how far planning overruns its deadline.

The moves are planned on three machines: as it is, with a payload and a supply pressure that need
much boost, and with thick links among obstacles. They start from rest, and from the middle of a
motion.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from mhsb_model.braking import brake_along
from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import MotionState, Trajectory
from mhsb_model.types import Position
from mhsb_planner.cases.moves import Move
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.errors import DeadlineError
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planner import Plan, Planner, PlannerKind, PlanOptions

MILLI = 1e3
SEED = 0

PLANNERS: tuple[PlannerKind, ...] = ("table", "integrated")

HEAVY_PAYLOAD, LOW_PRESSURE = 1.6, 0.625
"""Factors on the machine file's payload and supply pressure; 16 kg and 2.5 MPa for the suite's own
arm.
"""

LINK_RADIUS, LAST_LINK_RADIUS = 0.03, 0.02
"""Radii of thick links, and of the last link, for an arm of the paper's size [m]."""
ZONES = Zones(
    circles=((0.80, 0.25, 0.08), (0.45, -0.75, 0.10)), tip_boxes=((0.45, 0.30, 0.60, 0.40),)
)
"""Keep-out zones of arms that do not slew."""
POLE, BALL = (0.6, 0.6, -1.0, 0.2, 0.08), (0.7, -0.5, 0.3, 0.1)
"""Obstacles of arms that slew: an upright cylinder for the whole arm and a sphere for its tip.
Their numbers, and the link radii [m], are multiplied by the arm's `Machine.relative_size`.
"""

LONGEST = 0.06
"""Largest deadline after the call; deadlines are drawn from 0 to this [s]."""

OFF_GRID = (0.013, -0.011)
"""Offset from a node to a goal beside the grid [m]."""

RUNS = 5
"""Number of times that each first motion is timed."""
LONG_ENOUGH = 0.1
"""Deadline within which a first motion is found [s]."""

PERCENTILES = (50, 90, 99)
"""Percentiles of the overruns that are reported."""


class DeadlineRequest(NamedTuple):
    """A goal and the state from which it is planned.

    Attributes:
        goal: Goal in `base_link` [m].
        start: Start state.
        modes: Modes in force there; None leaves them to the planner.
        brake: Motion by which a moving start comes to rest; None for a start at rest.
    """

    goal: Position
    start: MotionState
    modes: StartModes | None = None
    brake: Trajectory | None = None

    def plan(
        self, planner: Planner, options: PlanOptions, deadline: Deadline = NO_DEADLINE
    ) -> Plan:
        """Return the plan of the request.

        Args:
            planner: The planner.
            options: Options of the plan.
            deadline: When planning must end.
        """
        return planner.plan(
            self.goal,
            self.start,
            modes=self.modes,
            brake=self.brake,
            options=options,
            deadline=deadline,
        )

    def with_goal_off_grid(self) -> DeadlineRequest:
        """Return the request with a goal that is no node of the grid."""
        x, *y, z = self.goal
        return self._replace(goal=(x + OFF_GRID[0], *y, z + OFF_GRID[1]))


def machines(base: Machine) -> dict[str, Machine]:
    """Return the machines on which the moves are planned.

    Args:
        base: The machine as it is.

    Returns:
        `plain`: `base` itself. `loaded`: more payload, less supply pressure. `obstacles`: thick
        links, self-collision and zones.
    """
    content, size, zones = base.config.model_dump(), 1.0, ZONES
    if base.slews:
        size = base.relative_size
        pole, ball = (tuple(size * number for number in zone) for zone in (POLE, BALL))
        zones = Zones(cylinders=(pole,), tip_spheres=(ball,))
    radii = (*(base.planar_arm.joint_count - 1) * (size * LINK_RADIUS,), size * LAST_LINK_RADIUS)
    content["keep_out"] |= {"link_radii": radii, "self_collision": True}
    thick = Machine.from_config(type(base.config).model_validate(content))
    return {
        "plain": base,
        "loaded": base.changed(
            payload=HEAVY_PAYLOAD * base.arrays.payload,
            supply_pressure=LOW_PRESSURE * base.arrays.supply_pressure,
        ),
        "obstacles": thick.changed(zones=zones),
    }


def from_rest(moves: Sequence[Move]) -> Iterator[DeadlineRequest]:
    """Yield a request from rest for each move."""
    for move in moves:
        yield DeadlineRequest(move.goal, MotionState.at_rest(move.start))


def from_motion(planner: Planner, moves: Sequence[Move]) -> Iterator[DeadlineRequest]:
    """Yield requests that leave each move on its way, for the goal of the next move.

    The instant is drawn between a quarter and three quarters of the motion. Moves without a plan
    are skipped.

    Args:
        planner: The planner.
        moves: The moves; the last one continues to the goal of the first.

    Yields:
        Requests with a moving start state.
    """
    random, options = np.random.default_rng(SEED), PlanOptions(planner="integrated")
    for move, other in zip(moves, [*moves[1:], *moves[:1]], strict=True):
        try:
            motion = planner.plan(
                move.goal, MotionState.at_rest(move.start), options=options
            ).motion
        except MhsbError:
            continue
        trajectory = motion.trajectory
        at_ns = round(random.uniform(0.25, 0.75) * trajectory.duration_ns)
        yield DeadlineRequest(
            other.goal,
            trajectory.sample(at_ns),
            StartModes.read_from(motion.schedule, at_ns),
            brake_along(planner.machine, trajectory, at_ns),
        )


def first_motion_figures(
    planner: Planner, moves: Sequence[Move], dijkstra_ms: float
) -> dict[str, Any]:
    """Measure the time to the first motion from rest and from motion.

    Each request counts with the median of `RUNS` times; between two of its runs all other requests
    are planned.

    Args:
        planner: The planner.
        moves: The moves.
        dijkstra_ms: Median time of SciPy's Dijkstra [ms].

    Returns:
        By planner and start (`rest`, `motion`): percentiles [ms], and p99 over SciPy's median.
    """
    starts = {"rest": list(from_rest(moves)), "motion": list(from_motion(planner, moves))}
    figures: dict[str, Any] = {kind: {} for kind in PLANNERS}
    for kind, (name, requests) in itertools.product(PLANNERS, starts.items()):
        times = np.full((RUNS, len(requests)), np.nan)
        bar = tqdm(total=times.size, desc=f"first motions, {kind}, from {name}")
        for run, (k, request) in itertools.product(range(RUNS), enumerate(requests)):
            times[run, k] = _first_motion(planner, request, kind)
            bar.update()
        medians = np.median(times[:, np.isfinite(times).all(axis=0)], axis=0)
        p50, p99 = np.percentile(medians, [50, 99]).tolist()
        single = float(np.nanpercentile(times, 99))
        figures[kind][name] = {
            "p50": p50,
            "p99": p99,
            "p99_of_single_runs": single,
            "p99_over_dijkstra": p99 / dijkstra_ms,
        }
    return figures


def _first_motion(planner: Planner, request: DeadlineRequest, kind: PlannerKind) -> float:
    """Measure the time until the first motion is found.

    Args:
        planner: The planner.
        request: What to plan.
        kind: Name of the planner.

    Returns:
        The time [ms], without the work after the first motion; NaN if none was found.
    """
    try:
        plan = request.plan(planner, PlanOptions(planner=kind), Deadline.after(LONG_ENOUGH))
    except MhsbError:
        return math.nan
    return MILLI * plan.seconds["first_motion"]


def overrun_figures(planner: Planner, moves: Sequence[Move]) -> dict[str, Any]:
    """Measure how long after its deadline planning returns.

    Deadlines are drawn uniformly up to `LONGEST`; every other goal is off the grid. Only plans that
    the deadline ended count.

    Args:
        planner: The planner; its machine is restored afterwards.
        moves: The moves, planned on each of `machines`.

    Returns:
        Percentiles and largest overrun [ms] over all plans, and by planner. Counts of plans asked
        for, ended by the deadline, and without a motion.
    """
    base, everything = planner.machine, _Overruns()
    figures: dict[str, Any] = {}
    for kind in PLANNERS:
        overruns, random = _Overruns(), np.random.default_rng(SEED)
        for name, machine in machines(base).items():
            planner.change_machine(machine)
            requests = [*from_rest(moves), *from_motion(planner, moves)]
            for i, request in enumerate(tqdm(requests, desc=f"deadlines, {kind}, {name}")):
                asked = request.with_goal_off_grid() if i % 2 else request
                overruns.measure(planner, asked, PlanOptions(planner=kind), random)
        figures[kind] = overruns.figures()
        everything.add(overruns)
    planner.change_machine(base)
    return everything.figures() | figures


@dataclass
class _Overruns:
    """Overruns of plans with a deadline, and how the plans ended.

    Attributes:
        late: Time from the deadline to the return of each plan that the deadline ended [ms].
        asked: Number of plans.
        without_motion: Number of plans that ended without a motion.
    """

    late: list[float] = field(default_factory=list)
    asked: int = 0
    without_motion: int = 0

    def measure(
        self,
        planner: Planner,
        request: DeadlineRequest,
        options: PlanOptions,
        random: np.random.Generator,
    ) -> None:
        """Plan with a random deadline and record the overrun.

        Requests that fail for another reason than the deadline do not count.

        Args:
            planner: The planner.
            request: What to plan.
            options: Options of the plan.
            random: Generator of the deadlines; advanced.
        """
        deadline = Deadline.after(random.uniform(0.0, LONGEST))
        found = True
        try:
            request.plan(planner, options, deadline)
        except DeadlineError:
            found = False
        except MhsbError:
            return
        late = -MILLI * deadline.remaining
        self.asked += 1
        self.without_motion += not found
        if late >= 0.0:
            self.late.append(late)

    def add(self, other: _Overruns) -> None:
        """Add the plans of another record to this one.

        Args:
            other: The other record; it stays as it is.
        """
        self.late += other.late
        self.asked += other.asked
        self.without_motion += other.without_motion

    def figures(self) -> dict[str, float]:
        """Return percentiles and largest overrun [ms], and the counts."""
        late = self.late or [0.0]
        return {f"p{p}": float(np.percentile(late, p)) for p in PERCENTILES} | {
            "max": max(late),
            "asked": self.asked,
            "ended_by_deadline": len(self.late),
            "without_motion": self.without_motion,
        }


def first_motion_lines(figures: dict[str, Any]) -> list[str]:
    """Format the times to the first motion as lines of a table."""
    return [
        f"first motion     {kind} from {start}: p50 {value['p50']:.1f} ms, "
        f"p99 {value['p99']:.1f} ms, {value['p99_over_dijkstra']:.1f} times SciPy's median"
        for kind, starts in figures.items()
        for start, value in starts.items()
    ]


def overrun_lines(figures: dict[str, Any]) -> list[str]:
    """Format the overruns as lines of a table.

    Args:
        figures: Result of `overrun_figures`.

    Returns:
        A line for all plans, then one for each planner.
    """
    rows = {"all": figures, **{kind: figures[kind] for kind in PLANNERS}}
    return [
        f"overrun          {name}: p50 {row['p50']:.2f} ms, p90 {row['p90']:.2f} ms, p99 "
        f"{row['p99']:.2f} ms, max {row['max']:.2f} ms of {row['ended_by_deadline']} plans ended "
        f"by deadlines up to {MILLI * LONGEST:.0f} ms ({row['without_motion']} without motion, "
        f"{row['asked']} asked for)"
        for name, row in rows.items()
    ]
