"""`animate`: write a recording, or a plan, as an animated GIF."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from mhsb_control import load_machine
from mhsb_model import command_line
from mhsb_model.command_line import JsonFlag, NumberRange, OptionalFile, UsageError
from mhsb_model.files.output_folders import make_parent_folder
from mhsb_model.goal import format_position
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_planner.cases.paper_cases import PaperCase
from mhsb_planner.kernel_parts import compile_planner
from mhsb_planner.planner import Planner, PlannerKind
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_tools.commands.film import FilmGoal, write_film
from mhsb_tools.commands.plan_arguments import (
    OptionalPosition,
    build_request,
    check_coordinates,
    format_case_title,
)
from mhsb_tools.moves.move import MoveRecord, move_of_plan

FILE_SUFFIX = ".gif"
"""Ending that the output file must have."""


@dataclass(frozen=True)
class PlannedMoveArguments:
    """Options for a plan that is drawn in place of a recording.

    Attributes:
        start: Tip position at the start of a plan [m].
        goal: Tip position at its goal [m].
        case: One of the paper's cases, such as 1-1.
        planner: Planner of the plan, as in `mhsb plan`. When left out, the case's own;
            without a case, the integrated one.
    """

    start: OptionalPosition = None
    goal: OptionalPosition = None
    case: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    planner: PlannerKind | None = None

    @property
    def is_given(self) -> bool:
        """True if a start, a goal or a case is given."""
        return any((self.start, self.goal, self.case))


@dataclass(frozen=True)
class FilmArguments:
    """Options for the film.

    Attributes:
        begin: First instant that is shown, counted from the start [s].
        end: Last instant that is shown, counted from the start [s]; the end when left out.
        speed: Seconds that pass in one second of the film.
        rate: Pictures in one second of the film; fewer make a smaller file.
        width: Width of the pictures [pixels].
    """

    begin: Annotated[float, tyro.conf.arg(metavar="S"), NumberRange(-1e9, 1e9)] = 0.0
    end: Annotated[float | None, tyro.conf.arg(metavar="S"), NumberRange(-1e9, 1e9)] = None
    speed: Annotated[float, NumberRange(1e-6, 1e6)] = 1.0
    rate: Annotated[float, tyro.conf.arg(metavar="PER_S"), NumberRange(0.01, 50.0)] = 12.0
    width: Annotated[int, NumberRange(200, 4000)] = 800


def animate(
    bag: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[BAG]")] = None,
    *,
    output: Annotated[Path, tyro.conf.arg(metavar="FILE")],
    plan: PlannedMoveArguments,
    machine: OptionalFile = None,
    namespace: str | None = None,
    film: FilmArguments,
    json_: JsonFlag = False,
) -> None:
    """Draw a recording, or a plan, as an animated GIF.

    Give a recording, or --start and --goal of a plan, or --case for a case of the paper. The film
    shows the arm with its cylinders in the colours of their modes, the tip's path, and modes and
    supply pressures [MPa] over time [s].

    Args:
        bag: Folder of the recording (rosbag2).
        output: File to write (GIF).
        plan: Plan that is drawn in place of a recording.
        machine: Machine file (YAML) of the arm; the suite's own when left out.
        namespace: Namespace of the recorded topics, such as /left; none when left out.
        film: What is shown of the recording or plan, and how.
        json_: Print one JSON object instead of text.

    Raises:
        UsageError: `output` does not end in .gif, not exactly one of recording and plan is given,
            an option has no effect, or fewer than two samples lie in the time range.
        BagError: The recording cannot be read, or has fewer than two hydraulic states during its
            references.
        ArgumentError: The film would have too many frames.
        MhsbError: Start or goal does not suit the arm, no motion was found, or a file cannot be
            used.
    """
    if output.suffix.lower() != FILE_SUFFIX:
        raise UsageError(f"--output: '{output}' must end in {FILE_SUFFIX}")
    _check_source(bag, plan, namespace)
    make_parent_folder(output, "the animation")
    arm = load_machine(machine)
    if bag is not None:
        move, goals = _read_recorded_move(arm, bag, namespace or "")
    else:
        asked = build_request(plan.start, plan.goal, plan.case, planner=plan.planner)
        move, goals = _plan_move(arm, asked)
    shown = _select_time_range(move, film.begin, film.end)
    frames = write_film(shown, goals, output, speed=film.speed, rate=film.rate, width=film.width)
    if json_:
        summary = {"output": str(output), "pictures": frames, "shown_s": shown.duration}
        print(json.dumps(summary))
    else:
        print(f"{frames} pictures of {shown.duration:.1f} s in {output}")


def _check_source(bag: Path | None, plan: PlannedMoveArguments, namespace: str | None) -> None:
    """Check that either a recording or a plan is given, and that each option has an effect.

    Args:
        bag: Folder of the recording; None if the option was not given.
        plan: Options of a plan: start, goal, case, planner.
        namespace: Namespace of the recorded topics; None if the option was not given.

    Raises:
        UsageError: Both or neither of recording and plan are given. Or an option has no effect: a
            planner beside a recording, or a namespace without a recording.
    """
    if (bag is None) is not plan.is_given:
        raise UsageError("give a recording, or --start and --goal, or --case NAME")
    if bag is not None and plan.planner is not None:
        raise UsageError(
            f"--planner {plan.planner} has no effect: a recording has been planned already; leave "
            "it out, or give --start and --goal, or --case NAME, instead of the recording"
        )
    if bag is None and namespace is not None:
        raise UsageError(
            f"--namespace {namespace} has no effect: a plan has no topics; leave it out, or give a "
            "recording"
        )


def _read_recorded_move(
    machine: Machine, bag: Path, namespace: str
) -> tuple[MoveRecord, list[FilmGoal]]:
    """Read a whole recording as one move.

    Args:
        machine: The recorded arm.
        bag: Folder of the recording (rosbag2).
        namespace: Namespace of the recorded topics; empty for none.

    Returns:
        The recording as a move whose time begins at its first sample. Then the goals whose plan the
        arm executed, in time order. The time of each goal is the instant at which its plan took
        over, in the move's time [s].

    Raises:
        BagError: The recording cannot be read. Or fewer than two hydraulic states were recorded
            between the first and the last reference.
    """
    # Recordings are decoded by ROS; plans are animated without it.
    from mhsb_tools.recording.bag_reader import read_recording
    from mhsb_tools.report.recorded_moves import get_whole_run_as_move
    from mhsb_tools.report.recorded_run import evaluate_recording

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
    """Plan a motion from rest and return it as a move.

    Compiles the planner's kernels and builds the posture table (best posture for each tip position)
    if they are not cached.

    Args:
        machine: The arm.
        asked: Start, goal, weights and planner.

    Returns:
        The planned move, and a list with its one goal, which holds from time 0.

    Raises:
        MhsbError: Start or goal does not suit the arm, or no motion was found.
    """
    check_coordinates(machine, asked)
    machine.check_in_workspace(asked.start)
    compile_planner()
    suite = Planner(machine, load_or_build_table(machine))
    at_rest = MotionState.at_rest(asked.start_posture(suite.machine))
    plan = suite.plan(asked.goal, at_rest, options=asked.options)
    title = f"{format_case_title(asked)}to {format_position(asked.goal, 'g')}, as planned"
    move = move_of_plan(machine, plan, asked.goal, title)
    return move, [FilmGoal(0.0, asked.goal)]


def _select_time_range(move: MoveRecord, begin: float, end: float | None) -> MoveRecord:
    """Return the part of a move between two times.

    Args:
        move: The move.
        begin: First time to keep, in the move's time [s].
        end: Last time to keep [s]; None keeps all to the end of the move.

    Returns:
        A new move with the samples from `begin` to `end`. It has no reference and no chamber
        pressures. Times do not change.

    Raises:
        UsageError: Fewer than two samples are in the range.
    """
    rows = (move.time >= begin) & (move.time <= (move.time[-1] if end is None else end))
    if np.count_nonzero(rows) < 2:
        last = "the end" if end is None else f"--end {end:g}"
        raise UsageError(
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


main = command_line.make_main(animate)
