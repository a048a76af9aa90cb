"""Simulated time over real DDS: freezes, overload, another of the same name."""

from __future__ import annotations

import re
import signal
import time
from itertools import pairwise

import numpy as np

from mhsb_model.trajectory import SECOND_NS
from mhsb_msgs_py import stamps, topics

MOVE = np.array([0.3, 0.3, 0.4])


def latest(observer):
    return observer.simulator_reports[-1]


def until_warning(observer, text, timeout=15.0):
    def warned():
        reports = observer.simulator_reports
        return reports and reports[-1].warning and text in reports[-1].sentence

    observer.until(warned, timeout)


def until_no_warning(observer, text):
    """A busy machine may have it warn of something else meanwhile.

    A node that has ended is forgotten after 20 s if its farewell is lost (lease of Fast DDS).
    """
    observer.until(lambda: text not in latest(observer).sentence, 30.0)


def lag(observer):
    """Simulated time behind the system's [s]."""
    return (time.time_ns() - observer.references[-1].stamp_ns) / 1e9


def test_a_simulator_frozen_in_motion_goes_on_where_it_was_without_a_leap(
    observer, simulator, commander
):
    commander.apply(commander.move(MOVE, duration=20.0))
    observer.until(lambda: observer.references[-1].state.velocity.any())
    in_force = observer.in_force_ns
    observer.references.clear()
    simulator.process.send_signal(signal.SIGSTOP)
    time.sleep(1.5)
    simulator.process.send_signal(signal.SIGCONT)
    until_warning(observer, "behind its pace")
    observer.until(lambda: len(observer.references) > 100)
    assert observer.in_force_ns == in_force
    steps = np.diff([each.stamp_ns for each in observer.references])
    assert steps.min() > 0
    assert steps.max() < SECOND_NS / 2  # where messages were lost; the freeze took longer
    assert observer.largest_reference_step() < 1e-4
    assert observer.call("mhsb_sim/stop").success
    observer.until(lambda: not observer.references[-1].state.velocity.any())
    commander.apply(commander.move(-MOVE / 10))


def test_plans_go_by_the_stamps_of_reference_while_simulated_time_is_behind(
    observer, simulator, commander
):
    simulator.process.send_signal(signal.SIGSTOP)
    time.sleep(1.5)
    simulator.process.send_signal(signal.SIGCONT)
    observer.until(lambda: lag(observer) > 0.8)
    halves = commander.move(MOVE)
    commander.apply(halves)
    by_the_system = commander.move(MOVE, stamp_ns=time.time_ns())
    report = commander.outcome_of(by_the_system)
    assert report.reason == "stamp"
    assert "ahead of the arm's time" in report.sentence


def test_a_pace_that_cannot_be_kept_is_told_with_the_one_that_is(observer, start_simulator):
    start_simulator("--ros-args", "-p", "publish_clock:=true", "-p", "real_time_factor:=50.0")
    until_warning(observer, "behind its pace")
    began, first_ns = time.monotonic(), observer.references[-1].stamp_ns
    observer.serve(1.5)
    simulated = (observer.references[-1].stamp_ns - first_ns) / SECOND_NS
    measured = simulated / (time.monotonic() - began)
    assert measured / 4.0 < latest(observer).real_time_factor < min(4.0 * measured, 49.0)
    taken, reason = observer.set_parameter("mhsb_sim", "real_time_factor", 1.0)
    assert taken, reason
    until_no_warning(observer, "behind its pace")
    steps = np.diff([each.stamp_ns for each in observer.references])
    assert steps.min() > 0


def test_two_simulators_of_one_name_are_noticed_by_both(observer, start_simulator):
    children = [start_simulator(), start_simulator()]
    until_warning(observer, "there are 2 nodes called /mhsb_sim")
    until_warning(observer, "/reference has 2 publishers")
    for child in children:
        child.wait_for("there are 2 nodes called /mhsb_sim")
        told = re.findall(r"\[mhsb_sim\]: (.*one is allowed)", child.output)
        assert all(one != next_one for one, next_one in pairwise(told))
    assert children[1].stop(signal.SIGINT) == 0
    until_no_warning(observer, "one is allowed")


def test_actuator_states_have_the_times_of_references_for_whoever_subscribes(observer, simulator):
    topic, heard = topics.ACTUATOR_STATES, []
    observer.create_subscription(topic.message, topic.name, heard.append, topic.qos)
    observer.until(lambda: len(heard) > 50)
    observer.serve(0.2)  # the last reference may still be on its way
    times = [stamps.from_time(each.header.stamp) for each in heard]
    references = [each.stamp_ns for each in observer.references]
    first = references.index(times[0])
    assert references[first : first + len(times)] == times
    assert len(heard[-1].name) == len(heard[-1].position) > 0


def test_somebody_else_on_its_topics_is_noticed_while_he_is_there(observer, simulator):
    observer.until(lambda: observer.simulator_reports)
    topic = topics.JOINT_STATES
    publisher = observer.create_publisher(topic.message, topic.name, topic.qos)
    until_warning(observer, f"/{topic.name} has 2 publishers")
    assert latest(observer).warning
    observer.destroy_publisher(publisher)
    until_no_warning(observer, "one is allowed")


def test_a_new_subscriber_of_diagnostics_gets_the_report_between_two_regular_ones(
    observer, simulator
):
    reports, topic = observer.simulator_reports, topics.DIAGNOSTICS
    observer.until(lambda: len(reports) > 2)
    for _ in range(5):  # a busy machine may be too late for one subscription
        before = len(reports)
        observer.until(lambda n=before: len(reports) > n)
        added = observer.create_subscription(topic.message, topic.name, lambda _: None, topic.qos)
        observer.until(lambda n=before: len(reports) > n + 1)
        observer.destroy_subscription(added)
    gaps = [b.sim_time_ns - a.sim_time_ns for a, b in pairwise(reports[2:])]
    assert min(gaps) < SECOND_NS / 2
