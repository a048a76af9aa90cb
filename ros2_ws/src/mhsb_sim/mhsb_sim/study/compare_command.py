"""`compare`: the planners side by side on the paper's cases and on random moves, simulated."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.command_line import Count, JobCount, Within
from mhsb_model.files.output_folders import make_output_folder
from mhsb_model.machine import Machine, load_machine
from mhsb_model.types import FloatArray
from mhsb_planner.errors import RequestError
from mhsb_planner.evaluation.moves import case_moves, random_moves
from mhsb_planner.planner import PLANNER_KINDS, Planner, PlanOptions, warm_up
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_planner.result_files import write_json
from mhsb_planner.search.s2_search import Weights
from mhsb_planner.work_arguments import Scheduler, jobs_of
from mhsb_sim.simulation.kernel_parts import compile_simulator
from mhsb_sim.study.compare_figure import draw_proportions
from mhsb_sim.study.planner_comparison import (
    BASELINE,
    GROUND_TRUTH,
    Comparison,
    Ratios,
    Request,
    at_highest_pressure,
    compare_all,
    ratios,
)
from mhsb_sim.study.supply_comparison import as_markdown, by_case, totals
from mhsb_sim.study.supply_comparison import as_text as supplies_as_text

TRUTHS = 10
"""Of so many random moves the ground truth is sought unless it is told otherwise."""


def compare(
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/compare"),
    machine: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    weights: Annotated[
        tuple[float, float, float], tyro.conf.arg(metavar="W1 W2 W3"), Within(0.0, 1e6)
    ] = (
        0.5,
        0.0,
        2.0,
    ),
    moves: Count = 100,
    truths: Annotated[int | None, Within(0, 10**6)] = None,
    jobs: JobCount = None,
    scheduler: Scheduler = None,
    json_: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Plan the moves of Cases 1 to 4 and random ones by every planner, and simulate all of them.

    Arms that slew have random ones alone. Every motion follows its path, whichever planner found
    that. Beside it, what the same moves would take with other supplies: constant pressure, load
    sensing, pump control, by energy models (docs/supplies.md). Writes DIR/records.json (energies in
    J, times in s, errors in mm), DIR/summary.json, DIR/supplies.md and DIR/proportions.png.

    Args:
        output: Folder for records, summary and figure.
        machine: Machine file (YAML); the suite's own arm when left out.
        weights: Of energy [1/J], time [1/s] and mode switches.
        moves: Number of random moves between nodes of the grid.
        truths: Of so many of these the ground truth is sought, too, seconds each; of 10, or of all
            where there are fewer, when left out.
        jobs: Processes; as many as there are processors when left out.
        scheduler: Address of a Dask cluster that does it instead (docs/cluster.md).
        json_: Print summary.json instead of text.
    """
    if jobs is not None and jobs < 1:
        raise command_line.UsageError(f"--jobs: {jobs} is below 1")
    sought = min(TRUTHS, moves) if truths is None else truths
    if sought > moves:
        raise command_line.UsageError(
            f"--truths: {sought} is above the number of random moves, {moves}; give at most that, "
            "or more --moves"
        )
    try:
        chosen = PlanOptions(weights=Weights(*weights)).weights
    except RequestError as error:
        raise command_line.UsageError(f"--weights: {error}") from error
    workers = jobs_of(jobs, scheduler)
    make_output_folder(output, "the comparison")
    arm = load_machine(machine)
    asked = requests(arm, moves, sought)
    comparisons = compare_all(arm, chosen, asked, workers)
    found = list(tqdm(comparisons, total=len(asked), unit="move", disable=None))
    cases, others = found[: len(found) - moves], found[len(found) - moves :]
    summary = {"weights": weights, "cases": summarize(cases), "random moves": summarize(others)}
    supplies = {
        title: totals(arm, [each.motions for each in moves])
        for title, moves in (("cases", cases), ("random moves", others))
    }
    summary["supplies"] = supplies
    write_json(output / "records.json", [asdict(each) for each in found])
    write_json(output / "summary.json", summary)
    draw_proportions(cases, others, output / "proportions.png")
    (output / "supplies.md").write_text("\n".join(as_markdown(supplies)), encoding="utf-8")
    if json_:
        print((output / "summary.json").read_text(encoding="utf-8"))
        return
    print("\n".join(as_text(cases, summary)))
    if cases:  # arms that slew have none
        print("\n".join(by_case([c.name for c in cases], [c.motions for c in cases], arm)))
    for title, found_there in supplies.items():
        print("\n".join(supplies_as_text(title, found_there)))
    print(f"written to {output}")


