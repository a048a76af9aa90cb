"""Benchmark of streamed goals: one goal sent repeatedly, and a goal that moves; in lock-step.

The lifecycle of goals, planning and hand-over are the node's own code. Simulated time stands still
while a plan is made. It then passes as long as planning took, or until the next event.

    stream       a goal sent every 0.1 s until the arm is there, over the same goal sent once
    moving_goal  a goal to and fro on lines on which the arm can follow it: distance of tip and
                 goal at the same instant, except for 0.5 s from each turning point; then the
                 stream stops
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from benchmarks.lock_step import LockStepWorld
from tqdm import tqdm

from mhsb_model.inverse_kinematics.closed_form_3r import (
    ELBOW_BRANCHES,
    is_within_limits,
    solve_last_three_joints,
)
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_model.trajectory import Trajectory
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.cases.moves import Move
from mhsb_planner.motion.energy import compute_motion_energy
from mhsb_planner.motion.limits.holding_pressure import HOLDING_PRESSURE_LIMIT
from mhsb_planner.motion.limits.node_set import NODE_SET_LIMIT
from mhsb_planner.motion.limits.usage import USAGE_LIMIT
from mhsb_planner.motion.motion_profile import compute_motion_profile
from mhsb_planner.motion.s3_limits import LimitValues
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.online.settings import Settings
from mhsb_planner.planner import PLANNER_KINDS, Planner, PlanOptions

SEED = 0
MILLI = 1e3

PERIOD = 0.1
"""Time between goals at the same place [s]."""

LONGEST = 120.0
"""Time after which an arm counts as not arrived [s]."""

TRANSPORT = 0.008
"""Time that a command takes to the arm [s]; over DDS on one idle machine it was 5 to 10 ms."""

FINE_STEP = 0.001
"""Time step of the world with a moving goal [s]."""

SPEEDS = (0.03, 0.1)
"""Speeds of the moving goal [m/s]."""
RATES = (20.0, 5.0)
"""Rates at which the moving goal is sent [Hz]."""
SHORTEST_LINE, LONGEST_LINE = 0.3, 0.5
"""Range of the lengths of lines [m]."""
LINE_POINTS = 41
"""Number of points at which a line is tested."""
AT_MOST = 0.8
"""Share of the capacity of pistons, valves and pumps that following a goal on a line may take."""

AFTER_TURNING = 0.5
"""Time after a turning point in which distances do not count [s]."""
PASSES = 2.5
"""Number of times that the goal goes along its line before it stops, in the middle of the line."""

Figures = dict[str, Any]


class Line(NamedTuple):
    """Line on which a goal moves to and fro.

    Attributes:
        begin: One end (x, z) [m].
        end: Other end (x, z) [m].
    """

    begin: FloatArray
    end: FloatArray

    @property
    def length(self) -> float:
        """Distance of both ends [m]."""
        return float(np.hypot(*(self.end - self.begin)))

    def point_at(self, distance: float) -> FloatArray:
        """Return the position of a goal that has moved to and fro for a distance from `begin`.

        Args:
            distance: Distance moved [m].

        Returns:
            Position (x, z) [m].
        """
        gone = distance % (2.0 * self.length)
        gone = min(gone, 2.0 * self.length - gone)
        return self.begin + (self.end - self.begin) * (gone / self.length)


@dataclass
class MotionLog:
    """Record of an arm's reference and modes.

    Attributes:
        world: World in lock-step with the arm.
        time_ns: The arm's times [ns].
        state: Position, velocity and acceleration at each time, shape (3, n) each.
        modes: Modes in force at each time, shape (n,) each.
    """

    world: LockStepWorld
    time_ns: list[int] = field(default_factory=list)
    state: list[FloatArray] = field(default_factory=list)
    modes: list[ModeArray] = field(default_factory=list)

    def record_state(self) -> None:
        """Append the arm's present reference and modes."""
        arm = self.world.arm
        reference = arm.reference
        self.time_ns.append(arm.time_ns)
        self.state.append(
            np.array([reference.position, reference.velocity, reference.acceleration])
        )
        self.modes.append(arm.command.schedule.modes_at(arm.time_ns))

    def energy(self) -> float:
        """Compute the planner's energy of the whole ride.

        Returns:
            Energy, reading `paper` [J].
        """
        offset = np.array(self.time_ns) - self.time_ns[0]
        q, qd, qdd = np.array(self.state).transpose(1, 0, 2)
        schedule = ModeSchedule(0, offset, np.array(self.modes))
        return compute_motion_energy(
            self.world.machine, Trajectory(0, offset, q, qd, qdd), schedule
        ).paper


# --- The same goal -------------------------------------------------------------------------------


