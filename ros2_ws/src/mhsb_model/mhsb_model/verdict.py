"""Verdicts on goals, outcomes of their executions, and the severity of both."""

from dataclasses import dataclass
from enum import IntEnum, StrEnum

from mhsb_model.goal import Goal


class Level(IntEnum):
    """Severity levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


class Verdict(StrEnum):
    """Result of a goal request; each goal received gets exactly one."""

    OK = "OK"
    """The goal was planned and the plan published."""
    AT_GOAL = "AT_GOAL"
    """The goal was accepted, and the tip is already at it."""
    SUPERSEDED = "SUPERSEDED"
    """A newer goal came before the plan."""
    NO_STATE = "NO_STATE"
    """No message says where the arm is."""
    MOVING = "MOVING"
    """A first plan needs an arm at rest."""
    NOT_FINITE = "NOT_FINITE"
    """The goal has NaN or infinite numbers."""
    FRAME = "FRAME"
    """The goal's frame is not one in which goals can be given."""
    OUT_OF_WORKSPACE = "OUT_OF_WORKSPACE"
    """The goal lies outside the workspace."""
    INFEASIBLE = "INFEASIBLE"
    """No path within the machine's limits leads to the goal."""
    OPTIONS = "OPTIONS"
    """The goal has options that the planner does not accept."""
    ZONE = "ZONE"
    """The goal is in a keep-out zone."""
    NOT_FOUND = "NOT_FOUND"
    """No motion was found within the longest commit horizon."""
    DEADLINE = "DEADLINE"
    """Motions were found, but none in time to be sent."""
    STOPPED = "STOPPED"
    """A stop came before a plan was sent."""
    MACHINE = "MACHINE"
    """The arm was started with another machine file."""
    FAULT = "FAULT"
    """The arm reports a fault."""
    TABLE = "TABLE"
    """The posture table cannot be used."""
    INTERNAL = "INTERNAL"
    """The planner itself failed."""

    @property
    def accepted(self) -> bool:
        """Return whether the goal was accepted, that is OK or AT_GOAL."""
        return self in (Verdict.OK, Verdict.AT_GOAL)

    @property
    def level(self) -> Level:
        """Severity: OK if accepted, WARN if superseded, otherwise ERROR."""
        if self.accepted:
            return Level.OK
        return Level.WARN if self is Verdict.SUPERSEDED else Level.ERROR


class Outcome(StrEnum):
    """Way in which the execution of an accepted goal ended."""

    REACHED = "reached"
    """The plan was executed to its end."""
    REPLACED = "replaced"
    """The plan of a later goal took over."""
    STOPPED = "stopped"
    """The arm was stopped on request."""
    ABORTED = "aborted"
    """The plan was not executed to its end."""

    @property
    def level(self) -> Level:
        """Severity: OK if the goal was reached, ERROR if the plan was aborted, otherwise WARN."""
        if self is Outcome.REACHED:
            return Level.OK
        return Level.ERROR if self is Outcome.ABORTED else Level.WARN


@dataclass(frozen=True)
class PlanSummary:
    """Expected energy, time and other numbers of the plan for an accepted goal.

    Attributes:
        plan_stamp_ns: Stamp of the plan's messages [ns]; 0 if nothing had to be published.
        energy_j: Energy in the reading `paper`: boosted oil costs p_L/η per volume, with the load
            pressure p_L and the pump's efficiency η [J].
        energy_series_j: Energy in the reading `series`: boosted oil costs the pressure rises of
            main and servo pump in series, per volume [J].
        duration_s: Duration of the motion [s].
        switches: Number of mode changes, summed over the actuators.
        plan_ms: Time from receiving the goal to publishing the plan [ms].
        lower_bound_j: Lower bound on the energy of every plan to this goal [J].
        lead_ms: Time from receiving the goal to the instant at which the new curve deviates from
            the old curve [ms].
        continued: Whether nothing was published because the plan in force already leads to the
            goal.
        speed_excess: Largest |v|/V_max − 1 of a piston [-]; negative if V_max is kept.
        cavitation_s: Time for which loads empty inlet chambers, summed over the actuators [s].
    """

    plan_stamp_ns: int
    energy_j: float
    energy_series_j: float
    duration_s: float
    switches: int
    plan_ms: float
    lower_bound_j: float
    lead_ms: float = 0.0
    continued: bool = False
    speed_excess: float = 0.0
    cavitation_s: float = 0.0


@dataclass(frozen=True)
class GoalVerdict:
    """A verdict on one goal, with a sentence for people.

    A verdict has a plan only if it accepts its goal. Creating a verdict against this rule raises
    ValueError.

    Attributes:
        code: The verdict.
        sentence: Explanation for a person.
        goal: The goal that it answers.
        plan: Numbers of the plan; None if the goal was not accepted.
    """

    code: Verdict
    sentence: str
    goal: Goal
    plan: PlanSummary | None = None

    @property
    def goal_stamp_ns(self) -> int:
        """Stamp of the goal, which identifies it [ns]."""
        return self.goal.stamp_ns

    def __post_init__(self) -> None:
        """Check that a verdict has a plan exactly if it accepts its goal.

        Raises:
            ValueError: A verdict OK or AT_GOAL has no plan, or another verdict has one.
        """
        if self.code.accepted != (self.plan is not None):
            raise ValueError(f"a verdict {self.code} and a plan {self.plan} do not go together")


@dataclass(frozen=True)
class ExecutionReport:
    """Report on how the execution of one accepted goal ended.

    Attributes:
        outcome: Way in which the execution ended.
        sentence: Explanation for a person.
        goal_stamp_ns: Stamp of the goal [ns].
        plan_stamp_ns: Stamp of the last plan that was sent for the goal [ns].
        attempts: Number of plans that were sent for the goal.
        lead_ms: Time from receiving the goal to the instant at which the last plan's curve deviates
            from the old one [ms].
        reason: Verdict code that explains an abort, for instance DEADLINE or FAULT; None if there
            is none.
    """

    outcome: Outcome
    sentence: str
    goal_stamp_ns: int
    plan_stamp_ns: int
    attempts: int = 1
    lead_ms: float = 0.0
    reason: Verdict | None = None


Report = GoalVerdict | ExecutionReport
"""Either report about a goal."""
