"""Limits of a joint motion: joint range, node set, valves, pumps, pressures and obstacles.

The node set is the workspace of the tip. Speeds are checked quasi-statically, as in the whole plan:
forces are those of gravity. Pressures are checked with inertia as well. The ability of an actuator
depends on its mode, so a motion is checked together with its mode schedule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.hydraulics import (
    SharedHydraulics,
    boosted_supply,
    compute_inertia_margin,
    compute_piston_flow_budget,
    compute_pressure_with_margin,
    compute_speed_from_drop,
    extension_speed,
    get_max_servo_pump_flow,
    get_max_supply_pressure,
    get_shared_hydraulics,
    inlet_area,
    load_pressure,
    opposes_motion,
    retraction_speed,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import BOOSTED_MODES
from mhsb_model.trajectory import (
    MAX_POINT_SPACING_NS,
    SECOND_NS,
    Trajectory,
    sample_states_at_shares,
    standstill,
)
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_model.workspace import compute_region_excess
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.motion.motion_profile import MotionProfile, compute_profile_arrays, motion_profile
from mhsb_planner.motion.s3_clearance import find_first_contact

JOINT_TOLERANCE = 1e-6
"""Excess beyond a joint limit that counts as rounding of table and interpolation [rad]."""

TIP_TOLERANCE = 1e-4
"""Distance out of the node set that is accepted [m].

The search checks a step at some instants; between them the tip may be so far outside."""

DEAD_BAND = 2e-4
"""Piston speed up to which a cylinder counts as held by its valve [m/s]."""

CHECK_SPACING = 1e-3
"""Spacing of the instants at which a motion is checked [s]."""

ROWS_AT_ONCE = 32
"""Number of intervals that are checked closely between two checks of the deadline."""

CHECK_TASK = "checking the trajectory"

# These reserves at both ends of an interval make its inside safe: within h = 20 ms a joint deviates
# from the chord by q̈ h²/8, which is 0.05 mrad per rad/s².
CLEAR_DISTANCE = 2e-3
"""Distance of the tip inside the node set that is a reserve [m]."""

CLEAR_USAGE = 0.95
"""Largest usage, pressure and thrust that leave a reserve [-]."""

CLEAR_PRESSURE = 0.999
"""Largest share of the available pressure up to which an interval counts as clear [-].

