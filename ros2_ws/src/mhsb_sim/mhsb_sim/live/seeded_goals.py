"""Random goals that there is a way to, and when to send them; the same seed, the same goals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState
from mhsb_planner.planner import Planner, PlanOptions

SHORTEST, LONGEST = 0.5, 3.0
"""Wall-clock time between two goals [s]."""


@dataclass(frozen=True)
class SeededGoal:
    """A tip position (x, z) [m], and the time until the next one [s]."""

    x: float
    z: float
    time: float


def seeded_goals(
    planner: Planner, count: int, seed: int, times: tuple[float, float] = (SHORTEST, LONGEST)
) -> list[SeededGoal]:
    """Goals anywhere in the workspace, each with a plan from rest in the start posture.

    The table's planner says whether there is one: it takes a twentieth of the online planner's
    time. Times between two goals are spread evenly between both `times` [s] and shuffled, so that
    as many goals take as long with any seed.
    """
    random = np.random.default_rng(seed)
    waits = np.random.default_rng([seed, 1]).permutation(np.linspace(*times, count))
    machine, options = planner.machine, PlanOptions(planner="table")
    start = MotionState.at_rest(np.array(machine.config.simulation.start_posture))
    goals: list[SeededGoal] = []
    while len(goals) < count:
        x, z = _anywhere(machine, random)
        try:
            planner.plan((x, z), start, options=options)
        except MhsbError:
            continue
        goals.append(SeededGoal(x, z, float(waits[len(goals)])))
    return goals


def _anywhere(machine: Machine, random: np.random.Generator) -> tuple[float, float]:
    """A point of the workspace, all areas alike [m]."""
    area = machine.config.workspace
    while True:
        x = random.uniform(area.min_x, area.max_radius)
        z = random.uniform(-area.max_radius, area.max_radius)
        if area.min_radius <= np.hypot(x, z) <= area.max_radius:
            return x, z
