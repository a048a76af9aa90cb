"""Steering: the fastest motion that brings a moving arm straight to rest at a nearby posture.

Steering is used for goals that move. Each plan ends at the last known goal, and a newer plan
replaces it long before its end. Each piston changes from its speed v₀ and acceleration a₀ to a
constant speed v, keeps v, and then comes to rest. Acceleration and jerk are limited. v is first
chosen so that the piston arrives as early as possible. If another piston takes longer, v is lowered
so that all arrive together.

A change of speed from v₀ to v₁ has up to three phases: a jerk ±j, a time at the highest
acceleration a_max, and the opposite jerk. If a_max is not reached, the peak acceleration a follows
from

    v₁ − v₀ = ±(2a² − a₀²)/(2j),   a = √(j |v₁ − v₀| + a₀²/2)

Source: Biagiotti, Melchiorri, Trajectory Planning for Automatic Machines and Robots, Section 3.4.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_lengths
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState, Trajectory
from mhsb_model.types import FloatArray, as_frozen
from mhsb_planner.motion.piston_motion import convert_to_joints, convert_to_pistons
from mhsb_planner.motion.s3_ramps import RAMP_TIME_STEP
from mhsb_planner.search.discrete_path import DiscretePath

JERK_SHARE = 0.8
"""Share of the allowed jerk that steered motions take [-].

Between the points of a trajectory, the jerk is up to 25 % higher."""

BISECTION_STEPS = 48
"""Number of bisections by which a piston's speed is found."""

PISTON_PHASES = 7
"""Number of phases of a piston: three to change speed, one at constant speed, three to stop."""


@dataclass(frozen=True, eq=False)
class Steering:
    """Motion from a moving start straight to the goal on one curve, without a rest in between.

    Attributes:
        trajectory: Remainder of the plan in force, with stamp 0. Paths are searched from its end,
            but the motion leaves it at once.
    """

    trajectory: Trajectory

    @property
    def posture(self) -> FloatArray:
        """Joint positions from which paths are searched, shape (n,) [rad or m]."""
        return self.trajectory.position[-1]


