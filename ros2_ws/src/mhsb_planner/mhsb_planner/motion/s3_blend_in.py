"""Coasting: the motion that brings a moving arm to rest within acceleration and jerk limits.

The motion consists of ramps: changes of speed with limited acceleration and jerk (`s3_ramps`). At
time 0, each piston has a cylinder length L₀, a speed v₀ and an acceleration a₀. Speed and
acceleration are explained by a ramp from a speed v_a to a speed v_b that began at the time −τ. At
the time δ, a ramp to rest begins. With the functions k, ρ and R = ∫ρ of the ramp,

    v₀ = v_a (1 − ρ(τ)) + v_b ρ(τ),   a₀ = (v_b − v_a) k(τ)
    L(t) = L₀ + v_a t + (v_b − v_a) (R(t + τ) − R(τ)) − v_b R(t − δ)

The piston comes to rest at L₀ + v_b (T_r/2 + δ) + (v_b − v_a) (τ − T_r/2 − R(τ)), where T_r is the
duration of the ramp. A path may start from this resting place at the time δ, before the piston gets
there. The motion along the path is then added to the coasting. So the piston keeps the speed v_b if
the path begins with this speed.

Many pairs (v_a, v_b) lead to the same state. v_a = 0 is chosen if the piston speeds up, and v_b = 0
if it slows down, if both speeds stay within V_max. δ is 0 if the limits allow this. Otherwise δ
grows until the jerks of both ramps together keep the limit.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState, Trajectory
from mhsb_model.types import FloatArray
from mhsb_planner.motion.piston_motion import convert_to_pistons
from mhsb_planner.motion.ramped_motion import RampedMotion
from mhsb_planner.motion.s3_ramps import (
    Ramp,
    compute_shortest_ramp,
    evaluate_ramp,
    find_ramp_time,
    round_up_to_time_step,
)
from mhsb_planner.motion.trajectory_points import sample_curve

MOST_PARTS = 4
"""Largest delay of the ramp to rest, as a multiple of T₂/2 [-].

T₂ is the time in which the ramp's acceleration builds up."""

STEADY_ACCELERATION_SHARE = 0.1
"""Share of the allowed acceleration up to which the speed of a piston counts as constant [-]."""

ACCELERATION_ROUNDING = 1e-9
"""Acceleration below which a piston counts as not accelerating [m/s²]."""


@dataclass(frozen=True, eq=False)
class Coasting:
    """Motion that brings a moving arm to rest.

    Attributes:
        motion: Motion of the pistons. Its last ramp (change of speed) brings them to rest.
        trajectory: The same motion as a trajectory of the joints, with stamp 0.
    """

    motion: RampedMotion
    trajectory: Trajectory

    @property
    def ramp(self) -> Ramp:
        """Ramp (change of speed) that ends the motion."""
        return Ramp(float(self.motion.rise[-1]), float(self.motion.blend[-1]))

    @property
    def stop_time(self) -> float:
        """Time δ at which the ramp to rest begins [s]."""
        return float(self.motion.ramp_begin[-1])

    @property
    def posture(self) -> FloatArray:
        """Joint positions at which the arm comes to rest, shape (n,) [rad or m]."""
        return self.trajectory.position[-1]


def compute_coasting(machine: Machine, start: MotionState) -> Coasting:
    """Compute the motion that brings a moving arm to rest (coasting).

    All pistons come to rest by one common ramp (smooth change of speed), after a delay if
    necessary. Several ramps and delays are tried. The first motion within the limits of
    acceleration and jerk is returned. If there is none, the last motion is returned, and its
    `keeps_dynamic_limits` is False.

    Args:
        machine: Machine that moves.
        start: State of the joints at the start.

    Returns:
        Coasting from the start to rest, as a motion of the pistons and as a joint trajectory.
    """
    for motion in _iterate_gentler_motions(machine, start):
        if motion.keeps_dynamic_limits:
            break
    rest = motion.sample(np.array([0.0, motion.end]))[0][-1]
    return Coasting(motion, sample_curve(motion, start, rest))


def _iterate_gentler_motions(machine: Machine, start: MotionState) -> Iterator[RampedMotion]:
    """Yield motions that bring a moving arm to rest, in the order of trial.

    In each motion all pistons stop by one common ramp (smooth change of speed), which begins after
    a delay. The ramp of `_choose_ramp` is tried first, then the shortest ramp from V_max if it
    differs. For each ramp, the delay grows from 0 in MOST_PARTS steps of T₂/2. T₂ is the time in
    which the ramp's acceleration builds up. Each delay is rounded up to a multiple of
    RAMP_TIME_STEP. Longer ramps need less acceleration and jerk. A longer delay separates the ramp
    from the change of speed that is still under way.

    Args:
        machine: Machine that moves.
        start: State of the joints at the start.

    Yields:
        Motions of the pistons from the start to rest.
    """
    state = (np.array(start.position), np.array(start.velocity), np.array(start.acceleration))
    pistons = convert_to_pistons(machine.arrays, *state)
    own, longest = _choose_ramp(machine, *pistons[1:]), compute_shortest_ramp(machine)
    for ramp in (own,) if own == longest else (own, longest):
        for parts in range(MOST_PARTS + 1):
            yield _compute_coasting_motion(machine, start.position, pistons, ramp, parts)


