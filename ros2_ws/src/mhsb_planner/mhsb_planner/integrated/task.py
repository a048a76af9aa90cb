"""What the integrated search is asked for, how hard it is to seek, and the routes it finds."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.integrated.certificate import MOST_CELLS, SOON_CELLS, least_cost_to
from mhsb_planner.integrated.goal_postures import PSI_SPACING, GoalPostures
from mhsb_planner.integrated.route import Memory, Terms, new_memory, price_route
from mhsb_planner.search.lower_bound import least_costs_between
from mhsb_planner.search.search_time import SearchTime


@dataclass(frozen=True)
class Effort:
    """How hard is sought.

    psi_spacing  rad, between the goal postures
    coarsest     m, spacing of the first lattice, at most
    finest       m, of the last, at least
    cells        finest steps between start and the farthest goal posture that is worth a thought
    finer        factor from one lattice's spacing to the next's
    expansions   states of all lattices together to expand once there is a route, at most
    narrowest    m, spacing of the last lattice where there is no route yet
    strides      lengths of the compass search's strides, as shares of the lattice's spacing
    turn         rad, by which what is free at the goal is changed per stride of one spacing
    sweeps       rounds for each stride, at most
    """

    psi_spacing: float = PSI_SPACING
    coarsest: float = 25e-3
    finest: float = 1e-3
    cells: int = 20
    finer: float = 1.6
    expansions: int = 12_000
    narrowest: float = 4e-3
    strides: tuple[float, ...] = (0.5, 0.25, 0.125, 0.0625)
    turn: float = 0.1
    sweeps: int = 3

    def for_size(self, scale: float) -> Effort:
        """The same for an arm so many times the paper's size: lengths grow with it."""
        return replace(
            self,
            coarsest=scale * self.coarsest,
            finest=scale * self.finest,
            narrowest=scale * self.narrowest,
        )


WITH_AREA = Effort(expansions=40_000, strides=(0.5, 0.25, 0.1))
"""Where the area is weighed lower bounds say little, and more has to be looked at. Shorter strides
find what the pieces miss over which the shortfall is summed, not what is cheaper."""


@dataclass(frozen=True, eq=False)
class Route:
    """A polygon of cylinder lengths, where it ends, and its cost with the best modes.

    via         float64[points, n] m
    goal        number of the goal posture that it was led to
    elbow, free  of the posture at its end, as `tip_postures` has them, turned since
    cost        w₁ E + w₂ T + w₃ switches
    """

    via: FloatArray
    goal: int
    elbow: int
    free: FloatArray
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
        weight, cells = priced_by.weight, cells_within(time)
        return cls(
            machine=machine,
            terms=priced_by,
            memory=new_memory(priced_by),
            start=posture,
            lengths=lengths,
            goals=goals,
            bound=least_cost_to(machine, priced_by.circuit, lengths, goals, weight, cells),
            least=least_costs_between(priced_by.circuit, lengths, reached, weight),
            time=time,
            effort=effort,
        )

    def price(self, via: FloatArray, limit: float = math.inf) -> float:
        """Cost of a route, inf where it reaches the limit or is not possible."""
        return float(price_route(self.terms, self.memory, via, self.start, limit))

    def to_goal(self, via: FloatArray, k: int, cost: float) -> Route:
        """Route to the goal posture k."""
        return Route(via, k, int(self.goals.elbow[k]), self.goals.free[k], cost)


def cells_within(time: SearchTime) -> int:
    """Cells that a lower bound may take: with a deadline fewer, so that searches begin sooner."""
    return SOON_CELLS if time.ends else MOST_CELLS
