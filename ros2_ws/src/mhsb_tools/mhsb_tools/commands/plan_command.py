"""`plan`: make one plan offline, without a ROS graph."""

import json
import math
import sys
import time
from typing import Any

import numpy as np
from tqdm import tqdm

from mhsb_control import load_machine
from mhsb_model import command_line
from mhsb_model.command_line import JsonFlag, OptionalFile
from mhsb_model.errors import MhsbError
from mhsb_model.files.output_folders import make_parent_folder
from mhsb_model.goal import format_distance, format_position
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import format_pattern
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory
from mhsb_model.types import FloatArray, Position
from mhsb_planner.cases.paper_cases import PaperCase
from mhsb_planner.kernel_parts import compile_planner, list_parts_for_rest
from mhsb_planner.motion.cavitation import find_cavitating_steps
from mhsb_planner.motion.motion_table import format_switches
from mhsb_planner.plan_log import PlanLog
from mhsb_planner.planner import Plan, Planner, PlanOptions
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.posture.reach_check import check_reach
from mhsb_planner.search.manipulability_loss import (
    compute_area_along_motion,
    compute_area_along_path,
    compute_reference_area,
)
from mhsb_tools.commands.plan_arguments import (
    ArmArguments,
    GoalArguments,
    MoveArguments,
    PlannerArguments,
    build_options,
    build_request,
    check_coordinates,
    format_case_line,
    format_case_title,
    list_replaced_values,
)
from mhsb_tools.commands.zone_arguments import ZoneArguments
from mhsb_tools.moves.move import move_of_plan
from mhsb_tools.moves.move_page import draw_move_page
from mhsb_tools.moves.operating_point import (
    OperatingPoint,
    OperatingPointResult,
    Range,
    find_best_operating_point,
)
from mhsb_tools.moves.supply_systems import compute_single_supply

REPEATED_PLAN_TIME = 1.0
"""A plan that took less time than this is made a second time, so that the printed times do not
include loading compiled kernels [s].
"""

SHOWN_INSTANTS = 11
"""Number of instants of the motion that are printed."""

BAR_DELAY = 0.5
"""Delay before a progress bar appears [s]; an error in a request is printed sooner."""


def plan(
    *,
    move: MoveArguments,
    goal: GoalArguments,
    arm: ArmArguments,
    planning: PlannerArguments,
    zones: ZoneArguments,
    plot: OptionalFile = None,
    csv: OptionalFile = None,
    json_: JsonFlag = False,
    explain: bool = False,
) -> None:
    """Plan a motion from rest and print it: duration, energy, modes over time, tip and joints.

    Give --start and --goal, or --case for a case of the paper. The posture table gives the start
    posture, for normal mode. With the planner `fixed` and an initial angle of joint 3, the start
    posture has this angle. Arms that slew have positions X Y Z, others X Z. Energies are in J,
    lengths in m, angles in rad, times in s. With --supply-pressure-range or --v-max-range, the
    motion is planned at many pressures or speeds, and the cheapest plan is printed.

    Args:
        move: Start, goal and points between them.
        goal: Angle of the end link and position of the tip at the end.
        arm: The arm and its supply.
        planning: How to plan.
        zones: Keep-out zones.
        plot: Picture (PNG) of the motion on one page: path, joints, modes, operating regions,
            pressures, energy.
        csv: Table (CSV) of the motion over time: positions, velocities and accelerations of the
            joints, modes, supply pressures.
        json_: Print one JSON object instead of text.
        explain: Print also the discrete path of the search, how the motion was fitted to it, the
            velocity polytope's area and the times of planning. Each proposed path follows, with its
            time, cost and outcome.

    Raises:
        UsageError: An option has no effect, or options exclude each other. These are
            `start_posture` with `start` or `case`, NAME with NAME_range (such as `v_max`), and any
            two of `goal_tolerance`, `goal_segment` and `goal_box`.
        MhsbError: No plan was found, or a file cannot be used. With `explain`, the log of a failed
            planning is printed to stderr.
    """
    command_line.check_suffix("plot", plot, ".png")
    command_line.check_suffix("csv", csv, ".csv")
    base = load_machine(arm.machine)
    posture, start = move.find_start(base)
    asked = build_request(
        start, move.goal, move.case, planning.weights, planning.planner, planning.initial_j3
    )
    ranges = arm.collect_ranges()
    options = build_options(asked, move, goal, planning)
    for file, what in ((plot, "the picture"), (csv, "the table")):
        if file is not None:
            make_parent_folder(file, what)
    check_coordinates(base, asked)
    if posture is None:
        check_reach(base, asked.start)
    if options.goal_region is None:
        check_reach(base, asked.goal)
    changed = zones.add_to(arm.change(base))
    has_obstacles = bool(changed.obstacles.names)
    compile_planner(parts=list_parts_for_rest(options.planner, has_obstacles=has_obstacles))
    suite = Planner(changed, load_or_build_table(base, arm.table))
    if posture is None:
        posture = asked.start_posture(suite.machine)
    made, found, seconds = _make_timed_plan(
        suite, asked.goal, posture, options, ranges, silent=json_, explain=explain
    )
    area = compute_polytope_areas(suite, made)
    if plot is not None:
        draw_move_page(move_of_plan(suite.machine, made, asked.goal, _title(asked)), plot)
    if csv is not None:
        made.to_csv(csv)
    if json_:
        content = as_json(suite.machine, made, seconds) | area | operating_points_as_json(found)
        content |= {"case": move.case, "replaced": list_replaced_values(asked)}
        print(json.dumps(content | ({"log": log_as_json(made.log)} if explain else {})))
        return
    lines = format_plan(asked, made, found)
    print("\n".join(lines + (format_explanation(suite, made, seconds, area) if explain else [])))


