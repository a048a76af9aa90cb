from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mhsb_model.arm_reports import HandOverOutcome, HandOverReason, HandOverReport
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, standstill
from mhsb_sim.simulation.plan_receiver import NEVER_NS, REPORTED_STAMP_CAPACITY, PlanReceiver

POSTURE = np.array([0.3, -1.4, -1.5])
NOW = 10 * SECOND_NS
MS = SECOND_NS // 1000


@dataclass
class Target:
    """A simulator's side of the hand-over: it follows a trajectory, at first that of standing."""

    plan_time_ns: int = NOW
    followed: Trajectory = field(default_factory=lambda: standstill(POSTURE, 0))
    forgotten_before_ns: int = 0
    plans: list[tuple[Trajectory, ModeSchedule]] = field(default_factory=list)

    @property
    def planned(self) -> MotionState:
        return self.followed.sample(self.plan_time_ns)

    def reference_at(self, time_ns: int) -> MotionState | None:
        return self.followed.sample(time_ns) if time_ns >= self.forgotten_before_ns else None

    def set_plan(self, trajectory: Trajectory, schedule: ModeSchedule) -> None:
        self.plans.append((trajectory, schedule))
        self.followed = trajectory


@pytest.fixture
def target() -> Target:
    return Target()


@pytest.fixture
def receiver(machine: Machine, target: Target) -> PlanReceiver:
    target.plan_time_ns = 1
    receiver = PlanReceiver(machine, target)
    target.plan_time_ns = NOW
    return receiver


def trajectory(
    stamp_ns: int = NOW,
    start: float = 0.0,
    joints: int = 3,
    end_velocity: float = 0.0,
    move: float = 0.1,
    wait_ns: int = 0,
) -> Trajectory:
    """From the posture, or beside it by `start`, joint_1 turns by `move`, after `wait_ns`."""
    posture = POSTURE[:1].repeat(joints) if joints != 3 else POSTURE
    offset = [0, wait_ns, wait_ns + SECOND_NS] if wait_ns else [0, SECOND_NS]
    position = np.tile(posture, (len(offset), 1))
    position[:-1] += start
    position[-1, 0] += move
    zero = np.zeros_like(position)
    velocity = zero.copy()
    velocity[-1] = end_velocity
    return Trajectory(stamp_ns, np.array(offset), position, velocity, zero)


def schedule(stamp_ns: int = NOW, modes: tuple[int, ...] = (0, 0, 0)) -> ModeSchedule:
    return ModeSchedule(stamp_ns, np.array([0]), np.array([modes], np.uint8))


def deliver(
    receiver: PlanReceiver, first: Trajectory, second: ModeSchedule, wall: float = 0.0
) -> list[HandOverReport]:
    reports = receiver.add_trajectory(first, wall) + receiver.add_schedule(second, wall)
    return reports + receiver.update(wall)


def test_a_pair_that_continues_the_reference_is_applied(
    receiver: PlanReceiver, target: Target
) -> None:
    (report,) = deliver(receiver, trajectory(), schedule())
    assert report == HandOverReport(
        HandOverOutcome.APPLIED,
        "plan 10.000 s was applied: it continues the reference within 0 rad and 0 rad/s",
        NOW,
        0.0,
        0.0,
        HandOverReason.NONE,
    )
    assert len(target.plans) == 1
    assert receiver.update(100.0) == []


def test_the_order_of_the_halves_does_not_matter(receiver: PlanReceiver) -> None:
    assert receiver.add_schedule(schedule(), 0.0) == []
    assert receiver.update(0.1) == []
    assert receiver.add_trajectory(trajectory(), 0.2) == []
    assert [report.outcome for report in receiver.update(0.2)] == ["applied"]


def test_a_plan_whose_common_curve_is_over_came_too_late(
    receiver: PlanReceiver, target: Target
) -> None:
    target.plan_time_ns = NOW + 120 * MS
    (report,) = deliver(receiver, trajectory(wait_ns=100 * MS), schedule())
    assert report.reason is HandOverReason.LATE
    assert report.outcome is HandOverOutcome.REFUSED
    assert report.sentence.startswith(
        "plan 10.000 s was refused: it came too late, 0.120 s after its stamp: the reference has "
        "left the curve that both share and is "
    )
    assert "at most 1e-06 is allowed; plan further ahead" in report.sentence
    assert 1e-6 < report.position_jump < 1e-4
    assert target.plans == []


