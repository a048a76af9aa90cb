"""`plan`: one plan, offline, without a ROS graph."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.command_line import Within
from mhsb_model.files.output_folders import make_room_for
from mhsb_model.goal import place
from mhsb_model.machine import Machine, load_machine
from mhsb_model.modes import pattern_name
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import Position
from mhsb_planner.commands.plan_arguments import (
    Point,
    angle_of,
    as_asked,
    case_line,
    case_title,
    goal_region_of,
    range_of,
    refuse_elsewhere,
    refuse_idle,
    replaced,
    request,
    start_in_posture,
)
from mhsb_planner.commands.zone_arguments import (
    ZoneBoxes,
    ZoneCircles,
    ZoneCylinders,
    ZoneSpheres,
    with_zones,
)
from mhsb_planner.evaluation.move import planned_move
from mhsb_planner.evaluation.move_page import draw_move_page
from mhsb_planner.evaluation.operating_point import (
    OperatingPoint,
    Sample,
    best_operating_point,
)
from mhsb_planner.evaluation.paper_cases import PaperCase
from mhsb_planner.goal_region import FARTHEST, WIDEST_ANGLE
from mhsb_planner.kernel_parts import compile_planner
from mhsb_planner.motion.cavitation import cavitating_steps
from mhsb_planner.motion.s3_trajectory import TrajectoryKind
from mhsb_planner.planner import Plan, Planner, PlannerKind
from mhsb_planner.planners.options import HIGHEST_WEIGHT
from mhsb_planner.planners.registry import summaries
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_planner.search.area_shortfall import area_along_motion, area_along_path, reference_area
from mhsb_planner.search.s2_search import SearchMethod
from mhsb_planner.search.s2_step import EnergyReading

SHORT = 1.0
"""A plan that took no longer is made once more, for the sake of the times that are told [s]."""

ANYWHERE, DISTANCES = Within(-1e4, 1e4), Within(0.0, FARTHEST)
ANGLES = Within(-WIDEST_ANGLE, WIDEST_ANGLE)
WEIGHTS = Within(0.0, HIGHEST_WEIGHT)
PRESSURES, SPEEDS = Within(1e5, 5e7), Within(1e-4, 1.0)
"""Ranges of options: positions and distances [m], angles [rad], weights, P_S [Pa], V_max [m/s]."""

BAR_DELAY = 0.5
"""Before which no progress is shown [s]: what is wrong with a request shows sooner."""


def plan(
    start: Annotated[Position | None, tyro.conf.arg(metavar="X [Y] Z"), ANYWHERE] = None,
    goal: Annotated[Position | None, tyro.conf.arg(metavar="X [Y] Z"), ANYWHERE] = None,
    case: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None,
    machine: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    table: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    weights: Annotated[
        tuple[float, float, float] | None, tyro.conf.arg(metavar="W1 W2 W3"), WEIGHTS
    ] = None,
    area_weight: Annotated[float | None, tyro.conf.arg(metavar="W4"), WEIGHTS] = None,
    planner: Annotated[
        PlannerKind | None,
        tyro.conf.arg(help=f"Where postures come from: {summaries()}; table when left out."),
    ] = None,
    initial_j3: Annotated[float | None, tyro.conf.arg(metavar="RAD"), ANGLES] = None,
    search: SearchMethod | None = None,
    heuristic_scale: Annotated[
        float | None, tyro.conf.arg(metavar="PER_M"), Within(0.0, 1e6)
    ] = None,
    trajectory: TrajectoryKind | None = None,
    max_speed_excess: Annotated[
        float | None, tyro.conf.arg(metavar="SHARE"), Within(0.0, 1.0)
    ] = None,
    energy_reading: EnergyReading | None = None,
    payload: Annotated[float | None, tyro.conf.arg(metavar="KG"), Within(0.0, 1e4)] = None,
    supply_pressure: Annotated[float | None, tyro.conf.arg(metavar="PA"), PRESSURES] = None,
    v_max: Annotated[float | None, tyro.conf.arg(metavar="M_S"), SPEEDS] = None,
    supply_pressure_range: Annotated[
        Point | None, tyro.conf.arg(metavar="LOW HIGH"), PRESSURES
    ] = None,
    v_max_range: Annotated[Point | None, tyro.conf.arg(metavar="LOW HIGH"), SPEEDS] = None,
    goal_psi: Annotated[float | None, tyro.conf.arg(metavar="RAD"), ANGLES] = None,
    goal_psi_range: Annotated[Point | None, tyro.conf.arg(metavar="LOW HIGH"), ANGLES] = None,
    goal_tolerance: Annotated[float | None, tyro.conf.arg(metavar="M"), DISTANCES] = None,
    goal_segment: Annotated[Point | None, tyro.conf.arg(metavar="X Z"), ANYWHERE] = None,
    goal_box: Annotated[Point | None, tyro.conf.arg(metavar="DX DZ"), DISTANCES] = None,
    via: Annotated[
        tuple[tuple[float, ...], ...],
        tyro.conf.arg(metavar="X [Y] Z"),
        tyro.conf.UseAppendAction,
        ANYWHERE,
    ] = (),
    via_tolerance: Annotated[float | None, tyro.conf.arg(metavar="M"), DISTANCES] = None,
    zone_box: ZoneBoxes = (),
    zone_circle: ZoneCircles = (),
    zone_cylinder: ZoneCylinders = (),
    zone_sphere: ZoneSpheres = (),
    plot: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    start_posture: Annotated[
        tuple[float, ...] | None, tyro.conf.arg(metavar="Q1 Q2 Q3 ..."), ANGLES
    ] = None,
    json_: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Plan a motion from rest and print it: path, modes, energy, time.

    Give --start and --goal, or --case for one of the paper's. The start posture is that of the
    posture table in normal mode, or the one with the initial angle of joint 3 if that is fixed.
    Arms that slew have positions X Y Z, others X Z. Energies are in J, lengths in m, angles in
    rad, times in s.

    Args:
        start: Tip position at the start [m].
        goal: Tip position at the goal [m].
        case: One of the paper's cases, such as 1-1; it sets start, goal, weights, planner and
            initial angle of joint 3. What of these is given as well counts, and is told.
        machine: Machine file (YAML); the suite's own arm when left out.
        table: Posture table (npz); built and kept in the user's cache when left out.
        weights: Of energy [1/J], time [1/s] and mode switches; 0.5 0 2 when left out.
        area_weight: Of the velocity polytope's area that is lost along the tip's path, for the
            integrated planner [1/m]; the area is left out where this is.
        initial_j3: Angle of joint 3 that the fixed planner keeps [rad]; that of the posture
            table at the start when left out.
        search: The exact search, or the published one with one label for each node, of the table
            and the fixed planner; exact when left out.
        heuristic_scale: Of the published search, cost per distance from the goal [1/m]; 1 when
            left out.
        trajectory: How the trajectory is made: polynomial as published, or the discrete path
            followed; when left out followed for the integrated planner, for the others a
            polynomial, or followed where V_max makes that the cheaper.
        max_speed_excess: How far pistons may pass V_max on a polynomial, as a share of it; it
            is stretched until they do not; 0.1 when left out.
        energy_reading: Price of boosted oil that the search minimises; the paper's when left out.
        payload: Mass at the tip [kg]; the machine file's when left out.
        supply_pressure: Of the main pump [Pa]; the machine file's when left out.
        v_max: Piston speed of the discrete plan [m/s]; the machine file's when left out. Actuators
            whose own is lower keep that.
        supply_pressure_range: Choose the constant supply pressure in this range with which the
            motion costs least [Pa]; with --json the points looked at are printed, too.
        v_max_range: Likewise the piston speed [m/s].
        goal_psi: Angle of the end link at the goal [rad]; free when left out.
        goal_psi_range: Least and greatest angle of the end link that will do [rad].
        goal_tolerance: Distance from the goal at which the tip may end as well [m].
        goal_segment: Other end of a line, from the goal on, anywhere on which the tip may end [m].
        goal_box: How far to either side of the goal, forward and up, the tip may end [m].
        via: Point that the tip passes on its way [m], with Y where the arm slews; may be given
            several times, in their order.
        via_tolerance: Distance at which it may pass them [m]; 0.01 when left out.
        plot: Picture (PNG) of the motion on one page: path, joints, modes, operating regions,
            pressures, energy.
        start_posture: Joint positions at the start [rad], extensions of telescopes [m], in place of
            --start. They may be beyond the joint limits: the motion then leads back into them.
        json_: Print one JSON object instead of text.
    """
    if plot is not None and plot.suffix.lower() != ".png":
        raise command_line.UsageError(f"--plot: '{plot}' must end in .png")
    posture = None
    if start_posture is not None:
        others = {"start": start, "case": case}
        posture, start = start_in_posture(load_machine(machine), start_posture, others)
    asked = request(start, goal, case, weights, planner, initial_j3)
    ranges = (
        range_of("supply-pressure", supply_pressure_range, supply_pressure),
        range_of("v-max", v_max_range, v_max),
    )
    wishes: dict[str, Any] = {
        "energy_reading": energy_reading,
        "via_tolerance": via_tolerance,
        "search": search,
        "heuristic_scale": heuristic_scale,
        "trajectory": trajectory,
        "max_speed_excess": max_speed_excess,
        "area_weight": area_weight,
    }
    refuse_idle(asked, {**wishes, "initial_j3": initial_j3, "via": via})
    options = replace(
        asked.options,
        goal_psi=angle_of(goal_psi, goal_psi_range),
        goal_region=goal_region_of(asked.goal, goal_tolerance, goal_segment, goal_box),
        via=via,
        **{name: value for name, value in wishes.items() if value is not None},
    )
    if plot is not None:
        make_room_for(plot, "the picture")
    base = load_machine(machine)
    refuse_elsewhere(base, asked)
    arm = with_zones(
        as_asked(
            base, payload=payload, supply_pressure=supply_pressure, max_piston_speed=v_max
        ),
        boxes=zone_box,
        circles=zone_circle,
        cylinders=zone_cylinder,
        spheres=zone_sphere,
    )
    compile_planner()
    suite = Planner(arm, table_for(base, table))
    began = time.perf_counter()
    if posture is None:
        base.check_in_workspace(asked.start)
        posture = asked.start_posture(suite.machine)
    at_rest = MotionState.at_rest(posture)
    found = None
    if any(ranges):
        with tqdm(desc="operating points", unit="plan", disable=json_, delay=BAR_DELAY) as bar:
            told = partial(_advance, bar)
            found = best_operating_point(suite, asked.goal, at_rest, options, *ranges, told=told)
    if found:
        made = found.plan
    else:
        made = suite.plan(asked.goal, at_rest, options=options)
        if time.perf_counter() - began < SHORT:  # most of it for loading kernels: plan without that
            began = time.perf_counter()
            made = suite.plan(asked.goal, at_rest, options=options)
    seconds = {**made.seconds, "total": time.perf_counter() - began}
    area = polytope_areas_of(suite, made)
    if plot is not None:
        draw_move_page(planned_move(suite.machine, made, asked.goal, _title(asked)), plot)
    if json_:
        content = as_json(suite.machine, made, seconds) | area | curve_json(found)
        print(json.dumps(content | {"case": case, "replaced": replaced(asked)}))
    else:
        lines = as_text(suite.machine, made, seconds)
        print("\n".join([*case_line(asked), *lines, area_line(area), *point_lines(found)]))


