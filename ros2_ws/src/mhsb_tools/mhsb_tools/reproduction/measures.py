"""Numbers that show whether a discrete path is direct, folded, boosted or economical."""

import math

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.modes import any_boosted
from mhsb_model.types import FloatArray
from mhsb_planner.posture.s1_polytope import compute_polytope_area
from mhsb_planner.search.discrete_path import DiscretePath


def energy(path: DiscretePath) -> float:
    """Return the energy of the discrete path, reading `paper` [J]."""
    return float(path.energy.sum())


def duration(path: DiscretePath) -> float:
    """Return the duration of the discrete path [s]."""
    return float(path.duration.sum())


def normal_share(path: DiscretePath, begin: float = 0.0, end: float = 1.0) -> float:
    """Return the share of time in which all actuators are in mode N (fed by the main pump).

    Args:
        path: The path.
        begin: Beginning of the part of the path that counts, as a share of the path's duration.
        end: End of this part, as a share of the path's duration.

    Returns:
        Share of this part's duration, 0 … 1.
    """
    return _share(path, ~any_boosted(path.modes), begin, end)


def mode_share(path: DiscretePath, mode: int, begin: float = 0.0, end: float = 1.0) -> float:
    """Return the share of time in which at least one actuator is in a mode.

    Args:
        path: The path.
        mode: Code of the mode.
        begin: Beginning of the part of the path that counts, as a share of the path's duration.
        end: End of this part, as a share of the path's duration.

    Returns:
        Share of this part's duration, 0 … 1.
    """
    return _share(path, (path.modes == mode).any(axis=1), begin, end)


def _share(path: DiscretePath, steps: np.ndarray, begin: float, end: float) -> float:
    """Return the share of time that chosen steps take in a part of a path.

    Args:
        path: The path. Only `time` is read.
        steps: Whether each step is chosen, bool, shape (steps,).
        begin: Beginning of the part, as a share of the path's duration.
        end: End of the part, as a share of the path's duration.

    Returns:
        Time of the chosen steps within the part, divided by the part's duration, 0 … 1.
    """
    edges = np.clip(path.time / path.time[-1], begin, end)
    return float(np.diff(edges)[steps].sum() / (end - begin))


def path_ratio(path: DiscretePath, spacing: float) -> float:
    """Return the length of the tip's path divided by the length of the shortest grid path.

    The shortest grid path joins the same ends by straight and diagonal moves. Its length counts as
    at least `spacing`.

    Args:
        path: The path; the tip's path is the polygon through its waypoints.
        spacing: Spacing of the grid [m].

    Returns:
        The ratio. It is 1 for a shortest path on the grid, and 0 for a path without steps. A path
        off the grid may have a little less than 1.
    """
    across, along = sorted(np.abs(path.tip[-1] - path.tip[0]))
    shortest = along - across + math.sqrt(2.0) * across
    return path.length / max(float(shortest), spacing)


def folding(path: DiscretePath) -> float:
    """Return how far the tip comes inside both ends of its path, towards the base in x [m]."""
    return float(path.tip[[0, -1], 0].min() - path.tip[:, 0].min())


def bulge(path: DiscretePath) -> float:
    """Return how far the tip goes beyond both ends of its path, away from the base in x [m]."""
    return float(path.tip[:, 0].max() - path.tip[[0, -1], 0].max())


def sideways(path: DiscretePath) -> float:
    """Return the tip's largest distance from the straight line through start and goal.

    Args:
        path: The path; start and goal must differ. Only `tip` is read.

    Returns:
        The distance [m].
    """
    along = path.tip[-1] - path.tip[0]
    offset = path.tip - path.tip[0]
    cross = offset[:, 0] * along[1] - offset[:, 1] * along[0]
    return float(np.abs(cross).max() / np.hypot(*along))


def joint_travel(path: DiscretePath, joint: int) -> float:
    """Return the sum of a joint's absolute changes along the path [rad]; `joint` counts from 0."""
    return float(np.abs(np.diff(path.posture[:, joint])).sum())


def compute_polytope_profile(machine: Machine, path: DiscretePath) -> FloatArray:
    """Compute the area of the velocity polytope at the end of each step of a path.

    The velocity polytope is the set of tip velocities that the pistons' speed limits allow. It is
    computed with the modes of the step.

    Args:
        machine: The arm.
        path: The path of k steps.

    Returns:
        Areas [m²/s²], shape (k,).
    """
    return np.array(
        [
            compute_polytope_area(machine, q, modes)
            for q, modes in zip(path.posture[1:], path.modes, strict=True)
        ]
    )
