"""A recording written message by message comes back as tables and domain objects."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from tests.support.messages import encode_schedule, encode_trajectory

from mhsb_model.goal import Goal
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import MotionState, Trajectory
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
from mhsb_tools.recording.bag_format import BagError, BagTopic
from mhsb_tools.recording.bag_reader import read_recording
from mhsb_tools.recording.bag_writer import BagWriter
from mhsb_tools.recording.recording import Recording

JOINTS = names.joint_names(2)
ACTUATORS = names.actuator_names(2)
WALL = 1_700_000_000_000_000_000  # ns; ROS time starts at 0 and goes twice as fast
PERIOD = 10_000_000  # ns of ROS time
STEPS = 200

generator = np.random.default_rng(1)
POSITION, VELOCITY, ACCELERATION = generator.normal(size=(3, STEPS, 2))
HYDRAULICS = generator.normal(size=(STEPS, len(actuator_states.SAMPLE_FIELDS), 2))
MOVE = Trajectory(
    40 * PERIOD,
    np.arange(3) * PERIOD,
    POSITION[:3],
    np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 0.0]]),
    ACCELERATION[:3],
)
SCHEDULE = ModeSchedule(40 * PERIOD, np.array([0, 5]), np.array([[2, 0], [0, 0]]))
VERDICT = plan_status.GoalVerdict(Verdict.ZONE, "in a zone", Goal(7, 0.5, 0.25))
HAND_OVER = sim_status.HandOverReport("applied", "it continues", 40 * PERIOD, 1e-9, 2e-9)
SIMULATOR = sim_status.SimulatorReport("running", False, 50 * PERIOD, 2.0, 30.0, 4.0)
REPORT = plan_status.ExecutionReport(Outcome.REACHED, "there", 7, 40 * PERIOD)


def wall(ros_ns: int) -> int:
    """When something of a ROS time was recorded."""
    return WALL + ros_ns // 2


def write(folder: Path, namespace: str = "") -> None:
    with BagWriter(folder) as bag:
        absolute = {}
        for topic in topics.SUITE_TOPICS:
            name = topic.name if topic.name.startswith("/") else f"{namespace}/{topic.name}"
            absolute[topic] = name
            bag.add_topic(BagTopic(name, topic.type_name, bag_format.format_qos(topic.qos)))

        def put(topic, ros_ns, message):
            bag.write(absolute[topic], serialize_message(message), wall(ros_ns), wall(ros_ns))

        for step in range(STEPS):
            now = step * PERIOD
            state = MotionState(POSITION[step], VELOCITY[step], ACCELERATION[step])
            sample = joint_state.JointSample(now, POSITION[step], VELOCITY[step])
            put(topics.JOINT_STATES, now, joint_state.encode(sample, JOINTS))
            put(topics.REFERENCE, now, reference.encode(reference.Reference(now, state), JOINTS))
            hydraulics = actuator_states.ActuatorSample(now, *HYDRAULICS[step])
            put(topics.ACTUATOR_STATES, now, actuator_states.encode(hydraulics, ACTUATORS))
        put(topics.GOAL_POSE, 30 * PERIOD, goal_pose.encode(goal_pose.Goal(7, 0.5, 0.25)))
        put(topics.PLAN_STATUS, 31 * PERIOD, plan_status.encode(VERDICT, 31 * PERIOD))
        put(topics.JOINT_TRAJECTORY, 32 * PERIOD, encode_trajectory(MOVE, JOINTS))
        put(topics.MODE_COMMANDS, 32 * PERIOD, encode_schedule(SCHEDULE, ACTUATORS))
        put(topics.PLAN_IN_FORCE, 40 * PERIOD, stamps.to_time(40 * PERIOD))
        put(topics.MODES, 40 * PERIOD, modes_in_force.encode(np.array([2, 0])))
        put(topics.MODES, 40 * PERIOD + PERIOD // 2, modes_in_force.encode(np.array([0, 0])))
        put(topics.PLAN_STATUS, 50 * PERIOD, plan_status.encode(REPORT, 50 * PERIOD))
        put(topics.DIAGNOSTICS, 40 * PERIOD, sim_status.encode(HAND_OVER, 40 * PERIOD))
        put(topics.DIAGNOSTICS, 50 * PERIOD, sim_status.encode(SIMULATOR, 50 * PERIOD))


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Recording:
    folder = tmp_path_factory.mktemp("recordings") / "bag"
    write(folder)
    return read_recording(folder)


def test_joint_streams_come_back_as_tables(recording):
    times = np.arange(STEPS) * PERIOD
    np.testing.assert_array_equal(recording.joint_states.time_ns, times)
    np.testing.assert_array_equal(recording.joint_states.position, POSITION)
    np.testing.assert_array_equal(recording.joint_states.velocity, VELOCITY)
    assert np.all(np.isnan(recording.joint_states.acceleration))
    np.testing.assert_array_equal(recording.references.time_ns, times)
    np.testing.assert_array_equal(recording.references.position, POSITION)
    np.testing.assert_array_equal(recording.references.acceleration, ACCELERATION)
    assert recording.joint_count == 2
    assert recording.unreadable == ()


def test_hydraulic_quantities_come_back_by_name(recording):
    assert list(recording.actuators.quantity) == list(actuator_states.SAMPLE_FIELDS)
    for index, table in enumerate(recording.actuators.quantity.values()):
        np.testing.assert_array_equal(table, HYDRAULICS[:, index])


def test_plans_come_back_as_domain_objects(recording):
    [move], [schedule] = recording.trajectories, recording.schedules
    np.testing.assert_array_equal(move.position, MOVE.position)
    assert move.stamp_ns == 40 * PERIOD
    np.testing.assert_array_equal(schedule.modes, SCHEDULE.modes)


def test_what_has_no_stamp_is_placed_in_ros_time(recording):
    assert recording.mode_time_ns.tolist() == [40 * PERIOD, 40 * PERIOD + PERIOD // 2]
    assert recording.modes.tolist() == [[2, 0], [0, 0]]
    [plan] = recording.plans_in_force
    assert (plan.time_ns, plan.value) == (40 * PERIOD, 40 * PERIOD)
    [goal] = recording.goals
    assert (goal.time_ns, goal.value) == (30 * PERIOD, goal_pose.Goal(7, 0.5, 0.25))


def test_verdicts_and_reports_come_back(recording):
    assert [(each.time_ns, each.value) for each in recording.reports] == [
        (31 * PERIOD, VERDICT),
        (50 * PERIOD, REPORT),
    ]


def test_reports_of_the_simulator_come_back_by_their_kind(recording):
    [hand_over], [simulator] = recording.hand_overs, recording.simulator_reports
    assert (hand_over.time_ns, hand_over.value) == (40 * PERIOD, HAND_OVER)
    assert (simulator.time_ns, simulator.value) == (50 * PERIOD, SIMULATOR)


def test_topics_below_a_namespace_are_found_by_it(tmp_path):
    write(tmp_path / "bag", "/left")
    assert len(read_recording(tmp_path / "bag", "/left").joint_states.time_ns) == STEPS
    with pytest.raises(BagError, match="no messages on /joint_states; was the simulator running"):
        read_recording(tmp_path / "bag")


def test_a_message_that_breaks_its_contract_is_told_and_left_out(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        for topic in (topics.JOINT_STATES, topics.MODES):
            bag.add_topic(BagTopic(f"/{topic.name}", topic.type_name, ""))
        sample = joint_state.JointSample(0, np.zeros(2), np.zeros(2))
        message = serialize_message(joint_state.encode(sample, JOINTS))
        bag.write("/joint_states", message, WALL, WALL)
        wrong = serialize_message(modes_in_force.encode(np.array([0, 9])))
        bag.write("/modes", wrong, WALL, WALL)
    recording = read_recording(tmp_path / "bag")
    [sentence] = recording.unreadable
    assert sentence == "modes: the mode of actuator 2 is 9; give 0 (N), 1 (DB) or 2 (SB)"
    assert recording.modes.shape == (0, 2)
    assert recording.trajectories == ()


def test_a_folder_that_is_no_recording_is_refused_with_advice(tmp_path):
    with pytest.raises(BagError, match=r"holds no file .*_0.mcap; name the folder"):
        read_recording(tmp_path)
    write(tmp_path / "bag")
    (tmp_path / "bag" / "metadata.yaml").unlink()
    with pytest.raises(
        BagError, match=r"has no metadata.yaml; complete it by mhsb record --repair"
    ):
        read_recording(tmp_path / "bag")
    with pytest.raises(BagError, match="is not a folder; name the folder of a recording"):
        read_recording(tmp_path / "nowhere")