def test_the_same_plan_in_time_is_applied(receiver: PlanReceiver, target: Target) -> None:
    target.plan_time_ns = NOW + 99 * MS
    (report,) = deliver(receiver, trajectory(wait_ns=100 * MS), schedule())
    assert report.outcome is HandOverOutcome.APPLIED


@pytest.mark.parametrize("start", [1e-5, -0.1])
def test_a_plan_that_never_was_on_the_reference_jumps_however_late_it_is(
    receiver: PlanReceiver, target: Target, start: float
) -> None:
    target.plan_time_ns = NOW + 9 * MS
    (report,) = deliver(receiver, trajectory(start=start, move=0.0), schedule())
    assert report.reason is HandOverReason.JUMP
    assert report.sentence == (
        "plan 10.000 s was refused: it does not continue the reference: at its stamp it is "
        f"{abs(start):g} rad and 0 rad/s away from it, at most 1e-06 is allowed; plan from "
        "`reference`"
    )
    assert report.position_jump == pytest.approx(abs(start), rel=0.01)
    assert target.plans == []


def test_a_jump_in_velocity_alone_is_refused(receiver: PlanReceiver, target: Target) -> None:
    zero = np.zeros((2, 3))
    moving = np.tile([0.0, 1e-3, 0.0], (2, 1))
    path = POSTURE + np.array([[0.0], [100.0]]) * moving
    target.followed = Trajectory(NOW, np.array([0, 100 * SECOND_NS]), path, moving, zero)
    (report,) = deliver(receiver, trajectory(), schedule())
    assert report.reason is HandOverReason.JUMP
    assert report.velocity_jump == pytest.approx(1e-3)


def test_a_plan_older_than_what_is_remembered_came_too_late(
    receiver: PlanReceiver, target: Target
) -> None:
    target.forgotten_before_ns = NOW + 1
    target.plan_time_ns = NOW + 3 * SECOND_NS
    (report,) = deliver(receiver, trajectory(), schedule())
    assert report.reason is HandOverReason.LATE


def test_a_message_is_awaited_while_only_one_of_a_plan_has_come(receiver: PlanReceiver) -> None:
    assert not receiver.awaits_message
    receiver.add_schedule(schedule(), 0.0)
    assert receiver.awaits_message
    receiver.add_trajectory(trajectory(), 0.0)
    assert not receiver.awaits_message
    receiver.update(0.0)
    receiver.add_trajectory(trajectory(NOW + 1), 0.0)
    receiver.update(0.6)
    assert not receiver.awaits_message


def test_half_a_pair_is_dropped_after_half_a_second(receiver: PlanReceiver) -> None:
    receiver.add_trajectory(trajectory(), 5.0)
    assert receiver.update(5.5) == []
    (report,) = receiver.update(5.51)
    assert report.outcome is HandOverOutcome.DROPPED
    assert report.reason is HandOverReason.INCOMPLETE
    assert report.sentence == (
        "plan 10.000 s was dropped: its mode schedule did not come within 0.5 s"
    )
    receiver.add_schedule(schedule(NOW + 1), 6.0)
    (report,) = receiver.update(7.0)
    assert "its trajectory did not come within 0.5 s" in report.sentence


def test_the_half_that_comes_after_its_plan_was_told_is_passed_over(
    receiver: PlanReceiver,
) -> None:
    receiver.add_trajectory(trajectory(), 5.0)
    assert len(receiver.update(6.0)) == 1
    assert receiver.add_schedule(schedule(), 6.1) == []
    assert receiver.update(9.0) == []
    assert receiver.add_trajectory(trajectory(NOW + 1, move=9.0), 9.0)[0].reason == "invalid"
    assert receiver.add_schedule(schedule(NOW + 1), 9.0) == []
    assert receiver.update(19.0) == []


