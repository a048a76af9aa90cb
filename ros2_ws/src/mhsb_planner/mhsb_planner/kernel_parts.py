"""Everything that the planner compiles, in parts that processes of their own can call.

What a kernel is compiled for are types, not numbers, so the suite's own machine does for all. The
longest parts come first; those at the end need kernels of the ones before.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from mhsb_model.kernels.pool import compile_ahead
from mhsb_model.machine import Machine, load_machine
from mhsb_planner.integrated import integrated_search
from mhsb_planner.motion import s3_trajectory
from mhsb_planner.motion.energy import energy_of_states
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.search import area_shortfall, fixed_j3, goal_clearance, s2_search
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.slewing import among_zones

COARSE = 0.25
"""Spacing of a table with few nodes [m]."""


@cache
def machine() -> Machine:
    """The machine that parts are called for."""
    return load_machine().without_obstacles()


@cache
def step_graph() -> StepGraph:
    """A posture table and the steps between its postures."""
    return StepGraph(machine(), build_posture_table(machine(), COARSE))


def pricing() -> None:
    """Routes of the integrated planner, and their cost."""
    integrated_search.warm_up_pricing(machine())


def postures() -> None:
    """S1: the posture table."""
    build_posture_table(machine(), COARSE)


def lattice() -> None:
    """Search of the integrated planner."""
    integrated_search.warm_up_lattice(machine())


def motion() -> None:
    """S3, S4 and the energy of a motion, and of a part of it."""
    s3_trajectory.warm_up(machine())
    rest = np.zeros((1, machine().joint_count))
    energy_of_states(machine(), np.ones(1), rest, rest, rest.astype(np.uint8))


def refinement() -> None:
    """Improvement of routes."""
    integrated_search.warm_up_refinement(machine())


def paths() -> None:
    """The integrated planner's answer."""
    integrated_search.warm_up_paths(machine())


def steps() -> None:
    """The cost of all steps between the table's postures."""
    step_graph()


def search() -> None:
    """S2: goals joined to the graph, and ways over it."""
    s2_search.warm_up(step_graph())


def fixed() -> None:
    """The conventional method's postures."""
    fixed_j3.warm_up(step_graph())


def others() -> None:
    """What no search leads to by itself."""
    goal_clearance.warm_up(machine())
    among_zones.warm_up(machine())
    area_shortfall.warm_up(machine())
    integrated_search.warm_up(machine())


PARTS = tuple(
    f"{__name__}:{part.__name__}"
    for part in (
        pricing, postures, lattice, motion, steps, refinement, search, paths, fixed, others,
    )
)  # fmt: skip


def compile_planner(say: Callable[[str], None] | None = None) -> None:
    """See to it that the planner compiles nothing later; `say` and the rest as `compile_ahead`."""
    compile_ahead(PARTS, say)
