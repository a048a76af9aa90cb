"""Limits of a joint motion: joint range, node set, valves, pumps, boost and obstacles.

Speeds are judged quasi-statically, as in the whole plan: forces are those of gravity. Pressures are
judged with inertia as well. What an actuator can do depends on the mode it is in, so a motion is
judged together with its mode schedule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.hydraulics import (
    Oil,
    boosted_supply,
    extension_speed,
    flow_for_pistons,
    highest_flow,
    highest_supply,
    inlet_area,
    load_pressure,
    oil_of,
    opposes_motion,
    pressure_to_move,
    retraction_speed,
    spared_margin,
    speed_of_drop,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import BOOSTED
from mhsb_model.trajectory import (
    POINT_SPACING_NS,
    SECOND_NS,
    Trajectory,
    standstill,
    states_within,
)
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_model.workspace import excess_of
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.motion.motion_profile import MotionProfile, motion_profile, profile_of
from mhsb_planner.motion.s3_clearance import first_contact

JOINT_TOLERANCE = 1e-6  # rad, rounding of table and interpolation
TIP_TOLERANCE = 1e-4  # m, what a step of the search may do between the instants it is looked at
DEAD_BAND = 2e-4
"""Piston speed below which a cylinder counts as held by its valve [m/s]."""

CHECK_SPACING = 1e-3
"""Spacing of the instants at which a motion is checked [s]."""

ROWS_AT_ONCE = 32
"""Intervals of a trajectory that are looked at closely before the result is looked at."""

CHECKING = "checking the trajectory"

# Reserve at both ends of an interval of the trajectory that makes its inside safe: over 20 ms,
# curvature moves a joint by q̈ h²/8 = 0.05 mrad per rad/s².
CLEAR_DISTANCE = 2e-3  # m
CLEAR_USAGE = 0.95
CLEAR_PRESSURE = 0.999
"""A lower share of the pressure leaves enough for the valve at the least speeds."""


class Limit(IntEnum):
    """What a motion can break first."""

    JOINT = 0
    NODE_SET = 1
    USAGE = 2
    THRUST = 3
    MODULES = 4
    OBSTACLE = 5


# The same as kernels take them.
_JOINT, _NODE_SET = int(Limit.JOINT), int(Limit.NODE_SET)
_USAGE, _THRUST = int(Limit.USAGE), int(Limit.THRUST)


@dataclass(frozen=True)
class Violation:
    """A limit that a motion breaks.

    limit   which
    time    s from the motion's start
    amount  excess over the limit: rad (JOINT), m (NODE_SET), share of what the pumps and valves
            can do (USAGE; infinite where no speed is possible), share of the supply pressure
            (THRUST), modules (MODULES), depth in m, or negative what clearance is left (OBSTACLE)
    name    of the obstacle
    """

    limit: Limit
    time: float
    amount: float
    name: str = ""

    def __str__(self) -> str:
        """One sentence."""
        what = {
            Limit.OBSTACLE: f"the arm gets to {self.name}",
            Limit.JOINT: f"a joint limit is passed by {self.amount:.3g} rad",
            Limit.NODE_SET: f"the tip leaves the workspace by {self.amount:.3g} m",
            Limit.USAGE: f"valves and pumps would have to give {1 + self.amount:.3g} times as much",
            Limit.THRUST: f"it takes {100 * self.amount:.3g} % more pressure than there is",
            Limit.MODULES: f"{self.amount:.0f} booster modules more than fitted are needed",
        }[self.limit]
        return f"{what} at {self.time:.3f} s"


@kernel
def speed_limit(
    oil: Oil, k: float, cap: float, rod: float, force: float, direction: float, modules: int
) -> float:
    """Largest speed [m/s] of a piston under `force` [N], in `direction` (±), with booster modules.

    Against the load: K √((p − margin − p_L) A_dir/(A³+a³)), p being P_S without modules and the
    highest boost pressure with them. With it: the valve at P_S, and the filling of the inlet
    chamber, K √P_S/A_dir. Boosted also n Q_SP/A_dir for n modules. k in
    m³/(s √Pa), cap, rod in m².
    """
    inlet = inlet_area(cap, rod, direction)
    if opposes_motion(force, direction):
        drive = highest_supply(oil, modules) - oil.boost_margin
        drive -= load_pressure(cap, rod, oil.tank_pressure, force, direction)
        speed = speed_of_drop(k, cap, rod, drive, direction)
    else:
        if direction > 0.0:
            speed = extension_speed(k, cap, rod, oil.supply_pressure, oil.tank_pressure, force)
        else:
            speed = retraction_speed(k, cap, rod, oil.supply_pressure, oil.tank_pressure, force)
        speed = min(speed, k * math.sqrt(oil.supply_pressure) / inlet)
    return min(speed, highest_flow(oil, modules) / inlet)


@kernel(inline="always")
def repeats(modes: ModeArray, k: int) -> bool:
    """Whether the modes of row k are those of the row before."""
    same = k > 0
    for j in range(modes.shape[1]):
        same = same and modes[k, j] == modes[k - 1, j]
    return same


class Demand(NamedTuple):
    """What states of motion ask for, float64[k] each.

    outside   m, how far the tip is out of the node set; negative within it
    usage     max( Σ A_dir|v|/(Q_MP − Σ q_leak(p_supply)), max_j |v_j|/speed_limit_j ): share of
              what main pump, servo pumps and valves can do. Slowing the motion by this factor, or
              less, brings it within the limits. Cylinders in the dead band are left out of the
              second term: the closed valve carries their load
    pressure  largest share of its pressure that the load of a cylinder takes which may be lifting
              it. Far below the dead band it does not: the valve is closed
    thrust    largest share of its pressure that a cylinder takes against gravity and inertia,
              p_L(F + (M q̈ + C q̇)/r) + m(v) and what inertia leaves of the margin
    """

    outside: FloatArray
    usage: FloatArray
    pressure: FloatArray
    thrust: FloatArray

    @classmethod
    def of(cls, machine: Machine, profile: MotionProfile, modes: ModeArray) -> Demand:
        """Of the states of a profile, each in its modes uint8[k, n]."""
        p = profile
        return cls(*_demand(machine.arrays, p.speed, p.force, p.inertia, p.tip, modes))


@kernel
def _demand(
    m: MachineArrays,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    tip: FloatArray,
    modes: ModeArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Kernel of `Demand.of`; its oracle in the tests uses the Machine's methods."""
    rows, oil, own = len(speed), oil_of(m), np.empty(speed.shape[1])
    valve, cap, rod = m.valve_coefficient, m.cap_area, m.rod_area
    modules_of = m.modules_per_mode
    min_x, min_radius, max_radius = m.min_x, m.min_radius, m.max_radius
    outside, usage, pressure = np.empty(rows), np.empty(rows), np.empty(rows)
    thrust = np.empty(rows)
    for k in range(rows):
        outside[k] = excess_of(min_x, min_radius, max_radius, tip[k, 0], tip[k, 1])
        usage[k], pressure[k], thrust[k] = _shares(
            oil, valve, cap, rod, modules_of, speed, force, inertia, k, modes, k, own
        )
    return outside, usage, pressure, thrust


