"""`animate`: write a recording, or a plan, as an animated GIF."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from mhsb_control import load_machine
from mhsb_model import command_line
from mhsb_model.command_line import NumberRange
from mhsb_model.files.output_folders import make_parent_folder
from mhsb_model.goal import format_position
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import Position
from mhsb_planner.cases.paper_cases import PaperCase
from mhsb_planner.kernel_parts import compile_planner
from mhsb_planner.planner import ONLINE_PLANNER, Planner, PlannerKind
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_tools.commands.film import FilmGoal, write_film
from mhsb_tools.commands.plan_arguments import build_request, case_title, check_coordinates
from mhsb_tools.moves.move import MoveRecord, move_of_plan
from mhsb_tools.recording.bag_reader import read_recording
from mhsb_tools.report.recorded_moves import get_whole_run_as_move
from mhsb_tools.report.recorded_run import evaluate_recording

FILE_SUFFIX = ".gif"
"""Ending that the output file must have."""
MIN_WIDTH, MAX_WIDTH = 200, 4000
"""Allowed width of the picture [pixels]."""


def animate(
    bag: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="BAG")] = None,
    *,
    output: Annotated[Path, tyro.conf.arg(metavar="FILE")],
    start: Annotated[
        Position | None, tyro.conf.arg(metavar="X [Y] Z"), NumberRange(-1e4, 1e4)
    ] = None,
    goal: Annotated[
        Position | None, tyro.conf.arg(metavar="X [Y] Z"), NumberRange(-1e4, 1e4)
    ] = None,
    case: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None,
    planner: PlannerKind | None = None,
    machine: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    namespace: str | None = None,
    begin: Annotated[float, tyro.conf.arg(metavar="S"), NumberRange(-1e9, 1e9)] = 0.0,
    end: Annotated[float | None, tyro.conf.arg(metavar="S"), NumberRange(-1e9, 1e9)] = None,
    speed: Annotated[float, NumberRange(-1e6, 1e6)] = 1.0,
    rate: Annotated[float, tyro.conf.arg(metavar="PER_S"), NumberRange(-1e6, 1e6)] = 12.0,
    width: Annotated[int, NumberRange(-(10**6), 10**6)] = 800,
    json_: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Draw a recording, or a plan, as an animated GIF.

    Give a recording, or --start and --goal of a plan, or --case for one of the paper's. The film
    shows the arm with its cylinders in the colours of their modes, the tip's path, and modes and
    supply pressures [MPa] over time [s].

    Args:
        bag: Folder of the recording (rosbag2).
        output: File to write (GIF).
        start: Tip position at the start of a plan [m].
        goal: Tip position at its goal [m].
        case: One of the paper's cases, such as 1-1.
        planner: Planner of the plan, as in `mhsb_tools plan`. When left out, the case's own;
            without a case, the integrated one.
        machine: Machine file (YAML) of the arm; the suite's own when left out.
        namespace: Namespace of the recorded topics, such as /left; none when left out.
        begin: First instant that is shown, after the start [s].
        end: Last instant that is shown [s]; the end when left out.
        speed: Seconds that pass in one second of the film.
        rate: Pictures in one second of the film, at most 50.
        width: Width of the picture [pixels].
        json_: Print one JSON object instead of text.
    """
    _check_arguments(output, bag, (start, goal, case), speed, rate, width)
    _check_options_have_effect(bag, planner, namespace)
    make_parent_folder(output, "the animation")
    arm = load_machine(machine)
    if bag is not None:
        move, goals = _read_recorded_move(arm, bag, namespace or "")
    else:
        kind = planner or (None if case else ONLINE_PLANNER)
        move, goals = _plan_move(arm, build_request(start, goal, case, planner=kind))
    shown = _select_time_range(move, begin, end)
    frames = write_film(shown, goals, output, speed=speed, rate=rate, width=width)
    if json_:
        summary = {"output": str(output), "pictures": frames, "shown_s": shown.duration}
        print(json.dumps(summary))
    else:
        print(f"{frames} pictures of {shown.duration:.1f} s in {output}")


