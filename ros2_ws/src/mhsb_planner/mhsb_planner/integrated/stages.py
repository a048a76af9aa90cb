"""The stages of the integrated search: straight lines, ever finer lattices, small changes.

Every stage starts from the best route so far. What a coarse lattice finds in a millisecond or two
is, its corners moved, mostly as cheap as what a fine one finds in a second; the fine ones follow as
long as there is time, and leave out all that cannot be cheaper.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mhsb_model.types import IntArray, frozen
from mhsb_planner.errors import DeadlineError, NoPathError
from mhsb_planner.integrated.lattice import LatticeSearch, evenly_long, evenly_turned
from mhsb_planner.integrated.refinement import shortcut, sweep
from mhsb_planner.integrated.route import Terms, price_route
from mhsb_planner.integrated.task import Route, Task
from mhsb_planner.search.s2_search import SEARCHING
from mhsb_planner.search.s2_step import Postures

GOOD_ENOUGH = 1e-3
"""A route within this share of the lower bound is not improved further."""

WORTH_A_LATTICE = 1e-2
"""Likewise, for lattices to be searched."""

WORTH_A_MOTION = 5e-3
"""Share by which a route must be cheaper than the one told before, to be told in between."""

ROUGH = 8e-3
"""Longest stroke within the pieces by which long strides are priced [m]."""

WORTH_REFINING = 1.1
"""Share of the best route's cost up to which what a lattice finds is improved."""

SPARSE = 3
"""Straight lines lead to one in so many goal postures first."""

TURNED = 6.0
"""How far the arm moves per spacing of the lattice in the cylinders, where there are obstacles."""

HASTE = 2.0
"""Of a first route: it may cost so many times as much as the cheapest over the same lattice."""

QUICK = 3
"""Lattices that are searched before it is time for other ways."""

FIRST_LINES = 8
"""So many are tried before something else may come first."""


@dataclass
class Work:
    """States of lattices expanded, and steps priced."""

    expanded: int = 0
    priced: int = 0


def routes(task: Task, work: Work) -> Iterator[Route | None]:
    """Ever cheaper routes; None where what follows may take long: others may be quicker now.

    work  what has been done until then, kept up to date

    Raises NoPathError, DeadlineError at its end where there is no route.
    """
    best: Route | None = None
    told: Route | None = None
    for route in straight(task):
        if best is None:
            told = route
            yield told
        best = route
    if leaves_room(task, best, WORTH_A_LATTICE):
        for route in over_lattices(task, best, work):
            best = route or best
            if route is None:
                yield None
            elif told is None or route.cost < (1.0 - WORTH_A_MOTION) * told.cost:
                told = route
                yield told
    if best is None:
        if task.time.until.passed:
            raise DeadlineError(SEARCHING)
        x, z = task.machine.tip_position(task.start)
        raise NoPathError((float(x), float(z)), task.goals.tip, task.machine.obstacles.names)
    if leaves_room(task, best, GOOD_ENOUGH):
        best = refined(task, best, spacings(task, best)[-1])
    if told is None or best.cost < told.cost:
        yield best


def leaves_room(task: Task, best: Route | None, share: float) -> bool:
    """Whether there may be a route that is cheaper by that share, and time to look for it."""
    room = best is None or best.cost > (1.0 + share) * task.bound
    return room and not task.time.until.passed


# --- Straight lines ------------------------------------------------------------------------------


def straight(task: Task) -> Iterator[Route | None]:
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


# --- Lattices ------------------------------------------------------------------------------------


def spacings(task: Task, best: Route | None) -> list[float]:
    """Spacings of the lattices [m], ever finer.

    In proportion to the longest stroke that may be asked for; where there is no route yet, from
    the coarsest to the narrowest.
    """
    effort = task.effort
    if best is None:
        first, last = effort.coarsest, effort.narrowest
    else:
        worth = np.vstack([best.via, task.goals.postures.length[task.least < best.cost]])
        stroke = float(np.max(np.abs(worth - task.lengths)))
        last = min(effort.narrowest, max(effort.finest, stroke / effort.cells))
        first = min(effort.coarsest, max(last, stroke / 3.0))
    count = math.ceil(math.log(first / last) / math.log(effort.finer) - 1e-9) + 1
    return [first * (last / first) ** (k / max(1, count - 1)) for k in range(count)]


