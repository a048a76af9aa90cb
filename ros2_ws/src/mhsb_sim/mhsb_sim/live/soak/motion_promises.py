"""Promises about motion: continuous, within limits, out of zones, and at rest when it has to be."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, IntArray
from mhsb_msgs_py.sim_status import APPLIED
from mhsb_planner.motion.s3_trajectory import FitRules
from mhsb_sim.live.soak.events import PLANNER, SIM, DeedKind, Events, overlapping
from mhsb_sim.live.soak.kept import Kept
from mhsb_sim.recording.recording import JointTable

BoolArray = NDArray[np.bool_]

LARGEST_JUMP = 1e-6  # rad, rad/s
SAME_CURVE = 1e-9
"""Reference and plan are evaluated by the same formula [rad]."""

SAMPLED_NS = 15_000_000
"""References farther apart than this, others having been missed, say nothing of each other."""

UNEVEN = 1e-6
"""What a quintic of the suite's motions can differ by from the cubic through two references that
are 10 ms apart, where its jerk jumps between them [rad]."""

UNEVEN_SLOWED = 2e-5
"""The same of a motion whose pace the guard changes: by 8/s, of joints at 0.3 rad/s, in 10 ms."""

JOINT_TOLERANCE = 1e-6  # rad
SPEED_EXCESS = 0.005
"""Share by which a motion that follows its path may pass V_max and the pump's flow, by rounding."""

BRAKING_NS, SLEWING_BRAKING_NS = 2 * SECOND_NS, 3 * SECOND_NS
"""Time after a stop in which the arm comes to rest; an excavator that slewed took 2.5 s."""

HEALED_SPEED = 0.05
"""What a joint may move at after healing, without a new goal [rad/s]."""

WINDOW_NS = SECOND_NS // 10
"""Over which a measured speed is taken."""


def small_jumps(events: Events) -> Kept:
    """At no hand-over the reference jumps, as the arm measured it."""
    applied = [e.value for e in events.recording.hand_overs if e.value.outcome == APPLIED]
    broken = tuple(
        f"plan {events.seconds(each.plan_stamp_ns):.3f} s: {each.position_jump:.2g} rad, "
        f"{each.velocity_jump:.2g} rad/s"
        for each in applied
        if not max(each.position_jump, each.velocity_jump) <= LARGEST_JUMP
    )
    return Kept(len(applied), broken)


def continuous_reference(events: Events) -> Kept:
    """From one reference to the next there is no jump, but where the simulation starts anew or
    supervision tells that it sets the reference; a plan that is slowed bends more sharply."""
    table = events.recording.references
    rows = np.flatnonzero(_neighbours(table))
    slowed = slowed_at(events, table.recorded_ns)
    apart = gaps(table, rows)
    anew = events.deeds_of(DeedKind.RESET, DeedKind.START, DeedKind.END, DeedKind.HEAL)
    told_ns = [
        each.recorded_ns for each in events.recording.simulator_reports if each.value.faulty
    ]
    broken = []
    for row, gap in zip(rows, apart, strict=True):
        time_ns = int(table.recorded_ns[row])
        uneven = UNEVEN_SLOWED if slowed[row] else UNEVEN
        if gap <= uneven or overlapping(anew, time_ns, time_ns, before=0.5, after=0.5):
            continue
        told = any(abs(time_ns - each) < SECOND_NS for each in told_ns)
        if told or _on_one_plan(events, int(row)):
            continue
        broken.append(f"at {events.seconds(time_ns):.3f} s it jumps by {gap:.2g} rad")
    return Kept(len(rows), tuple(broken))


def _on_one_plan(events: Events, row: int) -> bool:
    """Whether a reference and the next one lie on one published curve, which has no jumps."""
    table, pair = events.recording.references, slice(row, row + 2)
    time_ns = table.time_ns[pair]
    return any(
        np.abs(plan.sample_many(time_ns)[0] - table.position[pair]).max() <= SAME_CURVE
        for plan in events.recording.trajectories
        if plan.stamp_ns <= time_ns[0]
    )


def gaps(table: JointTable, rows: IntArray) -> FloatArray:
    """How far the reference after each row is from where this one leads [rad].

    q₁ − q₀ − h/2 (q̇₀ + q̇₁) + h²/12 (q̈₁ − q̈₀): zero for every curve up to the fourth degree.
    """
    h = ((table.time_ns[rows + 1] - table.time_ns[rows]) / SECOND_NS)[:, None]
    q, qd, qdd = table.position, table.velocity, table.acceleration
    moved = 0.5 * h * (qd[rows] + qd[rows + 1]) - h**2 / 12 * (qdd[rows + 1] - qdd[rows])
    return np.abs(q[rows + 1] - q[rows] - moved).max(axis=1, initial=0.0)