The rest is enough for the valve at the lowest speeds."""


class Limit(IntEnum):
    """Kind of limit that a motion can break."""

    JOINT = 0
    NODE_SET = 1
    USAGE = 2
    THRUST = 3
    MODULES = 4
    OBSTACLE = 5


# Kernels take the codes as plain integers.
_JOINT, _NODE_SET = int(Limit.JOINT), int(Limit.NODE_SET)
_USAGE, _THRUST = int(Limit.USAGE), int(Limit.THRUST)


@dataclass(frozen=True)
class Violation:
    """A limit that a motion breaks.

    Attributes:
        limit: Kind of limit.
        time: Time from the motion's start [s].
        amount: Excess over the limit. JOINT: angle or stroke [rad or m]. NODE_SET: distance [m].
            USAGE: share of what pumps and valves can give, inf if no speed is possible [-]. THRUST:
            share of the supply pressure [-]. MODULES: number of modules. OBSTACLE: depth [m],
            negative if some clearance is left.
        name: Name of the obstacle; empty for other limits.
    """

    limit: Limit
    time: float
    amount: float
    name: str = ""

    def __str__(self) -> str:
        """Return one sentence that describes the violation."""
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
    oil: SharedHydraulics,
    k: float,
    cap: float,
    rod: float,
    force: float,
    direction: float,
    modules: int,
) -> float:
    """Compute the largest speed of a piston under a load.

    Against the load the pressure limits it, with p = P_S without modules and p the highest boost
    pressure with them:

        v = K √((p − margin − p_L) A_dir/(A³ + a³))

    With the load the valve at P_S limits it, and the filling of the inlet chamber, K √P_S/A_dir. In
    boost the flow of n modules, n Q_SP/A_dir, is a further limit.

    Args:
        oil: Hydraulic numbers that all actuators share.
        k: Flow coefficient K of the valve [m³/(s √Pa)].
        cap: Cap-side piston area A [m²].
        rod: Rod-side piston area a [m²].
        force: Piston force, positive if it resists extension [N].
        direction: Positive for extension, negative for retraction.
        modules: Number n of booster modules; 0 means mode N.

    Returns:
        Largest speed as a magnitude [m/s]; 0 if the pressure does not suffice.
    """
    inlet = inlet_area(cap, rod, direction)
    if opposes_motion(force, direction):
        drive = get_max_supply_pressure(oil, modules) - oil.boost_margin
        drive -= load_pressure(cap, rod, oil.tank_pressure, force, direction)
        speed = compute_speed_from_drop(k, cap, rod, drive, direction)
    else:
        if direction > 0.0:
            speed = extension_speed(k, cap, rod, oil.supply_pressure, oil.tank_pressure, force)
        else:
            speed = retraction_speed(k, cap, rod, oil.supply_pressure, oil.tank_pressure, force)
        speed = min(speed, k * math.sqrt(oil.supply_pressure) / inlet)
    return min(speed, get_max_servo_pump_flow(oil, modules) / inlet)


@kernel(inline="always")
def repeats_previous_row(modes: ModeArray, k: int) -> bool:
    """Return whether the modes of a row equal the modes of the row before.

    Args:
        modes: Mode codes, shape (rows, n).
        k: Index of the row.

    Returns:
        True if they are equal; False for row 0.
    """
    same = k > 0
    for j in range(modes.shape[1]):
        same = same and modes[k, j] == modes[k - 1, j]
    return same


class Demand(NamedTuple):
    """Demands of k states of motion on workspace, flows and pressures.

    Attributes:
        outside: Distance of the tip out of the node set, negative inside, shape (k,) [m].
        usage: Share of what main pump, servo pumps and valves can do, shape (k,) [-]:
            max( Σ A_dir|v|/(Q_MP − Σ q_leak(p_supply)), max_j |v_j|/speed_limit_j ). A motion that
            is slower by this factor keeps the limits. The second term leaves out cylinders in the
            dead band, whose closed valves carry the load.
        pressure: Largest share of its highest supply pressure that a cylinder takes to hold its
            load, shape (k,) [-]. Only cylinders that may be lifting their load count. Far below the
            dead band the valve is closed, and a cylinder does not count.
        thrust: Largest share of its highest supply pressure that a moving cylinder takes against
            gravity and inertia, shape (k,) [-]. It takes p_L(F + (M q̈ + C q̇)/r) + m(v) and the
            part of the margin that inertia must leave.
    """

    outside: FloatArray
    usage: FloatArray
    pressure: FloatArray
    thrust: FloatArray

    @classmethod
    def from_profile(cls, machine: Machine, profile: MotionProfile, modes: ModeArray) -> Demand:
        """Compute the demands of the states of a profile, each in its own mode pattern.

        Args:
            machine: Machine with its hydraulics.
            profile: Profile with k rows.
            modes: Mode codes, shape (k, n).

        Returns:
            Distance of the tip out of the node set [m], and usage, pressure and thrust [-] of the k
            states.
        """
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
    """Compute the demands of k states, each in its own mode pattern.

    It is the kernel of `Demand.from_profile`. Test oracle: the methods of `Machine`.

    Args:
        m: Arrays of the machine.
        speed: Piston speeds, shape (k, n) [m/s].
        force: Piston forces under gravity, shape (k, n) [N].
        inertia: Piston forces from inertia, shape (k, n) [N].
        tip: Tip positions (x, z), shape (k, 2) [m].
        modes: Mode codes, shape (k, n).

    Returns:
        Fields of `Demand`, each of shape (k,):

        - outside: distance of the tip out of the node set, negative inside [m]
        - usage: share of what pumps and valves can do, inf if they can do nothing [-]
        - pressure: largest share of its highest supply pressure that a cylinder takes to hold its
          load [-]
        - thrust: largest such share that a moving cylinder takes against gravity and inertia [-]
    """
    rows, own = len(speed), np.empty(speed.shape[1])
    min_x, min_radius, max_radius = m.min_x, m.min_radius, m.max_radius
    outside, usage, pressure = np.empty(rows), np.empty(rows), np.empty(rows)
    thrust = np.empty(rows)
    for k in range(rows):
        outside[k] = compute_region_excess(min_x, min_radius, max_radius, tip[k, 0], tip[k, 1])
        usage[k], pressure[k], thrust[k] = _compute_shares(
            m, speed[k], force[k], inertia[k], modes[k], own
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
    """Compute the demands of k intervals at their beginnings and ends, in each interval's modes.

    It is the kernel of `EndDemands.from_profile`. If two adjacent intervals have equal modes, the
    values at their common point are computed once.

    Args:
        m: Arrays of the machine.
        speed: Piston speeds at the points, shape (k + 1, n) [m/s].
        force: Piston forces under gravity at the points, shape (k + 1, n) [N].
        inertia: Piston forces from inertia at the points, shape (k + 1, n) [N].
        tip: Tip positions (x, z) at the points, shape (k + 1, 2) [m].
        modes: Mode codes of the intervals, shape (k, n).

    Returns:
        Demands at the beginnings and at the ends, both of shape (4, k). The rows are the fields of
        `Demand`:

        - outside: distance of the tip out of the node set, negative inside [m]
        - usage: share of what pumps and valves can do, inf if they can do nothing [-]
        - pressure: largest share of its highest supply pressure that a cylinder takes to hold its
          load [-]
        - thrust: largest such share that a moving cylinder takes against gravity and inertia [-]
    """
    intervals, own = len(modes), np.empty(speed.shape[1])
    min_x, min_radius, max_radius = m.min_x, m.min_radius, m.max_radius
    begin, end = np.empty((4, intervals)), np.empty((4, intervals))
    for k in range(intervals):
        if repeats_previous_row(modes, k):
            for i in range(4):
                begin[i, k] = end[i, k - 1]
        else:
            begin[0, k] = compute_region_excess(min_x, min_radius, max_radius, tip[k, 0], tip[k, 1])
            begin[1, k], begin[2, k], begin[3, k] = _compute_shares(
                m, speed[k], force[k], inertia[k], modes[k], own
            )
        end[0, k] = compute_region_excess(
            min_x, min_radius, max_radius, tip[k + 1, 0], tip[k + 1, 1]
        )
        end[1, k], end[2, k], end[3, k] = _compute_shares(
            m, speed[k + 1], force[k + 1], inertia[k + 1], modes[k], own
        )
    return begin, end


@kernel(inline="always")
def _compute_shares(
    m: MachineArrays,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    modes: ModeArray,
    own: FloatArray,
) -> tuple[float, float, float]:
    """Compute usage, pressure and thrust of one state of motion.

    Args:
        m: Arrays of the machine.
        speed: Piston speeds, shape (n,) [m/s].
        force: Piston forces under gravity, shape (n,) [N].
        inertia: Piston forces from inertia, shape (n,) [N].
        modes: Mode codes, shape (n,).
        own: Working memory, shape (n,), overwritten: boosted supply pressure of each actuator [Pa].

    Returns:
        Usage, pressure and thrust [-]. Usage is the share of what pumps and valves can do, inf if
        no speed is possible. Pressure is the largest share of its highest supply pressure that a
        cylinder takes to hold its load. Thrust is the largest such share that a moving cylinder
        takes against gravity and inertia.
    """
    oil, valve, cap, rod = get_shared_hydraulics(m), m.valve_coefficient, m.cap_area, m.rod_area
    flow = fastest = heaviest = hardest = 0.0
    for j in range(len(own)):
        v, f, modules = speed[j], force[j], m.modules_per_mode[modes[j]]
        flow += inlet_area(cap[j], rod[j], v) * abs(v)
        if BOOSTED_MODES[modes[j]]:
            own[j] = boosted_supply(oil, valve[j], cap[j], rod[j], f, v)
        if abs(v) > DEAD_BAND:
            limit = speed_limit(oil, valve[j], cap[j], rod[j], f, v, modules)
            fastest = max(fastest, abs(v) / limit) if limit > 0.0 else math.inf
        lifts = abs(v) <= DEAD_BAND or opposes_motion(f, v)
        if lifts and abs(v) > 0.25 * DEAD_BAND:
            needed = compute_pressure_with_margin(oil, valve[j], cap[j], rod[j], f, 0.0)
            heaviest = max(heaviest, needed / get_max_supply_pressure(oil, modules))
        load = f + inertia[j]
        if abs(v) > DEAD_BAND and opposes_motion(load, v):
            needed = compute_pressure_with_margin(oil, valve[j], cap[j], rod[j], load, v)
            needed -= compute_inertia_margin(oil)
            hardest = max(hardest, needed / get_max_supply_pressure(oil, modules))
    shared = compute_piston_flow_budget(oil, own, modes)
    used = max(fastest, flow / shared) if shared > 0.0 else math.inf
    return used, heaviest, hardest


class EndDemands(NamedTuple):
    """Demands of k intervals at both of their ends, in each interval's modes.

    Attributes:
        begin: Demands at the beginnings.
        end: Demands at the ends.
        modes: Mode codes of the intervals, shape (k, n).
    """

    begin: Demand
    end: Demand
    modes: ModeArray

    @classmethod
    def from_profile(cls, machine: Machine, profile: MotionProfile, modes: ModeArray) -> EndDemands:
        """Compute the demands of the intervals between the instants of a profile.

        Args:
            machine: Machine with its hydraulics.
            profile: Profile with k + 1 rows.
            modes: Mode codes of the intervals, shape (k, n).

        Returns:
            Demands of the k intervals at their beginnings and ends, and the modes.
        """
        p = profile
        begin, end = _end_demands(machine.arrays, p.speed, p.force, p.inertia, p.tip, modes)
        return cls(Demand(*begin), Demand(*end), modes)

    def largest_usage(self, first: int) -> float:
        """Return the largest usage at the ends of the intervals from `first` on [-]."""
        return float(max(each.usage[first:].max() for each in (self.begin, self.end)))


def joint_excess(m: MachineArrays, q: FloatArray) -> FloatArray:
    """Compute how far the worst joint lies beyond its limits.

    Args:
        m: Arrays of the machine.
        q: Joint positions, shape (…, n) [rad or m].

    Returns:
        Excess of the worst joint, shape (…) [rad or m]; negative if all joints are within their
        limits.
    """
    return np.maximum(m.joint_min - q, q - m.joint_max).max(axis=-1)


def keeps_position_limits(machine: Machine, trajectory: Trajectory) -> bool:
    """Return whether a trajectory keeps joint limits, node set and clearance.

    Joint limits and node set are checked at the points only, obstacles at every instant. Obstacles
    count without margin, as in `find_first_contact`: a motion that starts in an obstacle may leave
    it. Pumps, valves and modes are not checked.

    Args:
        machine: Machine with its obstacles.
        trajectory: Joint trajectory.

    Returns:
        True if joint limits, node set and clearance are kept.
    """
    m, tips = machine.arrays, machine.tip_positions(trajectory.position)
    radius = np.hypot(tips[:, 0], tips[:, 1])
    ranges = (m.min_x - tips[:, 0], m.min_radius - radius, radius - m.max_radius)
    beyond = joint_excess(m, trajectory.position).max()
    if max(np.max(ranges), beyond) > JOINT_TOLERANCE:
        return False
    return find_first_contact(machine, trajectory) is None


def find_first_violation(
    machine: Machine,
    trajectory: Trajectory,
    schedule: ModeSchedule,
    ends: EndDemands | None = None,
    deadline: Deadline = NO_DEADLINE,
    middles: MotionProfile | None = None,
) -> Violation | None:
    """Find the first limit that a trajectory breaks under its mode schedule.

    Intervals between the points that are proven clear are skipped. All others are checked at
    instants at most CHECK_SPACING apart. Joint limits, node set, usage and thrust come first, up to
    the first interval whose modes need more booster modules than are fitted. Usage is the share of
    what pumps and valves can do; thrust is the share of the supply pressure that a moving cylinder
    takes. Obstacles are checked last (`s3_clearance`), only if nothing else is broken.

    Args:
        machine: Machine with its obstacles.
        trajectory: Joint trajectory of k points.
        schedule: Modes over time; they must change at the trajectory's points only, as S4 makes
            them.
        ends: Demands of the intervals between the points; None computes them. If given, its modes
            are used instead of the schedule.
        deadline: Instant at which the work is given up.
        middles: Profile at the middles of the intervals (`middle_profile`); None computes it.

    Returns:
        Kind of limit, time from the trajectory's start [s] and excess; None if no limit is broken.

    Raises:
        DeadlineError: The deadline passed.
    """
    m, time = machine.arrays, trajectory.offset_ns / SECOND_NS
    points = trajectory.points
    if ends is None:
        modes = schedule.modes_at_many(trajectory.offset_ns[:-1] + schedule.stamp_ns)
        ends = EndDemands.from_profile(machine, motion_profile(machine, *points), modes)
    modes = ends.modes
    within, beyond = _count_intervals_within_budget(m, modes)
    middles = middles or middle_profile(machine, trajectory)
    middle = Demand.from_profile(machine, middles, modes)
    doubtful = _find_unproven_intervals(m, time, *points, ends.begin, middle, ends.end)
    doubtful = doubtful[doubtful < within]
    deadline.check(CHECK_TASK)
    for first in range(0, len(doubtful), ROWS_AT_ONCE):
        rows = doubtful[first : first + ROWS_AT_ONCE]
        found = _find_violation_within(machine, trajectory, modes, rows)
        deadline.check(CHECK_TASK)
        if found is not None:
            return found
    if within < len(modes):
        return Violation(Limit.MODULES, time[within], float(beyond))
    contact = find_first_contact(machine, trajectory)
    if contact is not None:
        return Violation(Limit.OBSTACLE, contact.time, -contact.clearance, contact.name)
    return None


def warm_up(machine: Machine) -> None:
    """Compile the kernels that are called only for intervals not proven clear.

    Args:
        machine: Machine whose number of joints gives the argument types.
    """
    still = standstill(machine.arrays.joint_min).with_rest(MAX_POINT_SPACING_NS)
    normal = np.zeros((1, machine.joint_count), dtype=np.uint8)
    _find_violation_within(machine, still, normal, np.array([0]))


def middle_profile(machine: Machine, trajectory: Trajectory) -> MotionProfile:
    """Compute the profile of a trajectory half-way in time between its points.

    It contains piston speeds, piston forces under gravity and from inertia, and tip positions.
    """
    return motion_profile(machine, *trajectory.sample_midpoints())


@kernel(borrows=True)
def compute_outward_excess(m: MachineArrays, position: FloatArray) -> float:
    """Compute how far a joint moves outwards beyond its limits.

    A joint that starts beyond a limit may return. Therefore only the increase over its least excess
    so far counts; that least excess is 0 once the joint is within its limits.

    Args:
        m: Arrays of the machine.
        position: Joint positions in time order, shape (k, n) [rad or m].

    Returns:
        Largest such increase over joints and instants [rad or m]; negative if all joints stay
        within their limits; 0 if joints only return.
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
def _count_intervals_within_budget(m: MachineArrays, modes: ModeArray) -> tuple[int, int]:
    """Find the first interval whose modes need more booster modules than are fitted.

    Args:
        m: Arrays of the machine.
        modes: Mode codes of the intervals, shape (k, n).

    Returns:
        Number of intervals before it, and number of modules that are missing in it; (k, 0) if the
        modules suffice in all intervals.
    """
    for k in range(len(modes)):
        beyond = -m.module_count
        for j in range(modes.shape[1]):
            beyond += m.modules_per_mode[modes[k, j]]
        if beyond > 0:
            return k, beyond
    return len(modes), 0


