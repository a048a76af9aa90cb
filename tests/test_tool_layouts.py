"""What RViz, Foxglove, PlotJuggler, rqt and launch are told is what the suite says."""

import ast
import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from geometry_msgs.msg import Point, Pose, PoseStamped
from rclpy.qos import DurabilityPolicy
from std_msgs.msg import Header

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_msgs_py import actuator_states, goal_pose, names, sim_status, topics
from mhsb_planner.ros.planner_node import PLANNER_STATUS

ROOT = Path(__file__).resolve().parents[1]
LAUNCH_FILES = [
    ROOT / "ros2_ws/src/mhsb_sim/launch/mhsb.launch.py",
    ROOT / "ros2_ws/src/mhsb_tools/launch/demo.launch.py",
]
TOPICS = {topic.name: topic for topic in topics.SUITE_TOPICS}
MACHINE = load_machine()
ENTRIES = actuator_states.entry_names(MACHINE.actuator_names)


@pytest.fixture(scope="module")
def rviz():
    return yaml.safe_load(find_config_file("views/mhsb.rviz").read_text())["Visualization Manager"]


@pytest.fixture(scope="module")
def foxglove():
    return json.loads(find_config_file("views/foxglove.json").read_text())


def absolute(text) -> str:
    """The suite's name of a topic of the root namespace."""
    return text if text in TOPICS else text.removeprefix("/")


def test_rviz_hears_topics_of_the_suite_with_their_durability(rviz):
    asked = [
        display[key]
        for display in rviz["Displays"]
        for key in ("Topic", "Description Topic")
        if key in display
    ]
    assert {each["Value"] for each in asked} == {
        topics.MARKERS.name, topics.ROBOT_DESCRIPTION.name, topics.PLANNED_PATH_FLAT.name
    }  # fmt: skip
    for each in asked:
        latched = TOPICS[each["Value"]].qos.durability is DurabilityPolicy.TRANSIENT_LOCAL
        assert each["Durability Policy"] == ("Transient Local" if latched else "Volatile")


def test_a_click_in_rviz_is_a_goal_in_the_arms_plane(rviz):
    [tool] = [each for each in rviz["Tools"] if each["Class"].endswith("/SetGoal")]
    assert tool["Topic"]["Value"] == topics.GOAL_POSE.name
    frame = rviz["Global Options"]["Fixed Frame"]
    click = PoseStamped(header=Header(frame_id=frame), pose=Pose(position=Point(x=0.5, y=-0.3)))
    goal = goal_pose.decode(click)
    assert (goal.x, goal.z) == (0.5, -0.3)


def test_every_panel_of_foxglove_is_laid_out(foxglove):
    def leaves(node):
        if isinstance(node, str):
            return {node}
        return leaves(node["first"]) | leaves(node["second"])

    assert leaves(foxglove["layout"]) == set(foxglove["configById"])


def test_foxglove_plots_what_its_labels_say(foxglove):
    order = {
        topics.ACTUATOR_STATES.name: ENTRIES,
        topics.JOINT_STATES.name: MACHINE.joint_names,
        topics.MODES.name: MACHINE.actuator_names,
    }
    lines = [line for panel in foxglove["configById"].values() for line in panel.get("paths", [])]
    assert len(lines) == 15
    for line in lines:
        topic, field, index = re.fullmatch(r"(.+?)\.(\w+)\[(\d+)\]", line["value"]).groups()
        topic = absolute(topic)
        assert field in TOPICS[topic].message.get_fields_and_field_types()
        assert line["label"] == order[topic][int(index)]


def test_foxglove_hears_and_sends_what_there_is(foxglove):
    panels = foxglove["configById"]
    scene = panels["3D!arm"]
    assert set(map(absolute, scene["topics"])) <= set(TOPICS)
    assert absolute(scene["layers"]["arm"]["topic"]) == topics.ROBOT_DESCRIPTION.name
    assert scene["followTf"] == names.BASE_FRAME
    assert absolute(scene["publish"]["poseTopic"]) == topics.GOAL_POSE.name
    assert panels["DiagnosticSummary!all"]["topicToRender"] == topics.DIAGNOSTICS.name
    verdict = panels["RawMessages!verdict"]["topicPath"].partition(".")[0]
    assert absolute(verdict) == topics.PLAN_STATUS.name
    sent = panels["Publish!goal"]
    assert absolute(sent["topicName"]) == topics.GOAL_POSE.name
    goal = json.loads(sent["value"])
    position = goal["pose"]["position"]
    MACHINE.check_in_workspace((position["x"], position["z"]))
    assert goal["header"]["frame_id"] == names.BASE_FRAME


