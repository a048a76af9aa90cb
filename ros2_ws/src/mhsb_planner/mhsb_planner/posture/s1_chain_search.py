"""Posture with the largest velocity polytope for a chain of any kind (paper, step S1).

If the tip is held, n − 2 of the n joint coordinates are free. The positions of the other two joints
follow from these and from the tip position: the two joints close the chain
(`tip_postures.close_chain`). At a maximum, some joints may be at their limits. Therefore every pair
of joints closes the chain in turn, and the other joints are sampled evenly, limits included.

A local ascent of the area begins at the best samples, and at the best postures already found for
other mode combinations. Samples near to each other count as one. In each step of the ascent, three
joints move and the others rest. A joint that would pass its limit is put on the limit, and the
ascent continues along the limit.

`s1_judge` estimates the share of table entries whose maximum is missed, with SLSQP from many
starts.
"""

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.closed_form_3r import is_within_limits
from mhsb_model.inverse_kinematics.tip_postures import close_chain, find_closure_side
from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import (
    add_extension,
    compute_radian_equivalents,
    get_turn_angle,
    tip_jacobian,
)
from mhsb_model.linkages.linkage import moment_arm
from mhsb_model.modes import MODE_COUNT
from mhsb_model.statics import gravity_torque
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.posture.s1_polytope import (
    compute_area_from_limits,
    compute_cross_products,
    compute_flow_limit,
    compute_flow_limits,
    compute_flow_scale,
    compute_tip_columns,
    get_shared_flow,
)

MAX_CLOSED_CHAINS = 1500
"""Largest number of samples at one tip position."""

FIRST_PATTERN_STARTS, OTHER_PATTERN_STARTS = 3, 2
"""Number of samples at which an ascent begins, for the first mode combination and for each other
one.

For the other combinations, an ascent also begins at the best posture already found."""

MIN_START_DISTANCE = 0.35
"""Largest joint difference of two samples that count as one starting point [rad]."""

ROUGH_STRIDES, NEAR_STRIDES, FINE_STRIDES = (0.1, 2e-3), (0.025, 2e-3), (2e-3, 1e-6)
"""First and last stride of an ascent [rad], for three kinds of starting points.

The kinds are a sample, the posture of another mode combination, and the best posture found from
these two."""

SAME_AREA = 1e-9
"""Largest relative difference of two areas that count as equal [-]."""


@kernel
def _sample_postures(m: MachineArrays, x: float, z: float, found: FloatArray) -> int:
    """Sample postures within joint limits at a tip position.

    Each pair of joints in turn brings the tip to the position, in up to two ways. The other joints
    take evenly spaced values, limits included, as densely as MAX_CLOSED_CHAINS allows.

    Args:
        m: Arrays of the machine.
        x: Tip position forward [m].
        z: Tip position upward [m].
        found: Postures, shape (MAX_CLOSED_CHAINS, n) [rad or m]. Written in place.

    Returns:
        Number of postures written; further rows of `found` are undefined.
    """
    n = len(m.link_length)
    each = max(2, int((MAX_CLOSED_CHAINS / (n * (n - 1))) ** (1.0 / (n - 2))))
    q, count = np.empty(n), 0
    for i in range(n):
        for j in range(i + 1, n):
            for number in range(each ** (n - 2)):
                for side in (-1, 1):
                    rest = number
                    for k in range(n):
                        if k != i and k != j:
                            share = (rest % each) / (each - 1)
                            rest //= each
                            q[k] = (1.0 - share) * m.joint_min[k] + share * m.joint_max[k]
                    if (
                        count < len(found)
                        and close_chain(m, x, z, i, j, side, q)
                        and is_within_limits(m, q)
                    ):
                        copy_row(found[count], q)
                        count += 1
    return count


