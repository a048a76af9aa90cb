"""`check`: print a summary of a machine file as text or JSON."""

import json
import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from mhsb_control import (
    default_controller,
    load_machine,
    measures_pressures,
    select_controllers,
)
from mhsb_control.delay_line import describe_uncompensated_delay
from mhsb_model import command_line, hydraulics
from mhsb_model.circuit.dead_time import compute_dead_time, compute_valve_lag
from mhsb_model.command_line import JsonFlag, OptionalFile
from mhsb_model.files.output_folders import make_parent_folder
from mhsb_model.linkages import linkage
from mhsb_model.machine import Machine
from mhsb_sim.circuit.valves.registry import read_valve_sections
from mhsb_sim.simulation.fault_detection import SupervisionLimits
from mhsb_sim.simulation.fault_isolation import compute_frozen_length_time
from mhsb_sim.simulation.sensors import select_length_class
from mhsb_tools.commands.machine_doubts import list_doubts
from mhsb_tools.moves.workspace_drawing import draw_workspace_picture
from mhsb_tools.moves.workspace_points import (
    count_points_left,
    count_workspace_points,
    find_hold_regions,
)

FLOW_SHARES = (0.1, 0.5, 0.9)
"""Shares of the full flow at which the commands of a declared curve are given [-]."""

SLEW_DRIVES = ("rack_and_pinion", "motor")
"""Kinds of linkage that drive a slewing joint, which carries no gravity load."""


def check(
    file: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[FILE]")] = None,
    plot: OptionalFile = None,
    json_: JsonFlag = False,
) -> None:
    """Print a summary of a machine file: reach, moment arms, loads, boost, room left by zones.

    Args:
        file: Machine file (YAML, SI units); the suite's own arm when left out.
        plot: Picture (PNG) of the workspace: reachable points, where loads need boost, zones, and
            the arm in its start posture.
        json_: Print one JSON object, in SI units, instead of text.

    Raises:
        UsageError: `plot` does not end in .png.
        MhsbError: The file, or its section on valves, is invalid, or the picture cannot be written.
    """
    command_line.check_suffix("plot", plot, ".png")
    machine = load_machine(file)
    read_valve_sections(machine)
    if plot is not None:
        make_parent_folder(plot, "the picture")
        draw_workspace_picture(machine, find_hold_regions(machine), plot)
    if json_:
        print(json.dumps(collect_facts(machine)))
    else:
        print("\n".join(format_report(machine)))


def collect_facts(machine: Machine) -> dict[str, Any]:
    """Collect the numbers that describe a machine.

    Args:
        machine: The arm; every point of its workspace grid is examined.

    Returns:
        A dictionary that can be written as JSON, in SI units. Keys:

        - name: name in the machine file
        - hash: SHA-256 in hexadecimal of all values on which the posture table depends
        - machine_hash: `Machine.planning_hash`, which planner, arm, estimates files and recordings
            report under this name
        - slews: whether joint 1 turns the arm about an upright axis
        - joints: a list with a dictionary for each joint: range, moment arm, stroke, load
        - hydraulics: pressures, flows and speeds
        - controllers: names of the controllers that work with the machine's sensors
        - default_controller: the controller that runs if the user chooses none
        - pressure_sensors: whether the machine has pressure sensors
        - length_sensors: their class, rate, and the time in which a frozen one is found
        - dead_bands: valve openings below which no oil flows, extending and retracting [-]
        - valve_curves: tables of the openings, extending and retracting; None for a straight line
        - compensated_drop_pa: largest drop over one edge of a valve; None without compensators
        - workspace: counts of grid points that are held, need boost, or cannot be held
        - doubts: sentences on values with which the machine cannot work
        - keep_out: counts of grid points that stay reachable beside the obstacles; missing if the
            machine has none
    """
    points = count_workspace_points(machine.planar_arm)
    found = {
        "name": machine.name,
        "hash": machine.planar_arm.table_hash,
        "machine_hash": machine.planning_hash,
        "slews": machine.slews,
        "joints": [_joint_facts(machine, j) for j in range(machine.joint_count)],
        "hydraulics": _hydraulic_facts(machine),
        "controllers": list(select_controllers(machine)),
        "default_controller": default_controller(machine),
        "pressure_sensors": measures_pressures(machine),
        "length_sensors": _length_sensor_facts(machine),
        "dead_bands": list(machine.config.imperfections.overlaps),
        "valve_curves": list(machine.config.imperfections.curves),
        "compensated_drop_pa": machine.config.hydraulics.valve.compensated_drop,
        "workspace": points,
    }
    if machine.obstacles.names:
        found["keep_out"] = count_points_left(machine)
    held = points["held"] + points["boosted"]
    found["doubts"] = list_doubts(machine, held, held + points["too_heavy"])
    return found


