"""How fast planning is: the posture table, plans, first motions, and how it grows with the grid.

    scripts/bench planning

Times are medians of `RUNS` runs, those of whole integrated plans single ones, on whatever else the
machine does meanwhile; ratios are of times taken one after the other.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import tyro
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.command_line import Count, JobCount, Seed, Within
from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine, load_machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import MotionState
from mhsb_planner.evaluation.deadline_benchmark import (
    first_motion_figures,
    first_motion_lines,
    overrun_figures,
    overrun_lines,
)
from mhsb_planner.evaluation.integrated_benchmark import integrated_figures
from mhsb_planner.evaluation.moves import Move, random_moves
from mhsb_planner.evaluation.search_benchmark import (
    boosted_figures,
    boosted_lines,
    scene_figures,
    scene_lines,
)
from mhsb_planner.evaluation.streaming_benchmark import (
    moving_goal_figures,
    moving_goal_lines,
    stream_figures,
    stream_lines,
)
from mhsb_planner.evaluation.time_optimality import (
    time_optimality_figures,
    time_optimality_lines,
)
from mhsb_planner.motion.s4_mode_schedule import StartModes, mode_schedule
from mhsb_planner.planner import ENERGY_OPTIMAL, Planner, warm_up
from mhsb_planner.posture import s1_judge, s1_slsqp
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.result_files import write_json
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_search import search
from mhsb_planner.search.s2_step import DURATION, ENERGY_PAPER

RUNS = 5
SEED = 0
SPACINGS = (0.05, 0.025, 0.0125)  # m
MILLI = 1e3

Figures = dict[str, Any]
Result = TypeVar("Result")


ANY_MACHINE = ("table", "plan", "first_motion_ms", "overrun_ms", "stream")
PARTS = (*ANY_MACHINE, "moving_goal", "boosted", "scenes", "time_optimality", "growth")
"""Of the benchmark; those that are not of ANY_MACHINE are made for three joints that turn."""


@dataclass(frozen=True)
class Effort:
    """How much is measured.

    Plans, first motions, plans with a deadline in each condition, SLSQP entries, ground truths,
    plans for each spacing, and the spacings [m]; moves to a goal that comes again, and lines on
    which one moves; moves with ground truth on each machine that boosts much, scenes with
    obstacles; plans whose duration is compared with a collocation's; the deadline of plans that
    are wanted soon [s], and the seed of the random moves.
    """

    moves: int = 500
    first_motions: int = 100
    deadlines: int = 150
    entries: int = 200
    truths: int = 10
    growth_moves: int = 100
    spacings: tuple[float, ...] = SPACINGS
    runs: int = RUNS
    repeated: int = 30
    lines: int = 5
    boosted: int = 3
    scenes: int = 10
    collocations: int = 20
    within: float = 0.045
    seed: int = SEED


def measure(
    machine: Machine,
    effort: Effort,
    jobs: int | None = None,
    parts: Sequence[str] = PARTS,
    keep: Callable[[Figures], object] | None = None,
) -> Figures:
    """Figures of these parts of the benchmark, by the keys of its JSON file, and the yardstick.

    keep: is given those that there are after each part, so that none is lost.
    """
    figures: Figures = {}
    warm_up(Planner(machine, build_posture_table(machine, jobs=jobs)))
    table = build_posture_table(machine, jobs=jobs)
    if "table" in parts:
        table, figures["table"] = _table_figures(machine, effort, jobs)
    planner = Planner(machine, table)
    bar = tqdm(random_moves(planner, effort.moves, effort.seed), "moves", effort.moves, unit="move")
    moves = list(bar)
    figures["scipy_dijkstra"] = dijkstra_figures(planner.graph, moves, effort.runs)
    yardstick = figures["scipy_dijkstra"]["p50_ms"]
    measured: dict[str, Callable[[], Any]] = {
        "plan": lambda: {
            "table": _plan_figures(planner, moves, effort),
            "integrated": integrated_figures(planner, moves, effort.truths, effort.within),
        },
        "first_motion_ms": lambda: first_motion_figures(
            planner, moves[: effort.first_motions], yardstick
        ),
        "overrun_ms": lambda: overrun_figures(planner, moves[: effort.deadlines]),
        "stream": lambda: stream_figures(planner, moves[: effort.repeated]),
        "moving_goal": lambda: moving_goal_figures(planner, effort.lines),
        "boosted": lambda: boosted_figures(planner, effort.boosted),
        "scenes": lambda: scene_figures(planner, effort.scenes),
        "time_optimality": lambda: time_optimality_figures(planner, moves[: effort.collocations]),
        "growth": lambda: [
            _growth_figures(machine, spacing, effort, jobs) for spacing in effort.spacings
        ],
    }
    for part, work in measured.items():
        if part in parts:
            figures[part] = work()
            if keep:
                keep(figures)
    return figures


# --- Posture table -------------------------------------------------------------------------------


def _table_figures(
    machine: Machine, effort: Effort, jobs: int | None
) -> tuple[PostureTable, Figures]:
    build_s, table = _timed(lambda: build_posture_table(machine, jobs=jobs), effort.runs)
    began = time.perf_counter()
    judgement = s1_judge.judged(machine.plane, table, effort.entries, SEED)
    per_start = (time.perf_counter() - began) / (effort.entries * s1_judge.STARTS)
    per_entry = s1_slsqp.STARTS * per_start
    return table, {
        "entries": table.entries,
        "build_s": build_s,
        "slsqp_s_per_entry": per_entry,
        "speedup_over_slsqp": per_entry / (build_s / table.entries),
        "worst_area_ratio": judgement.worst_ratio,
    }


# --- Plans ---------------------------------------------------------------------------------------


def _plan_figures(planner: Planner, moves: list[Move], effort: Effort) -> Figures:
    """Percentiles over all moves of S2 to S4 together and of each, and of a first plan."""
    settled = StartModes.settled(np.full(planner.machine.joint_count, Mode.N))
    runs = []
    for _ in tqdm(range(effort.runs), desc="plans", unit="run"):
        times = np.empty((len(moves), 4))
        for row, move in zip(times, moves, strict=True):
            plan = planner.plan(move.goal, MotionState.at_rest(move.start))
            began = time.perf_counter()
            mode_schedule(planner.machine, plan.motion.trajectory, settled)
            s4 = time.perf_counter() - began
            s2, fit = plan.seconds["search"], plan.seconds["fit"]
            row[:] = s2 + fit, s2, fit - s4, s4
        runs.append(MILLI * times)
    percentiles = np.median([np.percentile(times, [50, 99], axis=0) for times in runs], axis=0)
    (p50, *_), (p99, s2_p99, s3_p99, s4_p99) = percentiles.tolist()
    return {
        "p50_ms": p50,
        "p99_ms": p99,
        "s2_p99_ms": s2_p99,
        "s3_p99_ms": s3_p99,
        "s4_p99_ms": s4_p99,
        "rebuild_ms": _rebuild_ms(planner, moves, effort.runs),
    }


def _rebuild_ms(planner: Planner, moves: list[Move], runs: int) -> float:
    """First plan after a change of payload or supply pressure, the table kept; the median."""
    base, times = planner.machine, []
    for run in range(1, runs + 1):
        changes = (
            base.changed(payload=base.arrays.payload * (1.0 - 0.01 * run)),
            base.changed(supply_pressure=base.arrays.supply_pressure * (1.0 + 0.01 * run)),
        )
        for machine in changes:
            move = moves[run % len(moves)]
            began = time.perf_counter()
            planner.change(machine)
            planner.plan(move.goal, MotionState.at_rest(move.start))
            times.append(time.perf_counter() - began)
    planner.change(base)
    return MILLI * statistics.median(times)


# --- Comparison and growth -----------------------------------------------------------------------


def explicit_graph(graph: StepGraph) -> csr_array:
    """All states and steps with the cost of the energy-optimal weights, for SciPy's searches.

    A step of no cost is given the smallest number there is: SciPy takes 0 for no step.
    Of parallel steps there are none, since each state is entered in its own pattern.
    """
    edges, patterns = graph.edges, len(graph.table.patterns)
    owner = graph.layout.owner.ravel()
    states = np.flatnonzero(owner >= 0)
    count = (edges.last - edges.first)[owner[states]]
    origin = np.repeat(states, count)
    within = np.arange(len(origin)) - np.repeat(np.cumsum(count) - count, count)
    edge = np.repeat(edges.first[owner[states]], count) + within
    weights = ENERGY_OPTIMAL
    cost = weights.energy * edges.cost[edge, ENERGY_PAPER]
    cost += weights.time * edges.cost[edge, DURATION]
    cost += weights.switches * graph.switches[origin % patterns, edges.pattern[edge]]
    shape = (len(owner), len(owner))
    return csr_array((np.maximum(cost, np.finfo(float).tiny), (origin, edges.state[edge])), shape)


def dijkstra_figures(graph: StepGraph, moves: list[Move], runs: int) -> Figures:
    """SciPy's Dijkstra from the same starts, to all states; making its graph does not count."""
    matrix = explicit_graph(graph)
    table, joints = graph.table, graph.machine.joint_count
    starts = [
        int(np.flatnonzero(np.all(table.posture[:, 0] == move.start[-joints:], axis=1))[0])
        * len(table.patterns)
        for move in moves
    ]
    times = np.empty((runs, len(moves)))
    for row in tqdm(times, desc="SciPy", unit="run"):
        for k, start in enumerate(starts):
            began = time.perf_counter()
            dijkstra(matrix, indices=start)
            row[k] = time.perf_counter() - began
    p50, p99 = MILLI * np.median(np.percentile(times, [50, 99], axis=1), axis=1)
    return {"p50_ms": float(p50), "p99_ms": float(p99)}