class _AreaBuffers(NamedTuple):
    """Working memory for polytope areas, and constants that all postures share.

    Attributes:
        unit: Joint motion that counts as much as 1 rad, shape (n,): 1 rad for a turning joint, a
            length [m] for a sliding joint. See `kinematics.compute_radian_equivalents`.
        scale: Piston speed per inlet flow, extending and retracting, shape (n, 2) [1/m²]. See
            `s1_polytope.compute_flow_scale`.
        flow: Flow that the main pump gives all cylinders together [m³/s].
        force: Working memory: joint torques under gravity, shape (n,) [N m or N].
        cross: Working memory: cross products C_i × C_j of the tip velocities per piston speed,
            shape (n, n) [-].
        limit: Working memory: largest inlet flow of each joint by mode and direction (0 extends, 1
            retracts), shape (n, modes, 2) [m³/s].
    """

    unit: FloatArray
    scale: FloatArray
    flow: float
    force: FloatArray
    cross: FloatArray
    limit: FloatArray


@kernel
def _compute_area(m: MachineArrays, q: FloatArray, pattern: ModeArray, w: _AreaBuffers) -> float:
    """Compute the area of the velocity polytope in a posture for one mode combination.

    The polytope contains all velocities of the tip that the pistons' limits allow. If a load is too
    heavy for the actuator's mode, the piston can only move with the load. The function is faster
    than `s1_polytope.compute_posture_area`, which gives the same area.

    Args:
        m: Arrays of the machine.
        q: Posture, shape (n,) [rad or m].
        pattern: Mode combination (one mode for each actuator), shape (n,).
        w: Working memory; `force`, `cross` and `limit` are overwritten.

    Returns:
        Area [m²/s²].
    """
    gravity_torque(m, q, w.force)
    columns = tip_jacobian(m, q)
    for j in range(len(q)):
        arm = moment_arm(m.linkage[j], q[j])
        columns[0, j] /= arm
        columns[1, j] /= arm
        limit = w.limit[j, pattern[j]]  # assigned one by one for the reason in `kernels.copying`
        limit[0], limit[1] = compute_flow_limit(m, j, pattern[j], w.force[j] / arm)
    compute_cross_products(columns, w.cross)
    return compute_area_from_limits(w.cross, w.scale, w.limit, pattern, w.flow)


class _JointTriple(NamedTuple):
    """Indices of three joints that move together so that the tip stays in place.

    Attributes:
        driver: Joint that moves by a given stride.
        first: First of the two joints that keep the tip in place.
        second: Second of the two joints that keep the tip in place; its index is above `first`.
    """

    driver: int
    first: int
    second: int


@kernel
def _move_with_fixed_tip(
    m: MachineArrays,
    tip: tuple[float, float],
    q: FloatArray,
    moved: FloatArray,
    triple: _JointTriple,
    stride: float,
) -> bool:
    """Move one joint by a stride while two other joints keep the tip in place.

    The moving joint, the driver, stops at its limits. If one of the two other joints would pass its
    limit, it is put on this limit. The driver and the remaining joint then keep the tip in place,
    so that the driver does not move by the stride.

    Args:
        m: Arrays of the machine.
        tip: Tip position (x, z) [m].
        q: Posture, shape (n,) [rad or m].
        moved: New posture, shape (n,) [rad or m]. Written in place.
        triple: Indices of the driver and of the two other joints.
        stride: Signed stride of the driver [rad or m].

    Returns:
        True if the move is possible. False if it leads to no other posture within limits; `moved`
        is then undefined.
    """
    n, x, z = len(q), tip[0], tip[1]
    driver, i, j = triple
    side = find_closure_side(m, q, i, j)
    copy_row(moved, q)
    moved[driver] = min(m.joint_max[driver], max(m.joint_min[driver], q[driver] + stride))
    if moved[driver] == q[driver] or not close_chain(m, x, z, i, j, side, moved):
        return False
    if is_within_limits(m, moved):
        return True
    for k in range(n):
        beyond = min(m.joint_max[k], max(m.joint_min[k], moved[k]))
        if beyond == moved[k]:
            continue
        other = j if k == i else i
        first, second = min(driver, other), max(driver, other)
        if beyond == q[k]:
            return False
        side = find_closure_side(m, q, first, second)
        copy_row(moved, q)
        moved[k] = beyond
        return close_chain(m, x, z, first, second, side, moved) and is_within_limits(m, moved)
    return False


