"""Postures with the tip at a point, for chains in which some joints slide (telescopes).

With three or more revolute joints, each telescope is held at evenly spaced extensions. What remains
is a chain of revolute joints with longer links (`tip_postures.find_postures`). With two revolute
joints, a given end-link angle ψ determines both joint angles, and the extension s of the last
telescope closes the chain:

    |t − (D₂ + s) e(ψ)| = D₁ if it slides beyond both revolute joints |t − D₂ e(ψ)| = D₁ + s if it
    slides between them

with the tip t, e(ψ) = (cos ψ, sin ψ), and the lengths D₁ and D₂ of the links before and from the
second revolute joint, without s.

All functions work in the arm's plane, with the origin at its first joint. For an arm that slews,
they take the arrays of `Machine.planar_arm`, which leave out the slew.
"""

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.closed_form_3r import is_within_limits, wrap_near
from mhsb_model.inverse_kinematics.tip_postures import (
    INNER_SAMPLES,
    find_postures,
    intersect_line_with_circle,
)
from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, IntArray, frozen


def find_telescope_postures(m: MachineArrays, x: float, z: float, psi: FloatArray) -> FloatArray:
    """Find postures within limits for a tip position and given end-link angles, with telescopes.

    Each telescope's extension takes INNER_SAMPLES evenly spaced values from limit to limit, in all
    combinations. There are two special cases. If only two joints are revolute, the last telescope
    is not sampled: its extension follows from the tip position. If more than three joints are
    revolute, the angles of all but the last three are also sampled. So the result is complete only
    with two revolute joints and one telescope, since nothing is sampled then.

    Args:
        m: Planar machine (without a slewing joint), with at least one telescope.
        x: Tip position forward [m].
        z: Tip position up [m].
        psi: End-link angles ψ to look at (sums of all revolute joint angles), float64[k], [rad].

    Returns:
        Postures in a new array, float64[found, n], [rad or m]; not aligned with `psi`.
    """
    turning, held = np.flatnonzero(~m.slides), np.flatnonzero(m.slides)
    closes = len(turning) == 2
    if closes:
        held = held[:-1]
    found = [np.empty((0, len(m.slides)))]
    for extension in sample_extensions(m, held, INNER_SAMPLES):
        if closes:
            start = np.zeros(len(m.slides))
            start[held] = extension
            last = int(np.flatnonzero(m.slides)[-1])
            found.append(
                _find_postures_closed_by_telescope(m, x, z, psi, start, int(turning[1]), last)
            )
        else:
            angles = find_postures(hold_extensions(m, extension), x, z, psi)
            whole = np.empty((len(angles), len(m.slides)))
            whole[:, held], whole[:, turning] = extension, angles
            found.append(whole)
    return np.concatenate(found)


@kernel
def _find_postures_closed_by_telescope(
    m: MachineArrays,
    x: float,
    z: float,
    psi: FloatArray,
    start: FloatArray,
    j: int,
    closing_telescope: int,
) -> FloatArray:
    """Find postures of a chain that has two revolute joints and is closed by a telescope.

    For each end-link angle ψ the extension of this telescope follows from the tip position. There
    are up to two solutions if the telescope is beyond both revolute joints, otherwise up to one.
    Solutions beyond the joint limits are left out. The first revolute joint has the index 0.

    Args:
        m: Planar machine (without a slewing joint).
        x: Tip position forward [m].
        z: Tip position up [m].
        psi: End-link angles ψ to look at, float64[k], [rad].
        start: Extensions of all other telescopes, 0 for all other joints, float64[n], [m].
        j: Index of the second revolute joint.
        closing_telescope: Index of the telescope that closes the chain.

    Returns:
        Postures within limits, float64[found, n], [rad or m], in the order of `psi`.
    """
    before = beyond = 0.0
    for k in range(len(start)):
        length = m.link_length[k] + start[k]
        if k < j:
            before += length
        else:
            beyond += length
    found, count = np.empty((2 * len(psi), len(start))), 0
    for angle in psi:
        ex, ez = math.cos(angle), math.sin(angle)
        wx, wz = x - beyond * ex, z - beyond * ez
        for side in (-1, 1):
            q = found[count]
            copy_row(q, start)
            if closing_telescope > j:
                is_reached, q[closing_telescope] = intersect_line_with_circle(
                    wx, wz, -ex, -ez, before * before, side
                )
                vx, vz = wx - q[closing_telescope] * ex, wz - q[closing_telescope] * ez
            else:
                is_reached, q[closing_telescope] = side > 0, math.hypot(wx, wz) - before
                vx, vz = wx, wz
            first = math.atan2(vz, vx)
            q[0] = wrap_near(first, 0.5 * (m.joint_min[0] + m.joint_max[0]))
            q[j] = wrap_near(angle - first, 0.5 * (m.joint_min[j] + m.joint_max[j]))
            if is_reached and is_within_limits(m, q):
                count += 1
    return found[:count]


def hold_extensions(m: MachineArrays, extension: FloatArray) -> MachineArrays:
    """Return the chain of revolute joints that is left if all telescopes are held.

    Each telescope becomes a part of the link before. The fields `turns`, `slides`, `link_length`,
    `joint_min` and `joint_max`, which inverse kinematics reads, belong to the shorter chain. All
    other fields still belong to the whole chain.

    Args:
        m: Planar machine (without a slewing joint).
        extension: Extension of each telescope in joint order, float64[telescopes], [m].

    Returns:
        Machine arrays of the shorter chain.
    """
    length, turning = np.array(m.link_length), np.flatnonzero(~m.slides)
    length[m.slides] += extension
    return m._replace(
        turns=frozen(m.turns[turning]),
        slides=frozen(m.slides[turning]),
        link_length=frozen(np.add.reduceat(length, turning)),
        joint_min=frozen(m.joint_min[turning]),
        joint_max=frozen(m.joint_max[turning]),
    )


def sample_extensions(m: MachineArrays, held: IntArray, samples: int) -> FloatArray:
    """Return all combinations of evenly spaced extensions of the given telescopes.

    Args:
        m: Machine with the joint limits.
        held: Indices of the telescopes, int64[telescopes].
        samples: Number of extensions of each telescope, from limit to limit.

    Returns:
        One combination per row, float64[samples ** telescopes, telescopes], [m]. The last
        telescope's extension changes fastest. If `held` is empty, one row without columns.
    """
    ends = zip(m.joint_min[held], m.joint_max[held], strict=True)
    grids = np.meshgrid(*(np.linspace(*each, samples) for each in ends), indexing="ij")
    return np.stack([grid.ravel() for grid in grids], axis=-1) if len(held) else np.empty((1, 0))