def _advance(bar: tqdm, _: Sample) -> None:
    bar.update()


def _title(asked: PaperCase) -> str:
    """Of the picture: which motion, and by which planner."""
    way = f"{place(asked.start, 'g')} to {place(asked.goal, 'g')}"
    return f"{case_title(asked)}{way}, {asked.options.planner} planner"


def as_json(machine: Machine, made: Plan, seconds: dict[str, float]) -> dict[str, Any]:
    """Everything about a plan in plain types."""
    path, motion = made.path, made.motion
    return {
        "machine": machine.name,
        "supply_pressure_pa": machine.arrays.supply_pressure,
        "v_max_m_s": machine.config.motion.max_piston_speed,
        "energy_discrete_j": float(path.energy.sum()),
        "energy_series_discrete_j": float(path.energy_series.sum()),
        "energy_j": made.energy.paper,
        "energy_series_j": made.energy.series,
        "lower_bound_j": made.lower_bound,
        "gap": made.gap,
        "duration_discrete_s": float(path.duration.sum()),
        "duration_s": motion.trajectory.duration_ns / SECOND_NS,
        "switches": path.switches,
        "switches_scheduled": motion.schedule.switches,
        "cost": path.cost,
        "path": path.tip.tolist(),
        "modes": path.modes.tolist(),
        "joint_path": path.posture.tolist(),
        "fit": {
            "method": motion.method.value,
            "stretch": motion.stretch,
            "speed_excess": motion.speed_excess,
            "tip_deviation_m": motion.tip_deviation,
            "joint_deviation_rad": motion.joint_deviation,
            "refused": list(motion.refused),
        },
        "warnings": list(made.warnings),
        "cavitating": [
            {"actuator": each.actuator, "begin_s": each.begin, "duration_s": each.duration}
            for each in made.cavitations
        ],
        "cavitating_steps": cavitating_steps(machine, path).tolist(),
        "expanded": path.statistics.expanded,
        "out_of_time": path.statistics.out_of_time,
        "timings_ms": {name: 1e3 * value for name, value in seconds.items()},
    }


