"""What a plan is to be like."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from mhsb_model.machine import Machine
from mhsb_model.slewing import InPlane
from mhsb_model.types import FloatArray, Position
from mhsb_planner.errors import RequestError
from mhsb_planner.goal_region import (
    AT_GOAL_ANGLE,
    AT_GOAL_DISTANCE,
    FARTHEST,
    Angle,
    Region,
    check_angle,
    is_met,
)
from mhsb_planner.motion.s3_trajectory import TrajectoryKind
from mhsb_planner.search.s2_published import DEFAULT_HEURISTIC_SCALE
from mhsb_planner.search.s2_search import SearchMethod, Weights
from mhsb_planner.search.s2_step import EnergyReading

ENERGY_OPTIMAL = Weights(0.5, 0.0, 2.0)
"""Weights of the paper's energy-optimal cases."""

DEFAULT_SPEED_EXCESS = 0.1
"""The paper's "slightly above V_max". On a path at V_max throughout a polynomial of its duration
passes it by a quarter at least, and is stretched."""

HIGHEST_SPEED_EXCESS = 1.0

HIGHEST_WEIGHT = 1e6
"""Of energy [1/J], time [1/s], switches [-] and area [1/m]: costs stay below 1e15, far from where
sums of them lose digits."""


@dataclass(frozen=True)
class PlanOptions:
    """What a plan is to be like.

    weights          of energy, time and mode switches
    energy_reading   `paper` or `series`
    goal_psi         rad, end-link angle at the goal, or the least and the greatest that will do;
                     None leaves it free
    goal_region      where else the tip may end, beside the goal itself
    via              points in `base_link` that the tip passes on its way, in this order: (x, z) m,
                     (x, y, z) m where joint 1 slews
    via_tolerance    m, at what distance at most
    planner          where postures come from, one of `registry.PLANNERS`
    trajectory       how S3 begins, with the published `polynomial` or with the path `followed`;
                     None: as the planner does, a stretched polynomial compared with following
    max_speed_excess largest |v|/V_max − 1 of a piston on a polynomial, where that is asked for
    initial_j3       rad, at which J3 is kept if it is fixed; None keeps it as at the start
    search           `exact` or `published`
    heuristic_scale  of the published search [1/m]
    max_expansions   of the search; None takes what it needs
    period           s, after which the motion is to be followed by another one; 0: by none
    area_weight      w₄ of the velocity polytope's area (`area_shortfall`) [1/m], for planners that
                     weigh it; 0 leaves the area out

    Raises RequestError for angles and points that are not finite, a tolerance that is not
    positive, a weight that is negative or not finite, and weights that are all 0.
    """

    weights: Weights = ENERGY_OPTIMAL
    energy_reading: EnergyReading = "paper"
    goal_psi: Angle = None
    goal_region: Region | None = None
    via: tuple[Position, ...] = ()
    via_tolerance: float = 0.01
    planner: str = "table"
    trajectory: TrajectoryKind | None = None
    max_speed_excess: float = DEFAULT_SPEED_EXCESS
    initial_j3: float | None = None
    search: SearchMethod = "exact"
    heuristic_scale: float = DEFAULT_HEURISTIC_SCALE
    max_expansions: int | None = None
    period: float = 0.0
    area_weight: float = 0.0

    def __post_init__(self) -> None:
        check_angle(self.goal_psi)
        for point in self.via:
            if not all(math.isfinite(value) for value in point):
                raise RequestError("via", point, "must be finite numbers [m]")
        if not (math.isfinite(self.via_tolerance) and self.via_tolerance > 0.0):
            raise RequestError("via_tolerance", self.via_tolerance, "must be above 0 m")
        if self.via_tolerance > FARTHEST:
            rule = f"must be at most {FARTHEST:g} m"
            raise RequestError("via_tolerance", self.via_tolerance, rule)
        if not 0.0 <= self.area_weight <= HIGHEST_WEIGHT:
            rule = f"must be from 0 to {HIGHEST_WEIGHT:g}"
            raise RequestError("area weight", self.area_weight, rule)
        weights = self.weights
        if max(weights.energy, weights.time, weights.switches) > HIGHEST_WEIGHT:
            given = [weights.energy, weights.time, weights.switches]
            raise RequestError("weights", given, f"must each be from 0 to {HIGHEST_WEIGHT:g}")
        if not (weights.energy or weights.time or weights.switches or self.area_weight):
            rule = "must not all be 0: any motion would be as good as any other; raise one of them"
            raise RequestError("weights", "0 0 0", rule)
        if not 0.0 <= self.max_speed_excess <= HIGHEST_SPEED_EXCESS:
            rule = f"must be within 0 … {HIGHEST_SPEED_EXCESS:g}"
            raise RequestError("max_speed_excess", self.max_speed_excess, rule)

    @property
    def on_the_way(self) -> PlanOptions:
        """For a leg to a point on the way: whatever posture will do there."""
        return replace(self, goal_psi=None, goal_region=None, via=())

    @property
    def at_the_end(self) -> PlanOptions:
        """For the leg to the goal."""
        return replace(self, via=())

    def distance(self, machine: Machine, goal: Position, posture: FloatArray) -> float:
        """How far the tip is from the goal in `base_link`, or from its region [m]."""
        place, tip = machine.in_plane(goal, posture[0]), machine.tip_position(posture)
        offset = float(tip[0]) - place.tip[0], float(tip[1]) - place.tip[1]
        region = self.goal_region
        away = math.hypot(*offset) if region is None else region.distance(offset)
        return math.hypot(away, self._aside(machine, place, posture))

    def is_met(self, machine: Machine, goal: Position, posture: FloatArray) -> bool:
        """Whether tip and end link are where they are asked for, and nothing is left to do."""
        place = machine.in_plane(goal, posture[0])
        if self._aside(machine, place, posture) > AT_GOAL_DISTANCE:
            return False
        tip, angle = machine.tip_position(posture), machine.end_link_angle(posture)
        region, psi = self.goal_region, self.goal_psi
        return is_met(place.tip, region, psi, tip, angle, AT_GOAL_DISTANCE, AT_GOAL_ANGLE)

    def _aside(self, machine: Machine, place: InPlane, posture: FloatArray) -> float:
        """How far the tip is from the plane of a place [m]."""
        if place.slew is None:
            return 0.0
        ahead = machine.arrays.slew_offset + machine.tip_position(posture)[0]
        return abs(float(ahead * (posture[0] - place.slew)))