@kernel  # a record of the motion would cost 3 % of the check, for numba takes 1 µs to recognize it
def _find_unproven_intervals(
    m: MachineArrays,
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    begin: Demand,
    middle: Demand,
    end: Demand,
) -> IntArray:
    """Find the intervals that are not proven to keep all limits.

    An interval is proven if both ends have enough reserve, or if bounds from both ends and the
    middle stay below every limit. In either case a bound on the joint positions must be within the
    joint limits. Demands are the tip's distance out of the node set, usage, pressure and thrust
    (`Demand`).

    Args:
        m: Arrays of the machine.
        time: Times of the points, shape (k,) [s].
        position: Joint positions at the points, shape (k, n) [rad or m].
        velocity: Joint velocities at the points, shape (k, n) [rad/s or m/s].
        acceleration: Joint accelerations at the points, shape (k, n) [rad/s² or m/s²].
        begin: Demands at the beginnings of the k - 1 intervals.
        middle: Demands at the middles.
        end: Demands at the ends.

    Returns:
        Indices of the intervals in ascending order.
    """
    beyond = _joint_bound(m, time, position, velocity, acceleration)
    rows, count = np.empty(len(beyond), dtype=np.int64), 0
    for k in range(len(beyond)):
        bounded = _bound_parabola(begin.outside[k], middle.outside[k], end.outside[k]) < 0.0
        bounded &= _bound_parabola(begin.usage[k], middle.usage[k], end.usage[k]) < 1.0
        bounded &= (
            _bound_parabola(begin.pressure[k], middle.pressure[k], end.pressure[k]) < CLEAR_PRESSURE
        )
        bounded &= _bound_parabola(begin.thrust[k], middle.thrust[k], end.thrust[k]) < 1.0
        clear = bounded or (_has_reserve(begin, k) and _has_reserve(end, k))
        if not (clear and beyond[k] <= JOINT_TOLERANCE):
            rows[count] = k
            count += 1
    return rows[:count]


