"""A recording written by hand, whose every number is known, through the real codecs.

Joint 1 turns from `FOLDED` to `RAISED` and back, rest-to-rest, all actuators in N; on the way
up a second plan takes over and goes on along the same curve. From `BOOSTED_FROM` on actuator 1
holds in DB. While the reference moves the measured joint 1 swings about it.

    s      0 … 1     1 … 5     5 … 6     6 … 10    10 … 12
           rest      up        rest      down      rest, DB
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from tests.support.messages import encode_schedule, encode_trajectory

from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, quintic_hermite
from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import (
    actuator_states,
    goal_pose,
    joint_state,
    modes_in_force,
    names,
    plan_status,
    reference,
    sim_status,
    stamps,
    topics,
)
from mhsb_tools.recording import bag_format
from mhsb_tools.recording.bag_format import BagTopic
from mhsb_tools.recording.bag_reader import read_recording
from mhsb_tools.recording.bag_writer import BagWriter
from mhsb_tools.report.recorded_run import EvaluatedRecording, evaluate_recording

BEGIN_NS = 100 * SECOND_NS
PERIOD_NS = SECOND_NS // 100
DURATION = 12.0  # s
BOOSTED_FROM = 10.0  # s
FOLDED = np.array([0.3, -1.4, -1.5])
RAISED = np.array([0.9, -1.4, -1.5])
SWING = 2e-3  # rad, amplitude of the error of joint 1
SWING_FREQUENCY = 2.0  # Hz
REST = np.zeros(3)


@dataclass(frozen=True)
class Story:
    """What has been recorded, and the numbers that a report must find in it."""

    folder: Path
    machine: Machine

    @property
    def run(self) -> EvaluatedRecording:
        return evaluate_recording(read_recording(self.folder), self.machine)

    @property
    def tip_swing(self) -> float:
        """Amplitude of the tip's error [m]."""
        return SWING * float(np.hypot(*self.machine.tip_position(FOLDED)))

    def energy(self, series: bool) -> float:
        """Energy [J] of the model over the time between the simulator's reports (0.5 … 11.5 s).

        In N every litre costs P_S, whatever the speed: strokes and leakage are all there is to
        know. The hold in DB costs leakage at the price of the load; with the pumps in series the
        valve leaks by the square root of its line's pressure.
        """
        m = self.machine.arrays
        stroke = self.machine.cylinder_lengths(RAISED) - self.machine.cylinder_lengths(FOLDED)
        volume = (m.cap_area + m.rod_area) @ np.abs(stroke) + 3 * m.leakage_flow * 11.0
        leaked = m.leakage_flow * (11.5 - BOOSTED_FROM)
        load = (self.machine.piston_forces(FOLDED)[0] + m.rod_area[0] * m.tank_pressure) / (
            m.cap_area[0]
        )
        if series:
            rise = max(0.0, load + m.boost_margin - m.supply_pressure)
            factor = np.sqrt(1.0 + rise / (m.supply_pressure - m.tank_pressure))
            volume += (factor - 1.0) * leaked
            boost, leaked = rise / m.servo_pump_efficiency, factor * leaked
        else:
            boost = max(0.0, load / m.servo_pump_efficiency - m.supply_pressure)
        return float(m.supply_pressure * volume + boost * leaked)

    @property
    def needed_pressure(self) -> float:
        """Lowest constant pressure [Pa] that drives and holds all joints, by balances of forces."""
        m, needed = self.machine.arrays, []
        for time in np.arange(0.0, DURATION, 0.01):
            state = followed(time)
            speed = self.machine.moment_arms(state.position) * state.velocity
            for j, force in enumerate(self.machine.piston_forces(state.position)):
                cap, rod = m.cap_area[j], m.rod_area[j]
                out = (force + rod * m.tank_pressure) / cap
                back = (cap * m.tank_pressure - force) / rod
                extends = speed[j] > 0.0 if abs(speed[j]) > MAX_HELD_SPEED else force > 0.0
                drop = (speed[j] / m.valve_coefficient[j]) ** 2 * (cap**3 + rod**3)
                needed.append((out if extends else back) + drop / (cap if extends else rod))
        return float(max(needed) + m.boost_margin)

    def energy_at(self, pressure: float) -> float:
        """Energy [J] of one pump at a constant pressure [Pa] between the simulator's reports."""
        m = self.machine.arrays
        stroke = self.machine.cylinder_lengths(RAISED) - self.machine.cylinder_lengths(FOLDED)
        ratio = (pressure - m.tank_pressure) / (m.supply_pressure - m.tank_pressure)
        volume = (m.cap_area + m.rod_area) @ np.abs(stroke)
        return float(pressure * (volume + 3 * m.leakage_flow * np.sqrt(ratio) * 11.0))


