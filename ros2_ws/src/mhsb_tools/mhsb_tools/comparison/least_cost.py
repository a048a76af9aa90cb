"""Least cost of a move by code that is independent of the planner's search: NumPy and SciPy alone.

The method is a lattice in the space of cylinder lengths, finer than any of the planner's. All steps
between its points are priced at once in all mode combinations (patterns), by the formulas of
`s2_step`. Cylinders at rest whose load P_S does not carry may be priced as boosted. SciPy's
Dijkstra algorithm searches over states of lattice point and pattern. Points through which no path
can be cheaper than a known one are left out by a lower bound. Of the planner's search only the
postures at the goal are used.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_model.hydraulics import scale_leakage
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED_MODES, RAIL_MODES, Mode
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.integrated.goal_postures import sample_goal_postures
from mhsb_planner.integrated.ik_near_start import add_postures_near_start
from mhsb_planner.search.s2_search import Weights
from mhsb_planner.search.s2_step import compute_hydraulic_coefficients

LATTICE_SPACING = 2.5e-3
"""Approximate distance of lattice points along each cylinder, for an arm of the paper's size
[m].
"""

MIN_STEPS = 25
"""Least number of lattice steps for the longest stroke to a goal posture."""

MOST_POINTS, MOST_LOOKED_AT = 30_000, 400_000
"""Largest number of lattice points kept, and tested by the lower bound. If there are more, the
lattice is made coarser.
"""

PSI_SPACING = math.radians(0.5)
"""Distance of end-link angles ψ of the goal postures [rad]."""
RANGE_SAMPLES = 2000
"""Number of samples over each joint's range, from which the lattice's angles are interpolated."""

MAX_HELD_STROKE = 1e-6
"""Stroke up to which a cylinder counts as held [m]."""

SPEED_FACTOR = 1.0 + 1e-9
"""Factor on V_max for an upper bound of all speeds that rounding cannot exceed."""

SMALLEST_COST = float(np.finfo(float).tiny)
"""Cost in place of 0, which SciPy takes as a missing edge."""


def search_least_cost(
    machine: Machine,
    start: FloatArray,
    goal: tuple[float, float],
    weights: Weights,
    incumbent_cost: float,
    boosts_held_loads: bool = True,
) -> tuple[float, FloatArray | None]:
    """Search a fine lattice of cylinder lengths for the cheapest path from a posture to a tip.

    All actuators are in mode N (fed by the main pump) at the start. Goal postures too near to an
    obstacle are left out, but the path may pass through obstacles. Boosted oil has the price p_L/η
    (energy reading `paper`), with load pressure p_L and servo pump efficiency η. The result is
    optimal on the lattice; a finer lattice may have a cheaper path.

    Args:
        machine: The planar arm (without the slewing joint).
        start: Start posture, shape (n,) [rad or m].
        goal: Tip position (x, z) [m].
        weights: Weights of energy, time and mode switches.
        incumbent_cost: Cost of the best path known so far; only cheaper paths are searched for.
        boosts_held_loads: Whether a cylinder that rests during a step is boosted if the main pump's
            pressure P_S does not carry its load. A cylinder that moves slowly rests in some steps
            of the lattice, and True prices this boost. False ignores it. Which one estimates the
            cost of a motion better depends on the move.

    Returns:
        Cost of the path, and cylinder lengths at its points, shape (points, n) [m]; the first is
        the start, the last a goal posture. Infinity and None if no path costs less than
        `incumbent_cost`.

    Raises:
        OutOfWorkspaceError: The goal is outside the workspace.
        InfeasibleGoalError: No posture at the goal is within the joint limits.
        ZoneError: All postures at the goal are too near to obstacles.
    """
    pricing = _Pricing(machine, weights, MAX_HELD_SPEED if boosts_held_loads else 0.0)
    circuit = compute_hydraulic_coefficients(machine.arrays, machine.patterns)
    weight = np.array([weights.energy, weights.time, weights.switches])
    among = sample_goal_postures(machine, *goal, spacing=PSI_SPACING)
    goals = add_postures_near_start(machine, among, start, circuit, weight).posture
    return _Lattice(pricing, start, goals, incumbent_cost).find_cheapest_path()


class _Demands(NamedTuple):
    """Quantities of k steps that do not depend on the mode combination, each of shape (k, n).

    Attributes:
        stroke: Length |ΔL| that the cylinder moves [m].
        area: Inlet area of its direction [m²].
        oil: Oil volume, area times stroke [m³].
        valve_coefficient: Valve pressure drop over speed squared [Pa s²/m²]; 0 if the cylinder is
            held in boost.
        highest_load_pressure: Highest load pressure at start, middle and end of the step [Pa]; −∞
            if the cylinder never moves against its load and is not held in boost.
        middle_load_pressure: Load pressure at the middle of the step [Pa].
        additional_leakage: Leakage of the valve at boost pressure minus its leakage at P_S [m³/s].
        is_loaded: Whether the cylinder moves, or rests under a load that P_S does not carry, bool.
    """

    stroke: FloatArray
    area: FloatArray
    oil: FloatArray
    valve_coefficient: FloatArray
    highest_load_pressure: FloatArray
    middle_load_pressure: FloatArray
    additional_leakage: FloatArray
    is_loaded: np.ndarray


class _Pricing:
    """Vectorized step costs of one machine with fixed weights; symbols as in `s2_step`."""

    def __init__(self, machine: Machine, weights: Weights, rest_speed: float) -> None:
        """Store the machine's numbers, and which joints each mode combination boosts.

        Args:
            machine: The arm.
            weights: Weights of the cost.
            rest_speed: Speed up to which a cylinder counts as resting [m/s]. A resting cylinder is
                priced as boosted if the main pump's pressure P_S does not carry its load. 0
                switches this rule off.
        """
        m, self.rest_speed = machine.arrays, rest_speed
        self.m = m
        self.machine, self.weights, self.patterns = machine, weights, machine.patterns
        self.cap, self.rod = m.cap_area, m.rod_area
        self.shared = m.main_pump_flow - len(m.cap_area) * m.leakage_flow
        self.boosted = np.array([[bool(BOOSTED_MODES[mode]) for mode in p] for p in self.patterns])
        self.on_rail = np.array([[bool(RAIL_MODES[mode]) for mode in p] for p in self.patterns])

    def lengths(self, postures: FloatArray) -> FloatArray:
        """Return the cylinder lengths [m] of postures, both of shape (k, n)."""
        return np.array([self.machine.cylinder_lengths(q) for q in postures])

    def arms(self, postures: FloatArray) -> FloatArray:
        """Return the signed moment arms dL/dq [m] of postures, both of shape (k, n)."""
        return np.array([self.machine.moment_arms(q) for q in postures])

    def forces(self, postures: FloatArray, arms: FloatArray) -> FloatArray:
        """Compute the piston forces that hold the arm at rest against gravity.

            F_j = (∂U/∂q_j) / r_j

        U is the potential energy [J] of payload and links, q_j the position of joint j, and r_j the
        moment arm dL_j/dq_j of its cylinder.

        Args:
            postures: Postures, shape (k, n) [rad, telescopes m].
            arms: Moment arms r [m], shape (k, n).

        Returns:
            Forces F [N], shape (k, n), positive if the load resists extension.
        """
        m = self.m
        angle, out = self._link_angles_and_extensions(postures)
        center, length = m.link_center + out, m.link_length + out
        torque, lifted = np.zeros_like(angle), np.zeros_like(angle)
        for i in range(angle.shape[1]):  # mass of link i, and of what hangs on its end
            beyond = m.payload + m.link_mass[i + 1 :].sum()
            moment = np.cos(angle[:, i]) * (m.link_mass[i] * center[:, i] + beyond * length[:, i])
            torque[:, : i + 1] += m.gravity * moment[:, None]
            lifted[:, i] = m.gravity * (m.link_mass[i] + beyond) * np.sin(angle[:, i])
        return np.where(m.slides, lifted, torque) / arms

    def _link_angles_and_extensions(self, postures: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the absolute angle of each link and the extension of each telescope.

        Args:
            postures: Postures, shape (k, n) [rad, telescopes m].

        Returns:
            Angles of the links from the x axis [rad] and extensions [m], each of shape (k, n). The
            extension is 0 for joints that turn.
        """
        out = np.where(self.m.slides, postures, 0.0)
        return np.cumsum(postures - out, axis=1), out

    def workspace_violation(self, postures: FloatArray) -> FloatArray:
        """Compute by how much the tip is outside the workspace.

        The workspace has a smallest x, a smallest radius and a largest radius around the arm's
        base.

        Args:
            postures: Postures, shape (k, n) [rad, telescopes m].

        Returns:
            Largest violation of these three limits [m], shape (k,); negative if the tip is inside.
        """
        m = self.m
        angle, out = self._link_angles_and_extensions(postures)
        length = m.link_length + out
        x, z = (np.cos(angle) * length).sum(axis=1), (np.sin(angle) * length).sum(axis=1)
        radius = np.hypot(x, z)
        return np.max([m.min_x - x, m.min_radius - radius, radius - m.max_radius], axis=0)

    def lower_bound(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Compute a lower bound on the cost of moving from one set of cylinder lengths to another.

            w₁ P_S (Σ A_dir |ΔL| + q_leak T) + w₂ T

        w₁ and w₂ are the weights of energy and time, P_S is the supply pressure [Pa], and ΔL the
        change of a cylinder's length [m]. A_dir is the area of the cap side if the cylinder
        extends, else of the rod side [m²]. q_leak is the leakage of all valves and the external
        leakage [m³/s]. T is the shortest time [s] that V_max (piston speed for planning) and the
        main pump's flow allow.

        Args:
            start: Cylinder lengths [m], shape (…, n).
            end: Cylinder lengths [m], shape (…, n); broadcast against `start`.

        Returns:
            Lower bound for each pair, shape (…).
        """
        m, delta = self.m, end - start
        oil = _total(np.where(delta > 0.0, self.cap, self.rod) * np.abs(delta))
        time = np.maximum(_most(np.abs(delta) / m.max_piston_speed), oil / self.shared)
        leakage = delta.shape[-1] * m.leakage_flow + m.external_leakage
        energy = m.supply_pressure * (oil + leakage * time)
        return np.asarray(self.weights.energy * energy + self.weights.time * time)

    def load_pressure(self, force: FloatArray, extends: np.ndarray) -> FloatArray:
        """Compute the load pressure p_L, which is the supply pressure that piston forces F need.

            p_L = (F + a p_T) / A    extending
            p_L = (-F + A p_T) / a   retracting

        A and a are the areas of cap side and rod side [m²], and p_T is the tank pressure [Pa].

        Args:
            force: Piston forces [N], shape (k, n), positive if the load resists extension.
            extends: True if the cylinder extends, False if it retracts, shape (k, n).

        Returns:
            Load pressure [Pa], shape (k, n).
        """
        tank = self.m.tank_pressure
        extending = (force + self.rod * tank) / self.cap
        return np.where(extends, extending, (-force + self.cap * tank) / self.rod)

    def more_leakage(self, supply: FloatArray) -> FloatArray:
        """Compute how much more a valve leaks at boost pressure than at P_S.

            Δq = q (f((p − p_T)/(P_S − p_T)) − 1)

        q is the leakage of a valve at P_S [m³/s], P_S the main pump's supply pressure, p_T the tank
        pressure [Pa], and f the factor of `hydraulics.scale_leakage`. Before use, p is limited to
        the range from P_S to the highest boost pressure.

        Args:
            supply: Supply pressures p [Pa], any shape.

        Returns:
            Additional leakage Δq [m³/s], same shape.
        """
        m = self.m
        drop = np.clip(supply, m.supply_pressure, m.max_boost_pressure) - m.tank_pressure
        rated = m.supply_pressure - m.tank_pressure
        return np.asarray(m.leakage_flow * (scale_leakage(m.land_leakage, drop / rated) - 1.0))

    def price_steps(
        self, delta: FloatArray, forces: tuple[FloatArray, FloatArray, FloatArray]
    ) -> FloatArray:
        """Compute the cost w₁ E + w₂ T of k steps in every mode combination (pattern).

        E is the energy [J], T the duration [s]; mode switches are not included. Boosted oil has the
        price p_L/η (energy reading `paper`), with load pressure p_L and servo pump efficiency η.
        The duration of a step, and so the piston speeds, depend on the pattern. A pattern is exact
        if it boosts just the cylinders that need boost at its own piston speeds. The patterns
        allowed for a step are:

        - the exact ones, if there are any;
        - otherwise all that boost at least the cylinders that need boost at their piston speeds.

        In both cases, no cylinder may need more than the highest boost pressure.

        Args:
            delta: Change of each cylinder length [m], shape (k, n).
            forces: Piston forces at start, middle and end of the steps [N], each of shape (k, n).

        Returns:
            Costs, shape (k, patterns); infinity if the pattern is not allowed.
        """
        demands = self._demands(delta, forces)
        slow, fast = (
            self._needs_boost(demands, v) for v in (0.0, SPEED_FACTOR * self.m.max_piston_speed)
        )
        surely, perhaps = _code(slow), _code(fast)
        cost = np.full((len(delta), len(self.patterns)), np.inf)
        exact = np.zeros(cost.shape, dtype=bool)
        codes = _code(self.boosted)
        for p, code in enumerate(codes):
            rows = np.flatnonzero((surely & ~code | code & ~perhaps) == 0)
            self._price_pattern(p, demands, rows, cost, exact)
        without = np.logical_not(exact.any(axis=1))
        for p, code in enumerate(codes):
            rows = np.flatnonzero(without & (surely & ~code == 0) & (code & ~perhaps != 0))
            self._price_pattern(p, demands, rows, cost, exact)
        cost[np.logical_not(without[:, None] | exact)] = np.inf
        return cost

    def _demands(
        self, delta: FloatArray, forces: tuple[FloatArray, FloatArray, FloatArray]
    ) -> _Demands:
        """Compute the quantities of k steps that do not depend on the mode combination.

        A cylinder rests in a step if its mean speed in the shortest possible duration is at most
        this object's `rest_speed`. A resting cylinder is held in boost if the main pump's pressure
        P_S does not carry its load but the highest boost pressure does. With `rest_speed` 0, no
        cylinder rests.

        Args:
            delta: Change of each cylinder length [m], shape (k, n).
            forces: Piston forces at start, middle and end of the steps [N], each of shape (k, n).

        Returns:
            The quantities, each of shape (k, n).
        """
        m, stroke, out = self.m, np.abs(delta), delta > 0.0
        area = np.where(out, self.cap, self.rod)
        valve = (self.cap**3 + self.rod**3) / (m.valve_coefficient**2 * area)
        moves = stroke > MAX_HELD_STROKE
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

    def _needs_boost(self, demands: _Demands, speed: FloatArray | float) -> np.ndarray:
        """Return which cylinders need boost at given piston speeds.

        Args:
            demands: Quantities of k steps.
            speed: Piston speeds [m/s], a number or an array that broadcasts to (k, n).

        Returns:
            Flags of shape (k, n), True if p_L + m(v) + margin exceeds P_S. p_L is the highest load
            pressure in the step, m(v) the valve's pressure drop at speed v, margin the machine's
            boost margin and P_S the main pump's pressure, all in Pa.
        """
        needs = (
            demands.highest_load_pressure
            + demands.valve_coefficient * speed**2
            + self.m.boost_margin
        )
        return needs > self.m.supply_pressure

    def _price_pattern(
        self, p: int, of_all: _Demands, rows: IntArray, cost: FloatArray, exact: np.ndarray
    ) -> None:
        """Compute the cost of some of k steps in one mode combination (pattern).

        Writes `cost[rows, p]` and `exact[rows, p]` in place; other elements stay as they are.

        Args:
            p: Index of the pattern.
            of_all: Quantities of all k steps.
            rows: Indices of the steps to price, possibly none.
            cost: Costs, shape (k, patterns). Infinity if the pattern does not boost a cylinder that
                needs boost, or if a cylinder needs more than the highest boost pressure.
            exact: Flags, shape (k, patterns). True if the pattern is possible and boosts exactly
                the cylinders that need boost.
        """
        if len(rows) == 0:
            return
        m, demands = self.m, _Demands(*(column[rows] for column in of_all))
        stroke, oil, boosted = demands.stroke, demands.oil, self.boosted[p]
        loaded = boosted & demands.is_loaded
        modules = m.modules_per_mode[self.patterns[p]]
        pumped = np.where(modules > 0, modules * m.servo_pump_flow, np.inf) / demands.area
        time = _most(stroke / np.minimum(m.max_piston_speed, pumped))
        rail = _most(
            np.where(self.on_rail[p] & demands.is_loaded, demands.additional_leakage, 0.0)
        )[:, None]
        leaks = np.where(self.on_rail[p], rail, demands.additional_leakage) * loaded
        time = np.maximum(time, _total(oil) / (self.shared - _total(leaks)))
        speed = stroke / np.maximum(time[:, None], SMALLEST_COST)
        needs = (
            demands.highest_load_pressure + demands.valve_coefficient * speed**2 + m.boost_margin
        )
        needed = needs > m.supply_pressure
        possible = np.all(needs <= m.max_boost_pressure, axis=1)
        possible &= np.all(boosted | ~needed, axis=1)
        exact[rows, p] = possible & np.all(np.equal(needed, boosted), axis=1)
        price = np.full(stroke.shape, m.supply_pressure)
        boost = np.maximum(price, demands.middle_load_pressure / m.servo_pump_efficiency)
        price = np.where(loaded, boost, price)
        energy = _total(price * (oil + m.leakage_flow * time[:, None]))
        energy += m.supply_pressure * m.external_leakage * time
        value = self.weights.energy * energy + self.weights.time * time
        cost[rows, p] = np.where(possible, value, np.inf)

    def holding_switch_cost(self, force: FloatArray) -> FloatArray:
        """Compute the cost of switching to the mode combination that holds a load at rest.

        An actuator switches to mode DB (boosted by its own servo pump) if load pressure and boost
        margin together exceed the main pump's pressure. Otherwise it switches to mode N (fed by
        the main pump). The number of booster modules is not limited.

        Args:
            force: Piston forces at rest, positive if they resist extension [N], shape (k, n).

        Returns:
            Cost of the switch from each mode combination, shape (k, patterns). It is the weight of
            mode switches, w₃, times the number of actuators that change their mode.
        """
        needs = self.load_pressure(force, force > 0.0) + self.m.boost_margin
        hold = np.where(needs > self.m.supply_pressure, Mode.DB, Mode.N)
        changed = (hold[:, None, :] != self.patterns[None, :, :]).sum(axis=2)
        return np.asarray(self.weights.switches * changed, dtype=np.float64)


def _total(values: FloatArray) -> FloatArray:
    """Return the sum over the last axis, the joints.

    For so few joints this is several times as fast as NumPy's sum.
    """
    return np.asarray(reduce(np.add, np.moveaxis(values, -1, 0)))


def _most(values: FloatArray) -> FloatArray:
    """Return the maximum over the last axis, the joints; faster than NumPy's for so few."""
    return np.asarray(reduce(np.maximum, np.moveaxis(values, -1, 0)))


