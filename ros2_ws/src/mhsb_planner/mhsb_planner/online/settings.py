"""Settings by which plans are made and goals are judged, and the choice of the payload."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mhsb_model.arm_reports import Estimate
from mhsb_model.machine import Machine
from mhsb_planner.planner import PlanOptions

CONFIDENCE_SIGMAS = 1.96
"""Number of standard deviations on either side of an estimate that contain the true value in 95 %
of all cases.
"""

MAX_RELATIVE_UNCERTAINTY = 0.1
"""Largest half width of the 95 % interval at which an estimate is used, as a share of the payload.
"""

MIN_RELATIVE_CHANGE = 0.03
"""Smallest change of the payload for which plans are made anew, as a share of the payload.

Every change takes new prices of all steps.
"""


def choose_payload(estimates: Sequence[Estimate], previous_payload: float | None) -> float | None:
    """Choose the payload to plan with, from the arm's estimates.

    Take the first estimate that is named `payload`, marked as known, positive, accurate and new. It
    is accurate if half its 95 % interval is at most `MAX_RELATIVE_UNCERTAINTY` of its value. It is
    new if it differs from `previous_payload` by more than `MIN_RELATIVE_CHANGE` of that payload.
    Without a `previous_payload` every estimate is new.

    Args:
        estimates: Estimates by the arm of any quantity, each with value and standard deviation. The
            payload is in kg.
        previous_payload: Estimated payload that plans have used so far [kg]; None if there was
            none.

    Returns:
        Value of the estimate [kg]; `previous_payload` if no estimate is taken.
    """
    for each in estimates:
        if each.quantity != "payload" or not each.known or each.value <= 0.0:
            continue
        narrow = CONFIDENCE_SIGMAS * each.deviation <= MAX_RELATIVE_UNCERTAINTY * each.value
        if narrow and (
            previous_payload is None
            or abs(each.value - previous_payload) > MIN_RELATIVE_CHANGE * previous_payload
        ):
            return each.value
    return previous_payload


REACHED_TOLERANCE = 0.010
"""Default of the largest distance of the measured tip from a reached goal or its region [m]."""


@dataclass(frozen=True)
class Settings:
    """Settings by which plans are made and goals are judged.

    Attributes:
        machine: Machine with the payload, supply pressure, V_max and zones to plan with.
        options: Options of plans.
        lead_min: Lower bound of the commit horizon [s].
        lead_max: Upper bound of the commit horizon [s].
        planning_budget: Fixed commit horizon [s]; 0 lets it adapt between its bounds.
        reached_tolerance: Largest distance of the measured tip from a reached goal or its region
            [m].
        lost_servo_pumps: Numbers of failed servo pumps, from 1; the machine is planned without
            them.
    """

    machine: Machine
    options: PlanOptions
    lead_min: float = 0.03
    lead_max: float = 1.0
    planning_budget: float = 0.0
    reached_tolerance: float = REACHED_TOLERANCE
    lost_servo_pumps: tuple[int, ...] = ()

    @property
    def lost_pumps_clause(self) -> str:
        """Clause on failed servo pumps, to be appended to the sentence of a refusal.

        It begins with a semicolon and lists the numbers of the pumps, from 1. It is empty if no
        pump has failed.
        """
        if not self.lost_servo_pumps:
            return ""
        return f"; the arm does without servo pump {', '.join(map(str, self.lost_servo_pumps))}"
