"""What the integrated planner is measured by: the same problem searched offline, ever finer.

The lattice covers all that the joint limits allow, its spacing falls from 5 mm until the cost
changes by less than 1 %, ψ is sampled every half degree, and the best route of all is refined.
"""

from __future__ import annotations

import math

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.integrated.integrated_search import Effort, search
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_search import Weights
from mhsb_planner.search.s2_step import EnergyReading

SETTLED = 0.01
"""Share of the cost by which a finer search may still change it."""

FIRST_SPACING = 5e-3  # m
FIRST_CELLS = 12
FINER = 1.5
"""Factor from one search's spacing to the next's."""

MOST_ROUNDS = 4


def ground_truth(
    machine: Machine,
    start: FloatArray,
    start_modes: ModeArray,
    goal: tuple[float, float],
    weights: Weights,
    energy_reading: EnergyReading = "paper",
) -> DiscretePath:
    """The cheapest path known from a posture [rad] to a tip position [m]; seconds of work."""
    best = search(machine, start, start_modes, goal, weights, energy_reading)
    before = math.inf
    for level in range(MOST_ROUNDS):
        path = search(
            machine, start, start_modes, goal, weights, energy_reading, effort=_effort(level)
        )
        best = min(best, path, key=lambda found: found.cost)
        if abs(before - path.cost) <= SETTLED * path.cost:
            break
        before = path.cost
    return best


def _effort(level: int) -> Effort:
    finer = FINER**level
    return Effort(
        psi_spacing=math.radians(0.5),
        cells=round(FIRST_CELLS * finer),
        margin=10**6,
        finest=0.5e-3,
        coarsest=FIRST_SPACING / finer,
        expansions=10**7,
        strides=(1.0, 0.5, 0.25, 0.125, 0.0625),
        sweeps=20,
    )