def format_report(machine: Machine) -> list[str]:
    """Compute the numbers that describe a machine and format them as lines of text.

    Args:
        machine: The arm.

    Returns:
        Lines without line breaks, with angles in degrees, pressures in MPa and flows in L/min:

        - name and hashes, table of joints, pumps and booster modules
        - values that the file gives to one actuator only
        - suitable controllers, length sensors, dead bands, curves and compensators of the valves
        - dead time of a machine without pressure sensors, else the declared delay of commands
        - a sentence on a delay that the controller `coordinated` does not compensate
        - counts of workspace points and, if there are obstacles, of those that remain reachable
        - warnings (`machine_doubts`)
    """
    found = collect_facts(machine)
    lines = [
        f"{machine.name}: {machine.joint_count} joints; machine_hash "
        f"{found['machine_hash'][:12]}, posture table {found['hash'][:12]}"
    ]
    lines += _joint_lines(found["joints"]) + _hydraulic_lines(found["hydraulics"])
    lines += _own_lines(found["joints"])
    sensors = "pressure sensors" if found["pressure_sensors"] else "length sensors alone"
    names = [
        f"{name} (default)" if name == found["default_controller"] else name
        for name in found["controllers"]
    ]
    lines.append(f"controllers that suit its {sensors}: {', '.join(names)}")
    lines += _sensor_and_valve_lines(found["length_sensors"], found["dead_bands"])
    lines += _curve_and_compensator_lines(machine)
    delay = machine.config.imperfections.computing_delay
    if dead_time := compute_dead_time(machine):
        lines.append(
            f"its servo needs a plan {1e3 * dead_time:.0f} ms ahead: computing delay and valve lag "
            f"are {1e3 * delay:.0f} ms and "
            f"{1e3 * compute_valve_lag(machine):.0f} ms, at least "
            f"{1e3 * machine.expected_delay:.0f} ms are expected"
        )
    elif delay:
        lines.append(f"declared delay of commands: {1e3 * delay:g} ms")
    limitation = describe_uncompensated_delay(machine)
    if limitation and "coordinated" in found["controllers"]:
        lines.append(limitation)
    lines += _workspace_lines(
        found["workspace"],
        2 if found["slews"] else 1,
        has_boosters=found["hydraulics"]["booster_modules"] > 0,
    )
    if "keep_out" in found:
        lines += _keep_out_lines(found["keep_out"])
    return lines + [f"warning: {doubt}" for doubt in found["doubts"]]


def _length_sensor_facts(machine: Machine) -> dict[str, Any]:
    """Collect class and rate of the length sensors, and how soon a frozen sensor is found.

    Args:
        machine: The arm.

    Returns:
        A dictionary. Keys:

        - class: name in the machine file
        - rate_hz: readings in a second
        - noise_rad, offset_rad, drift_rad_s: standard deviations of the joint angle; noise is None
          if the file gives it for lengths
        - frozen_found_s: longest time in which the simulator's supervision, with default limits,
          finds a frozen sensor; the fastest piston moves at V_max; None if it is not found
    """
    sensors = machine.config.imperfections.sensors
    _, limit = SupervisionLimits.for_controller(default_controller(machine)).frozen_length
    time = compute_frozen_length_time(machine, limit)
    kind = select_length_class(sensors)
    return {
        "class": sensors.length,
        "rate_hz": sensors.rate or 1.0 / machine.config.simulation.step,
        "noise_rad": kind.noise,
        "offset_rad": kind.offset,
        "drift_rad_s": kind.drift,
        "frozen_found_s": time if math.isfinite(time) else None,
    }


