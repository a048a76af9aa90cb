"""`simulate`: plan and simulate a sequence of goals headless, without a ROS graph."""

import itertools
import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tqdm import tqdm

from mhsb_control import (
    REGISTERED_CONTROLLERS,
    default_controller,
    get_controller_class,
    load_machine,
)
from mhsb_control.controller import LearningController
from mhsb_control.estimates_file import check_estimates_file_is_writable
from mhsb_model import command_line
from mhsb_model.command_line import JsonFlag, OptionalFile, Seed
from mhsb_model.files.output_folders import make_output_folder
from mhsb_model.goal import format_position
from mhsb_model.machine import Machine
from mhsb_model.schema import Sensors
from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.motion.energy import Energy, compute_energy_of_states
from mhsb_planner.motion.s3_trajectory import TrajectoryKind
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import DEFAULT_PLANNER, PlannerKind, PlanOptions
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.result_files import write_json
from mhsb_sim.circuit.audit import compute_energy_gap, compute_volume_gap, sum_energy_by_source
from mhsb_sim.simulation.plant_files import load_plant
from mhsb_sim.simulation.sensors import select_length_class
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.commands.plan_arguments import POSITION_RANGE
from mhsb_tools.commands.zone_arguments import ZoneArguments
from mhsb_tools.errors import VariationError
from mhsb_tools.machine_arguments import OptionalPayload, change_machine
from mhsb_tools.moves.move_page import draw_move_page
from mhsb_tools.study.energy_comparison import EnergyPart, list_energy_parts
from mhsb_tools.study.energy_comparison import as_text as energy_text
from mhsb_tools.study.headless import (
    SAMPLE_NS,
    GoalRun,
    HeadlessRun,
    Samples,
    TimedGoal,
    compile_kernels,
    convert_to_move,
)
from mhsb_tools.study.variations import load_variations, scale_values

SHORTEST_TIME, LONGEST_TIME = SAMPLE_NS / SECOND_NS, 3600.0
"""Allowed range of the time until the next goal [s]."""

REACHED_DISTANCE, REACHED_TIMEOUT = 0.01, 0.2
"""A goal is missed if the tip is farther from it than this [m], this long after its motion's end
[s].
"""

PICTURE_FILE = "move.png"
"""Name of the picture in the output folder."""


@dataclass(frozen=True)
class SimulatedArmArguments:
    """Options for the arm that planner and servo know, and for the arm that is simulated.

    Attributes:
        machine: Machine file (YAML); the suite's own arm when left out.
        payload: Mass at the tip [kg]; the machine file's when left out.
        plant: Plant file (YAML): in what the simulated arm differs from the machine that planner
            and servo know, or a whole machine file.
        vary: Factors on values of the simulated arm: KEY=FACTOR ..., where KEY is a name of
            config/variations.yaml (payload=1.3 friction=2) or a path in the machine file
            (circuit.bulk_modulus=0.7).
    """

    machine: OptionalFile = None
    payload: OptionalPayload = None
    plant: OptionalFile = None
    vary: Annotated[tuple[str, ...], tyro.conf.arg(metavar="KEY=FACTOR")] = ()


@dataclass(frozen=True)
class MethodArguments:
    """Options for planner and servo.

    Attributes:
        planner: Method that chooses postures and path, as in `mhsb plan`; integrated, as in the
            node, when left out.
        trajectory: How trajectories are made: polynomial or followed; followed for the integrated
            planner, polynomial for the others when left out.
        controller: Name of the servo controller; the first that suits the machine when left out.
        seed: Seed of the sensor noise.
        estimates_file: File (YAML) of what the lag_compensated servo has learnt: read at the start
            if it exists, written at the end.
    """

    planner: PlannerKind = DEFAULT_PLANNER
    trajectory: TrajectoryKind | None = None
    controller: Annotated[
        str | None,
        tyro.conf.arg(
            help=f"Servo controller, one of {', '.join(REGISTERED_CONTROLLERS)}; the first of them "
            "that suits the machine's sensors when left out."
        ),
    ] = None
    seed: Seed = 0
    estimates_file: OptionalFile = None


