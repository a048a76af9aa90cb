"""`simulate`: plans and simulates a sequence of goals, headless, without a ROS graph."""

from __future__ import annotations

import itertools
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.command_line import Seed, Within
from mhsb_model.files.output_folders import make_output_folder
from mhsb_model.goal import place
from mhsb_model.machine import Machine, load_machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.commands.plan_arguments import as_asked
from mhsb_planner.commands.zone_arguments import (
    ZoneBoxes,
    ZoneCircles,
    ZoneCylinders,
    ZoneSpheres,
    with_zones,
)
from mhsb_planner.evaluation.move_page import draw_move_page
from mhsb_planner.kernel_parts import compile_planner
from mhsb_planner.motion.energy import Energy, energy_of_states
from mhsb_planner.motion.s3_trajectory import TrajectoryKind
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import ONLINE_PLANNER, PlannerKind, PlanOptions
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_sim.circuit.audit import energy_by_source, energy_gap, volume_gap
from mhsb_sim.errors import VariationError
from mhsb_sim.servo import controller_class
from mhsb_sim.simulation.kernel_parts import compile_simulator
from mhsb_sim.simulation.plant_files import load_plant
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.study.energy_comparison import Element, energy_elements
from mhsb_sim.study.energy_comparison import as_text as energy_text
from mhsb_sim.study.headless import SAMPLE_NS, GoalRun, HeadlessRun, Samples, TimedGoal
from mhsb_sim.study.simulated_move import simulated_move
from mhsb_sim.study.variations import load_variations, scaled

SHORTEST_TIME, LONGEST_TIME = SAMPLE_NS / SECOND_NS, 3600.0  # s

REACHED, OVERDUE = 0.01, 0.2
"""A goal is missed where the tip is farther from it [m] so long after its motion's end [s]."""

PICTURE = "move.png"


def simulate(
    goal: Annotated[
        tuple[tuple[float, ...], ...],
        tyro.conf.arg(metavar="X [Y] Z T [X [Y] Z T ...]"),
        tyro.conf.UseAppendAction,
        Within(-1e4, 1e4),
    ] = (),
    machine: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    controller: str = "coordinated",
    seed: Seed = 0,
    payload: Annotated[float | None, tyro.conf.arg(metavar="KG"), Within(0.0, 1e4)] = None,
    plant: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    vary: Annotated[tuple[str, ...], tyro.conf.arg(metavar="KEY=FACTOR")] = (),
    planner: PlannerKind = ONLINE_PLANNER,
    trajectory: TrajectoryKind | None = None,
    zone_box: ZoneBoxes = (),
    zone_circle: ZoneCircles = (),
    zone_cylinder: ZoneCylinders = (),
    zone_sphere: ZoneSpheres = (),
    output: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    json_: Annotated[bool, tyro.conf.arg(name="json")] = False,
    audit: bool = False,
) -> int:
    """Plan and simulate goals one after the other, in lock-step, as fast as it goes.

    Each goal is a tip position X Z [m], or X Y Z where the arm slews, and the time T [s] until the
    next one, on the way or not;
    where the arm is not there although its motion is over, the exit code is 1. The arm starts at
    rest in the machine file's start posture. Same arguments, same bits.

    Args:
        goal: Goals: tip position [m] and time until the next goal [s]; may be given several times.
        machine: Machine file (YAML); the suite's own arm when left out.
        controller: Servo controller, coordinated or independent.
        seed: Of the sensor noise.
        payload: Mass at the tip [kg]; the machine file's when left out.
        plant: Plant file (YAML): what the simulated arm has other than the machine that planner
            and servo know, or a whole machine file.
        vary: What the simulated arm has more or less of than its file says: KEY=FACTOR ..., a name
            of config/variations.yaml (payload=1.3 friction=2) or a path in the machine file
            (circuit.bulk_modulus=0.7).
        planner: Where postures come from, as in `mhsb_planner plan`: table, fixed or integrated;
            integrated, as in the node, when left out.
        trajectory: How trajectories are made: polynomial or followed; followed for the integrated
            planner, polynomial for the others when left out.
        output: Folder for samples.csv (100 Hz, SI units), summary.json and move.png: path, joints,
            modes, operating regions, pressures and energy on one page.
        json_: Print one JSON object instead of text.
        audit: Also print where all energy and all oil went, and what the plans had expected; with
            --json that is there anyway.
    """
    if not goal:
        raise command_line.UsageError("give --goal X Z T, once or several times")
    if audit and json_:
        raise command_line.UsageError(
            "--audit has no effect with --json, which has it all: energies_j, volumes_m3 and "
            "energy_elements_j; leave it out"
        )
    arm = as_asked(load_machine(machine), payload=payload)
    kept_out = with_zones(
        arm, boxes=zone_box, circles=zone_circle, cylinders=zone_cylinder, spheres=zone_sphere
    )
    goals = list(itertools.chain.from_iterable(timed_goals(arm, values) for values in goal))
    if output is not None:
        make_output_folder(output, "the run")
    real = plant_of(arm, plant, vary)
    controller_class(controller)  # refuses an unknown one before anything takes time
    compile_planner()
    compile_simulator()
    replanner = Replanner(arm, table_for(arm))
    replanner.change(kept_out)
    replanner.warm_up([planner])
    simulator = Simulator(arm, controller, seed, plant=real)
    simulator.step()  # loads kernels, which is not to be timed
    simulator.reset()
    run = HeadlessRun(simulator, replanner, PlanOptions(planner=planner, trajectory=trajectory))
    began = time.perf_counter()
    results = list(tqdm(run.run(goals), total=len(goals), unit="goal", leave=False, disable=None))
    seconds = time.perf_counter() - began
    samples = run.samples()
    elements = energy_elements(planned_energy(arm, samples), simulator.energies)
    interventions = simulator.guard.interventions.count
    summary = summarize(
        arm.axes, results, samples, simulator.energies, seconds, elements, interventions
    )
    summary["volumes_m3"] = simulator.volumes
    if output is not None:
        write(output, samples, summary)
        draw_move_page(simulated_move(kept_out, samples, goals, elements), output / PICTURE)
    if json_:
        print(json.dumps(summary))
    else:
        print("\n".join(as_text(summary)))
        if audit:
            print("\n".join(audit_lines(simulator.energies, simulator.volumes)))
            print("\n".join(energy_text(elements)))
    missed = [result for result in results if is_missed(result)]
    for result in missed:
        print(f"simulate: {missed_sentence(result, interventions)}", file=sys.stderr)
    return 1 if missed else 0


