"""`demo`: both nodes, goals on a timer, a recording and a report; the paper's Section 4."""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.errors import MhsbError
from mhsb_model.files.config_files import of_machine
from mhsb_model.files.output_folders import make_output_folder
from mhsb_model.files.yaml_files import read_yaml
from mhsb_model.goal import Goal, place
from mhsb_model.machine import load_machine
from mhsb_model.types import Position
from mhsb_msgs_py.node_process import ros_running, serving, spin_until
from mhsb_planner.ros.goal_sender import GoalSender
from mhsb_sim.live.child_process import ChildEndedError, ChildProcess
from mhsb_sim.live.nodes import (
    ANSWER_TIMEOUT,
    both_nodes,
    compile_nodes,
    refuse_company,
    shake_hands,
)
from mhsb_sim.report.report_command import summary_lines, write_report
from mhsb_sim.simulation.plant_check import check_plant
from mhsb_sim.simulation.plant_files import load_plant

GOALS_FILE = "demo_goals.yaml"
UNFINISHED, RESULTS = "unfinished", ("bag", "report", "summary.json")
"""Where a demo puts what it makes until all of it is there, and what that is."""

REST = 2.0
"""Time at rest after a goal that was waited for [s]."""

LISTENERS = 2
"""Who has to hear goals: the planner and the recorder."""

BOTH_SIDES = 0.5
"""Time after a match within which the other side knows of it, too [s]."""


@dataclass(frozen=True)
class TimedGoal:
    """A tip position [m] and the time until the next goal [s]; None waits for the arrival.

    y is for arms that slew
    """

    x: float
    z: float
    time: float | None = None
    y: float | None = None

    @property
    def position(self) -> Position:
        """In `base_link`."""
        return Goal(0, self.x, self.z, self.y).position