def test_halves_that_come_twice_are_passed_over(receiver: PlanReceiver, target: Target) -> None:
    assert receiver.add_trajectory(trajectory(), 0.0) == []
    assert receiver.add_trajectory(trajectory(move=0.2), 0.0) == []
    assert receiver.add_schedule(schedule(), 0.0) == []
    assert len(receiver.update(0.0)) == 1
    assert target.plans[0][0].position[-1, 0] == pytest.approx(POSTURE[0] + 0.1)
    assert deliver(receiver, trajectory(), schedule()) == []


def test_half_a_pair_is_dropped_when_a_newer_one_comes(
    receiver: PlanReceiver, target: Target
) -> None:
    receiver.add_trajectory(trajectory(), 0.0)
    (report,) = receiver.add_schedule(schedule(NOW + 1000), 0.1)
    assert report.outcome is HandOverOutcome.DROPPED
    assert report.reason is HandOverReason.NEWER
    assert report.plan_stamp_ns == NOW
    assert "a newer plan came before it could be applied" in report.sentence
    receiver.add_trajectory(trajectory(NOW + 1000), 0.2)
    target.plan_time_ns = NOW + 1000
    assert [report.outcome for report in receiver.update(0.2)] == ["applied"]


def test_a_plan_waits_for_its_stamp_and_says_when_it_is_due(
    receiver: PlanReceiver, target: Target
) -> None:
    target.plan_time_ns = NOW - 100 * MS
    assert receiver.due_ns == NEVER_NS
    assert deliver(receiver, trajectory(), schedule()) == []
    assert receiver.due_ns == NOW
    assert receiver.update(99.0) == []
    target.plan_time_ns = NOW
    assert [report.outcome for report in receiver.update(0.1)] == ["applied"]
    assert receiver.due_ns == NEVER_NS


def test_a_plan_far_ahead_of_the_clock_is_refused_and_disturbs_none(
    receiver: PlanReceiver, target: Target
) -> None:
    target.plan_time_ns = NOW - 400 * MS
    assert deliver(receiver, trajectory(), schedule()) == []
    far = NOW + 200 * MS
    reports = deliver(receiver, trajectory(far), schedule(far))
    assert [report.sentence for report in reports] == [
        "plan 10.200 s was refused: it is stamped 0.600 s ahead of the arm's time, at most 0.5 s "
        "is allowed; go by the stamps of `reference`"
    ]
    assert reports[0].reason is HandOverReason.STAMP
    target.plan_time_ns = NOW
    assert [report.outcome for report in receiver.update(0.1)] == ["applied"]


def test_stamps_must_increase(receiver: PlanReceiver) -> None:
    deliver(receiver, trajectory(), schedule())
    (report,) = deliver(receiver, trajectory(NOW - 1), schedule(NOW - 1))
    assert report.reason is HandOverReason.STAMP
    assert report.sentence == (
        "plan 10.000 s was refused: its stamp is not newer than that of the plan before; stamps "
        "must increase"
    )
    assert math.isnan(report.position_jump)


def test_an_older_half_does_not_disturb_a_waiting_one(receiver: PlanReceiver) -> None:
    receiver.add_trajectory(trajectory(), 0.0)
    (report,) = receiver.add_schedule(schedule(NOW - 5), 0.0)
    assert report.outcome is HandOverOutcome.REFUSED
    receiver.add_schedule(schedule(), 0.0)
    assert [report.outcome for report in receiver.update(0.0)] == ["applied"]


def test_after_a_stop_no_plan_made_before_it_is_applied(
    receiver: PlanReceiver, target: Target
) -> None:
    target.plan_time_ns = NOW - 100 * MS
    assert deliver(receiver, trajectory(), schedule()) == []
    target.plan_time_ns = NOW + 200 * MS
    (report,) = receiver.invalidate_plans("the arm was stopped")
    assert report.reason is HandOverReason.STOPPED
    assert report.sentence == (
        "plan 10.000 s was dropped: the arm was stopped before it could be applied"
    )
    assert receiver.update(0.0) == []
    for stamp in (NOW + 100 * MS, NOW + 200 * MS):
        (report,) = deliver(receiver, trajectory(stamp), schedule(stamp))
        assert report.reason is HandOverReason.STOPPED
        assert "made before the arm was started, stopped or reset" in report.sentence
    later = NOW + 200 * MS + 1
    target.plan_time_ns = later
    (report,) = deliver(receiver, trajectory(later), schedule(later))
    assert report.outcome is HandOverOutcome.APPLIED


