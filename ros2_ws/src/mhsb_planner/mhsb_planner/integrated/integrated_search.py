"""From a start posture to a goal point: the best route found in the time there is.

1. straight lines to the goal's postures, those of the least lower bound first;
2. where these leave room, A* over a lattice for what is cheaper than the best of them;
3. corners taken out and moved, the goal's ψ turned, in ever smaller strides.

Every stage starts from the best route so far, so there is an answer as soon as there is a way.
The work of each stage is limited, so that the answer depends on the clock only where a budget is
given and the processor is slower than it has to be.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_planner.errors import NoPathError
from mhsb_planner.integrated.certificate import least_cost_to
from mhsb_planner.integrated.goal_postures import PSI_SPACING, GoalPostures, goal_postures
from mhsb_planner.integrated.lattice import LatticeSearch
from mhsb_planner.integrated.refinement import shortcut, sweep
from mhsb_planner.integrated.route import (
    Memory,
    Terms,
    least_step,
    new_memory,
    path_of,
    price_route,
    terms,
)
from mhsb_planner.search.area_shortfall import WITHOUT_AREA, AreaTerm
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.s2_search import SAME_POINT, Weights
from mhsb_planner.search.s2_step import ENERGY_COLUMN, EnergyReading, Postures

SEARCH_SHARE = 0.4
"""Of the budget; the rest is for the trajectory."""

GOOD_ENOUGH = 1e-3
"""A route within this share of the lower bound is not improved further."""

WORTH_A_LATTICE = 1e-2
"""Likewise, for the lattice to be searched."""

SPARSE = 3
"""Straight lines lead to one in so many goal postures first."""


@dataclass(frozen=True)
class Effort:
    """How hard is sought.

    psi_spacing  rad, between the goal postures
    cells        lattice steps between start and the farthest goal posture that is worth a thought
    margin       lattice points beyond start and goal postures
    finest       m, least spacing of the lattice
    coarsest     m, largest
    expansions   states of the lattice to expand, at most
    strides      lengths of the compass search's strides, as shares of the lattice's spacing
    turn         rad, by which ψ is turned per stride of one spacing
    sweeps       rounds for each stride, at most
    """

    psi_spacing: float = PSI_SPACING
    cells: int = 8
    margin: int = 6
    finest: float = 1e-3
    coarsest: float = 10e-3
    expansions: int = 300
    strides: tuple[float, ...] = (0.5, 0.25, 0.1)
    turn: float = 0.1
    sweeps: int = 3


@dataclass(frozen=True, eq=False)
class Route:
    """A polygon of cylinder lengths, where it ends, and its cost with the best modes.

    via         float64[points, n] m
    elbow, psi  of the goal posture at its end
    cost        w₁ E + w₂ T + w₃ switches
    """

    via: FloatArray
    elbow: int
    psi: float
    cost: float


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked for, and what every stage needs of it.

    start    float64[n] rad; lengths float64[n] m, of its cylinders
    bound    no route costs less
    least    float64[goals], no route to that goal posture costs less
    deadline of the processor's clock [s]
    """

    machine: Machine
    terms: Terms
    memory: Memory
    start: FloatArray
    lengths: FloatArray
    goals: GoalPostures
    bound: float
    least: FloatArray
    deadline: float
    effort: Effort

    @property
    def late(self) -> bool:
        """Whether the time is up."""
        return time.perf_counter() > self.deadline

    def price(self, via: FloatArray, limit: float = math.inf) -> float:
        """Cost of a route, inf where it reaches the limit or is not possible."""
        return float(price_route(self.terms, self.memory, via, self.start, limit))

    def to_goal(self, via: FloatArray, k: int, cost: float) -> Route:
        """Route to the goal posture k."""
        return Route(via, int(self.goals.elbow[k]), float(self.goals.psi[k]), cost)


