"""Posture of largest velocity polytope of any chain (paper, step S1).

With the tip held, n − 2 angles are free. Wherever a maximum lies, in the midst of the postures or
with some joints at their limits, two joints close the chain (`tip_postures.close_chain`) and the
others take values within a box: so all pairs are taken in turn, the others sampled evenly, limits
included. From the best samples, merged where they lie together, and from the best of the postures
that are already found under other patterns, the area is then ascended along the curves on which
three joints move and the others rest; a joint that would pass its limit is put there. Curves
through a posture at limits lie in these limits, so that the ascent slides along them.

What share of entries may have been missed is told by SLSQP from many starts (`s1_judge`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.inverse_kinematics.closed_form_3r import within_limits
from mhsb_model.inverse_kinematics.tip_postures import close_chain, side_of
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import extended, radians, tip_jacobian, turned
from mhsb_model.linkages.linkage import moment_arm
from mhsb_model.modes import MODE_COUNT
from mhsb_model.statics import gravity_torque
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.posture.s1_polytope import (
    cross_products,
    flow_limit,
    flow_limits,
    flow_scale,
    projected_area,
    shared_flow,
    tip_columns,
)

SOLUTIONS = 1500
"""Chains that are closed at one tip position, at most; half of them or more are beyond limits."""

STARTS, FURTHER_STARTS = 3, 2
"""Samples from which the area is ascended under the first pattern, and under others beside the best
of the postures that are already found."""

APART = 0.35
"""Samples of which no joint differs by more are one start [rad]."""

FIRST_STRIDE, LAST_STRIDE = 0.1, 1e-6
"""Of the ascent [rad]."""

NEAR_STRIDE = 0.025
"""The first from another pattern's posture [rad]."""

ROUGH_STRIDE = 2e-3
"""To which all starts are ascended; the best is to the end."""

SAME_AREA = 1e-9
"""A relative gain in area below this is none."""


@kernel
def _samples(m: MachineArrays, x: float, z: float, found: FloatArray) -> int:
    """Postures within limits at (x, z) m, to found[:, n]; their number.

    Two joints close the chain; of each other as many even samples as `SOLUTIONS` allow.
    """
    n = len(m.link_length)
    each = max(2, int((SOLUTIONS / (n * (n - 1))) ** (1.0 / (n - 2))))
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
                        and within_limits(m, q)
                    ):
                        found[count] = q
                        count += 1
    return count


class _Work(NamedTuple):
    """Working memory of areas, beside what is the same in all postures."""

    unit: FloatArray  # [n], see `kinematics.radians`
    scale: FloatArray  # [n, 2], see `s1_polytope.projected_area`
    flow: float  # m³/s
    force: FloatArray  # [n]
    cross: FloatArray  # [n, n]
    limit: FloatArray  # [n, modes, 2]


@kernel
def _area(m: MachineArrays, q: FloatArray, pattern: ModeArray, w: _Work) -> float:
    """`s1_polytope.posture_area`, its oracle, with the limits of the pattern's modes alone."""
    gravity_torque(m, q, w.force)
    columns = tip_jacobian(m, q)
    for j in range(len(q)):
        arm = moment_arm(m.linkage[j], q[j])
        columns[0, j] /= arm
        columns[1, j] /= arm
        w.limit[j, pattern[j]] = flow_limit(m, j, pattern[j], w.force[j] / arm)
    cross_products(columns, w.cross)
    return projected_area(w.cross, w.scale, w.limit, pattern, w.flow)


@kernel
def _slide(
    m: MachineArrays,
    x: float,
    z: float,
    q: FloatArray,
    moved: FloatArray,
    driver: int,
    i: int,
    j: int,
    stride: float,
) -> bool:
    """The posture with one joint moved by a stride [rad or m] and two others closing the chain, to
    moved[n].

    A joint that would pass its limit stays there, and where it is one of the two that close the
    chain it leads instead. False where that is not possible either.
    """
    n = len(q)
    side = side_of(m, q, i, j)
    moved[:] = q
    moved[driver] = min(m.joint_max[driver], max(m.joint_min[driver], q[driver] + stride))
    if moved[driver] == q[driver] or not close_chain(m, x, z, i, j, side, moved):
        return False
    if within_limits(m, moved):
        return True
    for k in range(n):
        beyond = min(m.joint_max[k], max(m.joint_min[k], moved[k]))
        if beyond == moved[k]:
            continue
        other = j if k == i else i
        first, second = min(driver, other), max(driver, other)
        if beyond == q[k]:
            return False
        side = side_of(m, q, first, second)
        moved[:] = q
        moved[k] = beyond
        return close_chain(m, x, z, first, second, side, moved) and within_limits(m, moved)
    return False


