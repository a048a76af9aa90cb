"""Check of a trajectory's curve: compare the extrema of each quintic piece with the limits.

A piece of duration h between the points (q₀, v₀, a₀) and (q₁, v₁, a₁) has, in Bernstein form over u
= t/h, the control values

    position      q₀, q₀ + v₀h/5, q₀ + 2v₀h/5 + a₀h²/20, and the same from the end with −h
    velocity      w₀ = v₀, w₁ = v₀ + a₀h/4, w₂ = 5(q₁ − q₀)/h − w₀ − w₁ − w₃ − w₄,
                  w₃ = v₁ − a₁h/4, w₄ = v₁
    acceleration  xᵢ = 4(wᵢ₊₁ − wᵢ)/h,   jerk  yᵢ = 3(xᵢ₊₁ − xᵢ)/h

A polynomial stays within the hull of its control values, so the control values are compared first.
If one exceeds a limit, the extrema are computed, which are at the ends and at the roots of the
derivative. The roots of a quadratic have a closed form. A cubic or quartic is monotone between two
neighbouring roots of its derivative. In each such interval, false position finds its root.

Source: Farin, Curves and Surfaces for CAGD, Chapter 5.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from mhsb_model.curve_limits import CurveLimits
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, JointMotion, Trajectory
from mhsb_model.types import FloatArray, IntArray

POSITION_TOLERANCE = 1e-5
"""Excess over a joint limit that is tolerated [rad, m].

A braking command samples its plan again every 20 ms. At a jump of the jerk by 1000 rad/s³, it
deviates from the plan's curve by this value."""

POSITION_ROUNDING = 8.0 * 2.0**-52
"""Relative error of a position in a message, from rounding and a few operations before it.

In a piece of duration h, a position error changes velocity, acceleration and jerk by 5/h, 20/h² and
120/h³ times this error."""

ROOT_STEPS = 60
"""Largest number of iterations of the root finder."""

ROOT_RESIDUE = 1e-10
"""Largest residual of a root, relative to the largest control value of the polynomial.

The error of the extremum is then about the square of this residual."""


class Quantity(IntEnum):
    """Limited quantity of a joint's motion."""

    POSITION = 0
    """Position [rad or m], limited below and above."""

    SPEED = 1
    """Magnitude of the velocity [rad/s or m/s]."""

    ACCELERATION = 2
    """Magnitude of the acceleration [rad/s² or m/s²]."""

    JERK = 3
    """Magnitude of the jerk [rad/s³ or m/s³]."""


# Kernels take plain integers.
_POSITION, _SPEED = int(Quantity.POSITION), int(Quantity.SPEED)
_ACCELERATION, _JERK = int(Quantity.ACCELERATION), int(Quantity.JERK)

EXCESS_ROW, VALUE_ROW, TIME_ROW = range(3)
"""Rows of the kernel's result: excess, value of the quantity, time after the first point [s].

The excess of a position is absolute [rad or m], that of the other quantities relative to the
limit."""


class QuinticPiece(NamedTuple):
    """Piece of one joint's curve: its time, and control values of position and derivatives.

    For a joint that slides, m takes the place of rad.
    """

    begin: float
    """Start of the piece, after the first point of the trajectory [s]."""

    duration: float
    """Duration of the piece [s]."""

    position: FloatArray
    """Control values of the position, float64[6], [rad]."""

    speed: FloatArray
    """Control values of the velocity, float64[5], [rad/s]."""

    acceleration: FloatArray
    """Control values of the acceleration, float64[4], [rad/s²]."""

    jerk: FloatArray
    """Control values of the jerk, float64[3], [rad/s³]."""


@dataclass(frozen=True)
class CurveExcess:
    """Worst excess of a curve over a limit."""

    quantity: Quantity
    """Quantity that exceeds its limit."""

    joint: int
    """Index of the joint, from 0."""

    time: float
    """Time after the trajectory's first point [s]."""

    value: float
    """Position [rad], or magnitude of speed [rad/s], acceleration [rad/s²] or jerk [rad/s³].

    The unit is m instead of rad if the joint slides. inf if the value overflows."""