def follows_the_plan(events: Events) -> Kept:
    """While a plan is in force, the reference is that plan's curve, in the plan's own time.

    Where the arm tells that it follows it later, by how much is known too seldom.
    """
    recording = events.recording
    table, plans = recording.references, {each.stamp_ns: each for each in recording.trajectories}
    broken, tested = [], 0
    for stamp_ns, begin_ns, end_ns in _in_force(events):
        if stamp_ns not in plans:
            continue
        inside = (table.recorded_ns > begin_ns) & (table.recorded_ns < end_ns)
        inside &= ~slowed_at(events, table.recorded_ns)
        if not inside.any():
            continue
        tested += int(inside.sum())
        away = np.abs(
            table.position[inside] - plans[stamp_ns].sample_many(table.time_ns[inside])[0]
        ).max(axis=1)
        worst = int(np.argmax(away))
        if away[worst] > SAME_CURVE:
            when = events.seconds(int(table.recorded_ns[inside][worst]))
            broken.append(f"at {when:.3f} s it is {away[worst]:.2g} rad from plan {stamp_ns}")
    return Kept(tested, tuple(broken))


def slowed_at(events: Events, time_ns: IntArray) -> BoolArray:
    """Whether the arm tells within a second of each time that it follows plans later."""
    slowed = np.zeros(len(time_ns), dtype=bool)
    for each in events.recording.simulator_reports:
        if each.value.plan_delay > 0.0:
            slowed |= np.abs(time_ns - each.recorded_ns) < SECOND_NS
    return slowed


def within_joint_limits(events: Events) -> Kept:
    """The reference keeps within the joints' limits."""
    table, limits = events.recording.references, events.machine.arrays
    q = table.position
    beyond = np.maximum(limits.joint_min - q, q - limits.joint_max).max(axis=1, initial=-np.inf)
    return _broken_rows(events, table, beyond > JOINT_TOLERANCE, beyond, "rad beyond a limit")


def within_speed_limits(events: Events) -> Kept:
    """No piston of the reference is faster than V_max, and their flow not more than the pump's.

    The table planner's polynomials may pass V_max, as the paper's do.
    """
    table, m = events.recording.references, events.machine.arrays
    arms = np.array([events.machine.moment_arms(q) for q in table.position])
    speed = arms.reshape(table.velocity.shape) * table.velocity
    inlet = np.where(speed > 0.0, m.cap_area, m.rod_area)
    pump = m.main_pump_flow - events.machine.joint_count * m.leakage_flow
    flow = (inlet * np.abs(speed)).sum(axis=1) / pump
    fastest = (np.abs(speed) / m.max_piston_speed).max(axis=1, initial=0.0)
    share = np.maximum(fastest / (1.0 + _allowed_excess(events, table.recorded_ns)), flow)
    return _broken_rows(events, table, share > 1.0 + SPEED_EXCESS, share, "of V_max or the flow")


def _allowed_excess(events: Events, time_ns: IntArray) -> FloatArray:
    """By how much V_max may be passed [-]: more from when a planner is told to use the table."""
    allowed = np.zeros(len(time_ns))
    for told in events.deeds_of(DeedKind.PARAMETER):
        if told.value == "table":
            ends = (life.end_ns for life in events.lives_of(PLANNER))
            end_ns = min((end for end in ends if end > told.begin_ns), default=events.end_ns)
            allowed[(time_ns > told.begin_ns) & (time_ns < end_ns)] = FitRules().max_excess
    return allowed


def keeps_out(events: Events) -> Kept:
    """Zones that are left, or never entered, are not entered, once there was time to stop."""
    table = events.recording.references
    at_ns = table.recorded_ns
    broken, tested = [], 0
    for zones, begin_ns, end_ns in _zones(events):
        arm = events.machine.changed(zones=zones)
        rows = np.flatnonzero((at_ns > begin_ns + _braking_ns(events)) & (at_ns < end_ns))
        clearance = np.array([arm.clearance(q)[0] for q in table.position[rows]])
        tested += len(rows)
        outside = np.logical_or.accumulate(clearance > 0.0) if len(rows) else clearance > 0.0
        entered = np.flatnonzero(outside & (clearance < -JOINT_TOLERANCE))
        if len(entered):
            when = events.seconds(int(at_ns[rows[entered[0]]]))
            broken.append(f"at {when:.2f} s it is {-clearance[entered].min():.2g} m in a zone")
    return Kept(tested, tuple(broken))


def rests_after_stops(events: Events) -> Kept:
    """After a stop nothing moves until the next goal."""
    table = events.recording.references
    next_deeds = events.deeds_of(DeedKind.GOAL, DeedKind.RESET, DeedKind.START, DeedKind.HEAL)
    broken, tested = [], 0
    for stop in events.deeds_of(DeedKind.STOP):
        later = (deed.begin_ns for deed in next_deeds if deed.begin_ns > stop.begin_ns)
        end_ns = min(later, default=events.end_ns)
        still = table.recorded_ns > stop.end_ns + _braking_ns(events)
        still &= table.recorded_ns < end_ns
        if not (stop.done and still.any()):
            continue
        tested += 1
        moving = np.flatnonzero(still & table.velocity.any(axis=1))
        if len(moving):
            when, stopped = events.seconds(int(table.recorded_ns[moving[0]])), stop.begin_ns
            broken.append(
                f"stopped by the {stop.node} at {events.seconds(stopped):.2f} s, it moves at "
                f"{when:.2f} s"
            )
    return Kept(tested, tuple(broken))


