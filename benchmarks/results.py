"""Measure what docs/results.md shows, and write that page.

    python benchmarks/results.py

Nothing is measured here that another benchmark does not measure, too: the planners and the supplies
come from `mhsb compare`, planning times from `scripts/bench planning`, tracking errors from
`mhsb study --benchmark`, and the fates of goals from `scripts/bench online`.
"""

# ruff: noqa: E402  # imports of the repository need its root on the path
from __future__ import annotations

import json
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks import online_benchmark, planning_benchmark
from benchmarks.integrated_benchmark import TABLE
from tqdm import tqdm

from mhsb_control import load_machine
from mhsb_model import command_line
from mhsb_model.command_line import Count
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState
from mhsb_planner.cases.moves import Move
from mhsb_planner.planner import ENERGY_OPTIMAL, PLANNER_KINDS, Planner
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.result_files import write_json
from mhsb_tools.commands.demo_command import GOALS_FILE, read_goals
from mhsb_tools.comparison.compare_command import list_compared_moves
from mhsb_tools.comparison.planner_comparison import ComparedMove, Comparison, compare_all
from mhsb_tools.comparison.supply_comparison import as_markdown, sum_supply_energies
from mhsb_tools.study import mismatch_benchmark
from mhsb_tools.study.study_command import study_benchmark

Figures = dict[str, Any]

SUMMED = ("energy_j", "energy_simulated_j", "lower_bound_j", "duration_s", "switches")
"""Fields of `PlannerResult` that are summed over moves."""


# --- Energy of planners and supplies -------------------------------------------------------------


def demo_moves(machine: Machine) -> list[ComparedMove]:
    """Return the moves from each goal of the demo to the next one, each from rest.

    Args:
        machine: The arm; the first move begins in its start posture.

    Returns:
        The moves. Each begins in the posture in which the table planner's motion before ends, as
        random moves begin in postures of the table.
    """
    planner = Planner(machine, load_or_build_table(machine))
    posture = np.array(machine.config.simulation.start_posture)
    moves: list[ComparedMove] = []
    for goal in read_goals(find_config_file(GOALS_FILE)):
        moves.append(ComparedMove(f"demo {len(moves) + 1}", Move(posture, goal.position), False))
        plan = planner.plan(goal.position, MotionState.at_rest(posture), options=TABLE)
        posture = plan.motion.trajectory.position[-1]
    return moves


def energy_figures(machine: Machine, comparisons: Sequence[Comparison]) -> Figures:
    """Sum energies and durations of all planners, and the energies of all supplies.

    Args:
        machine: The arm.
        comparisons: Compared moves; a move that some planner cannot do counts for none.

    Returns:
        `moves` (count), `planners` with sums [J, s] and the geometric mean `ratio` of the simulated
        energy over the table planner's, and `supplies` of `sum_supply_energies`.
    """
    done = [each for each in comparisons if set(PLANNER_KINDS) <= set(each.records)]
    base = np.array([each.records["table"].energy_simulated_j for each in done])
    planners = {}
    for kind in PLANNER_KINDS:
        rows = [asdict(each.records[kind]) for each in done]
        planners[kind] = {name: sum(row[name] for row in rows) for name in SUMMED}
        ratios = np.array([row["energy_simulated_j"] for row in rows]) / base
        planners[kind]["ratio"] = float(np.exp(np.log(ratios).mean()))
    supplies = sum_supply_energies(machine, [each.motions for each in comparisons])
    return {"moves": len(done), "planners": planners, "supplies": supplies}


def energy_lines(title: str, figures: Figures) -> list[str]:
    """Format the energies of all planners for one set of moves as a Markdown table."""
    head = ("simulated [kJ]", "planned [kJ]", "duration [s]", "mode switches")
    rows = {
        f"`{kind}`": (
            f"{each['energy_simulated_j'] / 1e3:.2f}",
            f"{each['energy_j'] / 1e3:.2f}",
            f"{each['duration_s']:.0f}",
            each["switches"],
            f"{each['ratio']:.3f}",
        )
        for kind, each in figures["planners"].items()
    }
    bound = f"{figures['planners']['integrated']['lower_bound_j'] / 1e3:.2f}"
    rows["lower bound of any plan"] = ("–", bound, "–", "–", "–")
    return table(f"{title}, {figures['moves']} moves", (*head, "simulated, over `table`"), rows)