def _make_timed_plan(
    planner: Planner,
    goal: Position,
    posture: FloatArray,
    options: PlanOptions,
    ranges: tuple[Range | None, Range | None],
    *,
    silent: bool,
    explain: bool,
) -> tuple[Plan, OperatingPoint | None, dict[str, float]]:
    """Plan a motion from rest, and measure the times of planning.

    If there is a range, the motion is planned at many pressures and speeds, and the plan of least
    cost is returned. Otherwise a plan that took less than REPEATED_PLAN_TIME is made a second time.

    Args:
        planner: Planner of the arm.
        goal: Tip position at the goal, (x, z) or (x, y, z) [m].
        posture: Posture at the start, shape (n,) [rad or m].
        options: Options of the plan.
        ranges: Ranges of supply pressure [Pa] and of V_max (piston speed for planning) [m/s]. The
            pressure and the speed of least cost are chosen in them. None keeps the machine's value.
        silent: True hides the progress bar, which is shown only if there is a range.
        explain: True prints the log of a failed planning to stderr; without effect if there is a
            range.

    Returns:
        Three values. The first is the plan. The second is the operating point (supply pressure and
        V_max) of least cost, with all points that were examined; None if there is no range. The
        third has the times of the stages [s], and under the key `total` the time of all.

    Raises:
        MhsbError: No plan was found, or an end of a range is not allowed for the machine.
    """
    at_rest, found, log, began = MotionState.at_rest(posture), None, PlanLog(), time.perf_counter()
    if any(ranges):
        with tqdm(desc="operating points", unit="plan", disable=silent, delay=BAR_DELAY) as bar:
            found = find_best_operating_point(
                planner, goal, at_rest, options, *ranges, on_sample=lambda _: bar.update()
            )
        made = found.plan
    else:
        try:
            made = planner.plan(goal, at_rest, options=options, log=log)
        except MhsbError:
            if explain:
                print(log, file=sys.stderr)
            raise
        if time.perf_counter() - began < REPEATED_PLAN_TIME:
            began = time.perf_counter()  # loading kernels took most of it, so plan again
            made = planner.plan(goal, at_rest, options=options)
    return made, found, {**made.seconds, "total": time.perf_counter() - began}


def _title(asked: PaperCase) -> str:
    """Return the title of the picture: the motion and its planner."""
    way = f"{format_position(asked.start, 'g')} to {format_position(asked.goal, 'g')}"
    return f"{format_case_title(asked)}{way}, {asked.options.planner} planner"


