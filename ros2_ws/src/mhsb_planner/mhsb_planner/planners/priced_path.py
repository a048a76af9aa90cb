"""Discrete path through given postures, for planners that choose postures but not modes."""

from itertools import pairwise

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.planners.path_planner import PathRequest
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.s2_search import SEARCH_TASK
from mhsb_planner.search.s2_step import compute_step_costs


def price_path(
    machine: Machine, request: PathRequest, posture: FloatArray, progress: PlanProgress
) -> DiscretePath | None:
    """Make the discrete path through given postures, with the cheapest modes for each step.

    The cost of a step is w₁ E + w₂ T + w₃ switches: energy, duration, and mode switches from the
    step before. The request's `energy_reading` says how boosted oil is priced in E. The modes of a
    step are chosen without regard to later steps, so other modes may make the whole path cheaper.

    Args:
        machine: The arm without a slewing joint, `StepGraph.machine`.
        request: The request, with weights w, `energy_reading` and the modes in force at the start.
        posture: Joint positions at the ends of the steps, shape (k + 1, n), k ≥ 1 [rad or m].
        progress: State of the planning loop. Its `search_deadline` is checked before each step.

    Returns:
        The path; None if no mode combination can do one of the steps.

    Raises:
        DeadlineError: `progress.search_deadline` passed.
    """
    weights, modes, taken = request.options.weights, request.modes.modes, []
    for start, end in pairwise(posture):
        progress.search_deadline.check(SEARCH_TASK)
        step = compute_step_costs(machine, start, end)
        if not step.admissible.any():
            return None
        energy = step.energy if request.options.energy_reading == "paper" else step.energy_series
        switches = np.count_nonzero(machine.patterns != modes, axis=1)
        cost = weights.energy * energy + weights.time * step.duration + weights.switches * switches
        p = int(np.nanargmin(cost))
        modes = machine.patterns[p]
        taken.append((modes, step.duration[p], step.energy[p], step.energy_series[p], cost[p]))
    chosen, duration, energy, energy_series, costs = map(np.array, zip(*taken, strict=True))
    return DiscretePath(
        tip=machine.tip_positions(posture),
        posture=posture,
        modes=chosen,
        duration=duration,
        energy=energy,
        energy_series=energy_series,
        cost=float(costs.sum()),
        start_modes=request.modes.modes,
        statistics=SearchStatistics(expanded=0, generated=len(taken), seconds=0.0),
    )