def search(
    machine: Machine,
    start_posture: FloatArray,
    start_modes: ModeArray,
    goal_xz: tuple[float, float],
    weights: Weights,
    energy_reading: EnergyReading = "paper",
    *,
    goal_psi: float | None = None,
    budget: float | None = None,
    certified_from: FloatArray | None = None,
    area: AreaTerm = WITHOUT_AREA,
    effort: Effort | None = None,
) -> DiscretePath:
    """Path from a posture [rad] and the modes in force to a tip position [m].

    goal_psi        end-link angle asked for at the goal [rad]; None: whichever costs least
    budget          s, for the whole plan; when the search's share is over, the best so far is taken
    certified_from  posture from which the lower bound counts; the start where left out [rad]
    area            weight of the polytope's area, and the area that counts as full

    A start at the goal gives a path without steps. Raises OutOfWorkspaceError,
    InfeasibleGoalError, ZoneError, NoPathError.
    """
    began = time.perf_counter()
    effort = effort or Effort()
    posture = np.array(start_posture, dtype=np.float64)
    modes = np.array(start_modes, dtype=np.uint8)
    goals = goal_postures(machine, *goal_xz, goal_psi, effort.psi_spacing)
    if _is_at(machine, posture, goals):
        tip, seconds = machine.tip_position(posture), time.perf_counter() - began
        return DiscretePath.standing(tip, posture, modes, seconds)
    weight = np.array([weights.energy, weights.time, weights.switches], dtype=np.float64)
    deadline = math.inf if budget is None else began + SEARCH_SHARE * budget
    priced_by = terms(machine, modes, weight, ENERGY_COLUMN[energy_reading], area)
    task = _task(machine, posture, priced_by, goals, deadline, effort)
    best = _straight(task)
    expanded = priced = 0
    if _leaves_room(task, best, WORTH_A_LATTICE):
        best, expanded, priced = _over_lattice(task, best)
    if best is None:
        x, z = machine.tip_position(posture)
        raise NoPathError((float(x), float(z)), goals.tip, machine.obstacles.names)
    if _leaves_room(task, best, GOOD_ENOUGH):
        best = _refined(task, best)
    origin = posture if certified_from is None else certified_from
    energy = np.array([1.0, 0.0])
    lower_bound = least_cost_to(
        machine, task.terms.circuit, machine.cylinder_lengths(origin), goals, energy
    )
    return path_of(
        task.terms,
        task.memory,
        best.via,
        best.cost,
        posture,
        modes,
        lower_bound,
        SearchStatistics(expanded, priced, time.perf_counter() - began, task.late),
    )


def _task(
    machine: Machine,
    posture: FloatArray,
    priced_by: Terms,
    goals: GoalPostures,
    deadline: float,
    effort: Effort,
) -> Task:
    lengths = machine.cylinder_lengths(posture)
    to_goals = [least_step(priced_by, lengths, goal) for goal in goals.postures.length]
    bound = least_cost_to(machine, priced_by.circuit, lengths, goals, priced_by.weight)
    return Task(
        machine=machine,
        terms=priced_by,
        memory=new_memory(priced_by),
        start=posture,
        lengths=lengths,
        goals=goals,
        bound=bound,
        least=np.array(to_goals),
        deadline=deadline,
        effort=effort,
    )


def _leaves_room(task: Task, best: Route | None, share: float) -> bool:
    return best is None or best.cost > (1.0 + share) * task.bound


def _straight(task: Task) -> Route | None:
    """The cheapest straight line to one of every few goal postures, or to one beside its end."""
    numbers = np.arange(len(task.least))
    sparse = numbers % SPARSE == 0
    best, end = _cheapest_of(task, numbers[sparse], None)
    near = (best is None) | (np.abs(numbers - end) < SPARSE)
    return _cheapest_of(task, numbers[~sparse & near], best)[0]