@kernel
def _ascend(
    m: MachineArrays,
    x: float,
    z: float,
    pattern: ModeArray,
    w: _Work,
    q: FloatArray,
    area: float,
    stride: float,
    last: float,
) -> float:
    """Ascend from the posture q, in place, by ever shorter strides down to `last` [rad]; its area.

    A stride is how far the joint turns that turns farthest of three that move: the rates at which
    the tip rests are the areas that the other two's columns of the Jacobian span. Those of joints
    that slide are by their units.
    """
    n = len(q)
    moved, best = np.empty(n), np.empty(n)
    ahead, up, unit = np.empty(n), np.empty(n), w.unit
    while stride >= last:
        heading, tx, tz = 0.0, 0.0, 0.0
        for k in range(n):  # offsets of the tip from each joint, that is the columns turned
            heading += turned(m.turns, q, k)
            along, across = math.cos(heading), math.sin(heading)
            if m.slides[k]:
                ahead[k], up[k] = across * unit[k], -along * unit[k]
            else:
                ahead[k], up[k] = x - tx, z - tz
            length = extended(m.slides, m.link_length, q, k)
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
                        driver, i, j = a, b, c
                    elif rb >= rc:
                        driver, i, j = b, a, c
                    else:
                        driver, i, j = c, a, b
                    for sign in (-1.0, 1.0):
                        if _slide(m, x, z, q, moved, driver, i, j, sign * stride * unit[driver]):
                            there = _area(m, moved, pattern, w)
                            if there > gained * (1.0 + SAME_AREA):
                                gained = there
                                best[:] = moved
        if gained > area:
            area = gained
            q[:] = best
        else:
            stride *= 0.5
    return area


@kernel
def _leave_out(
    sample: FloatArray, value: FloatArray, posture: FloatArray, unit: FloatArray
) -> None:
    """Give samples that lie together with a posture a value below all areas."""
    for s in range(len(value)):
        if np.max(np.abs(sample[s] - posture) / unit) <= APART:
            value[s] = -1.0


@kernel
def _best_known(
    m: MachineArrays,
    pattern: ModeArray,
    w: _Work,
    known: FloatArray,
    best: float,
    q: FloatArray,
) -> float:
    """The largest area of known[k, n], where it exceeds `best`, whose posture is put into q[n]."""
    for posture in known:
        area = _area(m, posture, pattern, w)
        if area > best:
            best = area
            q[:] = posture
    return best


@kernel
def largest_polytopes_of_chain(
    m: MachineArrays,
    x: float,
    z: float,
    patterns: ModeArray,
    posture: FloatArray,
    area: FloatArray,
) -> bool:
    """Posture of largest polytope area at (x, z) m under each pattern, as far as it is found.

    Written to posture[patterns, n] [rad] and area[patterns] [m²/s²]. Returns False, with both
    NaN, where no posture is within limits. Oracle: SLSQP from many starts.
    """
    posture[:] = np.nan
    area[:] = np.nan
    n = len(m.link_length)
    sample = np.empty((SOLUTIONS, n))
    count = _samples(m, x, z, sample)
    if count == 0:
        return False
    w = _Work(
        radians(m),
        flow_scale(m),
        shared_flow(m),
        np.empty(n),
        np.empty((n, n)),
        np.empty((n, MODE_COUNT, 2)),
    )
    cross, limit = np.empty((count, n, n)), np.empty((count, n, MODE_COUNT, 2))
    for s in range(count):
        flow_limits(m, sample[s], limit[s])
        cross_products(tip_columns(m, sample[s]), cross[s])
    value, q = np.empty(count), np.empty(n)
    for p in range(len(patterns)):
        pattern = patterns[p]
        for s in range(count):
            value[s] = projected_area(cross[s], w.scale, limit[s], pattern, w.flow)
        best = _best_known(m, pattern, w, posture[:p], -1.0, posture[p])
        if p > 0:
            best = _ascend(m, x, z, pattern, w, posture[p], best, NEAR_STRIDE, ROUGH_STRIDE)
            _leave_out(sample, value, posture[p], w.unit)
        for _ in range(STARTS if p == 0 else FURTHER_STARTS):
            first = np.argmax(value)
            if value[first] < 0.0:
                break
            q[:] = sample[first]
            top = _ascend(m, x, z, pattern, w, q, value[first], FIRST_STRIDE, ROUGH_STRIDE)
            _leave_out(sample, value, sample[first], w.unit)
            _leave_out(sample, value, q, w.unit)
            if top > best * (1.0 + SAME_AREA):
                best = top
                posture[p] = q
        area[p] = best
    for p in range(len(patterns)):
        q[:] = posture[p]
        best = _best_known(m, patterns[p], w, posture, area[p], q)
        posture[p] = q
        area[p] = _ascend(m, x, z, patterns[p], w, posture[p], best, ROUGH_STRIDE, LAST_STRIDE)
    return True
