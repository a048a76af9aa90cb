"""Everything that both nodes import and load at their start; importing this module does it.

Nothing here leaves a thread behind or initializes ROS, which a fork would not survive.
"""

import gc
import inspect
import os

os.environ["MUJOCO_GL"] = "disable"  # as the simulator node does, before MuJoCo is imported

from rclpy.type_support import check_for_type_support

from mhsb_model.machine import load_machine
from mhsb_msgs_py.topics import SUITE_TOPICS
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.ros import planner_node  # noqa: F401 - imported so that forks have it
from mhsb_sim.ros import sim_node  # noqa: F401 - imported so that forks have it
from mhsb_sim.simulation.kernel_parts import exercise_kernels

machine = load_machine()
Replanner(machine, load_or_build_table(machine)).warm_up()
exercise_kernels()
for topic in SUITE_TOPICS:
    check_for_type_support(topic.message)
inspect.getframeinfo(inspect.currentframe())  # rclpy's logger does, and Python keeps what it finds
gc.collect()
gc.freeze()  # collections of the forks need not look at what has been loaded here
