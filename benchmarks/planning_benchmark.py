"""Benchmark of planning: the posture table, plans, first motions, and growth with the grid.

    scripts/bench planning

Times are medians of `RUNS` runs; those of whole integrated plans are single runs. Other work on the
computer is part of the times. Ratios are of times taken one after the other.
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
from benchmarks.deadline_benchmark import (
    first_motion_figures,
    first_motion_lines,
    overrun_figures,
    overrun_lines,
)
from benchmarks.integrated_benchmark import integrated_figures
from benchmarks.search_benchmark import (
    boosted_figures,
    boosted_lines,
    scene_figures,
    scene_lines,
)
from benchmarks.streaming_benchmark import (
    moving_goal_figures,
    moving_goal_lines,
    stream_figures,
    stream_lines,
)
from benchmarks.time_optimality import (
    time_optimality_figures,
    time_optimality_lines,
)
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.command_line import Count, JobCount, JsonFlag, NumberRange, OptionalFile, Seed
from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine, load_machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import MotionState
from mhsb_planner.cases.moves import Move, yield_random_moves
from mhsb_planner.motion.s4_mode_schedule import ScheduledMotion, StartModes
from mhsb_planner.planner import ENERGY_OPTIMAL, Planner, PlanOptions, warm_up
from mhsb_planner.posture import s1_judge, s1_slsqp
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.result_files import write_json
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_search import PathQuery, search
from mhsb_planner.search.s2_step import DURATION_COLUMN, ENERGY_PAPER_COLUMN

RUNS = 5
"""Number of runs of which medians are taken."""
SEED = 0
SPACINGS = (0.05, 0.025, 0.0125)
"""Grid spacings for which growth is measured [m]."""
MILLI = 1e3

Figures = dict[str, Any]
Result = TypeVar("Result")


ANY_MACHINE = ("table", "plan", "first_motion_ms", "overrun_ms", "stream")
PARTS = (*ANY_MACHINE, "moving_goal", "boosted", "scenes", "time_optimality", "growth")
"""Parts of the benchmark. Those that are not in `ANY_MACHINE` are for arms of three revolute
joints.
"""


@dataclass(frozen=True)
class BenchmarkSize:
    """Amounts of work in the benchmark.

    Attributes:
        moves: Number of random moves that are planned.
        first_motions: Number of these whose first motion is timed.
        deadlines: Number of these that are planned with a deadline in each condition.
        entries: Number of table entries that are compared with SLSQP.
        truths: Number of moves with ground truth.
        growth_moves: Number of searches for each grid spacing.
        spacings: Grid spacings [m].
        runs: Number of runs of which medians are taken.
        repeated: Number of moves to a goal that is sent repeatedly.
        lines: Number of lines on which a goal moves.
        boosted: Number of moves with ground truth on each machine that boosts much.
        scenes: Number of scenes with obstacles.
        collocations: Number of moves whose duration is compared with a collocation's.
        deadline: Deadline of quick plans [s].
        seed: Seed of the random moves.
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
    deadline: float = 0.045
    seed: int = SEED


