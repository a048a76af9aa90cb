"""Benchmark of plans at V_max (allowed piston speed) beside plans at half of it, on random arms.

    python benchmarks/random_arms.py run|report out/random_arms.json

An arm is the paper's with other linkages (sizes and kinds, so moment arms are unlike between its
joints), cylinders, masses, valves, pumps and V_max of each piston. Every motion at half of V_max is
also allowed at V_max, so that a plan at V_max should not be dearer. Arms in the file are not
planned again.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tqdm import tqdm

from mhsb_control import load_machine
from mhsb_model.errors import MhsbError
from mhsb_model.holding import HoldingError, choose_holding_modes
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState
from mhsb_model.types import FloatArray
from mhsb_planner.cases.moves import Move
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.result_files import write_json

Positional = Annotated[Path, tyro.conf.Positional]
OPTIONS = PlanOptions(planner="integrated")
HALF = 0.5
"""Factor on V_max of the plans to compare with [-]."""
ALLOWED_RATIO = 1.01
"""Largest cost of a plan at V_max over that of a plan at half of it [-]."""
FACTORS = {
    "hydraulics.main_pump.pressure": (0.4, 1.2),
    "hydraulics.main_pump.max_flow": (0.5, 1.5),
    "hydraulics.servo_pump.max_flow": (0.5, 2.0),
    "hydraulics.valve.rated_flow": (0.3, 2.0),
    "hydraulics.valve.leakage_flow": (0.03, 1.0),
    "payload.mass": (0.1, 1.6),
    "motion.max_piston_speed": (0.4, 4.0),
}
"""Ranges of factors on values of the paper's arm, spread evenly by their logarithms [-]."""
LINK_MASS, BORE, ROD = (0.5, 1.8), (0.7, 1.3), (0.4, 0.6)
"""Ranges of the factors on mass and bore of each joint, and of rod over bore [-]."""
OWN_VALVE, OWN_SPEED = (0.5, 1.0), (0.5, 1.0)
"""Ranges of each joint's rated flow and V_max over those of the arm [-]."""
LINKAGE_FACTOR = (0.6, 1.7)
"""Range of the factor on the lengths of a four-bar, and so on its moment arm and stroke [-]."""
CHILD_RADIUS, PARENT_RADIUS = (0.035, 0.09), (0.2, 0.35)
"""Ranges of a slider-crank's radii [m]."""
PIN_ANGLES = (0.5, 2.6)
"""Range of the angle between a slider-crank's pins, in which it has no dead centre [rad]."""
MIN_NODES = 50
"""Number of nodes of an arm that a posture must hold."""
MOST_DRAWS = 30
"""Number of random moves of an arm, of which those count that one of both plans finds."""


def draw_factor(bounds: tuple[float, float], random: np.random.Generator) -> float:
    """Draw a factor whose logarithm is uniform over a range."""
    return float(np.exp(random.uniform(*np.log(bounds))))


def draw_linkage(joint: dict[str, Any], random: np.random.Generator) -> None:
    """Replace the linkage of a joint of the paper's arm in place, and its range if need be.

    The linkage is the joint's four-bar with other lengths, or a slider-crank.
    """
    linkage, limits = joint["linkage"], joint["limits"]
    if random.random() < 0.5:
        factor = draw_factor(LINKAGE_FACTOR, random)
        for key, value in linkage.items():
            if isinstance(value, dict):
                value["radius"] *= factor
            elif key.endswith("length"):
                linkage[key] *= factor
        return
    side = 1.0 if limits["upper"] > -limits["lower"] else -1.0  # of the joint's longer way
    lower, upper = np.sort(side * np.array(PIN_ANGLES))
    middle = 0.5 * (limits["lower"] + limits["upper"])
    angle = 0.5 * (lower + upper) - middle
    joint["linkage"] = {
        "kind": "slider_crank",
        "child_pin": {"radius": random.uniform(*CHILD_RADIUS), "angle": 0.3},
        "parent_pin": {"radius": random.uniform(*PARENT_RADIUS), "angle": 0.3 - angle},
    }
    limits["lower"] = max(limits["lower"], lower - angle)
    limits["upper"] = min(limits["upper"], upper - angle)


def draw_arm(paper: Machine, random: np.random.Generator) -> Machine:
    """Draw an arm with three joints that turn; raise MhsbError if it breaks a rule of files."""
    content = paper.config.model_dump(mode="json")
    values = {}
    for path, bounds in FACTORS.items():
        value: Any = content
        for key in path.split("."):
            value = value[key]
        values[path] = value * draw_factor(bounds, random)
    for joint in content["joints"]:
        draw_linkage(joint, random)
        heavier = draw_factor(LINK_MASS, random)
        joint["link"]["mass"] *= heavier
        joint["link"]["inertia"] *= heavier
        joint["cylinder"]["bore"] *= draw_factor(BORE, random)
        joint["cylinder"]["rod"] = joint["cylinder"]["bore"] * draw_factor(ROD, random)
        joint["actuator"] = {
            "rated_flow": values["hydraulics.valve.rated_flow"] * draw_factor(OWN_VALVE, random),
            "max_piston_speed": values["motion.max_piston_speed"] * draw_factor(OWN_SPEED, random),
        }
    return paper.with_values({**values, "joints": content["joints"]})