@kernel
def _ascend_area(
    m: MachineArrays,
    tip: tuple[float, float],
    pattern: ModeArray,
    w: _AreaBuffers,
    q: FloatArray,
    area: float,
    strides: tuple[float, float],
) -> float:
    """Increase the velocity polytope's area by moving joints while the tip stays in place.

    Each iteration tries all triples of joints in both directions. In each triple, the joint that
    has to move most is moved by the stride, and the other two joints keep the tip in place. The
    move that gives the largest area is made. If no move increases the area, the stride is halved.

    Args:
        m: Arrays of the machine.
        tip: Tip position (x, z) [m].
        pattern: Mode combination (one mode for each actuator), shape (n,).
        w: Working memory, overwritten.
        q: Posture, changed in place, shape (n,) [rad or m].
        area: Area in the posture q [m²/s²].
        strides: First stride, and stride below which the ascent ends [rad]. For a sliding
            joint, the stride is multiplied by the joint's `w.unit` [m/rad].

    Returns:
        Area in the final posture [m²/s²].
    """
    n = len(q)
    moved, best = np.empty(n), np.empty(n)
    ahead, up, unit = np.empty(n), np.empty(n), w.unit
    stride, last = strides
    while stride >= last:
        heading, tx, tz = 0.0, 0.0, 0.0
        for k in range(n):  # Jacobian columns turned by 90°: tip less joint
            heading += get_turn_angle(m.turns, q, k)
            along, across = math.cos(heading), math.sin(heading)
            if m.slides[k]:
                ahead[k], up[k] = across * unit[k], -along * unit[k]
            else:
                ahead[k], up[k] = tip[0] - tx, tip[1] - tz
            length = add_extension(m.slides, m.link_length, q, k)
            tx += length * along
            tz += length * across
        gained = area
        for a in range(n):
            for b in range(a + 1, n):
                for c in range(b + 1, n):
                    ra = abs(ahead[b] * up[c] - up[b] * ahead[c])
                    rb = abs(ahead[a] * up[c] - up[a] * ahead[c])
                    rc = abs(ahead[a] * up[b] - up[a] * ahead[b])
                    if ra >= rb and ra >= rc:
                        triple = _JointTriple(a, b, c)
                    elif rb >= rc:
                        triple = _JointTriple(b, a, c)
                    else:
                        triple = _JointTriple(c, a, b)
                    for sign in (-1.0, 1.0):
                        turn = sign * stride * unit[triple.driver]
                        if _move_with_fixed_tip(m, tip, q, moved, triple, turn):
                            there = _compute_area(m, moved, pattern, w)
                            if there > gained * (1.0 + SAME_AREA):
                                gained = there
                                copy_row(best, moved)
        if gained > area:
            area = gained
            copy_row(q, best)
        else:
            stride *= 0.5
    return area


@kernel
def _exclude_samples(
    sample: FloatArray, value: FloatArray, posture: FloatArray, unit: FloatArray
) -> None:
    """Set to −1 the areas of all samples close to a posture, so that no ascent begins there.

    A sample is close if no joint differs by more than MIN_START_DISTANCE times the joint's unit.

    Args:
        sample: Sampled postures, shape (count, n) [rad or m].
        value: Area of the velocity polytope at each sample, shape (count,) [m²/s²]. Written in
            place.
        posture: Posture to compare with, shape (n,) [rad or m].
        unit: Unit of each joint, shape (n,): 1 rad for a turning joint, a length [m] for a sliding
            joint.
    """
    for s in range(len(value)):
        is_close = True
        for j in range(len(posture)):
            distance = abs(sample[s, j] - posture[j]) / unit[j]
            is_close = is_close and distance <= MIN_START_DISTANCE
        if is_close:
            value[s] = -1.0


