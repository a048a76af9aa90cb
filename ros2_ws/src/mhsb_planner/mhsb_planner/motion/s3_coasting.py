"""Coasting: how a moving start comes to rest within acceleration and jerk, and where.

The state of each piston (L₀, v₀, a₀) is taken for one within a motion made of ramps: the piston
was to move at v_a until τ ago, and at v_b since. δ from now it is told to stop. With the ramp's k,
ρ and R = ∫ρ,

    v₀ = v_a (1 − ρ(τ)) + v_b ρ(τ),   a₀ = (v_b − v_a) k(τ)
    L(t) = L₀ + v_a t + (v_b − v_a) (R(t + τ) − R(τ)) − v_b R(t − δ)

and the piston comes to rest at L₀ + v_b (T_r/2 + δ) + (v_b − v_a) (τ − T_r/2 − R(τ)). A path that
sets out from there when the stop is told is a corner like any other: at the same speeds nothing
changes. Of the histories that lead to the state, v_a = 0 is taken where the piston speeds up and
v_b = 0 where it slows down, as far as both remain within V_max. δ is 0, or as long as it takes for
the jerks of both changes of speed not to add up to more than is allowed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState, Trajectory
from mhsb_model.types import FloatArray
from mhsb_planner.motion.piston_motion import piston_state
from mhsb_planner.motion.ramped_motion import RampedMotion
from mhsb_planner.motion.s3_ramps import Ramp, ramp_at, ramp_time, shortest_ramp, whole_ticks
from mhsb_planner.motion.trajectory_points import sampled_trajectory

MOST_PARTS = 4
"""δ is at most so many times half the time in which a ramp's acceleration builds up."""

STEADY = 0.1
"""Up to this share of the acceleration that is allowed, pistons count as moving steadily."""

NEGLIGIBLE = 1e-9
"""An acceleration below this is rounding [m/s²]."""


@dataclass(frozen=True, eq=False)
class Coasting:
    """How a moving start comes to rest.

    motion      of the pistons; the last ramp is that of coming to rest
    trajectory  the same motion of the joints, with stamp 0
    """

    motion: RampedMotion
    trajectory: Trajectory

    @property
    def ramp(self) -> Ramp:
        """By which it comes to rest."""
        return Ramp(float(self.motion.rise[-1]), float(self.motion.blend[-1]))

    @property
    def told(self) -> float:
        """When it is told to stop, δ [s]."""
        return float(self.motion.at[-1])

    @property
    def posture(self) -> FloatArray:
        """Where the arm comes to rest [rad]."""
        return self.trajectory.position[-1]


def coasting(machine: Machine, start: MotionState) -> Coasting:
    """The coasting of a moving start; not always within acceleration and jerk (`gentle`)."""
    for motion in _ever_gentler(machine, start):
        if motion.gentle:
            break
    rest = motion.sample(np.array([0.0, motion.end]))[0][-1]
    return Coasting(motion, sampled_trajectory(motion, start, rest))


def _ever_gentler(machine: Machine, start: MotionState) -> Iterator[RampedMotion]:
    """With the ramp that the speeds ask for, then with that to V_max, and with ever longer δ."""
    state = (np.array(start.position), np.array(start.velocity), np.array(start.acceleration))
    _, speed, acceleration = piston_state(machine.arrays, *state)
    own, longest = _ramp_from(machine, speed, acceleration), shortest_ramp(machine)
    for ramp in (own,) if own == longest else (own, longest):
        for parts in range(MOST_PARTS + 1):
            yield _coasting(machine, start, ramp, parts)


def _coasting(machine: Machine, start: MotionState, ramp: Ramp, parts: int) -> RampedMotion:
    """With δ so many times half the time in which acceleration builds up."""
    m, n = machine.arrays, machine.joint_count
    state = (np.array(start.position), np.array(start.velocity), np.array(start.acceleration))
    length, speed, acceleration = piston_state(m, *state)
    told = whole_ticks(0.5 * parts * ramp.blend) if parts > 0 else 0.0
    since, before, after = _histories(m, ramp.rise, ramp.blend, speed, acceleration)
    return RampedMotion(
        machine,
        start.position,
        length,
        speed=before,
        at=np.append(-since, told),
        change=np.vstack([np.diag(after - before), -after]),
        rise=np.full(n + 1, ramp.rise),
        blend=np.full(n + 1, ramp.blend),
        node_time=np.array([told + ramp.duration]),
    )


def _ramp_from(machine: Machine, speed: FloatArray, acceleration: FloatArray) -> Ramp:
    """The shortest from these piston speeds; where they change, the one that is going on."""
    if np.abs(acceleration).max() > STEADY * machine.arrays.max_piston_acceleration:
        return shortest_ramp(machine)
    return shortest_ramp(machine, float(np.abs(speed).max()))


@kernel
def _histories(
    m: MachineArrays, rise: float, blend: float, speed: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """τ [s], v_a and v_b [m/s] of pistons at these speeds [m/s] and accelerations [m/s²]."""
    n, total = len(speed), rise + blend
    since, before, after = np.empty(n), np.empty(n), np.empty(n)
    for j in range(n):
        sign = -1.0 if acceleration[j] < 0.0 else 1.0
        v, a, limit = sign * speed[j], sign * acceleration[j], m.max_piston_speed[j]
        if a < NEGLIGIBLE:
            since[j], before[j], after[j] = 0.5 * total, speed[j], speed[j]
            continue
        if v > 0.0:
            tau = ramp_time(rise, blend, v / a)
            if _step_at(rise, blend, tau, a) > limit > v:
                tau = total - ramp_time(rise, blend, (limit - v) / a)
        else:
            tau = total - ramp_time(rise, blend, -v / a)
            if _step_at(rise, blend, tau, a) > limit > -v:
                tau = ramp_time(rise, blend, (limit + v) / a)
        if _step_at(rise, blend, tau, a) == np.inf:
            tau = 0.5 * total
        step = _step_at(rise, blend, tau, a)
        _, share, _ = ramp_at(rise, blend, tau)
        since[j] = tau
        before[j], after[j] = sign * (v - share * step), sign * (v + (1.0 - share) * step)
    return since, before, after


@kernel
def _step_at(rise: float, blend: float, tau: float, acceleration: float) -> float:
    """The step of speed of which an acceleration is left τ after it was asked for [m/s]."""
    _, _, k = ramp_at(rise, blend, tau)
    return acceleration / k if k > 0.0 else np.inf