def as_text(machine: Machine, made: Plan, seconds: dict[str, float]) -> list[str]:
    """A table of the steps and the sums."""
    path, motion = made.path, made.motion
    names, empty = np.array(machine.actuator_names), cavitating_steps(machine, path)
    axes = f"tip {', '.join(machine.axes)} [m]"
    wide = 8 * len(machine.axes)
    lines = [f"step   {axes:{wide}}  modes           time [s]   energy [J]   cavitating"]
    for k in range(path.steps):
        tip = " ".join(f"{value:7.3f}" for value in path.tip[k + 1])
        lines.append(
            f"{k + 1:4d}  {tip}   {pattern_name(path.modes[k]):14s}"
            f"{path.duration[k]:10.2f} {path.energy[k]:12.1f}   {', '.join(names[empty[k]]) or '–'}"
        )
    lines += [
        f"discrete path: {path.duration.sum():.2f} s, {path.energy.sum():.1f} J "
        f"({path.energy_series.sum():.1f} J in series reading, at least "
        f"{made.lower_bound:.1f} J), {path.switches} mode switches",
        f"trajectory:    {motion.trajectory.duration_ns / SECOND_NS:.2f} s, "
        f"{made.energy.paper:.1f} J ({made.energy.series:.1f} J in series reading), "
        f"{motion.schedule.switches} mode switches, {100 * made.gap:.0f} % above the least energy",
        f"fit: {motion.method.value}, stretched {motion.stretch:.2f} times, "
        f"{100 * max(0.0, motion.speed_excess):.0f} % above V_max at most, "
        f"tip within {1e3 * motion.tip_deviation:.0f} mm of the discrete path",
        *(f"warning: {warning}" for warning in made.warnings),
        "planned in "
        + ", ".join(f"{1e3 * value:.1f} ms {name}" for name, value in seconds.items()),
    ]
    return lines


