"""The arm's own clock, as far as it can be told from the stamps of what it sends.

A simulator may run at another speed than the world, and falls behind where it cannot keep up.
Plans are stamped in its time: a plan that is in time by any other clock may come too late.
"""

from __future__ import annotations

from collections import deque

from mhsb_model.trajectory import SECOND_NS

WINDOW = 1.0
"""Stamps heard within so long tell what time it is [s]; the one least delayed counts."""

SPEED_WINDOW = 3.0
"""Stamps heard within so long tell how fast that time runs [s]."""

SHORTEST_SPAN = 0.3
"""A speed is told from stamps this far apart at least [s]; from less it would be guessed."""

SPACING = 0.02
"""Of the stamps heard within each span of this length the least delayed one is kept [s]."""

LEAP = 1.0
"""A clock this far ahead of where it should be has been set [s]."""

AS_THE_WORLD = 0.1
"""A speed within so much of 1 is that of a clock heard with delays."""


class ArmTime:
    """Maps the steady clock [s] to the arm's clock [ns]."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Nothing has been heard any more: another arm, or one that started anew."""
        self._heard: deque[tuple[float, int]] = deque()
        self._last: tuple[float, int] | None = None

    def hear(self, stamp_ns: int, wall: float) -> bool:
        """Take in a stamp heard at `wall`; False where the arm's clock has gone back."""
        went_back = self._last is not None and stamp_ns < self._last[1]
        if went_back or self._leaps(stamp_ns, wall):
            self.forget()
        self._last = (wall, stamp_ns)
        if not self._heard or wall // SPACING != self._heard[-1][0] // SPACING:
            self._heard.append(self._last)
        else:
            kept, kept_ns = self._heard[-1]
            if stamp_ns - kept_ns > self.speed * (wall - kept) * SECOND_NS:
                self._heard[-1] = self._last
        while wall - self._heard[0][0] > SPEED_WINDOW:
            self._heard.popleft()
        return not went_back

    def go_by_the_latest(self) -> None:
        """Believe the last stamp alone: by the ones before, the arm's clock would be further."""
        if self._last is not None:
            self._heard = deque([self._last])

    def _leaps(self, stamp_ns: int, wall: float) -> bool:
        if self._last is None:
            return False
        last, last_ns = self._last
        return (stamp_ns - last_ns) / SECOND_NS > self.speed * (wall - last) + LEAP

    def silence(self, wall: float) -> float:
        """Time since the last stamp [s]; infinite where there was none."""
        return float("inf") if self._last is None else wall - self._last[0]

    @property
    def speed(self) -> float:
        """Seconds of the arm's clock per second."""
        if not self._heard:
            return 1.0
        (first, first_ns), (last, last_ns) = self._heard[0], self._heard[-1]
        if last - first < SHORTEST_SPAN:
            return 1.0
        speed = (last_ns - first_ns) / SECOND_NS / (last - first)
        return 1.0 if abs(speed - 1.0) <= AS_THE_WORLD else speed

    def now_ns(self, wall: float) -> int:
        """The arm's time at `wall`; ValueError where nothing has been heard."""
        if not self._heard:
            raise ValueError("no stamp of the arm has been heard")
        speed, latest = self.speed, self._heard[-1][0]
        return max(
            stamp_ns + round(speed * (wall - heard) * SECOND_NS)
            for heard, stamp_ns in self._heard
            if latest - heard <= WINDOW
        )
