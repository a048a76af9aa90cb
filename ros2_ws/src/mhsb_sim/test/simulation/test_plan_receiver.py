from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory
from mhsb_sim.simulation.plan_receiver import Outcome, OutcomeKind, PlanReceiver

POSTURE = np.array([0.3, -1.4, -1.5])
NOW = 10 * SECOND_NS


@dataclass
class Target:
    """A simulator's side of the hand-over, at rest."""

    time_ns: int = NOW
    reference: MotionState = field(default_factory=lambda: MotionState.at_rest(POSTURE))
    plans: list[tuple[Trajectory, ModeSchedule]] = field(default_factory=list)

    def set_plan(self, trajectory: Trajectory, schedule: ModeSchedule) -> None:
        self.plans.append((trajectory, schedule))


@pytest.fixture
def receiver(machine: Machine) -> PlanReceiver:
    return PlanReceiver(machine)


def trajectory(
    stamp_ns: int = NOW,
    start: float = 0.0,
    joints: int = 3,
    end_velocity: float = 0.0,
    move: float = 0.1,
) -> Trajectory:
    position = np.tile(POSTURE[:1].repeat(joints) if joints != 3 else POSTURE, (2, 1))
    position[0] += start
    position[1, 0] += move
    zero = np.zeros_like(position)
    velocity = zero.copy()
    velocity[1] = end_velocity
    return Trajectory(stamp_ns, np.array([0, SECOND_NS]), position, velocity, zero)


def schedule(stamp_ns: int = NOW, modes: tuple[int, ...] = (0, 0, 0)) -> ModeSchedule:
    return ModeSchedule(stamp_ns, np.array([0]), np.array([modes], np.uint8))


def deliver(
    receiver: PlanReceiver, target: Target, first: Trajectory, second: ModeSchedule
) -> list[Outcome]:
    outcomes = receiver.add_trajectory(first, 0.0) + receiver.add_schedule(second, 0.0)
    return outcomes + receiver.update(target, 0.0)


def test_a_pair_that_continues_the_reference_is_applied(receiver: PlanReceiver) -> None:
    target = Target()
    (outcome,) = deliver(receiver, target, trajectory(), schedule())
    assert outcome.kind is OutcomeKind.APPLIED
    assert outcome.sentence == (
        "plan 10.000 s was applied: it continues the reference within 0 rad and 0 rad/s"
    )
    assert (outcome.position_jump, outcome.velocity_jump) == (0.0, 0.0)
    assert len(target.plans) == 1
    assert receiver.update(target, 100.0) == []


def test_the_order_of_the_halves_does_not_matter(receiver: PlanReceiver) -> None:
    target = Target()
    assert receiver.add_schedule(schedule(), 0.0) == []
    assert receiver.update(target, 0.1) == []
    assert receiver.add_trajectory(trajectory(), 0.2) == []
    assert [o.kind for o in receiver.update(target, 0.2)] == ["applied"]


@pytest.mark.parametrize("start", [1e-5, -0.3])
def test_a_jump_is_refused_as_late_with_its_size(receiver: PlanReceiver, start: float) -> None:
    target = Target(time_ns=NOW + 20_000_000)
    first = trajectory(start=start, move=0.0)
    (outcome,) = deliver(receiver, target, first, schedule())
    assert outcome.kind is OutcomeKind.REFUSED
    assert "plan 10.000 s was refused: it came too late, 0.020 s after" in outcome.sentence
    assert "away from the reference, at most 1e-06 is allowed" in outcome.sentence
    assert outcome.position_jump == pytest.approx(abs(start), rel=0.01)
    assert target.plans == []


def test_a_jump_in_velocity_alone_is_refused(receiver: PlanReceiver) -> None:
    moving = MotionState(POSTURE, np.array([0.0, 1e-3, 0.0]), np.zeros(3))
    (outcome,) = deliver(receiver, Target(reference=moving), trajectory(), schedule())
    assert outcome.kind is OutcomeKind.REFUSED
    assert outcome.velocity_jump == pytest.approx(1e-3)


def test_half_a_pair_is_dropped_after_half_a_second(receiver: PlanReceiver) -> None:
    target = Target()
    receiver.add_trajectory(trajectory(), 5.0)
    assert receiver.update(target, 5.5) == []
    (outcome,) = receiver.update(target, 5.51)
    assert outcome.kind is OutcomeKind.DROPPED
    assert outcome.sentence == (
        "plan 10.000 s was dropped: its mode schedule did not come within 0.5 s"
    )
    receiver.add_schedule(schedule(NOW + 1), 6.0)
    (outcome,) = receiver.update(target, 7.0)
    assert "its trajectory did not come within 0.5 s" in outcome.sentence


