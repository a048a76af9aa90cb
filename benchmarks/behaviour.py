"""Record what the suite does, and compare two records: a test for refactorings.

    source scripts/env.sh
    python benchmarks/behaviour.py record out/before.json --moves 20
    ... change the code ...
    python benchmarks/behaviour.py record out/after.json --moves 20
    python benchmarks/behaviour.py compare out/before.json out/after.json

A record holds plans without a deadline (random moves, every planner, two weights, every machine of
`config`), simulated motions, reports of scripted online runs in lock-step, and the options and JSON
keys of every command. Arrays are kept as hashes of their bytes, so equal records mean equal bits.
`compare` ends with exit code 1 if anything differs. It prints each difference. For plans whose bits
differ it prints the change of their cost, by which a change of numerics is judged.
"""

# imports of the repository need its root on the path
from __future__ import annotations

import hashlib
import json
import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.lock_step import LockStepWorld

from mhsb_model.errors import MhsbError
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine, load_machine
from mhsb_model.trajectory import MotionState
from mhsb_planner.cases.moves import draw_random_position
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.online.settings import Settings
from mhsb_planner.planner import Plan, Planner, PlanOptions, warm_up
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.search.s2_search import Weights
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.study.headless import HeadlessRun, TimedGoal

MACHINES = ("mhsb_arm3", "mhsb_arm4", "excavator", "forestry_crane", "telescope_arm")
PLANNERS = ("table", "fixed", "integrated")
WEIGHTS = {"energy": (0.5, 0.0, 2.0), "time": (0.0, 15.0, 2.0)}
"""Weights of the paper's energy-optimal and time-optimal cases."""

COMMANDS = {
    "mhsb_model": ("check",),
    "mhsb_planner": ("build_table", "plan", "goal", "reproduce"),
    "mhsb_sim": (
        "simulate", "compare", "study", "tune", "report", "animate", "demo", "record", "viewer",
    ),
}  # fmt: skip
JSON_RUNS = {
    "check": ("mhsb_tools", "check", "config/mhsb_arm3.yaml", "--json"),
    "plan": ("mhsb_tools", "plan", "--case", "1-1", "--json"),
    "simulate": ("mhsb_tools", "simulate", "--goal", "0.55", "0.60", "3", "--json"),
}
"""Commands whose JSON output is cheap to make; their keys are recorded."""

Record = dict[str, Any]


# --- Plans ---------------------------------------------------------------------------------------


def digest(*arrays: np.ndarray) -> str:
    """Return a hash of the bytes, shapes and types of arrays.

    Args:
        *arrays: The arrays; their order matters.

    Returns:
        The first 24 hexadecimal digits of a SHA-256.
    """
    hasher = hashlib.sha256()
    for array in arrays:
        hasher.update(f"{array.shape}{array.dtype}".encode())
        hasher.update(np.ascontiguousarray(array).tobytes())
    return hasher.hexdigest()[:24]


def draw_moves(planner: Planner, count: int, seed: int) -> Iterator[tuple[Any, tuple[float, ...]]]:
    """Draw moves between nodes of the posture table.

    Whether a planner finds a plan plays no part, so that the moves stay the same when planners
    change.

    Args:
        planner: The planner; its table has the nodes and their postures.
        count: Number of moves.
        seed: Seed of the random numbers.

    Yields:
        Start posture [rad or m] and goal in `base_link` [m].
    """
    random, machine = np.random.default_rng(seed), planner.machine
    table, limits = planner.graph.table, machine.arrays
    nodes = np.flatnonzero(table.feasible)
    for _ in range(count):
        here, there = random.choice(nodes, 2, replace=False)
        goal, start = table.nodes[there] * table.spacing, table.posture[here, 0]
        if machine.slews:
            began, ended = random.uniform(limits.joint_min[0], limits.joint_max[0], 2)
            goal, start = machine.convert_to_base(goal, ended), np.append(began, start)
        yield start, tuple(float(value) for value in goal)


def record_plan(
    planner: Planner, goal: tuple[float, ...], start: Any, options: PlanOptions
) -> Record:
    """Return the numbers and hashes of one plan, or the sentence of the error.

    Args:
        planner: The planner.
        goal: Goal in `base_link` [m].
        start: Start posture, shape (n,) [rad or m].
        options: Options of the plan.

    Returns:
        A dictionary; `refused` and `sentence` alone if there is no plan.
    """
    try:
        plan: Plan = planner.plan(goal, MotionState.at_rest(start), options=options)
    except MhsbError as error:
        return {"refused": type(error).__name__, "sentence": str(error)}
    trajectory, schedule = plan.motion.trajectory, plan.motion.schedule
    return {
        "trajectory": digest(
            trajectory.offset_ns, trajectory.position, trajectory.velocity, trajectory.acceleration
        ),
        "schedule": digest(schedule.offset_ns, schedule.modes),
        "path": digest(plan.path.posture),
        "energy_j": plan.energy.paper,
        "energy_series_j": plan.energy.series,
        "duration_s": plan.duration,
        "switches": schedule.switch_count,
        "lower_bound_j": plan.lower_bound,
        "cost": plan.cost(options),
    }


