"""Kinematics of chains in which some joints slide.

A prismatic joint j turns nothing, and puts the tip of its link Lⱼ + qⱼ beyond that of the link
before, along the direction θⱼ of both; its centre of mass lies cⱼ + qⱼ there. With the extensions
added to lengths and centres, and no angles for sliding joints, the chain at an instant is one of
rigid links, to which all that holds for revolute joints applies (`extended`, `turned`).
"""

from __future__ import annotations

import numpy as np

from mhsb_model import kinematics
from mhsb_model.arrays import MachineArrays
from mhsb_model.types import FloatArray, frozen

Slides = tuple[bool, ...]
"""Of each joint, whether it is prismatic."""


def turned(slides: Slides, q: FloatArray) -> FloatArray:
    """By how much each link is turned from the link before, float64[n] [rad]: 0 where it slides."""
    return np.where(slides, 0.0, q)


def extended(slides: Slides, rest: FloatArray, q: FloatArray) -> FloatArray:
    """`rest` float64[n] [m], lengths or centres at q = 0, with the extensions added [m]."""
    return frozen(rest + np.where(slides, q, 0.0))


def tip_jacobian(slides: Slides, link_length: FloatArray, q: FloatArray) -> FloatArray:
    """∂(x, z)/∂q, float64[2, n]: [m] of a joint that turns, (cos θⱼ, sin θⱼ) of one that slides."""
    angles = turned(slides, q)
    jacobian = kinematics.tip_jacobian(extended(slides, link_length, q), angles)
    heading, sliding = np.cumsum(angles), np.array(slides)
    jacobian[:, sliding] = np.cos(heading[sliding]), np.sin(heading[sliding])
    return np.array(jacobian)


def with_extensions_held(m: MachineArrays, slides: Slides, extension: FloatArray) -> MachineArrays:
    """The joints that turn, with telescopes held at `extension` float64[telescopes] [m].

    Each sliding part belongs to the link before. Lengths and limits alone are those of the shorter
    chain: what inverse kinematics needs.
    """
    length = extended(slides, m.link_length, _spread(slides, extension))
    turning = np.flatnonzero(~np.array(slides))
    return m._replace(
        link_length=frozen(np.add.reduceat(length, turning)),
        joint_min=frozen(m.joint_min[turning]),
        joint_max=frozen(m.joint_max[turning]),
    )


def with_extensions(slides: Slides, angles: FloatArray, extension: FloatArray) -> FloatArray:
    """Postures float64[k, n] of the angles float64[k, turning] with the extensions held [m]."""
    postures = np.tile(_spread(slides, extension), (len(angles), 1))
    postures[:, ~np.array(slides)] = angles
    return postures


def _spread(slides: Slides, extension: FloatArray) -> FloatArray:
    """The extensions at the joints that slide, 0 at the others, float64[n]."""
    q = np.zeros(len(slides))
    q[np.array(slides)] = extension
    return q


def extension_samples(m: MachineArrays, slides: Slides, samples: int) -> FloatArray:
    """Even samples of all telescopes, limits included, float64[samples ** telescopes, telescopes]
    [m]."""
    sliding = np.array(slides)
    ends = zip(m.joint_min[sliding], m.joint_max[sliding], strict=True)
    grids = np.meshgrid(*(np.linspace(*each, samples) for each in ends), indexing="ij")
    return np.stack([grid.ravel() for grid in grids], axis=-1)