def simulate(
    *,
    goal: Annotated[
        tuple[tuple[float, ...], ...],
        tyro.conf.arg(metavar="X [Y] Z T [X [Y] Z T ...]"),
        tyro.conf.UseAppendAction,
        POSITION_RANGE,
    ] = (),
    arm: SimulatedArmArguments,
    method: MethodArguments,
    zones: ZoneArguments,
    output: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    json_: JsonFlag = False,
    audit: bool = False,
) -> int:
    """Plan and simulate goals one after the other, in lock-step, as fast as it goes.

    Each goal is a tip position X Z [m], or X Y Z if the arm slews, and a time T [s]. After that
    time the next goal is sent, even if the arm is still moving. If the tip is more than 10 mm from
    a goal although its motion is over, the exit code is 1. The arm starts at rest in the machine
    file's start posture. Equal arguments give equal results, bit by bit.

    Args:
        goal: Goals: tip position [m] and time until the next goal [s]; may be given several times.
        arm: The arm that planner and servo know, and the arm that is simulated.
        method: Planner and servo.
        zones: Keep-out zones.
        output: Folder for samples.csv, summary.json and move.png: path, joints, modes, operating
            regions, pressures and energy on one page. Columns of samples.csv, every 10 ms: time
            [s]; reference, position [rad or m], reference_velocity, velocity [rad/s or m/s] and
            reference_acceleration [rad/s² or m/s²] of joints; tip_error [m]; modes (0 N, 1 DB, 2
            SB); cap_pressure, rod_pressure, supply_pressure [Pa]; valve_opening (-1 to 1).
        json_: Print one JSON object, as in summary.json, instead of text. Its energy_measured_j has
            the energy to the oil by main pump (mp) and servo pumps (sp).
        audit: Also print where all energy and all oil went, and what the plans had expected; not
            together with --json, which has it all.

    Returns:
        Exit code: 0, or 1 if a goal was missed.

    Raises:
        UsageError: There is no goal, `audit` is given together with `json_`, or the value of an
            option cannot be used.
        EstimatesFileError: The estimates file cannot be used, or not be written. Both are found
            before the run.
        MhsbError: Another file, the output folder or the controller cannot be used. Or a goal
            cannot be planned, or the simulation diverged.
    """
    if not goal:
        raise command_line.UsageError("give --goal X Z T, once or several times")
    if audit and json_:
        raise command_line.UsageError("--audit: leave it out, --json has all that it prints")
    known = change_machine(load_machine(arm.machine), payload=arm.payload)
    kept_out = zones.add_to(known)
    goals = list(itertools.chain.from_iterable(split_timed_goals(known, values) for values in goal))
    if output is not None:
        make_output_folder(output, "the run")
    plant = build_plant(known, arm.plant, arm.vary)
    run = _prepare_run(known, kept_out, plant, method)
    began = time.perf_counter()
    results = list(tqdm(run.run(goals), total=len(goals), unit="goal", leave=False, disable=None))
    seconds = time.perf_counter() - began
    simulator, samples = run.simulator, run.samples()
    elements = list_energy_parts(compute_planned_energy(known, samples), simulator.energies)
    summary = summarize(known.axes, results, samples, simulator, seconds, elements)
    if output is not None:
        write(output, samples, summary)
        draw_move_page(convert_to_move(kept_out, samples, goals, elements), output / PICTURE_FILE)
    if json_:
        print(json.dumps(summary))
    else:
        print("\n".join(as_text(summary) + (_audit_as_text(summary, elements) if audit else [])))
    sensors = plant.config.imperfections.sensors
    causes = describe_possible_causes(arm, method.estimates_file, sensors, _is_learning(simulator))
    missed = [result for result in results if is_missed(result)]
    for result in missed:
        sentence = compose_missed_sentence(result, summary["guard_interventions"], causes)
        print(f"simulate: {sentence}", file=sys.stderr)
    simulator.save_estimates()
    return 1 if missed else 0


def _prepare_run(
    machine: Machine, kept_out: Machine, plant: Machine, method: MethodArguments
) -> HeadlessRun:
    """Prepare planner and simulator for a run, and compile their kernels.

    Builds the posture table if it is not cached. One simulation step is made and reset, so that
    loading kernels does not count in the time of the run.

    Args:
        machine: The machine that the servo knows, without keep-out zones of the command line.
        kept_out: The machine that the planner knows, with all keep-out zones.
        plant: The machine that is simulated.
        method: Planner, kind of trajectory, controller and seed.

    Returns:
        The run; nothing of it is simulated yet.

    Raises:
        UnknownControllerError: There is no controller of that name.
        EstimatesFileError: The estimates file cannot be used, or not be written.
        EmptyTableError: No node of a newly built posture table has a posture.
        MhsbError: The simulator cannot be built for this machine and plant.
    """
    get_controller_class(method.controller or default_controller(machine))  # before long work
    compile_kernels()
    replanner = Replanner(machine, load_or_build_table(machine))
    replanner.change_machine(kept_out)
    replanner.warm_up([method.planner])
    simulator = Simulator(
        machine,
        method.controller,
        method.seed,
        plant=plant,
        estimates_file=method.estimates_file,
    )
    simulator.step()  # loads kernels, so that this is not part of the time
    simulator.reset()
    if method.estimates_file is not None:
        check_estimates_file_is_writable(method.estimates_file)
    options = PlanOptions(planner=method.planner, trajectory=method.trajectory)
    return HeadlessRun(simulator, replanner, options)


