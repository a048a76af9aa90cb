"""Benchmark of the simulator's speed, and of its growth with the number of actuators.

All times are wall-clock medians of `REPEATS` runs on one thread, taken in succession:

    real_time_factor   simulated over real time of a boosted motion
    step_us            one step of it [µs]
    kernel_us          part of sensors, servo and circuit, with the arm standing still [µs]
    bare_mj_step_us    MuJoCo's own step of the same model [µs]
    growth             these figures for arms with more actuators, without slew
"""

from __future__ import annotations

import json
import os
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Annotated, Any

import mujoco
import numpy as np
import tyro

from mhsb_model import command_line
from mhsb_model.command import Command
from mhsb_model.command_line import OptionalFile
from mhsb_model.machine import Machine, load_machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_model.trajectory import MAX_POINT_SPACING_NS, SECOND_NS, Trajectory
from mhsb_model.types import ModeArray
from mhsb_sim.mechanics.mujoco_model import build_model
from mhsb_sim.simulation.simulator import Simulator

REPEATS = 5
"""Number of runs of which medians are taken."""
DURATION = 5.0
"""Simulated time of a run [s]."""

TIMES = (1, 2, 4)
"""Numbers of repetitions of the arm's joints."""

SWING = 0.05
"""Amplitude of every joint's motion [rad], once in `DURATION`."""


def arm_of(machine: Machine, joints: int) -> Machine:
    """Return an arm that repeats a machine's joints and links, without gravity.

    There is one booster module for each joint and a spare one; the main pump's flow grows with the
    number of repetitions. Link masses are divided by this number, so that the whole arm is as heavy
    as the machine. The bulk modulus is divided by its square, so that the arm swings no faster and
    takes the same step.

    Args:
        machine: The arm to repeat.
        joints: Number of joints.

    Returns:
        The longer arm.
    """
    content = machine.config.model_dump()
    given, start = content["joints"], content["simulation"]["start_posture"]
    times = -(-joints // len(given))
    for joint in given:
        joint["link"]["mass"] /= times
        joint["link"]["inertia"] /= times
    content["joints"] = [given[j % len(given)] for j in range(joints)]
    content["gravity"] = 0.0
    content["simulation"]["start_posture"] = [start[j % len(start)] for j in range(joints)]
    content["hydraulics"]["modules"]["count"] = joints + 1
    content["hydraulics"]["main_pump"]["max_flow"] *= times
    content["circuit"]["bulk_modulus"] /= times**2
    content["motion"]["kept_joints"] = []
    return Machine.from_config(type(machine.config).model_validate(content))


def boosted_swing(machine: Machine) -> Command:
    """Return a command that swings every joint once in `DURATION`, boosted as `most_boosted`.

        q = q₀ ± SWING (1 − cos ωt)²/4,  ω = 2π/DURATION

    q₀ is the start posture; the sign leads towards the middle of the joint's range. Velocity and
    acceleration are zero at both ends. The modes do not change.

    Args:
        machine: The arm.

    Returns:
        The command, which begins at time 0.
    """
    time = np.arange(0.0, DURATION + 1e-9, MAX_POINT_SPACING_NS / SECOND_NS)[:, None]
    omega = 2.0 * np.pi / DURATION
    start = np.array(machine.config.simulation.start_posture)
    middle = (machine.arrays.joint_min + machine.arrays.joint_max) / 2.0
    size = 0.25 * SWING * np.sign(middle - start)
    wave, slope = 1.0 - np.cos(omega * time), omega * np.sin(omega * time)
    trajectory = Trajectory(
        0,
        np.rint(time[:, 0] * SECOND_NS).astype(np.int64),
        start + size * wave**2,
        size * 2.0 * wave * slope,
        size * 2.0 * (slope**2 + wave * omega**2 * np.cos(omega * time)),
    )
    modes = most_boosted(machine)[None, :]
    return Command(trajectory, ModeSchedule(0, np.array([0]), modes))


def most_boosted(machine: Machine) -> ModeArray:
    """Return a mode combination that uses as many booster modules as possible.

    The first actuator in the plane is in SB, and as many others in DB as there are modules for.

    Args:
        machine: The arm.

    Returns:
        Modes, shape (n,).
    """
    a, modes = machine.arrays, np.full(machine.joint_count, Mode.N)
    left = a.module_count
    for j in range(int(machine.slews), machine.joint_count):
        mode = Mode.SB if j == int(machine.slews) else Mode.DB
        if left >= a.modules_per_mode[mode]:
            modes[j], left = mode, left - int(a.modules_per_mode[mode])
    return modes


class HydraulicsStepper(Simulator):
    """Simulator that can run without its mechanics."""

    def step_hydraulics(self) -> None:
        """Run sensors, servo and circuit for one step while the arm does not move.

        Time and reference do not advance, and divergence is not detected.
        """
        self._control_valves()
        self._push(True, self._first_substeps)
        self._follow_pistons(self._last_substeps)


def measure(machine: Machine, controller: str = "coordinated") -> dict[str, float]:
    """Measure the simulator's speed for one machine.

    Args:
        machine: The arm.
        controller: Name of the servo controller.

    Returns:
        `real_time_factor` and the times of a step [µs], see the module's text.
    """
    command = boosted_swing(machine)
    simulator = HydraulicsStepper(machine, controller)
    simulator.step()  # compiles the kernels, so that this is not part of the times
    steps = round(DURATION * SECOND_NS / simulator.step_ns)
    model = build_model(machine)
    data = mujoco.MjData(model)

    def run() -> None:
        """Simulate the whole swing from the start."""
        simulator.reset()
        simulator.set_plan(command.trajectory, command.schedule)
        simulator.advance(DURATION)

    def hydraulics() -> None:
        """Step sensors, servo and circuit as often as a run has steps, without the mechanics."""
        for _ in range(steps):
            simulator.step_hydraulics()

    def bare() -> None:
        """Step MuJoCo alone as often as a run has steps."""
        for _ in range(steps):
            mujoco.mj_step(model, data)

    step_us = 1e6 * _median_seconds(run) / steps
    simulator.reset()
    simulator.set_plan(command.trajectory, command.schedule)
    simulator.advance(0.3 * DURATION)  # so that the servo is measured during the motion
    return {
        "real_time_factor": 1e6 * simulator.step_ns / SECOND_NS / step_us,
        "step_us": step_us,
        "kernel_us": 1e6 * _median_seconds(hydraulics) / steps,
        "bare_mj_step_us": 1e6 * _median_seconds(bare) / steps,
    }


def _median_seconds(work: Callable[[], None]) -> float:
    """Return the median wall time of `REPEATS` calls [s].

    Args:
        work: Function to call.

    Returns:
        The median time [s].
    """
    seconds = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return median(seconds)


def benchmark(
    output: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("out/bench/simulation.json"),
    machine: OptionalFile = None,
) -> None:
    """Measure the simulator's speed: times [µs] of a step, medians of five runs.

    Args:
        output: JSON file to write.
        machine: Machine file (YAML); the suite's own arm when left out.
    """
    arm = load_machine(machine)
    result: dict[str, Any] = measure(arm)
    joints = [times * arm.planar_arm.joint_count for times in TIMES]
    result["growth"] = {str(count): measure(arm_of(arm.planar_arm, count)) for count in joints}
    result["load_average"] = os.getloadavg()[0]
    result["processor"] = platform.processor() or platform.machine()
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(result, indent=2))


def main() -> int:
    """Entry point of `scripts/bench simulation`."""
    return command_line.run(benchmark, name="bench simulation")


if __name__ == "__main__":
    sys.exit(main())
