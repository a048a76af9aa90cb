"""Benchmark of the integrated planner's search with much boost, and among obstacles."""

from __future__ import annotations

import math
import time
from contextlib import suppress
from typing import Any

import numpy as np
from benchmarks.scenes import random_scenes
from tqdm import tqdm

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import MotionState
from mhsb_planner.cases.moves import Move, yield_random_moves
from mhsb_planner.deadline import Deadline
from mhsb_planner.errors import DeadlineError
from mhsb_planner.integrated.integrated_search import search
from mhsb_planner.planner import ENERGY_OPTIMAL, Planner, PlanOptions
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.search.s2_search import PathQuery
from mhsb_tools.comparison.ground_truth import search_ground_truth

HEAVY_PAYLOAD, LOW_PRESSURE = 16.0, 2.5e6  # kg, Pa
"""Payload [kg] and supply pressure [Pa] of machines that need much boost."""
SHORT = 0.04
"""Deadline of a quick search [s]."""

SCENE_TIME = 1.0
"""Deadline of a plan among obstacles [s]."""

DEARER = 1.01
"""Cost ratio above which a plan counts as dearer than the baselines'."""
MILLI = 1e3

Figures = dict[str, Any]


def mirror_linkages(machine: Machine) -> Machine:
    """Return the machine with every linkage mirrored, so that each moment arm is negative.

    Args:
        machine: The arm.

    Returns:
        The mirrored arm, named `…_mirrored`; its joints move as before.
    """
    content = machine.config.model_dump()
    content["name"] = f"{machine.name}_mirrored"
    other = {"left": "right", "right": "left"}
    for joint in content["joints"]:
        linkage, limits = joint["linkage"], joint["limits"]
        ends = limits["lower"] + limits["upper"]
        for pin in {"rocker_pivot", "parent_pin"} & set(linkage):
            linkage[pin]["angle"] *= -1.0
        if "rocker_side" in linkage:
            linkage["rocker_side"] = other[linkage["rocker_side"]]
        child = linkage["child_pin"]
        child["angle"] = math.remainder(-child["angle"] - ends, math.tau)
    return Machine.from_config(type(machine.config).model_validate(content))


# --- Where much is boosted -----------------------------------------------------------------------


def boosted_figures(base: Planner, moves: int) -> Figures:
    """Compare path costs with the ground truth on three machines.

    The machines have a low supply pressure, a heavy payload, or negative moment arms.

    Args:
        base: Planner of the machine as it is.
        moves: Number of random moves for each machine.

    Returns:
        By machine: mean and worst cost ratio without deadline and within `SHORT` (`quick_…`), the
        number found within it, and search times [s].
    """
    machine = base.machine
    mirrored = mirror_linkages(machine)
    planners = {
        "low_pressure": _planner_of_changed(base, machine.changed(supply_pressure=LOW_PRESSURE)),
        "heavy": _planner_of_changed(base, machine.changed(payload=HEAVY_PAYLOAD)),
        "negative_arms": Planner(mirrored, build_posture_table(mirrored)),
    }
    return {name: _measure_boosted(planner, moves, name) for name, planner in planners.items()}


def _planner_of_changed(planner: Planner, machine: Machine) -> Planner:
    """Return a new planner for a changed machine that uses the same posture table.

    Args:
        planner: Planner of the machine as it is; it stays as it is.
        machine: The changed machine.

    Returns:
        The new planner.
    """
    other = Planner(planner.machine, planner.graph.table)
    other.change_machine(machine)
    return other


def _measure_boosted(planner: Planner, moves: int, name: str) -> Figures:
    """Compare path costs of one machine with the ground truth.

    Args:
        planner: Planner of the machine.
        moves: Number of random moves.
        name: Name of the machine, for the progress bar.

    Returns:
        Cost ratios and search times [s], see `boosted_figures`. NaN if no quick search found a
        path.
    """
    ratios, quick, seconds = [], [], []
    for move in tqdm(yield_random_moves(planner, moves), f"ground truth, {name}", moves):
        machine, task = planner.machine, _search_arguments(planner.machine, move)
        query = PathQuery(*task, ENERGY_OPTIMAL)
        truth = search_ground_truth(machine, *task, ENERGY_OPTIMAL).cost
        began = time.perf_counter()
        ratios.append(search(machine, query).cost / truth)
        seconds.append(time.perf_counter() - began)
        with suppress(DeadlineError):
            soon = search(machine, query, deadline=Deadline.after(SHORT))
            quick.append(soon.cost / truth)
    return {
        "moves": moves,
        "ratio_mean": float(np.mean(ratios)),
        "ratio_worst": max(ratios),
        "quick_found": len(quick),
        "quick_ratio_mean": float(np.mean(quick)) if quick else math.nan,
        "quick_ratio_worst": max(quick, default=math.nan),
        "seconds_mean": float(np.mean(seconds)),
        "seconds_worst": max(seconds),
    }


