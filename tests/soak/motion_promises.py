"""Promises about motion: continuous, within limits, out of zones, and at rest when required."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from tests.soak.events import PLANNER, SIM, ActionKind, Events, overlaps_any
from tests.soak.kept import PromiseResult

from mhsb_model.arm_reports import HandOverOutcome
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.motion.s3_trajectory import FitRules
from mhsb_sim.simulation.supervision import Phase
from mhsb_tools.recording.recording import JointTable

BoolArray = NDArray[np.bool_]

LARGEST_JUMP = 1e-6
"""Largest jump of the reference at a hand-over [rad] and [rad/s]."""
SAME_CURVE = 1e-9
"""Largest difference of reference and plan, which are evaluated by one formula [rad]."""

SAMPLED_NS = 15_000_000
"""References farther apart than this are not compared, since others between them were missed
[ns].
"""

UNEVEN_AT_REST = 1e-6
"""Largest result of `gaps` for two references without acceleration [rad]."""

UNEVEN_IN_MOTION = 8.1e-6
"""Largest result of `gaps` for a motion of the suite, whose jerk jumps by at most 1000 rad/s³
[rad].

If the jerk jumps by Δj a time r h before the second of two references, h = 10 ms apart, the result
is h³ Δj r (1 − r)(1 − 2r)/12. The largest magnitude is h³ Δj √3/216.
"""

UNEVEN_SLOWED = 2e-5
"""Largest result of `gaps` for a motion that the guard slows down [rad]. It changes the factor on
the speed by up to 8 per second, and joints move at up to 0.3 rad/s.
"""

JOINT_TOLERANCE = 1e-6
"""Tolerance of joint limits [rad] and of clearances [m]."""
SPEED_EXCESS = 0.005
"""Share by which a motion that follows its path may exceed V_max and the pump's flow, by
rounding.
"""

BRAKING_NS, SLEWING_BRAKING_NS = 2 * SECOND_NS, 3 * SECOND_NS
"""Time after a stop in which an arm, and one that slews, comes to rest [ns]; an excavator that
slewed took 2.5 s.
"""

HEALED_SPEED = 0.05
"""Largest joint speed after healing, without a new goal [rad/s]."""

WINDOW_NS = SECOND_NS // 10
"""Time over which a measured speed is averaged [ns]."""


def check_hand_over_jumps(events: Events) -> PromiseResult:
    """Check that the reference does not jump at any hand-over, as the arm measured it.

    Args:
        events: Everything recorded in the soak.

    Returns:
        The result; each applied plan is one case.
    """
    applied = [
        e.value for e in events.recording.hand_overs if e.value.outcome == HandOverOutcome.APPLIED
    ]
    broken = tuple(
        f"plan {events.seconds(each.plan_stamp_ns):.3f} s: {each.position_jump:.2g} rad, "
        f"{each.velocity_jump:.2g} rad/s"
        for each in applied
        if not max(each.position_jump, each.velocity_jump) <= LARGEST_JUMP
    )
    return PromiseResult(len(applied), broken)


def check_continuous_reference(events: Events) -> PromiseResult:
    """Check that the reference does not jump from one sample to the next.

    Jumps are allowed where the simulation starts anew or supervision sets the reference. Where the
    jerk jumps, or a plan is slowed, successive references fit together less well.

    Args:
        events: Everything recorded in the soak.

    Returns:
        The result; each pair of successive references is one case.
    """
    table = events.recording.references
    rows = np.flatnonzero(_has_direct_successor(table))
    slowed = slowed_at(events, table.recorded_ns)
    apart = gaps(table, rows)
    moves = np.any(table.acceleration != 0.0, axis=1)
    anew = events.actions_of(ActionKind.RESET, ActionKind.START, ActionKind.END, ActionKind.HEAL)
    told_ns = [each.recorded_ns for each in events.recording.simulator_reports if each.value.faulty]
    broken = []
    for row, gap in zip(rows, apart, strict=True):
        time_ns = int(table.recorded_ns[row])
        uneven = UNEVEN_IN_MOTION if moves[row] or moves[row + 1] else UNEVEN_AT_REST
        uneven = UNEVEN_SLOWED if slowed[row] else uneven
        if gap <= uneven or overlaps_any(anew, time_ns, time_ns, before=0.5, after=0.5):
            continue
        told = any(abs(time_ns - each) < SECOND_NS for each in told_ns)
        if told or _on_one_plan(events, int(row)):
            continue
        broken.append(f"at {events.seconds(time_ns):.3f} s it jumps by {gap:.2g} rad")
    return PromiseResult(len(rows), tuple(broken))


def _on_one_plan(events: Events, row: int) -> bool:
    """Return whether a reference and the next one lie on one published plan, which has no jumps.

    Args:
        events: Everything recorded in the soak.
        row: Row of the first reference.

    Returns:
        True if both positions equal one plan's within `SAME_CURVE`.
    """
    table, pair = events.recording.references, slice(row, row + 2)
    time_ns = table.time_ns[pair]
    return any(
        np.abs(plan.sample_many(time_ns)[0] - table.position[pair]).max() <= SAME_CURVE
        for plan in events.recording.trajectories
        if plan.stamp_ns <= time_ns[0]
    )


def gaps(table: JointTable, rows: IntArray) -> FloatArray:
    """Compute how far each next reference is from where the present one leads.

        q₁ − q₀ − h/2 (q̇₀ + q̇₁) + h²/12 (q̈₁ − q̈₀)

    This is zero for every curve up to the fourth degree.

    Args:
        table: References.
        rows: Rows of the first reference of each pair.

    Returns:
        Largest gap of any joint [rad], one for each of the rows.
    """
    h = ((table.time_ns[rows + 1] - table.time_ns[rows]) / SECOND_NS)[:, None]
    q, qd, qdd = table.position, table.velocity, table.acceleration
    moved = 0.5 * h * (qd[rows] + qd[rows + 1]) - h**2 / 12 * (qdd[rows + 1] - qdd[rows])
    return np.abs(q[rows + 1] - q[rows] - moved).max(axis=1, initial=0.0)


def check_reference_is_plan(events: Events) -> PromiseResult:
    """Check that the reference is the plan in force, in the plan's own time.

    Times at which the arm reports that it follows a plan later are left out, since the delay is
    known too rarely.

    Args:
        events: Everything recorded in the soak.

    Returns:
        The result; each reference with a plan in force is one case.
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
    return PromiseResult(tested, tuple(broken))