def polytope_areas_of(planner: Planner, made: Plan) -> dict[str, float | None]:
    """The polytope's mean area along path and motion, what counts as full, and what is missing.

    The means are None where the tip does not move.
    """
    motion, reference = made.motion, reference_area(planner.graph.table)
    path = area_along_path(planner.machine, made.path)
    along = area_along_motion(planner.machine, motion.trajectory, motion.schedule)
    return {
        "area_discrete_m2_s2": path.mean,
        "area_m2_s2": along.mean,
        "area_reference_m2_s2": reference,
        "area_shortfall_m": along.shortfall(reference),
    }


def area_line(area: dict[str, float | None]) -> str:
    """The same in words."""
    mean = area["area_m2_s2"]
    if mean is None:
        return "polytope: the tip stays"
    return (
        f"polytope: {mean:.3f} m²/s² on average along the tip's path, full from "
        f"{area['area_reference_m2_s2']:.3f} m²/s²; shortfall {area['area_shortfall_m']:.3f} m"
    )


def curve_json(found: OperatingPoint | None) -> dict[str, Any]:
    """All points at which a plan was looked for; nothing where none was."""
    return {"operating_points": [_sample_json(sample) for sample in found.curve]} if found else {}


def _sample_json(sample: Sample) -> dict[str, Any]:
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


def point_lines(found: OperatingPoint | None) -> list[str]:
    """The best point in words."""
    if found is None:
        return []
    best = found.best
    return [
        f"operating point: {best.supply_pressure / 1e6:.3f} MPa, V_max {1e3 * best.v_max:.2f} mm/s "
        f"cost least, {best.cost:.1f}, of {len(found.curve)} looked at"
    ]


def main() -> int:
    """Entry point of `ros2 run mhsb_planner plan`."""
    return command_line.run(plan, name="plan")


if __name__ == "__main__":
    sys.exit(main())
