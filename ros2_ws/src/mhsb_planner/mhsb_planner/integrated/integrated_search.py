"""From a start posture to a goal point: a first route soon, then cheaper ones while there is time.

1. straight lines to the goal's postures, those of the least lower bound first;
2. where these leave room, A* over ever finer lattices for what is cheaper than the best so far,
3. and corners taken out and moved, the goal's ψ turned, in ever smaller strides, after each.

The first straight line that is possible is handed out at once, later routes as they are found
(`stages`). All work is limited, so that the answer depends on the clock only where there is a
deadline.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from time import perf_counter

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.goal_region import Angle, Region, is_met
from mhsb_planner.integrated import goals_near, stages
from mhsb_planner.integrated.certificate import least_cost_to
from mhsb_planner.integrated.goal_postures import goal_postures
from mhsb_planner.integrated.route import path_of, patient, price_route, terms
from mhsb_planner.integrated.stages import Work
from mhsb_planner.integrated.task import WITH_AREA, Effort, Route, Task, cells_within
from mhsb_planner.search.area_shortfall import WITHOUT_AREA, AreaTerm
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.lower_bound import ENERGY_ALONE, with_others
from mhsb_planner.search.s2_search import SAME_POINT, SEARCHING, Weights
from mhsb_planner.search.s2_step import ENERGY_COLUMN, EnergyReading
from mhsb_planner.search.search_time import SearchTime

__all__ = ["Effort", "IntegratedSearch", "Route", "Task", "search"]


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
        goal_psi: Angle = None,
        goal_region: Region | None = None,
        certified_from: FloatArray | None = None,
        area: AreaTerm = WITHOUT_AREA,
        others: tuple[float, float] = (0.0, 0.0),
        leaks: bool = True,
        time: SearchTime | None = None,
        effort: Effort | None = None,
    ) -> None:
        """From a posture [rad] and the modes in force to a tip position [m].

        goal_psi        end-link angle asked for at the goal [rad]; None: whichever costs least
        goal_region     where else the tip may end
        certified_from  posture from which the lower bound counts; the start where left out [rad]
        area            weight of the polytope's area, and the area that counts as full
        others          oil [m³] and least time [s] of what moves meanwhile, for the lower bound
        leaks           whether routes are chosen by what leaks while they last; what paths cost is
                        told with it either way
        time            when to end, and whether there is a motion along one of the paths

        Raises OutOfWorkspaceError, InfeasibleGoalError, ZoneError, DeadlineError.
        """
        self._began, time = perf_counter(), time or SearchTime()
        effort = effort or (WITH_AREA if area.weight > 0.0 else Effort())
        effort = effort.for_size(machine.scale)
        time.until.check(SEARCHING)
        posture = np.array(start_posture, dtype=np.float64)
        self._modes = np.array(start_modes, dtype=np.uint8)
        goals = goal_postures(machine, *goal_xz, goal_psi, effort.psi_spacing, goal_region)
        self._standing = is_met(
            goal_xz,
            goal_region,
            goal_psi,
            machine.tip_position(posture),
            machine.end_link_angle(posture),
            SAME_POINT,
            SAME_POINT,
        )
        time.until.check(SEARCHING)
        weight = np.array([weights.energy, weights.time, weights.switches], dtype=np.float64)
        self._terms = terms(machine, self._modes, weight, ENERGY_COLUMN[energy_reading], area)
        priced_by = self._terms if leaks else patient(self._terms)
        goals = goals_near.with_those_near(machine, goals, posture, priced_by.circuit, weight)
        self._task = Task.of(machine, posture, priced_by, goals, time, effort)
        time.until.check(SEARCHING)
        origin = posture if certified_from is None else certified_from
        self.lower_bound = self._least_energy(origin, others)

    def _least_energy(self, posture: FloatArray, others: tuple[float, float]) -> float:
        """No plan from a posture takes less [J]."""
        task, (energy, time) = self._task, self._terms.weight[:2]
        own = task.terms is self._terms and not any(others)
        if energy > 0.0 and time == 0.0 and own and np.array_equal(posture, task.start):
            return task.bound / float(energy)
        origin = task.machine.cylinder_lengths(posture)
        circuit = with_others(self._terms.circuit, *others)
        cells = cells_within(task.time)
        return least_cost_to(task.machine, circuit, origin, task.goals, ENERGY_ALONE, cells)

    def paths(self) -> Iterator[DiscretePath | None]:
        """Ever cheaper paths; None where what follows may take long: others may be quicker now.

        A start at the goal gives a path without steps. Raises, at its end, NoPathError where there
        is no path, DeadlineError where none was found in time.
        """
        task = self._task
        if self._standing:
            tip = task.machine.tip_position(task.start)
            yield DiscretePath.standing(tip, task.start, self._modes, self._seconds)
            return
        work = Work()
        for best in stages.routes(task, work):
            yield None if best is None else self._path(best, work)

    def last(self) -> DiscretePath:
        """The cheapest path that is found; raises as `paths`."""
        return [path for path in self.paths() if path is not None][-1]

    def along(self, via: FloatArray, spacings: tuple[float, ...]) -> DiscretePath | None:
        """See `improved`."""
        task = self._task
        off = np.abs(task.goals.postures.length - via[-1]).max(axis=1)
        route = task.to_goal(via, int(np.argmin(off)), task.price(via))
        if route.cost == math.inf:
            return None
        for spacing in spacings:
            route = stages.refined(task, route, spacing, task.effort.sweeps)
        return self._path(route, Work())

    @property
    def _seconds(self) -> float:
        """Since the search began [s]."""
        return perf_counter() - self._began

    def _path(self, best: Route, work: Work) -> DiscretePath:
        task, cost = self._task, best.cost
        if task.terms is not self._terms:
            cost = float(price_route(self._terms, task.memory, best.via, task.start, math.inf))
        return path_of(
            self._terms,
            task.memory,
            best.via,
            cost,
            task.start,
            self._modes,
            self.lower_bound,
            SearchStatistics(
                work.expanded, work.priced, self._seconds, task.time.until.passed
            ),
        )


def search(
    machine: Machine,
    start_posture: FloatArray,
    start_modes: ModeArray,
    goal_xz: tuple[float, float],
    weights: Weights,
    energy_reading: EnergyReading = "paper",
    *,
    goal_psi: Angle = None,
    goal_region: Region | None = None,
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
        goal_region=goal_region,
        area=area,
        time=SearchTime(deadline),
        effort=effort,
    )
    return under_way.last()


def improved(
    machine: Machine,
    start_posture: FloatArray,
    start_modes: ModeArray,
    goal_xz: tuple[float, float],
    weights: Weights,
    energy_reading: EnergyReading = "paper",
    *,
    via: FloatArray,
    spacings: tuple[float, ...],
    effort: Effort,
) -> DiscretePath | None:
    """The path of a route that was found elsewhere, improved by small changes; None: there is none.

    via       float64[points, n] m, cylinder lengths, the last those of one of the goal's postures
    spacings  m, to which the changes are in proportion
    """
    under_way = IntegratedSearch(
        machine, start_posture, start_modes, goal_xz, weights, energy_reading, effort=effort
    )
    return under_way.along(via, spacings)


def warm_up(machine: Machine) -> None:
    """Compile everything that a search can run through, whatever the stages of this one need."""
    task = _example(machine)
    x, z = task.goals.tip
    modes, weights = np.zeros(machine.joint_count, dtype=np.uint8), Weights(1.0, 1.0, 1.0)
    psi = machine.end_link_angle(task.goals.postures.posture[0])
    search(machine, task.start, modes, (x, z), weights, goal_psi=psi, effort=task.effort)
    goal_postures(machine, x, z, None, task.effort.psi_spacing)
    for part in (warm_up_pricing, warm_up_paths, warm_up_lattice, warm_up_refinement):
        part(machine)


def warm_up_pricing(machine: Machine) -> None:
    """Compile what a route's cost takes."""
    task = _example(machine)
    task.price(_line(task))
    goals_near.warm_up(machine, task.start, task.terms.circuit)


