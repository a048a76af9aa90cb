"""Area of the velocity polytope of the tip, which the postures of a posture table maximise.

In a posture and a mode combination, the piston speeds v_j have these limits (paper, Section 2.1):

    −V_ret,j ≤ v_j ≤ V_ext,j                valve, and for boosted joints the servo pumps
    Σ_j A_dir,j |v_j| ≤ Q_MP − n q_leak     main pump, boosted flow included

A_dir is the cap-side area A in extension and the rod-side area a in retraction. Q_MP is the main
pump's flow, and q_leak the leakage of each of n valves. The tip velocity is Σ_j C_j v_j with
C_j = J_j / r_j: column of the tip's Jacobian over moment arm. The polytope is the set of the tip
velocities of all admissible piston speeds.

The valve limits of a boosted joint are those at the highest boost pressure. As in the paper, the
leakage of all valves is taken at the main pump's pressure, since areas only compare postures. The
graph search (S2) and the trajectory (S3) check the real demand on the main pump, with the leakage
of boosted valves.

If even the highest boost pressure cannot hold the load, the joint can move in one direction only.
As in the paper, such a posture is not excluded here, since the polytope is still defined. The
search excludes its steps against the load.
"""

import itertools
import math

import numpy as np

from mhsb_model import hydraulics, kinematics
from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import moment_arm
from mhsb_model.machine import Machine
from mhsb_model.modes import MODE_COUNT
from mhsb_model.statics import piston_forces
from mhsb_model.types import FloatArray, ModeArray, frozen

COLUMN_PERTURBATION = 1e-12
"""Size of the numbers that are added to the tip velocities per piston speed [-].

They ensure that no two joints have exactly parallel tip velocities."""


@kernel
def compute_flow_limits(m: MachineArrays, q: FloatArray, limit: FloatArray) -> None:
    """Compute the largest inlet flow of every joint in every mode and direction.

        mode N:   A_dir v_valve(P_S)
        boosted:  min(A_dir v_valve(p_boost), modules · Q_SP)

    A_dir is the area of the chamber that fills. v_valve(p) is the largest piston speed that the
    valve allows under the gravity load at the supply pressure p. P_S is the main pump's pressure.
    p_boost is the highest boost pressure, and Q_SP the flow of one servo pump. `modules` is the
    number of servo pumps of the mode.

    Args:
        m: Arrays of the machine.
        q: Posture, shape (n,) [rad or m].
        limit: Largest flow by joint, mode and direction (0 extends, 1 retracts), shape (n, modes,
            2) [m³/s]. Written in place.
    """
    n = len(q)
    force = np.empty(n)
    piston_forces(m, q, force)
    for j in range(n):
        for mode in range(MODE_COUNT):
            limit[j, mode, 0], limit[j, mode, 1] = compute_flow_limit(m, j, mode, force[j])


@kernel(borrows=True)
def compute_flow_limit(m: MachineArrays, j: int, mode: int, force: float) -> tuple[float, float]:
    """Compute the largest inlet flow of one joint in a mode under a given load.

    One limit is the flow through the valve at the highest supply pressure of the mode. In boost the
    flow of the mode's servo pumps is a further limit.

    Args:
        m: Arrays of the machine.
        j: Index of the joint.
        mode: Mode code.
        force: Piston force F, positive if it resists extension [N].

    Returns:
        Largest flow in extension and largest flow in retraction, both as magnitudes [m³/s].
    """
    oil, cap, rod = hydraulics.get_shared_hydraulics(m), m.cap_area[j], m.rod_area[j]
    k, tank, modules = m.valve_coefficient[j], m.tank_pressure, m.modules_per_mode[mode]
    supply = hydraulics.get_max_supply_pressure(oil, modules)
    pumped = hydraulics.get_max_servo_pump_flow(oil, modules)
    out = cap * hydraulics.compute_extension_speed(k, cap, rod, supply, tank, force)
    back = rod * hydraulics.compute_retraction_speed(k, cap, rod, supply, tank, force)
    return min(out, pumped), min(back, pumped)


