"""Area of the end-effector velocity polytope, the objective of the posture table.

Admissible piston speeds v of a posture under a mode pattern (paper, Section 2.1):

    −V_ret,j ≤ v_j ≤ V_ext,j                valve, and for boosted joints the servo pumps
    Σ_j A_dir,j |v_j| ≤ Q_MP − n q_leak     main pump, boosted flow included

with A_dir the cap area A in extension and the rod-side area a in retraction. The tip moves at
Σ_j C_j v_j, C_j = J_j / r_j, so the polytope is the image of that body under a 2×n matrix. A
boosted joint's valve limits are those at the highest boost pressure: what the mode can do. All
valves leak as at P_S, as the paper has it: areas compare postures; what a motion may take of the
main pump, boosted leakage included, is checked in S2 and S3.
Where the load exceeds even that, the joint moves one way only and the polytope stays defined;
as in the paper such a posture is not excluded here, its steps against the load are.
"""

from __future__ import annotations

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

APART = 1e-12


@kernel
def flow_limits(m: MachineArrays, q: FloatArray, limit: FloatArray) -> None:
    """Largest inlet flow of every joint, written to limit[n, mode, extension|retraction] [m³/s].

    N: A_dir v_valve(P_S); boosted: min(A_dir v_valve(p_boost), modules · Q_SP).
    """
    n = len(q)
    force = np.empty(n)
    piston_forces(m, q, force)
    for j in range(n):
        for mode in range(MODE_COUNT):
            limit[j, mode] = flow_limit(m, j, mode, force[j])


@kernel(borrows=True)
def flow_limit(m: MachineArrays, j: int, mode: int, force: float) -> tuple[float, float]:
    """Largest inlet flow of joint j in a mode under a force [N], extending, retracting [m³/s]."""
    oil, cap, rod = hydraulics.oil_of(m), m.cap_area[j], m.rod_area[j]
    k, tank, modules = m.valve_coefficient[j], m.tank_pressure, m.modules_per_mode[mode]
    supply = hydraulics.highest_supply(oil, modules)
    pumped = hydraulics.highest_flow(oil, modules)
    out = cap * hydraulics.extension_speed(k, cap, rod, supply, tank, force)
    back = rod * hydraulics.retraction_speed(k, cap, rod, supply, tank, force)
    return min(out, pumped), min(back, pumped)


@kernel
def tip_columns(m: MachineArrays, q: FloatArray) -> FloatArray:
    """C_j = J_j / r_j, tip velocity per piston speed, float64[2, n] [-]."""
    columns = kinematics.tip_jacobian(m, q)
    for j in range(len(q)):
        arm = moment_arm(m.linkage[j], q[j])
        columns[0, j] /= arm
        columns[1, j] /= arm
    return columns


@kernel
def cross_products(columns: FloatArray, cross: FloatArray) -> None:
    """C_i × C_j of all pairs of columns [-], written to cross[n, n], exactly antisymmetric.

    Each column is moved by its own few 10⁻¹² (`APART`), in different directions, so that joints
    that come in exactly equal order anywhere have one order, the same wherever it is asked for.
    """
    n = columns.shape[1]
    for i in range(n):
        cross[i, i] = 0.0
        xi, zi = columns[0, i] + APART * (i + 1), columns[1, i] + APART * (i + 1) ** 2
        for j in range(i + 1, n):
            xj, zj = columns[0, j] + APART * (j + 1), columns[1, j] + APART * (j + 1) ** 2
            cross[i, j] = xi * zj - zi * xj
            cross[j, i] = -cross[i, j]


