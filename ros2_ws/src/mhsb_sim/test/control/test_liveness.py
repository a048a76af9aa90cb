"""Nothing freezes: from whatever state the arm follows its plan, or a hold is reported.

Within a second the tip's error falls, or stays while the reference goes on, or is a usual one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mhsb_control import load_machine
from mhsb_control.coordinated import CoordinatedController
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import count_modules
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.simulation.simulator import Simulator

Motion = Callable[..., tuple[Trajectory, ModeSchedule]]
MACHINES = ("mhsb_arm3", "excavator", "forestry_crane")
STATES = 20
"""States that are drawn from each run."""
MAX_OVERLAP = 0.25
FALL = 0.9
"""Share of its largest value to which an error has to fall."""
WAY = 1e-3
"""Way of the reference by which an arm follows whose error stays, at relative size 1 [m]."""


def draw_plan(
    machine: Machine, motion: Motion, random: np.random.Generator
) -> tuple[Trajectory, ModeSchedule]:
    """A random motion from the start posture for which there are modules enough."""
    m, start = machine.arrays, Simulator(machine).reference
    while True:
        away = 0.25 * random.uniform(-1.0, 1.0, machine.joint_count) * (m.joint_max - m.joint_min)
        goal = np.clip(start.position + away, m.joint_min + 0.02, m.joint_max - 0.02)
        plan = motion(start, goal, 0, speed=machine.config.motion.max_piston_speed, of=machine)
        modules = machine.config.hydraulics.modules
        if all(count_modules(row, modules.per_mode) <= modules.count for row in plan[1].modes):
            return plan


def check_run(machine: Machine, motion: Motion, random: np.random.Generator) -> None:
    """Run a random plan on a random plant, and check states that are drawn from it."""
    overlap = random.uniform(0.0, MAX_OVERLAP)
    payload = random.uniform(0.7, 1.3) * machine.arrays.payload
    plant = machine.with_values({"imperfections.valve_overlap": overlap})
    simulator = Simulator(machine, plant=plant, payload=payload, seed=int(random.integers(2**31)))
    plan = draw_plan(machine, motion, random)
    simulator.set_plan(*plan)
    errors, held, way = [], [], []
    while simulator.plan_time_ns < plan[0].end_ns and len(errors) < 120_000:
        simulator.step()
        tips = plant.tip_in_base(
            np.array([simulator.reference.position, simulator.joint_state.position])
        )
        errors.append(float(np.linalg.norm(tips[0] - tips[1])))
        way.append(tips[0])
        held.append("MPa beyond its load" in simulator.guard.sentence)
    window = round(SECOND_NS / simulator.step_ns)
    for k in random.integers(0, max(len(errors) - window, 1), STATES):
        ahead = np.array(errors[k : k + window])
        falls = np.any(ahead < FALL * np.maximum.accumulate(ahead))
        close = ahead.max() < CoordinatedController.usual_error * machine.relative_size
        gone = np.linalg.norm(way[min(k + window, len(way)) - 1] - way[k])
        follows = gone > WAY * machine.relative_size and ahead[-1] - ahead[0] < 0.5 * gone
        assert falls or close or follows or any(held[k : k + window]), (
            f"overlap {overlap:.3f}, payload {payload:.2f}: {1e3 * ahead[0]:.2f} mm at {k} ms"
        )
    rest = machine.tip_in_base(np.array([simulator.reference.position, plan[0].position[-1]]))
    assert any(held[-window:]) or np.linalg.norm(rest[0] - rest[1]) < 1e-3


@pytest.mark.parametrize("name", MACHINES)
def test_an_arm_with_a_plan_comes_closer_to_it_or_says_why_it_is_held(
    name: str, motion: Motion, fresh_seed: int
) -> None:
    machine = load_machine(find_config_file(f"{name}.yaml"))
    check_run(machine, motion, np.random.default_rng(fresh_seed))


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("mhsb_arm3", 5106),
        ("excavator", 30119),
        ("forestry_crane", 60144),
        ("forestry_crane", 70026),
    ],
)
def test_motions_that_a_hidden_overlap_has_stopped_go_on(
    name: str, seed: int, motion: Motion
) -> None:
    machine = load_machine(find_config_file(f"{name}.yaml"))
    check_run(machine, motion, np.random.default_rng(seed))


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_from_ten_thousand_states_nothing_freezes(
    name: str, motion: Motion, fresh_seed: int
) -> None:
    machine = load_machine(find_config_file(f"{name}.yaml"))
    random = np.random.default_rng(fresh_seed)
    for _ in range(-(-10_000 // (STATES * len(MACHINES)))):
        check_run(machine, motion, random)
