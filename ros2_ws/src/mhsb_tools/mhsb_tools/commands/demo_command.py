"""`demo`: run both nodes, send goals on a timer, record and report; the paper's Section 4."""

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
from rclpy.executors import SingleThreadedExecutor
from tqdm import tqdm

from mhsb_control import default_controller, load_machine
from mhsb_control.estimates_file import read_estimates_file
from mhsb_control.registry import check_keeps_estimates
from mhsb_model import command_line
from mhsb_model.command_line import JsonFlag, OptionalFile
from mhsb_model.errors import MhsbError
from mhsb_model.files.config_files import find_machine_config_file
from mhsb_model.files.machine_files import find_machine_file
from mhsb_model.files.output_folders import make_output_folder
from mhsb_model.files.yaml_files import read_yaml
from mhsb_model.goal import Goal, format_position
from mhsb_model.types import Position
from mhsb_msgs_py.node_process import run_command_node, spin_until
from mhsb_planner.result_files import write_json
from mhsb_planner.ros.goal_sender import GoalSender
from mhsb_sim.simulation.plant_files import check_plant, load_plant
from mhsb_tools.commands.demo_story import format_story
from mhsb_tools.comparison.supply_comparison import compare_on_tour
from mhsb_tools.live.child_process import ChildEndedError, ChildProcess
from mhsb_tools.live.nodes import (
    ANSWER_TIMEOUT,
    check_no_other_nodes,
    run_both_nodes,
    wait_for_planner_answer,
)
from mhsb_tools.report.report_command import write_report
from mhsb_tools.study.headless import compile_kernels

GOALS_FILE = "demo_goals.yaml"
"""Name of the goals file of the suite's own arm."""
UNFINISHED_FOLDER, RESULT_NAMES = "unfinished", ("bag", "report", "summary.json")
"""Folder in which a demo collects its results until all exist, and the names of these results."""

REST_TIME = 2.0
"""Time at rest after a goal that was waited for [s]."""

GOAL_LISTENERS = 2
"""Number of subscribers that must receive goals: the planner and the recorder."""

BOTH_SIDES = 0.5
"""Time after a discovery match within which the other side has matched, too [s]."""


@dataclass(frozen=True)
class DemoGoal:
    """A goal of the demo and when the next one follows.

    Attributes:
        x: Tip position forward in `base_link` [m].
        z: Tip position up [m].
        time: Time from sending this goal to sending the next [s]; None waits until the arm has
            arrived.
        y: Tip position to the left [m], for arms that slew; None for others.
    """

    x: float
    z: float
    time: float | None = None
    y: float | None = None

    @property
    def position(self) -> Position:
        """Tip position in `base_link`, (x, z) or (x, y, z) [m]."""
        return Goal(0, self.x, self.z, self.y).position


def demo(
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")],
    machine: OptionalFile = None,
    goals: OptionalFile = None,
    plant: OptionalFile = None,
    estimates_file: OptionalFile = None,
    view: bool = False,
    json_: JsonFlag = False,
) -> int:
    """Replan an arm online over ROS 2, record it and report on it.

    Starts sim_node and planner_node, sends goals on a timer, records into DIR/bag, writes
    DIR/report and DIR/summary.json. Runs in the domain of ROS_DOMAIN_ID. No other planner or
    simulator may run in this domain. Results of an earlier demo in DIR are replaced once all new
    ones exist; until then the new ones are in DIR/unfinished.

    Args:
        output: Folder for recording, report and summary.
        machine: Machine file (YAML); the suite's own arm when left out.
        goals: Goals (YAML: a list of x [m], z [m], y [m] if the arm slews, and time to the next
            [s]); the suite's goals for this machine when left out.
        plant: Plant file (YAML), such as config/realistic_plant.yaml: how the simulated arm differs
            from the machine that planner and servo know.
        estimates_file: File (YAML) of what the servo of a machine without pressure sensors has
            learnt: read at the start if it exists, written while the arm moves.
        view: Show the arm in a browser while it moves, at the address that is printed.
        json_: Print DIR/summary.json at the end; all else goes to standard error. Its
            energy_measured_j has the energy to the oil by main pump (mp) and servo pumps (sp).

    Returns:
        Exit code 0.

    Raises:
        MhsbError: A goal was lost or refused. Or a file or the output folder cannot be used, a
            planner or simulator already runs in this ROS domain, or a process failed.
    """
    with redirect_stdout(sys.stderr) if json_ else nullcontext():
        summary = _demo(output, machine, goals, (plant, estimates_file), view)
    if json_:
        print(json.dumps(summary))
    if problem := describe_failed_goals(summary):
        raise MhsbError(problem)
    return 0