# --- Planning time -------------------------------------------------------------------------------


def time_lines(figures: Figures) -> list[str]:
    """Format planning times beside SciPy's Dijkstra as a Markdown table."""
    plans = figures["plan"]
    soon = plans["integrated"]["soon"]
    measured = {
        "SciPy's Dijkstra over the table planner's states": figures["scipy_dijkstra"],
        "`table`, whole plan (S2 to S4)": plans["table"],
        "`integrated`, whole plan, no deadline": plans["integrated"],
        f"`integrated`, deadline of {soon['deadline_ms']:.0f} ms": soon,
    }
    rows = {
        name: (f"{each['p50_ms']:.1f}", f"{each['p99_ms']:.1f}") for name, each in measured.items()
    }
    return [
        *table("", ("median [ms]", "99 of 100 within [ms]"), rows),
        f"Moves without a plan at the deadline: {soon['not_found']}.",
    ]


# --- Fates of goals ------------------------------------------------------------------------------


def online_lines(figures: Figures) -> list[str]:
    """Format the fates of goals as a Markdown table."""
    lead, jump = figures["lead_ms"], figures["reference_jump_max_rad"]
    counts = ("goals", "applied", "superseded", "lost")
    head = (*counts[1:], "commit horizon, median, p99 [ms]", "largest jump of the reference [rad]")
    cells = (f"{lead['p50']:.0f}, {lead['p99']:.0f}", f"{jump:.1e}")
    row = (*(figures[name] for name in counts[1:]), *cells)
    return table("goals", head, {str(figures["goals"]): row})


# --- Page ----------------------------------------------------------------------------------------


def table(corner: str, head: Sequence[str], rows: Mapping[str, Sequence[object]]) -> list[str]:
    """Return the lines of a Markdown table, with an empty line behind it."""
    return [
        f"| {corner} | {' | '.join(head)} |",
        "|---" * (1 + len(head)) + "|",
        *(f"| {name} | {' | '.join(map(str, cells))} |" for name, cells in rows.items()),
        "",
    ]


def conditions() -> dict[str, str]:
    """Return date, commit, computer, load and command of the measurement."""
    git = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    load = os.getloadavg()
    busy = ", beside other work" if max(load) > 1.0 else ""
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "commit": subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip(),
        "computer": f"{os.cpu_count()} processors, {platform.system()} {platform.machine()}, "
        f"Python {platform.python_version()}, NumPy {np.__version__}",
        "load at the start": " ".join(f"{each:.1f}" for each in load) + busy,
        "command": f"`python benchmarks/results.py {shlex.join(sys.argv[1:])}".rstrip() + "`",
    }


def summary_lines(figures: Figures) -> list[str]:
    """Return the table of the main figures, each beside its baselines."""
    planners, supplies = (figures["random"][key] for key in ("planners", "supplies"))
    times, tracking = figures["planning"], figures["tracking"]["exact"]
    planned = {k: f"{v['energy_simulated_j'] / 1e3:.1f}" for k, v in planners.items()}
    oil = {k: f"{v['leaking']['hydraulic_j'] / 1e3:.1f}" for k, v in supplies["systems"].items()}
    soon = times["plan"]["integrated"]["soon"]
    error = {k: "{:.2f} mm, {:.2f} mm".format(*v["RMS [mm]"][::2]) for k, v in tracking.items()}
    moves = f"{figures['random']['moves']} random moves"
    rows: dict[str, Sequence[object]] = {
        f"energy of {moves}, simulated": (
            f"`integrated` {planned['integrated']} kJ",
            f"`table` (the paper's postures) {planned['table']} kJ, "
            f"`fixed` (joint 3 kept) {planned['fixed']} kJ",
        ),
        "energy to the oil, the same moves": (
            f"booster {oil['MHSB']} kJ",
            f"constant pressure {oil['constant pressure']} kJ, ideal load sensing "
            f"{oil['load sensing, 1 MPa']} kJ (Δp 1 MPa), {oil['load sensing, 2 MPa']} kJ (2 MPa)",
        ),
        f"time of a plan, deadline {soon['deadline_ms']:.0f} ms": (
            f"median {soon['p50_ms']:.0f} ms, p99 {soon['p99_ms']:.0f} ms",
            f"SciPy's Dijkstra, path only {times['scipy_dijkstra']['p50_ms']:.1f} ms",
        ),
        "tip error RMS: median, worst sequence": (
            f"`coordinated` {error['coordinated']}",
            f"`independent` (the paper's) {error['independent']}",
        ),
    }
    if "online" in figures:
        goals = "{lost} of {goals}".format(**figures["online"])
        rows["goals lost, sent in motion over topics"] = (goals, "–")
    return table("", ("MHSB", "baseline"), rows)


