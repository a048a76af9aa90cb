"""Lattices in the space of cylinder lengths, evenly spaced in lengths or in joint positions.

A lattice covers the whole ranges of the joints, and the start is one of its points. A step leads to
one of the 3ⁿ − 1 neighbours, along the axes and all diagonals.

If the spacing is equal for all cylinders, some path over the lattice has the strokes of the
straight move, and about its duration. It costs hardly more if no cylinder needs boost. With
obstacles the lattice is even in the joint positions instead, with smaller angles for inner joints.
Each step then moves the arm about equally far. With equal spacing in lengths it would not: one
millimetre of some cylinders moves the tip by 40 mm.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length, find_joint_angle
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, IntArray, frozen

NO_POINT = -1
"""Number that stands for no lattice point."""

LENGTH_ROUNDING = 1e-9
"""Rounding error allowed when a goal's cylinder length is compared with lattice lengths [m]."""

END_POINT_TOLERANCE = 0.05
"""Distance by which the last lattice point may miss the end of a joint's range, as a share of the
spacing.
"""


class Lattice(NamedTuple):
    """Points at all combinations of given lengths of each cylinder, numbered in row-major order.

    Attributes:
        shape: Number of lengths of each cylinder, shape (n,).
        stride: Change of the point number for one step along each cylinder, shape (n,).
        start: Number of the start point.
        length: Lattice lengths of each cylinder, shape (n, longest) [m]; shorter rows are padded
            with 0.
        angle: Position of the joint at each lattice length, shape (n, longest) [rad or m].
        moves: Steps to the neighbours as changes of the lattice indices, each −1, 0 or 1, shape (3ⁿ
            − 1, n).
    """

    shape: IntArray
    stride: IntArray
    start: int
    length: FloatArray
    angle: FloatArray
    moves: IntArray


def lattice_even_in_lengths(machine: Machine, posture: FloatArray, spacing: float) -> Lattice:
    """Create a lattice of cylinder lengths with the same spacing for all cylinders.

    From the start posture on, neighbouring lattice lengths have the distance `spacing`. The lengths
    at the joint limits are added, so the outermost distances may be shorter.

    Args:
        machine: The arm without a slewing joint.
        posture: Start posture, which becomes a lattice point, shape (n,) [rad or m].
        spacing: Distance of two lattice lengths [m].

    Returns:
        The lattice.
    """
    axes = []
    for j, angle in enumerate(posture):
        linkage, low, high = machine.arrays.linkage[j], *_joint_limits(machine, j)
        one, other = cylinder_length(linkage, low), cylinder_length(linkage, high)
        here = cylinder_length(linkage, angle)
        length, first = _evenly_spaced(here, min(one, other), max(one, other), spacing)
        axes.append((length, _invert_lengths(linkage, length, low, high, first, angle), first))
    return _assemble_lattice(axes)


def lattice_even_in_angles(machine: Machine, posture: FloatArray, reach: float) -> Lattice:
    """Create a lattice of cylinder lengths that is evenly spaced in the joint positions.

    The spacing of a turning joint [rad] is `reach` divided by the length of the stretched arm
    beyond it. Inner joints thus make smaller steps. For a telescope it is `reach` itself [m]. The
    joint limits are added as lattice positions, so the outermost distances may be shorter.

    Args:
        machine: The arm without a slewing joint.
        posture: Start posture, which becomes a lattice point, shape (n,) [rad or m].
        reach: Largest distance that any part of the arm moves if one joint makes one step [m].

    Returns:
        The lattice.
    """
    a = machine.arrays
    longest = a.link_length + np.where(a.slides, a.joint_max, 0.0)
    axes, beyond = [], np.where(a.slides, 1.0, np.cumsum(longest[::-1])[::-1])
    for j, angle in enumerate(posture):
        angles, first = _evenly_spaced(angle, *_joint_limits(machine, j), reach / beyond[j])
        linkage = machine.arrays.linkage[j]
        axes.append((np.array([cylinder_length(linkage, q) for q in angles]), angles, first))
    return _assemble_lattice(axes)


def _assemble_lattice(axes: list[tuple[FloatArray, FloatArray, int]]) -> Lattice:
    """Assemble a lattice from the points along each axis.

    Args:
        axes: For each cylinder its lattice lengths [m], the joint position at each of them [rad or
            m], and the index of the start's length.

    Returns:
        The lattice.
    """
    lengths, angles, first = zip(*axes, strict=True)
    shape = np.array([len(length) for length in lengths])
    stride = np.append(np.cumprod(shape[:0:-1])[::-1], 1)
    moves = [move for move in itertools.product((-1, 0, 1), repeat=len(shape)) if any(move)]
    return Lattice(
        frozen(shape),
        frozen(stride),
        int(stride @ np.array(first)),
        _stack_padded(lengths),
        _stack_padded(angles),
        frozen(np.array(moves)),
    )