def warm_up_paths(machine: Machine) -> None:
    """Compile what becomes of the cheapest route."""
    task = _example(machine)
    modes, statistics = np.zeros(machine.joint_count, dtype=np.uint8), SearchStatistics(0, 0, 0.0)
    path_of(task.terms, task.memory, _line(task), 0.0, task.start, modes, 0.0, statistics)


def warm_up_lattice(machine: Machine) -> None:
    """Compile the search over the lattice."""
    task = _example(machine)
    lattice = stages.lattice(task, task.terms, np.array([0]), task.effort.coarsest)
    lattice.search(math.inf, task.effort.expansions)


def warm_up_refinement(machine: Machine) -> None:
    """Compile what improves a route."""
    task = _example(machine)
    stages.refined(task, task.to_goal(_line(task), 0, math.inf), task.effort.coarsest)


def _line(task: Task) -> FloatArray:
    """The straight route to the first goal posture."""
    return np.array([task.lengths, task.goals.postures.length[0]])


def _example(machine: Machine) -> Task:
    """A short way in the middle of the joints' ranges, with nothing in its way."""
    machine = machine.without_obstacles()
    low, high = machine.arrays.joint_min, machine.arrays.joint_max
    start, end = low + 0.5 * (high - low), low + 0.52 * (high - low)
    effort = Effort(psi_spacing=0.02, expansions=2, sweeps=1)
    x, z = machine.tip_position(end)
    psi = machine.end_link_angle(end)
    goals = goal_postures(machine, float(x), float(z), psi, effort.psi_spacing)
    modes = np.zeros(machine.joint_count, dtype=np.uint8)
    priced_by = terms(machine, modes, np.ones(3), ENERGY_COLUMN["paper"], AreaTerm(1.0, 1.0))
    return Task.of(machine, start, priced_by, goals, SearchTime(), effort)
