"""Options of a planning request."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from mhsb_model.machine import Machine
from mhsb_model.slewing import PlanarTarget
from mhsb_model.types import FloatArray, Position
from mhsb_planner.errors import RequestError
from mhsb_planner.goal_region import (
    AT_GOAL_ANGLE,
    AT_GOAL_DISTANCE,
    MAX_REGION_SIZE,
    Angle,
    Region,
    check_angle,
    is_goal_met,
)
from mhsb_planner.motion.s3_trajectory import TrajectoryKind
from mhsb_planner.search.s2_published import DEFAULT_HEURISTIC_SCALE
from mhsb_planner.search.s2_search import SearchMethod, Weights
from mhsb_planner.search.s2_step import EnergyReading

DEFAULT_PLANNER = "integrated"
"""Name of the planner for requests that name no planner."""

ENERGY_OPTIMAL = Weights(0.5, 0.0, 2.0)
"""Weights of the paper's energy-optimal cases."""

DEFAULT_SPEED_EXCESS = 0.1
"""Default of `PlanOptions.max_speed_excess` [-]: the paper's "slightly above V_max".

A polynomial with the duration of a path at constant V_max exceeds V_max by at least a quarter, and
is stretched in time.
"""

HIGHEST_SPEED_EXCESS = 1.0
"""Upper limit of `PlanOptions.max_speed_excess`."""

HIGHEST_WEIGHT = 1e6
"""Upper limit of the weights of energy [1/J], time [1/s], switches [-] and area [1/m]. Costs then
stay below 1e15, so that sums in double precision keep their digits.
"""


