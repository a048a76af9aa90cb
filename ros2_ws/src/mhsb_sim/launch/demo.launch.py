"""Launch file that starts the demo of mhsb_tools, so that the former spelling still works.

ros2 launch mhsb_tools demo.launch.py
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Include the demo's launch file of mhsb_tools, and pass on all arguments."""
    demo = Path(get_package_share_directory("mhsb_tools"), "launch", "demo.launch.py")
    return LaunchDescription([IncludeLaunchDescription(PythonLaunchDescriptionSource(str(demo)))])
