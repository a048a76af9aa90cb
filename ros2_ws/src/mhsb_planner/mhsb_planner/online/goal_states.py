"""States of a goal, and a table of the effect of each event on a goal in each state.

`GoalLifecycle` handles the events. A test brings a goal into each state, lets each event happen,
and compares state and report with the table. `docs/goal_states.md` is written from the table.
"""

from enum import Enum
from typing import NamedTuple

from mhsb_model.verdict import Outcome, Verdict


class GoalState(Enum):
    """State of a goal. The value of each member is a sentence that explains it.

    If several plans are made for a goal, its most advanced state counts.
    """

    WAITING = "It waits for planning to begin."
    PLANNING = "A plan for it is being made."
    UNCONFIRMED = "A plan for it was sent, and the arm has not answered."
    REVOKED = "A plan for it was sent before a stop; if the arm takes it, the arm is stopped."
    EXECUTING = "The arm has confirmed a plan for it."
    STOPPING = "The arm has confirmed a plan for it, and is being brought to rest."
    ENDED = "It has got its last report."


class Transition(NamedTuple):
    """Effect of an event on a goal.

    Attributes:
        next_state: State of the goal after the event.
        report: Code of the verdict or execution report that the goal gets; None if it gets none.
        action: Clause that says what else happens; empty if nothing else happens.
    """

    next_state: GoalState
    report: Verdict | Outcome | None = None
    action: str = ""


_REFUSED_BY_STOP = Transition(GoalState.ENDED, Verdict.STOPPED)
_ENDED_BY_STOP = Transition(GoalState.ENDED, Outcome.STOPPED)
_ABORTED = Transition(GoalState.ENDED, Outcome.ABORTED)
_BRAKED = Transition(GoalState.STOPPING, action="the arm is braked")
_STOPPED_BY_PLANNER = {
    GoalState.WAITING: _REFUSED_BY_STOP,
    GoalState.PLANNING: _REFUSED_BY_STOP,
    GoalState.UNCONFIRMED: Transition(GoalState.REVOKED, action="the arm's own ~/stop is called"),
    GoalState.EXECUTING: _BRAKED,
}

GOAL_TRANSITIONS: dict[str, dict[GoalState, Transition]] = {
    "nothing is in the way of planning": {
        GoalState.WAITING: Transition(GoalState.PLANNING, action="a plan is requested"),
    },
    "no state of the arm is received for 2 s": {
        GoalState.WAITING: Transition(GoalState.ENDED, Verdict.NO_STATE),
    },
    "a newer goal comes": {
        GoalState.WAITING: Transition(GoalState.ENDED, Verdict.SUPERSEDED),
    },
    "the plan is ready": {
        GoalState.PLANNING: Transition(GoalState.UNCONFIRMED, Verdict.OK, "the plan is sent"),
    },
    "planning finds that the arm is there": {
        GoalState.PLANNING: Transition(GoalState.ENDED, Verdict.AT_GOAL),
    },
    "planning finds nothing in time": {
        GoalState.PLANNING: Transition(
            GoalState.PLANNING, action="it is planned again with a longer commit horizon"
        ),
    },
    "the third time at the longest commit horizon": {
        GoalState.PLANNING: Transition(GoalState.ENDED, Verdict.NOT_FOUND),
    },
    "planning finds that there is no motion": {
        GoalState.PLANNING: Transition(GoalState.ENDED, Verdict.INFEASIBLE),
    },
    "planning fails": {
        GoalState.PLANNING: Transition(GoalState.ENDED, Verdict.INTERNAL),
    },
    "the arm confirms the plan": {
        GoalState.UNCONFIRMED: Transition(GoalState.EXECUTING),
        GoalState.REVOKED: _BRAKED,
    },
    "the arm refuses the plan as late": {
        GoalState.UNCONFIRMED: Transition(
            GoalState.UNCONFIRMED,
            action="a plan from rest is stamped anew and sent; any other is made anew",
        ),
    },
    "the arm refuses the plan since it is elsewhere": {
        GoalState.UNCONFIRMED: Transition(
            GoalState.PLANNING, action="it is planned again with a longer commit horizon"
        ),
    },
    "the arm refuses the plan as invalid": {GoalState.UNCONFIRMED: _ABORTED},
    "the arm refuses the plan since it was stopped": {GoalState.UNCONFIRMED: _ENDED_BY_STOP},
    "the plan has ended at the goal": {
        GoalState.EXECUTING: Transition(GoalState.ENDED, Outcome.REACHED),
    },
    "a plan for a newer goal is confirmed": {
        GoalState.EXECUTING: Transition(GoalState.ENDED, Outcome.REPLACED),
    },
    "the arm follows a foreign plan": {
        GoalState.EXECUTING: Transition(GoalState.ENDED, Outcome.REPLACED),
    },
    "the arm has dropped the plan for 1 s": {GoalState.EXECUTING: _ENDED_BY_STOP},
    "the planner is asked to stop": _STOPPED_BY_PLANNER,
    "the goal is cancelled": _STOPPED_BY_PLANNER,
    "a zone is set across the motion": {GoalState.EXECUTING: _BRAKED},
    "the arm has come to rest": {
        GoalState.REVOKED: _ENDED_BY_STOP,
        GoalState.STOPPING: _ENDED_BY_STOP,
    },
    "the arm does not stop": {
        GoalState.REVOKED: _ENDED_BY_STOP,
        GoalState.STOPPING: Transition(
            GoalState.EXECUTING, action="the stop answers with an error"
        ),
    },
    "somebody stops the arm": {
        GoalState.WAITING: _REFUSED_BY_STOP,
        GoalState.PLANNING: _REFUSED_BY_STOP,
        GoalState.UNCONFIRMED: _ENDED_BY_STOP,
        GoalState.EXECUTING: _ENDED_BY_STOP,
    },
    "the arm took the plan after somebody stopped it": {GoalState.EXECUTING: _BRAKED},
    "the arm reports a fault": {
        GoalState.WAITING: Transition(GoalState.ENDED, Verdict.FAULT),
        GoalState.PLANNING: Transition(GoalState.ENDED, Verdict.FAULT),
        GoalState.UNCONFIRMED: _ABORTED,
        GoalState.REVOKED: _ABORTED,
        GoalState.EXECUTING: _ABORTED,
        GoalState.STOPPING: _ABORTED,
    },
    "the clock jumps": {
        GoalState.PLANNING: Transition(GoalState.PLANNING, action="the plan is made anew"),
        GoalState.UNCONFIRMED: Transition(GoalState.WAITING),
        GoalState.EXECUTING: _ABORTED,
        GoalState.STOPPING: _ABORTED,
    },
    "settings change": {
        GoalState.PLANNING: Transition(GoalState.PLANNING, action="the plan is made anew"),
    },
}
"""Transitions by event and state.

A goal in a state that is not listed for an event keeps its state and gets no report."""
