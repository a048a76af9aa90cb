"""Linkages: cylinder length and moment arm as functions of the joint angle.

A linkage is one row of `LINKAGE_WIDTH` numbers with its kind first, so that kernels can take the
linkages of all joints as one array. The moment arm is r = dL/dq, so τ = r F and the piston speed is
r q̇. r is negative if extension turns the joint in the negative direction.

The equations are in `slider_crank` and `four_bar`. A `LINEAR_LINKAGE` has L = L₀ + r q. It
describes the cylinder of a telescope, with q in m and r = 1, and the drive of a slew, with the
pitch radius r.
"""

import math

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages import four_bar, slider_crank
from mhsb_model.schema import Direct, FourBar, Linkage, SliderCrank
from mhsb_model.types import FloatArray

SLIDER_CRANK = 0.0
FOUR_BAR = 1.0
LINEAR_LINKAGE = 2.0
"""Kinds of linkages, the first number of a row."""

LINKAGE_WIDTH = 10
"""Length of a row: the kind and the numbers of a four-bar; other kinds leave the rest at zero."""

LAST_STEP = 1e-7
"""Step length below which Newton's method has converged [rad or m]."""


def build_linkage_row(linkage: Linkage, lower: float = 0.0) -> FloatArray:
    """Return the numbers of a linkage in the form in which kernels take them.

    A slew is described as a cylinder whose length changes by the pitch radius per rad. The cylinder
    of a telescope is as long as its retracted length plus the extension.

    Args:
        linkage: Linkage of a machine file.
        lower: Lower limit of a slew [rad]. The slew's cylinder length is set to 0 m at this angle.
            Other linkages ignore it.

    Returns:
        float64[LINKAGE_WIDTH]: the kind of linkage, then its numbers, filled up with zeros.
    """
    if isinstance(linkage, SliderCrank):
        numbers = [SLIDER_CRANK, *slider_crank.list_row_numbers(linkage)]
    elif isinstance(linkage, FourBar):
        numbers = [FOUR_BAR, *four_bar.list_row_numbers(linkage)]
    elif isinstance(linkage, Direct):
        numbers = [LINEAR_LINKAGE, linkage.retracted_length, 1.0]
    else:
        radius = linkage.pitch_radius
        numbers = [LINEAR_LINKAGE, -radius * lower, radius]
    row = np.zeros(LINKAGE_WIDTH)
    row[: len(numbers)] = numbers
    return row


@kernel(borrows=True, forceinline=True, reads=True)
def evaluate_linkage(linkage: FloatArray, q: float) -> tuple[float, float, float]:
    """Compute cylinder length, moment arm and the slope of the moment arm at a joint position.

    Args:
        linkage: Numbers of the linkage, from `build_linkage_row`, float64[LINKAGE_WIDTH].
        q: Joint angle [rad], or extension of a telescope [m].

    Returns:
        Cylinder length L [m], moment arm r = dL/dq [m], and dr/dq [m/rad]. For a telescope r is 1
        [-] and dr/dq is 0; for a slew r is constant and dr/dq is 0.
    """
    if linkage[0] == LINEAR_LINKAGE:
        return linkage[1] + linkage[2] * q, linkage[2], 0.0
    return evaluate_linkage_at_cosine(linkage, math.cos(q), math.sin(q))


@kernel(borrows=True, forceinline=True, reads=True)
def evaluate_linkage_at_cosine(
    linkage: FloatArray, cosine: float, sine: float
) -> tuple[float, float, float]:
    """Compute cylinder length, moment arm and its slope from cosine and sine of the angle.

    The linkage must be a slider-crank or a four-bar; the result for telescopes and slews would be
    wrong. If cosine and sine are known already, this is faster than `evaluate_linkage`.

    Args:
        linkage: Numbers of the linkage, from `build_linkage_row`, float64[LINKAGE_WIDTH].
        cosine: cos q.
        sine: sin q.

    Returns:
        Cylinder length L [m], moment arm r = dL/dq [m], and dr/dq [m/rad].
    """
    if linkage[0] == FOUR_BAR:
        _, _, length, arm, slope = four_bar.evaluate_four_bar(linkage, cosine, sine)
        return length, arm, slope
    return slider_crank.evaluate_slider_crank(linkage, cosine, sine)


@kernel(borrows=True, reads=True)
def cylinder_length(linkage: FloatArray, q: float) -> float:
    """Return the cylinder length L between the pins [m] at a joint position q [rad or m]."""
    return evaluate_linkage(linkage, q)[0]