def test_a_closed_receiver_refuses_what_waits_and_what_comes_until_it_is_opened(
    receiver: PlanReceiver, target: Target
) -> None:
    receiver.add_trajectory(trajectory(), 0.0)
    (report,) = receiver.close("joint_1 is 0.1 rad off")
    assert report.reason is HandOverReason.FAULT
    assert report.sentence == "plan 10.000 s was dropped: joint_1 is 0.1 rad off"
    (report,) = deliver(receiver, trajectory(NOW + 1), schedule(NOW + 1))
    assert report.reason is HandOverReason.FAULT
    assert report.sentence == "plan 10.000 s was refused: joint_1 is 0.1 rad off"
    target.plan_time_ns = NOW + 10
    receiver.open()
    (report,) = deliver(receiver, trajectory(NOW + 9), schedule(NOW + 9))
    assert report.reason is HandOverReason.RESET
    target.plan_time_ns = NOW + 11
    (report,) = deliver(receiver, trajectory(NOW + 11), schedule(NOW + 11))
    assert report.outcome is HandOverOutcome.APPLIED


def test_after_a_reset_older_stamps_are_welcome(receiver: PlanReceiver, target: Target) -> None:
    deliver(receiver, trajectory(), schedule())
    target.plan_time_ns, target.followed = 5, standstill(POSTURE, 0)
    receiver.reset()
    (report,) = deliver(receiver, trajectory(5), schedule(5))
    assert report.outcome is HandOverOutcome.APPLIED


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (trajectory(joints=2), "its trajectory has 2 joints, the machine has 3"),
        (trajectory(end_velocity=0.1), "its trajectory does not end at rest"),
    ],
)
def test_a_trajectory_that_cannot_be_followed_is_refused(
    receiver: PlanReceiver, bad: Trajectory, reason: str
) -> None:
    (report,) = receiver.add_trajectory(bad, 0.0)
    assert report.reason is HandOverReason.INVALID
    assert report.sentence == f"plan 10.000 s was refused: {reason}"


def test_a_trajectory_beyond_the_joint_limits_is_refused(
    receiver: PlanReceiver, machine: Machine
) -> None:
    lower, upper = machine.arrays.joint_min[0], machine.arrays.joint_max[0]
    (report,) = receiver.add_trajectory(trajectory(move=upper + 0.78 - POSTURE[0]), 0.0)
    assert report.reason is HandOverReason.INVALID
    assert report.sentence == (
        "plan 10.000 s was refused: its trajectory takes joint_1 0.78 rad beyond its limits "
        f"[{lower:g}, {upper:g}] rad, 1.000 s after its first point"
    )


def test_a_trajectory_with_a_jump_between_two_points_is_refused(
    receiver: PlanReceiver, machine: Machine
) -> None:
    rows = np.array([POSTURE, POSTURE + [0.0, 0.4, 0.0]])
    jump = Trajectory(NOW, [0, 10 * MS], rows, 0 * rows, 0 * rows)
    (report,) = receiver.add_trajectory(jump, 0.0)
    assert report.reason is HandOverReason.INVALID
    fastest = machine.max_joint_speeds[1]
    assert report.sentence == (
        "plan 10.000 s was refused: its trajectory moves joint_2 at 75 rad/s, 0.005 s after its "
        f"first point; the main pump cannot move it faster than {fastest:.3g} rad/s"
    )


@pytest.mark.parametrize(
    ("modes", "reason"),
    [
        ((0, 0), "its mode schedule has 2 actuators, the machine has 3"),
        ((2, 2, 1), "its mode pattern SB-SB-DB needs 5 booster modules, 4 are fitted"),
    ],
)
def test_a_mode_schedule_that_cannot_be_obeyed_is_refused_with_its_trajectory(
    receiver: PlanReceiver, modes: tuple[int, ...], reason: str
) -> None:
    assert receiver.add_trajectory(trajectory(), 0.0) == []
    (report,) = receiver.add_schedule(schedule(modes=modes), 0.0)
    assert report.reason is HandOverReason.INVALID
    assert report.sentence == f"plan 10.000 s was refused: {reason}"
    assert receiver.update(10.0) == []


