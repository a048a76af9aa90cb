"""Every trajectory that is sent passes the checks of ros2_control's joint_trajectory_controller.

The rules are those of `validate_trajectory_msg` in Jazzy's ros2_controllers, with its defaults.
"""

import numpy as np
import pytest
from scipy.interpolate import BPoly
from tests.support.messages import encode_trajectory

UP, DOWN, OUT = (0.55, 0.60), (0.55, -0.60), (0.75, 0.55)
FLOAT_EPSILON = float(np.finfo(np.float32).eps)


def seconds(time) -> float:
    return time.sec + 1e-9 * time.nanosec


def why_refused(message, joints, now: float) -> str | None:
    """What the controller would log, None where it takes the trajectory; now in s."""
    if not message.joint_names:
        return "empty joint names"
    if len(message.joint_names) != len(joints) or set(message.joint_names) != set(joints):
        return "joints do not match"
    if not message.points:
        return "empty trajectory"
    start = seconds(message.header.stamp)
    if start != 0.0 and start + seconds(message.points[-1].time_from_start) < now:
        return "ends in the past"
    if any(abs(speed) > FLOAT_EPSILON for speed in message.points[-1].velocities):
        return "velocity of the last point is not zero"
    before = None
    for point in message.points:
        at = (point.time_from_start.sec, point.time_from_start.nanosec)
        if before is not None and at <= before:
            return "time is not strictly increasing"
        before = at
        if len(point.positions) != len(joints):
            return "positions do not fit"
        for field in (point.velocities, point.accelerations):
            if len(field) not in (0, len(joints)):
                return "velocities or accelerations do not fit"
        if point.effort:
            return "effort is not supported"
    return None


@pytest.fixture
def sent(world):
    """Commands from rest, in motion, and one that brakes."""
    for goal in (UP, DOWN, OUT):
        world.verdict(world.send_goal(*goal))
        world.pass_time(0.7)
    world.life.stop(lambda success, sentence: None)
    world.pass_time(2.0)
    assert len(world.sent) >= 4
    return world.sent


def test_all_that_is_sent_passes_the_controllers_checks(world, sent):
    for command in sent:
        joints = world.machine.joint_names
        message = encode_trajectory(command.trajectory, joints)
        now = 1e-9 * command.stamp_ns
        assert why_refused(message, joints, now) is None
        # The rules do refuse: what is late, what still moves at its end, what goes back in time.
        late = now + 1.0 + 1e-9 * command.trajectory.duration_ns
        assert why_refused(message, joints, late) == "ends in the past"
        assert why_refused(message, joints[:-1], now) == "joints do not match"
        message.points[-1].velocities[0] = 1e-3
        assert "not zero" in (why_refused(message, joints, now) or "")
        message.points[-1].velocities[0] = 0.0
        message.points[1].time_from_start = message.points[0].time_from_start
        assert "increasing" in (why_refused(message, joints, now) or "")


def test_between_points_the_controllers_quintic_is_the_curve_that_was_planned(world, sent):
    for command in sent:
        message = encode_trajectory(command.trajectory, world.machine.joint_names)
        at = np.array([seconds(point.time_from_start) for point in message.points])
        states = np.array(
            [[point.positions, point.velocities, point.accelerations] for point in message.points]
        )
        quintic = BPoly.from_derivatives(at, states)
        offsets = np.linspace(0, command.trajectory.duration_ns, 997).astype(np.int64)
        position, velocity = command.trajectory.sample_many(command.stamp_ns + offsets)[:2]
        assert np.allclose(quintic(offsets / 1e9), position, atol=1e-9)
        assert np.allclose(quintic.derivative()(offsets / 1e9), velocity, atol=1e-6)
