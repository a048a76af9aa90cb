"""Steering: straight from a state of motion to rest at a posture near by, as fast as it goes.

For a goal that moves: each plan ends where the goal was seen last, and is left long before. Each
piston passes from its state (v₀, a₀) to one speed v within acceleration and jerk, keeps that, and
comes to rest from it; v is the speed at which it gets to its end soonest, or, where others take
longer, as late as they. A change of speed is a jerk, perhaps a while of the highest acceleration,
and the opposite jerk: with the peak a,

    v₁ − v₀ = ±(2a² − a₀²)/(2j),   a = √(j |v₁ − v₀| + a₀²/2) up to a_max

Source: Biagiotti, Melchiorri, Trajectory Planning for Automatic Machines and Robots, Section 3.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState, Trajectory
from mhsb_model.types import FloatArray
from mhsb_planner.motion.piston_motion import joint_motion, lengths_of, piston_state
from mhsb_planner.motion.s3_ramps import TICK
from mhsb_planner.search.discrete_path import DiscretePath

BRISK = 0.8
"""Share of the jerk that steering takes: between points a trajectory has up to a quarter more."""

HALVINGS = 48
PHASES = 7  # of a piston: three of the first change of speed, one between, three of the stop


@dataclass(frozen=True, eq=False)
class Steering:
    """A moving start from which a motion steers straight to its end.

    start  of the motion
    rest   of the plan in force, with stamp 0: its end is where paths are looked for from
    """

    start: MotionState
    trajectory: Trajectory

    @property
    def posture(self) -> FloatArray:
        """From which paths are looked for [rad]."""
        return self.trajectory.position[-1]


@dataclass(frozen=True, eq=False)
class SteeredMotion:
    """Pistons on their straight way; a curve for S3.

    length, speed, acceleration  float64[n] of the pistons at time 0 [m, m/s, m/s²]
    jerk, phase  float64[n, PHASES] m/s³ and s, one after the other
    share        float64[k + 1], of the duration when the path's nodes are due
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
        """When the last piston rests [s]."""
        return max(float(self.phase.sum(axis=1).max()), TICK)

    @property
    def node_time(self) -> FloatArray:
        """When the path's nodes are due [s]."""
        return self.end * self.share

    @property
    def breaks(self) -> FloatArray:
        """Times between which the jerk is constant, as far as they are a TICK apart [s]."""
        kept, last = [0.0], self.end - TICK
        for time in np.unique(np.cumsum(self.phase, axis=1)).tolist():
            if kept[-1] + TICK <= time <= last:
                kept.append(time)
        return np.array([*kept, self.end])

    def sample(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q, q̇, q̈ at the times [s], float64[times, n] each."""
        pistons = _pistons(
            time, self.length, self.speed, self.acceleration, self.jerk, self.phase
        )
        return joint_motion(self.machine.arrays, *pistons, self.start)


def steered_path(
    machine: Machine, path: DiscretePath, start: MotionState, stretch: float
) -> SteeredMotion:
    """From a moving start to rest at a path's end; it lasts `stretch` times the path at least."""
    m = machine.arrays
    state = (np.array(start.position), np.array(start.velocity), np.array(start.acceleration))
    length, speed, acceleration = piston_state(m, *state)
    stroke = lengths_of(m, path.posture[-1:])[0] - length
    least = stretch * float(path.duration.sum())
    jerk, phase = _phases(m, BRISK * m.max_piston_jerk, stroke, speed, acceleration, least)
    share = path.time / path.time[-1]
    return SteeredMotion(
        machine, start.position, length, speed, acceleration, jerk, phase, share
    )


@kernel
def _change(
    v0: float, a0: float, v1: float, a_max: float, j: float, jerk: FloatArray, phase: FloatArray
) -> tuple[float, float]:
    """Jerks and phases of a change of speed from (v₀, a₀) to (v₁, 0); its way [m] and time [s]."""
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
        t = phase[i]
        way += t * (v + t * (0.5 * a + t * jerk[i] / 6.0))
        v += t * (a + 0.5 * t * jerk[i])
        a += t * jerk[i]
        time += t
    return way, time


@kernel
def _by_way_of(
    v: float, v0: float, a0: float, a_max: float, j: float, jerk: FloatArray, phase: FloatArray
) -> tuple[float, float]:
    """Way and time from (v₀, a₀) to rest by the speed v, without keeping it."""
    there, first = _change(v0, a0, v, a_max, j, jerk[:3], phase[:3])
    phase[3] = jerk[3] = 0.0
    back, second = _change(v, 0.0, 0.0, a_max, j, jerk[4:], phase[4:])
    return there + back, first + second


@kernel
def _phases(
    m: MachineArrays,
    j: float,
    stroke: FloatArray,
    speed: FloatArray,
    acceleration: FloatArray,
    least: float,
) -> tuple[FloatArray, FloatArray]:
    """Jerks and phases of all pistons, float64[n, PHASES]; they last `least` s or longer.

    Oracle in the tests: the ends reached, the limits kept, and no shorter bang-bang motion.
    """
    n, a_max = len(stroke), m.max_piston_acceleration
    jerk, phase = np.zeros((n, PHASES)), np.zeros((n, PHASES))
    fastest, longest = np.empty(n), least
    for i in range(n):
        v0, a0, r, p = speed[i], acceleration[i], jerk[i], phase[i]
        high = max(m.max_piston_speed[i], abs(v0))
        low = -high
        way, time = _by_way_of(high, v0, a0, a_max, j, r, p)
        if way > stroke[i]:
            way, time = _by_way_of(low, v0, a0, a_max, j, r, p)
            if way >= stroke[i]:
                high = low
            else:
                for _ in range(HALVINGS):
                    middle = 0.5 * (low + high)
                    way, time = _by_way_of(middle, v0, a0, a_max, j, r, p)
                    if way > stroke[i]:
                        high = middle
                    else:
                        low = middle
        way, time = _by_way_of(high, v0, a0, a_max, j, r, p)
        fastest[i] = high
        if high != 0.0:
            time += max(0.0, (stroke[i] - way) / high)
        longest = max(longest, time)
    for i in range(n):
        v0, a0, r, p = speed[i], acceleration[i], jerk[i], phase[i]
        still, _ = _by_way_of(0.0, v0, a0, a_max, j, r, p)
        left = stroke[i] - still
        v = fastest[i]
        if v * left > 0.0:
            slow, fast = 0.0, v
            for _ in range(HALVINGS):
                middle = 0.5 * (slow + fast)
                way, time = _by_way_of(middle, v0, a0, a_max, j, r, p)
                if time + (stroke[i] - way) / middle > longest:
                    slow = middle
                else:
                    fast = middle
            v = fast
        way, _ = _by_way_of(v, v0, a0, a_max, j, r, p)
        if v != 0.0:
            p[3] = max(0.0, (stroke[i] - way) / v)
    return jerk, phase


@kernel
def _pistons(
    time: FloatArray,
    length: FloatArray,
    speed: FloatArray,
    acceleration: FloatArray,
    jerk: FloatArray,
    phase: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lengths, speeds and accelerations at increasing times, float64[times, n] each."""
    n = len(length)
    x, v, a = np.empty((len(time), n)), np.empty((len(time), n)), np.empty((len(time), n))
    for i in range(n):
        xs, vs, as_, since, k = length[i], speed[i], acceleration[i], 0.0, 0
        for row in range(len(time)):
            while k < PHASES and time[row] >= since + phase[i, k]:
                t = phase[i, k]
                xs += t * (vs + t * (0.5 * as_ + t * jerk[i, k] / 6.0))
                vs += t * (as_ + 0.5 * t * jerk[i, k])
                as_ += t * jerk[i, k]
                since += t
                k += 1
            t = time[row] - since
            r = jerk[i, k] if k < PHASES else 0.0
            if k == PHASES:
                t, vs, as_ = 0.0, 0.0, 0.0
            x[row, i] = xs + t * (vs + t * (0.5 * as_ + t * r / 6.0))
            v[row, i] = vs + t * (as_ + 0.5 * t * r)
            a[row, i] = as_ + t * r
    return x, v, a
