"""S3 as published: one sixth-degree polynomial per joint over the whole move.

In normalised time s = t/T the polynomial is p(s) = h(s) + w(s) Σ c_i B_i(s). The polynomial h meets
the boundary conditions. The factor w and its derivatives are 0 at both ends, so p meets the
boundary conditions for any coefficients c_i. The c_i are a least-squares fit to positions and
velocities of the discrete path.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import polynomial as series

from mhsb_model.trajectory import MotionState
from mhsb_model.types import FloatArray, frozen
from mhsb_planner.search.discrete_path import DiscretePath

POLYNOMIAL_DEGREE = 6
"""Degree of the polynomials (paper, step S3)."""
MIN_STEP_DURATION = 1e-6
"""Least duration of a step of the discrete path; shorter steps get this duration [s]."""
CHECK_INSTANTS = frozen((np.arange(96) + 0.5) / 96)
"""Evenly spaced normalised times [-]. The polynomials are fitted to the discrete path at these
times."""


@dataclass(frozen=True, eq=False)
class PolynomialCurve:
    """Polynomial motion q_j(t) = Σ_i coefficient[i, j] (t/T)^i of n joints.

    Attributes:
        coefficient: Coefficients, one row for each power of t/T, shape (7, n) [rad or m].
        duration: Duration T [s].
        node_time: Time at which the motion is to be at each node of the discrete path, shape (k +
            1,) [s].
    """

    coefficient: FloatArray
    duration: float
    node_time: FloatArray

    @property
    def breaks(self) -> FloatArray:
        """Start and end of the smooth curve: 0 and the duration, shape (2,) [s]."""
        return np.array([0.0, self.duration])

    def sample(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compute the joint motion at given times.

        Before time 0 and after `duration`, the polynomials are continued.

        Args:
            time: Times from the start of the motion, in any order, shape (k,) [s].

        Returns:
            Joint positions [rad or m], velocities [rad/s or m/s] and accelerations
            [rad/s² or m/s²], of shape (k, n).
        """
        powers = np.vander(time / self.duration, POLYNOMIAL_DEGREE + 1, increasing=True)
        first = _differentiate(self.coefficient)
        return (
            powers @ self.coefficient,
            powers[:, :-1] @ first / self.duration,
            powers[:, :-2] @ _differentiate(first) / self.duration**2,
        )


def fit_polynomial(
    path: DiscretePath, start: MotionState, delay: float, stretch: float
) -> PolynomialCurve:
    """Fit one polynomial per joint to a discrete path, with rest at the path's end.

    Position and velocity at both ends are met exactly. If the arm moves at the start, its
    acceleration there is met, too. The remaining coefficients fit positions and velocities of the
    path at CHECK_INSTANTS by least squares.

    Args:
        path: Discrete path.
        start: State of the joints at the start.
        delay: Time from the start to the path's first node [s]; 0 for a start at rest.
        stretch: Factor on `delay` and on the path's durations [-].

    Returns:
        Polynomials that start at time 0. Limits are not checked.
    """
    node_time = stretch * (delay + compute_node_times(path))
    duration = float(node_time[-1])
    moving = start.is_moving
    boundary = _compute_boundary_polynomial(start, path.posture[-1], duration, moving)
    position, velocity = _interpolate_path(path, start, node_time, CHECK_INSTANTS * duration)
    wanted = np.vstack([position, velocity * duration])
    basis, inverse = _compute_free_terms(5 if moving else 4)
    weights = inverse @ (wanted - _evaluate_with_slopes(CHECK_INSTANTS, boundary))
    return PolynomialCurve(boundary + basis @ weights, duration, node_time)


def compute_node_times(path: DiscretePath) -> FloatArray:
    """Compute the time at which a motion is to be at each node of a discrete path.

    Args:
        path: Discrete path of k steps. A shorter step counts as MIN_STEP_DURATION long.

    Returns:
        Ascending times from 0, shape (k + 1,) [s].
    """
    return np.concatenate([[0.0], np.cumsum(np.maximum(path.duration, MIN_STEP_DURATION))])


