"""`check`: what a machine file amounts to, as text."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from mhsb_model import command_line, hydraulics
from mhsb_model.linkages import linkage
from mhsb_model.machine import Machine, load_machine
from mhsb_model.obstacles.clearance import clearances
from mhsb_model.statics import piston_forces_in
from mhsb_model.types import FloatArray

GRID = 0.05
PSI_SAMPLES = 180


def check(
    file: Annotated[
        Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[FILE]")
    ] = None,
) -> None:
    """Print what a machine file amounts to: reach, moment arms, loads, boost, what zones leave.

    Args:
        file: Machine file (YAML, SI units); the suite's own arm when left out.
    """
    machine = load_machine(file)
    print("\n".join(report(machine)))


def report(machine: Machine) -> list[str]:
    """Lines of text about a machine; positions in m, angles in degrees, pressures in MPa."""
    lines = [f"{machine.name}: {machine.joint_count} joints, hash {machine.hash[:12]}"]
    lines += _joint_lines(machine)
    lines += _hydraulic_lines(machine)
    lines += _workspace_lines(machine)
    if machine.obstacles.names:
        lines += _keep_out_lines(machine)
    return lines


def _joint_lines(machine: Machine) -> list[str]:
    lines = [
        "joint  linkage        range [deg]      moment arm [mm]   stroke [mm]   "
        "straight out: [N m]  p_L [MPa]"
    ]
    straight = np.zeros(machine.joint_count)
    torque = machine.gravity_torque(straight)
    arrays = machine.arrays
    for j, joint in enumerate(machine.config.joints):
        row = arrays.linkage[j]
        lower, upper = joint.limits.lower, joint.limits.upper
        least, largest = linkage.moment_arm_range(row, lower, upper)
        lengths = linkage.motions(row, linkage.angle_grid(lower, upper))[:, 0]
        shown = "    outside the joint's range"
        if lower <= 0.0 <= upper:
            force = torque[j] / linkage.moment_arm(row, 0.0)
            pressure = hydraulics.load_pressure(
                arrays.cap_area[j], arrays.rod_area[j], arrays.tank_pressure, force, force
            )
            shown = f"{torque[j]:10.1f} {pressure / 1e6:16.2f}"
        lines.append(
            f"{j + 1:5d}  {joint.linkage.kind:12s} "
            f"{math.degrees(lower):7.1f} …{math.degrees(upper):6.1f}"
            f"  {1e3 * least:7.1f} …{1e3 * largest:6.1f}"
            f"  {1e3 * np.ptp(lengths):12.1f}  {shown}"
        )
    return lines


def _hydraulic_lines(machine: Machine) -> list[str]:
    arrays = machine.arrays
    per_minute = 6e4
    speed = arrays.servo_pump_flow / arrays.cap_area[0]
    return [
        f"main pump {arrays.supply_pressure / 1e6:.2f} MPa, "
        f"{arrays.main_pump_flow * per_minute:.2f} L/min; "
        f"{arrays.module_count} booster modules of {arrays.servo_pump_flow * per_minute:.3f} L/min "
        f"up to {arrays.max_boost_pressure / 1e6:.1f} MPa; {len(machine.patterns)} mode patterns",
        f"piston speed at most {1e3 * arrays.max_piston_speed:.1f} mm/s; one module extends "
        f"actuator 1 at {1e3 * speed:.1f} mm/s; leakage of all valves "
        f"{machine.joint_count * arrays.leakage_flow * per_minute:.3f} L/min",
    ]


def _workspace_lines(machine: Machine) -> list[str]:
    counts = dict.fromkeys(("P_S", "boost", "too heavy", "no posture"), 0)
    boosted = np.zeros(machine.joint_count, dtype=int)
    nodes = _nodes(machine)
    for x, z in nodes:
        pressures = _lightest_hold(machine, x, z)
        if pressures is None:
            counts["no posture"] += 1
        elif pressures.max() > machine.arrays.max_boost_pressure:
            counts["too heavy"] += 1
        elif pressures.max() > machine.arrays.supply_pressure:
            counts["boost"] += 1
            boosted += pressures > machine.arrays.supply_pressure
        else:
            counts["P_S"] += 1
    by_joint = ", ".join(f"joint {j + 1}: {n}" for j, n in enumerate(boosted))
    return [
        f"of {len(nodes)} points {GRID * 1e3:g} mm apart, in the posture that loads the "
        "cylinders least:",
        f"  {counts['P_S']} are held at supply pressure",
        f"  {counts['boost']} need boost ({by_joint})",
        f"  {counts['too heavy']} are beyond the highest boost pressure",
        f"  {counts['no posture']} have no posture within the joint limits",
    ]


def _keep_out_lines(machine: Machine) -> list[str]:
    """What obstacles leave of the points that the arm reaches."""
    psi = np.linspace(-np.pi, np.pi, PSI_SAMPLES, endpoint=False)
    reached = left = 0
    for x, z in _nodes(machine):
        postures = machine.postures(x, z, psi)
        if len(postures) > 0:
            distance, _ = clearances(machine.arrays, machine.obstacles.path_rows, postures)
            reached += 1
            left += bool(distance.max() >= 0.0)
    share = 100.0 * left / reached if reached else 0.0
    return [
        f"keeping {1e3 * machine.config.keep_out.margin:g} mm clear of "
        f"{'; '.join(machine.obstacles.names)}:",
        f"  {left} of {reached} points that can be reached are left, {share:.0f} %",
    ]


def _nodes(machine: Machine) -> list[tuple[float, float]]:
    area = machine.config.workspace
    extent = int(area.max_radius / GRID) + 1
    least, largest = (area.min_radius / GRID) ** 2, (area.max_radius / GRID) ** 2
    return [
        (i * GRID, k * GRID)
        for i in range(-extent, extent + 1)
        for k in range(-extent, extent + 1)
        if i * GRID >= area.min_x and least - 1e-9 <= i * i + k * k <= largest + 1e-9
    ]


def _lightest_hold(machine: Machine, x: float, z: float) -> FloatArray | None:
    """Supply pressures [Pa] of all actuators in the posture whose greatest is the smallest."""
    psi = np.linspace(-np.pi, np.pi, PSI_SAMPLES, endpoint=False)
    postures = machine.postures(x, z, psi)
    if len(postures) == 0:
        return None
    force = np.empty(postures.shape)
    piston_forces_in(machine.arrays, postures, force)
    needed = hydraulics.required_pressures(machine.arrays, force, np.zeros(force.shape))
    return np.array(needed[np.argmin(needed.max(axis=1))])


def main() -> int:
    """Entry point of `ros2 run mhsb_model check`."""
    return command_line.run(check)


if __name__ == "__main__":
    sys.exit(main())
