"""States of a goal and the events that change them, as one table.

`GoalLifecycle` implements the table. A test brings a goal into each state, lets each event happen,
and compares. `docs/contracts.md` shows the table.
"""

from enum import Enum


class GoalState(Enum):
    """State of a goal; the furthest one if further plans for it are made."""

    WAITING = "waiting"
    PLANNING = "planning"
    UNCONFIRMED = "unconfirmed"
    REVOKED = "revoked"
    EXECUTING = "executing"
    STOPPING = "stopping"
    ENDED = "ended"