def _code(flags: np.ndarray) -> IntArray:
    """Return rows of flags as integers with bit j set for a true flag of joint j."""
    return np.asarray(flags @ (1 << np.arange(flags.shape[1])))


@dataclass
class _Steps:
    """Edges of the search graph between states, each of which has an index.

    Attributes:
        origin: Indices of the states in which edges begin, a list of arrays.
        target: Indices of the states in which they end, aligned with `origin`.
        cost: Costs of the edges, aligned with `origin`.
    """

    origin: list[IntArray]
    target: list[IntArray]
    cost: list[FloatArray]

    def add(self, origin: IntArray, target: IntArray, cost: FloatArray) -> None:
        """Append edges to the graph; edges of infinite cost are left out.

        Args:
            origin: Indices of states, any shape.
            target: Indices of states, same shape.
            cost: Costs, same shape; infinity means no edge.
        """
        possible = np.isfinite(cost)
        self.origin.append(origin[possible])
        self.target.append(target[possible])
        self.cost.append(cost[possible])

    def matrix(self, states: int) -> csr_array:
        """Return all edges as a sparse matrix for SciPy.

        Args:
            states: Number of states of the graph.

        Returns:
            Matrix of shape (states, states). Element (i, j) is the cost from state i to state j, at
            least `SMALLEST_COST`. If several edges join two states, SciPy adds their costs, so the
            caller must add each edge only once.
        """
        between = np.concatenate(self.origin), np.concatenate(self.target)
        cost = np.maximum(np.concatenate(self.cost), SMALLEST_COST)
        return csr_array((cost, between), shape=(states, states))


