"""Launch both nodes, RViz if it is installed, and goals one after the other.

Examples:
    ros2 launch mhsb_tools demo.launch.py goals:=/path/to/goals.yaml record:=/tmp/bag
    ros2 launch mhsb_tools demo.launch.py goals:=none       # click them in RViz: key g
    ros2 launch mhsb_tools demo.launch.py --show-args       # machine, controller ...
"""

from functools import partial
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
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription
from mhsb_control import load_machine
from mhsb_model.files.config_files import find_config_file, find_machine_config_file
from mhsb_tools.commands.demo_command import GOALS_FILE, read_goals

NODES = "mhsb.launch.py"
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
    """Return the launch arguments, both nodes, and the actions that the arguments ask for."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=meaning)
        for name, (default, meaning) in ARGUMENTS.items()
    ]
    file = Path(get_package_share_directory("mhsb_sim"), "launch", NODES)
    nodes = IncludeLaunchDescription(PythonLaunchDescriptionSource(str(file)))
    return LaunchDescription([*arguments, nodes, OpaqueFunction(function=make_optional_actions)])


def make_optional_actions(context) -> list:
    """Return the actions that the arguments ask for, beside both nodes."""
    asked = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    actions = []
    if is_true(asked["rviz"]):
        actions.append(make_rviz())
    if is_true(asked["viewer"]):
        actions.append(make_command("mhsb_tools", "mhsb", "view"))
    if asked["record"]:
        actions.append(make_command("mhsb_tools", "mhsb", "record", "--output", asked["record"]))
    if asked["goals"] != NO_GOALS:
        machine = load_machine(LaunchConfiguration("machine").perform(context) or None)
        own = partial(find_machine_config_file, GOALS_FILE, machine.name)
        file = Path(asked["goals"]) if asked["goals"] else own()
        actions += chain_processes([make_goal(goal) for goal in read_goals(file)])
    return actions


def is_true(text: str) -> bool:
    """Return whether a text is true by the rule of launch's own conditions."""
    return text.strip().lower() in ("true", "1")


def make_rviz() -> Node | LogInfo:
    """Return RViz on the arm's plane, in which a click with the goal tool sends a goal."""
    try:
        get_package_share_directory("rviz2")
    except PackageNotFoundError:
        return LogInfo(msg="RViz is not installed; viewer:=true shows the arm in a browser")
    return Node(
        package="rviz2",
        executable="rviz2",
        namespace=LaunchConfiguration("namespace"),
        arguments=["-d", str(find_config_file("views/mhsb.rviz"))],
        parameters=[{"use_sim_time": LaunchConfiguration("use_sim_time")}],
    )


def make_command(package: str, executable: str, *arguments: str) -> Node:
    """Return a command of the suite as a launch action."""
    return Node(
        package=package,
        executable=executable,
        namespace=LaunchConfiguration("namespace"),
        arguments=list(arguments),
        output="screen",
    )


def make_goal(goal) -> Node:
    """Return the command that sends a goal once the planner is ready, and waits for the arm."""
    place = (f"{value:.9g}" for value in goal.position)
    return make_command("mhsb_planner", "goal", *place, "--wait", "--timeout", READY)


def chain_processes(processes: list) -> list:
    """Return actions that start the first process, and each other when the one before it ends."""
    handlers = [
        RegisterEventHandler(OnProcessExit(target_action=before, on_exit=[after]))
        for before, after in pairwise(processes)
    ]
    return [*handlers, processes[0]]
