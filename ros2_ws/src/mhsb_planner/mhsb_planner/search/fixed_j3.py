"""The conventional method: joint 3 keeps its angle (paper, Section 3.3, after its reference 18).

An initial angle J3 of joint 3 is given. At a tip position, joints 1 and 2 then have at most two
solutions. If both are beyond limits, J3 is changed in steps of 1° until a solution is within
limits. So each workspace node has one posture for all mode combinations. The search then finds path
and modes with the step costs of `s2_step`.

In an arm with more joints, all joints except two keep their angles; the machine file names the kept
joints. If necessary, one kept joint is changed. The elbow is the second of the two moving joints.
"""

import math
from contextlib import suppress

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.tip_postures import (
    find_closure_side,
    solve_posture_with_held_joints,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import compute_radian_equivalents
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, IntArray, frozen
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.errors import InfeasibleGoalError, RequestError
from mhsb_planner.posture.grid import Grid
from mhsb_planner.posture.s1_polytope import compute_all_polytope_areas
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.s2_graph import StepGraph

J3_STEP = math.radians(1.0)
"""Step by which a kept joint is changed if the two free joints have no solution [rad].

For a telescope, range/π stands for 1 rad (`kinematics.compute_radian_equivalents`).
"""

NODES_AT_ONCE = 50
"""Number of table nodes that are filled between two checks of the deadline."""

ELBOW_UP, ELBOW_DOWN = -1, 1
"""Side of the elbow: -1 up, +1 down.

The side is the sign of the angle from the link before the elbow to the line from elbow to tip."""


@kernel
def _find_posture(
    m: MachineArrays,
    x: float,
    z: float,
    moved: IntArray,
    kept: FloatArray,
    elbow: int,
    q: FloatArray,
) -> bool:
    """Find a posture at (x, z) that changes one kept joint by as few steps as possible.

    Two joints move freely, and all others keep the positions `kept`. If the free joints have no
    solution within limits, one kept joint is changed by 1, 2, … steps of J3_STEP. For each number
    of steps, the kept joints are tried in joint order, each upwards before downwards, and the elbow
    side `elbow` before the other side. The search ends without a result when every kept joint would
    be beyond its limits.

    Args:
        m: Arrays of the machine.
        x: Tip position forward [m].
        z: Tip position upward [m].
        moved: Indices i < j of the two joints that move freely, shape (2,).
        kept: Wanted positions of all other joints in joint order, shape (n - 2,) [rad or m].
        elbow: Side of the elbow that is tried first, ELBOW_UP or ELBOW_DOWN.
        q: Posture found, shape (n,) [rad or m]. Written in place.

    Returns:
        True if a posture was found; otherwise q is not valid.
    """
    changed, unit = kept.copy(), compute_radian_equivalents(m)
    i, j = moved[0], moved[1]
    change, left = 0, True
    while left:
        left, at = False, 0
        for k in range(len(q)):
            if k in (i, j):
                continue
            step = change * J3_STEP * unit[k]
            up, down = kept[at] + step, kept[at] - step
            left = left or up <= m.joint_max[k] or down >= m.joint_min[k]
            for sign in (1, -1):
                changed[at] = kept[at] + sign * step
                for side in (elbow, -elbow):
                    if solve_posture_with_held_joints(m, x, z, (i, j), changed, side, q):
                        return True
            changed[at] = kept[at]
            at += 1
        change += 1
    return False


@kernel(borrows=True)
def _fill_postures(
    m: MachineArrays,
    position: FloatArray,
    moved: IntArray,
    kept: FloatArray,
    elbow: int,
    posture: FloatArray,
) -> None:
    """Compute the postures of the conventional method at many tip positions.

    Two joints move freely, and all others are kept. If the free joints have no solution within
    limits, one kept joint is changed in steps of J3_STEP until there is a solution.

    Args:
        m: Arrays of the machine.
        position: Tip positions (x, z), shape (k, 2) [m].
        moved: Indices of the two joints that move freely, shape (2,).
        kept: Wanted positions of the kept joints in joint order, shape (n - 2,) [rad or m].
        elbow: Side of the elbow that is tried first, ELBOW_UP or ELBOW_DOWN.
        posture: Postures, shape (k, n) [rad or m]. Written in place; a row is NaN if there is no
            solution.
    """
    for i in range(len(position)):
        if not _find_posture(m, position[i, 0], position[i, 1], moved, kept, elbow, posture[i]):
            posture[i] = np.nan


def _list_moved_joints(machine: Machine) -> IntArray:
    """Return the indices of the two joints that are not kept, in ascending order."""
    kept = machine.kept_joints
    return frozen(np.array([j for j in range(machine.joint_count) if j not in kept]))


def read_kept_angles(machine: Machine, q: FloatArray) -> FloatArray:
    """Return the positions of the kept joints in a posture, clipped to their limits.

    Args:
        machine: Machine that names the joints that the conventional method keeps.
        q: Joint positions, shape (n,) [rad or m].

    Returns:
        Positions of the kept joints in joint order, shape (n - 2,) [rad or m].
    """
    kept, a = list(machine.kept_joints), machine.arrays
    return np.clip(np.asarray(q, dtype=np.float64)[kept], a.joint_min[kept], a.joint_max[kept])


def find_elbow_side(machine: Machine, q: FloatArray) -> int:
    """Return the side of the elbow (up or down) in a posture.

    Args:
        machine: Machine that names the kept joints. The elbow is the second of the two other
            joints.
        q: Joint positions, shape (n,) [rad or m].

    Returns:
        ELBOW_UP (−1) or ELBOW_DOWN (1).
    """
    i, j = _list_moved_joints(machine)
    return int(find_closure_side(machine.arrays, np.array(q, dtype=np.float64), i, j))


def compute_fixed_j3_posture(
    machine: Machine, x: float, z: float, j3: float | FloatArray, elbow: int = ELBOW_UP
) -> FloatArray:
    """Compute the posture of the conventional method at a tip position.

    Two joints move freely, and all others keep their given positions. If the free joints have no
    solution within limits, one kept joint is moved in steps until there is a solution. The kept
    joint and the direction that need the fewest steps are taken. A step is 1°; for a telescope,
    range/π stands for 1 rad.

    Args:
        machine: The arm without a slewing joint (`Machine.planar_arm`).
        x: Tip position forward [m].
        z: Tip position upward [m].
        j3: Initial position of joint 3 [rad or m], within its limits. For several kept joints:
            their positions in joint order, shape (n - 2,).
        elbow: Side of the elbow that is tried first, ELBOW_UP or ELBOW_DOWN.

    Returns:
        Joint positions, shape (n,) [rad or m], read-only.

    Raises:
        InfeasibleGoalError: No change of a kept joint gives a posture within limits.
        RequestError: j3 has the wrong length or is beyond a joint limit.
    """
    kept, q = _check_kept_angles(machine, j3), np.empty(machine.joint_count)
    if not _find_posture(machine.arrays, x, z, _list_moved_joints(machine), kept, elbow, q):
        raise InfeasibleGoalError(x, z)
    return frozen(q)


def build_fixed_j3_graph(
    machine: Machine,
    template_table: PostureTable,
    j3: float | FloatArray,
    elbow: int,
    jobs: int | None = None,
    grid: Grid | None = None,
    deadline: Deadline = NO_DEADLINE,
) -> StepGraph:
    """Build the graph of steps between the postures of the conventional method (kept joints).

    The graph has the nodes and mode combinations of a given posture table. Every combination of a
    node has the same posture; NaN marks a node without a posture. The function also prices all
    steps: it computes their durations and energies.

    Args:
        machine: The arm without a slewing joint (`Machine.planar_arm`).
        template_table: Posture table whose nodes, spacing and mode combinations are used.
        j3: Initial position of the kept joint, within its limits [rad or m]. For several kept
            joints: their positions in joint order, shape (n - 2,).
        elbow: Side of the elbow that is tried first, ELBOW_UP or ELBOW_DOWN.
        jobs: Number of threads; None means one per processor.
        grid: Grid of the table's nodes, if it has been built already; None builds it.
        deadline: Instant at which the work is given up.

    Returns:
        The graph. Its `posture_rule` gives postures of the conventional method between the nodes.

    Raises:
        RequestError: j3 has the wrong length or is beyond a joint limit.
        DeadlineError: The deadline passed.
    """
    kept, moved = _check_kept_angles(machine, j3), _list_moved_joints(machine)
    patterns, position = template_table.patterns, template_table.nodes * template_table.spacing
    posture = np.empty((len(position), machine.joint_count))
    area = np.empty((len(position), len(patterns)))
    for first in range(0, len(position), NODES_AT_ONCE):
        deadline.check("the table with joints fixed")
        part = slice(first, first + NODES_AT_ONCE)
        _fill_postures(machine.arrays, position[part], moved, kept, elbow, posture[part])
        area[part] = compute_all_polytope_areas(machine, posture[part], patterns)
    table = PostureTable(
        machine_name=machine.name,
        machine_hash=machine.table_hash,
        spacing=template_table.spacing,
        nodes=template_table.nodes,
        patterns=patterns,
        posture=np.repeat(posture[:, None, :], len(patterns), axis=1),
        area=area,
    )

    def find_postures(machine: Machine, x: float, z: float, _: Deadline) -> FloatArray:
        """Return the conventional method's posture at (x, z), once for each mode combination.

        The enclosing function gives the initial position of the kept joint, the elbow side and the
        number of mode combinations.

        Args:
            machine: Machine whose posture is wanted.
            x: Tip position forward [m].
            z: Tip position upward [m].
            _: Deadline, not used; `PostureRule` prescribes the argument.

        Returns:
            Joint positions, shape (patterns, n) [rad or m], with equal rows.

        Raises:
            InfeasibleGoalError: No change of a kept joint gives a posture within limits.
        """
        q = compute_fixed_j3_posture(machine, x, z, j3, elbow)
        return np.repeat(q[None, :], len(patterns), axis=0)

    return StepGraph(machine, table, jobs, posture_rule=find_postures, grid=grid, deadline=deadline)


def _check_kept_angles(machine: Machine, j3: float | FloatArray) -> FloatArray:
    """Convert the positions of the kept joints to an array and check them.

    Args:
        machine: Machine that names the kept joints and their limits.
        j3: Position of the only kept joint, or one position for each kept joint in joint order [rad
            or m].

    Returns:
        Positions of the kept joints, shape (n - 2,) [rad or m], read-only.

    Raises:
        RequestError: The number of positions is wrong, or a position is beyond its joint limits.
    """
    kept, angles = machine.kept_joints, np.atleast_1d(np.asarray(j3, dtype=np.float64))
    if len(angles) != len(kept):
        rule = f"is of one joint, {len(kept)} are kept; they stay as they are at the start"
        raise RequestError("initial J3", j3, rule)
    for j, angle in zip(kept, angles.tolist(), strict=True):
        low, high = float(machine.arrays.joint_min[j]), float(machine.arrays.joint_max[j])
        if not low <= angle <= high:
            unit = machine.joint_units[j]
            rule = f"must be within {low:g} … {high:g} {unit}"
            raise RequestError(f"initial J{j + 1}", f"{angle:g} {unit}", rule)
    return frozen(angles)


def warm_up(graph: StepGraph) -> None:
    """Compile the kernels of the conventional method, in which all joints except two are kept.

    Args:
        graph: Graph whose machine and mode combinations give the argument types.
    """
    machine, n = graph.machine, graph.machine.joint_count
    kept = read_kept_angles(machine, machine.arrays.joint_max)
    _fill_postures(
        machine.arrays,
        np.empty((0, 2)),
        _list_moved_joints(machine),
        frozen(kept),
        ELBOW_UP,
        np.empty((0, n)),
    )
    find_elbow_side(machine, machine.arrays.joint_max)
    with suppress(InfeasibleGoalError):
        compute_fixed_j3_posture(machine, 0.0, 0.0, kept)
    compute_all_polytope_areas(machine, np.empty((0, n)), graph.table.patterns)