def _demo(
    output: Path,
    machine: Path | None,
    goals: Path | None,
    of_simulator: tuple[Path | None, Path | None],
    view: bool,
) -> dict[str, Any]:
    """Run the demo: check the files, run the nodes, send the goals, write the report.

    The files are checked before a node starts. Kernels are compiled if they are not cached. After
    the motions, the same goals are planned by the other planners, to compare energies. Progress and
    a summary are printed.

    The results are the recording `bag`, the folder `report` and `summary.json`. While the demo runs
    they are in a subfolder of `output`. When all of them exist they are moved to `output` itself,
    and replace earlier results.

    Args:
        output: Folder for the results.
        machine: Machine file; None is the suite's own arm.
        goals: Goals file; None is the suite's file for this machine.
        of_simulator: Plant file, and file of what the servo has learnt. None for one that is not
            used.
        view: Start the viewer in a browser as well.

    Returns:
        The content of summary.json.

    Raises:
        MhsbError: A file or the output folder cannot be used, or a goal has the wrong number of
            coordinates for the arm. Or a planner node or simulator node already runs in this ROS
            domain, or a process failed.
    """
    arm = load_machine(machine)  # an unusable file is reported here, not by a node
    file = goals or find_machine_config_file(GOALS_FILE, arm.name)
    wanted = read_goals(file)
    for number, goal in enumerate(wanted, start=1):
        if len(goal.position) != len(arm.axes):
            own = "" if goals else f"; give goals of {arm.name} with --goals"
            raise MhsbError(f"{file}: goal {number} must have {', '.join(arm.axes)} [m]{own}")
    plant, estimates_file = of_simulator
    if plant:
        check_plant(arm, load_plant(arm, plant))
    if estimates_file:
        check_keeps_estimates(default_controller(arm))
        read_estimates_file(estimates_file, arm)
    began = time.monotonic()
    unfinished = prepare_output_folder(output)
    settings = (f"machine:={find_machine_file(machine).resolve()}",) if machine else ()
    files = {"plant": plant, "estimates_file": estimates_file}
    of_arm = tuple(f"{name}:={file.resolve()}" for name, file in files.items() if file)
    compile_kernels(lambda line: print(line, flush=True))
    with run_command_node(GoalSender) as (executor, sender):
        check_no_other_nodes(sender, executor)
        with _shown(machine) if view else nullcontext():
            print("starting simulator, planner and recorder")
            with run_both_nodes((*settings, *of_arm), settings) as nodes:
                wait_for_planner_answer(sender, executor)  # before the first goal
                _record(sender, executor, wanted, nodes, unfinished)
    print("writing the report")
    summary = write_report(unfinished / "bag", unfinished / "report", arm)
    (unfinished / "report" / "summary.json").unlink()
    print("planning the same goals by the other planners")
    tour = compare_on_tour(arm, [goal.position for goal in wanted])
    summary["tour"] = tour
    write_json(unfinished / "summary.json", summary)
    replace_earlier_results(output)
    print("\n".join(["", *format_story(summary, tour, output)]))
    print(f"done in {time.monotonic() - began:.0f} s")
    return summary