@kernel
def projected_area(
    cross: FloatArray, scale: FloatArray, limit: FloatArray, pattern: ModeArray, flow: float
) -> float:
    """Area of the polytope, for any number of joints [m²/s²].

    cross    float64[n, n], C_i × C_j
    scale    float64[n, 2], piston speed per inlet flow: 1/A extending, −1/a retracting [1/m²]
    limit    float64[n, modes, 2], largest flow by mode and direction [m³/s]
    pattern  uint8[n], mode of every joint
    flow     what the main pump gives all joints together [m³/s]

    Around the boundary the flow is dealt out greedily, in the order of w_j = d·C_j scale_j for
    the outward normal d. An edge is where that order changes: one joint turns round (w_j = 0),
    or two joints trade flow (w_i = w_j > 0). With p a corner of the edge e, the area is
    ½ Σ |p × e|, in any order of the edges.
    Oracle: half-space intersection and convex hull.
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
                        if _above(cross, i, j, k, si, sj, scale[k, d], upright):
                            used = limit[k, pattern[k], d]
                            rest -= used
                            height += used * scale[k, d] * lever
                    if rest > 0.0:
                        traded = min(limit[i, pattern[i], di], rest)
                        traded += min(limit[j, pattern[j], dj], rest) - rest
                        if traded > 0.0:
                            twice += traded * abs(height + rest * weight)
    return 0.5 * twice


@kernel
def _above(
    cross: FloatArray, i: int, j: int, k: int, si: float, sj: float, sk: float, upright: bool
) -> bool:
    """Whether joint k comes before i and j where these two are equal: w_k > w_i = w_j; i < j.

    By the orientation of the three points C s, summed in the order of their indices so that all
    three pairs of one triple decide alike.
    """
    ij, jk, ki = si * sj * cross[i, j], sj * sk * cross[j, k], sk * si * cross[k, i]
    if k > j:
        left_turn = (ij + jk) + ki >= 0.0
    elif k > i:
        left_turn = ((-ki) + (-jk)) + (-ij) < 0.0
    else:
        left_turn = (ki + ij) + jk >= 0.0
    return left_turn != upright


@kernel
def flow_scale(m: MachineArrays) -> FloatArray:
    """Piston speed per inlet flow, float64[n, 2]: 1/A extending, −1/a retracting [1/m²]."""
    n = len(m.cap_area)
    scale = np.empty((n, 2))
    for j in range(n):
        scale[j, 0] = 1.0 / m.cap_area[j]
        scale[j, 1] = -1.0 / m.rod_area[j]
    return scale


@kernel(borrows=True)
def shared_flow(m: MachineArrays) -> float:
    """Q_MP − n q_leak: what the main pump gives all cylinders together [m³/s]."""
    return m.main_pump_flow - len(m.cap_area) * m.leakage_flow


@kernel
def posture_area(m: MachineArrays, q: FloatArray, pattern: ModeArray) -> float:
    """Kernel of `polytope_area`."""
    n = len(q)
    limit = np.empty((n, MODE_COUNT, 2))
    cross = np.empty((n, n))
    flow_limits(m, q, limit)
    cross_products(tip_columns(m, q), cross)
    return projected_area(cross, flow_scale(m), limit, pattern, shared_flow(m))


def polytope_area(machine: Machine, q: FloatArray, pattern: ModeArray) -> float:
    """Area of the end-effector velocity polytope in posture q [rad] under a pattern [m²/s²]."""
    return float(posture_area(machine.arrays, np.array(q, dtype=np.float64), frozen(pattern)))


@kernel
def _posture_areas(
    m: MachineArrays, posture: FloatArray, patterns: ModeArray, area: FloatArray
) -> None:
    n = posture.shape[1]
    limit = np.empty((n, MODE_COUNT, 2))
    cross = np.empty((n, n))
    scale = flow_scale(m)
    flow = shared_flow(m)
    for i in range(len(posture)):
        if math.isnan(posture[i, 0]):
            area[i] = math.nan
            continue
        flow_limits(m, posture[i], limit)
        cross_products(tip_columns(m, posture[i]), cross)
        for p in range(len(patterns)):
            area[i, p] = projected_area(cross, scale, limit, patterns[p], flow)


def polytope_areas(machine: Machine, posture: FloatArray, patterns: ModeArray) -> FloatArray:
    """Areas of `posture` float64[k, n] [rad] under each pattern, float64[k, patterns] [m²/s²].

    NaN for a posture that is not a number.
    """
    area = np.empty((len(posture), len(patterns)))
    _posture_areas(machine.arrays, frozen(posture), frozen(patterns), area)
    return area


def piston_speed_corners(machine: Machine, q: FloatArray, pattern: ModeArray) -> FloatArray:
    """Corners of the body of admissible piston speeds in posture q [rad], float64[corners, n] m/s.

    One for each of the 2ⁿ orthants and the n! orders in which the joints take flow; some coincide.
    """
    q = np.array(q, dtype=np.float64)
    n = len(q)
    limit = np.empty((n, MODE_COUNT, 2))
    flow_limits(machine.arrays, q, limit)
    scale = flow_scale(machine.arrays)
    corners = []
    for direction in itertools.product((0, 1), repeat=n):
        for order in itertools.permutations(range(n)):
            rest = shared_flow(machine.arrays)
            speed = np.zeros(n)
            for j in order:
                taken = min(limit[j, pattern[j], direction[j]], rest)
                rest -= taken
                speed[j] = taken * scale[j, direction[j]]
            corners.append(speed)
    return np.array(corners)


def polytope_vertices(machine: Machine, q: FloatArray, pattern: ModeArray) -> FloatArray:
    """Corners of the polytope, counter-clockwise, float64[corners, 2] (ẋ, ż) [m/s].

    The hull of C v over the corners of the body of admissible piston speeds.
    """
    columns = tip_columns(machine.arrays, np.array(q, dtype=np.float64))
    return _hull(piston_speed_corners(machine, q, pattern) @ columns.T)


def _hull(points: FloatArray) -> FloatArray:
    """Convex hull of points in the plane, counter-clockwise (Andrew's monotone chain)."""
    ordered = sorted({(float(x), float(y)) for x, y in points})

    def chain(sequence: list[tuple[float, float]]) -> list[tuple[float, float]]:
        kept: list[tuple[float, float]] = []
        for p in sequence:
            while len(kept) > 1 and not _turns_left(kept[-2], kept[-1], p):
                kept.pop()
            kept.append(p)
        return kept[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))


def _turns_left(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    cross = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return cross > 1e-12 * math.dist(a, b) * math.dist(a, c)


def warm_up(machine: Machine) -> None:
    """Compile the kernels of this module."""
    polytope_area(machine, machine.arrays.joint_min, machine.patterns[0])
