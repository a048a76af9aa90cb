"""Starts the demo, which stands in mhsb_tools; its former spelling stays.

ros2 launch mhsb_tools demo.launch.py
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Include the demo's launch file; all arguments are passed on."""
    demo = Path(get_package_share_directory("mhsb_tools"), "launch", "demo.launch.py")
    return LaunchDescription([IncludeLaunchDescription(PythonLaunchDescriptionSource(str(demo)))])
