"""What a simulator makes of plans over real DDS: taken, refused, dropped, each told once."""

from __future__ import annotations

import math
import struct
import time

import numpy as np
import pytest
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from trajectory_msgs.msg import JointTrajectory

from mhsb_model.trajectory import SECOND_NS
from mhsb_msgs_py import stamps

MOVE = np.array([0.3, 0.3, 0.4])


def resident_mb(child):
    """Memory of a process [MB]."""
    with open(f"/proc/{child.process.pid}/statm", encoding="ascii") as statm:
        return int(statm.read().split()[1]) * 4096 / 1e6


def told_once(observer, commander, stamp_ns, outcome, reason):
    """Wait for the report of a plan, and whether nothing else is said of it later."""
    assert commander.outcome(stamp_ns).outcome == outcome
    observer.serve(0.8)
    (report,) = commander.reports(stamp_ns)
    assert report.reason == reason
    return report.sentence


def test_it_holds_at_the_start_and_takes_a_plan_that_continues(observer, commander):
    first = observer.references[-1].state
    observer.serve(0.5)
    np.testing.assert_array_equal(observer.references[-1].state.position, first.position)
    assert observer.in_force_ns == 0
    report = commander.outcome_of(commander.plan())
    assert (report.outcome, report.reason) == ("applied", "")


def test_what_cannot_be_followed_is_refused_once_with_its_reason(observer, commander):
    before = observer.references[-1].state.position

    jump = commander.send(commander.plan(shift=0.1))
    sentence = told_once(observer, commander, jump, "refused", "jump")
    assert "at its stamp it is 0.1 rad and 0 rad/s away from it" in sentence

    beyond_budget = commander.send(commander.plan(modes=(2, 2, 1)))
    sentence = told_once(observer, commander, beyond_budget, "refused", "invalid")
    assert "SB-SB-DB needs 5 booster modules, 4 are fitted" in sentence

    not_finite = commander.plan()
    not_finite[0].points[7].positions[1] = math.nan
    stamp = commander.send(not_finite)
    assert "point 7" in told_once(observer, commander, stamp, "refused", "invalid")

    misnamed = commander.plan()
    misnamed[0].joint_names = ["joint_1", "joint_2", "elbow"]
    stamp = commander.send(misnamed)
    assert "elbow" in told_once(observer, commander, stamp, "refused", "invalid")

    unknown_mode = commander.plan()
    unknown_mode[1].points[0].positions[2] = 3.0
    stamp = commander.send(unknown_mode)
    sentence = told_once(observer, commander, stamp, "refused", "invalid")
    assert "give 0 (N), 1 (DB) or 2 (SB)" in sentence

    assert observer.in_force_ns == 0
    np.testing.assert_array_equal(observer.references[-1].state.position, before)


def test_a_plan_that_comes_after_its_common_curve_is_over_is_late(observer, commander):
    halves = commander.move(MOVE, wait=0.1)
    observer.serve(0.4)
    stamp = commander.send(halves)
    sentence = told_once(observer, commander, stamp, "refused", "late")
    assert "it came too late, 0." in sentence
    assert "the reference has left the curve that both share" in sentence


def test_halves_lost_doubled_and_reordered(observer, commander):
    lost = commander.plan()
    commander.trajectories.publish(lost[0])
    stamp = stamps.from_time(lost[0].header.stamp)
    sentence = told_once(observer, commander, stamp, "dropped", "incomplete")
    assert "its mode schedule did not come within 0.5 s" in sentence
    commander.schedules.publish(lost[1])

    doubled = commander.plan()
    for _ in range(3):
        commander.send(doubled)
    told_once(observer, commander, stamps.from_time(doubled[0].header.stamp), "applied", "")

    older, newer = commander.plan(), commander.plan()
    commander.schedules.publish(newer[1])
    commander.schedules.publish(older[1])
    commander.trajectories.publish(newer[0])
    told_once(observer, commander, stamps.from_time(newer[0].header.stamp), "applied", "")
    assert [
        report.reason for report in commander.reports(stamps.from_time(older[0].header.stamp))
    ] in (["stamp"], ["newer"])
    commander.trajectories.publish(older[0])

    first, second = commander.plan(), commander.plan()
    commander.trajectories.publish(first[0])
    observer.serve(0.05)
    commander.send(second)
    told_once(observer, commander, stamps.from_time(second[0].header.stamp), "applied", "")
    told_once(observer, commander, stamps.from_time(first[0].header.stamp), "dropped", "newer")
    assert len(commander.reports(stamp)) == 1