def _sensor_and_valve_lines(sensors: dict[str, Any], dead_bands: list[float]) -> list[str]:
    """Format length sensors and dead bands as one line of text each.

    Args:
        sensors: Values as `_length_sensor_facts` returns them.
        dead_bands: Dead bands of the valves in extension and retraction, shares of the spool's
            stroke.

    Returns:
        A line on the sensors; a line on the dead bands if there are any.
    """
    time = sensors["frozen_found_s"]
    found = "a frozen one is not found by its readings, since they have no noise"
    if time is not None:
        found = f"at V_max a frozen one is found within {1e3 * time:.0f} ms"
    errors = [
        f"{math.degrees(unit * value):.2g}° {words}"
        for value, unit, words in (
            (sensors["noise_rad"], 1.0, "of noise"),
            (sensors["offset_rad"], 1.0, "of offset"),
            (sensors["drift_rad_s"], 60.0, "a minute of drift"),
        )
        if value
    ]
    having = f" with {', '.join(errors)}" if errors else ""
    lines = [
        f"length sensors '{sensors['class']}' read at {sensors['rate_hz']:g} Hz{having}; {found}"
    ]
    if any(dead_bands):
        extending, retracting = (f"{100.0 * each:g} %" for each in dead_bands)
        lines.append(
            f"dead bands of the valves: {extending} of the stroke extending, {retracting} "
            "retracting"
        )
    return lines


def _curve_and_compensator_lines(machine: Machine) -> list[str]:
    """Format the valves' declared curves and pressure compensators as one line of text each.

    Args:
        machine: The arm.

    Returns:
        For each direction with a declared curve, a line on the commands for a tenth, a half and
        nine tenths of the full flow, dead band included. A line on the compensators if there are
        any. It has the piston speed of each actuator with a fully open valve.
    """
    real, valve, lines = machine.config.imperfections, machine.config.hydraulics.valve, []
    for curve, overlap, direction in zip(
        real.curves, real.overlaps, ("extending", "retracting"), strict=True
    ):
        if curve is not None:
            strokes, openings = np.array(curve).T
            stroke = np.interp(FLOW_SHARES, openings, strokes) ** (1.0 / real.valve_exponent)
            commands = ", ".join(f"{100 * each:.0f}" for each in overlap + (1 - overlap) * stroke)
            shares = ", ".join(f"{100 * each:.0f}" for each in FLOW_SHARES)
            lines.append(
                f"curve of the valves, {direction}: {shares} % of the flow at {commands} % of the "
                "command"
            )
    if valve.compensated_drop is not None:
        m = machine.arrays
        full = m.valve_coefficient * math.sqrt(valve.compensated_drop) / m.cap_area
        speeds = ", ".join(f"{1e3 * each:.0f}" for each in full)
        lines.append(
            f"pressure compensators keep {valve.compensated_drop / 1e6:g} MPa over each edge of "
            f"the valves: at full command pistons move at {speeds} mm/s with every load"
        )
    return lines


def _joint_facts(machine: Machine, j: int) -> dict[str, Any]:
    """Collect range, moment arm, stroke and load of one joint.

    The load is computed for the straight arm (all joint positions 0) at rest under gravity.

    Args:
        machine: The arm.
        j: Index of the joint, from 0.

    Returns:
        A dictionary in SI units. Keys:

        - linkage: kind of linkage between cylinder and joint
        - range_rad (range_m for a telescope): least and largest joint position
        - moment_arm_m: least and largest moment arm dL/dq over the range, signed
        - cylinder_length_m: cylinder length at the lower and at the upper end of the range
        - stroke_m: change of the cylinder length over the range
        - straight_out_torque_nm (straight_out_force_n for a telescope): torque (or force) that
          holds the load; None if the joint slews, or cannot be at position 0
        - straight_out_load_pressure_pa: supply pressure that holds the load; None if the torque (or
          force) is None
        - own: values that the machine file gives to this actuator alone, by their key
    """
    arrays, joint = machine.arrays, machine.config.joints[j]
    row = arrays.linkage[j]
    lower, upper = joint.limits.lower, joint.limits.upper
    least, largest = linkage.moment_arm_range(row, lower, upper)
    lengths = linkage.evaluate_linkage_at_angles(row, linkage.angle_grid(lower, upper))[:, 0]
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
        "cylinder_length_m": [float(lengths[0]), float(lengths[-1])],
        "stroke_m": float(np.ptp(lengths)),
        "straight_out_force_n" if slides else "straight_out_torque_nm": torque,
        "straight_out_load_pressure_pa": pressure,
        "own": joint.actuator.model_dump(exclude_defaults=True),
    }