@contextmanager
def _shown(machine: Path | None) -> Iterator[None]:
    """Run the viewer (the arm in a browser) as a child process during a `with` block.

    Context manager. The viewer listens on a free port; its address is printed before the block
    begins.

    Args:
        machine: Machine file; None is the suite's own arm.

    Raises:
        ChildEndedError: The viewer ended, or gave no address within ANSWER_TIMEOUT.
    """
    arguments = ["--machine", str(find_machine_file(machine).resolve())] if machine else []
    with ChildProcess("mhsb_tools", "mhsb", "view", "--port", "0", *arguments) as viewer:
        print(f"the arm can be seen at {viewer.wait_for('http://', ANSWER_TIMEOUT)}", flush=True)
        yield


def describe_failed_goals(summary: dict[str, Any]) -> str | None:
    """Return a sentence on lost or refused goals, or None if there are none.

    Args:
        summary: The report's summary. It reads the numbers `goals_sent` and `goals_refused`, and
            the list `lost`: coordinates [m] and reason of each lost goal.

    Returns:
        If goals were lost: how many, and position and reason of the first. Otherwise, if goals were
        refused: how many. None if no goal was lost or refused.
    """
    sent, refused, lost = summary["goals_sent"], summary["goals_refused"], summary["lost"]
    if lost:
        first = lost[0]
        where = format_position(value for name, value in first.items() if name.endswith("_m"))
        return f"{len(lost)} of {sent} goals were lost, the first at {where}: {first['reason']}"
    if refused:
        return f"{refused} of {sent} goals were refused; summary.json says why"
    return None


def read_goals(file: Path) -> list[DemoGoal]:
    """Read goals from a YAML file.

    Args:
        file: A list of mappings. Keys: x, z [m]; y [m] if the arm slews; time [s] until the next
            goal, optional.

    Returns:
        The goals in the order of the file, at least one.

    Raises:
        MhsbError: The file cannot be read, is no list, is empty, or has a goal that cannot be used.
    """
    content = read_yaml(file)
    if not isinstance(content, list) or not content:
        raise MhsbError(f"{file} is not a list of goals; see config/{GOALS_FILE} for one")
    return [_goal(file, number, values) for number, values in enumerate(content, start=1)]


def _goal(file: Path, number: int, values: Any) -> DemoGoal:
    """Check one goal of a goals file and return it.

    Args:
        file: The file, for the error message.
        number: Number of the goal, from 1, for the error message.
        values: The goal as read from YAML: a mapping with x and z [m], and y [m] if the arm slews.
            `time` [s] until the next goal is optional. Whether the arm needs y is not checked here.

    Returns:
        The goal, all its numbers finite.

    Raises:
        MhsbError: `values` is no mapping, has a missing or unknown key, or a value is not a finite
            number.
    """
    try:
        goal = DemoGoal(**{key: float(value) for key, value in values.items()})
        if all(map(math.isfinite, (*goal.position, goal.time or 0.0))):
            return goal
    except (TypeError, ValueError, AttributeError, OverflowError):
        pass
    raise MhsbError(
        f"{file}: goal {number} must have x and z [m] and may have time [s], and y [m] where the "
        "arm slews, finite numbers"
    )


def prepare_output_folder(output: Path) -> Path:
    """Create the output folder, and in it an empty folder for the unfinished results.

    An existing folder of unfinished results is emptied. The function also sets the sentence that is
    printed if the user interrupts the command.

    Args:
        output: Folder of the demo; created if it does not exist.

    Returns:
        The folder for unfinished results, `output`/UNFINISHED_FOLDER.

    Raises:
        MhsbError: A part of the folder's path exists and is not a folder.
        OSError: The folder cannot be created or emptied for another reason.
    """
    make_output_folder(output, "the demo's output")
    unfinished = output / UNFINISHED_FOLDER
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir()
    command_line.set_interrupt_note(
        f"what was recorded is in {unfinished}; all else in {output} is as it was"
    )
    return unfinished


