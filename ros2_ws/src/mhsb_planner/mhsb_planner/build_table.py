"""`build_table`: computes the posture table of a machine and stores it."""

from __future__ import annotations

import json as json_format
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.command_line import Count, JobCount, Within
from mhsb_model.machine import Machine, load_machine
from mhsb_planner.posture import s1_global_search, s1_slsqp
from mhsb_planner.posture.grid import grid_nodes
from mhsb_planner.posture.posture_table_cache import cached_table_path
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.posture.s1_judge import Judgement, judged
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.work_arguments import Scheduler, jobs_of

SOLVERS = {"global": s1_global_search.search_globally, "slsqp": s1_slsqp.search_by_slsqp}


def build_table(
    machine: Path | None = None,
    output: Path | None = None,
    solver: Literal["global", "slsqp"] = "global",
    spacing: Annotated[float | None, Within(-100.0, 100.0)] = None,
    jobs: JobCount = None,
    scheduler: Scheduler = None,
    judge: Annotated[Count, tyro.conf.arg(metavar="N")] = 0,
    json: bool = False,
) -> None:
    """Compute the posture table: for every node of the grid and every mode pattern the posture of
    largest end-effector velocity polytope.

    Args:
        machine: Machine file (YAML, SI units); the suite's own arm when left out.
        output: File to write (npz); the user's cache, where the planner looks, when left out.
        solver: How the largest polytope is found: global searches all postures, slsqp is the
            paper's sequential quadratic programming from random starts, for comparison.
        spacing: Distance of the grid's nodes [m]; the machine file's when left out.
        jobs: Number of threads; one for each processor when left out.
        scheduler: Address of a Dask cluster that does it instead (docs/cluster.md).
        judge: So many random entries are compared with the paper's solver from 30 random starts,
            which takes about 0.1 s each, and what share of all may be short is told; 0: none.
        json: Print the result as JSON.
    """
    arm = load_machine(machine).plane
    spacing = arm.spacing if spacing is None else spacing
    total = len(grid_nodes(arm, spacing))
    workers = jobs_of(jobs, scheduler)
    s1_global_search.warm_up(arm)
    began = time.perf_counter()
    with tqdm(total=total, unit="node", desc="posture table") as bar:
        table = build_posture_table(
            arm,
            spacing,
            workers,
            progress=lambda done, _: bar.update(done - bar.n),
            solver=SOLVERS[solver],
        )
    seconds = time.perf_counter() - began
    path = output or cached_table_path(arm, spacing, solver)
    table.save(path)
    judgement = _judged(arm, table, judge) if judge else None
    if json:
        print(json_format.dumps(_facts(table, path, solver, seconds, judgement)))
        return
    print(_text(table, path, seconds))
    if judgement is not None:
        print(judgement.sentence)


def _judged(arm: Machine, table: PostureTable, entries: int) -> Judgement:
    with tqdm(total=entries, unit="entry", desc="judged by SLSQP") as bar:
        return judged(arm, table, entries, progress=lambda done: bar.update(done - bar.n))


def _facts(
    table: PostureTable, path: Path, solver: str, seconds: float, judgement: Judgement | None
) -> dict[str, object]:
    infeasible = table.nodes[~table.feasible] * table.spacing
    return {
        "machine": table.machine_name,
        "machine_hash": table.machine_hash,
        "output": str(path),
        "solver": solver,
        "spacing_m": table.spacing,
        "nodes": len(table.nodes),
        "patterns": len(table.patterns),
        "entries": table.entries,
        "infeasible_nodes_m": np.round(infeasible, 9).tolist(),
        "seconds": seconds,
        "judgement": judgement and {**asdict(judgement), "most_short": judgement.most_short},
    }


def _text(table: PostureTable, path: Path, seconds: float) -> str:
    missing = table.nodes[~table.feasible] * table.spacing
    lines = [
        f"{table.machine_name}: {len(table.nodes)} nodes, {len(table.patterns)} mode patterns, "
        f"{table.entries} entries in {seconds:.2f} s",
        f"{len(missing)} nodes have no posture within the joint limits"
        + (", at (x, z) m:" if len(missing) else ""),
    ]
    for x in np.unique(missing[:, 0]):
        heights = ", ".join(f"{z:.4g}" for z in missing[missing[:, 0] == x, 1])
        lines.append(f"  x = {x:.4g}: z = {heights}")
    return "\n".join([*lines, f"written to {path}"])


def main() -> int:
    """Entry point of `ros2 run mhsb_planner build_table`."""
    return command_line.run(build_table)


if __name__ == "__main__":
    sys.exit(main())
