"""Mode schedule of a trajectory (S4): the times at which each actuator switches its mode.

An actuator is boosted if it moves against its load and the main pump's pressure P_S is too low:

    p_L(F) + m(v) + margin > P_S

p_L is the load pressure under the force F of gravity. m(v) is the pressure drop over the valve at
the speed v, and `margin` the boost margin. If enough booster modules are free, an actuator is also
boosted if inertia takes more than half of the margin:

    p_L(F + inertia) + m(v) + margin/2 > P_S

Boost begins earlier than it is needed, since the servo pump has to raise the pressure first. The
mode is SB if the flow of one servo pump is not enough, otherwise DB. A boost lasts at least the
least time between two switches (dwell). A trajectory that is too short for its switches gets a rest
at its end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.holding import MAX_HELD_SPEED, choose_stop_modes
from mhsb_model.hydraulics import (
    compute_inertia_margin,
    compute_pressure_with_margin,
    cylinder_needs_boost,
    get_max_servo_pump_flow,
    get_shared_hydraulics,
    inlet_area,
    opposes_motion,
)
from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import LONG_AGO_NS, ModeSchedule
from mhsb_model.modes import BOOSTED_MODES, Mode
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray, IntArray, ModeArray, frozen
from mhsb_planner.motion.limits.module_budget import count_used_modules
from mhsb_planner.motion.motion_profile import MotionProfile, compute_motion_profile
from mhsb_planner.motion.s3_limits import repeats_previous_row

NEED_FACTOR = 1.005
"""Factor on speeds and forces when the need for boost is determined [-].