def record_plans(name: str, kind: str, weights: str, count: int, seed: int) -> dict[str, Record]:
    """Record plans of one machine, planner and weights; runs in a worker process.

    Args:
        name: Name of the machine file without its ending.
        kind: Name of the planner.
        weights: Key of `WEIGHTS`.
        count: Number of moves.
        seed: Seed of the moves.

    Returns:
        Records by keys such as `mhsb_arm3/table/energy/0`.
    """
    machine = load_machine(find_config_file(f"{name}.yaml"))
    planner = Planner(machine, load_or_build_table(machine))
    options = PlanOptions(planner=kind, weights=Weights(*WEIGHTS[weights]))
    return {
        f"{name}/{kind}/{weights}/{number}": record_plan(planner, goal, start, options)
        for number, (start, goal) in enumerate(draw_moves(planner, count, seed))
    }


# --- Motions, online runs, commands --------------------------------------------------------------


def random_goals(machine: Machine, count: int, seed: int) -> list[tuple[float, ...]]:
    """Draw goals anywhere in the workspace [m]; some of them cannot be reached."""
    random = np.random.default_rng(seed)
    return [tuple(map(float, draw_random_position(machine, random))) for _ in range(count)]


def record_motion(name: str, seed: int) -> dict[str, Record]:
    """Record a simulated motion along two goals, the second one given in motion.

    Args:
        name: Name of the machine file without its ending.
        seed: Seed of goals and sensor noise.

    Returns:
        One record: hash of all samples, tip error RMS [mm], highest supply pressure [MPa].
    """
    machine = load_machine(find_config_file(f"{name}.yaml"))
    table = load_or_build_table(machine)
    planner, replanner = Planner(machine, table), Replanner(machine, table)
    run = HeadlessRun(
        Simulator(machine, "coordinated", seed), replanner, PlanOptions(planner="table")
    )
    goals: list[TimedGoal] = []
    for goal in random_goals(machine, 50, seed):
        start = machine.config.simulation.start_posture
        planned = record_plan(planner, goal, np.array(start), PlanOptions(planner="table"))
        if "refused" not in planned:
            goals.append(TimedGoal(goal, 1.0 if not goals else 3.0))
        if len(goals) == 2:
            break
    for _ in run.run(goals):
        pass
    samples = run.samples()
    return {
        f"motion/{name}": {
            "samples": digest(samples.table()),
            "tip_error_rms_mm": float(1e3 * math.sqrt(float(np.mean(samples.tip_error**2)))),
            "max_supply_pressure_mpa": float(samples.supply_pressure.max() / 1e6),
        }
    }


def record_online(name: str, seed: int, goals: int) -> dict[str, Record]:
    """Record all reports of a scripted run in lock-step: random goals, stops, a slow worker.

    Times that depend on the computer are removed from the reports.

    Args:
        name: Name of the machine file without its ending.
        seed: Seed of goals and times.
        goals: Number of goals; every seventh is followed by a stop.

    Returns:
        One record: the reports as text, and the number of commands sent.
    """
    machine, random = load_machine(find_config_file(f"{name}.yaml")), np.random.default_rng(seed)
    replanner = Replanner(machine, load_or_build_table(machine))
    world = LockStepWorld(machine, replanner, Settings(machine, PlanOptions(planner="table")))
    for number, goal in enumerate(random_goals(machine, goals, seed)):
        world.planning_time = float(random.choice([0.01, 0.03, 0.2]))
        world.send_goal(*goal)
        world.pass_time(float(random.uniform(0.05, 2.0)))
        if number % 7 == 6:
            world.life.stop(lambda success, sentence: None)
    world.pass_time(20.0)
    reports = [re.sub(r"(plan_ms|lead_ms)=[^,)]*", r"\1", repr(each)) for each in world.reports]
    return {f"online/{name}": {"reports": reports, "commands": len(world.sent)}}