@kernel
def _find_best_known(
    m: MachineArrays,
    pattern: ModeArray,
    w: _AreaBuffers,
    known: FloatArray,
    best: float,
    q: FloatArray,
) -> float:
    """Find the posture with the largest velocity polytope among given postures.

    Args:
        m: Arrays of the machine.
        pattern: Mode combination (one mode for each actuator), shape (n,).
        w: Working memory, overwritten.
        known: Postures, shape (k, n) [rad or m].
        best: Area that must be exceeded [m²/s²].
        q: The posture found, shape (n,) [rad or m]. Written in place; unchanged if no area exceeds
            `best`.

    Returns:
        The largest area, at least `best` [m²/s²].
    """
    for k in range(len(known)):
        area = _compute_area(m, known[k], pattern, w)
        if area > best:
            best = area
            copy_row(q, known[k])
    return best


@kernel
def find_largest_polytopes_of_chain(
    m: MachineArrays,
    x: float,
    z: float,
    patterns: ModeArray,
    posture: FloatArray,
    area: FloatArray,
) -> bool:
    """Find for each mode combination the posture with the largest velocity polytope.

    The polytope contains all velocities of the tip that the pistons' limits allow. The arm may have
    any number of turning and sliding joints. Postures are sampled once for all combinations. For
    each combination, a local ascent changes the joint positions as long as the area grows. It
    begins at the best samples, and at the best postures of other combinations. The search may miss
    the largest area.

    Tested against SLSQP from many starts.

    Args:
        m: Arrays of the machine.
        x: Tip position forward [m].
        z: Tip position upward [m].
        patterns: Mode combinations (one mode for each actuator), shape (patterns, n).
        posture: Posture for each mode combination, written in place, shape (patterns, n) [rad or
            m].
        area: Area of the velocity polytope of each posture, written in place, shape (patterns,)
            [m²/s²].

    Returns:
        False if no posture is within joint limits; `posture` and `area` then stay as they are.
    """
    n = len(m.link_length)
    sample = np.empty((MAX_CLOSED_CHAINS, n))
    count = _sample_postures(m, x, z, sample)
    if count == 0:
        return False
    w = _AreaBuffers(
        compute_radian_equivalents(m),
        compute_flow_scale(m),
        get_shared_flow(m),
        np.empty(n),
        np.empty((n, n)),
        np.empty((n, MODE_COUNT, 2)),
    )
    cross, limit = np.empty((count, n, n)), np.empty((count, n, MODE_COUNT, 2))
    for s in range(count):
        compute_flow_limits(m, sample[s], limit[s])
        compute_cross_products(compute_tip_columns(m, sample[s]), cross[s])
    value, q = np.empty(count), np.empty(n)
    for p in range(len(patterns)):
        pattern = patterns[p]
        for s in range(count):
            value[s] = compute_area_from_limits(cross[s], w.scale, limit[s], pattern, w.flow)
        best = _find_best_known(m, pattern, w, posture[:p], -1.0, posture[p])
        if p > 0:
            best = _ascend_area(m, (x, z), pattern, w, posture[p], best, NEAR_STRIDES)
            _exclude_samples(sample, value, posture[p], w.unit)
        for _ in range(FIRST_PATTERN_STARTS if p == 0 else OTHER_PATTERN_STARTS):
            first = np.argmax(value)
            if value[first] < 0.0:
                break
            copy_row(q, sample[first])
            top = _ascend_area(m, (x, z), pattern, w, q, value[first], ROUGH_STRIDES)
            _exclude_samples(sample, value, sample[first], w.unit)
            _exclude_samples(sample, value, q, w.unit)
            if top > best * (1.0 + SAME_AREA):
                best = top
                copy_row(posture[p], q)
        area[p] = best
    for p in range(len(patterns)):
        copy_row(q, posture[p])
        best = _find_best_known(m, patterns[p], w, posture, area[p], q)
        copy_row(posture[p], q)
        area[p] = _ascend_area(m, (x, z), patterns[p], w, posture[p], best, FINE_STRIDES)
    return True
