"""`compare`: plan the paper's cases and random moves by every planner, and simulate them."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tqdm import tqdm

from mhsb_control import load_machine
from mhsb_model import command_line
from mhsb_model.command_line import Count, JsonFlag, NumberRange, OptionalFile
from mhsb_model.figure_style import BLACK, GREEN, GREY, PURPLE, open_figure
from mhsb_model.files.output_folders import make_output_folder
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.cases.moves import list_case_moves, list_distinct_cases, yield_random_moves
from mhsb_planner.cluster import WorkArguments
from mhsb_planner.errors import RequestError
from mhsb_planner.planner import PLANNER_KINDS, Planner, PlanOptions
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.result_files import write_json
from mhsb_planner.search.s2_search import Weights
from mhsb_tools.comparison.planner_comparison import (
    BASELINE_PLANNER,
    GROUND_TRUTH,
    ComparedMove,
    Comparison,
    compare_all,
    compute_ratios,
    raise_supply_pressure,
)
from mhsb_tools.comparison.supply_comparison import (
    as_markdown,
    format_energy_by_move,
    sum_supply_energies,
)
from mhsb_tools.machine_arguments import OptionalPayload, change_machine
from mhsb_tools.study.headless import compile_kernels

DEFAULT_TRUTHS = 10
"""Number of random moves for which the ground truth is searched by default."""


def compare(
    *,
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/compare"),
    machine: OptionalFile = None,
    payload: OptionalPayload = None,
    weights: Annotated[
        tuple[float, float, float], tyro.conf.arg(metavar="W1 W2 W3"), NumberRange(0.0, 1e6)
    ] = (0.5, 0.0, 2.0),
    moves: Count = 100,
    truths: Annotated[int | None, NumberRange(0, 10**6)] = None,
    work: WorkArguments,
    json_: JsonFlag = False,
) -> None:
    """Plan the moves of Cases 1 to 4 and random ones by every planner, and simulate all of them.

    Cases that the arm cannot reach are left out; arms that slew have random moves only. Motions of
    all planners are made by the same method: they follow their paths with ramps. Energy models give
    what the same moves would take with other supplies: constant pressure, load sensing, pump
    control (docs/studies.md). Writes DIR/records.json (energies in J, times in s, errors in mm),
    DIR/summary.json, DIR/supplies.md and DIR/proportions.png.

    Args:
        output: Folder for records, summary and figure.
        machine: Machine file (YAML); the suite's own arm when left out.
        payload: Mass at the tip [kg]; the machine file's when left out.
        weights: Weights of energy [1/J], time [1/s] and mode switches.
        moves: Number of random moves between nodes of the posture table's grid.
        truths: Number of random moves for which the ground truth (the cheapest path of a long
            search) is searched, too; each takes seconds. When left out, 10, or all moves if there
            are fewer.
        work: Processes or computers that do the work.
        json_: Print summary.json instead of text.

    Raises:
        UsageError: `truths` is above `moves`, or the weights cannot be used.
        MhsbError: The machine file, the output folder or the cluster cannot be used.
    """
    sought = min(DEFAULT_TRUTHS, moves) if truths is None else truths
    if sought > moves:
        raise command_line.UsageError(
            f"--truths: {sought} is above the number of random moves, {moves}; give at most that, "
            "or more --moves"
        )
    try:
        chosen = PlanOptions(weights=Weights(*weights)).weights
    except RequestError as error:
        raise command_line.UsageError(f"--weights: {error}") from error
    workers = work.connect()
    make_output_folder(output, "the comparison")
    arm = change_machine(load_machine(machine), payload=payload)
    asked = list_compared_moves(arm, moves, sought)
    comparisons = compare_all(arm, chosen, asked, workers)
    found = list(tqdm(comparisons, total=len(asked), unit="move", disable=None))
    cases, others = found[: len(found) - moves], found[len(found) - moves :]
    supplies = {
        title: sum_supply_energies(arm, [each.motions for each in compared])
        for title, compared in (("cases", cases), ("random moves", others))
    }
    summary = {
        "weights": weights,
        "unreachable_cases": list_unreachable_cases(arm, asked),
        "cases": summarize(cases),
        "random moves": summarize(others),
        "supplies": supplies,
    }
    write_json(output / "records.json", [asdict(each) for each in found])
    write_json(output / "summary.json", summary)
    draw_proportions(cases, others, output / "proportions.png")
    (output / "supplies.md").write_text("\n".join(as_markdown(supplies)), encoding="utf-8")
    if json_:
        print((output / "summary.json").read_text(encoding="utf-8"), end="")
        return
    print("\n".join(as_text(cases, summary)))
    if cases:
        names, motions = [each.name for each in cases], [each.motions for each in cases]
        print("\n".join(format_energy_by_move(names, motions, arm)))
    print("\n".join(as_markdown(supplies)))
    print(f"( ): moves in which a supply takes less than MHSB\nwritten to {output}")


def list_compared_moves(machine: Machine, moves: int, truths: int) -> list[ComparedMove]:
    """List the moves to compare: the moves of the paper's cases, then random moves.

    Compiles the kernels of planner and simulator, and builds the posture tables if they are not
    cached. Worker processes then find all of them in the caches.

    Args:
        machine: The arm. Cases that it cannot reach are left out; if it slews, there are none.
        moves: Number of random moves.
        truths: Number of random moves for which the ground truth (the cheapest path by a long
            offline search) is searched as well: the first ones. It is searched for every case.

    Returns:
        The moves. Cases have their own names, random moves are named `1`, `2` and so on.

    Raises:
        MhsbError: The highest boost pressure is not allowed as supply pressure, or a posture table
            has no posture.
    """
    compile_kernels()
    planner = Planner(machine, load_or_build_table(machine))
    load_or_build_table(raise_supply_pressure(machine))
    cases = [ComparedMove(name, move, True) for name, move in list_case_moves(machine).items()]
    others = [
        ComparedMove(str(number), move, number <= truths)
        for number, move in enumerate(yield_random_moves(planner, moves), start=1)
    ]
    return cases + others


def list_unreachable_cases(machine: Machine, asked: Sequence[ComparedMove]) -> list[str]:
    """List the names of the paper's cases that the arm cannot reach; none if joint 1 slews.

    Args:
        machine: The arm.
        asked: Moves of the comparison, as `list_compared_moves` returns them.
    """
    names = {each.name for each in asked}
    return [] if machine.slews else [name for name in list_distinct_cases() if name not in names]


def summarize(comparisons: Sequence[Comparison]) -> dict[str, Any]:
    """Summarize how each planner compares with the baseline planner (`table`).

    Args:
        comparisons: Results of all planners for each move.

    Returns:
        A dictionary by name of the planner; the ground truth (path of a long offline search) counts
        as a planner. Each entry has the key `moves` and statistics of the ratios planner /
        baseline, as `_ratio_numbers` returns them. The key `failures` has a sentence for each move
        that the planner did not plan, by name of the move. The entry `integrated over ground truth`
        has the ratios of these two, without failures. An entry is left out if no move was planned
        by both.
    """
    summary: dict[str, Any] = {}
    for kind in (*PLANNER_KINDS, GROUND_TRUTH):
        if kind == BASELINE_PLANNER:
            continue
        found = compute_ratios(comparisons, kind)
        if len(found["energy"]) > 0:
            summary[kind] = _ratio_numbers(found) | {
                "failures": {c.name: c.failures[kind] for c in comparisons if kind in c.failures}
            }
    truths = compute_ratios(comparisons, "integrated", GROUND_TRUTH)
    if len(truths["energy"]) > 0:
        summary["integrated over ground truth"] = _ratio_numbers(truths)
    return summary


def _ratio_numbers(found: dict[str, FloatArray]) -> dict[str, Any]:
    """Return the number of moves, and mean and extremes of each ratio.

    Args:
        found: Ratios of two planners as `compute_ratios` returns them, for at least one move.

    Returns:
        A dictionary. `moves` is the count. Each key of `found` has a dictionary with
        `geometric_mean`, `least` and `largest`.
    """
    spreads = {
        name: {
            "geometric_mean": float(np.exp(np.mean(np.log(values)))),
            "least": float(values.min()),
            "largest": float(values.max()),
        }
        for name, values in found.items()
    }
    return {"moves": len(found["energy"]), **spreads}


def as_text(cases: Sequence[Comparison], summary: dict[str, Any]) -> list[str]:
    """Format the results of a comparison as text.

    Args:
        cases: Results for the paper's cases that the arm can reach.
        summary: Dictionary whose keys `cases` and `random moves` have the results of `summarize`.
            Its key `unreachable_cases` has the names of the cases that the arm cannot reach.

    Returns:
        Lines without line breaks. Cases that the arm cannot reach have one line. If there are other
        cases, a line has the column titles. A line for each case and planner follows. It has
        energies [J], duration [s], mode switches and largest change of a joint in one step [rad].
        If there is no plan, it has the reason instead. The last lines have each planner's ratios to
        the baseline planner (geometric mean, least and largest), separately for cases and random
        moves.
    """
    head = (
        "case  planner       path   planned   series  simulated [J]  least [J]  time [s]  switches"
        "  largest step [rad]"
    )
    left_out = ", ".join(summary["unreachable_cases"])
    lines = [f"left out, as the arm cannot reach them: cases {left_out}"] if left_out else []
    lines += [head] if cases else []
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
            over = "" if "over" in kind else f" over {BASELINE_PLANNER}"
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


def draw_proportions(cases: Sequence[Comparison], others: Sequence[Comparison], path: Path) -> None:
    """Draw simulated against planned energy ratio, one point for each move, as PNG.

    Each ratio is the energy of the integrated planner's motion divided by the energy of the
    baseline planner's motion. Planned energies price boosted oil as `series` (servo pump in series
    with the main pump). The diagonal marks equal ratios, and a shaded band marks ratios that differ
    by at most AGREEMENT_SHARE. Moves that one of the two planners did not plan have no point.

    Args:
        cases: Results for the paper's cases, possibly none.
        others: Results for the random moves.
        path: PNG file to write.
    """
    with open_figure(path, 5.0, 5.5) as figure:
        axes = figure.subplots()
        ends = (0.0, 1.1)
        axes.fill_between(
            ends,
            [(1.0 - AGREEMENT_SHARE) * end for end in ends],
            [(1.0 + AGREEMENT_SHARE) * end for end in ends],
            color=GREY,
            alpha=0.2,
            linewidth=0.0,
            label=f"within {100 * AGREEMENT_SHARE:.0f} %",
        )
        axes.plot(ends, ends, color=BLACK, linewidth=0.8)
        for moves, color, label in (
            (others, GREEN, "random moves"),
            (cases, PURPLE, "Cases 1 to 4"),
        ):
            found = compute_ratios(moves, "integrated")
            planned, simulated = found["energy_series"], found["energy_simulated"]
            if len(planned) > 0:
                axes.scatter(planned, simulated, s=12, color=color, label=label)
        axes.set(
            xlabel=f"planned energy over the {BASELINE_PLANNER} planner's (pumps in series)",
            ylabel="the same, simulated",
            aspect="equal",
        )
        axes.legend()


main = command_line.make_main(compare)

AGREEMENT_SHARE = 0.1
"""Half width of the shaded band: simulated ratios within this share of the planned ones."""
