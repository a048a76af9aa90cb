"""A goal that moves: sent again and again, by a teleoperator's stick or as a camera sees it.

Where it will be is told from where its last messages were and when they came; the stamps of goals
say nothing. It may stop at any moment, so a plan ends hardly beyond where it was seen last.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from mhsb_model.goal import Goal
from mhsb_model.types import Position

SAMPLES = 5
"""The velocity is told from so many goals at most, and from three at least."""

LONGEST_PERIOD = 0.5
"""Goals farther apart are goals of their own [s]."""

FASTEST, SLOWEST = 0.5, 1e-3
"""A goal that moves faster is another one; one that moves slower stands [m/s]."""

FURTHEST = 1.7e-3
"""A plan may end so far beyond where the goal was last [m]."""

LATE = 1.5
"""After so many periods without a goal the stream has ended."""


class _Seen(NamedTuple):
    position: Position
    time: float


class GoalStream:
    """Where a goal goes; all times by the steady clock [s]."""

    def __init__(self) -> None:
        self._seen: deque[_Seen] = deque(maxlen=SAMPLES)

    def hear(self, goal: Goal, received: float) -> None:
        """A goal has come."""
        if self._seen:
            last = self._seen[-1]
            passed = received - last.time
            if passed <= 0.0:
                return
            moved = math.dist(goal.position, last.position)
            if passed > LONGEST_PERIOD or moved > FASTEST * passed:
                self._seen.clear()
        self._seen.append(_Seen(goal.position, received))

    @property
    def period(self) -> float:
        """Usual time from one goal to the next [s]."""
        return float(np.median(np.diff([each.time for each in self._seen])))

    @property
    def velocity(self) -> Position:
        """Of the goal, along each axis of its position [m/s], by least squares; 0 where it stands
        or too little has been seen."""
        if len(self._seen) < 3:
            return 0.0, 0.0
        position = np.array([each.position for each in self._seen])
        time = np.array([each.time for each in self._seen])
        since = time - time.mean()
        velocity = tuple(float(since @ along / (since @ since)) for along in position.T)
        return velocity if math.hypot(*velocity) >= SLOWEST else (0.0,) * len(velocity)

    def moves(self, now: float) -> bool:
        """Whether the goal moves and is about to come again."""
        if not any(self.velocity):
            return False
        return now - self._seen[-1].time <= LATE * self.period

    def ahead(self, goal: Goal, seconds: float) -> Goal:
        """Where a plan for the goal that came last should end: where it will be, or near it."""
        velocity = self.velocity
        speed = math.hypot(*velocity)
        if speed == 0.0:
            return goal
        seconds = min(seconds, FURTHEST / speed)
        pairs = zip(goal.position, velocity, strict=True)
        return goal.moved_to(tuple(along + seconds * rate for along, rate in pairs))