def ns(time: float) -> int:
    """ROS time [ns] of a time of the story [s]."""
    return BEGIN_NS + round(time * SECOND_NS)


def followed(time: float) -> MotionState:
    """The reference at a time of the story."""
    for begin, start, end in ((6.0, RAISED, FOLDED), (1.0, FOLDED, RAISED)):
        if time >= begin + 4.0:
            return MotionState.at_rest(end)
        if time >= begin:
            since, duration = np.array([time - begin]), np.array([4.0])
            return MotionState(
                *quintic_hermite(since, duration, (start, REST, REST), (end, REST, REST))
            )
    return MotionState.at_rest(FOLDED)


def plan(begin: float, end: float) -> tuple[Trajectory, ModeSchedule]:
    """The plan that follows the reference between two times of the story, in N."""
    offset = np.arange(0, round((end - begin) * SECOND_NS) + 1, 2 * PERIOD_NS)
    states = [followed(begin + each / SECOND_NS) for each in offset]
    return (
        Trajectory(
            ns(begin),
            offset,
            np.array([state.position for state in states]),
            np.array([state.velocity for state in states]),
            np.array([state.acceleration for state in states]),
        ),
        ModeSchedule(ns(begin), np.array([0, offset[-1]]), np.zeros((2, 3), np.uint8)),
    )


class StoryBag:
    """Writes messages of the suite at times of the story [s]."""

    def __init__(self, bag: BagWriter) -> None:
        self._bag = bag
        for topic in topics.SUITE_TOPICS:
            qos = bag_format.format_qos(topic.qos)
            bag.add_topic(BagTopic(self._name(topic), topic.type_name, qos))

    def put(self, topic: topics.Topic, time: float, message: object) -> None:
        wall = 1_700_000_000 * SECOND_NS + (ns(time) - BEGIN_NS) // 2  # twice as fast as real
        self._bag.write(self._name(topic), serialize_message(message), wall, wall)

    @staticmethod
    def _name(topic: topics.Topic) -> str:
        return topic.name if topic.name.startswith("/") else f"/{topic.name}"


def write_streams(bag: StoryBag) -> None:
    """Joint states, references, actuator states at 100 Hz, modes at 10 Hz."""
    joints, actuators = names.joint_names(3), names.actuator_names(3)
    for step in range(round(DURATION * 100) + 1):
        time = step / 100
        state = followed(time)
        moving = 1.0 <= time < 5.0 or 6.0 <= time < 10.0
        swing = moving * SWING * np.sin(2 * np.pi * SWING_FREQUENCY * time)
        measured = state.position + np.array([swing, 0.0, 0.0])
        sample = joint_state.JointSample(ns(time), measured, state.velocity)
        bag.put(topics.JOINT_STATES, time, joint_state.encode(sample, joints))
        message = reference.encode(reference.Reference(ns(time), state), joints)
        bag.put(topics.REFERENCE, time, message)
        values = {quantity: np.zeros(3) for quantity in actuator_states.SAMPLE_FIELDS}
        values |= {
            "cap_pressure": np.array([7.5e6 if step == 300 else 3e6, 2e6, 1e6]),
            "rod_pressure": np.full(3, 5e5),
            "supply_pressure": np.array([4e6, 9.25e6 if step == 400 else 4e6, 4e6]),
        }
        hydraulics = actuator_states.ActuatorSample(ns(time), **values)
        bag.put(topics.ACTUATOR_STATES, time, actuator_states.encode(hydraulics, actuators))
        if step % 10 == 0:
            modes = np.array([1 if time >= BOOSTED_FROM else 0, 0, 0])
            bag.put(topics.MODES, time, modes_in_force.encode(modes))


