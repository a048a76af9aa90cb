"""Benchmark of controllers without pressure sensors, over drawn plants of a mobile machine.

    python benchmarks/mobile_benchmark.py run|report out/mobile.json

The arm goes to and fro between two postures at a given speed of its fastest piston, on plants drawn
from `config/variations_mobile.yaml`. `pid` is a PI loop with the reference's speed and the file's
valve curve. Errors of the tip count after the time of learning. Runs in the file are not repeated.
"""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tqdm import tqdm

from mhsb_control import REGISTERED_CONTROLLERS, load_machine
from mhsb_control.lag_compensated import LagCompensatedController, LagCompensatedGains
from mhsb_model.files.config_files import find_config_file
from mhsb_model.linkages.linkage import moment_arm
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray
from mhsb_planner.result_files import write_json
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.study.variations import draw_machine, load_variations

Positional = Annotated[Path, tyro.conf.Positional]
VARIATIONS = Path(__file__).parents[1] / "config" / "variations_mobile.yaml"
CONTROLLERS = ("lag_compensated", "pid")
SPEEDS = (0.02, 0.06)
"""Largest piston speeds of the reference [m/s]."""
WAY = np.array([-0.9, 0.9, 0.8])
"""Way from the start posture to the other end [rad]."""
LEARNING, MEASURED = 60.0, 20.0
"""Time before errors count, and time for which they do [s]."""
PEAK_SPEED, STILL = 1.875, 0.25
"""Peak over mean speed of the profile; share of the planned way below which an arm stands still."""
PROPORTIONAL, INTEGRAL = 1.5, 0.3
"""Gains of the PI loop [1/s], [1/s²]: 60 degrees of phase margin at 0.35 s of delay."""


class PidController(LagCompensatedController):
    """PI on the cylinder length, with the reference's present speed and the file's curve."""

    def __init__(self, machine: Machine, signals: Any, gains: LagCompensatedGains) -> None:
        """Build it like its base class, with integrals at 0."""
        super().__init__(machine, signals, gains)
        self._integrals = np.zeros(machine.joint_count)

    def _command_valves(self) -> None:
        """Command the speed of the reference, corrected by the PI loop."""
        for j, axis in enumerate(self.axes):
            length, speed = self._look_ahead(j, 0.0)
            error = length - float(self._signals.sensors["length"][j])
            self._integrals[j] += INTEGRAL * error / self._gains.rate
            axis.speed = speed + PROPORTIONAL * error + self._integrals[j]
            command = axis.curves[int(axis.speed < 0.0)].command_at(abs(axis.speed))
            bounded = math.copysign(min(command, 1.0), axis.speed)
            self._signals.circuit.actuators["valve_command"][j] = bounded


def build_motion(machine: Machine, start: FloatArray, speed: float, time_ns: int) -> Trajectory:
    """Build minimum-jerk passes to and fro by WAY whose fastest piston reaches a speed."""
    share, linkage = np.linspace(0.0, 1.0, 200, endpoint=False), machine.arrays.linkage
    arms = [list(map(moment_arm, linkage, start + s * WAY)) for s in share]
    duration = PEAK_SPEED * float(np.abs(arms * WAY).max()) / speed
    count = math.ceil((LEARNING + MEASURED) / duration) + 1
    profile = share**3 * (10 - 15 * share + 6 * share**2)
    rate = 30 * share**2 * (1 - share) ** 2 / duration
    change = 60 * share * (1 - share) * (1 - 2 * share) / duration**2
    odd = np.arange(count)[:, None] % 2
    signs = 1 - 2 * odd
    rows = odd + signs * profile, signs * rate, signs * change
    profile, rate, change = (each.ravel() for each in rows)
    offsets = np.round(np.arange(len(profile)) * duration / len(share) * SECOND_NS).astype(np.int64)
    motion = start + np.outer(profile, WAY), np.outer(rate, WAY), np.outer(change, WAY)
    return Trajectory(time_ns, offsets, *motion)


def measure(machine: Machine, plant: Machine, controller: str, speed: float) -> dict[str, Any]:
    """Run to and fro; return errors of tip and cylinders [mm], time lost [s], whether it stands."""
    arm = Simulator(machine, controller, plant=plant)
    motion = build_motion(machine, arm.reference.position, speed, arm.time_ns)
    arm.set_plan(motion, ModeSchedule(motion.stamp_ns, np.array([0]), arm.modes[None, :]))
    errors, strokes, way, before = [], [], 0.0, arm.joint_state.position
    while arm.time_ns < (LEARNING + MEASURED) * SECOND_NS:
        arm.advance(0.01)
        q, wanted = arm.joint_state.position, arm.reference.position
        if arm.time_ns > LEARNING * SECOND_NS:
            apart = machine.tip_in_base(q) - machine.tip_in_base(wanted)
            errors.append(1e3 * float(np.linalg.norm(apart)))
            strokes.append(1e3 * (q - wanted) * list(map(moment_arm, machine.arrays.linkage, q)))
            way += float(np.abs(q - before).sum())
        before = q
    planned = np.abs(np.diff(motion.position, axis=0)).sum() / motion.offset_ns[-1] * SECOND_NS
    return {
        "rms": math.sqrt(np.mean(np.square(errors))),
        "cylinder": float(np.sqrt(np.mean(np.square(strokes), axis=0)).max()),
        "slowed": arm.guard.interventions.slowed,
        "stands": bool(way < STILL * planned * MEASURED),
    }


def run(
    file: Positional,
    draws: int = 12,
    seed: int = 0,
    machine: str = "excavator_1to14",
    length_sensors: str = "encoder_13_bit",
) -> None:
    """Simulate every controller and speed on every plant that is missing in a file.

    Args:
        file: JSON file, read and extended.
        draws: Number of plants.
        seed: Seed of the plants.
        machine: Name of a machine of the suite.
        length_sensors: Class of the plants' length sensors.
    """
    known = load_machine(find_config_file(f"{machine}.yaml"))
    variations = load_variations(known, VARIATIONS)
    found = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    for draw in tqdm(range(draws), unit="draw"):
        plant, drawn = draw_machine(known, variations, np.random.default_rng((seed, draw)), float)
        plant = plant.with_values({"imperfections.sensors.length": length_sensors})
        for speed, name in itertools.product(SPEEDS, CONTROLLERS):
            key = f"{machine} {seed} {draw} {1e3 * speed:.0f} {name}"
            if key not in found:
                about = {"speed": speed, "controller": name, "drawn": drawn}
                found[key] = about | measure(known, plant, name, speed)
                write_json(file, found)


def report(file: Positional) -> None:
    """Print median and 95 % quantile of each controller and speed in a file."""
    found = json.loads(file.read_text(encoding="utf-8")).values()
    for speed, name in itertools.product(SPEEDS, CONTROLLERS):
        own = [each for each in found if (each["speed"], each["controller"]) == (speed, name)]
        median, high = np.quantile([each["rms"] for each in own], (0.5, 0.95))
        cylinder = np.median([each["cylinder"] for each in own])
        slowed = np.median([each["slowed"] for each in own])
        stand = sum(each["stands"] for each in own)
        print(
            f"{1e3 * speed:3.0f} mm/s  {name:16s} tip RMS {median:5.1f} / {high:5.1f} mm, "
            f"cylinder {cylinder:4.1f} mm, slowed {slowed:4.1f} s, {stand} of {len(own)} stand"
        )


if __name__ == "__main__":
    REGISTERED_CONTROLLERS["pid"] = PidController
    tyro.extras.subcommand_cli_from_dict({"run": run, "report": report})