def is_missed(result: GoalRun) -> bool:
    """Whether the arm is not where a motion that has been over for a while should have led."""
    return result.overdue > OVERDUE and result.goal_distance > REACHED


def missed_sentence(result: GoalRun, interventions: int) -> str:
    """Where the tip was instead."""
    return (
        f"the goal {place(result.goal.position, 'g')} is missed: the tip is "
        f"{1e3 * result.goal_distance:.0f} mm from it {result.overdue:.1f} s after its motion "
        f"should have ended; the guard intervened {interventions} times: the arm "
        "that is simulated may ask more than plans and servo know of, --plant and --vary say what"
    )


def plant_of(machine: Machine, file: Path | None, vary: Sequence[str]) -> Machine:
    """The arm to simulate: of a file, or the one that is known; times factors, KEY=FACTOR each."""
    plant = machine if file is None else load_plant(machine, file)
    factors = {}
    for text in vary:
        key, _, factor = text.partition("=")
        try:
            factors[key] = float(factor)
        except ValueError:
            raise command_line.UsageError(
                f"--vary: {text!r} is not KEY=FACTOR with a number, such as payload=1.3"
            ) from None
    if not factors:
        return plant
    variations = load_variations(plant)
    try:
        return scaled(plant, factors, variations)
    except VariationError as error:
        raise command_line.UsageError(f"--vary: {error}") from error


def timed_goals(machine: Machine, values: Sequence[float]) -> list[TimedGoal]:
    """Goals of one --goal; UsageError where they are not the arm's."""
    count = len(machine.axes) + 1
    if not values or len(values) % count:
        wanted = " ".join([*machine.axes, "t"]).upper()
        given = " ".join(f"{value:g}" for value in values) or "nothing"
        raise command_line.UsageError(f"--goal: {machine.name} takes {wanted} each, not {given}")
    goals = [
        TimedGoal(tuple(values[k : k + count - 1]), values[k + count - 1])
        for k in range(0, len(values), count)
    ]
    for goal in goals:
        if not SHORTEST_TIME <= goal.time <= LONGEST_TIME:
            raise command_line.UsageError(
                f"--goal: the time {goal.time:g} s must be within {SHORTEST_TIME:g} … "
                f"{LONGEST_TIME:g} s"
            )
    return goals


def planned_energy(machine: Machine, samples: Samples) -> Energy:
    """The planner's model of what the servo followed, each sample for the time to the next one."""
    span = np.full(len(samples.time), SAMPLE_NS / SECOND_NS)
    return energy_of_states(
        machine,
        span,
        samples.reference,
        samples.reference_velocity,
        samples.modes,
        samples.reference_acceleration,
    )


