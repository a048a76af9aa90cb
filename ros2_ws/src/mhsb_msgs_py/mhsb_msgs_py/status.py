"""Verdicts on goals, outcomes of executions, and how serious each of them is."""

from __future__ import annotations

from enum import IntEnum, StrEnum


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
    ZONE = "ZONE"  # in a keep-out zone
    DEADLINE = "DEADLINE"  # planning took longer than its budget
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