def _check_arguments(
    output: Path,
    bag: Path | None,
    plan: tuple[object, ...],
    speed: float,
    rate: float,
    width: int,
) -> None:
    """Raise UsageError if the arguments do not go together; nothing slow is done.

    Args:
        output: File to write; must end in .gif.
        bag: Folder of the recording, or None.
        plan: Start, goal and case as given; all None or empty with a recording.
        speed: Seconds of the move in one second of the film; must be above 0.
        rate: Frames per second; must be above 0 and at most 50.
        width: Width of the picture [pixels].
    """
    if output.suffix.lower() != FILE_SUFFIX:
        raise command_line.UsageError(f"--output: '{output}' must end in {FILE_SUFFIX}")
    if (bag is None) is not any(plan):
        raise command_line.UsageError("give a recording, or --start and --goal, or --case NAME")
    if speed <= 0.0:
        raise command_line.UsageError(f"--speed: {speed:g} must be above 0")
    if not 0.0 < rate <= 50.0:
        raise command_line.UsageError(f"--rate: {rate:g} must be above 0 and at most 50")
    if not MIN_WIDTH <= width <= MAX_WIDTH:
        raise command_line.UsageError(f"--width: {width} must be within {MIN_WIDTH} … {MAX_WIDTH}")


def _check_options_have_effect(
    bag: Path | None, planner: str | None, namespace: str | None
) -> None:
    """Raise UsageError if an option was given that changes nothing.

    Args:
        bag: Folder of the recording; with it, a planner has no effect.
        planner: Name of the planner, or None.
        namespace: Namespace of topics, or None; without a recording it has no effect.
    """
    if bag is not None and planner is not None:
        raise command_line.UsageError(
            f"--planner {planner} has no effect: a recording has been planned already; leave it "
            "out, or give --start and --goal, or --case NAME, instead of the recording"
        )
    if bag is None and namespace is not None:
        raise command_line.UsageError(
            f"--namespace {namespace} has no effect: a plan has no topics; leave it out, or give a "
            "recording"
        )


def _read_recorded_move(
    machine: Machine, bag: Path, namespace: str
) -> tuple[MoveRecord, list[FilmGoal]]:
    """Read a recording as one move.

    Args:
        machine: The recorded arm.
        bag: Folder of the recording.
        namespace: Namespace of the recorded topics; empty for none.

    Returns:
        The whole recording as a move, and those goals whose plan the arm executed. A goal's time is
        the instant at which its plan took over [s], and the goals are in time order.

    Raises:
        BagError: The recording has no hydraulic states.
    """
    run = evaluate_recording(read_recording(bag, namespace, machine.slews), machine)
    move, first_ns = get_whole_run_as_move(
        run, f"{'/'.join(bag.resolve().parts[-2:])}, as recorded"
    )
    goals = []
    for each in run.goals:
        if each.taken_over_ns is not None:
            time = (each.taken_over_ns - first_ns) / SECOND_NS
            goals.append(FilmGoal(time, each.verdict.goal.position))
    return move, sorted(goals, key=lambda sent: sent.time)


def _plan_move(machine: Machine, asked: PaperCase) -> tuple[MoveRecord, list[FilmGoal]]:
    """Plan a case from rest and return it as a move.

    Compiles the planner's kernels and builds the posture table if they are not cached.

    Args:
        machine: The arm.
        asked: Start, goal, weights and planner.

    Returns:
        The planned move, and its goal as the only one, from time 0.
    """
    check_coordinates(machine, asked)
    machine.check_in_workspace(asked.start)
    compile_planner()
    suite = Planner(machine, load_or_build_table(machine))
    at_rest = MotionState.at_rest(asked.start_posture(suite.machine))
    plan = suite.plan(asked.goal, at_rest, options=asked.options)
    title = f"{case_title(asked)}to {format_position(asked.goal, 'g')}, as planned"
    move = move_of_plan(machine, plan, asked.goal, title)
    return move, [FilmGoal(0.0, asked.goal)]


def _select_time_range(move: MoveRecord, begin: float, end: float | None) -> MoveRecord:
    """Return the part of a move between two times.

    Args:
        move: The move.
        begin: First time [s].
        end: Last time [s]; None is the move's end.

    Returns:
        The move with the rows in between, without reference and chamber pressures.

    Raises:
        UsageError: Fewer than two samples lie in between.
    """
    rows = (move.time >= begin) & (move.time <= (move.time[-1] if end is None else end))
    if np.count_nonzero(rows) < 2:
        last = "the end" if end is None else f"--end {end:g}"
        raise command_line.UsageError(
            f"nothing lies between --begin {begin:g} and {last}; there are "
            f"{move.time[-1]:.1f} s in all"
        )
    return replace(
        move,
        time=move.time[rows],
        position=move.position[rows],
        reference=None,
        modes=move.modes[rows],
        speed=move.speed[rows],
        force=move.force[rows],
        supply=move.supply[rows],
        chambers={},
    )


def main() -> int:
    """Entry point of `ros2 run mhsb_tools animate`."""
    return command_line.run(animate, name="animate")


if __name__ == "__main__":
    sys.exit(main())