def test_a_trajectory_of_100000_points_is_refused_at_once_and_nothing_stalls(observer, commander):
    latest = observer.references[-1]
    still = np.tile(latest.state.position, (100_000, 1))
    zero = np.zeros_like(still)
    halves = commander.halves(latest.stamp_ns + 1, SECOND_NS // 200, (still, zero, zero), (0, 0, 0))
    observer.serve(0.1)
    stamp = commander.send(halves, once_received=Duration(seconds=20))
    assert commander.outcome(stamp).sentence.endswith(
        "its joint_trajectory cannot be used: the trajectory has 100000 points; give at most 40000"
    )
    observer.references.clear()
    observer.until(lambda: len(observer.references) > 20)
    times = [each.stamp_ns for each in observer.references]
    assert max(np.diff(times)) < SECOND_NS
    commander.apply(commander.plan())


def test_the_longest_allowed_trajectory_is_taken(observer, commander):
    latest = observer.references[-1]
    still = np.tile(latest.state.position, (30_001, 1))
    zero = np.zeros_like(still)
    stamp_ns = latest.stamp_ns + SECOND_NS  # it takes a while to send
    halves = commander.halves(stamp_ns, SECOND_NS // 50, (still, zero, zero), (0, 0, 0))
    observer.until(lambda: observer.references[-1].stamp_ns > stamp_ns - SECOND_NS // 10)
    commander.send(halves)
    assert commander.outcome(stamp_ns).outcome == "applied"


def test_after_a_stop_has_been_answered_no_plan_sent_before_starts_the_arm(observer, commander):
    """It waits for its stamp, or is under way, when the arm is stopped."""
    first = observer.references[-1].state.position
    ahead_ns = observer.references[-1].stamp_ns + SECOND_NS * 6 // 10
    waiting = commander.move(MOVE, wait=0.0, stamp_ns=ahead_ns)
    observer.until(lambda: observer.references[-1].stamp_ns > ahead_ns - SECOND_NS * 3 // 10)
    commander.send(waiting)
    observer.serve(0.05)
    on_its_way = commander.move(MOVE, wait=0.6)
    response = observer.call("mhsb_sim/stop")
    assert response.success
    told_once(observer, commander, ahead_ns, "dropped", "stopped")
    stamp = commander.send(on_its_way)
    sentence = told_once(observer, commander, stamp, "refused", "stopped")
    assert "made before the arm was started, stopped or reset" in sentence
    observer.serve(0.5)
    np.testing.assert_array_equal(observer.references[-1].state.position, first)
    commander.apply(commander.move(MOVE))


@pytest.mark.parametrize("own_clock", [False, True])
def test_a_reset_ends_the_plan_in_force_and_the_one_that_waits(
    observer, start_simulator, own_clock, commander_of
):
    arguments = ("--ros-args", "-p", "publish_clock:=true") if own_clock else ()
    start_simulator(*arguments)
    commander = commander_of(observer)
    start = observer.references[-1].state.position
    observer.serve(1.0)
    in_force = commander.move(MOVE)
    commander.apply(in_force)
    observer.until(lambda: observer.references[-1].state.velocity.any())
    late = commander.move(MOVE)
    assert observer.call("mhsb_sim/reset").success
    observer.references.clear()
    observer.until(lambda: observer.in_force_ns == 0)
    stamp = commander.send(late)
    report = commander.outcome(stamp)
    assert report.outcome == "refused"
    assert report.reason in ("reset", "stamp")
    observer.serve(1.0)
    np.testing.assert_array_equal(observer.references[-1].state.position, start)
    commander.apply(commander.move(MOVE))


def test_a_flood_of_trajectories_leaves_states_and_memory_as_they_are(
    observer, simulator, commander
):
    """A thousand a second, each the first half of another plan."""
    raw = bytearray(serialize_message(commander.move(MOVE)[0]))
    base_ns = observer.references[-1].stamp_ns

    def flood(duration, offset_ns):
        begin, sent = time.monotonic(), 0
        while (passed := time.monotonic() - begin) < duration:
            if sent < 1000 * passed:
                raw[4:12] = struct.pack("<iI", *divmod(base_ns + offset_ns + sent, SECOND_NS))
                commander.trajectories.publish(bytes(raw))
                sent += 1
            elif sent % 10 == 0:
                observer.executor_of_tests.spin_once(timeout_sec=0.0)
        return sent

    flood(1.0, 0)
    before = resident_mb(simulator)
    observer.references.clear()
    assert flood(4.0, 10_000_000) > 1000  # fewer where the sender does not get to more
    observer.serve(0.5)
    times = [each.stamp_ns for each in observer.references]
    assert (times[-1] - times[0]) / 1e9 > 2.0
    assert resident_mb(simulator) - before < 5.0
    observer.serve(1.0)
    commander.apply(commander.plan())


def test_bytes_that_are_no_trajectory_are_refused_and_nothing_ends(observer, commander):
    for raw in (b"\0\1\0\0", b"\0\1\0\0" + bytes(40), b"\xff" * 64):
        commander.trajectories.publish(raw)
        commander.schedules.publish(raw)
    commander.trajectories.publish(JointTrajectory())
    observer.until(lambda: [r for r in observer.hand_overs if r.reason == "invalid"])
    commander.apply(commander.plan())