def over_lattices(task: Task, best: Route | None, work: Work) -> Iterator[Route | None]:
    """Ever cheaper routes over ever finer lattices, each improved by small changes.

    So is the best before each. None before those that take long.
    """
    for number, spacing in enumerate(spacings(task, best)):
        if number == QUICK:
            yield None
        if best is not None and leaves_room(task, best, WORTH_A_LATTICE):
            best = refined(task, best, spacing)
            yield best
        for priced_by in _prices(task.terms, best):
            spent = best is not None and work.expanded >= task.effort.expansions
            if spent or not leaves_room(task, best, WORTH_A_LATTICE):
                return
            found = over_lattice(task, priced_by, best, spacing, work)
            if found is not None:
                found = refined(task, found, spacing)
                if best is None or found.cost < best.cost:
                    best = found
                    yield best


def _prices(t: Terms, best: Route | None) -> tuple[Terms, ...]:
    """By what lattices are searched: with and without boost of loads that are held.

    On a lattice a cylinder that moves slowly rests in between, which boosts none in a motion. Where
    there is no route yet, switches cost nothing, so that each point is expanded once.
    """
    without = t._replace(circuit=t.circuit._replace(rest_speed=0.0))
    if best is None:
        return (without._replace(weight=frozen(t.weight * [1.0, 1.0, 0.0])),)
    return t, without


def over_lattice(
    task: Task, priced_by: Terms, best: Route | None, spacing: float, work: Work
) -> Route | None:
    """The cheapest route over a lattice, where it may be made cheaper than the best so far."""
    limit = math.inf if best is None else best.cost
    worth = np.flatnonzero(task.least < limit)
    search = lattice(task, priced_by, worth, spacing)
    left = sys.maxsize if best is None else task.effort.expansions - work.expanded
    found = search.search(limit, left, task.time.until, HASTE if best is None else 1.0)
    work.expanded += search.expanded
    work.priced += search.priced
    if found is None:
        return None
    via, k = found
    cost = task.price(via, WORTH_REFINING * limit)
    return task.to_goal(via, int(worth[k]), cost) if cost < math.inf else None


def lattice(task: Task, priced_by: Terms, worth: IntArray, spacing: float) -> LatticeSearch:
    """The search for those of the goal postures that are worth it."""
    goals = Postures(*(column[worth] for column in task.goals.postures))
    if len(task.terms.obstacles) > 0:
        points = evenly_turned(task.machine, task.start, TURNED * spacing)
    else:
        points = evenly_long(task.machine, task.start, spacing)
    return LatticeSearch(priced_by, task.memory, points, goals)


# --- Small changes -------------------------------------------------------------------------------


def _tip_of(task: Task, route: Route) -> tuple[float, float]:
    """Where a route has its tip at its end [m]."""
    x, z = task.goals.tips[route.goal].tolist()
    return x, z


def refined(task: Task, best: Route, spacing: float) -> Route:
    """The route improved by small changes, in proportion to a lattice's spacing [m].

    First, by long strides, at the prices of a few long pieces; then, by the shortest, at those
    that count.
    """
    via, _ = shortcut(task.terms, task.memory, best.via, task.start, best.cost, task.time.until)
    if len(via) == 2:
        via = via[0] + np.linspace(0.0, 1.0, 4)[:, None] * (via[1] - via[0])
    route = replace(best, via=via, cost=task.price(via))
    rough = task.terms._replace(piece=ROUGH)
    moved = _swept(task, rough, route, spacing, task.effort.strides[:-1])
    moved = replace(moved, cost=task.price(moved.via, route.cost))
    if moved.cost < route.cost:
        route = moved
    route = _swept(task, task.terms, route, spacing, task.effort.strides[-1:])
    return route if route.cost < best.cost else best


def _swept(
    task: Task, t: Terms, route: Route, spacing: float, strides: tuple[float, ...]
) -> Route:
    """The route after rounds of a compass search by these strides, at the prices of t."""
    w, effort, until = task.memory, task.effort, task.time.until
    via, psi, tip = route.via.copy(), route.psi, _tip_of(task, route)
    cost = float(price_route(t, w, via, task.start, math.inf))
    for stride in strides:
        stroke, turn = stride * spacing, effort.turn * stride if task.goals.free else 0.0
        for _ in range(effort.sweeps):
            before = cost
            cost, psi = sweep(
                t, w, via, task.start, cost, tip, route.elbow, psi, stroke, turn, until
            )
            if cost > (1.0 - GOOD_ENOUGH) * before:
                break
    return replace(route, via=via, psi=psi, cost=cost)