def _growth_figures(
    machine: Machine, spacing: float, effort: Effort, jobs: int | None
) -> Figures:
    """Sizes and times for one spacing: table, graph, and the search between random nodes."""
    build_s, table = _timed(lambda: build_posture_table(machine, spacing, jobs), 1)
    graph_s, graph = _timed(lambda: StepGraph(machine, table, jobs), 1)
    random = np.random.default_rng(SEED)
    nodes = np.flatnonzero(table.feasible)
    times: list[float] = []
    expanded: list[int] = []
    bar = tqdm(total=effort.growth_moves, desc=f"{1e3 * spacing:g} mm", unit="plan")
    while len(times) < effort.growth_moves:
        here, there = random.choice(nodes, 2, replace=False)
        x, z = table.nodes[there] * spacing
        try:
            began = time.perf_counter()
            path = search(
                graph, table.posture[here, 0], table.patterns[0], (x, z), ENERGY_OPTIMAL
            )
            times.append(MILLI * (time.perf_counter() - began))
        except MhsbError:
            continue
        expanded.append(path.statistics.expanded)
        bar.update()
    bar.close()
    return {
        "spacing_m": spacing,
        "nodes": len(table.nodes),
        "states": int(np.count_nonzero(graph.layout.owner >= 0)),
        "steps": len(graph.edges.state),
        "build_s": build_s,
        "graph_s": graph_s,
        "expanded_p50": float(np.median(expanded)),
        "search_p50_ms": float(np.percentile(times, 50)),
        "search_p99_ms": float(np.percentile(times, 99)),
    }