def measure(
    machine: Machine,
    size: BenchmarkSize,
    jobs: int | None = None,
    parts: Sequence[str] = PARTS,
    keep: Callable[[Figures], object] | None = None,
) -> Figures:
    """Measure parts of the benchmark.

    Args:
        machine: The arm.
        size: Amounts of work.
        jobs: Number of threads; None takes one for each processor.
        parts: Keys of `PARTS`.
        keep: Called with all figures after each part, so that none is lost; None calls nothing.

    Returns:
        Figures by part, and the yardstick `scipy_dijkstra`, which is always measured.
    """
    figures: Figures = {}
    table = build_posture_table(machine, jobs=jobs)
    warm_up(Planner(machine, table))
    if "table" in parts:
        table, figures["table"] = _table_figures(machine, size, jobs)
    planner = Planner(machine, table)
    bar = tqdm(yield_random_moves(planner, size.moves, size.seed), "moves", size.moves, unit="move")
    moves = list(bar)
    figures["scipy_dijkstra"] = dijkstra_figures(planner.graph, moves, size.runs)
    yardstick = figures["scipy_dijkstra"]["p50_ms"]
    measured: dict[str, Callable[[], Any]] = {
        "plan": lambda: {
            "table": _plan_figures(planner, moves, size),
            "integrated": integrated_figures(planner, moves, size.truths, size.deadline),
        },
        "first_motion_ms": lambda: first_motion_figures(
            planner, moves[: size.first_motions], yardstick
        ),
        "overrun_ms": lambda: overrun_figures(planner, moves[: size.deadlines]),
        "stream": lambda: stream_figures(planner, moves[: size.repeated]),
        "moving_goal": lambda: moving_goal_figures(planner, size.lines),
        "boosted": lambda: boosted_figures(planner, size.boosted),
        "scenes": lambda: scene_figures(planner, size.scenes),
        "time_optimality": lambda: time_optimality_figures(planner, moves[: size.collocations]),
        "growth": lambda: [
            _growth_figures(machine, spacing, size, jobs) for spacing in size.spacings
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
    machine: Machine, effort: BenchmarkSize, jobs: int | None
) -> tuple[PostureTable, Figures]:
    """Measure the building of the posture table, and compare it with SLSQP on random entries.

    Args:
        machine: The arm.
        effort: Amounts of work.
        jobs: Number of threads.

    Returns:
        The table of the last build, and its figures: median build time [s], SLSQP's time for an
        entry [s], ratio of both times per entry, smallest ratio of areas to SLSQP's.
    """
    build_s, table = _timed(lambda: build_posture_table(machine, jobs=jobs), effort.runs)
    began = time.perf_counter()
    judgement = s1_judge.compare_with_slsqp(machine.planar_arm, table, effort.entries, SEED)
    per_start = (time.perf_counter() - began) / (effort.entries * s1_judge.SLSQP_STARTS)
    per_entry = s1_slsqp.DEFAULT_STARTS * per_start
    return table, {
        "entries": table.entries,
        "build_s": build_s,
        "slsqp_s_per_entry": per_entry,
        "speedup_over_slsqp": per_entry / (build_s / table.entries),
        "worst_area_ratio": judgement.worst_ratio,
    }


# --- Plans ---------------------------------------------------------------------------------------


def _plan_figures(planner: Planner, moves: list[Move], effort: BenchmarkSize) -> Figures:
    """Measure table plans: S2 to S4 together, each by itself, and a first plan after a change.

    Args:
        planner: The planner.
        moves: Random moves.
        effort: Amounts of work.

    Returns:
        Percentiles over the moves [ms], medians over the runs.
    """
    settled = StartModes.create_settled(np.full(planner.machine.joint_count, Mode.N))
    runs = []
    for _ in tqdm(range(effort.runs), desc="plans", unit="run"):
        times = np.empty((len(moves), 4))
        for row, move in zip(times, moves, strict=True):
            plan = planner.plan(
                move.goal, MotionState.at_rest(move.start), options=PlanOptions(planner="table")
            )
            began = time.perf_counter()
            _ = ScheduledMotion.create(planner.machine, plan.motion.trajectory, settled).schedule
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
    """Measure the first plan after a change of payload or supply pressure.

    The posture table is kept. The planner's machine is restored afterwards.

    Args:
        planner: The planner.
        moves: Random moves.
        runs: Number of changes of each kind.

    Returns:
        Median time of change and plan [ms].
    """
    base, times = planner.machine, []
    for run in range(1, runs + 1):
        changes = (
            base.changed(payload=base.arrays.payload * (1.0 - 0.01 * run)),
            base.changed(supply_pressure=base.arrays.supply_pressure * (1.0 + 0.01 * run)),
        )
        for machine in changes:
            move = moves[run % len(moves)]
            began = time.perf_counter()
            planner.change_machine(machine)
            planner.plan(
                move.goal, MotionState.at_rest(move.start), options=PlanOptions(planner="table")
            )
            times.append(time.perf_counter() - began)
    planner.change_machine(base)
    return MILLI * statistics.median(times)


# --- Comparison and growth -----------------------------------------------------------------------


def explicit_graph(graph: StepGraph) -> csr_array:
    """Return all states and steps as a sparse matrix for SciPy's searches.

    The cost has the energy-optimal weights. A step without cost gets the smallest positive number,
    since SciPy takes 0 as a missing edge. There are no parallel steps, because each state is
    entered in its own mode combination.

    Args:
        graph: The step graph.

    Returns:
        Costs from row to column, shape (states, states).
    """
    edges, patterns = graph.edges, len(graph.table.patterns)
    owner = graph.layout.posture_of_state.ravel()
    states = np.flatnonzero(owner >= 0)
    count = (edges.last - edges.first)[owner[states]]
    origin = np.repeat(states, count)
    within = np.arange(len(origin)) - np.repeat(np.cumsum(count) - count, count)
    edge = np.repeat(edges.first[owner[states]], count) + within
    weights = ENERGY_OPTIMAL
    cost = weights.energy * edges.cost[edge, ENERGY_PAPER_COLUMN]
    cost += weights.time * edges.cost[edge, DURATION_COLUMN]
    cost += weights.switches * graph.switches[origin % patterns, edges.pattern[edge]]
    shape = (len(owner), len(owner))
    return csr_array((np.maximum(cost, np.finfo(float).tiny), (origin, edges.state[edge])), shape)


def dijkstra_figures(graph: StepGraph, moves: list[Move], runs: int) -> Figures:
    """Time SciPy's Dijkstra from each start to all states; building its matrix does not count.

    Args:
        graph: The step graph.
        moves: Moves that start at nodes of the table.
        runs: Number of runs of which medians are taken.

    Returns:
        Median and 99th percentile over the moves [ms].
    """
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
    machine: Machine, spacing: float, effort: BenchmarkSize, jobs: int | None
) -> Figures:
    """Measure table, graph and search between random nodes for one grid spacing.

    Searches without a path are repeated with other nodes.

    Args:
        machine: The arm.
        spacing: Grid spacing [m].
        effort: Amounts of work.
        jobs: Number of threads.

    Returns:
        Counts of nodes, states and steps, times to build table and graph [s], expanded states, and
        percentiles of search times [ms].
    """
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
                graph, PathQuery(table.posture[here, 0], table.patterns[0], (x, z), ENERGY_OPTIMAL)
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
        "states": int(np.count_nonzero(graph.layout.posture_of_state >= 0)),
        "steps": len(graph.edges.state),
        "build_s": build_s,
        "graph_s": graph_s,
        "expanded_p50": float(np.median(expanded)),
        "search_p50_ms": float(np.percentile(times, 50)),
        "search_p99_ms": float(np.percentile(times, 99)),
    }