def heals_gently(events: Events) -> Kept:
    """After healing an arm that holds its position, or as soon as it has braked, no joint is
    faster than 0.05 rad/s without a new goal."""
    table, reference = events.recording.joint_states, events.recording.references
    rests_ns = reference.recorded_ns[~reference.velocity.any(axis=1)]
    others = events.deeds_of(DeedKind.GOAL, DeedKind.RESET, DeedKind.END, DeedKind.FAULT)
    broken, tested = [], 0
    for heal in events.deeds_of(DeedKind.HEAL):
        later = (deed.begin_ns for deed in others if deed.begin_ns > heal.begin_ns)
        end_ns = min(later, default=events.end_ns)
        braked_ns = rests_ns[rests_ns >= heal.begin_ns].min(initial=end_ns)
        rows = np.flatnonzero((table.recorded_ns > braked_ns) & (table.recorded_ns < end_ns))
        if not heal.value or len(rows) < 2 or _plan_in_force(events, heal.begin_ns) != 0:
            continue
        tested += 1
        speed = _measured_speed(table, rows)
        if speed > HEALED_SPEED:
            when = events.seconds(heal.begin_ns)
            broken.append(f"after healing {heal.value} at {when:.2f} s: {speed:.2g} rad/s")
    return Kept(tested, tuple(broken))


def _measured_speed(table: JointTable, rows: IntArray) -> float:
    """Largest mean speed of a joint over WINDOW_NS [rad/s]."""
    time_ns, q = table.time_ns[rows], table.position[rows]
    later = np.searchsorted(time_ns, time_ns + WINDOW_NS)
    first = np.flatnonzero(later < len(rows))
    if len(first) == 0:
        return 0.0
    span = (time_ns[later[first]] - time_ns[first]) / SECOND_NS
    return float((np.abs(q[later[first]] - q[first]).max(axis=1) / span).max())


def _braking_ns(events: Events) -> int:
    """Time that the arm has to come to rest [ns]."""
    return SLEWING_BRAKING_NS if events.machine.slews else BRAKING_NS


def _neighbours(table: JointTable) -> BoolArray:
    """Whether each reference but the last is followed by the very next one."""
    apart = np.diff(table.time_ns)
    return (apart > 0) & (apart < SAMPLED_NS)


def _in_force(events: Events) -> Iterator[tuple[int, int, int]]:
    """Each plan in force with the times between which it was [ns], of one simulation."""
    told = events.recording.plans_in_force
    ends = events.deeds_of(DeedKind.START, DeedKind.END, DeedKind.RESET)
    anew = [deed for deed in ends if deed.node == SIM]
    for each, after in zip(told, (*told[1:], None), strict=True):
        end_ns = events.end_ns if after is None else after.recorded_ns
        if not overlapping(anew, each.recorded_ns, end_ns, before=0.1, after=0.5):
            yield each.value, each.recorded_ns, end_ns


def _plan_in_force(events: Events, time_ns: int) -> int:
    """Stamp of the plan in force at a time [ns], 0 where the arm holds."""
    told = events.recording.plans_in_force
    return next((each.value for each in reversed(told) if each.recorded_ns <= time_ns), 0)


def _zones(events: Events) -> Iterator[tuple[Zones, int, int]]:
    """Zones with the times between which they held [ns]."""
    changes = [
        (deed.end_ns, deed.begin_ns, deed.value)
        for deed in events.deeds_of(DeedKind.ZONES)
        if deed.done
    ]
    own = events.machine.zones  # of the file, with which a planner starts
    changes += [(life.ready_ns, life.ready_ns, own) for life in events.lives_of(PLANNER)]
    changes.sort(key=lambda change: change[0])
    ends = [change[1] for change in changes[1:]] + [events.end_ns]
    for (begin_ns, _, zones), end_ns in zip(changes, ends, strict=True):
        if zones != Zones():
            yield zones, begin_ns, end_ns


def _broken_rows(
    events: Events, table: JointTable, wrong: BoolArray, amount: FloatArray, what: str
) -> Kept:
    """One sentence for the worst of the rows that break a promise."""
    if not np.any(wrong):
        return Kept(len(table.time_ns), ())
    worst = int(np.argmax(amount))
    when = events.seconds(int(table.recorded_ns[worst]))
    count = int(np.count_nonzero(wrong))
    return Kept(len(table.time_ns), (f"{count} times, {amount[worst]:.4g} {what} at {when:.2f} s",))