def _evenly_spaced(here: float, low: float, high: float, spacing: float) -> tuple[FloatArray, int]:
    """List evenly spaced numbers through a value within a range, and add the range's ends.

    An end is not added if the outermost number is nearer to it than END_POINT_TOLERANCE · spacing.

    Args:
        here: Value from which the spacing counts; it is one of the numbers.
        low: Lower end of the range.
        high: Upper end of the range.
        spacing: Distance between two numbers.

    Returns:
        The numbers in ascending order, and the index of `here` among them.
    """
    below = max(0, math.floor((here - low) / spacing))
    above = max(0, math.floor((high - here) / spacing))
    numbers: FloatArray = here + spacing * np.arange(-below, above + 1, dtype=np.float64)
    if numbers[0] > low + END_POINT_TOLERANCE * spacing:
        numbers, below = np.append(low, numbers), below + 1
    if numbers[-1] < high - END_POINT_TOLERANCE * spacing:
        numbers = np.append(numbers, high)
    return numbers, below


@kernel
def _invert_lengths(
    linkage: FloatArray, length: FloatArray, low: float, high: float, first: int, angle: float
) -> FloatArray:
    """Compute the joint positions that belong to lattice lengths of one cylinder.

    The inversion goes outwards from a known position. Each result is the first guess for the next.

    Args:
        linkage: Numeric description of the linkage that turns cylinder length into joint position.
        length: Cylinder lengths in ascending order, shape (count,) [m].
        low: Lower joint limit [rad or m].
        high: Upper joint limit [rad or m].
        first: Index of the length whose joint position is known.
        angle: Joint position at `first` [rad or m].

    Returns:
        Joint position at each length, shape (count,) [rad or m].
    """
    angles = np.empty(len(length))
    angles[first] = angle
    for i in range(first + 1, len(length)):
        angles[i] = find_joint_angle(linkage, length[i], low, high, angles[i - 1])
    for i in range(first - 1, -1, -1):
        angles[i] = find_joint_angle(linkage, length[i], low, high, angles[i + 1])
    return angles


def _joint_limits(machine: Machine, j: int) -> tuple[float, float]:
    """Return the lower and upper limit of joint j [rad or m]."""
    return float(machine.arrays.joint_min[j]), float(machine.arrays.joint_max[j])


def _stack_padded(rows: tuple[FloatArray, ...]) -> FloatArray:
    """Stack arrays of different lengths as rows of one array, padded with 0.

    Args:
        rows: One-dimensional arrays.

    Returns:
        Read-only array, shape (number of rows, length of the longest).
    """
    filled = np.zeros((len(rows), max(len(row) for row in rows)))
    for i, row in enumerate(rows):
        filled[i, : len(row)] = row
    return frozen(filled)


@kernel(borrows=True, forceinline=True)
def find_neighbour(lattice: Lattice, at: IntArray, move: IntArray) -> int:
    """Return the number of a neighbour of a lattice point.

    Args:
        lattice: The lattice.
        at: Lattice indices of the point, shape (n,).
        move: Step to the neighbour in lattice indices, shape (n,).

    Returns:
        Number of the neighbour; NO_POINT if the step leads out of the lattice.
    """
    point = 0
    for j in range(len(at)):
        index = at[j] + move[j]
        if not 0 <= index < lattice.shape[j]:
            return NO_POINT
        point += index * lattice.stride[j]
    return point


@kernel(inline="always")
def is_around(lattice: Lattice, at: IntArray, goal: FloatArray) -> bool:
    """Return whether a goal posture lies within one lattice step of a lattice point.

    Args:
        lattice: The lattice.
        at: Lattice indices of the point, shape (n,).
        goal: Cylinder lengths of the goal posture, shape (n,) [m].

    Returns:
        True if every cylinder length of the goal lies between those of the point's two neighbours
        along this cylinder, ends included.
    """
    for j in range(len(at)):
        one = lattice.length[j, max(0, at[j] - 1)]
        other = lattice.length[j, min(lattice.shape[j] - 1, at[j] + 1)]
        if not min(one, other) - LENGTH_ROUNDING <= goal[j] <= max(one, other) + LENGTH_ROUNDING:
            return False
    return True