def is_missed(result: GoalRun) -> bool:
    """Return whether the arm is away from a goal although its motion ended a while ago.

    Args:
        result: State of the run when the goal's time was up.

    Returns:
        True if the motion ended more than 0.2 s ago and the tip is more than 10 mm away.
    """
    return result.overdue > REACHED_TIMEOUT and result.goal_distance > REACHED_DISTANCE


def _is_learning(simulator: Simulator) -> bool:
    """Return whether the servo learns its valves, and some estimate is not yet known."""
    controller = get_controller_class(simulator.controller_name)
    is_known = all(each.known for each in simulator.estimates)
    return issubclass(controller, LearningController) and not is_known


def describe_possible_causes(
    arm: SimulatedArmArguments, estimates_file: Path | None, sensors: Sensors, is_learning: bool
) -> str:
    """Describe possible causes of goals that a run has missed.

    Args:
        arm: Options for the arm that is simulated.
        estimates_file: Estimates file of the run; None without one.
        sensors: The simulated sensors.
        is_learning: Whether the servo learns its valves, and some estimate is not yet known.

    Returns:
        Clauses that each begin with "; ". Empty if the simulated arm equals its machine file, its
        sensors do not drift, and the servo has learnt its valves.
    """
    causes = []
    if drift := select_length_class(sensors).drift:
        own = sensors.angle_drift is not None
        remedy = "with a smaller angle_drift" if own else "such as encoder_13_bit"
        causes.append(
            f"its length sensors '{sensors.length}' drift by some "
            f"{math.degrees(60.0 * drift):g}° a minute, which the servo cannot see: fit others, "
            f"{remedy}"
        )
    if is_learning:
        file = (
            f"the same --estimates-file {estimates_file}"
            if estimates_file
            else "--estimates-file FILE, twice"
        )
        causes.append(f"the servo is still learning its valves: run again with {file}")
    if arm.plant or arm.vary:
        causes.append(
            "the arm that is simulated may ask more than plans and servo know of, --plant and "
            "--vary say what"
        )
    return "".join(f"; {cause}" for cause in causes)


def compose_missed_sentence(result: GoalRun, interventions: int, causes: str) -> str:
    """Return a sentence on a missed goal: how far the tip was from it, and how late.

    Args:
        result: Result of the missed goal.
        interventions: Number of times in the whole run that the servo's mode guard boosted
            actuators beyond the plan or slowed the plan.
        causes: What may be why, as `describe_possible_causes` returns it.
    """
    times = "once" if interventions == 1 else f"{interventions} times"
    return (
        f"the goal {format_position(result.goal.position, 'g')} is missed: the tip is "
        f"{1e3 * result.goal_distance:.0f} mm from it {result.overdue:.1f} s after its motion "
        f"should have ended; the guard intervened {times}{causes}"
    )


def build_plant(machine: Machine, file: Path | None, vary: Sequence[str]) -> Machine:
    """Build the machine that is simulated.

    Args:
        machine: The arm that planner and servo know.
        file: Plant file; None starts from `machine` itself.
        vary: Factors on single values, each as `KEY=FACTOR`. KEY is a name in
            config/variations.yaml, such as `payload`, or a path in the machine file, such as
            `circuit.bulk_modulus`.

    Returns:
        The plant, with all factors applied.

    Raises:
        UsageError: A factor is malformed, or its key does not exist. Or the plant's value at KEY,
            before it is multiplied, is 0 or no number. A factor of 0 is no such error.
        MachineFileError: The plant file cannot be used, or a varied value is out of range.
        MhsbError: config/variations.yaml cannot be used for this machine.
    """
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
        return scale_values(plant, factors, variations)
    except VariationError as error:
        raise command_line.UsageError(f"--vary: {error}") from error