@kernel
def _end_demands(
    m: MachineArrays,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    tip: FloatArray,
    modes: ModeArray,
) -> tuple[FloatArray, FloatArray]:
    """Kernel of `EndDemands.of`: demands float64[4, k] where k intervals begin and where they end.

    In the same modes an interval begins as the one before ends.
    """
    intervals, oil, own = len(modes), oil_of(m), np.empty(speed.shape[1])
    valve, cap, rod = m.valve_coefficient, m.cap_area, m.rod_area
    modules_of = m.modules_per_mode
    min_x, min_radius, max_radius = m.min_x, m.min_radius, m.max_radius
    begin, end = np.empty((4, intervals)), np.empty((4, intervals))
    for k in range(intervals):
        if repeats(modes, k):
            for i in range(4):
                begin[i, k] = end[i, k - 1]
        else:
            begin[0, k] = excess_of(min_x, min_radius, max_radius, tip[k, 0], tip[k, 1])
            begin[1, k], begin[2, k], begin[3, k] = _shares(
                oil, valve, cap, rod, modules_of, speed, force, inertia, k, modes, k, own
            )
        end[0, k] = excess_of(min_x, min_radius, max_radius, tip[k + 1, 0], tip[k + 1, 1])
        end[1, k], end[2, k], end[3, k] = _shares(
            oil, valve, cap, rod, modules_of, speed, force, inertia, k + 1, modes, k, own
        )
    return begin, end


