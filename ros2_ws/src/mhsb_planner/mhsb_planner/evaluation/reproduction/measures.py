"""What is measured of a discrete path to tell one behaviour from another."""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.modes import any_boosted
from mhsb_model.types import FloatArray
from mhsb_planner.posture.s1_polytope import polytope_area
from mhsb_planner.search.discrete_path import DiscretePath


def energy(path: DiscretePath) -> float:
    """Energy of the discrete path, reading `paper` [J]."""
    return float(path.energy.sum())


def duration(path: DiscretePath) -> float:
    """Duration of the discrete path [s]."""
    return float(path.duration.sum())


def normal_share(path: DiscretePath, begin: float = 0.0, end: float = 1.0) -> float:
    """Share of the time in which no actuator is boosted [-], between two shares of the duration."""
    return _share(path, ~any_boosted(path.modes), begin, end)


def mode_share(path: DiscretePath, mode: int, begin: float = 0.0, end: float = 1.0) -> float:
    """Share of the time in which some actuator is in a mode [-], likewise."""
    return _share(path, (path.modes == mode).any(axis=1), begin, end)


def _share(path: DiscretePath, steps: np.ndarray, begin: float, end: float) -> float:
    edges = np.clip(path.time / path.time[-1], begin, end)
    return float(np.diff(edges)[steps].sum() / (end - begin))


def path_ratio(path: DiscretePath, spacing: float) -> float:
    """Length of the path over that of the shortest one of straight and diagonal moves [-]."""
    across, along = sorted(np.abs(path.tip[-1] - path.tip[0]))
    shortest = along - across + math.sqrt(2.0) * across
    return path.length / max(float(shortest), spacing)


def folding(path: DiscretePath) -> float:
    """How far the tip comes inside both ends of its path, towards the base [m]."""
    return float(path.tip[[0, -1], 0].min() - path.tip[:, 0].min())


def bulge(path: DiscretePath) -> float:
    """How far the tip goes beyond both ends of its path, away from the base [m]."""
    return float(path.tip[:, 0].max() - path.tip[[0, -1], 0].max())


def sideways(path: DiscretePath) -> float:
    """Largest distance of the tip from the straight line between start and goal [m]."""
    along = path.tip[-1] - path.tip[0]
    offset = path.tip - path.tip[0]
    cross = offset[:, 0] * along[1] - offset[:, 1] * along[0]
    return float(np.abs(cross).max() / np.hypot(*along))


def joint_travel(path: DiscretePath, joint: int) -> float:
    """Sum of a joint's changes along the path [rad]."""
    return float(np.abs(np.diff(path.posture[:, joint])).sum())


def polytope_profile(machine: Machine, path: DiscretePath) -> FloatArray:
    """Area of the velocity polytope at the end of each step, in its modes, float64[k] [m²/s²]."""
    return np.array(
        [
            polytope_area(machine, q, modes)
            for q, modes in zip(path.posture[1:], path.modes, strict=True)
        ]
    )