@kernel(inline="always")
def _bound_parabola(begin: float, middle: float, end: float) -> float:
    """Bound a quantity that varies about like a parabola over an interval.

    A parabola exceeds the highest of the three values by at most a quarter of the middle's distance
    from the chord. The whole distance is added as a reserve.

    Args:
        begin: Value at the beginning.
        middle: Value at the middle.
        end: Value at the end.

    Returns:
        Upper bound; inf or NaN if one of the values is infinite or NaN.
    """
    return max(begin, end, middle) + abs(middle - 0.5 * (begin + end))


@kernel(inline="always")
def _has_reserve(d: Demand, k: int) -> bool:
    """Return whether a state keeps enough distance from its limits for nearby states to be safe.

    Args:
        d: Demands of the states.
        k: Index of the state.

    Returns:
        True if the tip is CLEAR_DISTANCE inside and all shares are below CLEAR_USAGE.
    """
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
    """Bound how far joints get beyond their limits within each interval of a trajectory.

    A quintic stays within the hull of its six control points. Three of them belong to each end:
    q, q + q̇h/5 and q + 2q̇h/5 + q̈h²/20, with h < 0 at the interval's end.

    Args:
        m: Arrays of the machine.
        time: Times of the points, shape (k,) [s].
        position: Joint positions at the points, shape (k, n) [rad or m].
        velocity: Joint velocities at the points, shape (k, n) [rad/s or m/s].
        acceleration: Joint accelerations at the points, shape (k, n) [rad/s² or m/s²].

    Returns:
        Upper bound on the excess of the worst joint beyond its limits, shape (k - 1,) [rad or m];
        negative if all joints stay within them.
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


def _find_violation_within(
    machine: Machine, trajectory: Trajectory, modes: ModeArray, rows: IntArray
) -> Violation | None:
    """Find the first violation of joint limits, node set, usage or thrust within some intervals.

    Each interval is checked at instants at most CHECK_SPACING (1 ms) apart. Usage is the share of
    what valves and pumps can give. Thrust is the share of its highest supply pressure that a moving
    cylinder takes against gravity and inertia. `Demand` defines both. Booster modules and obstacles
    are not checked here.

    Args:
        machine: Machine with its hydraulics.
        trajectory: Joint trajectory of k points.
        modes: Mode codes of the intervals, shape (k - 1, n).
        rows: Indices of the intervals to check, in ascending order.

    Returns:
        Kind of limit, time from the trajectory's start [s] and excess of the violation; None if
        there is none.
    """
    time = trajectory.offset_ns / SECOND_NS
    motion = trajectory.points
    limit, at, amount = _find_first_broken_limit(machine.arrays, time, *motion, modes, rows)
    return None if limit < 0 else Violation(Limit(limit), at, amount)


@kernel
def _find_first_broken_limit(
    m: MachineArrays,
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    modes: ModeArray,
    rows: IntArray,
) -> tuple[int, float, float]:
    """Find the first limit that is broken within some intervals.

    Instants are at most CHECK_SPACING apart. At each of them the order of checks is joint limits,
    node set, usage, thrust.

    Args:
        m: Arrays of the machine.
        time: Times of the points, shape (k,) [s].
        position: Joint positions at the points, shape (k, n) [rad or m].
        velocity: Joint velocities at the points, shape (k, n) [rad/s or m/s].
        acceleration: Joint accelerations at the points, shape (k, n) [rad/s² or m/s²].
        modes: Mode codes of the intervals, shape (k - 1, n).
        rows: Indices of the intervals to check, in ascending order.

    Returns:
        Code of `Limit`, time [s] and excess over the limit, with the units of `Violation.amount`;
        (-1, 0, 0) if no limit is broken.
    """
    motion = position, velocity, acceleration
    for row in rows:
        h = time[row + 1] - time[row]
        looks = math.ceil(h / CHECK_SPACING) + 1
        shares = np.linspace(0.0, 1.0, looks)
        q, qd, qdd = sample_states_at_shares(time, *motion, np.full(looks, row), shares)
        held = np.empty((looks, modes.shape[1]), dtype=np.uint8)
        held[:] = modes[row]
        speed, force, tip, inertia = compute_profile_arrays(m, q, qd, qdd)
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