def requests(machine: Machine, moves: int, truths: int) -> list[Request]:
    """The moves of the cases by name, then random ones by number."""
    planner = Planner(machine, table_for(machine))
    table_for(at_highest_pressure(machine))
    warm_up(planner)  # so that the processes find compiled kernels
    compile_simulator()
    cases = [Request(name, move, True) for name, move in case_moves(machine).items()]
    others = [
        Request(str(number), move, number <= truths)
        for number, move in enumerate(random_moves(planner, moves), start=1)
    ]
    return cases + others


def summarize(comparisons: Sequence[Comparison]) -> dict[str, Any]:
    """Each planner against the baseline: ratios as geometric mean and extremes."""
    summary: dict[str, Any] = {}
    for kind in (*PLANNER_KINDS, GROUND_TRUTH):
        if kind == BASELINE:
            continue
        found = ratios(comparisons, kind)
        if len(found.energy) > 0:
            summary[kind] = _ratio_numbers(found) | {
                "failures": {c.name: c.failures[kind] for c in comparisons if kind in c.failures}
            }
    truths = ratios(comparisons, "integrated", GROUND_TRUTH)
    if len(truths.energy) > 0:
        summary["integrated over ground truth"] = _ratio_numbers(truths)
    return summary


def _ratio_numbers(found: Ratios) -> dict[str, Any]:
    return {
        "moves": len(found.energy),
        "energy": _spread(found.energy),
        "energy_series": _spread(found.series),
        "energy_simulated": _spread(found.simulated),
        "simulated_over_planned_ratio": _spread(found.proportion),
        "duration": _spread(found.duration),
    }


def _spread(values: FloatArray) -> dict[str, float]:
    return {
        "geometric_mean": float(np.exp(np.mean(np.log(values)))),
        "least": float(values.min()),
        "largest": float(values.max()),
    }


def as_text(cases: Sequence[Comparison], summary: dict[str, Any]) -> list[str]:
    """The cases line by line, then the summaries."""
    head = (
        "case  planner       path   planned   series  simulated [J]  least [J]  time [s]  switches"
        "  largest step [rad]"
    )
    lines = [head] if cases else []
    for case in cases:
        for kind, r in case.records.items():
            lines.append(
                f"{case.name:5s} {kind:13s}{r.energy_path_j:6.0f}{r.energy_j:10.0f}"
                f"{r.energy_series_j:9.0f}{r.energy_simulated_j:11.0f}{r.lower_bound_j:15.0f}"
                f"{r.duration_s:10.1f}{r.switches:10d}{r.largest_step_rad:20.3f}"
            )
        lines += [f"{case.name:5s} {kind:13s} {why}" for kind, why in case.failures.items()]
    for title in ("cases", "random moves"):
        for kind, numbers in summary[title].items():
            over = "" if "over" in kind else f" over {BASELINE}"
            lines.append(f"{title}, {kind}{over} ({numbers['moves']} moves):")
            lines += [
                f"  {name:30s} {spread['geometric_mean']:.3f}  "
                f"({spread['least']:.3f} to {spread['largest']:.3f})"
                for name, spread in numbers.items()
                if name not in ("moves", "failures")
            ]
            if numbers.get("failures"):
                lines.append(f"  no plan for {len(numbers['failures'])} moves")
    return lines


def main() -> int:
    """Entry point of `ros2 run mhsb_sim compare`."""
    return command_line.run(compare, name="compare")


if __name__ == "__main__":
    sys.exit(main())