@kernel(inline="always")
def _shares(
    oil: Oil,
    valve: FloatArray,
    cap: FloatArray,
    rod: FloatArray,
    modules_of: IntArray,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    i: int,
    modes: ModeArray,
    k: int,
    own: FloatArray,
) -> tuple[float, float, float]:
    """Usage, pressure and thrust of state i in the modes of row k; own[n] is working memory."""
    flow = fastest = heaviest = hardest = 0.0
    for j in range(len(own)):
        v, f, modules = speed[i, j], force[i, j], modules_of[modes[k, j]]
        flow += inlet_area(cap[j], rod[j], v) * abs(v)
        if BOOSTED[modes[k, j]]:
            own[j] = boosted_supply(oil, valve[j], cap[j], rod[j], f, v)
        if abs(v) > DEAD_BAND:
            limit = speed_limit(oil, valve[j], cap[j], rod[j], f, v, modules)
            fastest = max(fastest, abs(v) / limit) if limit > 0.0 else math.inf
        lifts = abs(v) <= DEAD_BAND or opposes_motion(f, v)
        if lifts and abs(v) > 0.25 * DEAD_BAND:
            needed = pressure_to_move(oil, valve[j], cap[j], rod[j], f, 0.0)
            heaviest = max(heaviest, needed / highest_supply(oil, modules))
        load = f + inertia[i, j]
        if abs(v) > DEAD_BAND and opposes_motion(load, v):
            needed = pressure_to_move(oil, valve[j], cap[j], rod[j], load, v)
            needed -= spared_margin(oil)
            hardest = max(hardest, needed / highest_supply(oil, modules))
    shared = flow_for_pistons(oil, own, modes[k])
    used = max(fastest, flow / shared) if shared > 0.0 else math.inf
    return used, heaviest, hardest


class EndDemands(NamedTuple):
    """Demands of k intervals at both their ends, each in the interval's modes uint8[k, n]."""

    begin: Demand
    end: Demand
    modes: ModeArray

    @classmethod
    def of(cls, machine: Machine, profile: MotionProfile, modes: ModeArray) -> EndDemands:
        """Of intervals between a profile's instants, in the modes uint8[k, n]."""
        p = profile
        begin, end = _end_demands(machine.arrays, p.speed, p.force, p.inertia, p.tip, modes)
        return cls(Demand(*begin), Demand(*end), modes)

    def largest_usage(self, first: int) -> float:
        """From interval `first` on."""
        return float(max(each.usage[first:].max() for each in (self.begin, self.end)))


def joint_excess(m: MachineArrays, q: FloatArray) -> FloatArray:
    """How far the worst joint of q float64[…, n] lies beyond its limits [rad]; negative within."""
    return np.maximum(m.joint_min - q, q - m.joint_max).max(axis=-1)


def stays_inside(machine: Machine, trajectory: Trajectory) -> bool:
    """Whether, at its points, a trajectory stays in all ranges, and everywhere off obstacles."""
    m, tips = machine.arrays, machine.tip_positions(trajectory.position)
    radius = np.hypot(tips[:, 0], tips[:, 1])
    ranges = (m.min_x - tips[:, 0], m.min_radius - radius, radius - m.max_radius)
    beyond = joint_excess(m, trajectory.position).max()
    if max(np.max(ranges), beyond) > JOINT_TOLERANCE:
        return False
    return first_contact(machine, trajectory) is None