def find_curve_excess(limits: CurveLimits, trajectory: Trajectory) -> CurveExcess | None:
    """Find where a trajectory's curve exceeds its limits most.

    Only the first quantity with an excess is reported, in the order position, speed, acceleration,
    jerk. A joint that begins outside its range may return to the range, but not move farther out on
    the way. Its limit is then, of all positions reached so far, the one nearest to the range.

    Args:
        limits: Limits of each joint.
        trajectory: Trajectory with the same joints as `limits`.

    Returns:
        The largest excess of the reported quantity over all joints and times. Positions are
        compared by the distance beyond the limit, other quantities by the ratio to the limit. None
        if the curve keeps all limits.
    """
    found = _compute_excesses(limits, trajectory)
    for quantity in Quantity:
        joint = int(np.argmax(found[EXCESS_ROW, quantity]))
        if found[EXCESS_ROW, quantity, joint] > 0.0:
            _, value, time = found[:, quantity, joint].tolist()
            return CurveExcess(quantity, joint, time, value)
    return None


def compute_slowing_factor(limits: CurveLimits, trajectory: Trajectory) -> float:
    """Compute the factor on a trajectory's duration that makes it keep its rate limits.

    The rate limits are the limits of speed, acceleration and jerk. With a duration k times as long,
    speeds fall to 1/k, accelerations to 1/k², and jerks to 1/k³. The result is the least k with
    which all three limits are kept. Position limits are not considered.

    Args:
        limits: Limits of each joint.
        trajectory: Trajectory with the same joints as `limits`.

    Returns:
        Factor k > 1; inf if the numbers overflow; 0 if the trajectory already keeps all three
        limits.
    """
    excess = _compute_excesses(limits, trajectory)[EXCESS_ROW].max(axis=1).tolist()
    powers = {Quantity.SPEED: 1, Quantity.ACCELERATION: 2, Quantity.JERK: 3}
    beyond = [(1.0 + excess[each]) ** (1.0 / n) for each, n in powers.items() if excess[each] > 0.0]
    return max(beyond, default=0.0)


def _compute_excesses(limits: CurveLimits, trajectory: Trajectory) -> FloatArray:
    """Compute the worst excess over the limits for each quantity and joint of a trajectory.

    The excess of a position is the distance beyond its limit [rad or m]. If a joint starts outside
    its range, its limit is, of all positions reached so far, the one nearest to the range. The
    excess of speed, acceleration and jerk is relative: |value|/limit − 1. It is inf if the numbers
    overflow.

    Args:
        limits: Limits of each joint.
        trajectory: Trajectory with n joints.

    Returns:
        float64[3, 4, n], indexed by row, `Quantity` and joint. The rows are EXCESS_ROW, VALUE_ROW
        (position, or magnitude of the quantity) and TIME_ROW (time after the first point [s]). All
        three are 0 if the limit is kept.
    """
    found = np.zeros((3, len(Quantity), trajectory.joint_count))
    _find_excesses(
        trajectory.offset_ns,
        trajectory.points,
        limits.lower,
        limits.upper,
        limits.rates,
        found,
    )
    return found


def describe_curve_problem(machine: Machine, trajectory: Trajectory) -> str | None:
    """Describe the worst excess of a trajectory over the limits of a machine.

    Args:
        machine: Machine whose `curve_limits` apply.
        trajectory: Trajectory to check.

    Returns:
        A clause that begins with "its trajectory" and names the joint, the time after the first
        point, the value and the limit. The value of a position is its distance beyond the joint's
        limits. None if the trajectory keeps all limits.
    """
    limits = machine.curve_limits
    excess = find_curve_excess(limits, trajectory)
    if excess is None:
        return None
    j, value, at = excess.joint, excess.value, f"{excess.time:.3f} s after its first point"
    name, unit = machine.joint_names[j], machine.joint_units[j]
    if excess.quantity is Quantity.POSITION:
        lower, upper = limits.lower[j], limits.upper[j]
        return (
            f"its trajectory takes {name} {max(lower - value, value - upper):.3g} {unit} beyond "
            f"its limits [{lower:.4g}, {upper:.4g}] {unit}, {at}"
        )
    if excess.quantity is Quantity.SPEED:
        return (
            f"its trajectory moves {name} at {value:.3g} {unit}/s, {at}; the main pump cannot "
            f"move it faster than {limits.speed[j]:.3g} {unit}/s"
        )
    if excess.quantity is Quantity.ACCELERATION:
        return (
            f"its trajectory accelerates {name} by {value:.3g} {unit}/s², {at}; pressures cannot "
            f"accelerate it by more than {limits.acceleration[j]:.3g} {unit}/s²"
        )
    return (
        f"its trajectory moves {name} with a jerk of {value:.3g} {unit}/s³, {at}; valves cannot "
        f"follow more than {limits.jerk[j]:.3g} {unit}/s³"
    )


