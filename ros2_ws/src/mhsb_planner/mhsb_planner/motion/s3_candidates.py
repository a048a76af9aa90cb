"""Curves that S3 tries along a discrete path, in the order of trial (`s3_trajectory`).

The last curve is the stepped path, which rests at every node.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Literal

import numpy as np

from mhsb_model.linkages.linkage import cylinder_lengths
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED_MODES
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, standstill
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.motion.limits.limit import TimeScaling, Violation
from mhsb_planner.motion.resting import insert_rests
from mhsb_planner.motion.s3_blend_in import Coasting
from mhsb_planner.motion.s3_following import compute_followed_path
from mhsb_planner.motion.s3_polynomial import compute_node_times, fit_polynomial
from mhsb_planner.motion.s3_slowing import USAGE_RESERVE
from mhsb_planner.motion.s3_state_to_rest import Steering, compute_steered_motion
from mhsb_planner.motion.s4_mode_schedule import MIN_DWELL, StartModes
from mhsb_planner.motion.trajectory_points import Curve
from mhsb_planner.motion.via_check import ViaPoint
from mhsb_planner.search.discrete_path import DiscretePath

MIN_RAMPED_STEP_DURATION = 0.1
"""Shortest duration of a step of the stepped path, from rest to rest [s]."""

UNIT_QUINTIC_PEAKS = (15 / 8, 10 / 3**0.5, 60.0)
"""Largest first, second and third derivative of 10u³ − 15u⁴ + 6u⁵ for u from 0 to 1 [-]."""


@dataclass(frozen=True, eq=False)
class SteppedPath:
    """Motion from node to node along straight lines in joint space, with a rest at every node.

        q = q_i + Δq (10u³ − 15u⁴ + 6u⁵)

    q_i is the posture at the beginning of a step and Δq its change. u grows from 0 to 1 in
    proportion to time during the step.

    Attributes:
        posture: Joint positions at the nodes, shape (k + 1, n) [rad or m].
        node_time: Time at which each node is reached, shape (k + 1,) [s].
    """

    posture: FloatArray
    node_time: FloatArray

    @property
    def breaks(self) -> FloatArray:
        """Times at which the curve is not smooth: the times of the nodes [s]."""
        return self.node_time

    def sample(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compute the joint motion at given times.

        Before time 0 the arm rests at the path's first posture, and after the end at its last
        posture.

        Args:
            time: Times from the start of the motion, in any order, shape (m,) [s].

        Returns:
            Joint positions [rad or m], velocities [rad/s or m/s] and accelerations
            [rad/s² or m/s²], of shape (m, n).
        """
        last = len(self.node_time) - 2
        step = np.clip(np.searchsorted(self.node_time, time, "right") - 1, 0, last)
        span = np.diff(self.node_time)[step]
        u = np.clip((time - self.node_time[step]) / span, 0.0, 1.0)[:, None]
        span = span[:, None]
        dq = np.diff(self.posture, axis=0)[step]
        q = self.posture[step] + dq * (10 * u**3 - 15 * u**4 + 6 * u**5)
        qd = dq * (30 * u**2 - 60 * u**3 + 30 * u**4) / span
        qdd = dq * (60 * u - 180 * u**2 + 120 * u**3) / span**2
        return q, qd, qdd


def compute_stepped_path(
    machine: Machine, path: DiscretePath, scale: FloatArray | float
) -> SteppedPath:
    """Compute a motion along a discrete path, with a rest at every node.

    Each step is a straight line in joint space. At scale 1 no piston is faster than in the same
    step of the discrete path, and the limits of acceleration and jerk are kept. If moment arms vary
    much within a step, this holds only approximately. A step at scale 1 lasts at least
    MIN_RAMPED_STEP_DURATION.

    Args:
        machine: Machine whose piston acceleration and jerk are the limits.
        path: Discrete path.
        scale: Factor on the durations of all steps, or of each step, shape (k,) [-].

    Returns:
        Motion that begins at time 0.
    """
    m = machine.arrays
    stroke = np.abs(np.diff(cylinder_lengths(m.linkage, path.posture), axis=0)).max(axis=1)
    speed, acceleration, jerk = UNIT_QUINTIC_PEAKS
    duration = np.maximum(speed * path.duration, MIN_RAMPED_STEP_DURATION)
    duration = np.maximum(duration, np.sqrt(acceleration * stroke / m.max_piston_acceleration))
    duration = np.maximum(duration, np.cbrt(jerk * stroke / m.max_piston_jerk))
    return SteppedPath(path.posture, np.concatenate([[0.0], np.cumsum(scale * duration)]))


