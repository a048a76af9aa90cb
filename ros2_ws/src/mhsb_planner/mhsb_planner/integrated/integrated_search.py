"""From a start posture to a goal point: a first route soon, then cheaper ones while there is time.

1. straight lines to the goal's postures, those of the least lower bound first;
2. where these leave room, A* over a lattice for what is cheaper than the best of them;
3. corners taken out and moved, the goal's ψ turned, in ever smaller strides.

Every stage starts from the best route so far; the first straight line that is possible is handed
out at once. The work of each stage is limited, so that the answer depends on the clock only where
there is a deadline and the processor is slower than it has to be.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.errors import DeadlineError, NoPathError
from mhsb_planner.integrated.certificate import least_cost_to
from mhsb_planner.integrated.goal_postures import PSI_SPACING, GoalPostures, goal_postures
from mhsb_planner.integrated.lattice import LatticeSearch
from mhsb_planner.integrated.refinement import shortcut, sweep
from mhsb_planner.integrated.route import (
    Memory,
    Terms,
    new_memory,
    path_of,
    price_route,
    terms,
)
from mhsb_planner.search.area_shortfall import WITHOUT_AREA, AreaTerm
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.lower_bound import ENERGY_ALONE, least_costs_between
from mhsb_planner.search.s2_search import SAME_POINT, SEARCHING, Weights
from mhsb_planner.search.s2_step import ENERGY_COLUMN, EnergyReading, Postures
from mhsb_planner.search.search_time import SearchTime

GOOD_ENOUGH = 1e-3
"""A route within this share of the lower bound is not improved further."""

WORTH_A_LATTICE = 1e-2
"""Likewise, for the lattice to be searched."""

SPARSE = 3
"""Straight lines lead to one in so many goal postures first."""

WHOLE_RANGE = 10**6
"""Lattice points beyond start and goals that no joint's range has."""

FIRST_LINES = 8
"""So many are tried before something else may come first."""


@dataclass(frozen=True)
class Effort:
    """How hard is sought.

    psi_spacing  rad, between the goal postures
    cells        lattice steps between start and the farthest goal posture that is worth a thought
    margin       lattice points beyond start and goal postures
    finest       m, least spacing of the lattice
    coarsest     m, largest
    expansions   states of the lattice to expand, at most
    whole_range  m, spacings of the lattices that are searched to the end where nothing was found
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
    whole_range: tuple[float, ...] = (10e-3, 5e-3)
    strides: tuple[float, ...] = (0.5, 0.25, 0.1)
    turn: float = 0.1
    sweeps: int = 3


@dataclass(frozen=True, eq=False)
class Route:
    """A polygon of cylinder lengths, where it ends, and its cost with the best modes.

    via         float64[points, n] m
    goal        number of the goal posture that it was led to
    elbow, psi  of the posture at its end, with ψ turned since
    cost        w₁ E + w₂ T + w₃ switches
    """

    via: FloatArray
    goal: int
    elbow: int
    psi: float
    cost: float


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked for, and what every stage needs of it.

    start    float64[n] rad; lengths float64[n] m, of its cylinders
    bound    no route costs less
    least    float64[goals], no route to that goal posture costs less
    """

    machine: Machine
    terms: Terms
    memory: Memory
    start: FloatArray
    lengths: FloatArray
    goals: GoalPostures
    bound: float
    least: FloatArray
    time: SearchTime
    effort: Effort

    @classmethod
    def of(
        cls,
        machine: Machine,
        posture: FloatArray,
        priced_by: Terms,
        goals: GoalPostures,
        time: SearchTime,
        effort: Effort,
    ) -> Task:
        """The task from a posture [rad] to these goals."""
        lengths, reached = machine.cylinder_lengths(posture), goals.postures.length
        return cls(
            machine=machine,
            terms=priced_by,
            memory=new_memory(priced_by),
            start=posture,
            lengths=lengths,
            goals=goals,
            bound=least_cost_to(machine, priced_by.circuit, lengths, goals, priced_by.weight),
            least=least_costs_between(priced_by.circuit, lengths, reached, priced_by.weight),
            time=time,
            effort=effort,
        )

    def price(self, via: FloatArray, limit: float = math.inf) -> float:
        """Cost of a route, inf where it reaches the limit or is not possible."""
        return float(price_route(self.terms, self.memory, via, self.start, limit))

    def to_goal(self, via: FloatArray, k: int, cost: float) -> Route:
        """Route to the goal posture k."""
        return Route(via, k, int(self.goals.elbow[k]), float(self.goals.psi[k]), cost)