def _compute_coasting_motion(
    machine: Machine,
    posture: FloatArray,
    pistons: tuple[FloatArray, FloatArray, FloatArray],
    ramp: Ramp,
    parts: int,
) -> RampedMotion:
    """Compute the motion that brings a moving arm to rest with a given ramp and delay.

    A ramp changes speeds by a trapezoid of acceleration, which builds up in the time T₂. All
    pistons come to rest by one ramp, which begins at the time δ. Each piston also completes a ramp
    of its own, which began in the past and explains the piston's speed and acceleration at the
    start.

    Args:
        machine: Machine that moves.
        posture: Joint positions at the start, shape (n,) [rad or m].
        pistons: Cylinder lengths [m], piston speeds [m/s] and piston accelerations [m/s²] at the
            start, of shape (n,).
        ramp: Ramp of all changes of speed.
        parts: Delay δ as a multiple of T₂/2. δ is rounded up to a multiple of RAMP_TIME_STEP.

    Returns:
        Motion of the pistons with n + 1 ramps: first the past ramp of each piston, then the common
        ramp to rest.
    """
    length, speed, acceleration = pistons
    stop_time = round_up_to_time_step(0.5 * parts * ramp.blend) if parts > 0 else 0.0
    before, begin, change = _place_ramps_to_rest(
        machine.arrays, *ramp, stop_time, speed, acceleration
    )
    rise, blend = np.full(len(begin), ramp.rise), np.full(len(begin), ramp.blend)
    node_time = np.array([stop_time + ramp.duration])
    return RampedMotion(machine, posture, length, before, begin, change, rise, blend, node_time)


def _choose_ramp(machine: Machine, speed: FloatArray, acceleration: FloatArray) -> Ramp:
    """Choose the ramp (smooth change of speed) that brings all pistons to rest.

    The result is the shortest ramp from the highest piston speed to rest. If a piston's
    acceleration exceeds STEADY_ACCELERATION_SHARE of the limit, the result is the shortest ramp
    from V_max.

    Args:
        machine: Machine that moves.
        speed: Piston speeds, shape (n,) [m/s].
        acceleration: Piston accelerations, shape (n,) [m/s²].

    Returns:
        Ramp common to all pistons.
    """
    steady = STEADY_ACCELERATION_SHARE * machine.arrays.max_piston_acceleration
    if max(map(abs, acceleration.tolist())) > steady:
        return compute_shortest_ramp(machine)
    return compute_shortest_ramp(machine, max(map(abs, speed.tolist())))


@kernel
def _place_ramps_to_rest(
    m: MachineArrays,
    rise: float,
    blend: float,
    stop_time: float,
    speed: FloatArray,
    acceleration: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place a past ramp of each piston and a common ramp to rest.

    A ramp is a smooth change of speed. The past ramp explains the present speed and acceleration of
    a piston. It leads from the speed v_a to the speed v_b and began a time τ before now. For a
    piston that speeds up, v_a is set to 0 and v_b is computed. For a piston that slows down, v_b is
    set to 0 and v_a is computed. If the computed speed exceeds V_max, it is set to V_max and the
    other speed is computed, unless the piston already exceeds V_max. For a piston without
    acceleration, v_a and v_b are its present speed, and τ is half the duration of the ramp. τ has
    this value also if the other rules give no finite change of speed.

    Args:
        m: Arrays of the machine.
        rise: Time T₁ from the ramp's beginning until its acceleration begins to fall [s].
        blend: Time T₂ ≤ T₁ [s]. The acceleration rises for T₂ at the ramp's beginning, and falls
            for T₂ at its end.
        stop_time: Time at which the common ramp to rest begins [s].
        speed: Piston speeds now, shape (n,) [m/s].
        acceleration: Piston accelerations now, shape (n,) [m/s²].

    Returns:
        Speeds v_a, shape (n,) [m/s]; time at which each ramp begins, the common ramp last, shape
        (n + 1,) [s]; change of the piston speeds in each ramp, shape (n + 1, n) [m/s].
    """
    n, total = len(speed), rise + blend
    before, begin, change = np.empty(n), np.empty(n + 1), np.zeros((n + 1, n))
    begin[n] = stop_time
    for j in range(n):
        sign = -1.0 if acceleration[j] < 0.0 else 1.0
        v, a, limit = sign * speed[j], sign * acceleration[j], m.max_piston_speed[j]
        if a < ACCELERATION_ROUNDING:
            begin[j], before[j], change[n, j] = -0.5 * total, speed[j], -speed[j]
            continue
        if v > 0.0:
            tau = find_ramp_time(rise, blend, v / a)
            if _compute_speed_change(rise, blend, tau, a) > limit > v:
                tau = total - find_ramp_time(rise, blend, (limit - v) / a)
        else:
            tau = total - find_ramp_time(rise, blend, -v / a)
            if _compute_speed_change(rise, blend, tau, a) > limit > -v:
                tau = find_ramp_time(rise, blend, (limit + v) / a)
        if _compute_speed_change(rise, blend, tau, a) == np.inf:
            tau = 0.5 * total
        step = _compute_speed_change(rise, blend, tau, a)
        _, share, _ = evaluate_ramp(rise, blend, tau)
        before[j], after = sign * (v - share * step), sign * (v + (1.0 - share) * step)
        begin[j], change[j, j], change[n, j] = -tau, after - before[j], -after
    return before, begin, change


@kernel
def _compute_speed_change(rise: float, blend: float, tau: float, acceleration: float) -> float:
    """Compute the change of speed of a ramp that has a given acceleration at a given time.

    Args:
        rise: Time T₁ from the ramp's beginning until its acceleration begins to fall [s].
        blend: Time T₂ ≤ T₁ [s]. The acceleration rises for T₂ at the ramp's beginning, and falls
            for T₂ at its end.
        tau: Time τ since the ramp began [s].
        acceleration: Acceleration at that time [m/s²].

    Returns:
        Change of speed [m/s]; inf if the ramp has no acceleration at τ.
    """
    _, _, k = evaluate_ramp(rise, blend, tau)
    return acceleration / k if k > 0.0 else np.inf