SHORTEST_MOVE = 0.5
"""Shortest duration of a polynomial [s]."""

TrajectoryKind = Literal["polynomial", "followed"]
"""Curve that S3 tries first: the published polynomial, or ramps that follow the discrete path."""

TRAJECTORY_KINDS: tuple[TrajectoryKind, ...] = ("polynomial", "followed")
"""All values of `TrajectoryKind`."""


FOLLOWED_SPEED_EXCESS = 1.001 * USAGE_RESERVE - 1.0
"""Largest speed excess |v|/V_max − 1 of a piston on a path that is followed with ramps [-].

The ramps keep V_max by construction. The excess only allows for USAGE_RESERVE and rounding."""


class FitMethod(StrEnum):
    """Method by which a trajectory was made."""

    POLYNOMIAL = "polynomial"
    """One polynomial of degree 6 per joint, as published."""
    RAMPED = "ramped"
    """The discrete path, with each change of piston speed smoothed by a ramp."""
    STEERED = "steered"
    """Braking from a moving start to rest at the path's end, in phases of constant jerk."""
    STEPPED = "stepped"
    """The discrete path with a rest at every node."""
    BRAKING = "braking"
    """A braking motion without a path."""
    CONTINUED = "continued"
    """The remaining part of the plan in force."""


@dataclass(frozen=True)
class FitRules:
    """Settings for the fit of a trajectory to a discrete path.

    A ramp is a change of piston speed with limited acceleration and jerk.

    Attributes:
        trajectory: Curve that is tried first: `polynomial` is the polynomial of degree 6,
            `followed` leaves the polynomial out.
        polynomial_only: True if no other curve is tried when the polynomial breaks a limit.
        stepped: True if the path may be followed step by step, with a rest at every node.
        ramp_factor: Factor on the duration of the shortest ramps that is tried first [-].
        max_ramp_factor: Largest such factor [-]. Ramps become longer if the pressure is too low.
        last_ramp_factor: Further factor on the duration of the motion's last ramp [-].
        max_stretch: Largest factor on a curve's duration, as a multiple of the factor that is tried
            first [-].
        max_excess: Largest excess of a piston speed, |v|/V_max − 1 [-].
        min_duration: Shortest duration to which the discrete path is stretched [s].
        via_points: Via points that the tip must pass on its way.
    """

    trajectory: TrajectoryKind = "polynomial"
    polynomial_only: bool = False
    stepped: bool = True
    ramp_factor: float = 1.0
    max_ramp_factor: float = 8.0
    last_ramp_factor: float = 1.0
    max_stretch: float = 3.0
    max_excess: float = 0.1
    min_duration: float = 0.0
    via_points: tuple[ViaPoint, ...] = ()

    @classmethod
    def create_following(cls) -> FitRules:
        """Create rules for a motion that follows its path with piston speeds within V_max."""
        return cls(trajectory="followed", max_excess=FOLLOWED_SPEED_EXCESS)