@kernel
def compute_tip_columns(m: MachineArrays, q: FloatArray) -> FloatArray:
    """Compute the tip velocity per piston speed for each joint, C_j = J_j / r_j.

    J_j is the column of the tip's Jacobian for joint j, and r_j the moment arm of its cylinder.

    Args:
        m: Arrays of the machine.
        q: Posture, shape (n,) [rad or m].

    Returns:
        Columns C_j, shape (2, n) [-]; rows x and z.
    """
    columns = kinematics.tip_jacobian(m, q)
    for j in range(len(q)):
        arm = moment_arm(m.linkage[j], q[j])
        columns[0, j] /= arm
        columns[1, j] /= arm
    return columns


@kernel(borrows=True)
def compute_cross_products(columns: FloatArray, cross: FloatArray) -> None:
    """Compute, for each pair of joints, the cross product of their tip velocities.

    A small vector, different for each joint, is first added to each tip velocity, so that parallel
    tip velocities have products other than 0. The result is exactly antisymmetric.

    Args:
        columns: Tip velocity per piston speed C_j of each joint, shape (2, n) [-]. Not changed.
        cross: Cross products C_i × C_j, written in place, shape (n, n) [-].
    """
    n = columns.shape[1]
    for i in range(n):
        cross[i, i] = 0.0
        xi, zi = (
            columns[0, i] + COLUMN_PERTURBATION * (i + 1),
            columns[1, i] + COLUMN_PERTURBATION * (i + 1) ** 2,
        )
        for j in range(i + 1, n):
            xj, zj = (
                columns[0, j] + COLUMN_PERTURBATION * (j + 1),
                columns[1, j] + COLUMN_PERTURBATION * (j + 1) ** 2,
            )
            cross[i, j] = xi * zj - zi * xj
            cross[j, i] = -cross[i, j]


@kernel(borrows=True, reads=True)
def compute_area_from_limits(
    cross: FloatArray, scale: FloatArray, limit: FloatArray, pattern: ModeArray, flow: float
) -> float:
    """Compute the area of the velocity polytope for any number of joints.

    The polytope contains all tip velocities Σ_j C_j v_j that the pistons' limits allow. C_j is the
    tip velocity per speed v_j of piston j. For each direction d, the farthest point of the polytope
    is found by giving the flow to the joints in descending order of w_j = scale_j d·C_j.

    As d turns, this order changes at some directions. Each change gives an edge of the polytope:
    one joint reverses (w_j = 0), or two joints exchange flow (w_i = w_j > 0). The area is a sum
    over all edges in any order, with an end point p and the vector e of each edge:

        ½ Σ |p × e|

    Tested against half-space intersection and convex hull.

    Args:
        cross: Cross products C_i × C_j, shape (n, n) [-].
        scale: Piston speed per inlet flow, shape (n, 2) [1/m²]: 1/(cap-side area) extending,
            −1/(rod-side area) retracting.
        limit: Largest inlet flow by joint, mode and direction (0 extends, 1 retracts), shape (n,
            modes, 2) [m³/s].
        pattern: Mode code of every joint, shape (n,).
        flow: Flow that the main pump gives all joints together, boosted joints included [m³/s].

    Returns:
        Area [m²/s²].
    """
    n = len(pattern)
    twice = 0.0
    for j in range(n):
        for side in (1.0, -1.0):
            rest = flow
            height = 0.0  # p × C_j
            for k in range(n):
                if k == j:
                    continue
                d = 0 if side * cross[j, k] > 0.0 else 1
                used = limit[k, pattern[k], d]
                rest -= used
                height += used * scale[k, d] * cross[k, j]
            if rest > 0.0:
                out = min(limit[j, pattern[j], 0], rest) * scale[j, 0]
                back = min(limit[j, pattern[j], 1], rest) * scale[j, 1]
                twice += abs(height) * (out - back)
    for i in range(n):
        for j in range(i + 1, n):
            for di in range(2):
                for dj in range(2):
                    si, sj = scale[i, di], scale[j, dj]
                    weight = si * sj * cross[i, j]
                    upright = weight > 0.0
                    rest = flow
                    height = 0.0  # p × e per flow traded
                    for k in range(n):
                        if k == i or k == j:
                            continue
                        lever = sj * cross[k, j] - si * cross[k, i]
                        d = 0 if (lever > 0.0) == upright else 1
                        sk = scale[k, d]
                        jk, ki = sj * sk * cross[j, k], sk * si * cross[k, i]
                        if _precedes_pair(i, j, k, weight, jk, ki):
                            used = limit[k, pattern[k], d]
                            rest -= used
                            height += used * sk * lever
                    if rest > 0.0:
                        traded = min(limit[i, pattern[i], di], rest)
                        traded += min(limit[j, pattern[j], dj], rest) - rest
                        if traded > 0.0:
                            twice += traded * abs(height + rest * weight)
    return 0.5 * twice


