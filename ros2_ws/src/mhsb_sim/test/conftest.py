"""The suite's own arm and simple motions of it, for the tests of the simulator."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mhsb_model.hydraulics import needs_boost
from mhsb_model.machine import Machine, load_machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode, modules_in_use
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, quintic_hermite
from mhsb_model.types import FloatArray, ModeArray
from mhsb_sim.simulation.kernel_parts import compile_simulator

POINT_SPACING = 0.02
SWITCH_MARGIN = 7  # points by which a boost begins early and ends late

Motion = Callable[..., tuple[Trajectory, ModeSchedule]]


@pytest.fixture(scope="session")
def machine() -> Machine:
    """The machine, with everything compiled, so that no test's time includes it."""
    compile_simulator()
    return load_machine()


@pytest.fixture(scope="session")
def motion(machine: Machine) -> Motion:
    """Quintic from a state to rest at a posture, as fast as speed and pump allow, with modes."""

    def make(
        start: MotionState,
        goal: FloatArray,
        stamp_ns: int = 0,
        speed: float = 0.012,
        of: Machine = machine,
    ) -> tuple[Trajectory, ModeSchedule]:
        trajectory = _quintic(of, start, np.asarray(goal, dtype=float), stamp_ns, speed)
        return trajectory, _schedule(of, trajectory)

    return make


def _quintic(
    machine: Machine, start: MotionState, goal: FloatArray, stamp_ns: int, speed: float
) -> Trajectory:
    """The shortest within joint limits, piston speed [m/s] and the main pump's flow."""
    m, zero = machine.arrays, np.zeros(machine.joint_count)
    flow = m.main_pump_flow - machine.joint_count * m.leakage_flow
    for duration in np.geomspace(0.4, 60.0, 100):
        points = int(np.ceil(duration / POINT_SPACING)) + 1
        q, qd, qdd = quintic_hermite(
            np.linspace(0.0, duration, points)[:, None],
            np.array([[duration]]),
            (start.position, start.velocity, start.acceleration),
            (goal, zero, zero),
        )
        pistons = np.array([machine.moment_arms(a) * b for a, b in zip(q, qd, strict=True)])
        inlets = np.where(pistons > 0.0, m.cap_area, m.rod_area)
        inside = np.all((q >= m.joint_min - 1e-9) & (q <= m.joint_max + 1e-9))
        drawn = (np.abs(pistons) * inlets).sum(axis=1)
        if inside and np.abs(pistons).max() <= speed and drawn.max() <= flow:
            break
    else:
        pytest.fail(f"no quintic leads from {start.position} within limits to {goal} rad")
    qd[-1] = 0.0
    offsets = np.round(np.linspace(0.0, duration, points) * SECOND_NS).astype(np.int64)
    return Trajectory(stamp_ns, offsets, q, qd, qdd)


def _schedule(machine: Machine, trajectory: Trajectory) -> ModeSchedule:
    modules = machine.config.hydraulics.modules
    needed = _needed_modes(machine, trajectory)
    modes = needed.copy()
    for k in range(len(needed)):
        near = needed[max(0, k - SWITCH_MARGIN) : k + SWITCH_MARGIN + 1].max(axis=0)
        modes[k] = near if modules_in_use(near, modules.per_mode) <= modules.count else needed[k]
    changes = np.any(np.diff(modes.astype(int), axis=0) != 0, axis=1)
    rows = np.flatnonzero(np.concatenate([[True], changes[:-1], [True]]))
    return ModeSchedule(trajectory.stamp_ns, trajectory.offset_ns[rows], modes[rows])


def _needed_modes(machine: Machine, trajectory: Trajectory) -> ModeArray:
    m, n = machine.arrays, machine.joint_count
    modes = np.zeros(trajectory.position.shape, np.uint8)
    for k, (q, qd, qdd) in enumerate(
        zip(trajectory.position, trajectory.velocity, trajectory.acceleration, strict=True)
    ):
        torque = machine.inverse_dynamics(q, qd, qdd)
        arms = machine.moment_arms(q)
        for j in range(n):
            speed = arms[j] * qd[j]
            if abs(speed) < 2e-4 or k == len(modes) - 1:
                speed = 0.0
            area = m.cap_area[j] if speed > 0 else m.rod_area[j]
            if needs_boost(m, j, torque[j] / arms[j], speed):
                modes[k, j] = Mode.SB if abs(speed) * area > m.servo_pump_flow else Mode.DB
    return modes
