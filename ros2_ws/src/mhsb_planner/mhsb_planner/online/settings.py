"""How plans are made."""

from __future__ import annotations

from dataclasses import dataclass

from mhsb_model.machine import Machine
from mhsb_planner.planner import PlanOptions


@dataclass(frozen=True)
class Settings:
    """How plans are made.

    machine             with payload, supply pressure, V_max and zones as asked for
    lead_min, lead_max  s, between which the lead adapts
    planning_budget     s, the lead where it shall not adapt; 0 where it shall
    lost_servo_pumps    numbers of those that fail, which the machine does not have any more
    """

    machine: Machine
    options: PlanOptions
    lead_min: float = 0.03
    lead_max: float = 1.0
    planning_budget: float = 0.0
    lost_servo_pumps: tuple[int, ...] = ()

    @property
    def handicap(self) -> str:
        """What is lost, as the end of a sentence about a goal that is refused."""
        if not self.lost_servo_pumps:
            return ""
        return f"; the arm does without servo pump {', '.join(map(str, self.lost_servo_pumps))}"