def test_half_a_pair_is_dropped_when_a_newer_one_comes(receiver: PlanReceiver) -> None:
    target = Target()
    receiver.add_trajectory(trajectory(), 0.0)
    (outcome,) = receiver.add_schedule(schedule(NOW + 1000), 0.1)
    assert outcome.kind is OutcomeKind.DROPPED
    assert outcome.stamp_ns == NOW
    assert "a newer plan came before it could be applied" in outcome.sentence
    receiver.add_trajectory(trajectory(NOW + 1000), 0.2)
    target.time_ns = NOW + 1000
    assert [o.kind for o in receiver.update(target, 0.2)] == ["applied"]


def test_a_plan_waits_for_its_stamp(receiver: PlanReceiver) -> None:
    target = Target(time_ns=NOW - 100_000_000)
    assert deliver(receiver, target, trajectory(), schedule()) == []
    target.time_ns = NOW
    assert [o.kind for o in receiver.update(target, 0.1)] == ["applied"]


def test_a_plan_far_ahead_of_the_clock_is_refused(receiver: PlanReceiver) -> None:
    target = Target(time_ns=NOW - 600_000_000)
    (outcome,) = deliver(receiver, target, trajectory(), schedule())
    assert outcome.sentence == (
        "plan 10.000 s was refused: it is stamped 0.600 s ahead of the clock"
    )


@pytest.mark.parametrize("stamp", [NOW, NOW - 1])
def test_stamps_must_increase(receiver: PlanReceiver, stamp: int) -> None:
    target = Target()
    deliver(receiver, target, trajectory(), schedule())
    (outcome,) = receiver.add_trajectory(trajectory(stamp), 1.0)
    assert outcome.sentence == (
        "plan 10.000 s was refused: its stamp is not newer than that of the plan before"
    )
    assert math.isnan(outcome.position_jump)


def test_an_older_half_does_not_disturb_a_waiting_one(receiver: PlanReceiver) -> None:
    target = Target()
    receiver.add_trajectory(trajectory(), 0.0)
    (outcome,) = receiver.add_schedule(schedule(NOW - 5), 0.0)
    assert outcome.kind is OutcomeKind.REFUSED
    receiver.add_schedule(schedule(), 0.0)
    assert [o.kind for o in receiver.update(target, 0.0)] == ["applied"]


def test_after_a_reset_older_stamps_are_welcome(receiver: PlanReceiver) -> None:
    deliver(receiver, Target(), trajectory(), schedule())
    receiver.clear()
    target = Target(time_ns=5)
    assert [o.kind for o in deliver(receiver, target, trajectory(5), schedule(5))] == ["applied"]


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
    (outcome,) = receiver.add_trajectory(bad, 0.0)
    assert outcome.kind is OutcomeKind.REFUSED
    assert outcome.sentence == f"plan 10.000 s was refused: {reason}"


def test_a_trajectory_beyond_the_joint_limits_is_refused(
    receiver: PlanReceiver, machine: Machine
) -> None:
    lower, upper = machine.arrays.joint_min[0], machine.arrays.joint_max[0]
    (outcome,) = receiver.add_trajectory(trajectory(move=upper + 0.78 - POSTURE[0]), 0.0)
    assert outcome.kind is OutcomeKind.REFUSED
    assert outcome.sentence == (
        "plan 10.000 s was refused: its trajectory takes joint_1 0.78 rad beyond its limits "
        f"[{lower:g}, {upper:g}] rad"
    )


@pytest.mark.parametrize(
    ("modes", "reason"),
    [
        ((0, 0), "its mode schedule has 2 actuators, the machine has 3"),
        ((2, 2, 1), "its mode pattern SB-SB-DB needs 5 booster modules, 4 are fitted"),
    ],
)
def test_a_mode_schedule_that_cannot_be_obeyed_is_refused(
    receiver: PlanReceiver, modes: tuple[int, ...], reason: str
) -> None:
    (outcome,) = receiver.add_schedule(schedule(modes=modes), 0.0)
    assert outcome.sentence == f"plan 10.000 s was refused: {reason}"


def test_a_limit_is_not_passed_by_rounding(receiver: PlanReceiver, machine: Machine) -> None:
    edge = float(machine.arrays.joint_max[0] - POSTURE[0])
    assert receiver.add_trajectory(trajectory(move=edge + 1e-9), 0.0) == []