@dataclass(frozen=True, eq=False)
class CurveCandidate:
    """One kind of curve along a discrete path, and the rules by which it is tried.

    Attributes:
        path: Discrete path that the curve follows.
        method: Method that the fitted motion reports.
        name: Words that describe the curve in messages.
        curve_at: Function that computes the curve. Its arguments are a factor on the duration of
            each step of the path, shape (k,) [-], and a factor on the duration of the ramps [-].
            Curves without ramps ignore the second argument.
        start: State of the joints at the beginning of the curve.
        lead_in: Motion before the curve, such as braking; None if there is none.
        stretch: Factor on the path's durations that is tried first [-].
        furthest_travel: Travel of each joint in the direction of its initial velocity that braking
            and the path need, shape (n,) [rad or m]. None means that travel is not checked.
        coasts: True if the curve begins while the arm moves, False if it begins at rest.
        stretchable: Effects of time for which the curve may be slowed. If a limit with another
            effect is broken, the curve is refused.
        slows_pieces: True if only the steps around a violation become longer, False if all steps
            do.
        max_stretch: Largest factor on the duration, as a multiple of `stretch` [-]. None means
            `FitRules.max_stretch`.
        ramp_factor: Factor on the duration of the ramps that is tried first [-].
        max_ramp_factor: Largest factor on the duration of the ramps [-]. They become longer if the
            pressure is too low.
        lack_with_shorter_ramps: Lack of pressure for which the ramps were made longer; None if they
            are as in the first trial.
    """

    path: DiscretePath
    method: FitMethod
    name: str
    curve_at: Callable[[FloatArray, float], Curve]
    start: MotionState
    lead_in: Trajectory | None = None
    stretch: float = 1.0
    furthest_travel: FloatArray | None = None
    coasts: bool = False
    stretchable: tuple[TimeScaling, ...] = (TimeScaling.SPEED, TimeScaling.INERTIA)
    slows_pieces: bool = False
    max_stretch: float | None = None
    ramp_factor: float = 1.0
    max_ramp_factor: float = 1.0
    lack_with_shorter_ramps: Violation | None = None

    def may_mend(self, lack: Violation) -> bool:
        """Return whether longer ramps may mend a lack of pressure for inertia.

        Args:
            lack: Violation of this curve. If shorter ramps left it just as it is, ramps have no
                effect there. This is common in the motion to rest before the path.

        Returns:
            False if ramps have no effect on the lack, or are as long as they may become.
        """
        return self.ramp_factor < self.max_ramp_factor and lack != self.lack_with_shorter_ramps

    def with_longer_ramps(self, growth: float, lack: Violation) -> CurveCandidate:
        """Return this curve with longer ramps.

        Args:
            growth: Factor by which the ramps become longer [-], limited by `max_ramp_factor`.
            lack: Lack of pressure for which they become longer.
        """
        longer = min(self.max_ramp_factor, growth * self.ramp_factor)
        return replace(self, ramp_factor=longer, lack_with_shorter_ramps=lack)


def iterate_candidates(
    machine: Machine,
    path: DiscretePath,
    start: MotionState,
    brake: Trajectory | None,
    coast: Coasting | Steering | None,
    modes: StartModes,
    rules: FitRules,
) -> Iterator[CurveCandidate]:
    """Yield the curves to try along a discrete path, in the order of trial.

    If `coast` is a `Steering`, the only curve leads from the moving start straight to the goal.
    Otherwise the order is:

    1. The polynomial, if `rules.trajectory` is `polynomial`. With `rules.polynomial_only` it is the
       only curve.
    2. If `coast` is a `Coasting`: the path with ramps (smooth changes of speed), which begins at
       once while the arm still moves.
    3. The path with ramps from rest, after `brake`. Then this path with a further rest before each
       step in which the boost of an actuator begins; its ramps may not become longer.
    4. The path step by step with a rest at every node, after `brake`, if `rules.stepped`.

    If an actuator was switched so recently that it may not be switched again yet, curves 3 and 4
    follow a second time, after a rest.

    Args:
        machine: Machine that moves.
        path: Discrete path.
        start: State of the joints at the start.
        brake: Motion that brings a moving arm to rest at the path's first node. None if the arm is
            at rest. With a `Coasting` it is `coast.trajectory`.
        coast: `Coasting`, the motion that brings a moving arm to rest. `Steering` if the moving arm
            goes to the goal without a rest. None otherwise.
        modes: Modes in force at the start, and time since each actuator's last switch.
        rules: Settings of the fit.

    Yields:
        Curves with the rules by which they are tried; the curves are computed later.
    """
    rest = MotionState.at_rest(path.posture[0])
    if isinstance(coast, Steering):
        yield CurveCandidate(
            path,
            FitMethod.STEERED,
            "steered",
            lambda scale, _: compute_steered_motion(machine, path, start, float(scale[0])),
            start,
            coasts=True,
        )
        return
    if rules.trajectory == "polynomial":
        yield _create_polynomial(path, start, brake)
        if rules.polynomial_only:
            return
    if coast is not None:
        yield _create_ramped(machine, path, start, None, coast, rules)
    youngest = MIN_DWELL - float(modes.age.min())
    lead_ins = [("", brake)]
    if youngest > 0.0:
        waited = (brake or standstill(start.position)).with_rest(round(youngest * SECOND_NS))
        lead_ins.append(("after a rest, ", waited))
    for words, lead_in in lead_ins:
        yield _create_ramped(machine, path, rest, lead_in, None, rules, words)
        boosts = _find_boost_steps(path)
        if len(boosts) > 0:
            rested, named = insert_rests(machine, path, boosts), f"{words}resting before boost, "
            shortest = replace(rules, max_ramp_factor=rules.ramp_factor)
            yield _create_ramped(machine, rested, rest, lead_in, None, shortest, named)
        if rules.stepped:
            yield CurveCandidate(
                path,
                FitMethod.STEPPED,
                f"{words}stepped",
                lambda scale, _: compute_stepped_path(machine, path, scale),
                rest,
                lead_in,
                slows_pieces=True,
            )