def as_json(machine: Machine, plan: Plan, seconds: dict[str, float]) -> dict[str, Any]:
    """Collect a plan in plain types for JSON.

    "Path" is the discrete path of the graph search; "motion" is the trajectory over time made from
    it.

    Args:
        machine: The arm for which the plan was made.
        plan: The plan.
        seconds: Wall time of each part of planning [s], by name.

    Returns:
        A dictionary in SI units, except `timings_ms` [ms]. Keys:

        - energy_j, energy_series_j, duration_s, switches_scheduled: of the motion; boosted oil is
            priced as `paper` and as `series`
        - energy_discrete_j, energy_series_discrete_j, duration_discrete_s, switches, cost: of the
            path
        - lower_bound_j: lower bound on the energy; gap: share by which the motion's energy exceeds
            it
        - constant_pressure: pressure [Pa] and energy_j of the same motion with one pump at constant
            pressure, without boost
        - path: tip [m], and joint_path: joint positions [rad or m], with a row for each waypoint
        - modes: 0 N, 1 DB, 2 SB, with a row for each step of the path
        - trajectory: the motion, as `_trajectory_as_json` returns it
        - fit: how the motion was made from the path, and how far it deviates
        - warnings: sentences
        - cavitating: actuators that cavitate in the motion, with begin and duration
        - cavitating_steps: flags with a row for each step of the path
        - expanded: number of states that the search expanded; out_of_time: whether its time ran out
        - machine, supply_pressure_pa, v_max_m_s, timings_ms
    """
    path, motion = plan.path, plan.motion
    return {
        "machine": machine.name,
        "supply_pressure_pa": machine.arrays.supply_pressure,
        "v_max_m_s": machine.config.motion.max_piston_speed,
        "energy_discrete_j": float(path.energy.sum()),
        "energy_series_discrete_j": float(path.energy_series.sum()),
        "energy_j": plan.energy.paper,
        "energy_series_j": plan.energy.series,
        "lower_bound_j": plan.lower_bound,
        "constant_pressure": compute_single_supply(machine, motion.trajectory)._asdict(),
        "gap": plan.gap,
        "duration_discrete_s": float(path.duration.sum()),
        "duration_s": motion.trajectory.duration_ns / SECOND_NS,
        "switches": path.switches,
        "switches_scheduled": motion.schedule.switch_count,
        "cost": path.cost,
        "path": path.tip.tolist(),
        "modes": path.modes.tolist(),
        "joint_path": path.posture.tolist(),
        "trajectory": _trajectory_as_json(motion.trajectory, motion.schedule),
        "fit": {
            "method": motion.method.value,
            "stretch": motion.stretch,
            "speed_excess": motion.speed_excess,
            "tip_deviation_m": motion.tip_deviation,
            "joint_deviation_rad": motion.joint_deviation,
            "refused": list(motion.refused),
        },
        "warnings": list(plan.warnings),
        "cavitating": [
            {"actuator": each.actuator, "begin_s": each.begin, "duration_s": each.duration}
            for each in plan.cavitations
        ],
        "cavitating_steps": find_cavitating_steps(machine, path).tolist(),
        "expanded": path.statistics.expanded,
        "out_of_time": path.statistics.out_of_time,
        "timings_ms": {name: 1e3 * value for name, value in seconds.items()},
    }


def log_as_json(log: PlanLog) -> list[dict[str, Any]]:
    """Convert the log of a plan to plain types for JSON.

    Args:
        log: Log, with an entry in time order for each path that was proposed.

    Returns:
        A dictionary for each entry, aligned with `log.entries`: `time_s`, `proposer` (source of the
        path), `outcome`, `path_cost`, `motion` (how it was made), `motion_cost` and `reason`. A
        cost is None if it was not computed.
    """
    return [
        {
            "time_s": entry.time,
            "proposer": entry.proposer,
            "outcome": entry.outcome.value,
            "path_cost": None if math.isnan(entry.path_cost) else entry.path_cost,
            "motion": entry.motion,
            "motion_cost": None if math.isnan(entry.motion_cost) else entry.motion_cost,
            "reason": entry.reason,
        }
        for entry in log.entries
    ]


def _trajectory_as_json(trajectory: Trajectory, schedule: ModeSchedule) -> dict[str, Any]:
    """Convert a trajectory and its modes to plain types for JSON.

    Args:
        trajectory: The motion, with k points.
        schedule: Times of its mode switches.

    Returns:
        A dictionary: `time_s` (k times since the beginning of the trajectory [s]), positions,
        velocities and accelerations of the joints [rad or m, per s and s²] and `modes` (0 N, 1 DB,
        2 SB). All but the first are nested lists of shape (k, n).
    """
    time_ns = trajectory.stamp_ns + trajectory.offset_ns
    return {
        "time_s": (trajectory.offset_ns / SECOND_NS).tolist(),
        **{name: values.tolist() for name, values in trajectory.points._asdict().items()},
        "modes": schedule.modes_at_many(time_ns).tolist(),
    }