def _joint_lines(joints: list[dict[str, Any]]) -> list[str]:
    """Format range, moment arm, cylinder length and load of all joints as a table.

    The last two columns are for the arm straight out (all joint positions 0): torque [N m] and load
    pressure p_L [MPa]. Each is "-" for a slew drive, and if position 0 is outside the joint's
    range. A line below the table then says that the arm cannot be straight.

    Args:
        joints: One dictionary for each joint, as `_joint_facts` returns it.

    Returns:
        A line of column titles, then one line for each joint, then the line on a bent arm. The
        columns are: number from 1, kind of linkage, range [deg], moment arm [mm], cylinder
        length at the lower and at the upper end of the range [mm], torque, load pressure. A
        telescope has its range in mm, "-" as moment arm, and a force [N] instead of the torque.
    """
    lines = [
        "joint  linkage        range [deg]      moment arm [mm]   length at ends [mm]   "
        "straight out: [N m]  p_L [MPa]"
    ]
    bent: list[str] = []
    for number, joint in enumerate(joints, start=1):
        slides, pressure = "range_m" in joint, joint["straight_out_load_pressure_pa"]
        lower, upper = (
            (1e3 * q for q in joint["range_m"]) if slides else map(math.degrees, joint["range_rad"])
        )
        torque = joint["straight_out_force_n" if slides else "straight_out_torque_nm"]
        least, largest = joint["moment_arm_m"]
        first, last = joint["cylinder_length_m"]
        arms = f" mm{'-':>14s}" if slides else f"  {1e3 * least:7.1f} …{1e3 * largest:6.1f}"
        shown = f"{'-':>10s} {'-':>16s}"
        if torque is None and joint["linkage"] not in SLEW_DRIVES:
            bent.append(str(number))
        if torque is not None:
            newtons = f"{torque:8.1f} N" if slides else f"{torque:10.1f}"
            shown = f"{newtons} {pressure / 1e6:16.2f}"
        lines.append(
            f"{number:5d}  {joint['linkage']:12s} {lower:7.1f} …{upper:6.1f}{arms}"
            f"  {1e3 * first:10.1f} …{1e3 * last:7.1f}   {shown}"
        )
    if bent:
        lines.append(
            f"no error: joint {', '.join(bent)} does not reach position 0, so the arm cannot be "
            "straight, and its loads stay below those straight out"
        )
    return lines


def _hydraulic_facts(machine: Machine) -> dict[str, Any]:
    """Collect pressures, flows and speeds of pumps, booster modules and valves.

    Args:
        machine: The arm.

    Returns:
        A dictionary in SI units, the unit at the end of each key. Keys:

        - supply_pressure_pa, main_pump_flow_m3_s: of the main pump
        - booster_modules: number of modules
        - servo_pump_flow_m3_s: highest flow of one module's servo pump
        - max_boost_pressure_pa: highest pressure of a boosted line
        - mode_patterns: number of mode combinations
        - max_piston_speed_m_s: highest V_max (piston speed for planning) of all actuators
        - first_boosted: number of the first actuator that may be boosted; 2 if joint 1 slews, else
          1
        - speed_of_one_module_m_s: speed at which one module extends that actuator
        - leakage_m3_s: leakage of the valves of all joints together
    """
    arrays, first = machine.arrays, int(machine.slews)  # a slewing joint is always in N
    return {
        "supply_pressure_pa": float(arrays.supply_pressure),
        "main_pump_flow_m3_s": float(arrays.main_pump_flow),
        "booster_modules": int(arrays.module_count),
        "servo_pump_flow_m3_s": float(arrays.servo_pump_flow),
        "max_boost_pressure_pa": float(arrays.max_boost_pressure),
        "mode_patterns": len(machine.planar_arm.patterns),
        "max_piston_speed_m_s": float(arrays.max_piston_speed.max()),
        "first_boosted": first + 1,
        "speed_of_one_module_m_s": float(arrays.servo_pump_flow / arrays.cap_area[first]),
        "leakage_m3_s": float(machine.joint_count * arrays.leakage_flow),
    }


