"""S4: the switching times of every actuator, from a time trajectory and the force it needs.

An actuator is boosted where it moves against its load and p_L + m(v) + margin > P_S, from a
little before (the servo pump has to raise its pressure first), in SB where one servo pump's flow
is not enough, and never shorter than a least dwell. Where inertia takes most of the margin,
p_L(F + inertia) + m(v) + margin/2 > P_S, it is boosted as well, as far as the modules go.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.holding import modes_to_stop
from mhsb_model.hydraulics import (
    highest_flow,
    inlet_area,
    lacks_pressure,
    oil_of,
    opposes_motion,
    pressure_to_move,
    spared_margin,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import LONG_AGO_NS, ModeSchedule
from mhsb_model.modes import BOOSTED, Mode
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray, IntArray, ModeArray, frozen
from mhsb_planner.motion.motion_profile import MotionProfile, motion_profile
from mhsb_planner.motion.s3_limits import DEAD_BAND, repeats

RESERVE = 1.005
"""Needs are judged at slightly higher speeds and forces, so that they hold between the points."""

_ROUNDING = 1e-9  # s

N, DB, SB = int(Mode.N), int(Mode.DB), int(Mode.SB)

# What lies outside the intervals that `_settle` looks at.
_OFF, _ON, _EDGE = 0, 1, 2


class SwitchingRules(NamedTuple):
    """How modes are switched."""

    min_dwell: float = 0.3  # s, shortest time between two switches of an actuator
    lead: float = 0.1  # s, by which boost precedes its need
    max_hold: float = 1.0  # s, how long a closed valve holds a load above P_S without boost


@dataclass(frozen=True, eq=False)
class StartModes:
    """Modes in force where a schedule begins, and for how long they have been.

    modes  uint8[n]
    age    float64[n] s since each actuator's last switch
    """

    modes: ModeArray
    age: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "modes", frozen(np.asarray(self.modes, dtype=np.uint8)))
        object.__setattr__(self, "age", frozen(np.asarray(self.age, dtype=np.float64)))

    @classmethod
    def settled(cls, modes: ModeArray) -> StartModes:
        """Modes that have been in force for long."""
        return cls(modes, np.full(len(modes), math.inf))

    @classmethod
    def during(cls, schedule: ModeSchedule, time_ns: int) -> StartModes:
        """The modes of a schedule at an absolute time; old where it does not know since when."""
        switched = schedule.switched_ns(time_ns)
        age = np.where(switched > LONG_AGO_NS, (time_ns - switched) / SECOND_NS, math.inf)
        return cls(schedule.modes_at(time_ns), age)


def mode_schedule(
    machine: Machine,
    trajectory: Trajectory,
    start: StartModes,
    preferred: ModeArray | None = None,
    rules: SwitchingRules | None = None,
) -> ModeSchedule:
    """Schedule of a trajectory, with its stamp; the last row, at its end, is the holding modes.

    preferred  uint8[points, n]: modes chosen by S2 around each point; SB there is kept in boost
               where the module budget allows, even if one servo pump's flow would do

    Where all flows cannot be had within the budget, SB gives way to DB: compare the result with
    `s3_limits.first_violation`. Where the motion is too short for its switches, the dwell is not
    kept: see `keeps_dwell`.
    """
    profile = motion_profile(
        machine, trajectory.position, trajectory.velocity, trajectory.acceleration
    )
    hold = modes_to_stop(machine, profile.force[-1], start.modes)
    modes = interval_modes(
        machine, trajectory.offset_ns / SECOND_NS, profile, start, hold, preferred, rules
    )
    return schedule_of_intervals(trajectory.stamp_ns, trajectory.offset_ns, modes, hold)


def interval_modes(
    machine: Machine,
    time: FloatArray,
    profile: MotionProfile,
    start: StartModes,
    hold: ModeArray,
    preferred: ModeArray | None = None,
    rules: SwitchingRules | None = None,
) -> ModeArray:
    """Modes between the instants `time` float64[k] s of a profile, uint8[k - 1, n].

    hold  uint8[n], modes in which the arm then rests
    """
    rules = rules or SwitchingRules()
    if preferred is None:
        preferred = np.full(profile.speed.shape, Mode.N)
    if len(time) < 2:
        return np.empty((0, machine.joint_count), dtype=np.uint8)
    return _interval_modes(
        machine.arrays,
        time,
        profile.speed,
        profile.force,
        profile.inertia,
        np.array(preferred, dtype=np.uint8),
        start.modes,
        start.age,
        hold,
        rules,
    )


def keeps_dwell(
    time: FloatArray,
    modes: ModeArray,
    start: StartModes,
    hold: ModeArray,
    rules: SwitchingRules | None = None,
) -> bool:
    """Whether no actuator is switched twice within the least dwell; arguments as above."""
    least = (rules or SwitchingRules()).min_dwell - _ROUNDING
    return bool(_shortest_run(time, modes, start.modes, start.age, hold) >= least)


def schedule_of_intervals(
    stamp_ns: int, offset_ns: IntArray, modes: ModeArray, hold: ModeArray
) -> ModeSchedule:
    """Schedule with the modes uint8[k-1, n] between k times, `hold` uint8[n] from the last on."""
    rows = np.append(_changes(modes), len(modes))
    return ModeSchedule(stamp_ns, offset_ns[rows], np.vstack([modes, hold])[rows])


@kernel
def _changes(modes: ModeArray) -> IntArray:
    """Rows that are the first, or differ from the one before."""
    rows, count = np.empty(len(modes), dtype=np.int64), 0
    for k in range(len(modes)):
        if not repeats(modes, k):
            rows[count] = k
            count += 1
    return rows[:count]


@kernel
def _interval_modes(
    m: MachineArrays,
    time: FloatArray,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    preferred: ModeArray,
    start: ModeArray,
    age: FloatArray,
    hold: ModeArray,
    rules: SwitchingRules,
) -> ModeArray:
    """Kernel of `interval_modes`; the tests check its result against the rules, one by one."""
    lead, dwell = rules.lead, rules.min_dwell
    intervals, n = len(speed) - 1, speed.shape[1]
    modes = np.zeros((intervals, n), dtype=np.uint8)
    needed = np.zeros((intervals, n), dtype=np.bool_)
    demand = np.zeros((intervals, n))
    free = np.empty(n, dtype=np.int64)
    on = np.empty(intervals, dtype=np.bool_)
    shared = np.empty(intervals, dtype=np.bool_)
    one_pump = highest_flow(oil_of(m), m.modules_per_mode[DB])
    for j in range(n):
        need, lifts, flow = _needs(m, j, speed, force)
        for i in range(intervals):
            on[i] = need[i] or need[i + 1]
            demand[i, j] = RESERVE * max(flow[i], flow[i + 1])
        _drop_short_holds(time, on, lifts, rules.max_hold, BOOSTED[hold[j]])
        needed[:, j] = on
        lacks = _lacks_to_accelerate(m, j, speed, force, inertia)
        for i in range(intervals):
            on[i] = on[i] or lacks[i] or lacks[i + 1]

        free[j] = _first_free(time, age[j], dwell)
        on[: free[j]] = BOOSTED[start[j]]
        before = _ON if BOOSTED[start[j]] else _OFF
        after = _ON if BOOSTED[hold[j]] else _OFF
        for ahead in (lead, 0.0):  # what is shared for its least time is boosted meanwhile
            for i in range(intervals):
                wanted = demand[i, j] > one_pump or preferred[i, j] == SB
                shared[i] = on[i] and (start[j] == SB if i < free[j] else wanted)
            shared_before = _ON if start[j] == SB else _OFF
            _settle(time, shared, free[j], intervals, 0.0, dwell, shared_before, _OFF)
            on |= shared
            _settle(time, on, free[j], intervals, ahead, dwell, before, after)
        for i in range(free[j], intervals):
            shared[i] = on[i] and (demand[i, j] > one_pump or preferred[i, j] == SB)
        _settle_shared(time, on, shared, free[j], lead, dwell, start[j], hold[j])
        for i in range(intervals):
            modes[i, j] = SB if shared[i] else (DB if on[i] else N)
    _keep_budget(m, time, modes, demand, needed, free, dwell)
    return modes


@kernel
def _first_free(time: FloatArray, age: float, dwell: float) -> int:
    """The first interval in which a mode that is `age` s old at time[0] may be left."""
    i = 0
    while i < len(time) - 1 and time[i] - time[0] < dwell - age - _ROUNDING:
        i += 1
    return i


@kernel
def _needs(
    m: MachineArrays, j: int, speed: FloatArray, force: FloatArray
) -> tuple[np.ndarray, np.ndarray, FloatArray]:
    """Of actuator j at each instant: need for boost, motion against the load, flow [m³/s]."""
    need = np.empty(len(speed), dtype=np.bool_)
    lifts = np.empty(len(speed), dtype=np.bool_)
    flow = np.empty(len(speed))
    oil, valve, cap, rod = oil_of(m), m.valve_coefficient[j], m.cap_area[j], m.rod_area[j]
    for k in range(len(speed)):
        v, f = speed[k, j], force[k, j]
        moved = RESERVE * v if abs(v) > DEAD_BAND else 0.0
        need[k] = lacks_pressure(oil, valve, cap, rod, RESERVE * f, moved)
        # Half the dead band: between the points a cylinder may be a little faster than at them.
        lifts[k] = abs(v) > 0.5 * DEAD_BAND and opposes_motion(f, v)
        flow[k] = inlet_area(cap, rod, v) * abs(v)
    return need, lifts, flow


@kernel
def _lacks_to_accelerate(
    m: MachineArrays, j: int, speed: FloatArray, force: FloatArray, inertia: FloatArray
) -> np.ndarray:
    """Whether P_S leaves actuator j too little to accelerate, at each instant."""
    oil, valve, cap, rod = oil_of(m), m.valve_coefficient[j], m.cap_area[j], m.rod_area[j]
    spared = spared_margin(oil)
    lacks = np.zeros(len(speed), dtype=np.bool_)
    for k in range(len(speed)):
        v, load = speed[k, j], force[k, j] + inertia[k, j]
        if abs(v) > 0.9 * DEAD_BAND and opposes_motion(load, v):
            needed = pressure_to_move(oil, valve, cap, rod, RESERVE * load, RESERVE * v)
            lacks[k] = needed - spared > oil.supply_pressure
    return lacks


@kernel
def _run_end(on: np.ndarray, first: int, last: int) -> int:
    """End of the run of equal values that begins at `first`, at most `last`."""
    end = first + 1
    while end < last and on[end] == on[first]:
        end += 1
    return end


@kernel
def _drop_short_holds(
    time: FloatArray, on: np.ndarray, lifts: np.ndarray, longest: float, held_after: bool
) -> None:
    """Clear runs that only hold the load, where the closed valve can do so meanwhile."""
    first = 0
    while first < len(on):
        end = _run_end(on, first, len(on))
        lasting = time[end] - time[first] >= longest or (end == len(on) and held_after)
        if on[first] and not lasting and not lifts[first : end + 1].any():
            on[first:end] = False
        first = end


@kernel
def _settle(
    time: FloatArray,
    on: np.ndarray,
    first: int,
    last: int,
    lead: float,
    dwell: float,
    before: int,
    after: int,
) -> None:
    """Give the runs of `on` within [first, last) their lead and least length, and close gaps.

    before, after: what lies outside: _ON (runs that touch it count as long), _OFF (gaps that
    touch it stay) or _EDGE (neither). Interval i lasts from time[i] to time[i + 1].
    """
    since = math.inf
    for i in range(last - 1, first - 1, -1):
        if on[i]:
            since = time[i] - lead
        on[i] = time[i + 1] > since + _ROUNDING

    i = first
    while i < last:
        end = _run_end(on, i, last)
        touches = (i == first and before == _ON) or (end == last and after == _ON)
        if on[i] and not touches:
            while end < last and time[end] - time[i] < dwell - _ROUNDING:
                end += 1
            start = i
            while start > first and time[end] - time[start] < dwell - _ROUNDING:
                start -= 1
            on[start:end] = True
        i = end

    i = first
    while i < last:
        end = _run_end(on, i, last)
        stays = (i == first and before == _OFF) or (end == last and after == _OFF)
        if not on[i] and not stays and time[end] - time[i] < dwell - _ROUNDING:
            on[i:end] = True
        i = end


@kernel
def _settle_shared(
    time: FloatArray,
    on: np.ndarray,
    shared: np.ndarray,
    free: int,
    lead: float,
    dwell: float,
    start: int,
    hold: int,
) -> None:
    """Settle the SB parts of every boosted run, so that its DB parts are long enough too.

    The intervals before `free` stay as they are; SB without room for its least time is DB.
    """
    first = 0
    while first < len(on):
        end = _run_end(on, first, len(on))
        begin = max(first, free)
        if on[first] and begin < end:
            before = after = _EDGE
            if first == 0 and BOOSTED[start]:
                before = _ON if start == SB else _OFF
            if end == len(on) and BOOSTED[hold]:
                after = _ON if hold == SB else _OFF
            if before != _ON and after != _ON and time[end] - time[begin] < dwell - _ROUNDING:
                shared[begin:end] = False
            if shared[begin:end].any() or before == _ON:
                _settle(time, shared, begin, end, lead, dwell, before, after)
        first = end


@kernel
def _keep_budget(
    m: MachineArrays,
    time: FloatArray,
    modes: ModeArray,
    demand: FloatArray,
    needed: np.ndarray,
    free: IntArray,
    dwell: float,
) -> None:
    """Bring every interval within the module budget, without a run that is shorter than `dwell`.

    The SB run with the least flow demand falls back to DB first; then boost that is there only
    for lead or dwell is given up. Nothing changes before free[j], an actuator's first interval in
    which it may be switched. What still does not fit stays, for the caller to find.
    """
    intervals, n = modes.shape
    for i in range(intervals):
        while True:
            used = 0
            for j in range(n):
                used += m.modules_per_mode[modes[i, j]]
            if used <= m.module_count:
                break
            loser = -1
            least = math.inf
            first = last = 0
            for j in range(n):
                if modes[i, j] != SB or i < free[j]:
                    continue
                a, b = _run_around(modes, i, j)
                a = max(a, free[j])
                peak = demand[a:b, j].max()
                if peak < least and _long_enough(time, modes, a, b, j, DB, dwell):
                    loser, least, first, last = j, peak, a, b
            if loser >= 0:
                modes[first:last, loser] = DB
                continue
            for j in range(n):
                if modes[i, j] != DB or i < free[j] or needed[i, j]:
                    continue
                a, b = _run_around(modes, i, j)
                first, last = i, i + 1
                while first > max(a, free[j]) and not needed[first - 1, j]:
                    first -= 1
                while last < b and not needed[last, j]:
                    last += 1
                if _long_enough(time, modes, first, last, j, N, dwell):
                    modes[first:last, j] = N
                    loser = j
                    break
            if loser < 0:
                break


@kernel
def _run_around(modes: ModeArray, i: int, j: int) -> tuple[int, int]:
    """The run of actuator j's mode around interval i, its first and the one after its last."""
    a, b = i, i + 1
    while a > 0 and modes[a - 1, j] == modes[i, j]:
        a -= 1
    while b < len(modes) and modes[b, j] == modes[i, j]:
        b += 1
    return a, b


@kernel
def _long_enough(
    time: FloatArray, modes: ModeArray, first: int, last: int, j: int, mode: int, dwell: float
) -> bool:
    """Whether `mode` in [first, last), and what it leaves of the runs beside it, last long enough.

    Runs that touch either end of the schedule go on there.
    """
    a, b = first, last
    while a > 0 and modes[a - 1, j] == mode:
        a -= 1
    while b < len(modes) and modes[b, j] == mode:
        b += 1
    least = dwell - _ROUNDING
    if a > 0 and b < len(modes) and time[b] - time[a] < least:
        return False
    if a > 0:
        c, _ = _run_around(modes, a - 1, j)
        if c > 0 and time[a] - time[c] < least:
            return False
    if b < len(modes):
        _, c = _run_around(modes, b, j)
        if c < len(modes) and time[c] - time[b] < least:
            return False
    return True


@kernel
def _shortest_run(
    time: FloatArray, modes: ModeArray, start: ModeArray, age: FloatArray, hold: ModeArray
) -> float:
    """Least time between two switches of an actuator [s], those before the first instant included.

    start, age  in force before, and for how long [s]; hold: from the last instant on
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