def slowed_at(events: Events, time_ns: IntArray) -> BoolArray:
    """Return which times are within a second of a report that plans are followed later.

    Args:
        events: Everything recorded in the soak.
        time_ns: System times [ns], shape (k,).

    Returns:
        Flags, shape (k,).
    """
    slowed = np.zeros(len(time_ns), dtype=bool)
    for each in events.recording.simulator_reports:
        if each.value.plan_delay > 0.0:
            slowed |= np.abs(time_ns - each.recorded_ns) < SECOND_NS
    return slowed


def check_joint_limits(events: Events) -> PromiseResult:
    """Check that the reference keeps the joint limits.

    Args:
        events: Everything recorded in the soak.

    Returns:
        The result; each reference is one case.
    """
    table, limits = events.recording.references, events.machine.arrays
    q = table.position
    beyond = np.maximum(limits.joint_min - q, q - limits.joint_max).max(axis=1, initial=-np.inf)
    return _broken_rows(events, table, beyond > JOINT_TOLERANCE, beyond, "rad beyond a limit")


def check_speed_limits(events: Events) -> PromiseResult:
    """Check that the reference keeps V_max of each piston and the main pump's flow.

    The table planner's polynomials may exceed V_max, as the paper's do.

    Args:
        events: Everything recorded in the soak.

    Returns:
        The result; each reference is one case.
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
    """Return the share by which V_max may be exceeded at each time.

    It is above 0 from when a planner is set to `table` until its process ends.

    Args:
        events: Everything recorded in the soak.
        time_ns: System times [ns], shape (k,).

    Returns:
        Shares, shape (k,).
    """
    allowed = np.zeros(len(time_ns))
    for told in events.actions_of(ActionKind.PARAMETER):
        if told.value == "table":
            ends = (life.end_ns for life in events.lives_of(PLANNER))
            end_ns = min((end for end in ends if end > told.begin_ns), default=events.end_ns)
            allowed[(time_ns > told.begin_ns) & (time_ns < end_ns)] = FitRules().max_excess
    return allowed


def check_zones(events: Events) -> PromiseResult:
    """Check that the arm does not enter zones once it had time to stop.

    A reset, or a new simulator process, may put the arm into a zone. It then must leave the zone
    before it counts as entering.

    Args:
        events: Everything recorded in the soak.

    Returns:
        The result; each reference while zones were in force is one case.
    """
    table = events.recording.references
    at_ns = table.recorded_ns
    anew = events.actions_of(ActionKind.RESET, ActionKind.START)
    moved_by_hand = np.zeros(len(at_ns), dtype=bool)
    for deed in anew:
        moved_by_hand |= (at_ns >= deed.begin_ns) & (at_ns <= deed.end_ns)
    stretch = np.searchsorted(np.sort([deed.end_ns for deed in anew]), at_ns)
    broken, tested = [], 0
    for zones, begin_ns, end_ns in _zones(events):
        arm = events.machine.changed(zones=zones)
        held = (at_ns > begin_ns + _braking_ns(events)) & (at_ns < end_ns) & ~moved_by_hand
        for number in np.unique(stretch[held]):
            rows = np.flatnonzero(held & (stretch == number))
            clearance = np.array([arm.clearance(q)[0] for q in table.position[rows]])
            tested += len(rows)
            outside = np.logical_or.accumulate(clearance > 0.0)
            entered = np.flatnonzero(outside & (clearance < -JOINT_TOLERANCE))
            if len(entered):
                when = events.seconds(int(at_ns[rows[entered[0]]]))
                broken.append(f"at {when:.2f} s it is {-clearance[entered].min():.2g} m in a zone")
    return PromiseResult(tested, tuple(broken))


def check_rest_after_stops(events: Events) -> PromiseResult:
    """Check that nothing moves from a stop until the next goal, after the time to brake.

    Args:
        events: Everything recorded in the soak.

    Returns:
        The result; each stop with references after it is one case.
    """
    table = events.recording.references
    next_deeds = events.actions_of(
        ActionKind.GOAL, ActionKind.RESET, ActionKind.START, ActionKind.HEAL
    )
    broken, tested = [], 0
    for stop in events.actions_of(ActionKind.STOP):
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
    return PromiseResult(tested, tuple(broken))


def check_healing(events: Events) -> PromiseResult:
    """Check that no joint moves fast after a fault is healed, until the next goal.

    No joint may exceed 0.05 rad/s once the reference rests for good. A stop that a dead pump has
    held up goes on after healing, so the reference may rest and move again. If a fault has closed
    the valves in motion, the arm swings on its oil, and is judged once it has come to rest. Healing
    while a plan is in force is left out.

    Args:
        events: Everything recorded in the soak.

    Returns:
        The result; each healing of a fault is one case.
    """
    table, reference = events.recording.joint_states, events.recording.references
    moves_ns = reference.recorded_ns[reference.velocity.any(axis=1)]
    others = events.actions_of(ActionKind.GOAL, ActionKind.RESET, ActionKind.END, ActionKind.FAULT)
    broken, tested = [], 0
    for heal in events.actions_of(ActionKind.HEAL):
        later = (deed.begin_ns for deed in others if deed.begin_ns > heal.begin_ns)
        end_ns = min(later, default=events.end_ns)
        braked_ns = moves_ns[moves_ns < end_ns].max(initial=heal.begin_ns)
        begin_ns = max(braked_ns, _swings_until(events, heal.begin_ns))
        rows = np.flatnonzero((table.recorded_ns > begin_ns) & (table.recorded_ns < end_ns))
        if not heal.value or len(rows) < 2 or _plan_in_force(events, heal.begin_ns) != 0:
            continue
        tested += 1
        speed = _measured_speed(table, rows)
        if speed > HEALED_SPEED:
            when = events.seconds(heal.begin_ns)
            broken.append(f"after healing {heal.value} at {when:.2f} s: {speed:.2g} rad/s")
    return PromiseResult(tested, tuple(broken))


def _swings_until(events: Events, time_ns: int) -> int:
    """Return when an arm has come to rest whose valves a fault had closed at a system time [ns].

    Until then the servo does not act. The result is 0 if the valves were not closed, and the end of
    the recording if the arm does not come to rest.
    """
    reports = events.recording.simulator_reports
    closed = [Phase.CLOSED.value in each.value.sentence for each in reports]
    began = [k for k, each in enumerate(reports) if each.recorded_ns <= time_ns]
    if not began or not closed[began[-1]]:
        return 0
    later = zip(reports[began[-1] :], closed[began[-1] :], strict=True)
    return next((each.recorded_ns for each, is_closed in later if not is_closed), events.end_ns)


def _measured_speed(table: JointTable, rows: IntArray) -> float:
    """Return the largest mean speed of any joint over `WINDOW_NS`.

    Args:
        table: Measured joint states.
        rows: Rows to examine.

    Returns:
        Speed [rad/s]; 0 if the rows span less than the window.
    """
    time_ns, q = table.time_ns[rows], table.position[rows]
    later = np.searchsorted(time_ns, time_ns + WINDOW_NS)
    first = np.flatnonzero(later < len(rows))
    if len(first) == 0:
        return 0.0
    span = (time_ns[later[first]] - time_ns[first]) / SECOND_NS
    return float((np.abs(q[later[first]] - q[first]).max(axis=1) / span).max())


def _braking_ns(events: Events) -> int:
    """Return the time in which the arm comes to rest after a stop [ns]."""
    return SLEWING_BRAKING_NS if events.machine.slews else BRAKING_NS


def _has_direct_successor(table: JointTable) -> BoolArray:
    """Return whether each reference is directly followed by the next one.

    Args:
        table: References, k rows.

    Returns:
        Flags, shape (k - 1,); False if references in between were missed.
    """
    apart = np.diff(table.time_ns)
    return (apart > 0) & (apart < SAMPLED_NS)


def _in_force(events: Events) -> Iterator[tuple[int, int, int]]:
    """Yield each plan in force with its span of time.

    Spans with a start, an end or a reset of the simulator are left out.

    Args:
        events: Everything recorded in the soak.

    Yields:
        Stamp of the plan (0 if the arm holds), begin and end in system time [ns].
    """
    told = events.recording.plans_in_force
    ends = events.actions_of(ActionKind.START, ActionKind.END, ActionKind.RESET)
    anew = [deed for deed in ends if deed.node == SIM]
    for each, after in zip(told, (*told[1:], None), strict=True):
        end_ns = events.end_ns if after is None else after.recorded_ns
        if not overlaps_any(anew, each.recorded_ns, end_ns, before=0.1, after=0.5):
            yield each.value, each.recorded_ns, end_ns


def _plan_in_force(events: Events, time_ns: int) -> int:
    """Return the stamp of the plan in force at a system time [ns]; 0 if the arm holds."""
    told = events.recording.plans_in_force
    return next((each.value for each in reversed(told) if each.recorded_ns <= time_ns), 0)


def _zones(events: Events) -> Iterator[tuple[Zones, int, int]]:
    """Yield zones with the span of time in which they were in force.

    Args:
        events: Everything recorded in the soak.

    Yields:
        Zones, begin and end in system time [ns]; spans without zones are left out.
    """
    changes = [
        (deed.end_ns, deed.begin_ns, deed.value)
        for deed in events.actions_of(ActionKind.ZONES)
        if deed.done
    ]
    own = events.machine.zones  # a planner starts with the zones of its file
    changes += [(life.ready_ns, life.ready_ns, own) for life in events.lives_of(PLANNER)]
    changes.sort(key=lambda change: change[0])
    ends = [change[1] for change in changes[1:]] + [events.end_ns]
    for (begin_ns, _, zones), end_ns in zip(changes, ends, strict=True):
        if zones != Zones():
            yield zones, begin_ns, end_ns


def _broken_rows(
    events: Events, table: JointTable, wrong: BoolArray, amount: FloatArray, what: str
) -> PromiseResult:
    """Return the result of a check with one sentence for the worst row.

    Args:
        events: Everything recorded in the soak.
        table: References; each row is one case.
        wrong: Whether each row breaks the promise.
        amount: Measure of each row, the largest being the worst.
        what: Unit and meaning of the measure, for the sentence.

    Returns:
        The result.
    """
    if not np.any(wrong):
        return PromiseResult(len(table.time_ns), ())
    worst = int(np.argmax(amount))
    when = events.seconds(int(table.recorded_ns[worst]))
    count = int(np.count_nonzero(wrong))
    return PromiseResult(
        len(table.time_ns), (f"{count} times, {amount[worst]:.4g} {what} at {when:.2f} s",)
    )