def demo(
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")],
    machine: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    goals: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    plant: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    view: bool = False,
    json_: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """Replan an arm online over ROS 2, record it and report on it.

    Starts sim_node and planner_node, sends goals on a timer, records into DIR/bag, writes
    DIR/report and DIR/summary.json. Runs in the domain of ROS_DOMAIN_ID, where no other planner
    or simulator may be. What an earlier demo left in DIR is replaced once all of it is there anew;
    until then it is in DIR/unfinished.

    Args:
        output: Folder for recording, report and summary.
        machine: Machine file (YAML); the suite's own arm when left out.
        goals: Goals (YAML: a list of x [m], z [m], where the arm slews also y [m], and time to the
            next [s]); the machine's own of the suite when left out.
        plant: Plant file (YAML), such as config/realistic_plant.yaml: what the simulated arm has
            other than the machine that planner and servo know.
        view: Show the arm in a browser meanwhile, at the address that is printed.
        json_: Print DIR/summary.json at the end; all else goes to standard error.
    """
    with redirect_stdout(sys.stderr) if json_ else nullcontext():
        summary = _demo(output, machine, goals, plant, view)
    if json_:
        print(json.dumps(summary))
    if problem := shortfall(summary):
        raise MhsbError(problem)
    return 0


def _demo(
    output: Path, machine: Path | None, goals: Path | None, plant: Path | None, view: bool
) -> dict[str, Any]:
    """All of it; what is in summary.json."""
    arm = load_machine(machine)  # a file that cannot be used is told here, not by a node
    file = goals or of_machine(GOALS_FILE, arm.name)
    wanted = read_goals(file)
    for number, goal in enumerate(wanted, start=1):
        if len(goal.position) != len(arm.axes):
            own = "" if goals else f"; give goals of {arm.name} with --goals"
            raise MhsbError(f"{file}: goal {number} must have {', '.join(arm.axes)} [m]{own}")
    if plant:
        check_plant(arm, load_plant(arm, plant))
    began = time.monotonic()
    unfinished = begin(output)
    settings = (f"machine:={machine.resolve()}",) if machine else ()
    of_plant = (f"plant:={plant.resolve()}",) if plant else ()
    compile_nodes()
    try:
        with ros_running(), serving(GoalSender) as (executor, sender):
            refuse_company(sender, executor)
            with _shown(machine) if view else nullcontext():
                _run(sender, executor, wanted, ((*settings, *of_plant), settings), unfinished)
    except ExternalShutdownException:
        raise KeyboardInterrupt from None
    print("writing the report")
    summary = write_report(unfinished / "bag", unfinished / "report", arm)
    shutil.move(unfinished / "report" / "summary.json", unfinished / "summary.json")
    finish(output)
    print("\n".join(summary_lines(summary)))
    print(f"done in {time.monotonic() - began:.0f} s; see {output}/report and summary.json")
    return summary


@contextmanager
def _shown(machine: Path | None) -> Iterator[None]:
    """A viewer on any free port, for the length of a block."""
    arguments = ["--machine", str(machine.resolve())] if machine else []
    with ChildProcess("mhsb_sim", "viewer", "--port", "0", *arguments) as viewer:
        print(f"the arm can be seen at {viewer.wait_for('http://', ANSWER_TIMEOUT)}", flush=True)
        yield


def shortfall(summary: dict[str, Any]) -> str | None:
    """One sentence where a goal was lost, or where there was no way to it; else None."""
    sent, refused, lost = summary["goals_sent"], summary["goals_refused"], summary["lost"]
    if lost:
        first = lost[0]
        where = place(value for name, value in first.items() if name.endswith("_m"))
        return f"{len(lost)} of {sent} goals were lost, the first at {where}: {first['reason']}"
    if refused:
        return f"{refused} of {sent} goals were refused; summary.json says why"
    return None


def read_goals(file: Path) -> list[TimedGoal]:
    """Goals of a YAML file; MhsbError where they cannot be used."""
    content = read_yaml(file)
    if not isinstance(content, list) or not content:
        raise MhsbError(f"{file} is not a list of goals; see config/{GOALS_FILE} for one")
    return [_goal(file, number, values) for number, values in enumerate(content, start=1)]


def _goal(file: Path, number: int, values: Any) -> TimedGoal:
    try:
        goal = TimedGoal(**{key: float(value) for key, value in values.items()})
        if all(map(math.isfinite, (*goal.position, goal.time or 0.0))):
            return goal
    except (TypeError, ValueError, AttributeError, OverflowError):
        pass
    raise MhsbError(
        f"{file}: goal {number} must have x and z [m] and may have time [s], and y [m] where the "
        "arm slews, finite numbers"
    )


def begin(output: Path) -> Path:
    """The folder for what a demo makes until all of it is there, emptied."""
    make_output_folder(output, "the demo's output")
    unfinished = output / UNFINISHED
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir()
    command_line.keep(f"what was recorded is in {unfinished}; all else in {output} is as it was")
    return unfinished


def finish(output: Path) -> None:
    """Put what the demo has made in the place of what an earlier one left; all else stays."""
    for name in RESULTS:
        old = output / name
        shutil.rmtree(old) if old.is_dir() else old.unlink(missing_ok=True)
        os.replace(output / UNFINISHED / name, old)
    (output / UNFINISHED).rmdir()


def _run(
    sender: GoalSender,
    executor: SingleThreadedExecutor,
    goals: list[TimedGoal],
    settings: tuple[tuple[str, ...], tuple[str, ...]],
    output: Path,
) -> None:
    """Start all, settings of the simulator and of the planner, and send the goals."""
    print("starting simulator, planner and recorder")
    with both_nodes(*settings) as nodes:
        shake_hands(sender, executor)
        _record(sender, executor, goals, nodes, output)


def _record(
    sender: GoalSender,
    executor: SingleThreadedExecutor,
    goals: list[TimedGoal],
    nodes: tuple[ChildProcess, ...],
    output: Path,
) -> None:
    """Send all goals to the running nodes while everything is recorded."""
    bag = str(output / "bag")
    with ChildProcess("mhsb_sim", "record", "--output", bag) as recorder:
        recorder.wait_for("ready", ANSWER_TIMEOUT)
        if not spin_until(executor, lambda: sender.listeners >= LISTENERS, ANSWER_TIMEOUT):
            raise ChildEndedError("the recorder is ready, but cannot be reached over ROS")
        spin_until(executor, lambda: False, BOTH_SIDES)
        for goal in tqdm(goals, desc="goals", unit="goal", disable=None):
            _send(sender, executor, goal)
            for process in (*nodes, recorder):
                process.check()


def _send(sender: GoalSender, executor: SingleThreadedExecutor, goal: TimedGoal) -> None:
    """Send a goal and wait as long as it says, or until the arm has come to rest."""
    began = time.monotonic()
    stamp_ns = sender.send(*goal.position)
    if not spin_until(executor, lambda: stamp_ns in sender.verdicts, ANSWER_TIMEOUT):
        raise ChildEndedError(f"the planner gave no answer within {ANSWER_TIMEOUT:g} s")
    verdict = sender.verdicts[stamp_ns]
    tqdm.write(f"  {place(goal.position, '.3f')}: {verdict.code.value}, {verdict.sentence}")
    if goal.time is not None:
        spin_until(executor, lambda: False, goal.time - (time.monotonic() - began))
    elif verdict.plan is not None:
        longest = verdict.plan.duration_s + ANSWER_TIMEOUT
        spin_until(executor, lambda: stamp_ns in sender.executions, longest)
        spin_until(executor, lambda: False, REST)


def main() -> int:
    """Entry point of `ros2 run mhsb_sim demo`."""
    return command_line.run(demo, name="demo")


if __name__ == "__main__":
    sys.exit(main())
