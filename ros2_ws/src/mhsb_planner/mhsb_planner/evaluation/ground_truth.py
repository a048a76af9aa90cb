"""What the integrated planner is measured by: the same problem searched offline, in several ways.

The planner's own search with far more work: lattices down to 2 mm, ψ every half degree. And the
cheapest routes over a lattice as fine that is priced and searched by other means (`least_cost`),
with and without loads that are held, for what the planner's search may leave out. All are improved
by small changes; the cheapest counts, at the planner's prices.
"""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.evaluation.least_cost import least_cost
from mhsb_planner.integrated.integrated_search import Effort, improved, search
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_search import Weights
from mhsb_planner.search.s2_step import EnergyReading

THOROUGH = Effort(
    psi_spacing=math.radians(0.5),
    cells=40,
    finer=1.3,
    narrowest=2e-3,
    expansions=100_000,
    strides=(0.5, 0.25, 0.125, 0.0625),
    sweeps=20,
)

SPACINGS = (10e-3, 2.5e-3)
"""By which routes over the other lattice are improved, of an arm of the paper's size [m]."""

NEAR_THE_BOUND = 2e-3
"""Share of the cost by which it may exceed the lower bound, to be taken for the least."""

MAY_BE_IMPROVED = 1.25
"""Share of the known cost up to which routes over the other lattice are looked at."""


def ground_truth(
    machine: Machine,
    start: FloatArray,
    start_modes: ModeArray,
    goal: tuple[float, float],
    weights: Weights,
    energy_reading: EnergyReading = "paper",
) -> DiscretePath:
    """The cheapest path known from a posture [rad] to a tip position [m]; seconds of work.

    Raises NoPathError.
    """
    task = machine, start, start_modes, goal, weights, energy_reading
    best = min((search(*task), search(*task, effort=THOROUGH)), key=_cost)
    if energy_reading != "paper" or np.any(start_modes) or len(machine.obstacles.path_rows) > 0:
        return best
    if weights.energy * best.lower_bound >= (1.0 - NEAR_THE_BOUND) * best.cost:
        return best
    for holding in (True, False):
        known = MAY_BE_IMPROVED * best.cost
        _, via = least_cost(machine, start, goal, weights, known, holding)
        if via is not None:
            spacings = tuple(machine.scale * spacing for spacing in SPACINGS)
            path = improved(*task, via=via, spacings=spacings, effort=THOROUGH)
            best = best if path is None else min(best, path, key=_cost)
    return best


def _cost(path: DiscretePath) -> float:
    return path.cost
