"""Postures with the tip at a point of chains in which some joints slide.

With their extensions held, the rest is a chain of joints that turn, whose links are as much longer:
extensions are sampled, and for each of them that chain's postures are in `tip_postures`.
"""

from __future__ import annotations

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.tip_postures import (
    INNER_SAMPLES,
    postures,
    two_joint_postures,
)
from mhsb_model.types import FloatArray, frozen


def telescope_postures(m: MachineArrays, x: float, z: float, psi: FloatArray) -> FloatArray:
    """Postures within limits at (x, z) m, float64[found, n].

    `INNER_SAMPLES` extensions of each telescope, limits included. Where two joints turn, these
    close the chain in closed form, and ψ follows; where more do, ψ is one of `psi` [rad].
    """
    found = [np.empty((0, len(m.slides)))]
    for extension in extension_samples(m, INNER_SAMPLES):
        held = with_extensions_held(m, extension)
        if len(held.link_length) == 2:
            angles = two_joint_postures(held, x, z)
        else:
            angles = postures(held, x, z, psi)
        found.append(_with_extensions(m, angles, extension))
    return np.concatenate(found)


def with_extensions_held(m: MachineArrays, extension: FloatArray) -> MachineArrays:
    """The joints that turn, with telescopes held at `extension` float64[telescopes] [m].

    Each sliding part belongs to the link before. Lengths and limits alone are those of the shorter
    chain: what inverse kinematics needs.
    """
    length, turning = np.array(m.link_length), np.flatnonzero(~m.slides)
    length[m.slides] += extension
    return m._replace(
        slides=frozen(m.slides[turning]),
        link_length=frozen(np.add.reduceat(length, turning)),
        joint_min=frozen(m.joint_min[turning]),
        joint_max=frozen(m.joint_max[turning]),
    )


def extension_samples(m: MachineArrays, samples: int) -> FloatArray:
    """Even samples of all telescopes, limits included, float64[samples ** telescopes, telescopes]
    [m]."""
    ends = zip(m.joint_min[m.slides], m.joint_max[m.slides], strict=True)
    grids = np.meshgrid(*(np.linspace(*each, samples) for each in ends), indexing="ij")
    return np.stack([grid.ravel() for grid in grids], axis=-1)


def _with_extensions(m: MachineArrays, angles: FloatArray, extension: FloatArray) -> FloatArray:
    """Postures float64[k, n] of the angles float64[k, turning] with the extensions held [m]."""
    found = np.empty((len(angles), len(m.slides)))
    found[:, m.slides], found[:, ~m.slides] = extension, angles
    return found