def first_violation(
    machine: Machine,
    trajectory: Trajectory,
    schedule: ModeSchedule,
    ends: EndDemands | None = None,
    deadline: Deadline = NEVER,
    middles: MotionProfile | None = None,
) -> Violation | None:
    """The first limit that a trajectory breaks under its mode schedule, or None.

    Looks at every millisecond, except inside intervals that are shown to be clear of all limits
    without; obstacles are those of `s3_clearance`. Mode changes are expected at the trajectory's
    points, as S4 makes them; `ends` are the demands of the intervals between these and `middles`
    their middles (`middle_profile`), where they are known. Raises DeadlineError.
    """
    m, time = machine.arrays, trajectory.offset_ns / SECOND_NS
    points = trajectory.position, trajectory.velocity, trajectory.acceleration
    if ends is None:
        modes = schedule.modes_at_many(trajectory.offset_ns[:-1] + schedule.stamp_ns)
        ends = EndDemands.of(machine, motion_profile(machine, *points), modes)
    modes = ends.modes
    within, beyond = _within_budget(m, modes)
    middles = middles or middle_profile(machine, trajectory)
    middle = Demand.of(machine, middles, modes)
    doubtful = _doubtful(m, time, *points, ends.begin, middle, ends.end)
    doubtful = doubtful[doubtful < within]
    deadline.check(CHECKING)
    for first in range(0, len(doubtful), ROWS_AT_ONCE):
        rows = doubtful[first : first + ROWS_AT_ONCE]
        found = _first_within(machine, trajectory, modes, rows)
        deadline.check(CHECKING)
        if found is not None:
            return found
    if within < len(modes):
        return Violation(Limit.MODULES, time[within], float(beyond))
    contact = first_contact(machine, trajectory)
    if contact is not None:
        return Violation(Limit.OBSTACLE, contact.time, -contact.clearance, contact.name)
    return None


def warm_up(machine: Machine) -> None:
    """Compile what is called only for intervals that are not clear of all limits."""
    still = standstill(machine.arrays.joint_min).rested(POINT_SPACING_NS)
    normal = np.zeros((1, machine.joint_count), dtype=np.uint8)
    _first_within(machine, still, normal, np.array([0]))


def middle_profile(machine: Machine, trajectory: Trajectory) -> MotionProfile:
    """Profile half-way between a trajectory's points."""
    return motion_profile(machine, *trajectory.middles())


@kernel(borrows=True)
def way_out(m: MachineArrays, position: FloatArray) -> float:
    """How far a joint goes beyond its limits [rad], other than where it comes back from beyond.

    position  float64[k, n] rad, one after the other; negative where all are within
    """
    farthest = -math.inf
    for j in range(position.shape[1]):
        least = math.inf
        for k in range(len(position)):
            excess = max(m.joint_min[j] - position[k, j], position[k, j] - m.joint_max[j])
            least = min(least, max(excess, 0.0))
            farthest = max(farthest, excess - least)
    return farthest


@kernel(borrows=True)
def _within_budget(m: MachineArrays, modes: ModeArray) -> tuple[int, int]:
    """How many intervals, the first ones, keep the module budget; what the next is beyond it."""
    for k in range(len(modes)):
        beyond = -m.module_count
        for j in range(modes.shape[1]):
            beyond += m.modules_per_mode[modes[k, j]]
        if beyond > 0:
            return k, beyond
    return len(modes), 0


@kernel
def _doubtful(
    m: MachineArrays,
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    begin: Demand,
    middle: Demand,
    end: Demand,
) -> IntArray:
    """Intervals of which ends, middles and control points do not show that no limit is broken.

    Either both ends have enough in reserve, or all that is asked for stays below its limit.
    """
    beyond = _joint_bound(m, time, position, velocity, acceleration)
    rows, count = np.empty(len(beyond), dtype=np.int64), 0
    for k in range(len(beyond)):
        bounded = _most(begin.outside[k], middle.outside[k], end.outside[k]) < 0.0
        bounded &= _most(begin.usage[k], middle.usage[k], end.usage[k]) < 1.0
        bounded &= _most(begin.pressure[k], middle.pressure[k], end.pressure[k]) < CLEAR_PRESSURE
        bounded &= _most(begin.thrust[k], middle.thrust[k], end.thrust[k]) < 1.0
        clear = bounded or (_has_reserve(begin, k) and _has_reserve(end, k))
        if not (clear and beyond[k] <= JOINT_TOLERANCE):
            rows[count] = k
            count += 1
    return rows[:count]