class IntegratedSearch:
    """A search under way.

    lower_bound  J, no plan to any posture at the goal takes less energy
    """

    def __init__(
        self,
        machine: Machine,
        start_posture: FloatArray,
        start_modes: ModeArray,
        goal_xz: tuple[float, float],
        weights: Weights,
        energy_reading: EnergyReading = "paper",
        *,
        goal_psi: float | None = None,
        certified_from: FloatArray | None = None,
        area: AreaTerm = WITHOUT_AREA,
        time: SearchTime | None = None,
        effort: Effort | None = None,
    ) -> None:
        """From a posture [rad] and the modes in force to a tip position [m].

        goal_psi        end-link angle asked for at the goal [rad]; None: whichever costs least
        certified_from  posture from which the lower bound counts; the start where left out [rad]
        area            weight of the polytope's area, and the area that counts as full
        time            when to end, and whether there is a motion along one of the paths

        Raises OutOfWorkspaceError, InfeasibleGoalError, ZoneError, DeadlineError.
        """
        self._began, effort, time = perf_counter(), effort or Effort(), time or SearchTime()
        time.until.check(SEARCHING)
        posture = np.array(start_posture, dtype=np.float64)
        self._modes = np.array(start_modes, dtype=np.uint8)
        goals = goal_postures(machine, *goal_xz, goal_psi, effort.psi_spacing)
        time.until.check(SEARCHING)
        weight = np.array([weights.energy, weights.time, weights.switches], dtype=np.float64)
        priced_by = terms(machine, self._modes, weight, ENERGY_COLUMN[energy_reading], area)
        self._task = Task.of(machine, posture, priced_by, goals, time, effort)
        time.until.check(SEARCHING)
        origin = machine.cylinder_lengths(posture if certified_from is None else certified_from)
        self.lower_bound = least_cost_to(machine, priced_by.circuit, origin, goals, ENERGY_ALONE)

    def paths(self) -> Iterator[DiscretePath | None]:
        """Ever cheaper paths; None where no straight line is possible: others may be quicker now.

        A start at the goal gives a path without steps. Raises, at its end, NoPathError where there
        is no path, DeadlineError where none was found in time.
        """
        task = self._task
        if _is_at(task.machine, task.start, task.goals):
            tip = task.machine.tip_position(task.start)
            yield DiscretePath.standing(tip, task.start, self._modes, self._seconds)
            return
        for best, work in _routes(task):
            yield None if best is None else self._path(best, work)

    def last(self) -> DiscretePath:
        """The cheapest path that is found; raises as `paths`."""
        return [path for path in self.paths() if path is not None][-1]

    @property
    def _seconds(self) -> float:
        """Since the search began [s]."""
        return perf_counter() - self._began

    def _path(self, best: Route, work: tuple[int, int]) -> DiscretePath:
        task = self._task
        return path_of(
            task.terms,
            task.memory,
            best.via,
            best.cost,
            task.start,
            self._modes,
            self.lower_bound,
            SearchStatistics(*work, self._seconds, task.time.until.passed),
        )


def search(
    machine: Machine,
    start_posture: FloatArray,
    start_modes: ModeArray,
    goal_xz: tuple[float, float],
    weights: Weights,
    energy_reading: EnergyReading = "paper",
    *,
    goal_psi: float | None = None,
    area: AreaTerm = WITHOUT_AREA,
    deadline: Deadline = NEVER,
    effort: Effort | None = None,
) -> DiscretePath:
    """The cheapest path until the deadline; arguments and errors as of `IntegratedSearch`."""
    under_way = IntegratedSearch(
        machine,
        start_posture,
        start_modes,
        goal_xz,
        weights,
        energy_reading,
        goal_psi=goal_psi,
        area=area,
        time=SearchTime(deadline),
        effort=effort,
    )
    return under_way.last()