def record_commands() -> dict[str, Record]:
    """Record the options of every command, and the JSON keys of those that are quick.

    Returns:
        A record for each command.
    """
    records: dict[str, Record] = {}
    for package, names in COMMANDS.items():
        for name in names:
            text = run_command(package, name, "--help")
            options = sorted(set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", text)))
            records[f"help/{package}/{name}"] = {"options": options}
    for name, words in JSON_RUNS.items():
        records[f"json/{name}"] = {"keys": sorted(keys_of(json.loads(run_command(*words))))}
    return records


def run_command(*words: str) -> str:
    """Return what `ros2 run` prints for these words; raises CalledProcessError if it fails."""
    return subprocess.run(
        ["bash", "-c", 'ros2 run "$@"', "ros2", *words],
        check=True,
        capture_output=True,
        text=True,
        env=os.environ | {"COLUMNS": "200"},
    ).stdout


def keys_of(content: Any, prefix: str = "") -> set[str]:
    """Return the paths of all keys in JSON content.

    Args:
        content: Decoded JSON.
        prefix: Path of the content itself.

    Returns:
        Paths such as `.goals[].x`; all elements of a list share one path.
    """
    if isinstance(content, dict):
        inner = [keys_of(value, f"{prefix}.{key}") for key, value in content.items()]
        return {f"{prefix}.{key}" for key in content}.union(*inner)
    if isinstance(content, list):
        return set().union(*(keys_of(value, f"{prefix}[]") for value in content))
    return set()


# --- Commands of this script ---------------------------------------------------------------------


def record(
    output: Annotated[Path, tyro.conf.Positional],
    moves: int = 20,
    seed: int = 33,
    machines: tuple[str, ...] = MACHINES,
    jobs: int | None = None,
) -> int:
    """Record plans, motions, online runs and commands.

    Args:
        output: JSON file to write.
        moves: Number of moves for each machine, planner and weights.
        seed: Seed of the random moves and goals.
        machines: Names of files in `config`, without their ending.
        jobs: Number of processes; all processors when left out.

    Returns:
        Exit code 0.
    """
    for name in machines:
        machine = load_machine(find_config_file(f"{name}.yaml"))
        warm_up(
            Planner(machine, load_or_build_table(machine))
        )  # makes tables and kernels for the workers
    results: dict[str, Record] = {}
    with ProcessPoolExecutor(jobs) as pool:
        work = [
            pool.submit(record_plans, name, kind, weights, moves, seed)
            for name in machines
            for kind in PLANNERS
            for weights in WEIGHTS
        ]
        work += [pool.submit(record_motion, name, seed) for name in machines]
        work += [pool.submit(record_online, name, seed, max(10, moves)) for name in machines]
        work.append(pool.submit(record_commands))
        for each in tqdm(work, disable=None):
            results |= each.result()
    output.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile("w", dir=output.parent, delete=False) as file:
        json.dump(results, file, indent=1, sort_keys=True)
    Path(file.name).replace(output)
    print(f"{len(results)} records in {output}")
    return 0


def compare(
    before: Annotated[Path, tyro.conf.Positional], after: Annotated[Path, tyro.conf.Positional]
) -> int:
    """Compare two records and print the differences.

    Args:
        before: Record of the code before a change.
        after: Record of the code after it.

    Returns:
        Exit code: 0, or 1 if anything differs.
    """
    old, new = (json.loads(path.read_text()) for path in (before, after))
    missing = sorted(old.keys() ^ new.keys())
    different = [key for key in sorted(old.keys() & new.keys()) if old[key] != new[key]]
    for key in missing:
        print(f"{key}: only in {'the first' if key in old else 'the second'} record")
    for key in different[:40]:
        fields = [field for field in old[key] if old[key].get(field) != new[key].get(field)]
        print(f"{key}: {', '.join(fields) or 'new fields'}")
    both = [key for key in old.keys() & new.keys() if "cost" in old[key] and "cost" in new[key]]
    lost = [key for key in old.keys() & new.keys() if "cost" in old[key] and "cost" not in new[key]]
    ratio = np.array([new[key]["cost"] / old[key]["cost"] for key in both])
    if ratio.size:
        print(
            f"{len(both)} plans in both: cost of the second over the first "
            f"{ratio.mean():.6f} mean, {np.quantile(ratio, 0.99):.6f} p99, {ratio.max():.6f} max"
        )
    print(f"{len(lost)} lost")
    same = len(old.keys() & new.keys()) - len(different)
    print(f"{same} records equal, {len(different)} different, {len(missing)} in one record alone")
    return 1 if different or missing else 0


if __name__ == "__main__":
    sys.exit(tyro.extras.subcommand_cli_from_dict({"record": record, "compare": compare}))