def replace_earlier_results(output: Path) -> None:
    """Move the new results into the output folder and delete earlier ones.

    The results are recording, report and summary (RESULT_NAMES). Other files in the folder stay.

    Args:
        output: Folder of the demo. Its folder of unfinished results must have all results; it is
            removed at the end.
    """
    for name in RESULT_NAMES:
        old = output / name
        shutil.rmtree(old) if old.is_dir() else old.unlink(missing_ok=True)
        os.replace(output / UNFINISHED_FOLDER / name, old)
    (output / UNFINISHED_FOLDER).rmdir()


def _record(
    sender: GoalSender,
    executor: SingleThreadedExecutor,
    goals: list[DemoGoal],
    nodes: tuple[ChildProcess, ...],
    output: Path,
) -> None:
    """Send all goals to the running nodes, one after the other, while a recorder runs.

    The recorder starts first and ends last. A goal may have a `time`, which is the wait until
    the next goal is sent. Without it, the wait ends with the goal's motion, or at once if the goal
    got no plan.

    Args:
        sender: Node that sends goals and collects verdicts.
        executor: Executor of that node.
        goals: Goals to send.
        nodes: Processes of simulator and planner. After each goal it is checked that they and the
            recorder still run.
        output: Folder in which the recording, named `bag`, is written.

    Raises:
        ChildEndedError: A process ended, the recorder does not receive goals, or the planner gives
            no verdict on a goal.
    """
    bag = str(output / "bag")
    with ChildProcess("mhsb_tools", "mhsb", "record", "--output", bag) as recorder:
        recorder.wait_for("ready", ANSWER_TIMEOUT)
        if not spin_until(
            executor, lambda: sender.subscriber_count >= GOAL_LISTENERS, ANSWER_TIMEOUT
        ):
            raise ChildEndedError("the recorder is ready, but cannot be reached over ROS")
        spin_until(executor, lambda: False, BOTH_SIDES)
        for number, goal in enumerate(tqdm(goals, desc="goals", unit="goal", disable=None), 1):
            _send(sender, executor, goal, f"goal {number} of {len(goals)}")
            for process in (*nodes, recorder):
                process.check_running()


def _send(sender: GoalSender, executor: SingleThreadedExecutor, goal: DemoGoal, title: str) -> None:
    """Send one goal, print its verdict, and wait until the next goal is due.

    There are three cases:

    - The goal has a time: the wait ends that long after sending.
    - It has no time, and a plan was made: the wait ends `REST_TIME` after the execution report,
      which says that the motion has ended. If that report does not come, the wait ends after
      the plan's duration plus `ANSWER_TIMEOUT` plus `REST_TIME`.
    - It has no time, and no plan was made: there is no wait.

    Args:
        sender: Node that sends goals and collects verdicts.
        executor: Executor of that node; it spins during the wait.
        goal: The goal.
        title: Words before the goal's position in the printed line, such as `goal 1 of 10`.

    Raises:
        ChildEndedError: The planner gave no verdict within `ANSWER_TIMEOUT`.
    """
    began = time.monotonic()
    stamp_ns = sender.send(*goal.position)
    if not spin_until(executor, lambda: stamp_ns in sender.verdicts, ANSWER_TIMEOUT):
        raise ChildEndedError(f"the planner gave no answer within {ANSWER_TIMEOUT:g} s")
    verdict = sender.verdicts[stamp_ns]
    plan = verdict.plan
    words = verdict.sentence
    if plan is not None and plan.plan_stamp_ns:
        words = (
            f"planned in {plan.plan_ms:.0f} ms, a motion of {plan.duration_s:.1f} s and "
            f"{plan.energy_series_j:.0f} J"
        )
    place = format_position(goal.position, ".3f")
    tqdm.write(f"  {title}, {place}: {verdict.code.value}, {words}")
    if goal.time is not None:
        spin_until(executor, lambda: False, goal.time - (time.monotonic() - began))
    elif verdict.plan is not None:
        longest = verdict.plan.duration_s + ANSWER_TIMEOUT
        spin_until(executor, lambda: stamp_ns in sender.executions, longest)
        spin_until(executor, lambda: False, REST_TIME)


main = command_line.make_main(demo)