@kernel
def _precedes_pair(i: int, j: int, k: int, ij: float, jk: float, ki: float) -> bool:
    """Return whether joint k gets its flow before the pair of joints i and j.

    The flow is given to joints in descending order of their weights w_j = s_j d·C_j for a direction
    d. C_j is the tip velocity per piston speed of joint j, and s_j its piston speed per inlet flow.
    On an edge of the velocity polytope the joints i and j have equal weights. The function returns
    whether w_k is larger. The orientation of the points s_i C_i, s_j C_j and s_k C_k decides this.
    The products are summed in index order, so that the three pairs of a triple give consistent
    answers.

    Args:
        i: Index of the first joint of the pair.
        j: Index of the second joint of the pair, above i.
        k: Index of the joint to compare.
        ij: Product s_i s_j (C_i × C_j) [1/m⁴].
        jk: Product s_j s_k (C_j × C_k) [1/m⁴].
        ki: Product s_k s_i (C_k × C_i) [1/m⁴].

    Returns:
        True if joint k comes first.
    """
    if k > j:
        left_turn = (ij + jk) + ki >= 0.0
    elif k > i:
        left_turn = ((-ki) + (-jk)) + (-ij) < 0.0
    else:
        left_turn = (ki + ij) + jk >= 0.0
    return left_turn != (ij > 0.0)


@kernel
def compute_flow_scale(m: MachineArrays) -> FloatArray:
    """Return the piston speed per inlet flow of every joint.

    Args:
        m: Arrays of the machine.

    Returns:
        1/A extending and −1/a retracting, shape (n, 2) [1/m²]. A is the piston area on the cap
        side, a on the rod side.
    """
    n = len(m.cap_area)
    scale = np.empty((n, 2))
    for j in range(n):
        scale[j, 0] = 1.0 / m.cap_area[j]
        scale[j, 1] = -1.0 / m.rod_area[j]
    return scale


@kernel(borrows=True)
def get_shared_flow(m: MachineArrays) -> float:
    """Return the flow that the main pump gives all cylinders together [m³/s].

    This is the main pump's largest flow minus the leakage of n valves.
    """
    return m.main_pump_flow - len(m.cap_area) * m.leakage_flow


@kernel
def compute_posture_area(m: MachineArrays, q: FloatArray, pattern: ModeArray) -> float:
    """Compute the area of the velocity polytope in a posture for one mode combination.

    The polytope contains all velocities of the tip that the pistons' limits allow.

    Args:
        m: Arrays of the machine.
        q: Posture, shape (n,) [rad or m].
        pattern: Mode of every joint, shape (n,).

    Returns:
        Area [m²/s²].
    """
    n = len(q)
    limit = np.empty((n, MODE_COUNT, 2))
    cross = np.empty((n, n))
    compute_flow_limits(m, q, limit)
    compute_cross_products(compute_tip_columns(m, q), cross)
    return compute_area_from_limits(
        cross, compute_flow_scale(m), limit, pattern, get_shared_flow(m)
    )


def compute_polytope_area(machine: Machine, q: FloatArray, pattern: ModeArray) -> float:
    """Compute the area of the velocity polytope in a posture for one mode combination.

    The polytope contains all velocities of the tip that the pistons' limits allow.

    Args:
        machine: The arm without a slewing joint.
        q: Posture, shape (n,) [rad or m].
        pattern: Mode code of every joint, shape (n,).

    Returns:
        Area [m²/s²].
    """
    return float(
        compute_posture_area(machine.arrays, np.array(q, dtype=np.float64), frozen(pattern))
    )


@kernel
def _compute_posture_areas(
    m: MachineArrays, posture: FloatArray, patterns: ModeArray, area: FloatArray
) -> None:
    """Compute the areas of the velocity polytopes of many postures in all mode combinations.

    Args:
        m: Arrays of the machine.
        posture: Postures, shape (k, n) [rad or m]. A posture of NaN gets areas of NaN.
        patterns: Mode combinations (one mode for each actuator), shape (patterns, n).
        area: Area by posture and mode combination, written in place, shape (k, patterns) [m²/s²].
    """
    n = posture.shape[1]
    limit = np.empty((n, MODE_COUNT, 2))
    cross = np.empty((n, n))
    scale = compute_flow_scale(m)
    flow = get_shared_flow(m)
    for i in range(len(posture)):
        if math.isnan(posture[i, 0]):
            area[i] = math.nan
            continue
        compute_flow_limits(m, posture[i], limit)
        compute_cross_products(compute_tip_columns(m, posture[i]), cross)
        for p in range(len(patterns)):
            area[i, p] = compute_area_from_limits(cross, scale, limit, patterns[p], flow)


