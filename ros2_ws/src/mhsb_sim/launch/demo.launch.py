"""Both nodes, RViz where it is installed, and goals one after the other; for instance:

ros2 launch mhsb_sim demo.launch.py goals:=/path/to/goals.yaml record:=/tmp/bag
ros2 launch mhsb_sim demo.launch.py goals:=none       # click them in RViz: key g
ros2 launch mhsb_sim demo.launch.py --show-args       # machine, controller, real_time_factor ...
"""

from itertools import pairwise
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from launch.actions import (
    DeclareLaunchArgument,
    IncludeLaunchDescription,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.event_handlers import OnProcessExit
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, ThisLaunchFileDir
from launch_ros.actions import Node

from launch import LaunchDescription
from mhsb_model.files.config_files import config_file, of_machine
from mhsb_model.machine import load_machine
from mhsb_sim.commands.demo_command import GOALS_FILE, read_goals

NODES = "/mhsb.launch.py"
NO_GOALS = "none"
READY = "300"
"""How long goals wait for a planner whose first start compiles [s]."""

ARGUMENTS = {  # name: (default, meaning); those of mhsb.launch.py come on top
    "namespace": ("", "namespace of all nodes"),
    "goals": ("", f"YAML list of goals; empty for the suite's own, {NO_GOALS} for yours alone"),
    "rviz": ("true", "show RViz where it is installed"),
    "viewer": ("false", "show the arm in a browser"),
    "record": ("", "folder for a recording; empty for none"),
}


def generate_launch_description() -> LaunchDescription:
    """Everything, and the arguments to set it up."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=meaning)
        for name, (default, meaning) in ARGUMENTS.items()
    ]
    nodes = IncludeLaunchDescription(PythonLaunchDescriptionSource([ThisLaunchFileDir(), NODES]))
    return LaunchDescription([*arguments, nodes, OpaqueFunction(function=shown_and_moved)])


def shown_and_moved(context) -> list:
    """What the arguments ask for beside both nodes."""
    asked = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    actions = []
    if is_true(asked["rviz"]):
        actions.append(rviz())
    if is_true(asked["viewer"]):
        actions.append(command("mhsb_sim", "viewer"))
    if asked["record"]:
        actions.append(command("mhsb_sim", "record", "--output", asked["record"]))
    if asked["goals"] != NO_GOALS:
        machine = load_machine(LaunchConfiguration("machine").perform(context) or None)
        file = Path(asked["goals"]) if asked["goals"] else of_machine(GOALS_FILE, machine.name)
        actions += one_after_the_other([send(goal) for goal in read_goals(file)])
    return actions


def is_true(text: str) -> bool:
    """As launch reads its own conditions."""
    return text.strip().lower() in ("true", "1")


def rviz() -> Node | LogInfo:
    """RViz on the arm's plane, where a click with its goal tool is a goal."""
    try:
        get_package_share_directory("rviz2")
    except PackageNotFoundError:
        return LogInfo(msg="RViz is not installed; viewer:=true shows the arm in a browser")
    return Node(
        package="rviz2",
        executable="rviz2",
        namespace=LaunchConfiguration("namespace"),
        arguments=["-d", str(config_file("views/mhsb.rviz"))],
        parameters=[{"use_sim_time": LaunchConfiguration("use_sim_time")}],
    )


def command(package: str, executable: str, *arguments: str) -> Node:
    """A command of the suite, which makes a node."""
    return Node(
        package=package,
        executable=executable,
        namespace=LaunchConfiguration("namespace"),
        arguments=list(arguments),
        output="screen",
    )


def send(goal) -> Node:
    """A goal, sent when the planner is ready, until the arm is there."""
    place = (f"{value:.9g}" for value in goal.position)
    return command("mhsb_planner", "goal", *place, "--wait", "--timeout", READY)


def one_after_the_other(processes: list) -> list:
    """The first, and handlers that start each of the others when the one before has ended."""
    handlers = [
        RegisterEventHandler(OnProcessExit(target_action=before, on_exit=[after]))
        for before, after in pairwise(processes)
    ]
    return [*handlers, processes[0]]