def _search_arguments(
    machine: Machine, move: Move
) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
    """Return start posture, start modes (all N) and goal (x, z) of a move, for the search."""
    x, z = move.goal
    return move.start, np.full(machine.joint_count, Mode.N, dtype=np.uint8), (x, z)


# --- Among obstacles -----------------------------------------------------------------------------


def scene_figures(planner: Planner, count: int) -> Figures:
    """Plan among obstacles with every planner and compare the motions' costs.

    Each plan has a deadline of `SCENE_TIME`. Costs of the integrated planner are divided by the
    cheaper one of the other planners' costs.

    Args:
        planner: Planner of the machine without obstacles; restored afterwards.
        count: Number of random scenes.

    Returns:
        `solved`: scenes solved by each planner. `compared` and `cost_ratio_…`: scenes that
        the integrated planner and another one solved. `dearer`: ratios above `DEARER`. `p50_ms` and
        `p99_ms`: planning times of the integrated planner [ms].
    """
    base, kinds = planner.machine, ("table", "fixed", "integrated")
    costs, seconds = np.full((count, len(kinds)), np.nan), []
    for row, scene in zip(costs, tqdm(random_scenes(planner, count), "scenes", count), strict=True):
        planner.change_machine(scene.machine)
        for i, kind in enumerate(kinds):
            began = time.perf_counter()
            row[i] = _cost(planner, scene.move, PlanOptions(planner=kind))
        seconds.append(time.perf_counter() - began)
        planner.change_machine(base)
    solved = np.isfinite(costs)
    both = solved[:, 2] & solved[:, :2].any(axis=1)
    ratio = costs[both, 2] / np.nanmin(costs[both, :2], axis=1)
    return {
        "scenes": count,
        "solved": dict(zip(kinds, solved.sum(axis=0).tolist(), strict=True)),
        "compared": len(ratio),
        "dearer": int(np.count_nonzero(ratio > DEARER)),
        "cost_ratio_mean": float(np.mean(ratio)) if len(ratio) else math.nan,
        "cost_ratio_worst": float(np.max(ratio, initial=0.0)),
        "p50_ms": MILLI * float(np.percentile(seconds, 50)),
        "p99_ms": MILLI * float(np.percentile(seconds, 99)),
    }


def _cost(planner: Planner, move: Move, options: PlanOptions) -> float:
    """Return the cost of a move's motion; NaN if there is none by the deadline.

    Args:
        planner: The planner.
        move: Start posture and goal.
        options: Options of the plan.

    Returns:
        The cost, or NaN.
    """
    start, until = MotionState.at_rest(move.start), Deadline.after(SCENE_TIME)
    try:
        return planner.plan(move.goal, start, options=options, deadline=until).cost(options)
    except MhsbError:
        return math.nan


def boosted_lines(figures: Figures) -> list[str]:
    """Format the figures of machines that boost much as lines of a table."""
    return [
        f"boosted          {name}, {row['moves']} moves: cost over the ground truth's "
        f"{row['ratio_mean']:.3f}, at worst {row['ratio_worst']:.3f}, in "
        f"{row['seconds_mean']:.2f} s ({row['seconds_worst']:.2f} s); within "
        f"{MILLI * SHORT:.0f} ms {row['quick_found']} found, {row['quick_ratio_mean']:.3f}, "
        f"at worst {row['quick_ratio_worst']:.3f}"
        for name, row in figures.items()
    ]


def scene_lines(scenes: Figures) -> list[str]:
    """Format the figures of scenes with obstacles as a line of a table.

    Args:
        scenes: Result of `scene_figures`.

    Returns:
        A list with one line.
    """
    solved = ", ".join(f"{kind} {number}" for kind, number in scenes["solved"].items())
    return [
        f"scenes           of {scenes['scenes']} solved: {solved}; cost over the cheaper of the "
        f"others' {scenes['cost_ratio_mean']:.3f}, at worst {scenes['cost_ratio_worst']:.3f}, "
        f"dearer by over 1 % in {scenes['dearer']} of {scenes['compared']}; "
        f"p50 {scenes['p50_ms']:.0f} ms, p99 {scenes['p99_ms']:.0f} ms",
    ]