def format_plan(asked: PaperCase, plan: Plan, found: OperatingPoint | None) -> list[str]:
    """Format a plan and its motion over time as text.

    Args:
        asked: The request: a case of the paper, or the user's own start and goal.
        plan: The plan.
        found: Best and all examined operating points, or None if none was searched.

    Returns:
        Lines: the case if it is one, the plan, what it saves against one pump at constant pressure,
        the operating point if one was searched, a note if zones are kept with
        links without thickness, an empty line, and the table of the motion.
    """
    supply = compute_single_supply(plan.machine, plan.motion.trajectory)
    return [
        *format_case_line(asked),
        str(plan),
        f"compare:  {supply.describe_saving(plan.energy.series)}",
        *format_operating_point(found),
        *format_thickness_note(plan.machine),
        "",
        *format_motion(plan),
    ]


def format_thickness_note(machine: Machine) -> list[str]:
    """Format a note if the arm has zones, but the machine file has no thickness of its links.

    Args:
        machine: The arm.

    Returns:
        One line, or none.
    """
    if not machine.obstacles.names or machine.config.keep_out.link_radii:
        return []
    return ["note:     links count as lines, because the machine file has no keep_out.link_radii"]


def format_motion(plan: Plan) -> list[str]:
    """Format the motion of a plan as a table over time.

    Args:
        plan: The plan.

    Returns:
        A line of column titles, then SHOWN_INSTANTS lines, evenly spaced in time from the beginning
        to the end. Each of these lines has time [s], tip in `base_link` [m] and joint positions
        [rad, telescopes m]. If the motion has no duration, only one such line follows the titles.
    """
    machine, trajectory = plan.machine, plan.motion.trajectory
    time_ns = np.unique(np.linspace(0, trajectory.duration_ns, SHOWN_INSTANTS).astype(np.int64))
    position = trajectory.sample_many(trajectory.stamp_ns + time_ns)[0]
    titles = [f"{axis} [m]" for axis in machine.axes]
    for name, unit in zip(machine.joint_names, machine.joint_units, strict=True):
        titles.append(f"{name} [{unit}]")
    return [
        f"time [s]   {' '.join(f'{title:>13}' for title in titles)}",
        *(
            f"{at / SECOND_NS:8.2f}   " + " ".join(f"{value:13.3f}" for value in (*tip, *row))
            for at, tip, row in zip(time_ns, machine.tip_in_base(position), position, strict=True)
        ),
    ]


def format_path(machine: Machine, plan: Plan) -> list[str]:
    """Format the discrete path of a plan (result of the graph search) as a table of its steps.

    Args:
        machine: The arm for which the plan was made.
        plan: The plan.

    Returns:
        A line of column titles, a line for each step, and a line with the sums. The columns are:
        number of the step (1, 2, …), tip at the end of the step [m], modes, duration [s], energy
        [J], cavitating actuators. The search has chosen the modes; the motion may have others.
    """
    path, names = plan.path, np.array(machine.actuator_names)
    empty = find_cavitating_steps(machine, path)
    axes = f"tip {', '.join(machine.axes)} [m]"
    wide = 8 * len(machine.axes)
    lines = [f"step   {axes:{wide}}  modes           time [s]   energy [J]   cavitating"]
    for k in range(path.steps):
        tip = " ".join(f"{value:7.3f}" for value in path.tip[k + 1])
        lines.append(
            f"{k + 1:4d}  {tip}   {format_pattern(path.modes[k]):14s}"
            f"{path.duration[k]:10.2f} {path.energy[k]:12.1f}   {', '.join(names[empty[k]]) or '–'}"
        )
    return [
        *lines,
        f"discrete path of the search: {path.duration.sum():.2f} s, {path.energy.sum():.1f} J "
        f"({path.energy_series.sum():.1f} J with the pumps in series), "
        f"{format_switches(path.switches)}; the modes of the motion are chosen anew",
    ]


def format_explanation(
    planner: Planner, plan: Plan, seconds: dict[str, float], area: dict[str, float | None]
) -> list[str]:
    """Describe how a plan was found.

    Args:
        planner: Planner that made it.
        plan: The plan.
        seconds: Wall time of each part of planning [s], by name.
        area: Result of `compute_polytope_areas`.

    Returns:
        Lines: the discrete path of the search; how the motion was fitted to it; the times of
        planning [ms]; the velocity polytope's area; and the log of proposed paths. The fit has the
        method, the factor by which the motion was stretched in time, the excess over V_max (piston
        speed for planning) [%], and the largest distance of the tip from the discrete path [mm].
    """
    motion = plan.motion
    return [
        "",
        *format_path(planner.machine, plan),
        "",
        f"fit: {motion.method.value}, stretched {motion.stretch:.2f} times on average, "
        f"{100 * max(0.0, motion.speed_excess):.0f} % above V_max at most, "
        f"tip within {1e3 * motion.tip_deviation:.0f} mm of the discrete path",
        "planned in "
        + ", ".join(f"{1e3 * value:.1f} ms {name}" for name, value in seconds.items()),
        format_area(area),
        "",
        str(plan.log),
    ]