def test_what_cannot_be_read_ends_its_plan_and_no_other(receiver: PlanReceiver) -> None:
    assert receiver.add_trajectory(trajectory(), 0.0) == []
    (report,) = receiver.add_unusable(NOW + 1, "no points", 0.0)
    assert report.reason is HandOverReason.INVALID
    assert report.plan_stamp_ns == NOW + 1
    (report,) = receiver.add_unusable(NOW, "no points", 0.0)
    assert report.sentence == "plan 10.000 s was refused: no points"
    assert receiver.add_schedule(schedule(), 0.0) == []
    assert receiver.update(10.0) == []


def test_a_limit_is_not_passed_by_rounding(receiver: PlanReceiver, machine: Machine) -> None:
    edge = float(machine.arrays.joint_max[0] - POSTURE[0])
    path = trajectory(move=edge + 1e-9)
    slow = Trajectory(NOW, 3 * path.offset_ns, path.position, path.velocity, path.acceleration)
    assert receiver.add_trajectory(slow, 0.0) == []


EVENTS = st.one_of(
    st.tuples(st.sampled_from(["trajectory", "schedule", "garbage"]), st.integers(0, 9)),
    st.tuples(st.just("time"), st.integers(1, 60)),
    st.tuples(st.sampled_from(["stop", "close", "open"]), st.just(0)),
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(events=st.lists(EVENTS, max_size=40))
def test_of_every_plan_one_report_is_made_in_whatever_order_things_happen(
    machine: Machine, events: list[tuple[str, int]]
) -> None:
    """Plans 20 ms apart, halves lost, doubled, reordered, stops and faults in between."""
    target = Target(plan_time_ns=NOW)
    receiver = PlanReceiver(machine, target)
    reports: list[HandOverReport] = []
    came: set[int] = set()
    voided_ns = -1
    for kind, number in events:
        stamp = NOW + 20 * MS * number
        wall = target.plan_time_ns / SECOND_NS
        if kind == "trajectory":
            planned = trajectory(stamp, wait_ns=50 * MS, move=0.01 * number)
            reports += receiver.add_trajectory(planned, wall)
        elif kind == "schedule":
            reports += receiver.add_schedule(schedule(stamp), wall)
        elif kind == "garbage":
            reports += receiver.add_unusable(stamp, "no points", wall)
        elif kind == "time":
            target.plan_time_ns += number * MS
        elif kind == "stop":
            reports += receiver.invalidate_plans("the arm was stopped")
            voided_ns = target.plan_time_ns
        elif kind == "close":
            reports += receiver.close("a fault")
        else:
            receiver.open()
            voided_ns = target.plan_time_ns
        if kind in ("trajectory", "schedule", "garbage"):
            came.add(stamp)
        before = len(target.plans)
        new = receiver.update(wall)
        reports += new
        for plan, _ in target.plans[before:]:
            assert plan.stamp_ns > voided_ns
            assert plan.stamp_ns <= target.plan_time_ns
            assert max(new[-1].position_jump, new[-1].velocity_jump) <= 1e-6
    target.plan_time_ns += 10 * SECOND_NS
    reports += receiver.update(target.plan_time_ns / SECOND_NS)
    assert Counter(report.plan_stamp_ns for report in reports) == Counter(came)
    applied = [r.plan_stamp_ns for r in reports if r.outcome is HandOverOutcome.APPLIED]
    assert applied == [plan.stamp_ns for plan, _ in target.plans] == sorted(applied)
    assert all((r.reason == "") == (r.outcome == "applied") for r in reports)


def test_a_flood_leaves_nothing_behind(receiver: PlanReceiver, target: Target) -> None:
    for k in range(10 * REPORTED_STAMP_CAPACITY):
        target.plan_time_ns += 1
        receiver.add_trajectory(trajectory(NOW + k), 0.0)
    assert len(receiver._reported_stamps) == REPORTED_STAMP_CAPACITY