It covers higher speeds and forces between the points."""

MIN_DWELL = 0.3
"""Least time between two switches of an actuator [s]."""
BOOST_LEAD = 0.1
"""Time by which boost begins before it is needed [s]."""
MAX_VALVE_HOLD = 1.0
"""Longest time for which the closed valve alone may hold a load that is too heavy for the main
pump's pressure [s].
"""

_ROUNDING = 1e-9
"""Difference of times that counts as rounding [s]."""
_LEAST_RUN = MIN_DWELL - _ROUNDING
"""Duration from which on a run of equal modes counts as long enough [s]."""

N, DB, SB = int(Mode.N), int(Mode.DB), int(Mode.SB)

# States beside the intervals that `_enforce_lead_and_dwell` may change; see its argument `beside`.
_OFF, _ON, _EDGE = 0, 1, 2


@dataclass(frozen=True, eq=False)
class StartModes:
    """Modes in force at the beginning of a schedule, and the time since their last switches.

    Attributes:
        modes: Mode codes (N, DB, SB), shape (n,).
        age: Time since the last switch of each actuator, shape (n,) [s]; inf if unknown or long
            ago.
    """

    modes: ModeArray
    age: FloatArray

    def __post_init__(self) -> None:
        """Convert both arrays to read-only arrays of their types."""
        object.__setattr__(self, "modes", frozen(np.asarray(self.modes, dtype=np.uint8)))
        object.__setattr__(self, "age", frozen(np.asarray(self.age, dtype=np.float64)))

    @classmethod
    def create_settled(cls, modes: ModeArray) -> StartModes:
        """Create start modes whose actuators may be switched at once: their age is infinite.

        Args:
            modes: Mode codes (N, DB, SB), shape (n,).

        Returns:
            Start modes.
        """
        return cls(modes, np.full(len(modes), math.inf))

    @classmethod
    def read_from(cls, schedule: ModeSchedule, time_ns: int) -> StartModes:
        """Read the modes at a time from a schedule, and the time since each last switch.

        Args:
            schedule: Modes over time.
            time_ns: Absolute time [ns].

        Returns:
            Start modes. The age of an actuator's mode is inf if its last switch is not known.
        """
        switched = schedule.find_last_switches(time_ns)
        age = np.where(switched > LONG_AGO_NS, (time_ns - switched) / SECOND_NS, math.inf)
        return cls(schedule.modes_at(time_ns), age)


def compute_interval_modes(
    machine: Machine,
    time: FloatArray,
    profile: MotionProfile,
    start: StartModes,
    hold: ModeArray,
    preferred: ModeArray | None = None,
) -> ModeArray:
    """Compute the modes of all actuators between the instants of a motion profile.

    An actuator is boosted if the main pump's pressure is too low to move, hold or accelerate its
    load. An actuator that only holds its load for a short time is not boosted, since its closed
    valve holds the load. Boost begins BOOST_LEAD before it is needed and lasts at least MIN_DWELL.
    A boosted actuator gets mode SB (shared rail) if its flow exceeds that of one servo pump, or if
    `preferred` says SB. Otherwise it gets DB (own servo pump). Modes in force at the start stay in
    force until the actuator may be switched again.

    If too few booster modules are fitted, SB becomes DB. After that, DB becomes N for actuators
    that move and hold their loads without boost. If this does not suffice, the result still needs
    too many modules.

    Args:
        machine: Machine with its hydraulics and modules.
        time: Instants of the profile in ascending order, shape (k,) [s].
        profile: Profile (piston speeds and forces) with k rows.
        start: Modes in force at the first instant, and time since each actuator's last switch.
        hold: Modes in which the arm rests after the last instant, shape (n,).
        preferred: Modes that the search for the discrete path chose at each instant, shape (k, n).
            Only SB has an effect. None means no preference.

    Returns:
        Mode codes of the intervals between the instants, shape (k - 1, n); no rows if there is only
        one instant.
    """
    if preferred is None:
        preferred = np.full(profile.speed.shape, Mode.N)
    if len(time) < 2:
        return np.empty((0, machine.joint_count), dtype=np.uint8)
    return _choose_interval_modes(
        machine.arrays,
        time,
        profile.speed,
        profile.force,
        profile.inertia,
        np.array(preferred, dtype=np.uint8),
        start.modes,
        start.age,
        hold,
    )


def keeps_dwell(time: FloatArray, modes: ModeArray, start: StartModes, hold: ModeArray) -> bool:
    """Return whether every actuator keeps MIN_DWELL, the least time between two mode switches.

    Args:
        time: Instants in ascending order, shape (k,) [s].
        modes: Mode codes between the instants, shape (k - 1, n).
        start: Modes in force before the first instant, and time since each actuator's last switch.
        hold: Modes from the last instant on, shape (n,).

    Returns:
        True if the time is kept; the last switch before the first instant is included.
    """
    return bool(_compute_shortest_run(time, modes, start.modes, start.age, hold) >= _LEAST_RUN)


@dataclass(frozen=True, eq=False)
class ScheduledMotion:
    """A trajectory of k points with its profile and its modes.

    Attributes:
        trajectory: Joint trajectory.
        profile: Profile (piston speeds and forces) at the points.
        intervals: Mode codes between the points, shape (k - 1, n).
        hold: Mode codes from the last point on, shape (n,).
        keeps_dwell: True if every actuator keeps the least time between two switches.
    """

    trajectory: Trajectory
    profile: MotionProfile
    intervals: ModeArray
    hold: ModeArray
    keeps_dwell: bool

    @classmethod
    def create(
        cls,
        machine: Machine,
        trajectory: Trajectory,
        start: StartModes,
        preferred: ModeArray | None = None,
    ) -> ScheduledMotion:
        """Compute the modes of a trajectory, with a standstill at its end if switches need time.

        Each mode must last at least MIN_DWELL. If a mode lasts less, a standstill of 2 MIN_DWELL is
        added at the trajectory's end, and all modes are computed again. The standstill gives room
        to switches near the trajectory's end, but not to switches far from the end.

        Args:
            machine: Machine with its hydraulics and modules.
            trajectory: Joint trajectory.
            start: Modes in force at the beginning, and time since each actuator's last switch.
            preferred: Modes that the search for the discrete path chose, at each point, shape
                (points, n). Only SB has an effect: an actuator that needs boost then gets SB. None
                means no preference.

        Returns:
            Trajectory with its profile and its modes, and with the standstill if it was needed.
            `keeps_dwell` of the result is False if a mode lasts less than MIN_DWELL in spite of the
            standstill.
        """
        once = cls._create_without_rest(machine, trajectory, start, preferred)
        if once.keeps_dwell:
            return once
        rested = trajectory.with_rest(round(2 * MIN_DWELL * SECOND_NS))
        if preferred is not None:
            rest = len(rested.offset_ns) - len(preferred)
            preferred = np.vstack([preferred, np.repeat(preferred[-1:], rest, axis=0)])
        return cls._create_without_rest(machine, rested, start, preferred)

    @classmethod
    def _create_without_rest(
        cls,
        machine: Machine,
        trajectory: Trajectory,
        start: StartModes,
        preferred: ModeArray | None,
    ) -> ScheduledMotion:
        """Compute the modes of a trajectory that stays as it is.

        Args:
            machine: Machine with its hydraulics and modules.
            trajectory: Joint trajectory.
            start: Modes in force at the beginning, and time since each actuator's last switch.
            preferred: Modes that the search for the discrete path chose, at each point, shape
                (points, n). Only SB has an effect: an actuator that needs boost then gets SB. None
                means no preference.

        Returns:
            Trajectory with its profile and its modes. Its `keeps_dwell` is False if an actuator is
            switched twice within MIN_DWELL.
        """
        profile = compute_motion_profile(
            machine, trajectory.position, trajectory.velocity, trajectory.acceleration
        )
        time = trajectory.offset_ns / SECOND_NS
        hold = choose_stop_modes(machine, profile.force[-1], start.modes)
        modes = compute_interval_modes(machine, time, profile, start, hold, preferred)
        kept = keeps_dwell(time, modes, start, hold)
        return cls(trajectory, profile, modes, hold, kept)

    @cached_property
    def switch_count(self) -> int:
        """Number of mode changes of all actuators in `schedule`, which is not made for this."""
        modes, last = self.intervals, self.intervals[-1:]
        return int(np.count_nonzero(modes[1:] != modes[:-1]) + np.count_nonzero(last != self.hold))

    @cached_property
    def schedule(self) -> ModeSchedule:
        """Mode schedule of the trajectory, with its stamp.

        Equal modes of adjacent intervals become one row. The last row holds `hold`.
        """
        offset, modes = self.trajectory.offset_ns, self.intervals
        rows = np.append(_find_changes(modes), len(modes))
        modes = np.vstack([modes, self.hold])
        return ModeSchedule(self.trajectory.stamp_ns, offset[rows], modes[rows])


@kernel
def _find_changes(modes: ModeArray) -> IntArray:
    """Find the rows of a mode array that differ from the row before.

    Args:
        modes: Mode codes (N, DB, SB), shape (rows, n).

    Returns:
        Indices of the rows in ascending order, beginning with row 0.
    """
    rows, count = np.empty(len(modes), dtype=np.int64), 0
    for k in range(len(modes)):
        if not repeats_previous_row(modes, k):
            rows[count] = k
            count += 1
    return rows[:count]


@kernel  # records would cost 3 %, for numba takes 1 µs to recognize one at a call
def _choose_interval_modes(
    m: MachineArrays,
    time: FloatArray,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    preferred: ModeArray,
    start: ModeArray,
    age: FloatArray,
    hold: ModeArray,
) -> ModeArray:
    """Compute the modes of all actuators between the instants of a motion.

    First, the intervals in which an actuator needs boost are determined. If boost would only hold a
    load for a short time, it is dropped, since the closed valve holds the load. Intervals in which
    the pressure is too low to accelerate the load are added. Boost is shared (SB) if the flow
    exceeds that of one servo pump, or if SB is preferred. Then boost, and shared boost, begin
    earlier by BOOST_LEAD and are lengthened to MIN_DWELL. The mode at the start stays in
    force until its age has reached MIN_DWELL. Last, boost is reduced if too few booster modules are
    fitted. Some intervals may still use too many modules.

    Tests check the result against each rule.

    Args:
        m: Arrays of the machine.
        time: Instants in ascending order, shape (k,) [s].
        speed: Piston speeds, shape (k, n) [m/s].
        force: Piston forces under gravity, shape (k, n) [N].
        inertia: Piston forces from inertia, shape (k, n) [N].
        preferred: Modes that the search for the discrete path chose, at each instant, shape (k, n).
            Only SB has an effect: an actuator that needs boost then gets SB, even if one servo pump
            would suffice.
        start: Modes in force at the first instant, shape (n,).
        age: Time since the last switch of each actuator, shape (n,) [s].
        hold: Modes after the last instant, shape (n,).

    Returns:
        Mode codes of the intervals between the instants, shape (k - 1, n).
    """
    intervals, n = len(speed) - 1, speed.shape[1]
    modes = np.zeros((intervals, n), dtype=np.uint8)
    needed = np.zeros((intervals, n), dtype=np.bool_)
    demand = np.zeros((intervals, n))
    free = np.empty(n, dtype=np.int64)
    on = np.empty(intervals, dtype=np.bool_)
    shared = np.empty(intervals, dtype=np.bool_)
    sharing = np.empty(intervals, dtype=np.bool_)
    one_pump = get_max_servo_pump_flow(get_shared_hydraulics(m), m.modules_per_mode[DB])
    for j in range(n):
        need, lifts, flow = _determine_needs(m, j, speed, force)
        for i in range(intervals):
            on[i] = need[i] or need[i + 1]
            demand[i, j] = NEED_FACTOR * max(flow[i], flow[i + 1])
        _drop_short_holds(time, on, lifts, BOOSTED_MODES[hold[j]])
        copy_row(needed[:, j], on)
        lacks = _lacks_pressure_to_accelerate(m, j, speed, force, inertia)
        for i in range(intervals):
            on[i] = on[i] or lacks[i] or lacks[i + 1]

        free[j] = _find_first_free_interval(time, age[j])
        for i in range(intervals):
            sharing[i] = demand[i, j] > one_pump or preferred[i, j] == SB
        _time_boosts(time, on, shared, sharing, free[j], start[j], hold[j])
        _write_modes(modes[:, j], on, shared)
    _reduce_to_module_budget(m, time, modes, demand, needed, free)
    return modes


@kernel
def _time_boosts(
    time: FloatArray,
    on: np.ndarray,
    shared: np.ndarray,
    sharing: np.ndarray,
    free: int,
    start: int,
    hold: int,
) -> None:
    """Determine in which intervals an actuator is boosted, and in which the boost is shared (SB).

    Boost begins earlier than it is needed, by BOOST_LEAD. Runs of boost and of shared boost are
    lengthened to MIN_DWELL. Before interval `free` the mode of the start stays in force.

    Args:
        time: Instants in ascending order, shape (k,) [s].
        on: True for each interval in which boost is needed, shape (k - 1,). Written in place: True
            for each interval with boost.
        shared: True for each interval with shared boost, shape (k - 1,). Written in place; its old
            content is ignored.
        sharing: True for each interval in which boost is to be shared, shape (k - 1,).
        free: First interval in which the actuator may leave the mode of the start.
        start: Mode code at the first instant.
        hold: Mode code after the last instant.
    """
    intervals = len(on)
    on[:free] = BOOSTED_MODES[start]
    boost_beside = (_ON if BOOSTED_MODES[start] else _OFF, _ON if BOOSTED_MODES[hold] else _OFF)
    beside = (_ON if start == SB else _OFF, _OFF)
    for ahead in (BOOST_LEAD, 0.0):  # a lengthened SB run may lengthen its boost run
        for i in range(intervals):
            shared[i] = on[i] and (start == SB if i < free else sharing[i])
        _enforce_lead_and_dwell(time, shared, free, intervals, 0.0, beside)
        for i in range(intervals):
            on[i] = on[i] or shared[i]
        _enforce_lead_and_dwell(time, on, free, intervals, ahead, boost_beside)
    for i in range(free, intervals):
        shared[i] = on[i] and sharing[i]
    _enforce_shared_boost_dwell(time, on, shared, free, start, hold)


@kernel
def _write_modes(modes: ModeArray, on: np.ndarray, shared: np.ndarray) -> None:
    """Write the mode of an actuator in each interval into `modes`.

    Args:
        modes: Mode codes of the intervals, shape (k - 1,). Written in place: SB if `shared` is
            True, else DB if `on` is True, else N.
        on: True for each interval with boost, shape (k - 1,).
        shared: True for each interval with shared boost, shape (k - 1,).
    """
    for i in range(len(modes)):
        modes[i] = SB if shared[i] else (DB if on[i] else N)


@kernel
def _find_first_free_interval(time: FloatArray, age: float) -> int:
    """Find the first interval in which an actuator may leave the mode of the start.

    This is allowed after the mode has been in force for MIN_DWELL. Interval i lasts from
    instant i to instant i + 1.

    Args:
        time: Instants in ascending order, shape (k,) [s].
        age: Time since the actuator's last switch, at the first instant [s].

    Returns:
        Index of the interval; k - 1, the number of intervals, if there is none.
    """
    i = 0
    while i < len(time) - 1 and time[i] - time[0] < MIN_DWELL - age - _ROUNDING:
        i += 1
    return i


@kernel
def _determine_needs(
    m: MachineArrays, j: int, speed: FloatArray, force: FloatArray
) -> tuple[np.ndarray, np.ndarray, FloatArray]:
    """Determine an actuator's need for boost and its flow at each instant.

    Boost is supply by servo pumps. An actuator needs it if the main pump's pressure is too low for
    its speed and load. As a reserve, speed and load are multiplied by NEED_FACTOR. At speeds up to
    MAX_HELD_SPEED the actuator counts as at rest, and the pressure must suffice to hold the load.

    Args:
        m: Arrays of the machine.
        j: Index of the actuator.
        speed: Piston speeds, shape (k, n) [m/s].
        force: Piston forces under gravity, shape (k, n) [N].

    Returns:
        Three arrays of shape (k,). The first is True if the actuator needs boost. The second is
        True if it moves against its load and faster than half of MAX_HELD_SPEED. The third is the
        flow into the cylinder, without reserve [m³/s].
    """
    need = np.empty(len(speed), dtype=np.bool_)
    lifts = np.empty(len(speed), dtype=np.bool_)
    flow = np.empty(len(speed))
    oil, valve, cap, rod = (
        get_shared_hydraulics(m),
        m.valve_coefficient[j],
        m.cap_area[j],
        m.rod_area[j],
    )
    for k in range(len(speed)):
        v, f = speed[k, j], force[k, j]
        moved = NEED_FACTOR * v if abs(v) > MAX_HELD_SPEED else 0.0
        need[k] = cylinder_needs_boost(oil, valve, cap, rod, NEED_FACTOR * f, moved)
        # Half the dead band: between the points a cylinder may be a little faster than at them.
        lifts[k] = abs(v) > 0.5 * MAX_HELD_SPEED and opposes_motion(f, v)
        flow[k] = inlet_area(cap, rod, v) * abs(v)
    return need, lifts, flow


@kernel
def _lacks_pressure_to_accelerate(
    m: MachineArrays, j: int, speed: FloatArray, force: FloatArray, inertia: FloatArray
) -> np.ndarray:
    """Determine when the main pump's pressure is too low for an actuator to accelerate its load.

    The pressure must carry the load (gravity and inertia) and the drop over the valve. In addition,
    MARGIN_SHARE_WITHOUT_INERTIA of the boost margin (pressure in reserve) must remain for friction
    and control. The result is False if the piston does not move against the load, or if its speed
    is at most 0.9 MAX_HELD_SPEED. Speeds and loads are multiplied by NEED_FACTOR as a reserve.

    Args:
        m: Arrays of the machine.
        j: Index of the actuator.
        speed: Piston speeds, shape (k, n) [m/s].
        force: Piston forces under gravity, shape (k, n) [N].
        inertia: Piston forces from inertia, shape (k, n) [N].

    Returns:
        True at each instant at which the pressure is too low, shape (k,).
    """
    oil, valve, cap, rod = (
        get_shared_hydraulics(m),
        m.valve_coefficient[j],
        m.cap_area[j],
        m.rod_area[j],
    )
    spared = compute_inertia_margin(oil)
    lacks = np.zeros(len(speed), dtype=np.bool_)
    for k in range(len(speed)):
        v, load = speed[k, j], force[k, j] + inertia[k, j]
        if abs(v) > 0.9 * MAX_HELD_SPEED and opposes_motion(load, v):
            needed = compute_pressure_with_margin(
                oil, valve, cap, rod, NEED_FACTOR * load, NEED_FACTOR * v
            )
            lacks[k] = needed - spared > oil.supply_pressure
    return lacks


@kernel
def _find_run_end(on: np.ndarray, first: int, last: int) -> int:
    """Find the end of the run of equal values that begins at an index.

    Args:
        on: True or False for each interval, shape (intervals,).
        first: Index at which the run begins.
        last: Index at which the search ends at the latest.

    Returns:
        Index of the first value after the run, at most `last`.
    """
    end = first + 1
    while end < last and on[end] == on[first]:
        end += 1
    return end


@kernel
def _drop_short_holds(
    time: FloatArray, on: np.ndarray, lifts: np.ndarray, held_after: bool
) -> None:
    """Remove boost (supply by servo pumps) that only holds a load for a short time.

    The closed valve holds the load instead. A run is an unbroken sequence of intervals with boost.
    It stays if it contains a motion against the load, or if it lasts MAX_VALVE_HOLD or more. It
    also stays if it reaches the last instant and `held_after` is True.

    Args:
        time: Instants in ascending order, shape (k,) [s].
        on: True for each interval with boost, shape (k - 1,). Written in place.
        lifts: True at each instant at which the piston moves against the load, shape (k,).
        held_after: True if the actuator is boosted after the last instant.
    """
    first = 0
    while first < len(on):
        end = _find_run_end(on, first, len(on))
        lasting = time[end] - time[first] >= MAX_VALVE_HOLD or (end == len(on) and held_after)
        if on[first] and not lasting and not lifts[first : end + 1].any():
            on[first:end] = False
        first = end


@kernel
def _enforce_lead_and_dwell(
    time: FloatArray,
    on: np.ndarray,
    first: int,
    last: int,
    lead: float,
    beside: tuple[int, int],
) -> None:
    """Let each run of True values begin earlier, lengthen short runs, and close short gaps.

    A run is a sequence of intervals that are True. A gap is a sequence of intervals that are False.
    First the beginning of each run is moved earlier by `lead`. Then runs shorter than MIN_DWELL are
    lengthened, first at the end and, if there is no more room, at the beginning. Last, gaps shorter
    than MIN_DWELL become True.

    Args:
        time: Limits of the intervals; interval i lasts from time[i] to time[i + 1], [s].
        on: True or False for each interval. Entries from `first` to last - 1 are written in place.
        first: First interval that may change.
        last: Last interval that may change, plus 1.
        lead: Time by which each run begins earlier [s].
        beside: State before interval `first`, and state from interval `last` on. _ON: a run that
            touches this end counts as long enough. _OFF: a gap that touches this end is not closed.
            _EDGE: runs and gaps at this end are treated like all others.
    """
    before, after = beside
    since = math.inf
    for i in range(last - 1, first - 1, -1):
        if on[i]:
            since = time[i] - lead
        on[i] = time[i + 1] > since + _ROUNDING

    i = first
    while i < last:
        end = _find_run_end(on, i, last)
        touches = (i == first and before == _ON) or (end == last and after == _ON)
        if on[i] and not touches:
            while end < last and time[end] - time[i] < _LEAST_RUN:
                end += 1
            start = i
            while start > first and time[end] - time[start] < _LEAST_RUN:
                start -= 1
            on[start:end] = True
        i = end

    i = first
    while i < last:
        end = _find_run_end(on, i, last)
        stays = (i == first and before == _OFF) or (end == last and after == _OFF)
        if not on[i] and not stays and time[end] - time[i] < _LEAST_RUN:
            on[i:end] = True
        i = end


@kernel
def _enforce_shared_boost_dwell(
    time: FloatArray,
    on: np.ndarray,
    shared: np.ndarray,
    free: int,
    start: int,
    hold: int,
) -> None:
    """Adjust the intervals of boost in mode SB so that SB and DB each last long enough.

    A boosted actuator is in mode SB (shared rail) or DB (own servo pump). A run is a sequence of
    boosted intervals, with parts in SB and parts in DB. A run shorter than MIN_DWELL becomes DB as
    a whole, unless SB is in force just before or after it. A run without SB in it or beside it
    stays DB. In all other runs, SB parts begin earlier by BOOST_LEAD. SB parts shorter than
    MIN_DWELL are lengthened at their end, and if this is not enough, at their beginning. Then DB
    parts shorter than MIN_DWELL become SB, unless DB is in force just before or after the run,
    beside this part. The intervals before `free` stay as they are.

    Args:
        time: Limits of the intervals, shape (k,) [s].
        on: True for each interval with boost, DB or SB, shape (k - 1,).
        shared: True for each interval with SB, shape (k - 1,). Written in place.
        free: First interval in which the actuator may be switched.
        start: Mode in force before the first interval.
        hold: Mode in force after the last interval.
    """
    first = 0
    while first < len(on):
        end = _find_run_end(on, first, len(on))
        begin = max(first, free)
        if on[first] and begin < end:
            before = after = _EDGE
            if first == 0 and BOOSTED_MODES[start]:
                before = _ON if start == SB else _OFF
            if end == len(on) and BOOSTED_MODES[hold]:
                after = _ON if hold == SB else _OFF
            if before != _ON and after != _ON and time[end] - time[begin] < _LEAST_RUN:
                shared[begin:end] = False
            if shared[begin:end].any() or _ON in (before, after):
                _enforce_lead_and_dwell(time, shared, begin, end, BOOST_LEAD, (before, after))
        first = end


@kernel
def _reduce_to_module_budget(
    m: MachineArrays,
    time: FloatArray,
    modes: ModeArray,
    demand: FloatArray,
    needed: np.ndarray,
    free: IntArray,
) -> None:
    """Reduce boost in intervals whose modes use more booster modules than are fitted.

    A run is a sequence of intervals in which an actuator has one mode. For each interval, the run
    in mode SB (shared rail) with the least peak flow becomes DB (own servo pump). This is repeated
    until the modules suffice or no run is left. Then DB becomes N (main pump alone) in intervals in
    which `needed` is False. No change makes a run shorter than MIN_DWELL. An interval may still
    use too many modules at the end.

    Args:
        m: Arrays of the machine.
        time: Limits of the intervals, shape (k,) [s].
        modes: Mode codes (N, DB, SB), shape (k - 1, n). Written in place.
        demand: Flow into each cylinder in each interval, shape (k - 1, n) [m³/s].
        needed: True for each interval in which an actuator needs boost to move or hold its load,
            shape (k - 1, n).
        free: First interval in which each actuator may be switched, shape (n,). Earlier intervals
            do not change.
    """
    intervals, n = modes.shape
    for i in range(intervals):
        while count_used_modules(m, modes[i]) > m.module_count:
            loser = -1
            least = math.inf
            first = last = 0
            for j in range(n):
                if modes[i, j] != SB or i < free[j]:
                    continue
                a, b = _extend_run(modes, i, i + 1, j, SB)
                a = max(a, free[j])
                peak = demand[a:b, j].max()
                if peak < least and _keeps_dwell_after_change(time, modes, a, b, j, DB):
                    loser, least, first, last = j, peak, a, b
            if loser >= 0:
                modes[first:last, loser] = DB
                continue
            for j in range(n):
                if modes[i, j] != DB or i < free[j] or needed[i, j]:
                    continue
                a, b = _extend_run(modes, i, i + 1, j, DB)
                first, last = i, i + 1
                while first > max(a, free[j]) and not needed[first - 1, j]:
                    first -= 1
                while last < b and not needed[last, j]:
                    last += 1
                if _keeps_dwell_after_change(time, modes, first, last, j, N):
                    modes[first:last, j] = N
                    loser = j
                    break
            if loser < 0:
                break


@kernel
def _extend_run(modes: ModeArray, first: int, last: int, j: int, mode: int) -> tuple[int, int]:
    """Extend a range of intervals by adjacent intervals in which an actuator has a given mode.

    Args:
        modes: Mode codes (N, DB, SB), shape (intervals, n).
        first: Index of the range's first interval.
        last: Index of the range's last interval plus 1.
        j: Index of the actuator.
        mode: Mode code of the adjacent intervals that are added.

    Returns:
        Index of the first interval, and index of the last interval plus 1.
    """
    while first > 0 and modes[first - 1, j] == mode:
        first -= 1
    while last < len(modes) and modes[last, j] == mode:
        last += 1
    return first, last


@kernel
def _keeps_dwell_after_change(
    time: FloatArray, modes: ModeArray, first: int, last: int, j: int, mode: int
) -> bool:
    """Return whether an actuator's modes still last long enough after a change of its mode.

    A run is a sequence of intervals of equal mode. The run of the new mode and the remaining runs
    before and after it are checked. A run that touches the beginning or the end of the schedule
    always counts as long enough.

    Args:
        time: Limits of the intervals, shape (k,) [s].
        modes: Mode codes before the change, shape (k - 1, n).
        first: First interval to change.
        last: Last interval to change, plus 1.
        j: Index of the actuator.
        mode: New mode of these intervals.

    Returns:
        True if the change keeps MIN_DWELL.
    """
    a, b = _extend_run(modes, first, last, j, mode)
    if a > 0 and b < len(modes) and time[b] - time[a] < _LEAST_RUN:
        return False
    if a > 0:
        c, _ = _extend_run(modes, a - 1, a, j, modes[a - 1, j])
        if c > 0 and time[a] - time[c] < _LEAST_RUN:
            return False
    if b < len(modes):
        _, c = _extend_run(modes, b, b + 1, j, modes[b, j])
        if c < len(modes) and time[c] - time[b] < _LEAST_RUN:
            return False
    return True


@kernel
def _compute_shortest_run(
    time: FloatArray, modes: ModeArray, start: ModeArray, age: FloatArray, hold: ModeArray
) -> float:
    """Compute the least time between two mode switches of the same actuator.

    This includes the time from an actuator's last switch before the first instant to its next
    switch.

    Args:
        time: Instants in ascending order, shape (k,) [s].
        modes: Mode codes between the instants, shape (k - 1, n).
        start: Modes in force before the first instant, shape (n,).
        age: Time since the last switch of each actuator, at the first instant, shape (n,) [s].
        hold: Modes from the last instant on, shape (n,).

    Returns:
        Least time over all actuators [s]. An actuator does not count if it is not switched, or if
        it is switched once and its age is inf. inf if no actuator counts.
    """
    intervals, n = modes.shape
    shortest = math.inf
    for j in range(n):
        mode, switched = start[j], time[0] - age[j]
        for i in range(intervals + 1):
            now = modes[i, j] if i < intervals else hold[j]
            if now != mode:
                shortest = min(shortest, time[i] - switched)
                mode, switched = now, time[i]
    return shortest