def _cheapest_of(
    task: Task, numbers: IntArray, best: Route | None
) -> tuple[Route | None, int]:
    """The best route, or a cheaper straight line to one of these goal postures, and to which."""
    end = -1
    for k in numbers[np.argsort(task.least[numbers], kind="stable")]:
        limit = math.inf if best is None else best.cost
        if task.least[k] >= limit:
            break
        via = np.array([task.lengths, task.goals.postures.length[k]])
        cost = task.price(via, limit)
        if cost < limit:
            best, end = task.to_goal(via, int(k), cost), int(k)
    return best, end


def _spacing(task: Task, best: Route | None) -> float:
    """Spacing of the lattice [m], in proportion to the longest stroke that may be asked for."""
    effort = task.effort
    if best is None:
        worth = task.goals.postures.length
    else:
        worth = np.vstack([best.via, task.goals.postures.length[task.least < best.cost]])
    stroke = float(np.max(np.abs(worth - task.lengths)))
    return min(effort.coarsest, max(effort.finest, stroke / effort.cells))


def _over_lattice(task: Task, best: Route | None) -> tuple[Route | None, int, int]:
    """The cheapest route over the lattice, or the best so far; states expanded, steps priced."""
    effort = task.effort
    limit = math.inf if best is None else best.cost
    worth = np.flatnonzero(task.least < limit)
    lattice = LatticeSearch(
        task.terms,
        task.memory,
        task.machine,
        task.start,
        Postures(*(column[worth] for column in task.goals.postures)),
        _spacing(task, best),
        effort.margin,
    )
    found = lattice.search(limit, effort.expansions, lambda: task.late)
    if found is not None:
        via, k = found
        cost = task.price(via)
        if cost < limit:
            best = task.to_goal(via, int(worth[k]), cost)
    return best, lattice.expanded, lattice.priced


def _refined(task: Task, best: Route) -> Route:
    """The route improved by small changes."""
    t, w, effort = task.terms, task.memory, task.effort
    spacing = _spacing(task, best)
    via, cost = shortcut(t, w, best.via, task.start, best.cost)
    if len(via) == 2:
        via = via[0] + np.linspace(0.0, 1.0, 4)[:, None] * (via[1] - via[0])
    psi = best.psi
    for stride in effort.strides:
        turn = effort.turn * stride if task.goals.free else 0.0
        for _ in range(effort.sweeps):
            if task.late:
                break
            before = cost
            cost, psi = sweep(
                t,
                w,
                via,
                task.start,
                cost,
                task.goals.tip,
                best.elbow,
                psi,
                stride * spacing,
                turn,
            )
            if cost > (1.0 - GOOD_ENOUGH) * before:
                break
    return Route(via, best.elbow, psi, cost)


def _is_at(machine: Machine, posture: FloatArray, goals: GoalPostures) -> bool:
    if math.dist(machine.tip_position(posture), goals.tip) > SAME_POINT:
        return False
    off = np.max(np.abs(goals.postures.posture - posture), axis=1)
    return goals.free or bool(np.any(off <= SAME_POINT))


def warm_up(machine: Machine) -> None:
    """Compile everything that a search can run through, whatever the stages of this one need."""
    low, high = machine.arrays.joint_min, machine.arrays.joint_max
    start, end = low + 0.5 * (high - low), low + 0.52 * (high - low)
    x, z = machine.tip_position(end)
    modes, weights = np.zeros(machine.joint_count, dtype=np.uint8), Weights(1.0, 1.0, 1.0)
    effort = Effort(psi_spacing=1.0, expansions=2, sweeps=1)
    with suppress(MhsbError):
        search(machine, start, modes, (x, z), weights, goal_psi=float(end.sum()), effort=effort)
        goals = goal_postures(machine, x, z, None, effort.psi_spacing)
        priced_by = terms(machine, modes, np.ones(3), ENERGY_COLUMN["paper"], AreaTerm(1.0, 1.0))
        task = _task(machine, start, priced_by, goals, math.inf, effort)
        via = np.array([task.lengths, goals.postures.length[0]])
        _over_lattice(task, None)
        _refined(task, task.to_goal(via, 0, task.price(via)))