def split_timed_goals(machine: Machine, values: Sequence[float]) -> list[TimedGoal]:
    """Split the numbers of one `--goal` into goals.

    Args:
        machine: The arm; each goal has x, z and time, or x, y, z and time if it slews.
        values: All numbers in order, position [m] and then time until the next goal [s], for each
            goal.

    Returns:
        The goals in order, at least one.

    Raises:
        UsageError: The numbers do not fill whole goals, or a time is out of range.
    """
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


def compute_planned_energy(machine: Machine, samples: Samples) -> Energy:
    """Compute the energy that the planner's model gives for the reference of a run.

    The model gets the reference that the servo followed and the modes that were in force. Each
    sample stands for the time until the next one.

    Args:
        machine: The arm that the planner knows.
        samples: The simulated run.

    Returns:
        Energy of the whole run [J], with boosted oil priced as `paper` and as `series`.
    """
    span = np.full(len(samples.time), SAMPLE_NS / SECOND_NS)
    return compute_energy_of_states(
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
    simulator: Simulator,
    seconds: float,
    elements: list[EnergyPart],
) -> dict[str, Any]:
    """Summarize a run in plain numbers for JSON.

    Args:
        axes: Names of a goal's coordinates, `x`, `z` or `x`, `y`, `z`.
        results: One result for each goal.
        samples: The simulated run.
        simulator: The simulator after the run, with energies, volumes and the guard's
            interventions.
        seconds: Wall time of planning and simulating [s].
        elements: Planned and simulated energy of each part of the circuit [J].

    Returns:
        A dictionary; units are at the ends of the keys. `goals` has a dictionary for each goal, as
        `_goal_numbers` returns it. All other keys are for the whole run:

        - simulated_s: simulated time; real_time_factor: simulated time divided by `seconds`
        - tip_error_rms_mm, tip_error_max_mm: RMS and maximum of the tip's distance from its
            reference
        - reference_jump_max_rad: largest jump of the reference when a new plan took over
        - max_supply_pressure_mpa, max_chamber_pressure_mpa
        - mode_switches, guard_interventions: counts
        - energy_measured_j: of main pump (`mp`) and servo pumps (`sp`); energy_by_source_j: of
            both, to the oil and at the shafts
        - energies_j: energy by circuit element; energy_elements_j: `elements`
        - volumes_m3: oil by destination
    """
    energies = simulator.energies
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
        "guard_interventions": simulator.guard.interventions.count,
        "energy_measured_j": {"mp": energies["main_pump"], "sp": energies["servo_pumps"]},
        "energy_by_source_j": sum_energy_by_source(energies),
        "energies_j": energies,
        "energy_elements_j": [asdict(element) for element in elements],
        "volumes_m3": simulator.volumes,
    }


def _goal_numbers(axes: Sequence[str], result: GoalRun) -> dict[str, Any]:
    """Collect the numbers of one goal for JSON.

    Args:
        axes: Names of a goal's coordinates, `x`, `z` or `x`, `y`, `z`.
        result: Result of the goal.

    Returns:
        A dictionary. It has the goal's coordinates by name of the axis [m], and `time_s`, the time
        until the next goal. `goal_distance_mm` is the tip's distance from the goal when that time
        is over. If a plan was made, also `duration_s`, `plan_ms` (planning time), `warnings`, and
        two planned energies. They differ in the price of boosted oil: `paper` in
        `energy_planned_j`, `series` in `energy_planned_series_j`.
    """
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
            "plan_ms": 1e3 * plan.planning_time,
            "warnings": list(plan.warnings),
        }
    return numbers