@kernel
def _find_excesses(
    offset_ns: IntArray,
    points: JointMotion,
    lower: FloatArray,
    upper: FloatArray,
    rate_limits: FloatArray,
    excesses: FloatArray,
) -> None:
    """Find the worst excess of each quantity and joint, and write it into `excesses`.

    The exact extrema of each quintic piece between two points are compared with the limits. If the
    numbers of a piece overflow, the excess is inf. A joint that begins outside its range may return
    to the range, but not move farther out on the way. Its limit is then, of all points so far, the
    position nearest to the range.

    Tested against SciPy's BPoly.

    Args:
        offset_ns: Times of the points after the first one, int64[points], [ns].
        points: Motion of the n joints at the points.
        lower: Least position of each joint, float64[n], [rad or m].
        upper: Greatest position of each joint, float64[n], [rad or m].
        rate_limits: Limits of speed, acceleration and jerk (rows) of each joint, float64[3, n].
        excesses: Result, float64[3, 4, n], zeros before, written in place. The first index is
            EXCESS_ROW, VALUE_ROW or TIME_ROW, the second a `Quantity`, the third the joint.
            Elements stay 0 if the limit is kept.
    """
    position, velocity, acceleration = points
    place, speed, force, jerk = np.empty(6), np.empty(5), np.empty(4), np.empty(3)
    breaks = np.empty((3, 6))
    for j in range(position.shape[1]):
        worst, rates = excesses[:, :, j], rate_limits[:, j]
        low, high = position[0, j], position[0, j]
        for k in range(len(offset_ns) - 1):
            h = (offset_ns[k + 1] - offset_ns[k]) / SECOND_NS
            piece = QuinticPiece(offset_ns[k] / SECOND_NS, h, place, speed, force, jerk)
            low = min(lower[j], max(low, position[k, j]))
            high = max(upper[j], min(high, position[k, j]))
            _write_control_values(
                piece,
                (position[k, j], velocity[k, j], acceleration[k, j]),
                (position[k + 1, j], velocity[k + 1, j], acceleration[k + 1, j]),
            )
            if not _keeps_limits(piece, low, high, rates) and not _record_overflow(piece, worst):
                _check_piece(piece, breaks, low, high, rates, worst)


@kernel(borrows=True)
def _write_control_values(
    piece: QuinticPiece, start: tuple[float, float, float], end: tuple[float, float, float]
) -> None:
    """Write the Bernstein control values of one quintic piece and of its three derivatives.

    For a joint that slides, m takes the place of rad.

    Args:
        piece: Piece with its duration. Its control values are written in place.
        start: Position, velocity and acceleration at the start [rad, rad/s, rad/s²].
        end: Position, velocity and acceleration at the end [rad, rad/s, rad/s²].
    """
    (q0, v0, a0), (q1, v1, a1), h = start, end, piece.duration
    position, speed, acceleration, jerk = (
        piece.position,
        piece.speed,
        piece.acceleration,
        piece.jerk,
    )
    speed[0], speed[1], speed[3], speed[4] = v0, v0 + 0.25 * a0 * h, v1 - 0.25 * a1 * h, v1
    speed[2] = 5.0 * ((q1 - q0) / h) - (speed[0] + speed[1] + speed[3] + speed[4])
    acceleration[0], acceleration[3] = a0, a1
    acceleration[1], acceleration[2] = (
        4.0 * (speed[2] - speed[1]) / h,
        4.0 * (speed[3] - speed[2]) / h,
    )
    for i in range(3):
        jerk[i] = 3.0 * (acceleration[i + 1] - acceleration[i]) / h
    position[0], position[1], position[2] = (
        q0,
        q0 + 0.2 * h * v0,
        q0 + 0.2 * h * (speed[0] + speed[1]),
    )
    position[5], position[4], position[3] = (
        q1,
        q1 - 0.2 * h * v1,
        q1 - 0.2 * h * (speed[3] + speed[4]),
    )


