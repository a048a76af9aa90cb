"""Limits of a joint motion: joint range, node set, valves, pumps and boost, at every instant.

Quasi-static, as the whole plan: forces are those of gravity. What an actuator can do depends on
the mode it is in, so a motion is judged together with its mode schedule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numba import njit

from mhsb_model.arrays import MachineArrays
from mhsb_model.hydraulics import (
    extension_speed,
    inlet_area,
    load_pressure,
    opposes_motion,
    required_pressure,
    retraction_speed,
)
from mhsb_model.kinematics import tip_position
from mhsb_model.linkage import moment_arm
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_model.statics import piston_forces
from mhsb_model.trajectory import SECOND_NS, Trajectory, quintic_hermite
from mhsb_model.types import FloatArray, ModeArray
from mhsb_model.workspace import node_set_excess

JOINT_TOLERANCE = 1e-6  # rad, rounding of table and interpolation
TIP_TOLERANCE = 1e-4  # m, what a step of the search may do between the instants it is looked at
DEAD_BAND = 2e-4
"""Piston speed below which a cylinder counts as held by its valve [m/s]."""

CHECK_SPACING = 1e-3
"""Spacing of the instants at which a motion is checked [s]."""

# Reserve at both ends of an interval of the trajectory that makes its inside safe: over 20 ms,
# curvature moves a joint by q̈ h²/8 = 0.05 mrad per rad/s².
CLEAR_ANGLE = 2e-3  # rad
CLEAR_DISTANCE = 2e-3  # m
CLEAR_USAGE = 0.95
CLEAR_PRESSURE = 0.999
"""A lower share of the pressure leaves enough for the valve at the least speeds."""

NORMAL = int(Mode.N)


class Limit(IntEnum):
    """What a motion can break first."""

    NONE = 0
    JOINT = 1
    NODE_SET = 2
    USAGE = 3
    MODULES = 4


NONE, JOINT, NODE_SET, USAGE, MODULES = (int(limit) for limit in Limit)


@dataclass(frozen=True)
class Violation:
    """A limit that a motion breaks.

    limit   which
    time    s from the motion's start
    amount  excess over the limit: rad (JOINT), m (NODE_SET), share of what the pumps and valves
            can do (USAGE; infinite where no speed is possible), modules (MODULES)
    """

    limit: Limit
    time: float
    amount: float

    def __str__(self) -> str:
        """One sentence."""
        what = {
            Limit.JOINT: f"a joint limit is passed by {self.amount:.3g} rad",
            Limit.NODE_SET: f"the tip leaves the workspace by {self.amount:.3g} m",
            Limit.USAGE: f"valves and pumps would have to give {1 + self.amount:.3g} times as much",
            Limit.MODULES: f"{self.amount:.0f} booster modules more than fitted are needed",
        }[self.limit]
        return f"{what} at {self.time:.3f} s"


@njit(cache=True, nogil=True)
def speed_limit(m: MachineArrays, j: int, force: float, direction: float, mode: int) -> float:
    """Largest piston speed of actuator j [m/s] in a mode, under `force` [N], in `direction` (±).

    Against the load: K √((p − margin − p_L) A_dir/(A³+a³)), p being P_S in N and the highest
    boost pressure in DB and SB. With it: the valve at P_S, and the filling of the inlet chamber,
    K √P_S/A_dir. Boosted also n Q_SP/A_dir for the n modules of the mode.
    """
    cap, rod = m.cap_area[j], m.rod_area[j]
    inlet = inlet_area(cap, rod, direction)
    k = m.valve_coefficient
    if opposes_motion(force, direction):
        supply = m.supply_pressure if mode == NORMAL else m.max_boost_pressure
        drive = supply - m.boost_margin
        drive -= load_pressure(cap, rod, m.tank_pressure, force, direction)
        speed = k * math.sqrt(max(0.0, drive) * inlet / (cap**3 + rod**3))
    else:
        if direction > 0.0:
            speed = extension_speed(k, cap, rod, m.supply_pressure, m.tank_pressure, force)
        else:
            speed = retraction_speed(k, cap, rod, m.supply_pressure, m.tank_pressure, force)
        speed = min(speed, k * math.sqrt(m.supply_pressure) / inlet)
    if mode != NORMAL:
        speed = min(speed, m.modules_per_mode[mode] * m.servo_pump_flow / inlet)
    return speed


@njit(cache=True, nogil=True)
def usage(m: MachineArrays, speed: FloatArray, force: FloatArray, modes: ModeArray) -> float:
    """Share of what main pump, servo pumps and valves can do that piston speeds [m/s] ask for.

    max( Σ A_dir|v|/(Q_MP − n q_leak), max_j |v_j|/speed_limit_j ); slowing the motion by this
    factor, or less, brings it within the limits. Cylinders in the dead band are left out of the
    second term: the closed valve carries their load.
    """
    n = len(speed)
    flow = 0.0
    worst = 0.0
    for j in range(n):
        v = abs(speed[j])
        flow += inlet_area(m.cap_area[j], m.rod_area[j], speed[j]) * v
        if v > DEAD_BAND:
            limit = speed_limit(m, j, force[j], speed[j], modes[j])
            worst = max(worst, v / limit) if limit > 0.0 else math.inf
    return max(worst, flow / (m.main_pump_flow - n * m.leakage_flow))


@njit(cache=True, nogil=True)
def joint_excess(m: MachineArrays, q: FloatArray) -> float:
    """How far the worst joint lies beyond its limits [rad]; negative within them."""
    worst = -math.inf
    for j in range(len(q)):
        worst = max(worst, max(m.joint_min[j] - q[j], q[j] - m.joint_max[j]))
    return worst


@njit(cache=True, nogil=True)
def _modules(m: MachineArrays, modes: ModeArray) -> int:
    used = 0
    for mode in modes:
        used += m.modules_per_mode[mode]
    return used


@njit(cache=True, nogil=True)
def _pressure_share(
    m: MachineArrays, speed: FloatArray, force: FloatArray, modes: ModeArray
) -> float:
    """Largest share of its pressure that the load of a cylinder takes which may be lifting it.

    Far below the dead band it does not: the valve is closed.
    """
    worst = 0.0
    for j in range(len(speed)):
        lifts = abs(speed[j]) <= DEAD_BAND or opposes_motion(force[j], speed[j])
        if lifts and abs(speed[j]) > 0.25 * DEAD_BAND:
            supply = m.supply_pressure if modes[j] == NORMAL else m.max_boost_pressure
            worst = max(worst, required_pressure(m, j, force[j], 0.0) / supply)
    return worst


@njit(cache=True, nogil=True)
def _judge(
    m: MachineArrays, q: FloatArray, qd: FloatArray, modes: ModeArray, work: FloatArray
) -> tuple[float, float, float]:
    """Node set excess [m], usage and pressure share at one state; work is float64[2, n]."""
    speed, force = work[0], work[1]
    piston_forces(m, q, force)
    for j in range(len(q)):
        speed[j] = moment_arm(m.linkage[j], q[j]) * qd[j]
    x, z = tip_position(m.link_length, q)
    outside = node_set_excess(m, x, z)
    return outside, usage(m, speed, force, modes), _pressure_share(m, speed, force, modes)


@njit(cache=True, nogil=True)
def _highest(
    left: tuple[float, float, float],
    middle: tuple[float, float, float],
    right: tuple[float, float, float],
    i: int,
) -> float:
    """Bound on entry i all over an interval, from its ends and its middle.

    A parabola exceeds the highest of the three by a quarter of the middle's bow at most.
    """
    bow = abs(middle[i] - 0.5 * (left[i] + right[i]))
    return max(left[i], middle[i], right[i]) + bow


@njit(cache=True, nogil=True)
def _first_violation(
    m: MachineArrays,
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    modes: ModeArray,
    spacing: float,
) -> tuple[int, float, float]:
    """Kernel of `first_violation`: limit, time and amount.

    modes are those of the intervals, uint8[k - 1, n]. Its oracle in the tests samples the
    trajectory densely and uses the Machine's methods.
    """
    rows, n = position.shape
    work = np.empty((2, n))
    q = np.empty(n)
    qd = np.empty(n)
    right = (0.0, 0.0, 0.0)
    for i in range(rows - 1):
        used = _modules(m, modes[i])
        if used > m.module_count:
            return MODULES, time[i], float(used - m.module_count)
        if i == 0 or (modes[i] != modes[i - 1]).any():
            right = _judge(m, position[i], velocity[i], modes[i], work)
        left = right
        right = _judge(m, position[i + 1], velocity[i + 1], modes[i], work)
        h = time[i + 1] - time[i]
        clear_rest = (
            max(left[0], right[0]) < -CLEAR_DISTANCE
            and max(left[1], right[1]) < CLEAR_USAGE
            and max(left[2], right[2]) < CLEAR_USAGE
        )
        if not clear_rest:
            for j in range(n):
                _hermite(position, velocity, acceleration, i, j, h, 0.5 * h, q, qd)
            middle = _judge(m, q, qd, modes[i], work)
            clear_rest = (
                _highest(left, middle, right, 0) < 0.0
                and _highest(left, middle, right, 1) < 1.0
                and _highest(left, middle, right, 2) < CLEAR_PRESSURE
            )
        excess = max(joint_excess(m, position[i]), joint_excess(m, position[i + 1]))
        clear_joints = excess < -CLEAR_ANGLE
        if clear_joints and clear_rest:
            continue
        count = int(math.ceil(h / spacing))
        for part in range(count + 1):
            s = h * part / count
            for j in range(n):
                _hermite(position, velocity, acceleration, i, j, h, s, q, qd)
            excess = joint_excess(m, q)
            if excess > JOINT_TOLERANCE:
                return JOINT, time[i] + s, excess
            if clear_rest:
                continue
            outside, share, _ = _judge(m, q, qd, modes[i], work)
            if outside > TIP_TOLERANCE:
                return NODE_SET, time[i] + s, outside
            if share > 1.0:
                return USAGE, time[i] + s, share - 1.0
    return NONE, 0.0, 0.0


@njit(cache=True, nogil=True)
def _hermite(
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    i: int,
    j: int,
    h: float,
    s: float,
    q: FloatArray,
    qd: FloatArray,
) -> None:
    """Value and slope of joint j's quintic, s [s] into interval i of length h [s], to q and qd."""
    start = (position[i, j], velocity[i, j], acceleration[i, j])
    end = (position[i + 1, j], velocity[i + 1, j], acceleration[i + 1, j])
    q[j], qd[j], _ = quintic_hermite(s, h, start, end)


def first_violation(
    machine: Machine, trajectory: Trajectory, schedule: ModeSchedule
) -> Violation | None:
    """The first limit that a trajectory breaks under its mode schedule, or None.

    Looks at every millisecond, except inside intervals that ends and middle show to be clear of
    all limits. Mode changes are expected at the trajectory's points, as S4 makes them.
    """
    limit, time, amount = _first_violation(
        machine.arrays,
        trajectory.offset_ns / SECOND_NS,
        trajectory.position,
        trajectory.velocity,
        trajectory.acceleration,
        schedule.modes_at_many(trajectory.offset_ns[:-1] + schedule.stamp_ns),
        CHECK_SPACING,
    )
    return None if limit == NONE else Violation(Limit(limit), time, amount)