def summarize(
    axes: Sequence[str],
    results: list[GoalRun],
    samples: Samples,
    energies: dict[str, float],
    seconds: float,
    elements: list[Element],
    interventions: int,
) -> dict[str, Any]:
    """The run in plain numbers; `seconds` of computing, `interventions` of the guard.

    axes  of the goals' positions, as `Machine.axes`
    """
    chambers = np.maximum(samples.cap_pressure, samples.rod_pressure)
    return {
        "goals": [_goal_numbers(axes, result) for result in results],
        "simulated_s": float(samples.time[-1] - samples.time[0]),
        "real_time_factor": float((samples.time[-1] - samples.time[0]) / seconds),
        "tip_error_rms_mm": float(1e3 * np.sqrt(np.mean(samples.tip_error**2))),
        "tip_error_max_mm": float(1e3 * np.max(samples.tip_error)),
        "reference_jump_max_rad": max(result.reference_jump for result in results),
        "max_supply_pressure_mpa": float(samples.supply_pressure.max() / 1e6),
        "max_chamber_pressure_mpa": float(chambers.max() / 1e6),
        "mode_switches": int(np.count_nonzero(np.diff(samples.modes.astype(int), axis=0))),
        "guard_interventions": interventions,
        "energy_measured_j": {"mp": energies["main_pump"], "sp": energies["servo_pumps"]},
        "energy_by_source_j": energy_by_source(energies),
        "energies_j": energies,
        "energy_elements_j": [asdict(element) for element in elements],
    }


def _goal_numbers(axes: Sequence[str], result: GoalRun) -> dict[str, Any]:
    numbers: dict[str, Any] = {
        **dict(zip(axes, result.goal.position, strict=True)),
        "time_s": result.goal.time,
        "goal_distance_mm": 1e3 * result.goal_distance,
    }
    if result.replan is not None:
        plan = result.replan.plan
        numbers |= {
            "duration_s": plan.motion.trajectory.duration_ns / SECOND_NS,
            "energy_planned_j": plan.energy.paper,
            "energy_planned_series_j": plan.energy.series,
            "plan_ms": 1e3 * plan.took,
            "warnings": list(plan.warnings),
        }
    return numbers


def as_text(summary: dict[str, Any]) -> list[str]:
    """The summary for a person."""
    axes = [axis for axis in "xyz" if axis in summary["goals"][0]]
    head = f"goal {', '.join(axes)} [m]"
    lines = [f"{head:{8 * len(axes)}}  time [s]  planned [s]  left to the goal [mm]"]
    for goal in summary["goals"]:
        to = " ".join(f"{goal[axis]:7.3f}" for axis in axes)
        planned = f"{goal['duration_s']:11.2f}" if "duration_s" in goal else "no new plan"
        lines.append(
            f"{to}  {goal['time_s']:9.2f}  {planned}"
            f"  {goal['goal_distance_mm']:12.2f}"
        )
    warnings = [
        f"warning: to {place([goal[axis] for axis in axes], 'g')}: {warning}"
        for goal in summary["goals"]
        for warning in goal.get("warnings", ())
    ]
    main, servo = (summary["energy_by_source_j"][name] for name in ("main_pump", "servo_pumps"))
    return [
        *lines,
        *warnings,
        f"tip error {summary['tip_error_rms_mm']:.2f} mm RMS, "
        f"{summary['tip_error_max_mm']:.2f} mm at most",
        f"pressures at most {summary['max_supply_pressure_mpa']:.2f} MPa in the supply lines, "
        f"{summary['max_chamber_pressure_mpa']:.2f} MPa in the chambers",
        f"to the oil {main['hydraulic']:.0f} J of the main pump, {servo['hydraulic']:.0f} J of the "
        f"servo pumps; at their shafts {main['shaft']:.0f} J and {servo['shaft']:.0f} J",
        f"{summary['mode_switches']} mode switches, {summary['guard_interventions']} interventions "
        "of the guard",
        f"{summary['simulated_s']:.1f} s simulated at {summary['real_time_factor']:.1f} times "
        "real time",
    ]


def audit_lines(energies: dict[str, float], volumes: dict[str, float]) -> list[str]:
    """Where the pumps' energy [J] and the main pump's oil [m³] went."""
    cubic_centimetres = {name: 1e6 * volume for name, volume in volumes.items()}
    return [
        *_audit(
            "energy audit [J]",
            energies,
            energies["main_pump"] + energies["servo_pumps"],
            energy_gap(energies),
        ),
        *_audit(
            "volume audit [cm³]",
            cubic_centimetres,
            cubic_centimetres["main_pump"],
            volume_gap(cubic_centimetres),
        ),
    ]


def _audit(title: str, amounts: dict[str, float], delivered: float, gap: float) -> list[str]:
    lines = [f"{title}:"]
    lines += [f"  {name.replace('_', ' '):20s}{value:12.3f}" for name, value in amounts.items()]
    return [
        *lines,
        f"  unaccounted for     {gap:12.6f}  ({100 * gap / delivered:.2e} % of delivered)",
    ]


def write(output: Path, samples: Samples, summary: dict[str, Any]) -> None:
    """samples.csv and summary.json in the folder `output`."""
    np.savetxt(
        output / "samples.csv",
        samples.table(),
        fmt="%.9g",
        delimiter=",",
        header=",".join(samples.column_names()),
        comments="",
    )
    (output / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")


def main() -> int:
    """Entry point of `ros2 run mhsb_sim simulate`."""
    return command_line.run(simulate, name="simulate")


if __name__ == "__main__":
    sys.exit(main())
