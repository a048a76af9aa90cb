"""The least cost of a move by another way than the planner's: NumPy and SciPy alone.

A lattice in the space of cylinder lengths, finer than any of the planner's; all steps between its
points priced at once in all mode patterns, from the formulas of `s2_step` and with the loads that
are held, as a motion pays for them; SciPy's Dijkstra over points and patterns. Points through which
no route can be cheaper than one that is known are left out. Nothing of the search's code is used
but the postures at the goal.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED, ON_RAIL, Mode
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.integrated.goal_postures import goal_postures
from mhsb_planner.integrated.goals_near import with_those_near
from mhsb_planner.search.s2_search import Weights
from mhsb_planner.search.s2_step import circuit_of

SPACING = 2.5e-3
"""Between the lattice's points along each cylinder, about, of an arm of the paper's size [m]."""

CELLS = 25
"""Steps of the longest stroke to the goal, at least."""

MOST_POINTS, MOST_LOOKED_AT = 30_000, 400_000
"""Where more points could be on a cheaper route, or are to be asked whether, the lattice is made
coarser."""

PSI_SPACING = math.radians(0.5)
SAMPLES = 2000
"""Of each joint's range, to choose the lattice's angles by."""

HELD, REST_SPEED = 1e-6, 2e-4  # m, m/s

FASTEST = 1.0 + 1e-9
"""Of V_max: no step is faster, however it is rounded."""

TINY = float(np.finfo(float).tiny)
"""Instead of a cost of 0, which SciPy takes for no step."""


def least_cost(
    machine: Machine,
    start: FloatArray,
    goal: tuple[float, float],
    weights: Weights,
    known: float,
    holding: bool = True,
) -> tuple[float, FloatArray | None]:
    """Least cost from a posture [rad], in N, to a tip position [m], reading `paper`.

    known    cost of a route; dearer ones are not looked for
    holding  whether cylinders at rest are boosted where P_S does not carry their load; on a lattice
             those that move slowly rest in between, so that either may be the better guess

    Returns also the route's cylinder lengths, float64[points, n] m; inf and None where nothing
    cheaper is found. Obstacles are not looked at.
    """
    pricing = _Pricing(machine, weights, REST_SPEED if holding else 0.0)
    circuit = circuit_of(machine.arrays, machine.patterns)
    weight = np.array([weights.energy, weights.time, weights.switches])
    among = goal_postures(machine, *goal, spacing=PSI_SPACING)
    goals = with_those_near(machine, among, start, circuit, weight).postures.posture
    return _Lattice(pricing, start, goals, known).cheapest()


class _Demands(NamedTuple):
    """What k steps ask of their cylinders, whatever the pattern, float64[k, n] each.

    stroke m, area m², oil m³
    valve   by which its drop grows with the speed squared [Pa s²/m²]
    worst   load pressure on the way [Pa], −∞ where no boost is asked for
    middle  load pressure half-way [Pa]
    more    what its valve leaks more where it is boosted [m³/s]
    loads   whether it moves, or rests under a load that P_S does not carry, bool[k, n]
    """

    stroke: FloatArray
    area: FloatArray
    oil: FloatArray
    valve: FloatArray
    worst: FloatArray
    middle: FloatArray
    more: FloatArray
    loads: np.ndarray


class _Pricing:
    """Costs of steps, many at a time; the symbols are those of `s2_step`."""

    def __init__(self, machine: Machine, weights: Weights, rest_speed: float) -> None:
        m, self.rest_speed = machine.arrays, rest_speed
        self.m = m
        self.machine, self.weights, self.patterns = machine, weights, machine.patterns
        self.cap, self.rod = m.cap_area, m.rod_area
        self.shared = m.main_pump_flow - len(m.cap_area) * m.leakage_flow
        self.boosted = np.array([[bool(BOOSTED[mode]) for mode in p] for p in self.patterns])
        self.on_rail = np.array([[bool(ON_RAIL[mode]) for mode in p] for p in self.patterns])

    def lengths(self, postures: FloatArray) -> FloatArray:
        """float64[k, n] m."""
        return np.array([self.machine.cylinder_lengths(q) for q in postures])

    def arms(self, postures: FloatArray) -> FloatArray:
        """float64[k, n] m."""
        return np.array([self.machine.moment_arms(q) for q in postures])

    def forces(self, postures: FloatArray, arms: FloatArray) -> FloatArray:
        """Of the cylinders, float64[k, n] N: ∂U/∂q of the masses beyond a joint, over its arm."""
        m = self.m
        angle, out = self._turned_and_out(postures)
        center, length = m.link_center + out, m.link_length + out
        torque, lifted = np.zeros_like(angle), np.zeros_like(angle)
        for i in range(angle.shape[1]):  # mass of link i, and of what hangs on its end
            beyond = m.payload + m.link_mass[i + 1 :].sum()
            moment = np.cos(angle[:, i]) * (m.link_mass[i] * center[:, i] + beyond * length[:, i])
            torque[:, : i + 1] += m.gravity * moment[:, None]
            lifted[:, i] = m.gravity * (m.link_mass[i] + beyond) * np.sin(angle[:, i])
        return np.where(m.slides, lifted, torque) / arms

    def _turned_and_out(self, postures: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Angles of the links [rad], and how far they are out [m], float64[k, n] each."""
        out = np.where(self.m.slides, postures, 0.0)
        return np.cumsum(postures - out, axis=1), out

    def excess(self, postures: FloatArray) -> FloatArray:
        """How far the tip is out of the workspace, float64[k] m."""
        m = self.m
        angle, out = self._turned_and_out(postures)
        length = m.link_length + out
        x, z = (np.cos(angle) * length).sum(axis=1), (np.sin(angle) * length).sum(axis=1)
        radius = np.hypot(x, z)
        return np.max([m.min_x - x, m.min_radius - radius, radius - m.max_radius], axis=0)

    def bound(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """What a way between lengths float64[…, n] costs at least."""
        m, delta = self.m, end - start
        oil = _total(np.where(delta > 0.0, self.cap, self.rod) * np.abs(delta))
        time = np.maximum(_most(np.abs(delta) / m.max_piston_speed), oil / self.shared)
        leakage = delta.shape[-1] * m.leakage_flow + m.idle_leakage
        energy = m.supply_pressure * (oil + leakage * time)
        return np.asarray(self.weights.energy * energy + self.weights.time * time)

    def load_pressure(self, force: FloatArray, out: np.ndarray) -> FloatArray:
        """p_L, extending where `out`, of forces [N]."""
        tank = self.m.tank_pressure
        extending = (force + self.rod * tank) / self.cap
        return np.where(out, extending, (-force + self.cap * tank) / self.rod)

    def more_leakage(self, supply: FloatArray) -> FloatArray:
        """What a valve leaks more at these supply pressures [Pa] than at P_S [m³/s]."""
        m = self.m
        drop = np.clip(supply, m.supply_pressure, m.max_boost_pressure) - m.tank_pressure
        rated = m.supply_pressure - m.tank_pressure
        return np.asarray(m.leakage_flow * (np.sqrt(drop / rated) - 1.0))

    def steps(
        self, delta: FloatArray, forces: tuple[FloatArray, FloatArray, FloatArray]
    ) -> FloatArray:
        """w₁ E + w₂ T of k steps by delta float64[k, n] m, float64[k, patterns], inf: no step.

        forces  at their start, middle and end, float64[k, n] N each

        A pattern counts where it boosts exactly what needs it; where none does, those that boost
        more. So most patterns need not be looked at, by what needs boost at rest and at V_max.
        """
        demands = self._demands(delta, forces)
        slow, fast = (self._needed(demands, v) for v in (0.0, FASTEST * self.m.max_piston_speed))
        surely, perhaps = _code(slow), _code(fast)
        cost = np.full((len(delta), len(self.patterns)), np.inf)
        exact = np.zeros(cost.shape, dtype=bool)
        codes = _code(self.boosted)
        for p, code in enumerate(codes):
            rows = np.flatnonzero((surely & ~code | code & ~perhaps) == 0)
            self._put_pattern(p, demands, rows, cost, exact)
        without = np.logical_not(exact.any(axis=1))
        for p, code in enumerate(codes):
            rows = np.flatnonzero(without & (surely & ~code == 0) & (code & ~perhaps != 0))
            self._put_pattern(p, demands, rows, cost, exact)
        cost[np.logical_not(without[:, None] | exact)] = np.inf
        return cost

    def _demands(
        self, delta: FloatArray, forces: tuple[FloatArray, FloatArray, FloatArray]
    ) -> _Demands:
        m, stroke, out = self.m, np.abs(delta), delta > 0.0
        area = np.where(out, self.cap, self.rod)
        valve = (self.cap**3 + self.rod**3) / (m.valve_coefficient**2 * area)
        moves = stroke > HELD
        sign = np.where(out, 1.0, -1.0)
        against = np.max([sign * force for force in forces], axis=0) > 0.0
        pressure = [self.load_pressure(force, out) for force in forces]
        worst = np.where(moves & against, np.max(pressure, axis=0), -np.inf)
        middle = pressure[1]
        shortest = _most(stroke / m.max_piston_speed)[:, None]
        held = [self.load_pressure(force, force > 0.0) for force in forces]
        heaviest = np.max(held, axis=0) + m.boost_margin
        rests = (stroke <= self.rest_speed * shortest) & (self.rest_speed > 0.0)
        rests &= (heaviest > m.supply_pressure) & (heaviest <= m.max_boost_pressure)
        worst = np.where(rests, heaviest - m.boost_margin, worst)
        middle, valve = np.where(rests, held[1], middle), np.where(rests, 0.0, valve)
        more = self.more_leakage(middle + valve * m.max_piston_speed**2 + m.boost_margin)
        return _Demands(stroke, area, stroke * area, valve, worst, middle, more, moves | rests)

    def _needed(self, demands: _Demands, speed: FloatArray | float) -> np.ndarray:
        """What needs boost at these speeds [m/s], bool[k, n]."""
        needs = demands.worst + demands.valve * speed**2 + self.m.boost_margin
        return needs > self.m.supply_pressure

    def _put_pattern(
        self, p: int, of_all: _Demands, rows: IntArray, cost: FloatArray, exact: np.ndarray
    ) -> None:
        """Write what some of the steps cost in a pattern, and whether it boosts what needs it."""
        if len(rows) == 0:
            return
        m, demands = self.m, _Demands(*(column[rows] for column in of_all))
        stroke, oil, boosted = demands.stroke, demands.oil, self.boosted[p]
        loaded = boosted & demands.loads
        modules = m.modules_per_mode[self.patterns[p]]
        pumped = np.where(modules > 0, modules * m.servo_pump_flow, np.inf) / demands.area
        time = _most(stroke / np.minimum(m.max_piston_speed, pumped))
        rail = _most(np.where(self.on_rail[p] & demands.loads, demands.more, 0.0))[:, None]
        leaks = np.where(self.on_rail[p], rail, demands.more) * loaded
        time = np.maximum(time, _total(oil) / (self.shared - _total(leaks)))
        speed = stroke / np.maximum(time[:, None], TINY)
        needs = demands.worst + demands.valve * speed**2 + m.boost_margin
        needed = needs > m.supply_pressure
        possible = np.all(needs <= m.max_boost_pressure, axis=1)
        possible &= np.all(boosted | ~needed, axis=1)
        exact[rows, p] = possible & np.all(np.equal(needed, boosted), axis=1)
        price = np.full(stroke.shape, m.supply_pressure)
        boost = np.maximum(price, demands.middle / m.servo_pump_efficiency)
        price = np.where(loaded, boost, price)
        energy = _total(price * (oil + m.leakage_flow * time[:, None]))
        energy += m.supply_pressure * m.idle_leakage * time
        value = self.weights.energy * energy + self.weights.time * time
        cost[rows, p] = np.where(possible, value, np.inf)

    def to_hold(self, force: FloatArray) -> FloatArray:
        """Cost of the switches to what holds forces[k, n] at rest, float64[k, patterns]."""
        needs = self.load_pressure(force, force > 0.0) + self.m.boost_margin
        hold = np.where(needs > self.m.supply_pressure, Mode.DB, Mode.N)
        changed = (hold[:, None, :] != self.patterns[None, :, :]).sum(axis=2)
        return np.asarray(self.weights.switches * changed, dtype=np.float64)


def _total(values: FloatArray) -> FloatArray:
    """Sum over the joints, the last axis; NumPy's own takes several times as long over so few."""
    return np.asarray(reduce(np.add, np.moveaxis(values, -1, 0)))


def _most(values: FloatArray) -> FloatArray:
    """Largest over the joints, likewise."""
    return np.asarray(reduce(np.maximum, np.moveaxis(values, -1, 0)))


def _code(flags: np.ndarray) -> IntArray:
    """Rows of bool[k, n] as numbers, a bit for each joint."""
    return np.asarray(flags @ (1 << np.arange(flags.shape[1])))


@dataclass
class _Steps:
    """Steps between numbered states."""

    origin: list[IntArray]
    target: list[IntArray]
    cost: list[FloatArray]

    def add(self, origin: IntArray, target: IntArray, cost: FloatArray) -> None:
        """Those that are possible, of arrays of one shape."""
        possible = np.isfinite(cost)
        self.origin.append(origin[possible])
        self.target.append(target[possible])
        self.cost.append(cost[possible])

    def matrix(self, states: int) -> csr_array:
        """For SciPy; there are no parallel steps."""
        between = np.concatenate(self.origin), np.concatenate(self.target)
        cost = np.maximum(np.concatenate(self.cost), TINY)
        return csr_array((cost, between), shape=(states, states))


class _Lattice:
    """Points of a lattice through which a route may be cheaper than a known one."""

    def __init__(
        self, pricing: _Pricing, start: FloatArray, goals: FloatArray, known: float
    ) -> None:
        self._pricing, self._known, self._goals = pricing, known, goals
        self._goal_lengths = pricing.lengths(goals)
        here = pricing.lengths(start[None, :])[0]
        self._worth_it = self._goal_lengths[pricing.bound(here, self._goal_lengths) < known]
        stroke = np.max(np.abs(self._worth_it - here), initial=1e-3)
        spacing = min(SPACING * pricing.machine.scale, stroke / CELLS)
        while not self._lay_out(start, here, spacing):
            spacing *= 1.1

    def _lay_out(self, start: FloatArray, here: FloatArray, spacing: float) -> bool:
        """Choose the points; whether they are not too many."""
        pricing, axes = self._pricing, self._axes(start, spacing)
        shape = tuple(len(axis) for axis in axes)
        if math.prod(shape) > MOST_LOOKED_AT:
            return False
        grids = np.indices(shape).reshape(len(shape), -1).T
        angle = np.stack([axis[grids[:, j]] for j, axis in enumerate(axes)], axis=1)
        lengths = [self._along(start, j, axis, pricing.lengths) for j, axis in enumerate(axes)]
        length = np.stack([axis[grids[:, j]] for j, axis in enumerate(lengths)], axis=1)
        spent = pricing.bound(here, length)
        near = np.flatnonzero(spent < self._known)
        length, left = length[near], np.full(len(near), np.inf)
        for goal in self._worth_it:
            left = np.minimum(left, pricing.bound(length, goal))
        worth = np.flatnonzero(spent[near] + left < self._known)
        kept = near[worth]
        if len(kept) > MOST_POINTS:
            return False
        self.place = grids[kept]
        if len(kept) == 0:
            return True
        self.shape, self.spacing = np.array(shape), 1.001 * spacing
        self.angle, self.length = angle[kept], length[worth]
        self.number = np.full(shape, -1)
        self.number[tuple(self.place.T)] = np.arange(len(kept))
        self.here = int(np.argmin(np.abs(self.angle - start).max(axis=1)))
        arms = [self._along(start, j, axis, pricing.arms) for j, axis in enumerate(axes)]
        of_points = np.stack([axis[self.place[:, j]] for j, axis in enumerate(arms)], axis=1)
        self.force = pricing.forces(self.angle, of_points)
        self.excess = pricing.excess(self.angle)
        halves = [0.5 * (axis[1:] + axis[:-1]) for axis in axes]
        self.halves = [
            self._along(start, j, half, pricing.arms) for j, half in enumerate(halves)
        ]
        self.arms = arms
        return True

    def _axes(self, start: FloatArray, spacing: float) -> list[FloatArray]:
        """Angles of each joint, the start's among them, about evenly long in its cylinder [rad]."""
        m, axes = self._pricing.m, []
        for j, q in enumerate(start):
            dense = np.linspace(m.joint_min[j], m.joint_max[j], SAMPLES)
            length = self._along(start, j, dense, self._pricing.lengths)
            at = np.interp(q, dense, length)
            low, high = min(length[0], length[-1]), max(length[0], length[-1])
            below, above = math.floor((at - low) / spacing), math.floor((high - at) / spacing)
            steps = np.arange(-below, above + 1)
            steps = steps[self._worth(j, at, at + spacing * steps)]
            order = np.argsort(length)
            angles = np.interp(at + spacing * steps, length[order], dense[order])
            angles[steps == 0] = q
            axes.append(angles)
        return axes

    def _worth(self, j: int, here: float, length: FloatArray) -> np.ndarray:
        """Lengths of cylinder j [m] to which routes may lead, by what this cylinder alone takes."""
        alone, n = np.eye(len(self._goal_lengths[0]))[j], len(length)
        there = np.full(n, np.inf)
        for goal in self._goal_lengths[:, j]:
            there = np.minimum(there, self._pricing.bound(length[:, None] * alone, goal * alone))
        return self._pricing.bound(here * alone, length[:, None] * alone) + there < self._known

    @staticmethod
    def _along(
        start: FloatArray, j: int, angles: FloatArray, of: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """What `of` gives for joint j at these angles [rad]; the others do not matter."""
        postures = np.repeat(start[None, :], len(angles), axis=0)
        postures[:, j] = angles
        return of(postures)[:, j]

    def cheapest(self) -> tuple[float, FloatArray | None]:
        """Cost and cylinder lengths of the cheapest route."""
        patterns, w_switch = len(self._pricing.patterns), self._pricing.weights.switches
        count = len(self.place)
        if count == 0:
            return math.inf, None
        sink = count * patterns
        steps = _Steps([], [], [])
        for move in itertools.product((-1, 0, 1), repeat=len(self.shape)):
            if any(move):
                self._add_moves(steps, np.array(move))
        ends = self._add_endings(steps, sink)
        modes = self._pricing.patterns
        apart = np.count_nonzero(modes[:, None, :] != modes[None, :, :], axis=2)
        one, other = np.nonzero(apart == 1)
        base = patterns * np.arange(count)[:, None]
        switching = np.full((count, len(one)), w_switch)
        steps.add(base + one, base + other, switching)
        begin = self.here * patterns + int(np.flatnonzero(~modes.any(axis=1))[0])
        cost, before = dijkstra(
            steps.matrix(sink + 1), indices=begin, return_predecessors=True, limit=self._known
        )
        if not np.isfinite(cost[sink]):
            return math.inf, None
        way, state = [], int(before[sink])
        last = state
        while state != begin and state >= 0:
            way.append(state // patterns)
            state = int(before[state])
        points = [self.here, *[k for k, _ in itertools.groupby(way[::-1])]]
        goal = self._goal_lengths[ends.flat[last]]
        return float(cost[sink]), np.vstack([self.length[points], goal])

    def _add_moves(self, steps: _Steps, move: IntArray) -> None:
        """The steps from all points by one and the same move of their places."""
        place = self.place + move
        inside = np.flatnonzero(np.all((place >= 0) & (place < self.shape), axis=1))
        target = self.number[tuple(place[inside].T)]
        origin, target = inside[target >= 0], target[target >= 0]
        middle = 0.5 * (self.angle[origin] + self.angle[target])
        arms = np.empty_like(middle)
        for j, way in enumerate(move):
            at = self.place[origin, j]
            arms[:, j] = self.arms[j][at] if way == 0 else self.halves[j][at + min(way, 0)]
        forces = self.force[origin], self._pricing.forces(middle, arms), self.force[target]
        cost = self._pricing.steps(self.length[target] - self.length[origin], forces)
        allowed = np.maximum(1e-9, self.excess[origin])
        out = (self.excess[target] > allowed) | (self._pricing.excess(middle) > allowed + 1e-5)
        cost[out] = np.inf
        self._add(steps, origin, target[:, None] * len(self._pricing.patterns), cost)

    def _add(
        self, steps: _Steps, origin: IntArray, target: IntArray, cost: FloatArray
    ) -> None:
        """Steps in a pattern from the state of that pattern, switches being steps of their own."""
        own = np.arange(cost.shape[1])
        start = origin[:, None] * cost.shape[1] + own
        steps.add(start, target + own, cost)

    def _add_endings(self, steps: _Steps, sink: int) -> IntArray:
        """Steps to the goal from points around its postures; which of these each state ends in."""
        pricing = self._pricing
        count, patterns = len(self.place), len(pricing.patterns)
        forces = pricing.forces(self._goals, pricing.arms(self._goals))
        hold = pricing.to_hold(forces)
        least, end = np.full((count, patterns), np.inf), np.zeros((count, patterns), dtype=int)
        for k, goal in enumerate(self._goal_lengths):
            near = np.flatnonzero(np.all(np.abs(self.length - goal) <= self.spacing, axis=1))
            if len(near) == 0:
                continue
            middle = 0.5 * (self.angle[near] + self._goals[k])
            between = pricing.forces(middle, pricing.arms(middle))
            there = np.repeat(forces[k][None, :], len(near), axis=0)
            cost = pricing.steps(goal - self.length[near], (self.force[near], between, there))
            cost += hold[k]
            better = cost < least[near]
            least[near] = np.where(better, cost, least[near])
            end[near] = np.where(better, k, end[near])
        steps.add(np.arange(sink).reshape(least.shape), np.full(least.shape, sink), least)
        return end