def _find_boost_steps(path: DiscretePath) -> IntArray:
    """Find the steps of a path at which an actuator's boost begins, except the first step.

    Args:
        path: Discrete path. Only `modes` is read.

    Returns:
        Indices of the steps in ascending order.
    """
    boosted = BOOSTED_MODES[path.modes]
    return np.flatnonzero((boosted[1:] & ~boosted[:-1]).any(axis=1)) + 1


def _create_ramped(
    machine: Machine,
    path: DiscretePath,
    start: MotionState,
    lead_in: Trajectory | None,
    coast: Coasting | None,
    rules: FitRules,
    words: str = "",
) -> CurveCandidate:
    """Create a curve along a discrete path whose changes of speed are ramps, as a curve to try.

    Its ramps become longer if the pressure is too low, and its steps if valves or pumps cannot
    follow. A curve that begins at rest and has the longest ramps may be slowed, too, if the
    pressure is still too low.

    Args:
        machine: Machine that moves.
        path: Discrete path.
        start: State of the joints at the beginning of the curve.
        lead_in: Motion before the curve, such as braking; None if there is none.
        coast: Motion that brings a moving arm to rest. None if the curve begins at rest.
        rules: Settings of the fit, with the factors on the duration of the ramps.
        words: Beginning of the curve's name in messages. It is ignored if `coast` is given.

    Returns:
        Curve to try.
    """
    words = words if coast is None else "setting out at once, "
    speed, inertia = TimeScaling.SPEED, TimeScaling.INERTIA
    return CurveCandidate(
        path,
        FitMethod.RAMPED,
        f"{words}with ramps",
        lambda scale, ramp_factor: compute_followed_path(
            machine, path, ramp_factor, coast, scale, last_ramp_factor=rules.last_ramp_factor
        ),
        start,
        lead_in,
        coasts=coast is not None,
        ramp_factor=rules.ramp_factor,
        max_ramp_factor=rules.max_ramp_factor,
        stretchable=(speed, inertia) if coast is None else (speed,),
        slows_pieces=True,
    )


def _create_polynomial(
    path: DiscretePath, start: MotionState, brake: Trajectory | None
) -> CurveCandidate:
    """Create the published curve, one polynomial of degree 6 per joint, as a curve to try.

    Two rules hold if the arm moves at the start. The polynomial must not be slowed after its first
    trial. No joint may travel farther in its initial direction than it does during `brake` or on
    the path.

    Args:
        path: Discrete path.
        start: State of the joints at the start.
        brake: Motion that brings a moving arm to rest; None if the arm is at rest. The polynomial
            reaches the path's first node after half the duration of this motion.

    Returns:
        Curve to try. If the path takes less time than SHORTEST_MOVE, the first trial already
        stretches it to this duration.
    """
    shortest = max(1.0, SHORTEST_MOVE / float(compute_node_times(path)[-1]))
    if brake is None:
        rest = MotionState.at_rest(path.posture[0])
        return CurveCandidate(
            path,
            FitMethod.POLYNOMIAL,
            "polynomial",
            lambda scale, _: fit_polynomial(path, rest, 0.0, float(scale[0])),
            rest,
            stretch=shortest,
        )
    delay = brake.duration_ns / SECOND_NS / 2
    return CurveCandidate(
        path,
        FitMethod.POLYNOMIAL,
        "polynomial from the moving start",
        lambda scale, _: fit_polynomial(path, start, delay, float(scale[0])),
        start,
        stretch=shortest,
        furthest_travel=compute_furthest_travel(start, np.vstack([brake.position, path.posture])),
        max_stretch=1.0,
    )


def compute_furthest_travel(start: MotionState, position: FloatArray) -> FloatArray:
    """Compute the largest travel of each joint in the direction of its initial velocity.

    Args:
        start: State of the joints at the start.
        position: Joint positions along a motion, shape (k, n) [rad or m].

    Returns:
        Travel from the start, shape (n,) [rad or m]. It is 0 for a joint that is at rest at the
        start, and negative for a joint that only moves the other way.
    """
    return np.max(np.sign(start.velocity) * (position - start.position), axis=0)
