"""Stream of goals: a moving goal that is sent again and again, by a joystick or a camera.

The goal's velocity is computed from positions and receipt times of the last messages. The stamps of
goals are not used. A plan ends at the place where the goal will be a little later: at most
`MAX_LOOKAHEAD_TIME` plus the machine's dead time. The time is short because the goal may stop at
any moment.
"""

import math
from collections import deque

import numpy as np

from mhsb_model.goal import Goal
from mhsb_model.types import Position

MAX_VELOCITY_SAMPLES = 5
"""Number of last goals from which the velocity is computed. At least three are needed."""

LONGEST_PERIOD = 0.5
"""Time above which two successive goals do not belong to one moving goal [s]."""

MAX_GOAL_SPEED, MIN_GOAL_SPEED = 0.5, 1e-3
"""Largest and smallest speed at which a goal counts as moving [m/s].

If the speed seems higher, the new goal is a different goal. A slower goal counts as standing still.
"""

MAX_LOOKAHEAD_TIME = 0.06
"""Largest time by which the end of a plan may be ahead of the goal, without dead time [s].

With a longer time the tip follows a moving goal more closely. If the goal stops, the tip passes it
by the distance that the goal would have moved in this time. Measured on lines at 100 mm/s with a
goal every 50 ms: the median distance was 9.6, 8.0, 6.4 and 5.4 mm with 0.017, 0.034, 0.05 and
0.06 s.
"""

STREAM_END_PERIODS = 1.5
"""Number of periods without a goal after which the goal counts as having stopped [-]."""


class GoalStream:
    """Estimator of a moving goal's velocity and period; all times are by the steady clock [s]."""

    def __init__(self) -> None:
        """Begin without a goal."""
        # positions of goals in `base_link` [m], and times of their receipt [s]
        self._received: deque[tuple[Position, float]] = deque(maxlen=MAX_VELOCITY_SAMPLES)

    def add_goal(self, goal: Goal, received_at: float) -> None:
        """Add a goal to the stream, or begin a new stream with it.

        A new stream begins if more than `LONGEST_PERIOD` has passed since the last goal, or if the
        goal has moved faster than `MAX_GOAL_SPEED` since then. All earlier goals are then
        forgotten. A goal is ignored if it was not received later than the last goal.

        Args:
            goal: The goal. Only `position` is read.
            received_at: Time of receipt by the steady clock [s].
        """
        if self._received:
            last_position, last_at = self._received[-1]
            passed = received_at - last_at
            if passed <= 0.0:
                return
            moved = math.dist(goal.position, last_position)
            if passed > LONGEST_PERIOD or moved > MAX_GOAL_SPEED * passed:
                self._received.clear()
        self._received.append((goal.position, received_at))

    @property
    def period(self) -> float:
        """Median time from one goal to the next [s]; NaN if there are fewer than two goals."""
        return float(np.median(np.diff([at for _, at in self._received])))

    @property
    def velocity(self) -> Position:
        """Velocity of the goal, fitted to the last positions by least squares [m/s].

        The elements are those of the position, (x, z) or (x, y, z). All are 0 if the goal is slower
        than `MIN_GOAL_SPEED`. With fewer than three received goals, the result is (0, 0).
        """
        if len(self._received) < 3:
            return 0.0, 0.0
        position, time = (np.array(each) for each in zip(*self._received, strict=True))
        since = time - time.mean()
        velocity = tuple(float(since @ along / (since @ since)) for along in position.T)
        return velocity if math.hypot(*velocity) >= MIN_GOAL_SPEED else (0.0,) * len(velocity)

    def is_moving(self, now: float) -> bool:
        """Return whether the goal moves and its last message is recent.

        Args:
            now: Present time by the steady clock [s].

        Returns:
            True if the velocity is not 0, and the last message came at most STREAM_END_PERIODS
            times the median period ago.
        """
        if not any(self.velocity):
            return False
        return now - self._received[-1][1] <= STREAM_END_PERIODS * self.period

    def extrapolate(self, goal: Goal, age: float, commit_horizon: float, dead_time: float) -> Goal:
        """Extrapolate a moving goal to the place at which a plan for it should end.

        The goal is moved by its velocity from its receipt to a time ahead of now. The time ahead is
        the sum of the commit horizon (time until the plan takes over), one period of the goal, and
        the dead time. Commit horizon and period together count with at most `MAX_LOOKAHEAD_TIME`.

        Args:
            goal: Goal that was received last. At least three goals must have been received.
            age: Time since the goal was received [s].
            commit_horizon: Commit horizon, without the dead time [s].
            dead_time: Dead time of the machine [s].

        Returns:
            The moved goal.
        """
        seconds = age + dead_time + min(commit_horizon + self.period, MAX_LOOKAHEAD_TIME)
        pairs = zip(goal.position, self.velocity, strict=True)
        return goal.moved_to(tuple(along + seconds * rate for along, rate in pairs))