def as_text(summary: dict[str, Any]) -> list[str]:
    """Format the summary of a run as text.

    Args:
        summary: The dictionary that `summarize` returns.

    Returns:
        A line of column titles, then a line for each goal. Each goal's line has position [m], time
        until the next goal [s] and duration of the plan [s]. Last comes the tip's distance from the
        goal at the end of that time [mm]. Lines with warnings, tip errors [mm], highest pressures
        [MPa] and energies of main pump and servo pumps [J] follow. The last lines have numbers of
        mode switches and of interventions of the mode guard, and simulated time [s].
    """
    axes = [axis for axis in "xyz" if axis in summary["goals"][0]]
    head = f"goal {', '.join(axes)} [m]"
    lines = [f"{head:{8 * len(axes)}}  time [s]  planned [s]  left to the goal [mm]"]
    for goal in summary["goals"]:
        to = " ".join(f"{goal[axis]:7.3f}" for axis in axes)
        planned = f"{goal['duration_s']:11.2f}" if "duration_s" in goal else "no new plan"
        lines.append(f"{to}  {goal['time_s']:9.2f}  {planned}  {goal['goal_distance_mm']:12.2f}")
    warnings = [
        f"warning: to {format_position([goal[axis] for axis in axes], 'g')}: {warning}"
        for goal in summary["goals"]
        for warning in goal.get("warnings", ())
    ]
    is_slowed = summary["guard_interventions"] > 0
    reference = ", from the reference that the guard slows" if is_slowed else ""
    main, servo = (summary["energy_by_source_j"][name] for name in ("main_pump", "servo_pumps"))
    return [
        *lines,
        *warnings,
        f"tip error {summary['tip_error_rms_mm']:.2f} mm RMS, "
        f"{summary['tip_error_max_mm']:.2f} mm at most{reference}",
        f"pressures at most {summary['max_supply_pressure_mpa']:.2f} MPa in the supply lines, "
        f"{summary['max_chamber_pressure_mpa']:.2f} MPa in the chambers",
        f"to the oil {main['hydraulic']:.0f} J of the main pump, {servo['hydraulic']:.0f} J of the "
        f"servo pumps; at their shafts {main['shaft']:.0f} J and {servo['shaft']:.0f} J",
        f"{summary['mode_switches']} mode switches, {summary['guard_interventions']} interventions "
        "of the guard",
        f"{summary['simulated_s']:.1f} s simulated at {summary['real_time_factor']:.1f} times "
        "real time",
    ]


def _audit_as_text(summary: dict[str, Any], elements: list[EnergyPart]) -> list[str]:
    """Format where energy and oil of a run went, and what the plans had expected.

    Args:
        summary: The dictionary that `summarize` returns.
        elements: Planned and simulated energy of each part of the circuit [J].

    Returns:
        Lines of three tables: energy audit, volume audit, and planned beside simulated energies.
    """
    return format_audit(summary["energies_j"], summary["volumes_m3"]) + energy_text(elements)


def format_audit(energies: dict[str, float], volumes: dict[str, float]) -> list[str]:
    """Format where the energy of all pumps and the oil of the main pump went.

    Args:
        energies: Energy by circuit element [J], as `Simulator.energies`.
        volumes: Oil by destination [m³], as `Simulator.volumes`.

    Returns:
        Lines of two tables, energy [J] and volume [cm³]. The last line of each is the amount that
        is unaccounted for.
    """
    cubic_centimetres = {name: 1e6 * volume for name, volume in volumes.items()}
    return [
        *_format_audit_table(
            "energy audit [J]",
            energies,
            energies["main_pump"] + energies["servo_pumps"],
            compute_energy_gap(energies),
        ),
        *_format_audit_table(
            "volume audit [cm³]",
            cubic_centimetres,
            cubic_centimetres["main_pump"],
            compute_volume_gap(cubic_centimetres),
        ),
    ]


def _format_audit_table(
    title: str, amounts: dict[str, float], delivered: float, gap: float
) -> list[str]:
    """Format a table of amounts and of the difference that they leave.

    Args:
        title: Title of the table, without a colon.
        amounts: Amount by name; underscores of the names are printed as spaces.
        delivered: Total amount delivered, in the unit of `amounts`.
        gap: Amount that is unaccounted for, in the unit of `amounts`.

    Returns:
        The title, a line for each amount, and a line with the gap, also as a percentage of
        `delivered`. No unit is printed.
    """
    lines = [f"{title}:"]
    lines += [f"  {name.replace('_', ' '):20s}{value:12.3f}" for name, value in amounts.items()]
    return [
        *lines,
        f"  unaccounted for     {gap:12.6f}  ({100 * gap / delivered:.2e} % of delivered)",
    ]


def write(output: Path, samples: Samples, summary: dict[str, Any]) -> None:
    """Write samples.csv and summary.json into a folder.

    Args:
        output: An existing folder.
        samples: The simulated run; samples.csv has a line of column names, then one line of SI
            values for each instant.
        summary: The dictionary that `summarize` returns; content of summary.json.
    """
    np.savetxt(
        output / "samples.csv",
        samples.table(),
        fmt="%.9g",
        delimiter=",",
        header=",".join(samples.column_names()),
        comments="",
    )
    write_json(output / "summary.json", summary)


main = command_line.make_main(simulate)
