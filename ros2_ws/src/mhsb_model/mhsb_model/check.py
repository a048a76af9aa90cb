"""`check`: what a machine file amounts to, as text or JSON."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from mhsb_model import command_line, hydraulics
from mhsb_model.linkages import linkage
from mhsb_model.machine import Machine, load_machine
from mhsb_model.obstacles.clearance import clearances
from mhsb_model.types import FloatArray, frozen

PSI_SAMPLES, TELESCOPE_PSI_SAMPLES = 180, 3600
"""Angles of the end link at each point: a telescope's whole range may take a few degrees."""

SLEW_SAMPLES = 72
"""Angles of the slew: five degrees apart where it turns all the way."""

SLEW_DRIVES = ("rack_and_pinion", "motor")
"""Linkages of what slews, on which no load weighs."""


def check(
    file: Annotated[
        Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[FILE]")
    ] = None,
    json_: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Print what a machine file amounts to: reach, moment arms, loads, boost, what zones leave.

    Args:
        file: Machine file (YAML, SI units); the suite's own arm when left out.
        json_: Print one JSON object, in SI units, instead of text.
    """
    machine = load_machine(file)
    if json_:
        print(json.dumps(facts(machine)))
    else:
        print("\n".join(report(machine)))


def facts(machine: Machine) -> dict[str, Any]:
    """What a machine amounts to, in SI units."""
    found = {
        "name": machine.name,
        "hash": machine.plane.hash,
        "slews": machine.slews,
        "joints": [_joint_facts(machine, j) for j in range(machine.joint_count)],
        "hydraulics": _hydraulic_facts(machine),
        "workspace": _workspace_facts(machine.plane),
    }
    if machine.obstacles.names:
        found["keep_out"] = _keep_out_facts(machine)
    return found


def report(machine: Machine) -> list[str]:
    """The facts as lines of text; positions in m, angles in degrees, pressures in MPa."""
    found = facts(machine)
    lines = [f"{machine.name}: {machine.joint_count} joints, hash {machine.hash[:12]}"]
    lines += _joint_lines(found["joints"]) + _hydraulic_lines(found["hydraulics"])
    lines += _own_lines(found["joints"])
    lines += _workspace_lines(found["workspace"], 2 if found["slews"] else 1)
    if "keep_out" in found:
        lines += _keep_out_lines(found["keep_out"])
    return lines


def _joint_facts(machine: Machine, j: int) -> dict[str, Any]:
    """Of one joint; torque and load pressure with the arm straight out, None where it cannot be."""
    arrays, joint = machine.arrays, machine.config.joints[j]
    row = arrays.linkage[j]
    lower, upper = joint.limits.lower, joint.limits.upper
    least, largest = linkage.moment_arm_range(row, lower, upper)
    lengths = linkage.motions(row, linkage.angle_grid(lower, upper))[:, 0]
    torque = pressure = None
    if lower <= 0.0 <= upper and not (machine.slews and j == 0):
        torque = float(machine.gravity_torque(np.zeros(machine.joint_count))[j])
        force = torque / linkage.moment_arm(row, 0.0)
        pressure = float(
            hydraulics.load_pressure(
                arrays.cap_area[j], arrays.rod_area[j], arrays.tank_pressure, force, force
            )
        )
    slides = bool(machine.arrays.slides[j])
    return {
        "linkage": joint.linkage.kind,
        "range_m" if slides else "range_rad": [float(lower), float(upper)],
        "moment_arm_m": [float(least), float(largest)],
        "stroke_m": float(np.ptp(lengths)),
        "straight_out_force_n" if slides else "straight_out_torque_nm": torque,
        "straight_out_load_pressure_pa": pressure,
        "own": joint.actuator.model_dump(exclude_defaults=True),
    }


def _joint_lines(joints: list[dict[str, Any]]) -> list[str]:
    lines = [
        "joint  linkage        range [deg]      moment arm [mm]   stroke [mm]   "
        "straight out: [N m]  p_L [MPa]"
    ]
    for number, joint in enumerate(joints, start=1):
        slides, pressure = "range_m" in joint, joint["straight_out_load_pressure_pa"]
        lower, upper = (1e3 * q for q in joint["range_m"]) if slides else map(
            math.degrees, joint["range_rad"]
        )
        torque = joint["straight_out_force_n" if slides else "straight_out_torque_nm"]
        least, largest = joint["moment_arm_m"]
        arms = f" mm{'-':>14s}" if slides else f"  {1e3 * least:7.1f} …{1e3 * largest:6.1f}"
        shown = "    outside the joint's range"
        if joint["linkage"] in SLEW_DRIVES:
            shown = f"{'-':>10s} {'-':>16s}"
        if torque is not None:
            newtons = f"{torque:8.1f} N" if slides else f"{torque:10.1f}"
            shown = f"{newtons} {pressure / 1e6:16.2f}"
        lines.append(
            f"{number:5d}  {joint['linkage']:12s} {lower:7.1f} …{upper:6.1f}{arms}"
            f"  {1e3 * joint['stroke_m']:12.1f}  {shown}"
        )
    return lines


def _hydraulic_facts(machine: Machine) -> dict[str, Any]:
    arrays, first = machine.arrays, int(machine.slews)  # what slews is always in N
    return {
        "supply_pressure_pa": float(arrays.supply_pressure),
        "main_pump_flow_m3_s": float(arrays.main_pump_flow),
        "booster_modules": int(arrays.module_count),
        "servo_pump_flow_m3_s": float(arrays.servo_pump_flow),
        "max_boost_pressure_pa": float(arrays.max_boost_pressure),
        "mode_patterns": len(machine.plane.patterns),
        "max_piston_speed_m_s": float(arrays.max_piston_speed.max()),
        "first_boosted": first + 1,
        "speed_of_one_module_m_s": float(arrays.servo_pump_flow / arrays.cap_area[first]),
        "leakage_m3_s": float(machine.joint_count * arrays.leakage_flow),
    }


def _hydraulic_lines(found: dict[str, Any]) -> list[str]:
    per_minute = 6e4
    return [
        f"main pump {found['supply_pressure_pa'] / 1e6:.2f} MPa, "
        f"{found['main_pump_flow_m3_s'] * per_minute:.2f} L/min; {found['booster_modules']} "
        f"booster modules of {found['servo_pump_flow_m3_s'] * per_minute:.3f} L/min "
        f"up to {found['max_boost_pressure_pa'] / 1e6:.1f} MPa; {found['mode_patterns']} "
        "mode patterns",
        f"piston speed at most {1e3 * found['max_piston_speed_m_s']:.1f} mm/s; one module extends "
        f"actuator {found['first_boosted']} at {1e3 * found['speed_of_one_module_m_s']:.1f} mm/s; "
        f"leakage of all valves {found['leakage_m3_s'] * per_minute:.3f} L/min",
    ]


OWN = {
    "rated_flow": ("valve of {:.2f} L/min", 6e4),
    "rated_pressure_drop_per_land": ("rated drop of {:.2f} MPa at each land", 1e-6),
    "max_piston_speed": ("piston speed of at most {:.1f} mm/s", 1e3),
    "friction": ("{:g} times the friction", 1.0),
    "relief_pressure": ("chambers relieved at {:.1f} MPa", 1e-6),
}
"""How what an actuator has of its own is told, and by what its SI value is multiplied."""


def _own_lines(joints: list[dict[str, Any]]) -> list[str]:
    """A line for each actuator that has something of its own."""
    lines = []
    for number, joint in enumerate(joints, start=1):
        told = [OWN[name][0].format(OWN[name][1] * value) for name, value in joint["own"].items()]
        lines += [f"actuator {number} has of its own: {', '.join(told)}"] if told else []
    return lines


def _workspace_facts(machine: Machine) -> dict[str, Any]:
    counts = dict.fromkeys(("held", "boosted", "too_heavy", "no_posture"), 0)
    boosted = np.zeros(machine.joint_count, dtype=int)
    nodes = _nodes(machine)
    for x, z in nodes:
        pressures = _lightest_hold(machine, x, z)
        if pressures is None:
            counts["no_posture"] += 1
        elif pressures.max() > machine.arrays.max_boost_pressure:
            counts["too_heavy"] += 1
        elif pressures.max() > machine.arrays.supply_pressure:
            counts["boosted"] += 1
            boosted += pressures > machine.arrays.supply_pressure
        else:
            counts["held"] += 1
    return {
        "points": len(nodes),
        "spacing_m": machine.spacing,
        "end_link_angles": len(_end_link_angles(machine)),
        **counts,
        "boosted_by_joint": boosted.tolist(),
    }


def _end_link_angles(machine: Machine) -> FloatArray:
    """Angles ψ at which postures are looked for [rad]."""
    count = TELESCOPE_PSI_SAMPLES if machine.has_telescope else PSI_SAMPLES
    return np.linspace(-np.pi, np.pi, count, endpoint=False)


def _workspace_lines(found: dict[str, Any], first: int) -> list[str]:
    """first: number of the first joint in the plane."""
    by_joint = ", ".join(f"joint {j}: {n}" for j, n in enumerate(found["boosted_by_joint"], first))
    return [
        f"of {found['points']} points {found['spacing_m'] * 1e3:g} mm apart, in the posture that "
        "loads the cylinders least:",
        f"  {found['held']} are held at supply pressure",
        f"  {found['boosted']} need boost ({by_joint})",
        f"  {found['too_heavy']} are beyond the highest boost pressure",
        f"  {found['no_posture']} have no posture within the joint limits at "
        f"{found['end_link_angles']} angles of the end link",
    ]


def _keep_out_facts(machine: Machine) -> dict[str, Any]:
    """What obstacles leave of the points that the arm reaches: in its plane or, where zones are in
    space, in its plane at each of many angles of the slew."""
    plane, in_space = machine.plane, bool(machine.obstacles.in_space.any())
    psi, turned = _end_link_angles(plane), _slew_angles(machine) if in_space else np.zeros(1)
    near = [angle for angle in turned if len(machine.plane_among(angle, angle).shadows.rows)]
    reached = left = 0
    for x, z in _nodes(plane):
        postures = plane.postures(x, z, psi)
        if len(postures) == 0:
            continue
        reached += len(turned)
        distance, _ = clearances(plane.arrays, plane.obstacles.path_rows, postures)
        clear = frozen(postures[distance >= 0.0])
        if len(clear) > 0:
            left += len(turned) - len(near)
            left += sum(_is_clear_of_zones(machine, angle, clear) for angle in near)
    return {
        "margin_m": float(machine.config.keep_out.margin),
        "obstacles": list(machine.obstacles.names),
        **({"slew_angles": len(turned)} if in_space else {}),
        "reached": reached,
        "left": left,
    }


def _slew_angles(machine: Machine) -> FloatArray:
    """Angles of the slew at which zones are looked for [rad]."""
    return np.linspace(machine.arrays.joint_min[0], machine.arrays.joint_max[0], SLEW_SAMPLES)


def _is_clear_of_zones(machine: Machine, slew: float, postures: FloatArray) -> bool:
    """Whether one of the plane's postures float64[k, n − 1] keeps clear of all zones in space while
    the slew is at an angle [rad]."""
    zones = frozen(machine.obstacles.path_rows[machine.obstacles.in_space])
    turned = frozen(np.column_stack([np.full(len(postures), slew), postures]))
    return bool(clearances(machine.arrays, zones, turned)[0].max() >= 0.0)


def _keep_out_lines(found: dict[str, Any]) -> list[str]:
    left, reached, where = found["left"], found["reached"], ""
    share = 100.0 * left / reached if reached else 0.0
    if "slew_angles" in found:
        where = f", counted at {found['slew_angles']} angles of the slew"
    return [
        f"keeping {1e3 * found['margin_m']:g} mm clear of {'; '.join(found['obstacles'])}:",
        f"  {left} of {reached} points that can be reached are left, {share:.0f} %{where}",
    ]


def _nodes(machine: Machine) -> list[tuple[float, float]]:
    area, apart = machine.config.workspace, machine.spacing
    extent = int(area.max_radius / apart) + 1
    least, largest = (area.min_radius / apart) ** 2, (area.max_radius / apart) ** 2
    return [
        (i * apart, k * apart)
        for i in range(-extent, extent + 1)
        for k in range(-extent, extent + 1)
        if i * apart >= area.min_x and least - 1e-9 <= i * i + k * k <= largest + 1e-9
    ]


def _lightest_hold(machine: Machine, x: float, z: float) -> FloatArray | None:
    """Supply pressures [Pa] of all actuators in the posture whose greatest is the smallest."""
    psi = _end_link_angles(machine)
    postures = machine.postures(x, z, psi)
    if len(postures) == 0:
        return None
    force = machine.piston_forces_in(postures)
    needed = hydraulics.required_pressures(machine.arrays, force, np.zeros(force.shape))
    return np.array(needed[np.argmin(needed.max(axis=1))])


def main() -> int:
    """Entry point of `ros2 run mhsb_model check`."""
    return command_line.run(check)


if __name__ == "__main__":
    sys.exit(main())