def _routes(task: Task) -> Iterator[tuple[Route | None, tuple[int, int]]]:
    """Ever cheaper routes, with the lattice's states expanded and steps priced until then."""
    best: Route | None = None
    told: Route | None = None
    work = 0, 0
    for route in _straight(task):
        if best is None:
            told = route
            yield told, work
        best = route
    if _leaves_room(task, best, WORTH_A_LATTICE):
        best, work = _over_lattice(task, best)
        if best is None:
            best, more = _anywhere(task)
            work = work[0] + more[0], work[1] + more[1]
        if not task.time.found and _is_cheaper(best, told):
            told = best
            yield told, work
    if best is None:
        if task.time.until.passed:
            raise DeadlineError(SEARCHING)
        x, z = task.machine.tip_position(task.start)
        raise NoPathError((float(x), float(z)), task.goals.tip, task.machine.obstacles.names)
    if _leaves_room(task, best, GOOD_ENOUGH):
        best = _refined(task, best)
    if _is_cheaper(best, told):
        yield best, work


def _is_cheaper(route: Route | None, other: Route | None) -> bool:
    """Whether there is a route and it costs less than another, or there is no other."""
    return route is not None and (other is None or route.cost < other.cost)


def _leaves_room(task: Task, best: Route | None, share: float) -> bool:
    """Whether there may be a route that is cheaper by that share, and time to look for it."""
    room = best is None or best.cost > (1.0 + share) * task.bound
    return room and not task.time.until.passed


def _straight(task: Task) -> Iterator[Route | None]:
    """Ever cheaper straight lines to one of every few goal postures, then to one beside its end.

    None where the first few are all impossible, and where the first round has found none.
    """
    numbers = np.arange(len(task.least))
    sparse = numbers % SPARSE == 0
    order = _in_order(task, numbers[sparse])
    best: Route | None = None
    for part in (order[:FIRST_LINES], order[FIRST_LINES:]):
        for line in _cheaper(task, part, best):
            best = line
            yield line
        if best is None:
            yield None
    near = best is None or np.abs(numbers - best.goal) < SPARSE
    yield from _cheaper(task, _in_order(task, numbers[~sparse & near]), best)


def _in_order(task: Task, numbers: IntArray) -> IntArray:
    """Goal postures by the least that they may cost."""
    return numbers[np.argsort(task.least[numbers], kind="stable")]


def _cheaper(task: Task, numbers: IntArray, best: Route | None) -> Iterator[Route]:
    """Straight lines to these goal postures, each cheaper than the best before, while there is
    time."""
    for k in numbers.tolist():
        limit = math.inf if best is None else best.cost
        if task.least[k] >= limit or task.time.until.passed:
            break
        via = np.array([task.lengths, task.goals.postures.length[k]])
        cost = task.price(via, limit)
        if cost < limit:
            best = task.to_goal(via, k, cost)
            yield best


def _spacing(task: Task, best: Route | None) -> float:
    """Spacing of the lattice [m], in proportion to the longest stroke that may be asked for."""
    effort = task.effort
    if best is None:
        worth = task.goals.postures.length
    else:
        worth = np.vstack([best.via, task.goals.postures.length[task.least < best.cost]])
    stroke = float(np.max(np.abs(worth - task.lengths)))
    return min(effort.coarsest, max(effort.finest, stroke / effort.cells))


def _over_lattice(task: Task, best: Route | None) -> tuple[Route | None, tuple[int, int]]:
    """The cheapest route over the lattice, or the best so far; states expanded, steps priced."""
    limit = math.inf if best is None else best.cost
    worth = np.flatnonzero(task.least < limit)
    lattice = _lattice(task, worth, _spacing(task, best), task.effort.margin)
    found = lattice.search(limit, task.effort.expansions, task.time.until)
    if found is not None:
        via, k = found
        cost = task.price(via)
        if cost < limit:
            best = task.to_goal(via, int(worth[k]), cost)
    return best, (lattice.expanded, lattice.priced)


def _anywhere(task: Task) -> tuple[Route | None, tuple[int, int]]:
    """A route over lattices of the joints' whole ranges, ever finer, as long as there is time.

    None: there is no route over the finest either, or time is up.
    """
    expanded = priced = 0
    every = np.arange(len(task.least))
    for spacing in task.effort.whole_range:
        lattice = _lattice(task, every, spacing, margin=WHOLE_RANGE)
        found = lattice.search(math.inf, sys.maxsize, task.time.until)
        expanded, priced = expanded + lattice.expanded, priced + lattice.priced
        if found is not None:
            via, k = found
            return task.to_goal(via, k, task.price(via)), (expanded, priced)
        if task.time.until.passed:
            break
    return None, (expanded, priced)


