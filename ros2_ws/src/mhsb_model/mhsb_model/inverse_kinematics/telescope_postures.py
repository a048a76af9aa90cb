"""Postures with the tip at a point of chains in which some joints slide.

Where three joints turn or more, the telescopes' extensions are held, even samples of each, and the
rest is a chain of joints that turn, whose links are as much longer (`tip_postures.postures`). Where
two turn, the end link's angle ψ leaves them no freedom: of the last telescope the extension is what
closes the chain,

    |t − (D₂ + s) e(ψ)| = D₁,    or    |t − D₂ e(ψ)| = D₁ + s

where it slides beyond both joints that turn, or between them: t the tip, e(ψ) = (cos ψ, sin ψ), D₁
and D₂ the links' lengths before and from the second of them, without s.
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.closed_form_3r import within_limits, wrap_near
from mhsb_model.inverse_kinematics.tip_postures import INNER_SAMPLES, on_circle, postures
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, IntArray, frozen


def telescope_postures(m: MachineArrays, x: float, z: float, psi: FloatArray) -> FloatArray:
    """Postures within limits at (x, z) m for the end-link angles ψ [rad], float64[found, n].

    `INNER_SAMPLES` extensions of each telescope that is held, limits included.
    """
    turning, held = np.flatnonzero(~m.slides), np.flatnonzero(m.slides)
    closes = len(turning) == 2
    if closes:
        held = held[:-1]
    found = [np.empty((0, len(m.slides)))]
    for extension in extension_samples(m, held, INNER_SAMPLES):
        if closes:
            start = np.zeros(len(m.slides))
            start[held] = extension
            last = int(np.flatnonzero(m.slides)[-1])
            found.append(_closed_by_telescope(m, x, z, psi, start, int(turning[1]), last))
        else:
            angles = postures(with_extensions_held(m, extension), x, z, psi)
            whole = np.empty((len(angles), len(m.slides)))
            whole[:, held], whole[:, turning] = extension, angles
            found.append(whole)
    return np.concatenate(found)


@kernel
def _closed_by_telescope(
    m: MachineArrays, x: float, z: float, psi: FloatArray, start: FloatArray, j: int, p: int
) -> FloatArray:
    """Postures of a chain in which joints 1 and j turn, with telescope p closing it for each ψ.

    start  float64[n], extensions of all other telescopes [m]
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
            q[:] = start
            if p > j:
                met, q[p] = on_circle(wx, wz, -ex, -ez, before * before, side)
                vx, vz = wx - q[p] * ex, wz - q[p] * ez
            else:
                met, q[p] = side > 0, math.hypot(wx, wz) - before
                vx, vz = wx, wz
            first = math.atan2(vz, vx)
            q[0] = wrap_near(first, 0.5 * (m.joint_min[0] + m.joint_max[0]))
            q[j] = wrap_near(angle - first, 0.5 * (m.joint_min[j] + m.joint_max[j]))
            if met and within_limits(m, q):
                count += 1
    return found[:count]


def with_extensions_held(m: MachineArrays, extension: FloatArray) -> MachineArrays:
    """The joints that turn, with telescopes held at `extension` float64[telescopes] [m].

    Each sliding part belongs to the link before. Lengths and limits alone are those of the shorter
    chain: what inverse kinematics needs.
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


def extension_samples(m: MachineArrays, held: IntArray, samples: int) -> FloatArray:
    """Even samples of the telescopes at joints `held`, limits included [m].

    float64[samples ** telescopes, telescopes]
    """
    ends = zip(m.joint_min[held], m.joint_max[held], strict=True)
    grids = np.meshgrid(*(np.linspace(*each, samples) for each in ends), indexing="ij")
    return np.stack([grid.ravel() for grid in grids], axis=-1) if len(held) else np.empty((1, 0))
