"""Benchmark of replanning online, over real topics between real processes.

    scripts/bench online

Random goals that can be reached, identical in every condition, are sent 0.5 to 3 s apart. Times
between goals are wall-clock times in all conditions, even if simulated time runs slower:

    idle      both nodes at default settings
    loaded    two busy loops beside them
    one_core  nodes, benchmark and one busy loop on one processor; the simulator is the clock

The outcome of each goal is evaluated by `goal_fates`; all goals count as feasible,
whatever their verdicts say. Then a goal moves to and fro on a line, sent at 50 Hz, without other
load (`compute_tracking_figures`).
"""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from benchmarks.message_watcher import MessageWatcher
from benchmarks.planning_benchmark import dijkstra_figures
from benchmarks.processor_load import (
    read_resident_bytes,
    restrict_to_one_processor,
    run_busy_loops,
)
from benchmarks.replanning_figures import compute_replanning_figures
from benchmarks.seeded_goals import SeededGoal, draw_reachable_goals
from benchmarks.streaming_benchmark import lines as followable_lines
from benchmarks.tracking_figures import compute_tracking_figures
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.command_line import Count, JsonFlag, NumberRange, Seed, UsageError
from mhsb_model.machine import Machine, load_machine
from mhsb_msgs_py.node_process import run_ros, serve_node, spin_until
from mhsb_planner.cases.moves import yield_random_moves
from mhsb_planner.planner import Planner, warm_up
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.result_files import write_json
from mhsb_tools.live.child_process import ChildProcess
from mhsb_tools.live.nodes import (
    check_no_other_nodes,
    run_both_nodes,
    wait_for_planner_answer,
)
from mhsb_tools.study.headless import compile_kernels

LAST_TIMEOUT = 60.0
"""Time in which the last goal must be reached [s]."""

STREAM_PERIOD, STREAM_SPEED = 0.02, 0.05
"""Time between streamed goals [s], and speed of the streamed goal [m/s]."""

REFERENCE_MOVES, REFERENCE_RUNS = 100, 3
"""Number of moves and runs of the yardstick, SciPy's Dijkstra."""

PER_MB = 1e-6

Figures = dict[str, Any]


@dataclass(frozen=True)
class LoadCondition:
    """Load beside the nodes during a measurement.

    Attributes:
        busy_loops: Number of processes that keep a processor busy.
        one_core: Whether nodes, benchmark and busy loops share one processor.
        simulated_time: Whether the simulator publishes /clock and the planner uses it.
    """

    busy_loops: int
    one_core: bool = False
    simulated_time: bool = False


CONDITIONS = {
    "idle": LoadCondition(0),
    "loaded": LoadCondition(2),
    "one_core": LoadCondition(1, one_core=True, simulated_time=True),
}


def measure(condition: LoadCondition, goals: Sequence[SeededGoal], name: str = "") -> Figures:
    """Start both nodes, send all goals under one condition and evaluate the run.

    Args:
        condition: Load beside the nodes.
        goals: Goals with the time until the next one.
        name: Name of the condition, for the progress bar.

    Returns:
        Figures of `compute_replanning_figures`, growth of both nodes' memory [MB], and the load
        average before and after.
    """
    load = os.getloadavg()[0]
    with (
        restrict_to_one_processor(condition.one_core),
        run_ros([]),
        serve_node(MessageWatcher) as (executor, watcher),
    ):
        check_no_other_nodes(watcher, executor)
        sim, planner = ("publish_clock:=true",), ("use_sim_time:=true",)
        settings = (sim, planner) if condition.simulated_time else ((), ())
        with run_both_nodes(*settings) as nodes:
            wait_for_planner_answer(watcher, executor)
            with run_busy_loops(condition.busy_loops):
                watcher.forget()
                before = sum(read_resident_bytes(node.pid) for node in nodes)
                _send(watcher, executor, goals, nodes, name)
                growth = sum(read_resident_bytes(node.pid) for node in nodes) - before
        recording = watcher.decode_messages()
    return {
        **compute_replanning_figures(recording),
        "rss_growth_mb": PER_MB * growth,
        "load_average_before": load,
        "load_average_after": os.getloadavg()[0],
    }


def measure_stream(machine: Machine, seconds: float) -> Figures:
    """Start both nodes, send a goal that moves to and fro at 50 Hz, and evaluate the run.

    Args:
        machine: The arm; the line is one that it can follow at `STREAM_SPEED`.
        seconds: Duration of the stream [s].

    Returns:
        Figures of `compute_tracking_figures`.
    """
    line = next(followable_lines(machine, STREAM_SPEED))
    with run_ros([]), serve_node(MessageWatcher) as (executor, watcher):
        check_no_other_nodes(watcher, executor)
        with run_both_nodes():
            wait_for_planner_answer(watcher, executor)
            first = watcher.send(*line.begin.tolist())
            spin_until(executor, lambda: first in watcher.executions, LAST_TIMEOUT)
            watcher.forget()
            began = due = time.monotonic()
            while (now := time.monotonic()) - began < seconds:
                last = watcher.send(*line.point_at(STREAM_SPEED * (now - began)).tolist())
                due += STREAM_PERIOD
                spin_until(executor, lambda: False, due - time.monotonic())
            spin_until(executor, lambda: last in watcher.executions, LAST_TIMEOUT)
        recording = watcher.decode_messages()
    return compute_tracking_figures(recording, machine)


