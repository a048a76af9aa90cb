"""An arm that is being brought to rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from mhsb_planner.online.goal_in_hand import GoalInHand

STOP_TIMEOUT = 5.0
"""How long an arm may take to confirm that it stops [s]."""

BRAKINGS = 3
"""Commands that brake, before the arm itself is asked to stop."""

STOP_ASKED = "the planner was asked to stop"
ARM_STOPPED = "the arm was asked to stop"


@dataclass
class Stopping:
    """The arm is being brought to rest.

    reason  why, as executions are told
    since   by the steady clock [s]
    done    who is told when the arm can no longer do anything else: success, sentence
    goals   that end with it
    again   the goal to be planned for afterwards
    tries   commands that brake, sent so far
    obstacle  name of the obstacle ahead that is braked for, empty without one
    set_ns  when that was set, by the arm's clock [ns]
    """

    reason: str
    since: float
    done: list[Callable[[bool, str], None]] = field(default_factory=list)
    goals: list[GoalInHand] = field(default_factory=list)
    again: GoalInHand | None = None
    tries: int = 0
    obstacle: str = ""
    set_ns: int = 0
