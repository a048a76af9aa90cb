"""Verdicts on goals, how their executions end, and how serious each of it is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, StrEnum

from mhsb_model.goal import Goal


class Level(IntEnum):
    """Levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


class Verdict(StrEnum):
    """What became of a goal; each goal that is received gets exactly one."""

    OK = "OK"  # planned and published
    AT_GOAL = "AT_GOAL"  # accepted, and there already: nothing to do
    SUPERSEDED = "SUPERSEDED"  # a newer goal came before the plan
    NO_STATE = "NO_STATE"  # nobody says where the arm is
    MOVING = "MOVING"  # a first plan needs an arm at rest
    NOT_FINITE = "NOT_FINITE"  # NaN or infinite numbers
    FRAME = "FRAME"  # a frame that goals cannot be given in
    OUT_OF_WORKSPACE = "OUT_OF_WORKSPACE"
    INFEASIBLE = "INFEASIBLE"  # no path within the machine's limits
    OPTIONS = "OPTIONS"  # options of the goal's own that the planner does not take
    ZONE = "ZONE"  # in a keep-out zone
    NOT_FOUND = "NOT_FOUND"  # no motion was found within the longest lead
    DEADLINE = "DEADLINE"  # motions were found, but none in time to be sent
    STOPPED = "STOPPED"  # a stop came before a plan was sent
    FAULT = "FAULT"  # the arm reports a fault
    TABLE = "TABLE"  # the posture table cannot be used
    INTERNAL = "INTERNAL"  # a fault of the planner

    @property
    def accepted(self) -> bool:
        """Whether the goal was accepted."""
        return self in (Verdict.OK, Verdict.AT_GOAL)

    @property
    def level(self) -> Level:
        """OK where accepted, WARN where superseded, ERROR where refused."""
        if self.accepted:
            return Level.OK
        return Level.WARN if self is Verdict.SUPERSEDED else Level.ERROR


class Outcome(StrEnum):
    """How the execution of an accepted goal ended."""

    REACHED = "reached"
    REPLACED = "replaced"  # by the plan of a later goal
    STOPPED = "stopped"  # on request
    ABORTED = "aborted"  # the plan was not executed to its end

    @property
    def level(self) -> Level:
        """OK where the goal was reached, ERROR where the plan was aborted, else WARN."""
        if self is Outcome.REACHED:
            return Level.OK
        return Level.ERROR if self is Outcome.ABORTED else Level.WARN


@dataclass(frozen=True)
class PlanSummary:
    """What an accepted goal will cost.

    plan_stamp_ns    stamp of the plan's messages, ns; 0 where nothing had to be published
    energy_j         in the planner's energy reading, J
    energy_series_j  in the series reading, J
    duration_s       s
    switches         mode changes
    plan_ms          from goal received to plan published, ms
    lower_bound_j    no plan to this goal needs less, J
    lead_ms          from goal received to where the new curve leaves the old one, ms
    continued        whether the plan in force leads there already and nothing was published
    speed_excess     greatest |v|/V_max − 1 of a piston; negative where V_max is kept
    cavitation_s     for which loads empty the inlet chambers of actuators, summed over these, s
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
    """What became of a goal, which is named by its stamp [ns] and was at x, z [m]; y of arms that
    slew.

    `sentence` tells a person. Accepted goals have a plan, others None; anything else is a
    ValueError.
    """

    code: Verdict
    sentence: str
    goal_stamp_ns: int
    goal_x: float
    goal_z: float
    plan: PlanSummary | None = None
    goal_y: float | None = None

    @classmethod
    def of(
        cls, goal: Goal, code: Verdict, sentence: str, plan: PlanSummary | None = None
    ) -> GoalVerdict:
        """The verdict on a goal."""
        return cls(code, sentence, goal.stamp_ns, goal.x, goal.z, plan, goal.y)

    @property
    def goal(self) -> Goal:
        """The goal that it is on."""
        return Goal(self.goal_stamp_ns, self.goal_x, self.goal_z, self.goal_y)

    def __post_init__(self) -> None:
        if self.code.accepted != (self.plan is not None):
            raise ValueError(f"a verdict {self.code} and a plan {self.plan} do not go together")


@dataclass(frozen=True)
class ExecutionReport:
    """How the execution of an accepted goal ended.

    goal_stamp_ns, plan_stamp_ns  of the goal, and of the last plan that was sent for it [ns]
    attempts  how many plans were sent for it
    lead_ms   from goal received to where the curve of that last plan leaves the old one, ms
    reason    code of a verdict, where that is why it was aborted: `DEADLINE`, `FAULT`, …
    """

    outcome: Outcome
    sentence: str
    goal_stamp_ns: int
    plan_stamp_ns: int
    attempts: int = 1
    lead_ms: float = 0.0
    reason: Verdict | None = None


Report = GoalVerdict | ExecutionReport
"""What is told of goals."""