def _send(
    watcher: MessageWatcher,
    executor: SingleThreadedExecutor,
    goals: Sequence[SeededGoal],
    nodes: tuple[ChildProcess, ...],
    name: str,
) -> None:
    """Send all goals on time and wait until the last one's execution ends.

    Args:
        watcher: Node that sends goals and records reports.
        executor: Executor of that node.
        goals: Goals with the time until the next one [s].
        nodes: Simulator and planner, checked after each goal.
        name: Label of the progress bar.

    Raises:
        ChildEndedError: A node ended.
    """
    due = time.monotonic()
    for goal in tqdm(goals, name, unit="goal", disable=None):
        spin_until(executor, lambda: False, due - time.monotonic())
        last = watcher.send(*goal.position)
        due += goal.pause
        for node in nodes:
            node.check_running()
    spin_until(executor, lambda: last in watcher.executions, LAST_TIMEOUT)
    spin_until(executor, lambda: False, 1.0)


def reference_ms(planner: Planner) -> float:
    """Return the median time of SciPy's Dijkstra as in `scripts/bench planning` [ms].

    It is the yardstick for the speed of the machine.

    Args:
        planner: The planner, for its graph.
    """
    moves = list(yield_random_moves(planner, REFERENCE_MOVES))
    return float(dijkstra_figures(planner.graph, moves, REFERENCE_RUNS)["p50_ms"])


def online(
    output: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("out/bench/online.json"),
    goals: Annotated[Count, tyro.conf.arg(metavar="N")] = 200,
    condition: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME [NAME ...]")] = tuple(
        CONDITIONS
    ),
    seed: Seed = 0,
    stream: Annotated[float, tyro.conf.arg(metavar="SECONDS"), NumberRange(0.0, 1e6)] = 60.0,
    json_: JsonFlag = False,
) -> int:
    """Measure replanning online, print a table and write the figures as JSON.

    Runs in the domain of ROS_DOMAIN_ID, where no other planner or simulator may be. Times in ms.

    Args:
        output: JSON file to write.
        goals: Number of goals in each condition.
        condition: Load beside the nodes: idle, loaded or one_core; all when left out.
        seed: Seed of goals and of the times between them.
        stream: Duration for which a goal streams at 50 Hz [s]; 0 leaves it out.
        json_: Print the JSON file instead of text.

    Returns:
        Exit code 0.
    """
    if unknown := [name for name in condition if name not in CONDITIONS]:
        raise UsageError(f"--condition: {unknown[0]} is not one of {', '.join(CONDITIONS)}")
    if goals < 1:
        raise UsageError(f"--goals is {goals}; it must be at least 1")
    machine = load_machine()
    figures, wanted = prepare(machine, goals, seed)
    try:
        for name in condition:
            figures[name] = measure(CONDITIONS[name], wanted, name)
            write_json(output, figures)
            command_line.set_interrupt_note(f"{output} has the conditions up to {name}")
        if stream > 0.0:
            figures["stream"] = measure_stream(machine, stream)
            write_json(output, figures)
    except ExternalShutdownException:
        raise KeyboardInterrupt from None
    if json_:
        print(output.read_text(encoding="utf-8"))
    else:
        print("\n".join(as_text(figures)))
        print(f"written to {output}")
    return 0


def prepare(machine: Machine, goals: int, seed: int) -> tuple[Figures, list[SeededGoal]]:
    """Compile all kernels and prepare what all conditions share.

    Args:
        machine: The arm.
        goals: Number of goals.
        seed: Seed of goals and of the times between them.

    Returns:
        Figures of the computer with SciPy's time [ms], and the goals.
    """
    compile_kernels()
    planner = Planner(machine, load_or_build_table(machine))
    warm_up(planner)
    wanted = draw_reachable_goals(planner, goals, seed)
    return {
        "seed": seed,
        "processors": os.cpu_count(),
        "processor": platform.processor() or platform.machine(),
        "scipy_dijkstra_p50_ms": reference_ms(planner),
    }, wanted


def as_text(figures: Figures) -> list[str]:
    """Format the figures as a table.

    Args:
        figures: Content of the JSON file.

    Returns:
        A line for the yardstick, column titles, a line for each measured condition and for the
        stream.
    """
    lines = [
        f"SciPy's Dijkstra {figures['scipy_dijkstra_p50_ms']:.2f} ms",
        "          goals applied retried lost deadline superseded   speed   lead p50, p99 [ms]"
        "   plan p50, p99 [ms]   jump [rad, rad/s]   growth [MB]",
    ]
    for name in filter(figures.__contains__, CONDITIONS):
        each = figures[name]
        lines.append(
            f"{name:9s} {each['goals']:5d} {each['applied']:7d} {each['retried']:7d} "
            f"{each['lost']:4d} {each['deadline']:8d} {each['superseded']:10d} "
            f"{_text(each['real_time_factor'], '7.3f')} {_two(each['lead_ms'])}   "
            f"{_two(each['plan_ms'])}    {_text(each['reference_jump_max_rad'], '8.1e')} "
            f"{_text(each['reference_jump_max_rad_s'], '8.1e')} {each['rss_growth_mb']:13.1f}"
        )
    if "stream" in figures:
        each = figures["stream"]
        lines.append(
            f"stream    {each['goals']} goals in {each['duration_s']:.0f} s: {each['verdicts']}, "
            f"{each['plans_per_s']:.1f} plans/s, {_two(each['behind_mm'])} mm behind (p50, p99)"
        )
    return lines


def _two(values: Figures) -> str:
    return f"{_text(values['p50'], '9.1f')} {_text(values['p99'], '8.1f')}"


def _text(value: float | None, form: str) -> str:
    return f"{'–':>{form.partition('.')[0]}}" if value is None else f"{value:{form}}"


def main() -> int:
    """Entry point of `scripts/bench online`."""
    return command_line.run(online, name="bench online")


if __name__ == "__main__":
    sys.exit(main())