def _timed(work: Callable[[], Result], runs: int) -> tuple[float, Result]:
    """Time several calls of a function.

    Args:
        work: Function to call.
        runs: Number of calls, at least 1.

    Returns:
        Median time [s], and the result of the last call.
    """
    times = []
    for _ in range(runs):
        began = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - began)
    return statistics.median(times), result


# --- Command -------------------------------------------------------------------------------------


def planning(
    output: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("out/bench/planning.json"),
    machine: OptionalFile = None,
    jobs: Annotated[JobCount, tyro.conf.arg(metavar="N")] = None,
    boosted: Annotated[Count, tyro.conf.arg(metavar="N")] = BenchmarkSize.boosted,
    scenes: Annotated[Count, tyro.conf.arg(metavar="N")] = BenchmarkSize.scenes,
    collocations: Annotated[Count, tyro.conf.arg(metavar="N")] = BenchmarkSize.collocations,
    moves: Annotated[Count, tyro.conf.arg(metavar="N")] = BenchmarkSize.moves,
    truths: Annotated[Count, tyro.conf.arg(metavar="N")] = BenchmarkSize.truths,
    within: Annotated[
        float, tyro.conf.arg(metavar="S"), NumberRange(1e-4, 1e4)
    ] = BenchmarkSize.deadline,
    seed: Annotated[Seed, tyro.conf.arg(metavar="N")] = BenchmarkSize.seed,
    parts: Annotated[list[str] | None, tyro.conf.arg(metavar="PART")] = None,
    json_: JsonFlag = False,
) -> None:
    """Measure planning, print a table and write the figures as JSON.

    Args:
        output: JSON file to write.
        machine: Machine file (YAML); the suite's own arm when left out.
        jobs: Number of threads; one for each processor when left out.
        boosted: Moves with ground truth on each of three machines that boost much, 10 to 40 s each.
        scenes: Random scenes with obstacles.
        collocations: Number of moves whose duration is compared with an offline collocation's.
        moves: Random moves that are planned.
        truths: Number of these with ground truth, some 10 s each; 20 s with four joints.
        within: Deadline of quick plans [s].
        seed: Seed of the random moves.
        parts: Keys of the JSON file that are measured. When left out, all that the machine allows.
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
    effort = BenchmarkSize(
        moves=moves,
        truths=truths,
        boosted=boosted,
        scenes=scenes,
        collocations=collocations,
        deadline=within,
        seed=seed,
    )
    figures = measure(arm, effort, jobs, parts or possible, partial(_save_figures, output))
    if json_:
        print(output.read_text(encoding="utf-8"))
        return
    print("\n".join(as_text(figures)))
    print(f"written to {output}")


def _save_figures(output: Path, figures: Figures) -> None:
    """Write the figures measured so far, and say so if the command is interrupted."""
    write_json(output, figures)
    command_line.set_interrupt_note(f"{output} has what was measured, up to '{list(figures)[-1]}'")


def as_text(figures: Figures) -> list[str]:
    """Format the measured parts as a table.

    Args:
        figures: Result of `measure`.

    Returns:
        Lines of text; parts that were not measured are left out.
    """
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
    """Format the figures of the posture table."""
    return [
        f"posture table    {table['entries']} entries in {table['build_s']:.2f} s; SLSQP "
        f"{1e3 * table['slsqp_s_per_entry']:.1f} ms an entry, {table['speedup_over_slsqp']:.0f} "
        f"times as long; smallest area over SLSQP's {table['worst_area_ratio']:.9f}"
    ]


def _plan_lines(figures: Figures) -> list[str]:
    """Format the figures of table plans and integrated plans.

    Args:
        figures: Figures of the part `plan`.

    Returns:
        Lines of text.
    """
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
    """Format mean and worst ratio to the ground truth.

    Args:
        figures: Figures of integrated plans.

    Returns:
        A clause that begins with a semicolon; empty if the ratios were not measured.
    """
    if "ground_truth_ratio_mean" not in figures:
        return ""
    mean, worst = figures["ground_truth_ratio_mean"], figures["ground_truth_ratio_max"]
    return f"; over the ground truth {mean:.3f}, at worst {worst:.3f}"


def _growth_lines(rows: Sequence[Figures]) -> list[str]:
    """Format the figures of all grid spacings as a table."""
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
