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
from mhsb_planner.integrated.lattice import Lattice, LatticeSearch, evenly_long, evenly_turned
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

ROUGH = 5e-3
"""Longest stroke within the pieces by which long strides are priced, of an arm of the paper's size
[m]."""

WORTH_FINDING, WORTH_REFINING = 1.25, 1.5
"""Shares of the best route's cost up to which routes over a lattice are sought, at its prices, and
what it finds is improved, at those that count: on a lattice most routes are dearer than need be."""

SPARSE = 3
"""Straight lines lead to one in so many goal postures first."""

TURNED = 6.0
"""How far the arm moves per spacing of the lattice in the cylinders, where there are obstacles."""

HASTE = 2.0
"""Of a first route: it may cost so many times as much as the cheapest over the same lattice."""

SOON = 1.3
"""Likewise of what is found over a lattice of four joints and more with a deadline."""

FIRST_STATES = 2000
"""Expanded for such a route; then it is only asked whether there is any, at any cost."""

MOST_POINTS, FEWER = 2**26, 1.25
"""A lattice of more points, which only longer chains than the suite's have, is laid out wider."""

QUICK = 3
"""Lattices that are searched before it is time for other ways."""

FIRST_LINES = 8
"""So many are tried before something else may come first."""


@dataclass
class Work:
    """States of lattices expanded, and steps priced."""

    expanded: int = 0
    priced: int = 0

    def add(self, search: LatticeSearch) -> None:
        """What a search over a lattice has done."""
        self.expanded += search.expanded
        self.priced += search.priced


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
        best = refined(task, best, spacings(task, best)[-1], task.effort.sweeps)
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
    if best is not None:
        beside = np.abs(numbers - best.goal) < SPARSE
        yield from _cheaper(task, _in_order(task, numbers[~sparse & beside]), best)


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

    So is the best before each. None before those that take long, or where half the time is gone.
    """
    for number, spacing in enumerate(spacings(task, best)):
        if number == QUICK or task.time.half_gone:
            yield None
        if best is not None and leaves_room(task, best, WORTH_A_LATTICE):
            best = refined(task, best, spacing)
            yield best
        for priced_by in _prices(task.terms, best):
            spent = best is not None and work.expanded >= task.effort.expansions
            if spent or not leaves_room(task, best, WORTH_A_LATTICE):
                return
            found = over_lattice(task, priced_by, best, spacing, work)
            if found is None and best is None:
                break
            if found is not None and (best is None or not _beside(found, best, spacing)):
                found = refined(task, found, spacing)
                if best is None or found.cost < best.cost:
                    best = found
                    yield best


def _prices(t: Terms, best: Route | None) -> tuple[Terms, ...]:
    """By what lattices are searched: with and without boost of loads that are held.

    On a lattice a cylinder that moves slowly rests in between, which boosts none in a motion. Where
    there is no route yet, switches cost nothing at first, so that each point is expanded once.
    """
    without = t._replace(circuit=t.circuit._replace(rest_speed=0.0))
    if best is None:
        return without._replace(weight=frozen(t.weight * [1.0, 1.0, 0.0])), t
    return without, t


def over_lattice(
    task: Task, priced_by: Terms, best: Route | None, spacing: float, work: Work
) -> Route | None:
    """The cheapest route over a lattice, where it may be made cheaper than the best so far."""
    limit = math.inf if best is None else best.cost
    worth = np.flatnonzero(task.least < limit)
    search = lattice(task, priced_by, worth, spacing)
    if best is not None:
        left = task.effort.expansions - work.expanded
        haste = SOON if task.time.ends and len(task.lengths) > 3 else 1.0
        found = search.search(WORTH_FINDING * limit, left, task.time.until, haste)
        work.add(search)
    else:
        found = search.search(math.inf, FIRST_STATES, task.time.until, HASTE)
        work.add(search)
        if found is None and not search.exhausted:
            search = lattice(task, priced_by, worth, spacing)
            found = search.search(math.inf, sys.maxsize, task.time.until, HASTE, once=True)
            work.add(search)
    if found is None:
        return None
    via, k = found
    cost = task.price(via, WORTH_REFINING * limit)
    return task.to_goal(via, int(worth[k]), cost) if cost < math.inf else None


def _beside(found: Route, best: Route, spacing: float) -> bool:
    """Whether all corners of a dearer route lie within a spacing [m] of the best one."""
    if found.cost < best.cost:
        return False
    start, way = best.via[:-1], np.diff(best.via, axis=0)
    off = found.via[:, None] - start
    share = np.clip((off * way).sum(-1) / np.maximum((way * way).sum(-1), 1e-12), 0.0, 1.0)
    nearest = np.abs(off - share[..., None] * way).max(axis=-1).min(axis=1)
    return bool(nearest.max() < spacing)


def lattice(task: Task, priced_by: Terms, worth: IntArray, spacing: float) -> LatticeSearch:
    """The search for those of the goal postures that are worth it."""
    goals = Postures(*(column[worth] for column in task.goals.postures))
    points = _points(task, spacing)
    while points.shape.prod() > MOST_POINTS:
        spacing *= FEWER
        points = _points(task, spacing)
    return LatticeSearch(priced_by, task.memory, points, goals)


def _points(task: Task, spacing: float) -> Lattice:
    if len(task.terms.obstacles) > 0:
        return evenly_turned(task.machine, task.start, TURNED * spacing)
    return evenly_long(task.machine, task.start, spacing)


# --- Small changes -------------------------------------------------------------------------------


def _tip_of(task: Task, route: Route) -> tuple[float, float]:
    """Where a route has its tip at its end [m]."""
    x, z = task.goals.tips[route.goal].tolist()
    return x, z


def refined(task: Task, best: Route, spacing: float, fine_sweeps: int = 1) -> Route:
    """The route improved by small changes, in proportion to a lattice's spacing [m].

    First by long strides at the prices of long pieces, as far as those that count follow; then by
    the shortest, in so many rounds at most.
    """
    via, _ = shortcut(task.terms, task.memory, best.via, task.start, best.cost, task.time.until)
    if len(via) == 2:
        via = via[0] + np.linspace(0.0, 1.0, 4)[:, None] * (via[1] - via[0])
    route = replace(best, via=via, cost=task.price(via))
    effort, last = task.effort, task.terms.piece
    rough = ROUGH * task.machine.scale
    for stride in effort.strides[:-1]:
        route = _swept(task, route, spacing, stride, effort.sweeps, rough)
    route = _swept(task, route, spacing, effort.strides[-1], fine_sweeps, last)
    return route if route.cost < best.cost else best


def _swept(
    task: Task, route: Route, spacing: float, stride: float, rounds: int, piece: float
) -> Route:
    """The route after rounds of a compass search by one stride, priced by pieces so long [m]."""
    t, w, until = task.terms, task.memory, task.time.until
    rough = t._replace(piece=piece)
    stroke, turn = stride * spacing, task.effort.turn * stride * task.goals.turns
    via, free, tip = route.via.copy(), route.free.copy(), _tip_of(task, route)
    cost = float(price_route(rough, w, via, task.start, math.inf))
    for _ in range(rounds):
        before = cost
        cost = sweep(
            rough, w, via, task.start, cost, tip, route.elbow, free, stroke, turn, until
        )
        counts = cost if piece == t.piece else task.price(via, route.cost)
        if counts < route.cost:
            route = replace(route, via=via.copy(), free=free.copy(), cost=counts)
        if counts > route.cost or cost > (1.0 - GOOD_ENOUGH) * before:
            break
    return route