def _interpolate_path(
    path: DiscretePath, start: MotionState, node_time: FloatArray, time: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Interpolate a discrete path linearly in joint space and over time.

    If the first node comes after time 0, the stretch from the start to this node is interpolated,
    too. Times after the last node are extrapolated with the last step's velocity.

    Args:
        path: Discrete path of k steps. Only `posture` is read.
        start: State of the joints at time 0. Only `position` is read.
        node_time: Time at which the motion is to be at each node, shape (k + 1,) [s].
        time: Times of interpolation, shape (m,) [s].

    Returns:
        Joint positions [rad or m] and velocities [rad/s or m/s], both of shape (m, n).
    """
    times, nodes = node_time, path.posture
    if node_time[0] > 0.0:
        times = np.concatenate([[0.0], node_time])
        nodes = np.vstack([start.position, nodes])
    step = np.clip(np.searchsorted(times, time, "right") - 1, 0, len(times) - 2)
    velocity = np.diff(nodes, axis=0) / np.diff(times)[:, None]
    return nodes[step] + velocity[step] * (time - times[step])[:, None], velocity[step]


def _compute_boundary_polynomial(
    start: MotionState, end: FloatArray, duration: float, moving: bool
) -> FloatArray:
    """Compute, for each joint, the polynomial of least degree from a start state to rest.

    Position and velocity are met at both ends. If `moving`, the acceleration at the start is met,
    too.

    Args:
        start: State of the joints at the start.
        end: Joint positions at the end, shape (n,) [rad or m].
        duration: Duration T [s].
        moving: True if the start's acceleration is a condition, too.

    Returns:
        Coefficients of the powers of s = t/T, with the time t, shape (7, n) [rad or m]. Row i
        belongs to s^i. Coefficients of unused powers are 0.
    """
    result = np.zeros((POLYNOMIAL_DEGREE + 1, len(end)))
    dq = end - start.position
    result[0], result[1] = start.position, start.velocity * duration
    if moving:
        result[2] = start.acceleration * duration**2 / 2
        left = dq - result[1] - result[2]  # position that s³ and s⁴ must add at s = 1
        slope = -result[1] - 2 * result[2]  # derivative that they must add
        result[3], result[4] = 4 * left - slope, slope - 3 * left
    else:
        result[2], result[3] = 3 * dq - 2 * result[1], result[1] - 2 * dq
    return result


@cache
def _compute_free_terms(conditions: int) -> tuple[FloatArray, FloatArray]:
    """Compute polynomials that may be added to a motion without changing its boundary conditions.

    In normalised time s from 0 to 1 the polynomials are

        w(s) B_i(s),  w = s²(1 − s)² or s³(1 − s)²,  B_i = (2s − 1)^i,  i = 0, 1, …

    w has the power s³ if the start's acceleration is a condition, otherwise s². This choice of B_i
    keeps a least-squares fit well conditioned. The result is cached.

    Args:
        conditions: Number of boundary conditions: 4, or 5 with the start's acceleration.

    Returns:
        Two read-only arrays: the coefficients of the polynomials by power and term, shape (7, 7 −
        conditions), and the pseudo-inverse of their values and slopes at the m instants
        CHECK_INSTANTS, shape (7 − conditions, 2 m).
    """
    window = series.polyfromroots([0.0] * (conditions - 2) + [1.0] * 2)
    basis = np.zeros((POLYNOMIAL_DEGREE + 1, POLYNOMIAL_DEGREE + 1 - conditions))
    for i in range(basis.shape[1]):
        term = series.polymul(window, series.polypow([-1.0, 2.0], i))
        basis[: len(term), i] = term
    return frozen(basis), frozen(np.linalg.pinv(_evaluate_with_slopes(CHECK_INSTANTS, basis)))


def _evaluate_with_slopes(s: FloatArray, coefficient: FloatArray) -> FloatArray:
    """Evaluate polynomials and their derivatives at normalised times.

    Args:
        s: Normalised times, shape (m,) [-].
        coefficient: Coefficients by power, shape (7, columns).

    Returns:
        Values in the first m rows and derivatives dp/ds in the next m rows, shape (2 m, columns).
    """
    powers = s[:, None] ** np.arange(POLYNOMIAL_DEGREE + 1)
    return np.vstack([powers @ coefficient, powers[:, :-1] @ _differentiate(coefficient)])


def _differentiate(coefficient: FloatArray) -> FloatArray:
    """Compute the coefficients of the derivatives of polynomials.

    Args:
        coefficient: Coefficients by ascending power, shape (powers, columns).

    Returns:
        Coefficients of the derivatives, shape (powers − 1, columns).
    """
    return coefficient[1:] * np.arange(1.0, len(coefficient))[:, None]
