"""Starts planner and simulator, for instance:

ros2 launch mhsb_sim mhsb.launch.py machine:=/path/to/machine.yaml real_time_factor:=2.0
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription

ARGUMENTS = {  # name: (default, type, meaning)
    "namespace": ("", str, "namespace of both nodes"),
    "machine": ("", str, "machine file; empty for the one that is installed"),
    "seed": ("0", int, "seed of the simulator's random numbers"),
    "controller": ("coordinated", str, "servo of the simulator"),
    "real_time_factor": ("1.0", float, "simulated time over wall time"),
    "use_sim_time": ("false", bool, "the simulator publishes /clock and the planner follows it"),
}


def value(name: str) -> ParameterValue:
    """A launch argument as a parameter of its type."""
    return ParameterValue(LaunchConfiguration(name), value_type=ARGUMENTS[name][1])


def generate_launch_description() -> LaunchDescription:
    """Both nodes, and the arguments to set them up."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=meaning)
        for name, (default, _, meaning) in ARGUMENTS.items()
    ]
    namespace = LaunchConfiguration("namespace")
    planner = Node(
        package="mhsb_planner",
        executable="planner_node",
        namespace=namespace,
        output="screen",
        parameters=[{name: value(name) for name in ("machine", "use_sim_time")}],
    )
    simulator = Node(
        package="mhsb_sim",
        executable="sim_node",
        namespace=namespace,
        output="screen",
        parameters=[
            {name: value(name) for name in ("machine", "seed", "controller", "real_time_factor")},
            {"publish_clock": value("use_sim_time")},
        ],
    )
    return LaunchDescription([*arguments, planner, simulator])