def write_plans(bag: StoryBag) -> None:
    """Two plans on the way up, one back; two more that the simulator did not take."""
    joints, actuators = names.joint_names(3), names.actuator_names(3)
    bag.put(topics.PLAN_IN_FORCE, 0.0, stamps.to_time(0))
    for begin, end, jumps in (
        (1.0, 5.0, (0.0, 0.0)),
        (3.0, 5.0, (2e-7, 3e-8)),
        (6.0, 10.0, (1e-8, 4e-7)),
    ):
        path, schedule = plan(begin, end)
        bag.put(topics.JOINT_TRAJECTORY, begin, encode_trajectory(path, joints))
        bag.put(topics.MODE_COMMANDS, begin, encode_schedule(schedule, actuators))
        bag.put(topics.PLAN_IN_FORCE, begin, stamps.to_time(ns(begin)))
        report = sim_status.HandOverReport("applied", "it continues", ns(begin), *jumps)
        bag.put(topics.DIAGNOSTICS, begin, sim_status.encode(report, ns(begin)))
    for end in (5.01, 10.01):
        bag.put(topics.PLAN_IN_FORCE, end, stamps.to_time(0))
    for report in (
        sim_status.HandOverReport("refused", "it came too late", ns(7.0), 0.5, 0.1),
        sim_status.HandOverReport("dropped", "half of it is missing", ns(8.0), np.nan, np.nan),
    ):
        bag.put(topics.DIAGNOSTICS, 8.0, sim_status.encode(report, ns(8.0)))


def write_goals(bag: StoryBag, machine: Machine) -> None:
    """Three goals with plans, one in place, one outside, one that is not a number."""
    up, down = machine.tip_position(RAISED), machine.tip_position(FOLDED)
    beside, away = up + (0.0, 2e-3), down + (3e-3, -4e-3)
    goals = (
        (1.0, Verdict.OK, up, 10.0, Outcome.REPLACED),
        (3.0, Verdict.OK, beside, 20.0, Outcome.REACHED),
        (3.5, Verdict.OUT_OF_WORKSPACE, (2.0, 0.0), None, None),
        (4.0, Verdict.NOT_FINITE, (np.nan, 0.0), None, None),
        (6.0, Verdict.OK, away, 30.0, Outcome.REACHED),
        (11.0, Verdict.AT_GOAL, down, 1000.0, None),
    )
    for time, code, (x, z), plan_ms, outcome in goals:
        goal = goal_pose.Goal(ns(time) + 7, float(x), float(z))
        bag.put(topics.GOAL_POSE, time - 0.05, goal_pose.encode(goal))
        stamp_ns = ns(time) if code is Verdict.OK else 0
        cost = plan_status.PlanSummary(stamp_ns, 100.0, 90.0, 4.0, 2, plan_ms or 0.0, 50.0)
        plan = cost if code.accepted else None
        verdict = plan_status.GoalVerdict(code, "a sentence", goal, plan)
        bag.put(topics.PLAN_STATUS, time, plan_status.encode(verdict, ns(time)))
        if outcome is not None:
            report = plan_status.ExecutionReport(outcome, "a sentence", goal.stamp_ns, stamp_ns)
            bag.put(topics.PLAN_STATUS, time + 2.5, plan_status.encode(report, ns(time)))


def write_reports(bag: StoryBag) -> None:
    """The simulator's own report, every second; the first one's factor is of its start."""
    for second in range(12):
        time = second + 0.5
        factor = 99.0 if second == 0 else 2.0
        report = sim_status.SimulatorReport(
            "running", False, ns(time), factor, 100.0 + 10.0 * second, 5.0 + 2.0 * second
        )
        bag.put(topics.DIAGNOSTICS, time, sim_status.encode(report, ns(time)))


@pytest.fixture(scope="session")
def story(machine: Machine, tmp_path_factory: pytest.TempPathFactory) -> Story:
    folder = tmp_path_factory.mktemp("story") / "bag"
    with BagWriter(folder) as writer:
        bag = StoryBag(writer)
        write_streams(bag)
        write_plans(bag)
        write_goals(bag, machine)
        write_reports(bag)
    return Story(folder, machine)


@pytest.fixture(scope="session")
def run(story: Story) -> EvaluatedRecording:
    return story.run


@pytest.fixture(scope="session")
def idle_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of the streams alone: no plan, no goal, no report of the simulator."""
    folder = tmp_path_factory.mktemp("idle") / "bag"
    with BagWriter(folder) as writer:
        write_streams(StoryBag(writer))
    return folder