@kernel(borrows=True)
def _keeps_limits(piece: QuinticPiece, low: float, high: float, rate_limits: FloatArray) -> bool:
    """Return whether the control values of a piece prove that it keeps all limits.

    Args:
        piece: Piece of the joint's curve.
        low: Lower limit of the position in this piece [rad or m].
        high: Upper limit of the position in this piece [rad or m].
        rate_limits: Limits of speed, acceleration and jerk of the joint, float64[3].

    Returns:
        True if all control values are finite, positions are within their limits, and the magnitudes
        of all other quantities are below their limits.
    """
    for value in piece.position:
        if not low <= value <= high:
            return False
    return (
        _find_largest_magnitude(piece.speed) < rate_limits[0]
        and _find_largest_magnitude(piece.acceleration) < rate_limits[1]
        and _find_largest_magnitude(piece.jerk) < rate_limits[2]
    )


@kernel(borrows=True)
def _record_overflow(piece: QuinticPiece, excesses: FloatArray) -> bool:
    """Record an excess of inf if the control values of a piece are infinite or nan.

    Speed, acceleration and jerk are checked in this order. Only the first of them that overflows
    gets the excess. Nothing is written if all control values are finite.

    Args:
        piece: Piece of the joint's curve.
        excesses: Worst excesses of the joint so far, float64[3, 4], written in place. The first
            index is EXCESS_ROW, VALUE_ROW or TIME_ROW, the second a `Quantity`.

    Returns:
        True if an excess of inf was written.
    """
    for quantity, values in (
        (_SPEED, piece.speed),
        (_ACCELERATION, piece.acceleration),
        (_JERK, piece.jerk),
    ):
        if not _find_largest_magnitude(values) < math.inf:
            _record_excess(excesses[:, quantity], math.inf, math.inf, piece.begin)
            return True
    return False


@kernel(borrows=True)
def _check_piece(
    piece: QuinticPiece,
    breaks: FloatArray,
    low: float,
    high: float,
    rate_limits: FloatArray,
    excesses: FloatArray,
) -> None:
    """Check one piece of a joint's curve against all limits, and record its excesses.

    The control values are compared first, since the curve stays between the least and the greatest
    of them. Extrema are computed only if a control value exceeds its limit. Each quantity has its
    extrema at the roots of its derivative. So the roots of jerk, acceleration and speed are found
    in this order. Between two neighbouring roots of its derivative, a quantity has at most one
    root.

    A position counts only if it is more than POSITION_TOLERANCE beyond its limit. The other
    quantities count only if rounding of the positions cannot be the cause.

    Args:
        piece: Piece of the joint's curve.
        breaks: Working memory for points u = 0 … 1 of the piece, float64[3, 6]; overwritten.
        low: Lower limit of the position in this piece [rad or m].
        high: Upper limit of the position in this piece [rad or m].
        rate_limits: Limits of speed, acceleration and jerk of the joint, float64[3].
        excesses: Worst excesses of the joint so far, float64[3, 4]. Overwritten where the piece has
            worse excesses. The first index is EXCESS_ROW, VALUE_ROW or TIME_ROW, the second a
            `Quantity`.
    """
    h, position, jerk = piece.duration, piece.position, piece.jerk
    rounding = POSITION_ROUNDING * max(1.0, abs(position[0]), abs(position[5]))
    beyond = False
    for control in position:
        beyond = beyond or control > high or control < low
    fast = _find_largest_magnitude(piece.speed) > rate_limits[0]
    if _find_largest_magnitude(jerk) > rate_limits[2]:
        count = _write_quadratic_extrema(jerk, breaks[0])
        slack = 120.0 * rounding / h**3
        _record_excesses_at(
            piece, jerk, breaks[0, :count], rate_limits[2], slack, excesses[:, _JERK]
        )
    if not (beyond or fast or _find_largest_magnitude(piece.acceleration) > rate_limits[1]):
        return
    count = _write_quadratic_roots(jerk, breaks[0])
    slack = 20.0 * rounding / h**2
    _record_excesses_at(
        piece,
        piece.acceleration,
        breaks[0, :count],
        rate_limits[1],
        slack,
        excesses[:, _ACCELERATION],
    )
    if not (beyond or fast):
        return
    count = _write_polynomial_roots(piece.acceleration, breaks[0, :count], breaks[1])
    slack = 5.0 * rounding / h
    _record_excesses_at(
        piece, piece.speed, breaks[1, :count], rate_limits[0], slack, excesses[:, _SPEED]
    )
    if not beyond:
        return
    count = _write_polynomial_roots(piece.speed, breaks[1, :count], breaks[2])
    for u in breaks[2, :count]:
        q = _evaluate_bernstein(position, u)
        excess = max(q - high, low - q)
        if excess > POSITION_TOLERANCE:
            _record_excess(excesses[:, _POSITION], excess, q, piece.begin + u * h)


