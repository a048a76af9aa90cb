"""How soon there is a motion, and by how much planning outlasts its deadline.

The same moves on three machines: as it is, with a payload and a supply pressure at which much has
to be boosted, and with thick links among obstacles; from rest, and from the middle of a motion.
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
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.errors import DeadlineError
from mhsb_planner.evaluation.moves import Move
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planner import Plan, Planner, PlannerKind, PlanOptions

MILLI = 1e3
SEED = 0

PLANNERS: tuple[PlannerKind, ...] = ("table", "integrated")

HEAVY_PAYLOAD, LOW_PRESSURE = 1.6, 0.625
"""Of the machine file's; of the suite's own arm 16 kg and 2.5 MPa."""

LINK_RADIUS, LAST_LINK_RADIUS = 0.03, 0.02  # m
ZONES = Zones(
    circles=((0.80, 0.25, 0.08), (0.45, -0.75, 0.10)), tip_boxes=((0.45, 0.30, 0.60, 0.40),)
)
POLE, BALL = (0.6, 0.6, -1.0, 0.2, 0.08), (0.7, -0.5, 0.3, 0.1)
"""Of arms that slew: a cylinder for the whole arm and a sphere for its tip, in times the arm's
`Machine.scale`, as are their links' radii [m]."""

LONGEST = 0.06
"""Deadlines are drawn up to so long after the call [s]."""

OFF_GRID = (0.013, -0.011)
"""From a node to a goal that is none [m]."""

RUNS = 5
LONG_ENOUGH = 0.1
"""For a first motion [s]."""

PERCENTILES = (50, 90, 99)


class Request(NamedTuple):
    """Goal in `base_link` [m], start, modes in force there, how a moving start comes to rest."""

    goal: Position
    start: MotionState
    modes: StartModes | None = None
    brake: Trajectory | None = None

    def plan(self, planner: Planner, options: PlanOptions, deadline: Deadline = NEVER) -> Plan:
        """The plan for it."""
        return planner.plan(self.goal, self.start, self.modes, self.brake, options, deadline)

    def beside_the_grid(self) -> Request:
        """The same with a goal that is no node."""
        x, *y, z = self.goal
        return self._replace(goal=(x + OFF_GRID[0], *y, z + OFF_GRID[1]))


def machines(base: Machine) -> dict[str, Machine]:
    """The machines by name."""
    content, size, zones = base.config.model_dump(), 1.0, ZONES
    if base.slews:
        size = base.scale
        pole, ball = (tuple(size * number for number in zone) for zone in (POLE, BALL))
        zones = Zones(cylinders=(pole,), tip_spheres=(ball,))
    radii = (*(base.plane.joint_count - 1) * (size * LINK_RADIUS,), size * LAST_LINK_RADIUS)
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


def from_rest(moves: Sequence[Move]) -> Iterator[Request]:
    """The moves as they are."""
    for move in moves:
        yield Request(move.goal, MotionState.at_rest(move.start))


def from_motion(planner: Planner, moves: Sequence[Move]) -> Iterator[Request]:
    """Each move left on its way, between a quarter and three quarters, for the next one's goal."""
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
        yield Request(
            other.goal,
            trajectory.sample(at_ns),
            StartModes.during(motion.schedule, at_ns),
            brake_along(planner.machine, trajectory, at_ns),
        )


def first_motion_figures(
    planner: Planner, moves: Sequence[Move], dijkstra_ms: float
) -> dict[str, Any]:
    """Time to the first motion [ms] by planner and start, and its p99 over SciPy's median.

    Each request's is the median of RUNS, with all other requests in between.
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


def _first_motion(planner: Planner, request: Request, kind: PlannerKind) -> float:
    """Time until there is one [ms]; NaN where there is none. What would come after is left out."""
    try:
        plan = request.plan(planner, PlanOptions(planner=kind), Deadline.after(LONG_ENOUGH))
    except MhsbError:
        return math.nan
    return MILLI * plan.seconds["first_motion"]


def overrun_figures(planner: Planner, moves: Sequence[Move]) -> dict[str, Any]:
    """Time from the deadline to the return [ms], where planning was ended by it.

    Deadlines are drawn evenly up to LONGEST; every other goal is off the grid. Over all plans, and
    by planner, with how many were asked for, ended by the deadline, and ended without a motion.
    """
    base, everything = planner.machine, _Overruns()
    figures: dict[str, Any] = {}
    for kind in PLANNERS:
        overruns, random = _Overruns(), np.random.default_rng(SEED)
        for name, machine in machines(base).items():
            planner.change(machine)
            requests = [*from_rest(moves), *from_motion(planner, moves)]
            for i, request in enumerate(tqdm(requests, desc=f"deadlines, {kind}, {name}")):
                asked = request.beside_the_grid() if i % 2 else request
                overruns.measure(planner, asked, PlanOptions(planner=kind), random)
        figures[kind] = overruns.figures()
        everything.add(overruns)
    planner.change(base)
    return everything.figures() | figures


@dataclass
class _Overruns:
    """Overruns [ms], and how plans with a deadline ended."""

    late: list[float] = field(default_factory=list)
    asked: int = 0
    without_motion: int = 0

    def measure(
        self, planner: Planner, request: Request, options: PlanOptions, random: np.random.Generator
    ) -> None:
        """Plan with a deadline; requests without plan do not count."""
        deadline = Deadline.after(random.uniform(0.0, LONGEST))
        found = True
        try:
            request.plan(planner, options, deadline)
        except DeadlineError:
            found = False
        except MhsbError:
            return
        late = -MILLI * deadline.left
        self.asked += 1
        self.without_motion += not found
        if late >= 0.0:
            self.late.append(late)

    def add(self, other: _Overruns) -> None:
        """Take another's plans in."""
        self.late += other.late
        self.asked += other.asked
        self.without_motion += other.without_motion

    def figures(self) -> dict[str, float]:
        """Percentiles and numbers."""
        late = self.late or [0.0]
        return {f"p{p}": float(np.percentile(late, p)) for p in PERCENTILES} | {
            "max": max(late),
            "asked": self.asked,
            "ended_by_deadline": len(self.late),
            "without_motion": self.without_motion,
        }


def first_motion_lines(figures: dict[str, Any]) -> list[str]:
    """The times to the first motion as lines of a table."""
    return [
        f"first motion     {kind} from {start}: p50 {value['p50']:.1f} ms, "
        f"p99 {value['p99']:.1f} ms, {value['p99_over_dijkstra']:.1f} times SciPy's median"
        for kind, starts in figures.items()
        for start, value in starts.items()
    ]


def overrun_lines(figures: dict[str, Any]) -> list[str]:
    """The overruns as lines of a table."""
    rows = {"all": figures, **{kind: figures[kind] for kind in PLANNERS}}
    return [
        f"overrun          {name}: p50 {row['p50']:.2f} ms, p90 {row['p90']:.2f} ms, p99 "
        f"{row['p99']:.2f} ms, max {row['max']:.2f} ms of {row['ended_by_deadline']} plans ended "
        f"by deadlines up to {MILLI * LONGEST:.0f} ms ({row['without_motion']} without motion, "
        f"{row['asked']} asked for)"
        for name, row in rows.items()
    ]