def page(figures: Figures) -> str:
    """Return the page of results."""
    sets = {title: figures[title] for title in ("demo", "random")}
    measured = {name: (value,) for name, value in figures["conditions"].items()}
    lines = [
        "# How good is it? Measured results\n",
        "<!-- written by benchmarks/results.py -->\n",
        *summary_lines(figures),
        *table("measured", (f"machine `{figures['machine']}`",), measured),
        "## Energy by planner\n",
        "All motions start at rest, follow their paths, and were simulated. `demo` has the moves "
        "from each goal of the demo to the next one; `random` has moves between random nodes. "
        "They start in postures of the posture table, which favours `table`. "
        "Weights are (0.5, 0, 2). `planned` is the energy reading `paper`. Ratios are geometric "
        "means over the moves.\n",
        *(line for title, each in sets.items() for line in energy_lines(title, each)),
        "## Energy by supply\n",
        "The same moves with other supplies, by the energy models of "
        "[studies](studies.md#other-supplies). Every supply counts with the motion that is best "
        "for it. In brackets: moves in which it takes less than MHSB.\n",
        *as_markdown({title: each["supplies"] for title, each in sets.items()}),
        "## Planning time\n",
        *time_lines(figures["planning"]),
        "\n## Tracking error\n",
        "Median / p95 / worst over the sequences of the [mismatch benchmark]"
        "(studies.md#the-mismatch-benchmark): on the exact machine, then on drawn plants.\n",
        *mismatch_benchmark.as_markdown(figures["tracking"]),
    ]
    if "online" in figures:
        lines += [
            "## Goals over real topics\n",
            "Random goals 0.5 to 3 s apart, both nodes as processes. [Studies]"
            "(studies.md#outcome-of-goals) defines the columns.\n",
            *online_lines(figures["online"]),
        ]
    return "\n".join(lines).rstrip() + "\n"


def results(
    output: Annotated[Path, tyro.conf.arg(metavar="FILE")] = ROOT / "out/bench/results.json",
    to: Annotated[Path, tyro.conf.arg(metavar="FILE")] = ROOT / "docs/results.md",
    moves: Count = 100,
    draws: Count = 20,
    goals: Count = 40,
) -> None:
    """Measure energy, planning time, tracking errors and lost goals of the suite's own arm.

    Args:
        output: JSON file to write.
        to: Page to write.
        moves: Number of random moves.
        draws: Number of drawn plants.
        goals: Number of goals over real topics; 0 leaves these out.
    """
    machine = load_machine()
    figures: Figures = {"conditions": conditions(), "machine": machine.name}
    asked = {"demo": demo_moves(machine), "random": list_compared_moves(machine, moves, 0)[-moves:]}
    for title, compared in asked.items():
        found = compare_all(machine, ENERGY_OPTIMAL, compared)
        done = list(tqdm(found, title, len(compared), unit="move"))
        figures[title] = energy_figures(machine, done)
    size = planning_benchmark.BenchmarkSize(moves=moves, truths=0)
    figures["planning"] = planning_benchmark.measure(machine, size, parts=("plan",))
    protocol = mismatch_benchmark.load_protocol(machine)
    study_benchmark(machine, protocol, draws, None, output.with_name("tracking"))
    tracking = json.loads(output.with_name("tracking").joinpath("summary.json").read_text())
    figures["tracking"] = {title: tracking[title] for title in ("exact", "draws")}
    write_json(output, figures)
    if goals:
        _, wanted = online_benchmark.prepare(machine, goals, 0)
        idle = online_benchmark.CONDITIONS["idle"]
        figures["online"] = online_benchmark.measure(idle, wanted, "online")
    write_json(output, figures)
    to.write_text(page(figures), encoding="utf-8")
    print(f"written to {output} and {to}")


if __name__ == "__main__":
    sys.exit(command_line.run(results, name="results"))