def stream_figures(planner: Planner, moves: Sequence[Move]) -> Figures:
    """Compare a goal that is sent every 0.1 s with one that is sent once.

    Args:
        planner: The planner, for machine and posture table.
        moves: The moves.

    Returns:
        By planner: number of moves and arrivals, and ratios of time and energy, median and largest.
    """
    replanner = Replanner(planner.machine, planner.graph.table)
    figures = {}
    for kind in PLANNER_KINDS:
        ratios, arrived = [], 0
        for move in tqdm(moves, f"the same goal, {kind}"):
            once, again = (
                _send_until_rest(planner.machine, replanner, kind, move, period)
                for period in (LONGEST, PERIOD)
            )
            arrived += again is not None
            if once is not None and again is not None:
                ratios.append(np.divide(again, once))
        time, energy = np.array(ratios).T
        figures[kind] = {
            "moves": len(moves),
            "arrived": arrived,
            "time_ratio": {"p50": float(np.median(time)), "max": float(time.max())},
            "energy_ratio": {"p50": float(np.median(energy)), "max": float(energy.max())},
        }
    return figures


def _send_until_rest(
    machine: Machine, replanner: Replanner, kind: str, move: Move, period: float
) -> tuple[float, float] | None:
    """Send a goal repeatedly until the arm rests there.

    Args:
        machine: The arm.
        replanner: Its planner.
        kind: Name of the planning method.
        move: Start posture and goal.
        period: Time between goals [s].

    Returns:
        Time [s] and energy [J] until the arm rests at the goal; None if it does not within
        `LONGEST`.
    """
    settings = Settings(machine, PlanOptions(planner=kind))
    world = LockStepWorld(machine, replanner, settings, start=move.start)
    ride, began, due = MotionLog(world), world.now, 0.0
    while world.now - began < LONGEST:
        if world.now - began >= due:
            world.send_goal(*move.goal)
            due += period
        world.pass_time(0.02)
        ride.record_state()
        if world.tip_is_at(*move.goal):
            return world.now - began, ride.energy()
    return None


# --- A goal that moves ---------------------------------------------------------------------------


def moving_goal_figures(planner: Planner, count: int) -> Figures:
    """Measure how far the tip is behind a moving goal, for each speed and rate.

    Args:
        planner: The planner, for machine and posture table.
        count: Number of lines.

    Returns:
        By speed and rate: distances [mm] behind the goal, largest overshoot and distance at rest
        [mm], and plans per second.
    """
    machine = planner.machine
    replanner = Replanner(machine, planner.graph.table)
    figures = {}
    for speed, rate in itertools.product(SPEEDS, RATES):
        name = f"{MILLI * speed:g} mm/s, {rate:g} Hz"
        rows = [
            _follow_line(machine, replanner, line, speed, rate)
            for line in tqdm(list(itertools.islice(lines(machine, speed), count)), name)
        ]
        behind = np.concatenate([row.behind for row in rows])
        figures[name] = {
            "lines": len(rows),
            "p50_mm": MILLI * float(np.median(behind)),
            "p99_mm": MILLI * float(np.percentile(behind, 99)),
            "worst_median_mm": MILLI * max(float(np.median(row.behind)) for row in rows),
            "overshoot_mm": MILLI * max(row.overshoot for row in rows),
            "rests_off_mm": MILLI * max(row.off for row in rows),
            "plans_per_s": float(np.mean([row.plans for row in rows])),
        }
    return figures


def lines(machine: Machine, speed: float) -> Iterator[Line]:
    """Yield random lines along which the arm can follow a goal with a constant end-link angle ψ.

    Args:
        machine: An arm of three joints.
        speed: Speed of the goal [m/s].

    Yields:
        Lines without end; equal calls yield equal lines.
    """
    random = np.random.default_rng(SEED)
    reach = machine.config.workspace.max_radius
    while True:
        begin = random.uniform((0.0, -reach), (reach, reach))
        angle, length = random.uniform(0.0, math.tau), random.uniform(SHORTEST_LINE, LONGEST_LINE)
        line = Line(begin, begin + length * np.array([math.cos(angle), math.sin(angle)]))
        if _can_follow(machine, line, speed):
            yield line