def test_plotjuggler_draws_series_that_a_recording_has():
    root = ElementTree.parse(find_config_file("views/plotjuggler.xml")).getroot()
    told = sim_status.SimulatorReport("running", False, 0, 1.0, 0.0, 0.0)
    report = sim_status.encode(told, 0)
    series = {f"/joint_states/{joint}/{what}" for joint in MACHINE.joint_names
              for what in ("position", "velocity")}  # fmt: skip
    series |= {f"/actuator_states/{entry}/position" for entry in ENTRIES}
    series |= {f"/modes/data[{j}]" for j in range(MACHINE.joint_count)}
    series |= {
        f"/diagnostics/{status.hardware_id}/{status.name}/{value.key}"
        for status in report.status
        for value in status.values
    }
    curves = [curve.get("name") for curve in root.iter("curve")]
    assert len(curves) == 26
    assert set(curves) <= series
    assert all(re.fullmatch("#[0-9A-Fa-f]{6}", each.get("color")) for each in root.iter("curve"))
    for splitter in root.iter("DockSplitter"):  # read by these numbers, unchecked
        sizes = splitter.get("sizes").split(";")
        assert len(sizes) == int(splitter.get("count")) == len(list(splitter))


def test_every_status_of_the_nodes_has_one_group():
    file = find_config_file("views/diagnostic_aggregator.yaml")
    groups = yaml.safe_load(file.read_text())["/**"]["ros__parameters"]
    prefixes = [
        prefix
        for group in groups.values()
        if isinstance(group, dict)
        for prefix in group["find_and_remove_prefix"]
    ]
    told = (sim_status.HAND_OVER_STATUS, sim_status.SIMULATOR_STATUS, PLANNER_STATUS)
    for name in told:
        assert sum(name.startswith(prefix) for prefix in prefixes) == 1


def literals(file) -> dict[str, object]:
    """Constants of a Python file, and dictionaries of them by key alone."""
    found = {}
    for node in ast.parse(file.read_text()).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            value = node.value
            names_ = [key.value for key in value.keys] if isinstance(value, ast.Dict) else None
            found[node.targets[0].id] = names_ or getattr(value, "value", None)
    return found


@pytest.mark.parametrize("file", LAUNCH_FILES, ids=lambda file: file.name)
def test_launch_files_start_executables_that_are_there(file):
    installed = {
        (setup.parent.name, name)
        for setup in ROOT.glob("ros2_ws/src/*/setup.py")
        for name in re.findall(r'"(\w+) = ', setup.read_text())
    }
    text = file.read_text()
    started = re.findall(r'package="(\w+)",\s+executable="(\w+)"', text)
    started += re.findall(r'command\("(\w+)", "(\w+)"', text)
    own = {each for each in started if each[0].startswith("mhsb")}
    assert own
    assert own <= installed


def test_launch_arguments_are_parameters_of_the_nodes():
    both, demo = map(literals, LAUNCH_FILES)
    sources = "".join(
        (ROOT / f"ros2_ws/src/{file}").read_text()
        for file in (
            "mhsb_sim/mhsb_sim/ros/sim_parameters.py",
            "mhsb_planner/mhsb_planner/ros/planner_parameters.py",
            "mhsb_msgs_py/mhsb_msgs_py/parameters.py",
        )
    )
    of_ros = {"namespace", "use_sim_time"}
    for name in set(both["ARGUMENTS"]) - of_ros:
        assert re.search(rf'"{name}"', sources), name
    assert set(demo["ARGUMENTS"]) & set(both["ARGUMENTS"]) == {"namespace"}


@pytest.mark.parametrize("file", LAUNCH_FILES, ids=lambda file: file.name)
def test_launch_reads_its_files(file):
    pytest.importorskip("launch_ros", reason="launch is not installed")
    from launch.actions import DeclareLaunchArgument
    from launch.launch_description_sources import PythonLaunchDescriptionSource

    from launch import LaunchContext

    description = PythonLaunchDescriptionSource(str(file)).get_launch_description(LaunchContext())
    told = [each for each in description.entities if isinstance(each, DeclareLaunchArgument)]
    assert {each.name for each in told} == set(literals(file)["ARGUMENTS"])
    assert all(each.description for each in told)