def compute_all_polytope_areas(
    machine: Machine, posture: FloatArray, patterns: ModeArray
) -> FloatArray:
    """Compute the areas of the velocity polytopes of many postures in all mode combinations.

    Args:
        machine: The arm without a slewing joint.
        posture: Postures, shape (k, n) [rad or m].
        patterns: Mode combinations (one mode for each actuator), shape (patterns, n).

    Returns:
        Area by posture and mode combination, shape (k, patterns) [m²/s²]; NaN for a posture of NaN.
    """
    area = np.empty((len(posture), len(patterns)))
    _compute_posture_areas(machine.arrays, frozen(posture), frozen(patterns), area)
    return area


def list_piston_speed_corners(machine: Machine, q: FloatArray, pattern: ModeArray) -> FloatArray:
    """List the corners of the set of admissible piston speeds in a posture.

    The set is bounded by the flow limit of each joint and by the main pump's flow. A corner is
    given by the direction of every joint (2ⁿ choices) and the order in which the joints get flow
    (n! choices).

    Args:
        machine: The arm without a slewing joint.
        q: Posture, shape (n,) [rad or m].
        pattern: Mode of every joint, shape (n,).

    Returns:
        Piston speeds, positive in extension, shape (2ⁿ n!, n) [m/s]; some corners coincide.
    """
    q = np.array(q, dtype=np.float64)
    n = len(q)
    limit = np.empty((n, MODE_COUNT, 2))
    compute_flow_limits(machine.arrays, q, limit)
    scale = compute_flow_scale(machine.arrays)
    corners = []
    for direction in itertools.product((0, 1), repeat=n):
        for order in itertools.permutations(range(n)):
            rest = get_shared_flow(machine.arrays)
            speed = np.zeros(n)
            for j in order:
                taken = min(limit[j, pattern[j], direction[j]], rest)
                rest -= taken
                speed[j] = taken * scale[j, direction[j]]
            corners.append(speed)
    return np.array(corners)


def compute_polytope_vertices(machine: Machine, q: FloatArray, pattern: ModeArray) -> FloatArray:
    """Return the vertices of the velocity polytope in a posture, counter-clockwise.

    The polytope contains all velocities of the tip that the pistons' limits allow. It is the convex
    hull of the tip velocities that belong to the corners of the set of admissible piston speeds.

    Args:
        machine: The arm without a slewing joint.
        q: Posture, shape (n,) [rad or m].
        pattern: Mode of every joint, shape (n,).

    Returns:
        Tip velocities (ẋ, ż), shape (vertices, 2) [m/s].
    """
    columns = compute_tip_columns(machine.arrays, np.array(q, dtype=np.float64))
    return _convex_hull(list_piston_speed_corners(machine, q, pattern) @ columns.T)


def _convex_hull(points: FloatArray) -> FloatArray:
    """Return the convex hull of points in the plane, by Andrew's monotone chain.

    Args:
        points: Points, shape (k, 2).

    Returns:
        Vertices, counter-clockwise, shape (vertices, 2), without points on an edge between two
        vertices.
    """
    ordered = sorted({(float(x), float(y)) for x, y in points})

    def half_hull(sequence: list[tuple[float, float]]) -> list[tuple[float, float]]:
        """Return one half of the hull over sorted points, without its last point.

        Args:
            sequence: Points in ascending order for the lower half, descending for the upper half.

        Returns:
            Vertices at which the hull turns left.
        """
        kept: list[tuple[float, float]] = []
        for p in sequence:
            while len(kept) > 1 and not _turns_left(kept[-2], kept[-1], p):
                kept.pop()
            kept.append(p)
        return kept[:-1]

    return np.array(half_hull(ordered) + half_hull(ordered[::-1]))


def _turns_left(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Return whether the way from point a over b to c turns left by more than rounding."""
    cross = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return cross > 1e-12 * math.dist(a, b) * math.dist(a, c)