@dataclass(frozen=True)
class PlanOptions:
    """Options of a planning request.

    Attributes:
        weights: Weights of energy [1/J], time [1/s] and mode switches [-].
        energy_reading: Formula by which boosted oil is priced, `paper` or `series`.
        goal_psi: End-link angle at the goal, or least and greatest admissible angle [rad]; None
            leaves it free.
        goal_region: Other admissible tip positions; None means the goal alone.
        via: Points in `base_link` that the tip passes in this order: (x, z) [m], or (x, y, z) if
            joint 1 slews.
        via_tolerance: Largest distance of the tip from a via point when it passes [m].
        planner: Name of the planner, one of `registry.REGISTERED_PLANNERS`.
        trajectory: Method of the trajectory stage (S3): the published `polynomial`, or `followed`
            (along the path). None means the planner's method; if a polynomial had to be slowed, it
            is then compared with a followed path.
        max_speed_excess: Largest |v|/V_max − 1 of a piston on a polynomial [-], if options or
            planner ask for polynomials.
        initial_j3: Angle at which the fixed-joint planner keeps joint 3 [rad]; None means its angle
            at the start.
        search: Graph search of the table and fixed-joint planners, `exact` or `published`.
        heuristic_scale: Scale of the published search's heuristic [1/m].
        period: Time between the messages of a moving goal [s]; 0 means that the goal does not move.
        area_weight: Weight w₄ of the manipulability loss (`manipulability_loss`) [1/m]; 0 ignores
            it. Only some planners accept it.

    Raises:
        RequestError: A value is out of range; `__post_init__` has the ranges.
    """

    weights: Weights = ENERGY_OPTIMAL
    energy_reading: EnergyReading = "paper"
    goal_psi: Angle = None
    goal_region: Region | None = None
    via: tuple[Position, ...] = ()
    via_tolerance: float = 0.01
    planner: str = DEFAULT_PLANNER
    trajectory: TrajectoryKind | None = None
    max_speed_excess: float = DEFAULT_SPEED_EXCESS
    initial_j3: float | None = None
    search: SearchMethod = "exact"
    heuristic_scale: float = DEFAULT_HEURISTIC_SCALE
    period: float = 0.0
    area_weight: float = 0.0

    def __post_init__(self) -> None:
        """Raise RequestError if a value is out of range.

        Raises:
            RequestError: A rule is broken. Angles and via points must be finite. Angles must be at
                most WIDEST_ANGLE in magnitude. A range must be given from its lower to its upper
                end. `via_tolerance` must be above 0 and at most MAX_REGION_SIZE. Weights must be of
                the type `Weights`. All weights, `area_weight` included, must be from 0 to
                HIGHEST_WEIGHT, and at least one must be above 0. `max_speed_excess` must be from 0
                to HIGHEST_SPEED_EXCESS.
        """
        check_angle(self.goal_psi)
        for point in self.via:
            if not all(math.isfinite(value) for value in point):
                raise RequestError("via", point, "must be finite numbers [m]")
        if not (math.isfinite(self.via_tolerance) and self.via_tolerance > 0.0):
            raise RequestError("via_tolerance", self.via_tolerance, "must be above 0 m")
        if self.via_tolerance > MAX_REGION_SIZE:
            rule = f"must be at most {MAX_REGION_SIZE:g} m"
            raise RequestError("via_tolerance", self.via_tolerance, rule)
        if not 0.0 <= self.area_weight <= HIGHEST_WEIGHT:
            rule = f"must be from 0 to {HIGHEST_WEIGHT:g}"
            raise RequestError("area weight", self.area_weight, rule)
        weights = self.weights
        if not isinstance(weights, Weights):
            raise RequestError("weights", weights, "must be Weights, such as Weights(0.5, 0, 2)")
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
    def for_via_point(self) -> PlanOptions:
        """Options for the path to a via point: any end-link angle, no region, no via points."""
        return replace(self, goal_psi=None, goal_region=None, via=())

    @property
    def for_last_leg(self) -> PlanOptions:
        """Options for the path from the last via point to the goal: all but the via points."""
        return replace(self, via=())

    def distance_to_goal(self, machine: Machine, goal: Position, posture: FloatArray) -> float:
        """Compute the distance of the tip from the goal or its region.

        Args:
            machine: The whole arm.
            goal: Goal in `base_link`: (x, z) [m], or (x, y, z) if joint 1 slews.
            posture: Joint positions of the whole arm, shape (n,) [rad or m].

        Returns:
            √(d² + a²) [m]. The distance d lies in the arm's plane; it is 0 within the region. The
            distance a lies across the plane, as an arc length around the slew's axis. It is 0 if
            the arm does not slew.

        Raises:
            OutOfWorkspaceError: The slew's limits do not allow the goal.
        """
        place, tip = machine.convert_to_plane(goal, posture[0]), machine.tip_position(posture)
        offset = float(tip[0]) - place.tip[0], float(tip[1]) - place.tip[1]
        region = self.goal_region
        away = math.hypot(*offset) if region is None else region.distance(offset)
        return math.hypot(away, self._distance_from_plane(machine, place, posture))

    def is_goal_reached(self, machine: Machine, goal: Position, posture: FloatArray) -> bool:
        """Return whether tip and end-link angle of a posture are at the goal or in its region.

        Args:
            machine: The whole arm.
            goal: Goal in `base_link`: (x, z) [m], or (x, y, z) if joint 1 slews.
            posture: Joint positions of the whole arm, shape (n,) [rad or m].

        Returns:
            True if the tip is within AT_GOAL_DISTANCE of the goal or region, and the end-link angle
            within AT_GOAL_ANGLE of an admissible angle. The distance in the arm's plane and the arc
            length across it are compared separately.

        Raises:
            OutOfWorkspaceError: The slew's limits do not allow the goal.
        """
        place = machine.convert_to_plane(goal, posture[0])
        if self._distance_from_plane(machine, place, posture) > AT_GOAL_DISTANCE:
            return False
        tip, angle = machine.tip_position(posture), machine.end_link_angle(posture)
        region, psi = self.goal_region, self.goal_psi
        return is_goal_met(place.tip, region, psi, tip, angle, AT_GOAL_DISTANCE, AT_GOAL_ANGLE)

    def _distance_from_plane(
        self, machine: Machine, place: PlanarTarget, posture: FloatArray
    ) -> float:
        """Compute the arc length around the slew's axis from the tip to a target's plane.

        Args:
            machine: The whole arm.
            place: Target as a position in the arm's plane and a slew angle; its `slew` is None if
                the arm does not slew.
            posture: Joint positions of the whole arm, shape (n,) [rad or m].

        Returns:
            Arc length [m]; 0 if the arm does not slew.
        """
        if place.slew is None:
            return 0.0
        ahead = machine.arrays.slew_offset + machine.tip_position(posture)[0]
        return abs(float(ahead * (posture[0] - place.slew)))