def _can_follow(machine: Machine, line: Line, speed: float) -> bool:
    """Return whether some constant ψ lets the arm follow a line within `AT_MOST` of its capacity.

    Sampled are 37 angles ψ for each elbow, and 41 points of the line, all in N.

    Args:
        machine: An arm of three joints.
        line: The line.
        speed: Speed along it [m/s].

    Returns:
        True if one sampled ψ keeps joint limits, speeds, flow, pressures and workspace.
    """
    tips = np.linspace(line.begin, line.end, LINE_POINTS)
    modes = np.full((LINE_POINTS, machine.joint_count), Mode.N, dtype=np.uint8)
    time = np.linspace(0.0, line.length / speed, LINE_POINTS)
    arrays = machine.arrays
    for elbow, psi in itertools.product(ELBOW_BRANCHES, np.linspace(-math.pi, math.pi, 37)):
        q = np.empty((LINE_POINTS, machine.joint_count))
        if not all(
            solve_last_three_joints(arrays, x, z, psi, elbow, row) and is_within_limits(arrays, row)
            for (x, z), row in zip(tips.tolist(), q, strict=True)
        ):
            continue
        velocity = np.asarray(np.gradient(q, time, axis=0))
        profile = compute_motion_profile(machine, q, velocity)
        values = LimitValues.from_profile(machine, profile, modes)
        fastest = (np.abs(profile.speed) / arrays.max_piston_speed).max()
        usage = max(fastest, values.of(USAGE_LIMIT).max(), values.of(HOLDING_PRESSURE_LIMIT).max())
        if usage <= AT_MOST and values.of(NODE_SET_LIMIT).max() < 0.0:
            return True
    return False


class FollowingResult(NamedTuple):
    """Result of following a goal on a line.

    Attributes:
        behind: Distances of tip and goal [m], one for each time step that counts.
        overshoot: Largest distance of the tip beyond the last goal, in its direction [m].
        off: Distance of the tip from the last goal at rest [m].
        plans: Number of plans per second.
    """

    behind: FloatArray
    overshoot: float
    off: float
    plans: float


def _follow_line(
    machine: Machine, replanner: Replanner, line: Line, speed: float, rate: float
) -> FollowingResult:
    """Let an arm follow a goal on a line until the stream stops, then wait 3 s.

    Args:
        machine: The arm.
        replanner: Its planner; planning takes the time that it really takes.
        line: The line; the arm begins at rest at its beginning.
        speed: Speed of the goal [m/s].
        rate: Number of goals per second [Hz].

    Returns:
        Distances and number of plans.
    """
    settings = Settings(machine, PlanOptions(planner="integrated"))
    world = LockStepWorld(machine, replanner, settings, step=FINE_STEP)
    world.planning_time, world.transport = None, TRANSPORT
    x, z = line.begin.tolist()
    world.send_goal(x, z)
    world.pass_time_until(lambda: world.tip_is_at(x, z), LONGEST)
    began, sent, due, behind = world.now, len(world.sent), 0.0, []
    goal = line.begin
    while (passed := world.now - began) * speed < PASSES * line.length:
        if passed >= due:
            goal = line.point_at(speed * passed)
            world.send_goal(*goal.tolist())
            due += 1.0 / rate
        world.pass_time(world.step)
        passed = world.now - began
        if passed % (line.length / speed) > AFTER_TURNING:
            behind.append(float(np.hypot(*(_tip(world) - line.point_at(speed * passed)))))
    plans = (len(world.sent) - sent) / passed
    ahead = line.point_at(speed * passed) - line.point_at(speed * passed - 1e-3)
    ahead /= np.hypot(*ahead)
    overshoot = -math.inf
    for _ in range(round(3.0 / world.step)):
        world.pass_time(world.step)
        overshoot = max(overshoot, float((_tip(world) - goal) @ ahead))
    off = float(np.hypot(*(_tip(world) - goal)))
    return FollowingResult(np.array(behind), overshoot, off, plans)


def _tip(world: LockStepWorld) -> FloatArray:
    return np.array(world.machine.tip_position(world.arm.reference.position))


def stream_lines(figures: Figures) -> list[str]:
    """Format the figures of a repeated goal as lines of a table."""
    return [
        "the same goal every 0.1 s   moves arrived   time ratio p50, max   energy ratio p50, max",
        *(
            f"{kind:27s} {row['moves']:5d} {row['arrived']:7d} {row['time_ratio']['p50']:13.3f} "
            f"{row['time_ratio']['max']:7.3f} {row['energy_ratio']['p50']:16.3f} "
            f"{row['energy_ratio']['max']:6.3f}"
            for kind, row in figures.items()
        ),
    ]


def moving_goal_lines(figures: Figures) -> list[str]:
    """Format the figures of a moving goal as lines of a table."""
    return [
        "moving goal      lines   behind p50, p99, worst line's p50 [mm]   overshoot, rests off "
        "[mm]   plans/s",
        *(
            f"{name:16s} {row['lines']:5d} {row['p50_mm']:12.2f} {row['p99_mm']:7.2f} "
            f"{row['worst_median_mm']:9.2f} {row['overshoot_mm']:20.2f} {row['rests_off_mm']:9.3f} "
            f"{row['plans_per_s']:13.1f}"
            for name, row in figures.items()
        ),
    ]
