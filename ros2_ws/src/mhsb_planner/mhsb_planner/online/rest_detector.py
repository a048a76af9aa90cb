"""Detector of a measured standstill of the arm."""

import math
from collections import deque

import numpy as np

from mhsb_model.trajectory import MotionState
from mhsb_model.types import FloatArray

OLDEST_STATE = 0.5
"""Largest age at which a measurement or a reference is still used [s]."""

REST_SPEED = 0.01
"""Joint speed below which an arm counts as standing still [rad/s]; for sliding joints [m/s]."""

REST_TIME = 0.2
"""Time for which the arm must stand still before it counts as at rest [s].

A motion does not stay below `REST_SPEED` for so long: even if all joints reverse at the same time,
they are below it for less than 0.1 s.
"""


class RestDetector:
    """Detector of a measured standstill of the arm.

    An arm vibrates while a servo holds it: measured velocities reach 0.06 rad/s although positions
    stay within 0.1 mrad. So the smaller of two speeds counts, both over the last `REST_TIME` before
    the last measurement. The first is the largest measured velocity. The second is the largest
    change of a joint's position, divided by `REST_TIME`.
    """

    def __init__(self) -> None:
        """Begin without a measurement."""
        self._states: deque[tuple[float, float, FloatArray]] = deque()
        self._since = math.inf

    def add_measurement(self, state: MotionState, steady_time: float) -> None:
        """Add a measurement, and drop measurements that are older than `REST_TIME`.

        A new series of measurements starts after a gap of more than `OLDEST_STATE`. Measurements of
        all publishers form one series, so if two arms use the same name, both must rest.

        Args:
            state: Measured position [rad or m] and velocity [rad/s or m/s] of all joints.
            steady_time: Time of receipt by the steady clock [s].
        """
        if self._states and steady_time - self._states[-1][0] > OLDEST_STATE:
            self._states.clear()
        if not self._states:
            self._since = steady_time
        self._states.append((steady_time, float(np.abs(state.velocity).max()), state.position))
        while steady_time - self._states[0][0] > REST_TIME:
            self._states.popleft()

    def is_at_rest(self, steady_time: float) -> bool:
        """Return whether the arm has been measured at rest for `REST_TIME`.

        Args:
            steady_time: Present time by the steady clock [s].

        Returns:
            True if three conditions hold. The last measurement is at most `OLDEST_STATE` old.
            Measurements have come for at least `REST_TIME`. The joint speed over the last
            `REST_TIME` is below `REST_SPEED`.
        """
        if not self._states or steady_time - self._states[-1][0] > OLDEST_STATE:
            return False
        last = self._states[-1][0]
        return last - self._since >= REST_TIME and self._compute_speed() < REST_SPEED

    def describe_motion(self, steady_time: float) -> str:
        """Describe why the arm does not count as resting.

        Args:
            steady_time: Present time by the steady clock [s].

        Returns:
            Clause without capital letter and full stop. It says that nothing was measured within
            `OLDEST_STATE`, or gives the measured joint speed and its limit [rad/s].
        """
        if not self._states or steady_time - self._states[-1][0] > OLDEST_STATE:
            return f"nothing was measured of the arm in the last {OLDEST_STATE:g} s (joint_states)"
        speed = self._compute_speed()
        return f"a joint of the arm moves at {speed:.3g} rad/s, it rests below {REST_SPEED:g} rad/s"

    def _compute_speed(self) -> float:
        """Compute the joint speed over the measurements of the last `REST_TIME`.

        Two speeds are compared: the largest measured velocity of any joint, and the largest change
        of any joint's position divided by `REST_TIME`.

        Returns:
            The smaller of the two speeds, not negative [rad/s]. For a joint that slides it is in
            m/s.
        """
        by_velocity = max(speed for _, speed, _ in self._states)
        by_position = float(np.ptp([position for *_, position in self._states], axis=0).max())
        return min(by_velocity, by_position / REST_TIME)
