"""Names on the ROS graph: nodes, services, frames, joints and actuators."""

PLANNER_NODE = "mhsb_planner"
SIM_NODE = "mhsb_sim"

MOVE_TIP_ACTION = "~/move_tip"
STOP_SERVICE = "~/stop"
RESET_SERVICE = "~/reset"
CLEAR_FAULTS_SERVICE = "~/clear_faults"

BASE_FRAME = "base_link"  # x forward, y to the left, z up
WORK_PLANE_FRAME = "work_plane"  # the arm's plane as its x-y plane: x forward, y up


def joint_names(count: int) -> tuple[str, ...]:
    """Return `joint_1`, `joint_2`, ... for a machine with `count` joints."""
    return tuple(f"joint_{number}" for number in range(1, count + 1))


def actuator_names(count: int) -> tuple[str, ...]:
    """Return `actuator_1`, `actuator_2`, ... in the order of the joints that they drive."""
    return tuple(f"actuator_{number}" for number in range(1, count + 1))
