"""Measure how the servo follows plans on plants with valve overlap, delay and slow valves.

    source scripts/env.sh
    python benchmarks/plant_changes.py run out/plant.json --sequences 6
    python benchmarks/plant_changes.py report out/plant.json

A change names what the plant has and the machine file does not, such as `overlap=0.1` or
`overlap=0.25,delay=0.02,lag=0.02`. All changes of a machine follow the same plans. Each goal is
planned from where the plan before ends, after a pause. `run` adds to the file after every
simulation and goes on where it was stopped.
"""

from __future__ import annotations

import json
import math
import pickle
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from tqdm import tqdm

from mhsb_control import load_machine
from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.files.config_files import find_config_file
from mhsb_model.holding import choose_holding_modes
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.cases.moves import draw_random_position
from mhsb_planner.online.commit_horizon import OFFLINE_LEAD
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.result_files import write_json
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.study.draws import PLAN_OPTIONS
from mhsb_tools.study.replay import Replay, replay
from mhsb_tools.study.servo_study import compute_supply_overshoot

GOALS = {"mhsb_arm3": 6, "excavator": 3, "forestry_crane": 3}
"""Number of goals of a sequence, by machine; others have 3."""
CHANGES = (
    "none",
    *(f"overlap={each}" for each in (0.05, 0.08, 0.1, 0.15, 0.25)),
    *(f"delay={each}" for each in (0.01, 0.015, 0.02, 0.04)),
    *(f"lag={each}" for each in (0.02, 0.05)),
    "overlap=0.25,delay=0.02,lag=0.02",
)
PAUSE = 1.0
"""Time between a plan's end and the next goal [s]."""
GOAL_TOLERANCE = 2.0
"""Distance within which a goal counts as reached [mm per m of reach]."""
PAPER_REACH = 1.029
"""Reach of a machine of relative size 1 [m]."""


def build_plant(machine: Machine, change: str) -> Machine:
    """Return a plant that differs from its machine file.

    Args:
        machine: The machine as its file describes it.
        change: `none`, or terms `overlap=` [share of the stroke], `delay=` [s] and `lag=` [s],
            separated by commas. The lag of a spool is 2 ζ/ω, ω is its natural frequency.
    """
    keys = {"overlap": "valve_overlap", "delay": "computing_delay"}
    values: dict[str, float] = {}
    for name, text in (term.split("=") for term in change.split(",") if change != "none"):
        if name == "lag":
            frequency = machine.config.circuit.valve_damping / (math.pi * float(text))
            values["circuit.valve_frequency"] = frequency
        else:
            values[f"imperfections.{keys[name]}"] = float(text)
    return machine.with_values(values)


def plan_sequence(machine: Machine, replanner: Replanner, seed: int, goals: int) -> list[Command]:
    """Plan random goals from the start posture on, one after the other."""
    random = np.random.default_rng(seed)
    start = np.array(machine.config.simulation.start_posture)
    command = Command.hold(0, start, choose_holding_modes(machine, machine.piston_forces(start)))
    commands: list[Command] = []
    while len(commands) < goals:
        now_ns = command.trajectory.end_ns + round(PAUSE * SECOND_NS) if commands else 0
        goal = draw_random_position(machine, random)
        try:
            replan = replanner.replan(command, now_ns, goal, OFFLINE_LEAD, PLAN_OPTIONS)
        except MhsbError:
            continue
        if replan is not None:
            command = replan.command
            commands.append(command)
    return commands


def count_reached(plant: Machine, commands: Sequence[Command], run: Replay) -> int:
    """Count the plans at whose ends the arm came to rest at the goal.

    The last step counts in which the reference rests at the end of the plan.
    """
    tolerance, reached = 1e-3 * GOAL_TOLERANCE * PAPER_REACH * plant.relative_size, 0
    rests = np.all(run.reference[:, 1] == 0.0, axis=1)
    for command in commands:
        end = command.trajectory.position[-1]
        there = np.flatnonzero(rests & np.all(abs(run.reference[:, 0] - end) < 1e-6, axis=1))
        if len(there):
            tips = plant.tip_in_base(np.array([run.position[there[-1]], end]))
            reached += bool(np.linalg.norm(tips[0] - tips[1]) < tolerance)
    return reached


def measure(
    machine: Machine, change: str, commands: Sequence[Command], seed: int, declared: bool
) -> dict:
    """Simulate a sequence; the RMS is that of the tip's error while the reference moves."""
    plant = build_plant(machine, change)
    machine = plant if declared else machine
    duration = commands[-1].trajectory.end_ns / SECOND_NS + PAUSE
    try:
        run = replay(Simulator(machine, seed=seed, plant=plant), commands, duration)
    except MhsbError as reason:
        return {"failure": str(reason)}
    error = 1e3 * run.tip_error(plant)
    moving = np.any(run.reference[:, 1] != 0.0, axis=1)
    return {
        "reached": count_reached(plant, commands, run),
        "goals": len(commands),
        "rms_per_reach": float(np.sqrt(np.mean(error[moving] ** 2)))
        / (PAPER_REACH * plant.relative_size),
        "overshoot": float(compute_supply_overshoot(plant, run).max() / 1e6),
        "relief": bool(run.energies["relief_valves"] > 0.0),
        "held": run.hold_reason,
    }


def run(
    output: Annotated[Path, tyro.conf.Positional],
    machines: tuple[str, ...] = tuple(GOALS),
    changes: tuple[str, ...] = CHANGES,
    sequences: int = 6,
    seed: int = 0,
    plans: Path = Path("out/plant_plans"),
    declared: bool = False,
) -> None:
    """Simulate sequences `seed` … `seed + sequences − 1`; plans are kept in a folder.

    The servo knows the change if it is declared, as its machine file would have it.
    """
    found = json.loads(output.read_text()) if output.exists() else {}
    plans.mkdir(parents=True, exist_ok=True)

    @cache
    def make_replanner(machine: Machine) -> Replanner:
        return Replanner(machine, load_or_build_table(machine))

    for name in machines:
        machine = load_machine(find_config_file(f"{name}.yaml"))
        for own in tqdm(range(seed, seed + sequences), desc=name):
            file = plans / f"{name}_{own}.pkl"
            if not file.exists():
                goals = GOALS.get(name, 3)
                planned = plan_sequence(machine, make_replanner(machine), own, goals)
                file.write_bytes(pickle.dumps(planned))
            commands = pickle.loads(file.read_bytes())
            for change in changes:
                results = found.setdefault(name, {}).setdefault(change, {})
                if str(own) not in results:
                    results[str(own)] = measure(machine, change, commands, own, declared)
                    write_json(output, found)


def report(file: Annotated[Path, tyro.conf.Positional]) -> None:
    """Print a line for every machine and change."""
    print("machine change: complete sequences; RMS median, p95 [mm/m]; overshoot p95; relief; held")
    for name, changes in json.loads(file.read_text()).items():
        for change, results in changes.items():
            ran = [each for each in results.values() if "failure" not in each]
            rms, peaks = ([each[key] for each in ran] for key in ("rms_per_reach", "overshoot"))
            print(
                f"{name:15s}{change:34s}{sum(r['reached'] == r['goals'] for r in ran)}/"
                f"{len(results)}  {np.median(rms):7.3f} {np.quantile(rms, 0.95):7.3f}  "
                f"{np.quantile(peaks, 0.95):6.3f} MPa  {sum(r['relief'] for r in ran)}  "
                f"{sum(bool(r['held']) for r in ran)}"
            )


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({"run": run, "report": report})
