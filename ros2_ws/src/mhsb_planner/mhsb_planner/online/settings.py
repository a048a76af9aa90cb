"""Settings by which plans are made and goals are judged, and the choice of the payload."""

from collections.abc import Sequence
from dataclasses import dataclass

from mhsb_model.arm_reports import Estimate
from mhsb_model.machine import Machine
from mhsb_planner.planner import PlanOptions

CONFIDENCE_SIGMAS = 1.96
"""Half width of the 95 % confidence interval of an estimate, in standard deviations [-]."""

MAX_RELATIVE_UNCERTAINTY = 0.1
"""Largest half width of the 95 % interval of a used estimate, as a share of its value [-]."""

MIN_RELATIVE_CHANGE = 0.03
"""Smallest change of the payload that is used in plans, as a share of the payload [-].

After every change the costs of all steps of the search must be computed again.
"""


def choose_payload(estimates: Sequence[Estimate], previous_payload: float | None) -> float | None:
    """Choose the payload to plan with, from the arm's estimates.

    The first estimate that meets these conditions is taken:

    - Its quantity is `payload`. It is marked as known and is positive.
    - It is accurate: half its 95 % interval is at most `MAX_RELATIVE_UNCERTAINTY` of its value.
    - It is new: it differs from `previous_payload` by more than `MIN_RELATIVE_CHANGE` of this
      payload, or `previous_payload` is None.

    Args:
        estimates: Estimates of any quantities of the arm, each with value and standard deviation;
            [kg] for the payload.
        previous_payload: Estimated payload that plans have used so far [kg]; None if plans have
            used no estimate.

    Returns:
        Value of the estimate [kg]; `previous_payload` if no estimate meets the conditions.
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
"""Default of `Settings.reached_tolerance` [m]."""


@dataclass(frozen=True)
class Settings:
    """Settings by which plans are made and goals are judged.

    Attributes:
        machine: Machine with the payload, supply pressure, V_max and zones to plan with.
        options: Options of plans.
        lead_min: Lower bound of the commit horizon (time until a new plan takes over) [s].
        lead_max: Upper bound of the commit horizon [s].
        planning_budget: Fixed commit horizon [s]. 0 means that the horizon is estimated, within the
            bounds.
        reached_tolerance: Largest distance of the measured tip from the goal, or from its region,
            at which the goal counts as reached [m].
        lost_servo_pumps: Numbers of failed servo pumps, from 1. They are not included in `machine`.
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
        """Clause on failed servo pumps that is appended to the sentence of a refusal.

        It begins with a semicolon and lists the numbers of the pumps, from 1. It is empty if no
        pump has failed.
        """
        if not self.lost_servo_pumps:
            return ""
        return f"; the arm does without servo pump {', '.join(map(str, self.lost_servo_pumps))}"