@kernel(borrows=True)
def _record_excesses_at(
    piece: QuinticPiece,
    control: FloatArray,
    points: FloatArray,
    limit: float,
    slack: float,
    worst: FloatArray,
) -> None:
    """Record the excess of a quantity at given points of a piece if it is the worst so far.

    The quantity is speed, acceleration or jerk, and the excess is |value|/limit − 1. A value counts
    only if it exceeds the limit by more than `slack`.

    Args:
        piece: Piece of the joint's curve.
        control: Bernstein control values of the quantity.
        points: Points of the piece to look at, each u = 0 … 1.
        limit: Limit of the magnitude.
        slack: Excess that rounding may cause, in the unit of the limit.
        worst: Worst excess of the quantity so far, float64[3] in the order EXCESS_ROW, VALUE_ROW,
            TIME_ROW; written in place.
    """
    for u in points:
        reached = abs(_evaluate_bernstein(control, u))
        if reached > limit + slack:
            time = piece.begin + u * piece.duration
            _record_excess(worst, reached / limit - 1.0, reached, time)


@kernel(borrows=True)
def _record_excess(worst: FloatArray, excess: float, value: float, time: float) -> None:
    """Replace the worst excess by a new excess if the new one is larger.

    Args:
        worst: Worst excess of a quantity so far, float64[3] in the order EXCESS_ROW, VALUE_ROW,
            TIME_ROW; written in place.
        excess: New excess over the limit: absolute for a position, else relative to the limit.
        value: Position, or magnitude of the quantity.
        time: Time after the first point of the trajectory [s].
    """
    if excess > worst[EXCESS_ROW]:
        worst[EXCESS_ROW], worst[VALUE_ROW], worst[TIME_ROW] = excess, value, time


@kernel(borrows=True)
def _find_largest_magnitude(control: FloatArray) -> float:
    """Return the largest magnitude of some control values.

    Args:
        control: Values, float64[k].

    Returns:
        The largest magnitude; nan if one of the values is nan, 0 if there are none.
    """
    largest = 0.0
    for each in control:
        if not abs(each) <= largest:
            largest = abs(each)
            if math.isnan(largest):
                return largest
    return largest


@kernel(borrows=True)
def _evaluate_bernstein(control: FloatArray, u: float) -> float:
    """Evaluate a polynomial in Bernstein form.

    Args:
        control: Bernstein coefficients, shape (degree + 1,).
        u: Argument, 0 … 1.

    Returns:
        Value of the polynomial at u.

    Source:
        Farin, Curves and Surfaces for CAGD, Section 5.3 (nested multiplication).
    """
    degree, rest = len(control) - 1, 1.0 - u
    power, choices, total = 1.0, 1.0, control[0] * rest
    for i in range(1, degree):
        power *= u
        choices *= (degree - i + 1) / i
        total = (total + power * choices * control[i]) * rest
    return total + power * u * control[degree]


