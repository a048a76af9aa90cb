"""`animate`: a recording, or a plan, as an animation."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from mhsb_model import command_line
from mhsb_model.command_line import Within
from mhsb_model.files.output_folders import make_room_for
from mhsb_model.goal import place
from mhsb_model.machine import Machine, load_machine
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import Position
from mhsb_planner.commands.plan_arguments import case_title, refuse_elsewhere, request
from mhsb_planner.evaluation.move import Move, planned_move
from mhsb_planner.evaluation.paper_cases import PaperCase
from mhsb_planner.kernel_parts import compile_planner
from mhsb_planner.planner import ONLINE_PLANNER, Planner, PlannerKind
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_sim.commands.film import Sent, write_film
from mhsb_sim.recording.bag_reader import read_recording
from mhsb_sim.report.recorded_moves import whole_run
from mhsb_sim.report.recorded_run import recorded_run

SUFFIX = ".gif"
SMALLEST, LARGEST = 200, 4000
"""Width of the picture [dots]."""


def animate(
    bag: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="BAG")] = None,
    *,
    output: Annotated[Path, tyro.conf.arg(metavar="FILE")],
    start: Annotated[Position | None, tyro.conf.arg(metavar="X [Y] Z"), Within(-1e4, 1e4)] = None,
    goal: Annotated[Position | None, tyro.conf.arg(metavar="X [Y] Z"), Within(-1e4, 1e4)] = None,
    case: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None,
    planner: PlannerKind | None = None,
    machine: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    namespace: str | None = None,
    begin: Annotated[float, tyro.conf.arg(metavar="S"), Within(-1e9, 1e9)] = 0.0,
    end: Annotated[float | None, tyro.conf.arg(metavar="S"), Within(-1e9, 1e9)] = None,
    speed: Annotated[float, Within(-1e6, 1e6)] = 1.0,
    rate: Annotated[float, tyro.conf.arg(metavar="PER_S"), Within(-1e6, 1e6)] = 12.0,
    width: Annotated[int, Within(-(10**6), 10**6)] = 800,
    json_: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Draw a recording, or a plan, as an animated GIF.

    Give a recording, or --start and --goal of a plan, or --case for one of the paper's. The arm
    with its cylinders in the colours of their modes, the tip's path, modes and supply pressures
    [MPa] over time [s].

    Args:
        bag: Folder of the recording (rosbag2).
        output: File to write (GIF).
        start: Tip position at the start of a plan [m].
        goal: Tip position at its goal [m].
        case: One of the paper's cases, such as 1-1.
        planner: That plans, as in `mhsb_planner plan`; the case's own, without a case the
            integrated one when left out.
        machine: Machine file (YAML) of the arm; the suite's own when left out.
        namespace: Namespace of the recorded topics, such as /left; none when left out.
        begin: First instant that is shown, after the start [s].
        end: Last one [s]; to the end when left out.
        speed: Seconds that pass in one second of the film.
        rate: Pictures in one second of the film, at most 50.
        width: Of the picture [dots].
        json_: Print one JSON object instead of text.
    """
    _check(output, bag, (start, goal, case), speed, rate, width)
    _refuse_idle(bag, planner, namespace)
    make_room_for(output, "the animation")
    arm = load_machine(machine)
    if bag is not None:
        move, goals = _recorded(arm, bag, namespace or "")
    else:
        kind = planner or (None if case else ONLINE_PLANNER)
        move, goals = _planned(arm, request(start, goal, case, planner=kind))
    shown = _cut(move, begin, end)
    frames = write_film(shown, goals, output, speed=speed, rate=rate, width=width)
    if json_:
        told = {"output": str(output), "pictures": frames, "shown_s": shown.duration}
        print(json.dumps(told))
    else:
        print(f"{frames} pictures of {shown.duration:.1f} s in {output}")


def _check(
    output: Path,
    bag: Path | None,
    plan: tuple[object, ...],
    speed: float,
    rate: float,
    width: int,
) -> None:
    """Raise UsageError where the arguments do not go together, before anything takes time."""
    if output.suffix.lower() != SUFFIX:
        raise command_line.UsageError(f"--output: '{output}' must end in {SUFFIX}")
    if (bag is None) is not any(plan):
        raise command_line.UsageError("give a recording, or --start and --goal, or --case NAME")
    if speed <= 0.0:
        raise command_line.UsageError(f"--speed: {speed:g} must be above 0")
    if not 0.0 < rate <= 50.0:
        raise command_line.UsageError(f"--rate: {rate:g} must be above 0 and at most 50")
    if not SMALLEST <= width <= LARGEST:
        raise command_line.UsageError(f"--width: {width} must be within {SMALLEST} … {LARGEST}")


def _refuse_idle(bag: Path | None, planner: str | None, namespace: str | None) -> None:
    """Raise UsageError where an option that was given changes nothing."""
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


def _recorded(machine: Machine, bag: Path, namespace: str) -> tuple[Move, list[Sent]]:
    run = recorded_run(read_recording(bag, namespace, machine.slews), machine)
    move, first_ns = whole_run(run, f"{'/'.join(bag.resolve().parts[-2:])}, as recorded")
    goals = []
    for each in run.goals:
        if each.taken_over_ns is not None:
            time = (each.taken_over_ns - first_ns) / SECOND_NS
            goals.append(Sent(time, each.verdict.goal.position))
    return move, sorted(goals, key=lambda sent: sent.time)


def _planned(machine: Machine, asked: PaperCase) -> tuple[Move, list[Sent]]:
    refuse_elsewhere(machine, asked)
    machine.check_in_workspace(asked.start)
    compile_planner()
    suite = Planner(machine, table_for(machine))
    at_rest = MotionState.at_rest(asked.start_posture(suite.machine))
    plan = suite.plan(asked.goal, at_rest, options=asked.options)
    title = f"{case_title(asked)}to {place(asked.goal, 'g')}, as planned"
    move = planned_move(machine, plan, asked.goal, title)
    return move, [Sent(0.0, asked.goal)]


def _cut(move: Move, begin: float, end: float | None) -> Move:
    """The part between two times [s]; UsageError where there is nothing."""
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
    """Entry point of `ros2 run mhsb_sim animate`."""
    return command_line.run(animate, name="animate")


if __name__ == "__main__":
    sys.exit(main())