@dataclass(frozen=True, eq=False)
class SteeredMotion:
    """Motion of n pistons from a moving start straight to rest, in phases of constant jerk.

    Attributes:
        machine: Machine that moves.
        start: Joint positions at time 0, shape (n,) [rad or m].
        length: Cylinder lengths at time 0, shape (n,) [m].
        speed: Piston speeds at time 0, shape (n,) [m/s].
        acceleration: Piston accelerations at time 0, shape (n,) [m/s²].
        jerk: Jerk of each phase, shape (n, PISTON_PHASES) [m/s³].
        phase: Duration of each phase, shape (n, PISTON_PHASES) [s].
        share: Planned time of each node of the path as a share of the motion's duration, shape
            (k + 1,) [-].
    """

    machine: Machine
    start: FloatArray
    length: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    phase: FloatArray
    share: FloatArray

    @cached_property
    def end(self) -> float:
        """Time at which the last piston rests [s]."""
        return max(float(self.phase.sum(axis=1).max()), RAMP_TIME_STEP)

    @property
    def node_time(self) -> FloatArray:
        """Time at which the motion is to be at each node of the path, shape (k + 1,) [s]."""
        return self.end * self.share

    @property
    def breaks(self) -> FloatArray:
        """Times at which the jerk changes, from 0 to the end of the motion [s].

        A time is left out if it is less than RAMP_TIME_STEP after the previous one or before the
        end.
        """
        kept, last = [0.0], self.end - RAMP_TIME_STEP
        for time in np.unique(np.cumsum(self.phase, axis=1)).tolist():
            if kept[-1] + RAMP_TIME_STEP <= time <= last:
                kept.append(time)
        return np.array([*kept, self.end])

    def sample(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compute the joint motion at given times.

        Args:
            time: Times in ascending order from the start of the motion, shape (m,) [s].

        Returns:
            Joint positions [rad or m], velocities [rad/s or m/s] and accelerations
            [rad/s² or m/s²], of shape (m, n).
        """
        pistons = _sample_pistons(
            time, self.length, self.speed, self.acceleration, self.jerk, self.phase
        )
        return convert_to_joints(self.machine.arrays, *pistons, as_frozen(self.start))


def compute_steered_motion(
    machine: Machine, path: DiscretePath, start: MotionState, stretch: float
) -> SteeredMotion:
    """Compute a motion that brings a moving arm straight to rest at a path's end.

    Only the path's last posture and its duration matter. Each piston changes to a constant speed,
    keeps it, and stops, within V_max and the limits of acceleration and jerk. If its speed at the
    start exceeds V_max, this speed is the limit. All pistons arrive at the time of the piston that
    needs longest.

    Args:
        machine: Machine that moves.
        path: Discrete path whose last posture is the end.
        start: State of the joints at the start.
        stretch: Least duration of the motion, as a multiple of the path's duration [-].

    Returns:
        Motion of the pistons that begins at time 0, in PISTON_PHASES phases of constant jerk for
        each piston. Joint limits and pressures are not checked.
    """
    m = machine.arrays
    state = (np.array(start.position), np.array(start.velocity), np.array(start.acceleration))
    length, speed, acceleration = convert_to_pistons(m, *state)
    stroke = cylinder_lengths(m.linkage, path.posture[-1:])[0] - length
    least = stretch * float(path.duration.sum())
    jerk, phase = _plan_phases(
        m, JERK_SHARE * m.max_piston_jerk, stroke, speed, acceleration, least
    )
    share = path.time / path.time[-1]
    return SteeredMotion(machine, start.position, length, speed, acceleration, jerk, phase, share)


@kernel(inline="always")
def _advance(x: float, v: float, a: float, jerk: float, t: float) -> tuple[float, float, float]:
    """Compute the position, speed and acceleration of a piston after a time of constant jerk.

    Args:
        x: Position at the beginning [m].
        v: Speed at the beginning [m/s].
        a: Acceleration at the beginning [m/s²].
        jerk: Jerk [m/s³].
        t: Time [s].

    Returns:
        Position [m], speed [m/s] and acceleration [m/s²] at the end.
    """
    return x + t * (v + t * (0.5 * a + t * jerk / 6.0)), v + t * (a + 0.5 * t * jerk), a + t * jerk


@kernel
def _plan_speed_change(
    v0: float, a0: float, v1: float, a_max: float, j: float, jerk: FloatArray, phase: FloatArray
) -> tuple[float, float]:
    """Plan the phases in which a piston changes its speed with limited acceleration and jerk.

    There are three phases: a jerk, constant acceleration, and the opposite jerk.

    Args:
        v0: Speed at the beginning [m/s].
        a0: Acceleration at the beginning [m/s²].
        v1: Speed at the end [m/s]; the acceleration there is 0.
        a_max: Largest acceleration [m/s²]. The acceleration at the beginning may be larger.
        j: Magnitude of the jerk [m/s³].
        jerk: Jerk of each phase, shape (3,) [m/s³]. Written in place.
        phase: Duration of each phase, shape (3,) [s]. Written in place.

    Returns:
        Stroke during the change, signed [m], and its duration [s].
    """
    sign = 1.0 if v1 >= v0 + 0.5 * a0 * abs(a0) / j else -1.0
    step, own = sign * (v1 - v0), sign * a0
    peak, flat = math.sqrt(max(j * step + 0.5 * own * own, 0.0)), 0.0
    highest = max(a_max, own)
    if peak > highest:
        flat = (step - (2.0 * highest * highest - own * own) / (2.0 * j)) / highest
        peak = highest
    jerk[0], jerk[1], jerk[2] = sign * j, 0.0, -sign * j
    phase[0], phase[1], phase[2] = max(0.0, (peak - own) / j), flat, peak / j
    way, v, a, time = 0.0, v0, a0, 0.0
    for i in range(3):
        way, v, a = _advance(way, v, a, jerk[i], phase[i])
        time += phase[i]
    return way, time


@kernel
def _plan_stop_via_speed(
    v: float, v0: float, a0: float, a_max: float, j: float, jerk: FloatArray, phase: FloatArray
) -> tuple[float, float]:
    """Plan the phases in which a piston changes to a given speed and then stops at once.

    Args:
        v: Speed at which the stop begins [m/s].
        v0: Speed at the beginning [m/s].
        a0: Acceleration at the beginning [m/s²]. The change to the speed v is limited to |a0|
            instead of a_max if a0 has the direction of this change and exceeds a_max. The stop is
            limited to a_max.
        a_max: Largest acceleration [m/s²].
        j: Magnitude of the jerk [m/s³].
        jerk: Jerk of each phase, shape (PISTON_PHASES,) [m/s³]. Written in place.
        phase: Duration of each phase, shape (PISTON_PHASES,) [s]. Written in place. Phase 3, at the
            constant speed v, gets the duration 0.

    Returns:
        Stroke of the whole motion, signed [m], and its duration [s].
    """
    there, first = _plan_speed_change(v0, a0, v, a_max, j, jerk[:3], phase[:3])
    phase[3] = jerk[3] = 0.0
    back, second = _plan_speed_change(v, 0.0, 0.0, a_max, j, jerk[4:], phase[4:])
    return there + back, first + second


@kernel
def _plan_phases(
    m: MachineArrays,
    j: float,
    stroke: FloatArray,
    speed: FloatArray,
    acceleration: FloatArray,
    least: float,
) -> tuple[FloatArray, FloatArray]:
    """Compute phases of constant jerk in which all pistons cover their strokes and arrive together.

    Each piston changes to a constant speed, keeps it for a time, and then stops. First, the
    constant speed with which a piston arrives earliest is found by bisection. Then the speed is
    lowered for each piston that would arrive before the slowest piston or before `least`.

    Tests check that the ends are reached, that limits are kept, and that no bang-bang motion is
    shorter.

    Args:
        m: Arrays of the machine, with the limits of piston speed and acceleration.
        j: Magnitude of the jerk [m/s³].
        stroke: Signed stroke of each piston, shape (n,) [m].
        speed: Piston speeds at the start, shape (n,) [m/s].
        acceleration: Piston accelerations at the start, shape (n,) [m/s²].
        least: Least duration of the motion [s].

    Returns:
        Jerks [m/s³] and durations [s] of the phases, both of shape (n, PISTON_PHASES).
    """
    n, a_max = len(stroke), m.max_piston_acceleration
    jerk, phase = np.zeros((n, PISTON_PHASES)), np.zeros((n, PISTON_PHASES))
    fastest, longest = np.empty(n), least
    for i in range(n):
        v0, a0, r, p = speed[i], acceleration[i], jerk[i], phase[i]
        high = max(m.max_piston_speed[i], abs(v0))
        low = -high
        way, time = _plan_stop_via_speed(high, v0, a0, a_max, j, r, p)
        if way > stroke[i]:
            way, time = _plan_stop_via_speed(low, v0, a0, a_max, j, r, p)
            if way >= stroke[i]:
                high = low
            else:
                for _ in range(BISECTION_STEPS):
                    middle = 0.5 * (low + high)
                    way, time = _plan_stop_via_speed(middle, v0, a0, a_max, j, r, p)
                    if way > stroke[i]:
                        high = middle
                    else:
                        low = middle
        way, time = _plan_stop_via_speed(high, v0, a0, a_max, j, r, p)
        fastest[i] = high
        if high != 0.0:
            time += max(0.0, (stroke[i] - way) / high)
        longest = max(longest, time)
    for i in range(n):
        v0, a0, r, p = speed[i], acceleration[i], jerk[i], phase[i]
        still, _ = _plan_stop_via_speed(0.0, v0, a0, a_max, j, r, p)
        left = stroke[i] - still
        v = fastest[i]
        if v * left > 0.0:
            slow, fast = 0.0, v
            for _ in range(BISECTION_STEPS):
                middle = 0.5 * (slow + fast)
                way, time = _plan_stop_via_speed(middle, v0, a0, a_max, j, r, p)
                if time + (stroke[i] - way) / middle > longest:
                    slow = middle
                else:
                    fast = middle
            v = fast
        way, _ = _plan_stop_via_speed(v, v0, a0, a_max, j, r, p)
        if v != 0.0:
            p[3] = max(0.0, (stroke[i] - way) / v)
    return jerk, phase


@kernel
def _sample_pistons(
    time: FloatArray,
    length: FloatArray,
    speed: FloatArray,
    acceleration: FloatArray,
    jerk: FloatArray,
    phase: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute lengths, speeds and accelerations of pistons that move in phases of constant jerk.

    The phases of a piston follow each other from time 0. After its last phase a piston rests.

    Args:
        time: Times in ascending order from the start of the motion, shape (m,) [s].
        length: Cylinder lengths at time 0, shape (n,) [m].
        speed: Piston speeds at time 0, shape (n,) [m/s].
        acceleration: Piston accelerations at time 0, shape (n,) [m/s²].
        jerk: Jerk of each phase, shape (n, PISTON_PHASES) [m/s³].
        phase: Duration of each phase, shape (n, PISTON_PHASES) [s].

    Returns:
        Cylinder lengths [m], piston speeds [m/s] and accelerations [m/s²], of shape (m, n).
    """
    n = len(length)
    x, v, a = np.empty((len(time), n)), np.empty((len(time), n)), np.empty((len(time), n))
    for i in range(n):
        xs, vs, as_, since, k = length[i], speed[i], acceleration[i], 0.0, 0
        for row in range(len(time)):
            while k < PISTON_PHASES and time[row] >= since + phase[i, k]:
                xs, vs, as_ = _advance(xs, vs, as_, jerk[i, k], phase[i, k])
                since += phase[i, k]
                k += 1
            t = time[row] - since
            r = jerk[i, k] if k < PISTON_PHASES else 0.0
            if k == PISTON_PHASES:
                t, vs, as_ = 0.0, 0.0, 0.0
            x[row, i], v[row, i], a[row, i] = _advance(xs, vs, as_, r, t)
    return x, v, a