@kernel(inline="always")
def _most(begin: float, middle: float, end: float) -> float:
    """What a quantity does not exceed that is like a parabola, from its ends and its middle.

    A parabola exceeds the highest of them by a quarter of the middle's bow at most; the whole bow
    is added. Infinite, or not a number, where one of them is.
    """
    return max(begin, end, middle) + abs(middle - 0.5 * (begin + end))


@kernel(inline="always")
def _has_reserve(d: Demand, k: int) -> bool:
    """Whether state k has so much in reserve that those close by are safe."""
    share = max(d.usage[k], d.pressure[k], d.thrust[k])
    return d.outside[k] < -CLEAR_DISTANCE and share < CLEAR_USAGE


@kernel
def _joint_bound(
    m: MachineArrays,
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
) -> FloatArray:
    """Bound on the joint excess [rad] within each interval of a trajectory, float64[k - 1].

    A quintic stays within the hull of its control points b₀ = q, b₁ = q + q̇h/5,
    b₂ = q + 2q̇h/5 + q̈h²/20, and likewise from the interval's end, with h < 0.
    """
    rows, n = position.shape
    bound = np.empty(rows - 1)
    for i in range(rows - 1):
        highest = -math.inf
        for k, h in ((i, time[i + 1] - time[i]), (i + 1, time[i] - time[i + 1])):
            for j in range(n):
                q, turn = position[k, j], 0.2 * h * velocity[k, j]
                bent = q + 2.0 * turn + 0.05 * h * h * acceleration[k, j]
                above = max(q, q + turn, bent) - m.joint_max[j]
                below = m.joint_min[j] - min(q, q + turn, bent)
                highest = max(highest, above, below)
        bound[i] = highest
    return bound


def _first_within(
    machine: Machine, trajectory: Trajectory, modes: ModeArray, rows: IntArray
) -> Violation | None:
    """The first violation within some intervals, looked at every millisecond or closer."""
    time = trajectory.offset_ns / SECOND_NS
    motion = trajectory.position, trajectory.velocity, trajectory.acceleration
    limit, at, amount = _first_broken(machine.arrays, time, *motion, modes, rows)
    return None if limit < 0 else Violation(Limit(limit), at, amount)


@kernel
def _first_broken(
    m: MachineArrays,
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    modes: ModeArray,
    rows: IntArray,
) -> tuple[int, float, float]:
    """Kernel of `_first_within`: limit, time [s] and amount; −1 where none is broken."""
    motion = position, velocity, acceleration
    for row in rows:
        h = time[row + 1] - time[row]
        looks = math.ceil(h / CHECK_SPACING) + 1
        shares = np.linspace(0.0, 1.0, looks)
        q, qd, qdd = states_within(time, *motion, np.full(looks, row), shares)
        held = np.empty((looks, modes.shape[1]), dtype=np.uint8)
        held[:] = modes[row]
        speed, force, tip, inertia = profile_of(m, q, qd, qdd)
        outside, usage, _, thrust = _demand(m, speed, force, inertia, tip, held)
        for k in range(looks):
            at = time[row] + shares[k] * h
            excess = -math.inf
            for j in range(q.shape[1]):
                excess = max(excess, m.joint_min[j] - q[k, j], q[k, j] - m.joint_max[j])
            if excess > JOINT_TOLERANCE:
                return _JOINT, at, excess
            if outside[k] > TIP_TOLERANCE:
                return _NODE_SET, at, outside[k]
            if usage[k] > 1.0:
                return _USAGE, at, usage[k] - 1.0
            if thrust[k] > 1.0:
                return _THRUST, at, thrust[k] - 1.0
    return -1, 0.0, 0.0
