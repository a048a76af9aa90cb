"""Topics of the suite: name, message type and QoS, in one table.

Names are relative, so that namespaces and remaps work. Only /clock and /diagnostics are absolute,
as everywhere in ROS.
"""

from dataclasses import dataclass
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String, UInt8MultiArray
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from mhsb_msgs_py import qos


@dataclass(frozen=True, eq=False)
class Topic:
    """One topic, used as `node.create_publisher(topic.message, topic.name, topic.qos)`.

    Attributes:
        name: Name of the topic.
        message: Class of its messages.
        qos: Quality of service of its publisher and subscriptions.
    """

    name: str
    message: type[Any]
    qos: QoSProfile

    @property
    def type_name(self) -> str:
        """Message type as ROS writes it, such as `std_msgs/msg/String`."""
        package = self.message.__module__.partition(".")[0]
        return f"{package}/msg/{self.message.__name__}"


GOAL_POSE = Topic("goal_pose", PoseStamped, qos.STATUS)
PLAN_STATUS = Topic("plan_status", DiagnosticArray, qos.STATUS)
JOINT_STATES = Topic("joint_states", JointState, qos.DEFAULT)
REFERENCE = Topic("reference", JointTrajectory, qos.DEFAULT)
PLAN_IN_FORCE = Topic("plan_in_force", Time, qos.LATCHED)
JOINT_TRAJECTORY = Topic("joint_trajectory", JointTrajectory, qos.DEFAULT)
MODE_COMMANDS = Topic("mode_commands", JointTrajectory, qos.DEFAULT)
MODES = Topic("modes", UInt8MultiArray, qos.LATCHED)
ACTUATOR_STATES = Topic("actuator_states", JointState, qos.DEFAULT)
ESTIMATES = Topic("estimates", JointState, qos.DEFAULT)
PLANNED_PATH = Topic("planned_path", Path, qos.LATCHED)
PLANNED_PATH_FLAT = Topic("work_plane/planned_path", Path, qos.LATCHED)
MARKERS = Topic("markers", MarkerArray, qos.LATCHED)
ROBOT_DESCRIPTION = Topic("robot_description", String, qos.LATCHED)
DIAGNOSTICS = Topic("/diagnostics", DiagnosticArray, qos.DEFAULT)
CLOCK = Topic("/clock", Clock, qos.CLOCK)

SUITE_TOPICS = (
    GOAL_POSE,
    PLAN_STATUS,
    JOINT_STATES,
    REFERENCE,
    PLAN_IN_FORCE,
    JOINT_TRAJECTORY,
    MODE_COMMANDS,
    MODES,
    ACTUATOR_STATES,
    ESTIMATES,
    PLANNED_PATH,
    PLANNED_PATH_FLAT,
    MARKERS,
    ROBOT_DESCRIPTION,
    DIAGNOSTICS,
    CLOCK,
)
"""All topics of the suite."""