@kernel
def cylinder_lengths(linkages: FloatArray, postures: FloatArray) -> FloatArray:
    """Compute the lengths of all cylinders in k postures.

    Args:
        linkages: Row of each joint's linkage, shape (n, LINKAGE_WIDTH).
        postures: Joint positions, shape (k, n) [rad or m].

    Returns:
        Cylinder lengths, shape (k, n) [m].
    """
    lengths = np.empty(postures.shape)
    for k in range(len(postures)):
        for j in range(postures.shape[1]):
            lengths[k, j] = cylinder_length(linkages[j], postures[k, j])
    return lengths


@kernel(borrows=True, reads=True)
def moment_arm(linkage: FloatArray, q: float) -> float:
    """Return the moment arm r = dL/dq [m] at a joint position q [rad or m]; 1 for a telescope."""
    return evaluate_linkage(linkage, q)[1]


@kernel
def evaluate_linkage_at_angles(linkage: FloatArray, angles: FloatArray) -> FloatArray:
    """Compute cylinder length, moment arm and its slope at several joint positions.

    Args:
        linkage: Numbers of the linkage, from `build_linkage_row`, float64[LINKAGE_WIDTH].
        angles: Joint angles [rad], or extensions of a telescope [m], float64[k].

    Returns:
        float64[k, 3] with the columns cylinder length L [m], moment arm r = dL/dq [m], and dr/dq
        [m/rad]. Where a four-bar cannot be assembled, the numbers are finite and mean nothing.
    """
    found = np.empty((len(angles), 3))
    for k in range(len(angles)):
        found[k, 0], found[k, 1], found[k, 2] = evaluate_linkage(linkage, angles[k])
    return found


@kernel(borrows=True, reads=True)
def find_joint_angle(
    linkage: FloatArray, length: float, lower: float, upper: float, guess: float
) -> float:
    """Find the joint position at which the cylinder has a given length.

    The moment arm must keep its sign between the limits, so there is at most one such position.
    Newton's method starts from `guess`. If a step leaves the interval in which the solution must
    lie, the interval is halved instead. The last step has a length d < LAST_STEP; the remaining
    error is about d² r′/(2r), with the moment arm r and its slope r′.

    Args:
        linkage: Numbers of the linkage, from `build_linkage_row`, float64[LINKAGE_WIDTH].
        length: Cylinder length [m].
        lower: Lower limit of the joint [rad], or [m] for a telescope.
        upper: Upper limit of the joint [rad or m].
        guess: First estimate, limited to lower … upper [rad or m].

    Returns:
        Joint position [rad or m]. If no position within the limits has this length, the result is
        the limit whose length is nearer.
    """
    q = min(upper, max(lower, guess))
    below, above = lower - 1.0, upper + 1.0
    for _ in range(100):
        reached, arm, _ = evaluate_linkage(linkage, q)
        step = (length - reached) / arm
        moved = min(upper, max(lower, q + step))
        if abs(moved - q) < LAST_STEP:
            return moved
        if step > 0.0:
            below = q
        else:
            above = q
        if not below < moved < above:
            moved = 0.5 * (max(below, lower) + min(above, upper))
        q = moved
    return q


def moment_arm_range(linkage: FloatArray, lower: float, upper: float) -> tuple[float, float]:
    """Return the least and the largest moment arm, with their signs, within the joint limits.

    The search is over a grid of positions at most 0.1° apart, or 1.7 mm for a telescope.

    Args:
        linkage: Numbers of the linkage, from `build_linkage_row`, float64[LINKAGE_WIDTH].
        lower: Lower limit of the joint [rad or m].
        upper: Upper limit of the joint [rad or m].

    Returns:
        Least and largest moment arm r = dL/dq [m].
    """
    arms = evaluate_linkage_at_angles(linkage, angle_grid(lower, upper))[:, 1]
    return float(arms.min()), float(arms.max())


def angle_grid(lower: float, upper: float) -> FloatArray:
    """Return evenly spaced angles between two limits, both included, at most 0.1° apart.

    For a telescope these are extensions, at most 1.7 mm apart.

    Args:
        lower: First angle [rad], or extension [m].
        upper: Last angle [rad], or extension [m].

    Returns:
        float64[k] with k ≥ 2 [rad or m].
    """
    return np.linspace(lower, upper, max(2, math.ceil(math.degrees(upper - lower) * 10) + 1))