@kernel(borrows=True)
def _write_quadratic_extrema(control: FloatArray, points: FloatArray) -> int:
    """Write the points at which a quadratic can have its extrema on 0 … 1.

    These are 0, the vertex if it lies between 0 and 1, and 1.

    Args:
        control: Bernstein control values of the quadratic, float64[3].
        points: Result in ascending order, written in place; it needs 3 places.

    Returns:
        Number of values written, 2 or 3.
    """
    c0, c1, c2 = control[0], control[1], control[2]
    bend = (c0 - c1) - (c1 - c2)
    points[0], points[1] = 0.0, 1.0
    if (c0 - c1) * bend <= 0.0 or abs(c0 - c1) >= abs(bend):
        return 2
    points[1], points[2] = (c0 - c1) / bend, 1.0
    return 3


@kernel(borrows=True)
def _write_quadratic_roots(control: FloatArray, points: FloatArray) -> int:
    """Write the roots of a quadratic between 0 and 1, with a 0 before them and a 1 behind them.

    With t = u/(1 − u) the roots u follow from c₂t² + 2c₁t + c₀ = 0:

        t = p/c₂ and c₀/p,   p = −c₁ − sign(c₁) √(c₁² − c₀c₂)

    Args:
        control: Bernstein control values c₀, c₁, c₂ of the quadratic, float64[3].
        points: Result u in ascending order, written in place; it needs 4 places.

    Returns:
        Number of values written, 2 to 4.
    """
    points[0], points[1] = 0.0, 1.0
    scale = _find_largest_magnitude(control)
    if scale == 0.0:
        return 2
    c0, c1, c2 = control[0] / scale, control[1] / scale, control[2] / scale
    square = c1 * c1 - c0 * c2
    if square < 0.0:
        return 2
    p = -c1 - math.copysign(math.sqrt(square), c1)
    one = p / (p + c2) if p + c2 != 0.0 else -1.0
    other = c0 / (c0 + p) if c0 + p != 0.0 else -1.0
    count = 1
    for u in (min(one, other), max(one, other)):
        if 0.0 < u < 1.0:
            points[count] = u
            count += 1
    points[count] = 1.0
    return count + 1


@kernel(borrows=True)
def _write_polynomial_roots(control: FloatArray, breaks: FloatArray, points: FloatArray) -> int:
    """Write the roots of a polynomial between 0 and 1, with a 0 before them and a 1 behind them.

    Args:
        control: Bernstein control values of the polynomial.
        breaks: 0, the roots of the polynomial's derivative in ascending order, and 1. Between two
            neighbours the polynomial is monotone, so it has at most one root there. A root is found
            only if the sign changes between them.
        points: Result in ascending order, written in place; it needs one place more than `breaks`
            has.

    Returns:
        Number of values written, at least 2.
    """
    points[0], count = 0.0, 1
    residue = ROOT_RESIDUE * _find_largest_magnitude(control)
    left, at_left = 0.0, control[0]
    for i in range(1, len(breaks)):
        right, at_right = breaks[i], _evaluate_bernstein(control, breaks[i])
        if (at_left < 0.0) != (at_right < 0.0):
            points[count] = _find_root(control, left, right, at_left, at_right, residue)
            count += 1
        left, at_left = right, at_right
    points[count] = 1.0
    return count + 1


@kernel(borrows=True)
def _find_root(
    control: FloatArray, left: float, right: float, at_left: float, at_right: float, residue: float
) -> float:
    """Find the root of a polynomial in an interval in which it is monotone.

    The method is false position with the Illinois modification. It stops after ROOT_STEPS
    iterations, or if the value is nearly 0.

    Args:
        control: Bernstein control values of the polynomial.
        left: Left end of the interval, u = 0 … 1.
        right: Right end of the interval, u = 0 … 1.
        at_left: Value of the polynomial at the left end.
        at_right: Value at the right end, of the other sign.
        residue: Magnitude up to which a value counts as 0.

    Returns:
        Root u between `left` and `right`.
    """
    middle, side = left, 0
    for _ in range(ROOT_STEPS):
        span = at_right - at_left
        middle = (left * at_right - right * at_left) / span if span != 0.0 else left
        if not left <= middle <= right:
            middle = 0.5 * (left + right)
        value = _evaluate_bernstein(control, middle)
        if abs(value) <= residue:
            break
        if (value < 0.0) == (at_left < 0.0):
            left, at_left = middle, value
            if side == -1:
                at_right *= 0.5
            side = -1
        else:
            right, at_right = middle, value
            if side == 1:
                at_left *= 0.5
            side = 1
    return middle