def compute_polytope_areas(planner: Planner, plan: Plan) -> dict[str, float | None]:
    """Compute how large the velocity polytope is along a plan.

    The velocity polytope is the set of tip velocities that the pistons' speed limits allow. The
    shortfall is ∫ max(0, 1 − area/reference) ds along the tip's path of the motion.

    Args:
        planner: The planner; its machine and posture table are used.
        plan: The plan.

    Returns:
        A dictionary. Keys:

        - area_discrete_m2_s2, area_m2_s2: mean area along the discrete path, and along the motion;
            None if the tip does not move
        - area_reference_m2_s2: smallest area that counts as full
        - area_shortfall_m: the shortfall [m], which is the length of a path with area 0 that would
            have the same shortfall
    """
    motion, reference = plan.motion, compute_reference_area(planner.graph.table)
    path = compute_area_along_path(planner.machine, plan.path)
    along = compute_area_along_motion(planner.machine, motion.trajectory, motion.schedule)
    return {
        "area_discrete_m2_s2": path.mean,
        "area_m2_s2": along.mean,
        "area_reference_m2_s2": reference,
        "area_shortfall_m": along.compute_area_loss(reference),
    }


def format_area(area: dict[str, float | None]) -> str:
    """Format how large the velocity polytope is along a motion, as one line of text.

    Args:
        area: Result of `compute_polytope_areas`. The line shows `area_m2_s2` (mean area along the
            motion), `area_reference_m2_s2` (smallest area that counts as full) and
            `area_shortfall_m`. The shortfall is the length of a path with area 0 that would have
            the same manipulability loss [m].

    Returns:
        The line without a line break. If `area_m2_s2` is None, it says only that the tip does not
        move.
    """
    mean, shortfall = area["area_m2_s2"], area["area_shortfall_m"]
    if mean is None or shortfall is None:
        return "polytope: the tip stays"
    return (
        f"polytope: {mean:.3f} m²/s² on average along the tip's path, full from "
        f"{area['area_reference_m2_s2']:.3f} m²/s²; shortfall {format_distance(shortfall)}"
    )


def operating_points_as_json(found: OperatingPoint | None) -> dict[str, Any]:
    """Convert all examined operating points (supply pressure and V_max) to plain types for JSON.

    Args:
        found: Result of the search for an operating point, or None.

    Returns:
        A dictionary with one key, `operating_points`: a list with a dictionary for each examined
        point. Empty if `found` is None.
    """
    return {"operating_points": [_sample_json(sample) for sample in found.curve]} if found else {}


def _sample_json(sample: OperatingPointResult) -> dict[str, Any]:
    """Convert one examined operating point to plain types for JSON.

    Args:
        sample: Supply pressure, V_max (piston speed for planning), and what the move takes there.

    Returns:
        A dictionary: `supply_pressure_pa`, `v_max_m_s`, `energy_j`, `energy_series_j`,
        `duration_s`, `switches` and `cost`. If no plan was found, only the first two and `failure`,
        a sentence.
    """
    point = {"supply_pressure_pa": sample.supply_pressure, "v_max_m_s": sample.v_max}
    if sample.failure:
        return point | {"failure": sample.failure}
    return point | {
        "energy_j": sample.energy,
        "energy_series_j": sample.energy_series,
        "duration_s": sample.duration,
        "switches": sample.switches,
        "cost": sample.cost,
    }


def format_operating_point(found: OperatingPoint | None) -> list[str]:
    """Describe the best operating point in one line.

    Args:
        found: Best and all examined operating points, or None if none was searched.

    Returns:
        A list with one line: supply pressure [MPa], V_max (piston speed for planning) [mm/s], cost,
        and number of points examined. Empty if `found` is None.
    """
    if found is None:
        return []
    best = found.best
    return [
        f"operating point: {best.supply_pressure / 1e6:.3f} MPa, V_max {1e3 * best.v_max:.2f} mm/s "
        f"cost least, {best.cost:.1f}, of {len(found.curve)} looked at"
    ]


main = command_line.make_main(plan)