def _timed(work: Callable[[], Result], runs: int) -> tuple[float, Result]:
    """Median of the seconds that some runs take, and the last one's result."""
    times = []
    for _ in range(runs):
        began = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - began)
    return statistics.median(times), result


# --- Command -------------------------------------------------------------------------------------


def planning(
    output: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("out/bench/planning.json"),
    machine: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    jobs: Annotated[JobCount, tyro.conf.arg(metavar="N")] = None,
    boosted: Annotated[Count, tyro.conf.arg(metavar="N")] = Effort.boosted,
    scenes: Annotated[Count, tyro.conf.arg(metavar="N")] = Effort.scenes,
    collocations: Annotated[Count, tyro.conf.arg(metavar="N")] = Effort.collocations,
    moves: Annotated[Count, tyro.conf.arg(metavar="N")] = Effort.moves,
    truths: Annotated[Count, tyro.conf.arg(metavar="N")] = Effort.truths,
    within: Annotated[float, tyro.conf.arg(metavar="S"), Within(1e-4, 1e4)] = Effort.within,
    seed: Annotated[Seed, tyro.conf.arg(metavar="N")] = Effort.seed,
    parts: Annotated[list[str] | None, tyro.conf.arg(metavar="PART")] = None,
    json_: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Measure planning, print a table and write the figures as JSON.

    Args:
        output: JSON file to write.
        machine: Machine file (YAML); the suite's own arm when left out.
        jobs: Number of threads; one for each processor when left out.
        boosted: Moves with ground truth on each of three machines that boost much, 10 to 40 s each.
        scenes: Random scenes with obstacles.
        collocations: Of the moves, those whose duration is compared with an offline collocation's.
        moves: Random moves that are planned.
        truths: Of these, those with ground truth, some 10 s each; 20 s with four joints.
        within: Deadline of plans that are wanted soon [s].
        seed: Of the random moves.
        parts: Keys of the JSON file that are measured; all, of arms with more than three joints
            those of any machine, when left out.
        json_: Print the JSON file instead of text.
    """
    least_counts = (("moves", moves, 1), ("collocations", collocations, 1), ("truths", truths, 0))
    for name, count, least in least_counts:
        if count < least:
            raise command_line.UsageError(f"--{name} {count} is below {least}")
    arm = load_machine(machine)
    possible = PARTS if arm.is_3r else ANY_MACHINE
    for part in parts or ():
        if part not in possible:
            reason = f"--parts {part} is none of {', '.join(possible)}"
            raise command_line.UsageError(reason)
    effort = Effort(
        moves=moves,
        truths=truths,
        boosted=boosted,
        scenes=scenes,
        collocations=collocations,
        within=within,
        seed=seed,
    )
    figures = measure(arm, effort, jobs, parts or possible, partial(_keep, output))
    if json_:
        print(output.read_text(encoding="utf-8"))
        return
    print("\n".join(as_text(figures)))
    print(f"written to {output}")


def _keep(output: Path, figures: Figures) -> None:
    write_json(output, figures)
    command_line.keep(f"{output} has what was measured, up to '{list(figures)[-1]}'")


def as_text(figures: Figures) -> list[str]:
    """The figures as a table, of the parts that there are."""
    other = figures["scipy_dijkstra"]
    lines = [f"SciPy Dijkstra   p50 {other['p50_ms']:.1f} ms, p99 {other['p99_ms']:.1f} ms"]
    told: dict[str, Callable[[Any], list[str]]] = {
        "table": _table_lines,
        "plan": _plan_lines,
        "time_optimality": time_optimality_lines,
        "first_motion_ms": first_motion_lines,
        "overrun_ms": overrun_lines,
        "stream": stream_lines,
        "moving_goal": moving_goal_lines,
        "boosted": boosted_lines,
        "scenes": scene_lines,
        "growth": _growth_lines,
    }
    for part, lines_of in told.items():
        lines += lines_of(figures[part]) if part in figures else []
    return lines


def _table_lines(table: Figures) -> list[str]:
    return [
        f"posture table    {table['entries']} entries in {table['build_s']:.2f} s; SLSQP "
        f"{1e3 * table['slsqp_s_per_entry']:.1f} ms an entry, {table['speedup_over_slsqp']:.0f} "
        f"times as long; smallest area over SLSQP's {table['worst_area_ratio']:.9f}"
    ]


def _plan_lines(figures: Figures) -> list[str]:
    plan, integrated = figures["table"], figures["integrated"]
    soon = integrated["soon"]
    return [
        f"plans (S2-S4)    p50 {plan['p50_ms']:.2f} ms, p99 {plan['p99_ms']:.2f} ms "
        f"(S2 {plan['s2_p99_ms']:.2f}, S3 {plan['s3_p99_ms']:.2f}, S4 {plan['s4_p99_ms']:.2f})",
        f"first plan       {plan['rebuild_ms']:.1f} ms after a change of payload or pressure",
        f"integrated plans p50 {integrated['p50_ms']:.1f} ms, p99 {integrated['p99_ms']:.1f} ms; "
        f"energy over the table planner's {integrated['energy_ratio_geomean']:.3f} (Cases 1-4, or "
        f"all moves where there are none), at worst {integrated['worst_energy_ratio']:.3f}, cost "
        f"at worst {integrated['worst_cost_ratio']:.3f}{_over_the_truth(integrated)}",
        f"  in {soon['deadline_ms']:.0f} ms      answered p50 {soon['p50_ms']:.1f} ms, p99 "
        f"{soon['p99_ms']:.1f} ms; {soon['not_found']} without a plan; energy over the table "
        f"planner's at worst {soon['worst_energy_ratio']:.3f}, cost at worst "
        f"{soon['worst_cost_ratio']:.3f}{_over_the_truth(soon)}",
    ]


def _over_the_truth(figures: Figures) -> str:
    if "ground_truth_ratio_mean" not in figures:
        return ""
    mean, worst = figures["ground_truth_ratio_mean"], figures["ground_truth_ratio_max"]
    return f"; over the ground truth {mean:.3f}, at worst {worst:.3f}"


def _growth_lines(rows: Sequence[Figures]) -> list[str]:
    return [
        "spacing [mm]   states     steps   table [s]   graph [s]   search p50, p99 [ms]   expanded",
        *(
            f"{1e3 * row['spacing_m']:12.4g} {row['states']:8d} {row['steps']:9d} "
            f"{row['build_s']:11.2f} {row['graph_s']:11.2f} {row['search_p50_ms']:13.2f} "
            f"{row['search_p99_ms']:8.2f} {row['expanded_p50']:10.0f}"
            for row in rows
        ),
    ]


def main() -> int:
    """Entry point of `scripts/bench planning`."""
    return command_line.run(planning, name="bench planning")


if __name__ == "__main__":
    sys.exit(main())
