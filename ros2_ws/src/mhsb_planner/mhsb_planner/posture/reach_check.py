"""Check of the reach of an arm, which needs none of the kernels that take long to compile."""

import numpy as np

from mhsb_model.errors import MhsbError, OutOfWorkspaceError
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, Position
from mhsb_planner.errors import InfeasibleGoalError, place_text
from mhsb_planner.posture.grid import list_grid_nodes
from mhsb_planner.posture.s1_psi_intervals_3r import MAX_INTERVALS, find_feasible_intervals


def check_reach(machine: Machine, position: Position) -> None:
    """Check that the tip can be at a position, in the workspace and within the joint limits.

    Obstacles are not considered. Joint limits are considered only if the arm has three turning
    joints in its plane, since the intervals of its postures are known in closed form. If such an
    arm has no slew, the error's message also states the nearest grid point in reach.

    Args:
        machine: The arm; it may slew.
        position: (x, z), or (x, y, z) if joint 1 slews, in `base_link` [m].

    Raises:
        OutOfWorkspaceError: The position is outside the workspace.
        InfeasibleGoalError: No posture within the joint limits reaches the position.
    """
    arm = machine.planar_arm
    try:
        machine.check_in_workspace(position)
        tip = machine.convert_to_plane(position, preferred_slew=0.0).tip
        if arm.is_3r and not _has_posture(arm, tip):
            raise InfeasibleGoalError(*tip)
    except (OutOfWorkspaceError, InfeasibleGoalError) as error:
        if arm.is_3r and not machine.slews:
            _append_nearest_node(error, arm, position)
        raise


def _has_posture(arm: Machine, tip: Position | FloatArray) -> bool:
    """Return whether an arm of three turning joints has a posture at a tip position (x, z) [m]."""
    intervals = np.empty((MAX_INTERVALS, 3))
    return bool(find_feasible_intervals(arm.arrays, tip[0], tip[1], intervals) > 0)


def _append_nearest_node(error: MhsbError, arm: Machine, position: Position) -> None:
    """Add the nearest grid node that an arm reaches to an error's sentence.

    Args:
        error: The error, changed in place; it stays as it is if no node is in reach.
        arm: Arm of three turning joints, without a slewing joint.
        position: Position (x, z) that the arm does not reach [m].
    """
    nodes = list_grid_nodes(arm, arm.spacing) * arm.spacing
    for node in nodes[np.argsort(np.hypot(*(nodes - position).T))]:
        if _has_posture(arm, node):
            error.args = (f"{error}; the nearest grid point in reach is {place_text(node)}",)
            return
