"""Machines of 1:14 to 20 t follow and arrive with files that have no gains."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mhsb_control import load_machine
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.simulation.simulator import Simulator

Motion = Callable[..., tuple[Trajectory, ModeSchedule]]

BRISK = np.array([0.2, 0.13, -0.13, -0.2])
"""Way of a move whose acceleration and jerk are those of the fastest plans [rad]."""

EXPONENTS = {
    0: "angle kind kept_joints per_mode count efficiency",
    1: "length center_of_mass radius rocker_length coupler_length pitch_radius bore rod min_x "
    "min_radius max_radius spacing max_piston_speed max_piston_acceleration max_piston_jerk "
    "friction_speed length_noise pressure pressure_noise boost_margin max_boost_pressure "
    "main_pump_droop line_relief_pressure chamber_relief_pressure manifold_relief_margin",
    2: "viscous_friction relief_flow_gain",
    3: "mass max_flow displacement rated_flow leakage_flow chamber_dead_volume line_volume "
    "rail_volume manifold_volume check_valve_flow switching_valve_flow servo_pump_flow_reserve "
    "servo_pump_slew rail_bleed_flow anti_cavitation_flow coulomb_friction",
    4: "servo_pump_power main_pump_drag_power",
    5: "inertia",
}
"""Exponents of the size in the quantities of a machine file: of equal shape and density, and with
equal times. Pressures carry the weight and are in proportion to the size; others are as they were.
"""
EXPONENT = {key: power for power, keys in EXPONENTS.items() for key in keys.split()}


def scale(content: Any, size: float) -> Any:
    """Return the content of a machine file, `size` times as large."""
    if isinstance(content, dict):
        return {
            key: size ** EXPONENT.get(key, 0) * value
            if isinstance(value, float)
            else scale(value, size)
            for key, value in content.items()
        }
    return [scale(each, size) for each in content] if isinstance(content, list) else content


def build_machine(weight: float, folder: Path) -> Machine:
    """Return the excavator of 1.6 t with another weight [t], from a file without gains."""
    content = yaml.safe_load(find_config_file("excavator.yaml").read_text(encoding="utf-8"))
    for name in ("coordinated", "independent"):
        del content["servo"][name]
    content["circuit"]["bulk_modulus"] = 4e8  # of hoses, as the 1:14 excavator's
    content["hydraulics"]["main_pump"]["max_flow"] *= 2.0  # all pistons at V_max
    file = folder / "scaled.yaml"
    scaled = scale(content, (weight / 1.6) ** (1 / 3))
    file.write_text(yaml.safe_dump(scaled), encoding="utf-8")
    return load_machine(file)


@pytest.mark.parametrize("weight", [0.03, 1.6, 8.0, 20.0])
def test_a_file_without_gains_follows_and_arrives_at_every_size(
    weight: float, motion: Motion, tmp_path: Path
) -> None:
    machine = build_machine(weight, tmp_path)
    simulator, errors = Simulator(machine), []
    start, speed = simulator.reference.position, machine.config.motion.max_piston_speed
    for goal in (start + BRISK, start, start + BRISK):
        plan = motion(
            simulator.reference, goal, stamp_ns=simulator.time_ns, speed=speed, of=machine
        )
        simulator.set_plan(*plan)
        for _ in range(round(plan[0].duration_ns / SECOND_NS / 0.01)):
            simulator.advance(0.01)
            joints = simulator.joint_state.position, simulator.reference.position
            errors.append(np.linalg.norm(np.diff(machine.tip_in_base(np.array(joints)), axis=0)))
        simulator.advance(0.5)
        missed = machine.tip_in_base(simulator.joint_state.position) - machine.tip_in_base(goal)
        assert np.linalg.norm(missed) < 5e-3 * machine.relative_size
    assert np.sqrt(np.mean(np.square(errors))) < 2.5e-3 * machine.relative_size