def slow_down(arm: Machine, factor: float) -> Machine:
    """Return a copy of an arm whose pistons all have a V_max by a factor lower."""
    values = {"motion.max_piston_speed": factor * arm.config.motion.max_piston_speed}
    for j, speed in enumerate(arm.arrays.max_piston_speed.tolist()):
        values[f"joints.{j}.actuator.max_piston_speed"] = factor * speed
    return arm.with_values(values)


def is_held(arm: Machine, posture: FloatArray) -> bool:
    """Return whether the booster modules suffice to hold a posture at rest."""
    try:
        choose_holding_modes(arm, arm.piston_forces(posture))
    except HoldingError:
        return False
    return True


def draw_planners(random: np.random.Generator) -> tuple[Planner, Planner, FloatArray]:
    """Draw arms until one can hold a posture at MIN_NODES nodes.

    Returns:
        Planner of the arm, planner of the arm at half of V_max, and the nodes' indices.
    """
    paper = load_machine()
    while True:
        try:
            arm = draw_arm(paper, random)
            slower = slow_down(arm, HALF)
            table = build_posture_table(arm)
        except MhsbError:
            continue
        nodes = np.flatnonzero(table.feasible)
        held = np.array([i for i in nodes if is_held(arm, table.posture[i, 0])])
        if len(held) >= MIN_NODES:
            return Planner(arm, table), Planner(slower, table), held


def draw_moves(planner: Planner, nodes: FloatArray, random: np.random.Generator) -> Iterator[Move]:
    """Yield MOST_DRAWS moves from a node of the posture table to another."""
    table = planner.graph.table
    for _ in range(MOST_DRAWS):
        here, there = random.choice(nodes, 2, replace=False)
        goal = (table.nodes[there] * table.spacing).tolist()
        yield Move(table.posture[here, 0], tuple(goal))


def plan(planner: Planner, move: Move) -> dict[str, Any]:
    """Plan a move without a deadline; return cost, proposer, processor time [s], or the failure."""
    began = time.process_time()
    try:
        found = planner.plan(move.goal, MotionState.at_rest(move.start), options=OPTIONS)
    except MhsbError as error:
        return {"cost": None, "failure": str(error), "seconds": time.process_time() - began}
    taken = [each.proposer for each in found.log.entries if each.outcome == "taken"][-1]
    seconds = time.process_time() - began
    return {"cost": found.cost(OPTIONS), "proposer": taken, "seconds": seconds}


def run(file: Positional, arms: int = 60, moves: int = 3, seed: int = 1) -> None:
    """Plan moves of random arms at V_max and at half of it.

    Args:
        file: JSON file, read and extended.
        arms: Number of arms.
        moves: Number of moves of each arm.
        seed: Seed of arms and moves.
    """
    found = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    for arm in tqdm(range(arms), unit="arm"):
        key = f"{seed} {arm}"
        if key in found:
            continue
        random = np.random.default_rng((seed, arm))
        planner, slower, nodes = draw_planners(random)
        rows: list[dict[str, Any]] = []
        for move in draw_moves(planner, nodes, random):
            row = {"full": plan(planner, move), "half": plan(slower, move)}
            if row["full"]["cost"] is not None or row["half"]["cost"] is not None:
                rows.append(row)
            if len(rows) == moves:
                break
        found[key] = rows
        write_json(file, found)


def report(file: Positional) -> None:
    """Print how many plans at V_max are dearer than at half of it, and which."""
    found = json.loads(file.read_text(encoding="utf-8"))
    ratios = {}
    for arm, rows in found.items():
        for i, row in enumerate(rows):
            costs = (row["full"]["cost"], row["half"]["cost"])
            full, half = (math.inf if cost is None else cost for cost in costs)
            ratios[f"{arm} move {i}"] = full / half
    values = np.array(list(ratios.values()))
    dearer = {name: ratio for name, ratio in ratios.items() if ratio > ALLOWED_RATIO}
    both = values[np.isfinite(values) & (values > 0.0)]
    print(
        f"{len(found)} arms, {len(values)} moves; dearer at V_max: {len(dearer)} "
        f"({len(dearer) / len(values):.1%}), worst ratio {both.max():.3f}, "
        f"mean ratio {both.mean():.3f}; found only at V_max {np.sum(values == 0.0)}, "
        f"only at half {np.sum(np.isinf(values))}"
    )
    for name, ratio in sorted(dearer.items(), key=lambda item: -item[1]):
        print(f"{name}: {ratio:.3f}")


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({"run": run, "report": report})
