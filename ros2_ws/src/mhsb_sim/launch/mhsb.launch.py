"""Launch planner and simulator, and robot_state_publisher if it is installed.

Example:
    ros2 launch mhsb_sim mhsb.launch.py machine:=/path/to/machine.yaml real_time_factor:=2.0
"""

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription
from mhsb_control import load_machine
from mhsb_sim.mechanics.robot_description import build_robot_description

ARGUMENTS = {  # name: (default, type, meaning)
    "namespace": ("", str, "namespace of both nodes"),
    "machine": ("", str, "machine file; empty for the one that is installed"),
    "seed": ("0", int, "seed of the simulator's random numbers"),
    "controller": ("", str, "servo of the simulator; empty for the one that suits the machine"),
    "real_time_factor": ("1.0", float, "simulated time over wall time"),
    "use_sim_time": ("false", bool, "the simulator publishes /clock and the planner follows it"),
}


def make_value(name: str) -> ParameterValue:
    """Return the value of a launch argument, converted to its type, as a node's parameter.

    Args:
        name: Key in ARGUMENTS.
    """
    return ParameterValue(LaunchConfiguration(name), value_type=ARGUMENTS[name][1])


def make_state_publisher(context) -> list[Node]:
    """Return the node robot_state_publisher, or nothing if it is not installed.

    The node computes TF frames from the URDF and the joint states.

    Args:
        context: Launch context, from which the argument `machine` is read. If this is empty, the
            suite's own arm is taken.

    Returns:
        List of one node; empty if the package is not installed.

    Raises:
        MachineFileError: The machine file is missing or not valid.
    """
    try:
        get_package_share_directory("robot_state_publisher")
    except PackageNotFoundError:
        return []
    machine = load_machine(LaunchConfiguration("machine").perform(context) or None)
    return [
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            namespace=LaunchConfiguration("namespace"),
            parameters=[
                {
                    "robot_description": build_robot_description(machine),
                    "use_sim_time": make_value("use_sim_time"),
                }
            ],
        )
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the launch description: arguments, planner, simulator and robot_state_publisher.

    With `use_sim_time`, the simulator publishes /clock.
    """
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
        parameters=[{name: make_value(name) for name in ("machine", "use_sim_time")}],
    )
    simulator = Node(
        package="mhsb_sim",
        executable="sim_node",
        namespace=namespace,
        output="screen",
        parameters=[
            {
                name: make_value(name)
                for name in ("machine", "seed", "controller", "real_time_factor")
            },
            {"publish_clock": make_value("use_sim_time")},
        ],
    )
    frames = OpaqueFunction(function=make_state_publisher)
    return LaunchDescription([*arguments, planner, simulator, frames])
