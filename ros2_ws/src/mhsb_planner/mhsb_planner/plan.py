"""A plan: a motion, where it comes from, and what it costs."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from mhsb_model.cavitation import Cavitation
from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.motion.energy import Energy
from mhsb_planner.motion.s3_trajectory import FittedMotion
from mhsb_planner.planners.options import PlanOptions
from mhsb_planner.search.discrete_path import DiscretePath

ROUNDING = 1e-9
"""Costs that differ by no more than this share are equal."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion and where it comes from.

    path     S2's discrete path; without steps where braking alone led to the goal
    motion   S3's trajectory with S4's mode schedule, both with stamp 0
    energy   of the motion [J], in both readings
    seconds  time taken by `search`, `fit` and `energy`, and by the integrated planner's
             `comparison` with others' paths; `first_motion` is when, since the call, there was a
             motion at all [s]
    area_shortfall  of the motion (`area_shortfall`) [m]; 0 where the area has no weight
    cavitations     of actuators whose static loads drive them faster than inlets fill
    start_in        which joints are beyond their limits and what obstacle the arm is in or touches
             at the start, as a clause; else empty
    """

    path: DiscretePath
    motion: FittedMotion
    energy: Energy
    seconds: MappingProxyType[str, float] = field(default_factory=lambda: MappingProxyType({}))
    area_shortfall: float = 0.0
    cavitations: tuple[Cavitation, ...] = ()
    start_in: str = ""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is wrong with the start, and what the motion asks of the machine beyond its limits;
        one sentence for each."""
        start = (self.start_in,) if self.start_in else ()
        return (*start, *map(str, (*self.motion.overloads, *self.cavitations)))

    @property
    def lower_bound(self) -> float:
        """No plan from the start to the goal's postures takes less energy [J].

        Of the integrated planner: to any posture at the goal; of the others: to those they allow.
        """
        return self.path.lower_bound

    @property
    def gap(self) -> float:
        """Share by which the motion's energy, reading `paper`, exceeds the lower bound."""
        return self.energy.paper / self.lower_bound - 1.0 if self.lower_bound > 0.0 else 0.0

    @property
    def took(self) -> float:
        """Time that making the plan took [s]."""
        return sum(value for name, value in self.seconds.items() if name != "first_motion")

    @property
    def duration(self) -> float:
        """Of the motion [s]."""
        return self.motion.trajectory.duration_ns / SECOND_NS

    @property
    def joint_travel(self) -> float:
        """How far all joints turn together [rad]."""
        return float(np.abs(np.diff(self.motion.trajectory.position, axis=0)).sum())

    def energy_read(self, options: PlanOptions) -> float:
        """In the reading that is asked for [J]."""
        return self.energy.paper if options.energy_reading == "paper" else self.energy.series

    def cost(self, options: PlanOptions) -> float:
        """w₁ E + w₂ T + w₃ switches + w₄ M of the motion."""
        weights = options.weights
        cost = weights.energy * self.energy_read(options) + weights.time * self.duration
        cost += weights.switches * self.motion.schedule.switches
        return cost + options.area_weight * self.area_shortfall

    def is_cheaper_than(self, other: Plan, options: PlanOptions) -> bool:
        """Whether it costs less than another; ties go by energy, time, joint travel."""
        for measure in (
            lambda each: each.cost(options),
            lambda each: each.energy_read(options),
            lambda each: each.duration,
            lambda each: each.joint_travel,
        ):
            new, known = measure(self), measure(other)
            if abs(new - known) > ROUNDING * known:
                return bool(new < known)
        return False
