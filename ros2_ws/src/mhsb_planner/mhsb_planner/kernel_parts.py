"""Functions that call all kernels of the planner, in parts that separate processes can compile.

A kernel (a function compiled by numba) is compiled for types of arguments, not for their values.
Calls with the default machine therefore compile the kernels for all machines. The parts that take
longest come first. The last parts use kernels of earlier parts. On two processors, the process with
the step costs is ready before the one with the motions. It takes up the graph search, which uses
its step graph. `mhsb plan` compiles only the parts that its planner and obstacles need, a planner
node compiles all of them.
"""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from mhsb_model.kernels.pool import compile_ahead
from mhsb_model.machine import Machine, load_machine
from mhsb_planner.integrated import integrated_search
from mhsb_planner.integrated.lower_bound import bound_energy_to_goal
from mhsb_planner.motion import s3_clearance, s3_trajectory
from mhsb_planner.motion.energy import compute_energy_of_states
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.search import (
    fixed_j3,
    goal_clearance,
    manipulability_loss,
    s2_search,
    s2_step,
)
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.slewing import among_zones

COARSE_TABLE_SPACING = 0.25
"""Grid spacing of a posture table with few nodes, which is quickly built [m]."""


@cache
def machine() -> Machine:
    """Return the machine with which the kernels are called: the default machine without obstacles.

    The machine is cached.
    """
    return load_machine().without_obstacles()


@cache
def step_graph() -> StepGraph:
    """Return a graph of steps between the postures of a coarse posture table.

    The graph is cached.
    """
    return StepGraph(machine(), build_posture_table(machine(), COARSE_TABLE_SPACING))


def compile_path_pricing() -> None:
    """Compile the kernels by which the integrated planner computes costs of cylinder paths."""
    integrated_search.warm_up_pricing(machine())


def compile_lattice_search() -> None:
    """Compile the lattice search of the integrated planner."""
    integrated_search.warm_up_lattice(machine())


def compile_motion() -> None:
    """Compile the fit of motions from rest: trajectory (S3), mode schedule (S4) and energy."""
    s3_trajectory.warm_up(machine())


def compile_energy_bound() -> None:
    """Compile the lower bound on the energy of plans to a goal, by one call of its function."""
    middle = 0.5 * (machine().arrays.joint_min + machine().arrays.joint_max)
    x, z = machine().tip_position(middle)
    bound_energy_to_goal(machine(), middle, (float(x), float(z)))


def compile_clearance() -> None:
    """Compile the clearance of goals and motions from obstacles."""
    goal_clearance.warm_up(machine())
    s3_clearance.warm_up(machine())


def compile_moving_starts() -> None:
    """Compile the fit of trajectories (S3) for starts in motion."""
    s3_trajectory.warm_up_moving_starts(machine())


def compile_refinement() -> None:
    """Compile the local improvement of cylinder paths of the integrated planner."""
    integrated_search.warm_up_refinement(machine())


def compile_path_conversion() -> None:
    """Compile the conversion of cylinder paths to discrete paths."""
    integrated_search.warm_up_paths(machine())


def compile_step_costs() -> None:
    """Compile the posture table (S1) and the costs of all steps between its postures."""
    step_graph()


def compile_graph_search() -> None:
    """Compile the graph search (S2) and the connection of the goal to the graph."""
    s2_search.warm_up(step_graph())


def compile_fixed_joint_search() -> None:
    """Compile the search of the conventional method, in which joint 3 keeps its position."""
    fixed_j3.warm_up(step_graph())


def compile_polytope_areas() -> None:
    """Compile the computation of velocity-polytope areas along a motion."""
    manipulability_loss.warm_up(machine())


def compile_remaining_kernels() -> None:
    """Compile kernels that only some requests or nodes need, by calls for the default machine.

    They are kernels for zones in space, for the energy of single states, for the costs of single
    steps, and for the integrated planner's search.
    """
    rest = np.zeros((1, machine().joint_count))
    compute_energy_of_states(machine(), np.ones(1), rest, rest, rest.astype(np.uint8))
    among_zones.warm_up(machine())
    s2_step.warm_up(machine())
    integrated_search.warm_up(machine())


def _name_parts(*parts: Callable[[], None]) -> tuple[str, ...]:
    """Return the import paths ("module:function") of functions of this module."""
    return tuple(f"{__name__}:{part.__name__}" for part in parts)


_PATH_PARTS = {
    "fixed": _name_parts(compile_fixed_joint_search),
    "integrated": _name_parts(
        compile_path_pricing, compile_lattice_search, compile_refinement, compile_path_conversion,
        compile_fixed_joint_search,
    ),
}  # fmt: skip
"""Parts that only some path planners need, by name of the planner."""


def list_parts_for_rest(planner: str, *, has_obstacles: bool) -> tuple[str, ...]:
    """List the parts that are needed to plan a motion from rest without zones in space.

    Args:
        planner: Name of the path planner.
        has_obstacles: Whether the arm must keep clear of obstacles.

    Returns:
        Import paths ("module:function") in the order in which the parts are started.
    """
    return (
        *_name_parts(compile_step_costs, compile_motion),
        *_name_parts(compile_graph_search, compile_energy_bound),
        *_PATH_PARTS.get(planner, ()),
        *(_name_parts(compile_clearance) if has_obstacles else ()),
        *_name_parts(compile_polytope_areas),
    )


KERNEL_PARTS = (
    *list_parts_for_rest("integrated", has_obstacles=True),
    *_name_parts(compile_moving_starts, compile_remaining_kernels),
)
"""Import paths of all parts, in the order in which they are started."""


def compile_planner(
    say: Callable[[str], None] | None = None, parts: Sequence[str] = KERNEL_PARTS
) -> None:
    """Compile those kernels of the planner that are not in the cache yet.

    Args:
        say: Function that gets lines of text about the progress. None shows a progress bar instead.
        parts: Import paths ("module:function") of the parts to compile.
    """
    compile_ahead(parts, say)