def _lattice(task: Task, worth: IntArray, spacing: float, margin: int) -> LatticeSearch:
    """The search for those of the goal postures that are worth it."""
    goals = Postures(*(column[worth] for column in task.goals.postures))
    return LatticeSearch(
        task.terms, task.memory, task.machine, task.start, goals, spacing, margin
    )


def _refined(task: Task, best: Route) -> Route:
    """The route improved by small changes."""
    t, w, effort, until = task.terms, task.memory, task.effort, task.time.until
    spacing = _spacing(task, best)
    via, cost = shortcut(t, w, best.via, task.start, best.cost, until)
    if len(via) == 2:
        via = via[0] + np.linspace(0.0, 1.0, 4)[:, None] * (via[1] - via[0])
    psi, tip = best.psi, task.goals.tip
    for stride in effort.strides:
        stroke, turn = stride * spacing, effort.turn * stride if task.goals.free else 0.0
        for _ in range(effort.sweeps):
            before = cost
            cost, psi = sweep(
                t, w, via, task.start, cost, tip, best.elbow, psi, stroke, turn, until
            )
            if cost > (1.0 - GOOD_ENOUGH) * before:
                break
    return Route(via, best.goal, best.elbow, psi, cost)


def _is_at(machine: Machine, posture: FloatArray, goals: GoalPostures) -> bool:
    if math.dist(machine.tip_position(posture), goals.tip) > SAME_POINT:
        return False
    off = np.max(np.abs(goals.postures.posture - posture), axis=1)
    return goals.free or bool(np.any(off <= SAME_POINT))


def warm_up(machine: Machine) -> None:
    """Compile everything that a search can run through, whatever the stages of this one need."""
    task = _example(machine)
    x, z = task.goals.tip
    modes, weights = np.zeros(machine.joint_count, dtype=np.uint8), Weights(1.0, 1.0, 1.0)
    psi = float(task.goals.psi[0])
    search(machine, task.start, modes, (x, z), weights, goal_psi=psi, effort=task.effort)
    goal_postures(machine, x, z, None, task.effort.psi_spacing)
    for part in (warm_up_pricing, warm_up_paths, warm_up_lattice, warm_up_refinement):
        part(machine)


def warm_up_pricing(machine: Machine) -> None:
    """Compile what a route's cost takes."""
    task = _example(machine)
    task.price(_line(task))


def warm_up_paths(machine: Machine) -> None:
    """Compile what becomes of the cheapest route."""
    task = _example(machine)
    modes, statistics = np.zeros(machine.joint_count, dtype=np.uint8), SearchStatistics(0, 0, 0.0)
    path_of(task.terms, task.memory, _line(task), 0.0, task.start, modes, 0.0, statistics)


def warm_up_lattice(machine: Machine) -> None:
    """Compile the search over the lattice."""
    task = _example(machine)
    lattice = _lattice(task, np.array([0]), task.effort.coarsest, task.effort.margin)
    lattice.search(math.inf, task.effort.expansions)


def warm_up_refinement(machine: Machine) -> None:
    """Compile what improves a route."""
    task = _example(machine)
    _refined(task, task.to_goal(_line(task), 0, math.inf))


def _line(task: Task) -> FloatArray:
    """The straight route to the first goal posture."""
    return np.array([task.lengths, task.goals.postures.length[0]])


def _example(machine: Machine) -> Task:
    """A short way in the middle of the joints' ranges, with nothing in its way."""
    machine = machine.without_obstacles()
    low, high = machine.arrays.joint_min, machine.arrays.joint_max
    start, end = low + 0.5 * (high - low), low + 0.52 * (high - low)
    effort = Effort(psi_spacing=1.0, expansions=2, sweeps=1)
    x, z = machine.tip_position(end)
    goals = goal_postures(machine, float(x), float(z), float(end.sum()), effort.psi_spacing)
    modes = np.zeros(machine.joint_count, dtype=np.uint8)
    priced_by = terms(machine, modes, np.ones(3), ENERGY_COLUMN["paper"], AreaTerm(1.0, 1.0))
    return Task.of(machine, start, priced_by, goals, SearchTime(), effort)