class _Lattice:
    """Lattice in cylinder space, reduced to points that a path cheaper than a known one may pass.

    Below, N is the number of these points.
    """

    def __init__(
        self, pricing: _Pricing, start: FloatArray, goals: FloatArray, known: float
    ) -> None:
        """Lay out the lattice around the start.

        The first spacing is LATTICE_SPACING times the arm's size relative to the paper's arm, but
        at most 1/MIN_STEPS of the longest stroke to a goal posture. It is increased by 10 % again
        and again until the number of points is within MOST_LOOKED_AT and MOST_POINTS.

        Args:
            pricing: Step costs of the machine.
            start: Start posture, shape (n,) [rad or m].
            goals: Goal postures, shape (goals, n) [rad or m].
            known: Cost of the best path known so far. Points that no cheaper path can pass are not
                in the lattice.
        """
        self._pricing, self._known, self._goals = pricing, known, goals
        self._goal_lengths = pricing.lengths(goals)
        here = pricing.lengths(start[None, :])[0]
        self._reachable_goal_lengths = self._goal_lengths[
            pricing.lower_bound(here, self._goal_lengths) < known
        ]
        stroke = np.max(np.abs(self._reachable_goal_lengths - here), initial=1e-3)
        spacing = min(LATTICE_SPACING * pricing.machine.relative_size, stroke / MIN_STEPS)
        while not self._choose_points(start, here, spacing):
            spacing *= 1.1

    def _choose_points(self, start: FloatArray, here: FloatArray, spacing: float) -> bool:
        """Choose the lattice points for one spacing, and store the values that the search needs.

        A point is kept if a path through it may be cheaper than the known path. One lower bound is
        on the cost from the start to the point, another from there to the nearest goal posture.
        Together they must be less than the known cost. With N points kept, the method sets these
        attributes; if N is 0, it sets only `place`, which is then empty:

        - place: lattice indices of each point, shape (N, n)
        - angle, length, force: joint positions [rad or m], cylinder lengths [m] and piston forces
          [N] of each point, each of shape (N, n)
        - excess: distance of the tip outside the workspace [m], shape (N,), negative inside
        - number: index of a point by its lattice indices, −1 if the point is not kept
        - here: index of the point at the start
        - arms: for each joint, moment arms [m] at its lattice positions
        - halves: for each joint, moment arms [m] half-way between neighbouring positions
        - shape: number of lattice positions along each axis
        - spacing: distance of points along each cylinder [m], enlarged by 0.1 % against rounding

        Args:
            start: Start posture, shape (n,) [rad or m].
            here: Cylinder lengths at the start [m], shape (n,).
            spacing: Distance of points along each cylinder [m].

        Returns:
            False if there are too many points; the caller then tries a larger spacing.
        """
        pricing, axes = self._pricing, self._axes(start, spacing)
        shape = tuple(len(axis) for axis in axes)
        if math.prod(shape) > MOST_LOOKED_AT:
            return False
        grids = np.indices(shape).reshape(len(shape), -1).T
        angle = np.stack([axis[grids[:, j]] for j, axis in enumerate(axes)], axis=1)
        lengths = [
            self._evaluate_along_axis(start, j, axis, pricing.lengths)
            for j, axis in enumerate(axes)
        ]
        length = np.stack([axis[grids[:, j]] for j, axis in enumerate(lengths)], axis=1)
        spent = pricing.lower_bound(here, length)
        near = np.flatnonzero(spent < self._known)
        length, left = length[near], np.full(len(near), np.inf)
        for goal in self._reachable_goal_lengths:
            left = np.minimum(left, pricing.lower_bound(length, goal))
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
        arms = [
            self._evaluate_along_axis(start, j, axis, pricing.arms) for j, axis in enumerate(axes)
        ]
        of_points = np.stack([axis[self.place[:, j]] for j, axis in enumerate(arms)], axis=1)
        self.force = pricing.forces(self.angle, of_points)
        self.excess = pricing.workspace_violation(self.angle)
        halves = [0.5 * (axis[1:] + axis[:-1]) for axis in axes]
        self.halves = [
            self._evaluate_along_axis(start, j, half, pricing.arms) for j, half in enumerate(halves)
        ]
        self.arms = arms
        return True

    def _axes(self, start: FloatArray, spacing: float) -> list[FloatArray]:
        """Return the joint positions that the lattice has along each axis.

        Along an axis, the cylinder lengths are evenly spaced, and the start is one of the
        positions. Positions that no path cheaper than the known one can pass are left out.

        Args:
            start: Start posture, shape (n,) [rad or m].
            spacing: Distance of positions, measured in cylinder length [m].

        Returns:
            An array of positions [rad or m] for each joint; the arrays have different lengths.
        """
        m, axes = self._pricing.m, []
        for j, q in enumerate(start):
            dense = np.linspace(m.joint_min[j], m.joint_max[j], RANGE_SAMPLES)
            length = self._evaluate_along_axis(start, j, dense, self._pricing.lengths)
            at = np.interp(q, dense, length)
            low, high = min(length[0], length[-1]), max(length[0], length[-1])
            below, above = math.floor((at - low) / spacing), math.floor((high - at) / spacing)
            steps = np.arange(-below, above + 1)
            steps = steps[self._may_be_cheaper(j, at, at + spacing * steps)]
            order = np.argsort(length)
            angles = np.interp(at + spacing * steps, length[order], dense[order])
            angles[steps == 0] = q
            axes.append(angles)
        return axes

    def _may_be_cheaper(self, j: int, here: float, length: FloatArray) -> np.ndarray:
        """Return which lengths of one cylinder can occur on a path cheaper than the known one.

        The known cost is compared with a lower bound, the cost of moving this cylinder alone. It
        moves from the start to the tested length, and then to the goal posture that is cheapest for
        it.

        Args:
            j: Index of the cylinder.
            here: Length of cylinder j at the start [m].
            length: Lengths to test [m], shape (k,).

        Returns:
            Flags, shape (k,); True if the bound is below the known cost.
        """
        alone, n = np.eye(len(self._goal_lengths[0]))[j], len(length)
        there = np.full(n, np.inf)
        for goal in self._goal_lengths[:, j]:
            there = np.minimum(
                there, self._pricing.lower_bound(length[:, None] * alone, goal * alone)
            )
        return (
            self._pricing.lower_bound(here * alone, length[:, None] * alone) + there < self._known
        )

    @staticmethod
    def _evaluate_along_axis(
        start: FloatArray, j: int, angles: FloatArray, of: Callable[[FloatArray], FloatArray]
    ) -> FloatArray:
        """Evaluate a function of postures while only one joint moves.

        Args:
            start: Posture that gives the positions of the other joints, shape (n,). They must have
                no influence on the value of joint j.
            j: Index of the joint.
            angles: Positions of joint j [rad or m], shape (k,).
            of: Function from postures (k, n) to a value for each joint (k, n), such as
                `_Pricing.lengths`.

        Returns:
            The value of joint j at each of `angles`, shape (k,).
        """
        postures = np.repeat(start[None, :], len(angles), axis=0)
        postures[:, j] = angles
        return of(postures)[:, j]

    def find_cheapest_path(self) -> tuple[float, FloatArray | None]:
        """Search the lattice for the cheapest path with Dijkstra's algorithm.

        A state is a lattice point together with a mode combination; a mode switch is an edge
        between two states of one point. The search begins at the start in mode N (all actuators fed
        by the main pump). All goal postures lead to one common goal state. The cost includes the
        final switches to the modes that hold the arm at the goal posture.

        Returns:
            Cost of the path, and cylinder lengths at its points, shape (points, n) [m]. The first
            is the lattice point of the start, the last a goal posture. Infinity and None if no path
            costs less than the known one.
        """
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
        """Add the steps from all lattice points to their neighbours in one direction.

        A step gets one edge for each mode combination in which it is possible; the modes are equal
        at both ends. A step gets no edge if its middle or its end is outside the workspace. A step
        that begins outside (the start may be there) may stay outside, but must not lead farther
        out.

        Args:
            steps: Edges of the graph; extended in place.
            move: Offset to the neighbour in lattice indices, −1, 0 or 1 for each joint, shape (n,).
        """
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
        cost = self._pricing.price_steps(self.length[target] - self.length[origin], forces)
        allowed = np.maximum(1e-9, self.excess[origin])
        out = (self.excess[target] > allowed) | (
            self._pricing.workspace_violation(middle) > allowed + 1e-5
        )
        cost[out] = np.inf
        patterns = cost.shape[1]
        own = np.arange(patterns)
        steps.add(patterns * origin[:, None] + own, patterns * target[:, None] + own, cost)

    def _add_endings(self, steps: _Steps, sink: int) -> IntArray:
        """Add edges from the lattice points near goal postures to the goal state.

        A point is near a goal posture if each cylinder's length differs by at most the lattice's
        spacing. The cost of an edge is the step to the posture plus the switches to the modes that
        hold the arm there. Each state gets at most one edge: to the cheapest of the goal postures
        near it.

        Args:
            steps: Edges of the graph; extended in place.
            sink: Index of the goal state, which is the number of all other states.

        Returns:
            Index of the goal posture to which each state's edge leads, shape (points, patterns); 0
            if the state has no such edge.
        """
        pricing = self._pricing
        count, patterns = len(self.place), len(pricing.patterns)
        forces = pricing.forces(self._goals, pricing.arms(self._goals))
        hold = pricing.holding_switch_cost(forces)
        least, end = np.full((count, patterns), np.inf), np.zeros((count, patterns), dtype=int)
        for k, goal in enumerate(self._goal_lengths):
            near = np.flatnonzero(np.all(np.abs(self.length - goal) <= self.spacing, axis=1))
            if len(near) == 0:
                continue
            middle = 0.5 * (self.angle[near] + self._goals[k])
            between = pricing.forces(middle, pricing.arms(middle))
            there = np.repeat(forces[k][None, :], len(near), axis=0)
            cost = pricing.price_steps(goal - self.length[near], (self.force[near], between, there))
            cost += hold[k]
            better = cost < least[near]
            least[near] = np.where(better, cost, least[near])
            end[near] = np.where(better, k, end[near])
        steps.add(np.arange(sink).reshape(least.shape), np.full(least.shape, sink), least)
        return end