def _hydraulic_lines(found: dict[str, Any]) -> list[str]:
    """Format pressures, flows and speeds of the hydraulics as two lines of text.

    Args:
        found: Values in SI units, as `_hydraulic_facts` returns them.

    Returns:
        Line 1: main pump [MPa, L/min], booster modules [L/min, MPa], number of mode combinations.
        Line 2: highest piston speed [mm/s], speed at which one module extends the first boosted
        actuator [mm/s], leakage of all valves [L/min]. Without booster modules, line 1 says that N
        is the only mode, and no speed of a module follows.
    """
    per_minute = 6e4
    boosters, one_module = "no booster modules, all actuators are always in N", ""
    if found["booster_modules"]:
        boosters = (
            f"{found['booster_modules']} booster modules of "
            f"{found['servo_pump_flow_m3_s'] * per_minute:.3f} L/min up to "
            f"{found['max_boost_pressure_pa'] / 1e6:.1f} MPa; "
            f"{found['mode_patterns']} mode patterns"
        )
        one_module = (
            f"one module extends actuator {found['first_boosted']} at "
            f"{1e3 * found['speed_of_one_module_m_s']:.1f} mm/s; "
        )
    return [
        f"main pump {found['supply_pressure_pa'] / 1e6:.2f} MPa, "
        f"{found['main_pump_flow_m3_s'] * per_minute:.2f} L/min; {boosters}",
        f"piston speed at most {1e3 * found['max_piston_speed_m_s']:.1f} mm/s; {one_module}"
        f"leakage of all valves {found['leakage_m3_s'] * per_minute:.3f} L/min",
    ]


ACTUATOR_FORMATS = {
    "rated_flow": ("valve of {:.2f} L/min", 6e4),
    "rated_pressure_drop_per_land": ("rated drop of {:.2f} MPa at each land", 1e-6),
    "max_piston_speed": ("piston speed of at most {:.1f} mm/s", 1e3),
    "friction": ("{:g} times the friction", 1.0),
    "relief_pressure": ("chambers relieved at {:.1f} MPa", 1e-6),
}
"""Text for each value that one actuator may have of its own, by its key in the machine file.

Each entry is a format string and the factor from the SI value to the printed unit.
"""


def _own_lines(joints: list[dict[str, Any]]) -> list[str]:
    """Format the values that the machine file gives to single actuators alone.

    Args:
        joints: One dictionary for each joint, as `_joint_facts` returns it. Only `own` is read:
            value by key, keys as in ACTUATOR_FORMATS.

    Returns:
        One line for each actuator that has values of its own, in the order of the joints. Empty if
        none has.
    """
    lines = []
    for number, joint in enumerate(joints, start=1):
        values = [
            ACTUATOR_FORMATS[name][0].format(ACTUATOR_FORMATS[name][1] * value)
            for name, value in joint["own"].items()
        ]
        lines += [f"actuator {number} has of its own: {', '.join(values)}"] if values else []
    return lines


def _workspace_lines(found: dict[str, Any], first: int, *, has_boosters: bool) -> list[str]:
    """Format the counts of workspace points as text.

    Args:
        found: Counts, as `count_workspace_points` returns them.
        first: Number of the first joint in the plane: 1, or 2 if joint 1 slews.
        has_boosters: Whether the machine has booster modules.

    Returns:
        The number of points, then one line for each of the counts `held`, `boosted` (with the count
        by joint), `too_heavy` and `no_posture`. The line for `boosted` is left out without booster
        modules.
    """
    by_joint = ", ".join(f"joint {j}: {n}" for j, n in enumerate(found["boosted_by_joint"], first))
    highest = "highest boost" if has_boosters else "supply"
    between = "; a posture table searches between them, and may reach a few more"
    between = between if found["no_posture"] else ""
    return [
        f"of {found['points']} points {found['spacing_m'] * 1e3:g} mm apart, in the posture that "
        "loads the cylinders least:",
        f"  {found['held']} are held at supply pressure",
        *([f"  {found['boosted']} need boost ({by_joint})"] if has_boosters else []),
        f"  {found['too_heavy']} are beyond the {highest} pressure",
        f"  {found['no_posture']} have no posture within the joint limits at "
        f"{found['end_link_angles']} angles of the end link{between}",
    ]


def _keep_out_lines(found: dict[str, Any]) -> list[str]:
    """Format the effect of obstacles on the reachable points as two lines of text.

    Args:
        found: Counts, as `count_points_left` returns them.

    Returns:
        Line 1: margin [mm] and names of the obstacles. Line 2: number of reachable points that
        remain clear of obstacles, and their share [%].
    """
    left, reached, where = found["left"], found["reached"], ""
    share = 100.0 * left / reached if reached else 0.0
    if "slew_angles" in found:
        where = f", counted at {found['slew_angles']} angles of the slew"
    return [
        f"keeping {1e3 * found['margin_m']:g} mm clear of {'; '.join(found['obstacles'])}:",
        f"  {left} of {reached} points that can be reached are left, {share:.0f} %{where}",
    ]


main = command_line.make_main(check)
