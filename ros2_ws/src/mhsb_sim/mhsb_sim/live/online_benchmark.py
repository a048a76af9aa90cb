"""How well replanning online does, over real topics between real processes.

    scripts/bench online

Random goals that there is a way to, the same in every condition, 0.5 to 3 s apart. Times between
goals are wall-clock times in all conditions, also where simulated time runs slower:

    idle      both nodes at default settings
    loaded    two busy loops beside them
    one_core  nodes, benchmark and one busy loop on one processor; the simulator is the clock

What became of each goal is `goal_fates`; all goals count as feasible, whatever their verdicts say.
Then a goal streams at 50 Hz, idle, to and fro on a line (`stream_figures`).
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
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.command_line import Count, Seed, UsageError, Within
from mhsb_model.machine import Machine, load_machine
from mhsb_msgs_py.node_process import ros_running, serving, spin_until
from mhsb_planner.evaluation.moves import random_moves
from mhsb_planner.evaluation.planning_benchmark import dijkstra_figures
from mhsb_planner.evaluation.streaming_benchmark import lines as followable_lines
from mhsb_planner.planner import Planner, warm_up
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_planner.result_files import write_json
from mhsb_sim.live.child_process import ChildProcess
from mhsb_sim.live.load import busy_loops, one_processor
from mhsb_sim.live.nodes import both_nodes, compile_nodes, refuse_company, shake_hands
from mhsb_sim.live.seeded_goals import SeededGoal, seeded_goals
from mhsb_sim.live.watcher import Watcher
from mhsb_sim.report.online_figures import online_figures
from mhsb_sim.report.stream_figures import stream_figures

LAST_TIMEOUT = 60.0
"""Time for the last goal to be reached [s]."""

STREAM_PERIOD, STREAM_SPEED = 0.02, 0.05  # s, m/s

REFERENCE_MOVES, REFERENCE_RUNS = 100, 3

PER_MB = 1e-6

Figures = dict[str, Any]


@dataclass(frozen=True)
class Condition:
    """What goes on beside the nodes.

    simulated_time  the simulator publishes /clock, which the planner goes by
    """

    busy_loops: int
    one_core: bool = False
    simulated_time: bool = False


CONDITIONS = {
    "idle": Condition(0),
    "loaded": Condition(2),
    "one_core": Condition(1, one_core=True, simulated_time=True),
}


def measure(condition: Condition, goals: Sequence[SeededGoal], name: str = "") -> Figures:
    """The figures of one condition."""
    load = os.getloadavg()[0]
    with (
        one_processor(condition.one_core),
        ros_running([]),
        serving(Watcher) as (executor, watcher),
    ):
        refuse_company(watcher, executor)
        sim, planner = ("publish_clock:=true",), ("use_sim_time:=true",)
        settings = (sim, planner) if condition.simulated_time else ((), ())
        with both_nodes(*settings) as nodes:
            shake_hands(watcher, executor)
            with busy_loops(condition.busy_loops):
                watcher.forget()
                before = sum(node.resident_bytes for node in nodes)
                _send(watcher, executor, goals, nodes, name)
                growth = sum(node.resident_bytes for node in nodes) - before
        recording = watcher.recording()
    return {
        **online_figures(recording),
        "rss_growth_mb": PER_MB * growth,
        "load_average_before": load,
        "load_average_after": os.getloadavg()[0],
    }


def measure_stream(machine: Machine, seconds: float) -> Figures:
    """The figures of a goal that moves to and fro for so long."""
    line = next(followable_lines(machine, STREAM_SPEED))
    with ros_running([]), serving(Watcher) as (executor, watcher):
        refuse_company(watcher, executor)
        with both_nodes():
            shake_hands(watcher, executor)
            first = watcher.send(*line.begin.tolist())
            spin_until(executor, lambda: first in watcher.executions, LAST_TIMEOUT)
            watcher.forget()
            began = due = time.monotonic()
            while (now := time.monotonic()) - began < seconds:
                last = watcher.send(*line.at(STREAM_SPEED * (now - began)).tolist())
                due += STREAM_PERIOD
                spin_until(executor, lambda: False, due - time.monotonic())
            spin_until(executor, lambda: last in watcher.executions, LAST_TIMEOUT)
        recording = watcher.recording()
    return stream_figures(recording, machine)


def _send(
    watcher: Watcher,
    executor: SingleThreadedExecutor,
    goals: Sequence[SeededGoal],
    nodes: tuple[ChildProcess, ...],
    name: str,
) -> None:
    """Send all goals on time, wait for the end of the last one."""
    due = time.monotonic()
    for goal in tqdm(goals, name, unit="goal", disable=None):
        spin_until(executor, lambda: False, due - time.monotonic())
        last = watcher.send(*goal.position)
        due += goal.time
        for node in nodes:
            node.check()
    spin_until(executor, lambda: last in watcher.executions, LAST_TIMEOUT)
    spin_until(executor, lambda: False, 1.0)


def reference_ms(planner: Planner) -> float:
    """SciPy's Dijkstra as `scripts/bench planning` has it, for ratios of times [ms]."""
    moves = list(random_moves(planner, REFERENCE_MOVES))
    return float(dijkstra_figures(planner.graph, moves, REFERENCE_RUNS)["p50_ms"])


def online(
    output: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("out/bench/online.json"),
    goals: Annotated[Count, tyro.conf.arg(metavar="N")] = 200,
    condition: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME [NAME ...]")] = tuple(
        CONDITIONS
    ),
    seed: Seed = 0,
    stream: Annotated[float, tyro.conf.arg(metavar="SECONDS"), Within(0.0, 1e6)] = 60.0,
    json_: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """Measure replanning online, print a table and write the figures as JSON.

    Runs in the domain of ROS_DOMAIN_ID, where no other planner or simulator may be. Times in ms.

    Args:
        output: JSON file to write.
        goals: Number of goals in each condition.
        condition: What goes on beside the nodes, of idle, loaded and one_core.
        seed: Of goals and the times between them.
        stream: How long a goal streams at 50 Hz [s]; 0 leaves it out.
        json_: Print the JSON file instead of text.
    """
    if unknown := [name for name in condition if name not in CONDITIONS]:
        raise UsageError(f"--condition: {unknown[0]} is not one of {', '.join(CONDITIONS)}")
    if goals < 1:
        raise UsageError(f"--goals is {goals}; it must be at least 1")
    machine = load_machine()
    figures, wanted = _offline(machine, goals, seed)
    try:
        for name in condition:
            figures[name] = measure(CONDITIONS[name], wanted, name)
            write_json(output, figures)
            command_line.keep(f"{output} has the conditions up to {name}")
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


def _offline(machine: Machine, goals: int, seed: int) -> tuple[Figures, list[SeededGoal]]:
    """What is the same for all conditions, worked out before."""
    compile_nodes()
    planner = Planner(machine, table_for(machine))
    warm_up(planner)
    wanted = seeded_goals(planner, goals, seed)
    return {
        "seed": seed,
        "processors": os.cpu_count(),
        "processor": platform.processor() or platform.machine(),
        "scipy_dijkstra_p50_ms": reference_ms(planner),
    }, wanted


def as_text(figures: Figures) -> list[str]:
    """The figures as a table."""
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
