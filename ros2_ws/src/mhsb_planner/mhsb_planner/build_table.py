"""Command `build_table`, which computes the posture table of a machine and stores it."""

import json as json_format
import math
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.command_line import Count, NumberRange
from mhsb_model.machine import Machine, load_machine
from mhsb_planner.cluster import WorkArguments
from mhsb_planner.errors import place_text
from mhsb_planner.posture import s1_global_search, s1_slsqp
from mhsb_planner.posture.grid import list_grid_nodes
from mhsb_planner.posture.posture_table_cache import cached_table_path
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.posture.s1_judge import TableComparison, compare_with_slsqp
from mhsb_planner.posture.s1_posture_table import PostureTable

SOLVER_FUNCTIONS = {"global": s1_global_search.search_globally, "slsqp": s1_slsqp.search_by_slsqp}
"""Solvers by the names that the command accepts."""

SHOWN_NODES = 3
"""Largest number of nodes without a posture whose positions are printed."""


@dataclass(frozen=True)
class TableArguments:
    """Options for the content of a posture table.

    Attributes:
        solver: Solver for the largest polytope. global searches all postures; slsqp is the paper's
            sequential quadratic programming from random starts, for comparison.
        spacing: Distance of the grid's nodes, above 0 [m]; the machine file's if left out.
    """

    solver: Literal["global", "slsqp"] = "global"
    spacing: Annotated[float | None, NumberRange(-100.0, 100.0)] = None


def build_table(
    *,
    machine: Path | None = None,
    output: Path | None = None,
    table: TableArguments,
    work: WorkArguments,
    judge: Annotated[Count, tyro.conf.arg(metavar="N")] = 0,
    json: bool = False,
) -> None:
    """Compute the posture table of a machine and store it.

    For every node of the grid and every mode combination, the table contains the posture with the
    largest velocity polytope of the tip.

    Args:
        machine: Machine file (YAML, SI units); the suite's own arm if left out.
        output: File to write (npz); if left out, the file in the user's cache that the planner
            reads.
        table: Solver and grid of the table.
        work: Number of processes, or the Dask cluster, that computes.
        judge: Number of random entries to compare with the paper's solver from 30 random starts, at
            about 0.1 s each; 0 compares none. An entry is short if the area of its polytope is more
            than 0.1 % smaller than the solver's. The command then states an upper bound on the
            share of short entries in the whole table.
        json: Print the result as JSON.
    """
    arm = load_machine(machine).planar_arm
    spacing = arm.spacing if table.spacing is None else table.spacing
    total = len(list_grid_nodes(arm, spacing))
    workers = work.connect()
    s1_global_search.warm_up(arm)
    began = time.perf_counter()
    with tqdm(total=total, unit="node", desc="posture table") as bar:
        built = build_posture_table(
            arm,
            spacing,
            workers,
            progress=lambda done, _: bar.update(done - bar.n),
            solver=SOLVER_FUNCTIONS[table.solver],
        )
    seconds = time.perf_counter() - began
    path = output or cached_table_path(arm, spacing, table.solver)
    built.save(path)
    judgement = _compare_with_progress(arm, built, judge) if judge else None
    if json:
        print(json_format.dumps(_collect_result(built, path, table.solver, seconds, judgement)))
        return
    print(_describe_result(built, path, seconds))
    if judgement is not None:
        print(judgement.sentence)


def _compare_with_progress(arm: Machine, table: PostureTable, entries: int) -> TableComparison:
    """Compare random entries of a posture table with the solver SLSQP, with a progress bar.

    Args:
        arm: The arm without a slewing joint.
        table: The posture table.
        entries: Number of entries to compare.

    Returns:
        Number of entries compared, number of short entries, and least ratio of an entry's area to
        SLSQP's area. An entry is short if its area is more than 0.1 % smaller.
    """
    with tqdm(total=entries, unit="entry", desc="judged by SLSQP") as bar:
        return compare_with_slsqp(
            arm, table, entries, progress=lambda done: bar.update(done - bar.n)
        )


def _collect_result(
    table: PostureTable, path: Path, solver: str, seconds: float, judgement: TableComparison | None
) -> dict[str, object]:
    """Collect the result of the command for its JSON output.

    Args:
        table: The table.
        path: File that was written.
        solver: Name of the solver.
        seconds: Time that building took [s].
        judgement: Comparison with SLSQP; None if there was none.

    Returns:
        Values by key: name and hash of the machine, output file, solver, grid spacing [m], numbers
        of nodes, mode combinations and entries, positions (x, z) of nodes without a posture [m],
        time [s], and the comparison or None.
    """
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
        "judgement": judgement and {**asdict(judgement), "most_short": judgement.short_share_bound},
    }


def _describe_result(table: PostureTable, path: Path, seconds: float) -> str:
    """Describe the table as text, with the number of nodes that have no posture.

    Args:
        table: The table.
        path: File that was written.
        seconds: Time that building took [s].

    Returns:
        Lines of text. The first line has the numbers of nodes, mode combinations and entries, and
        the time. The second line has the number of nodes without a posture, and the positions of at
        most SHOWN_NODES of them. The last line has the path of the file.
    """
    missing = table.nodes[~table.feasible] * table.spacing
    shown = missing[:: max(1, math.ceil(len(missing) / SHOWN_NODES))]
    lines = [
        f"{table.machine_name}: {len(table.nodes)} nodes, {len(table.patterns)} mode patterns, "
        f"{table.entries} entries in {seconds:.2f} s",
        f"{len(missing)} nodes have no posture within the joint limits"
        + (f", such as {', '.join(place_text(node) for node in shown)}" if len(missing) else ""),
        f"written to {path}",
    ]
    return "\n".join(lines)


def main() -> int:
    """Run the command (entry point of `ros2 run mhsb_planner build_table`).

    Returns:
        The exit code.
    """
    return command_line.run(build_table)


if __name__ == "__main__":
    sys.exit(main())
