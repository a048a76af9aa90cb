"""Mode schedules: the mode of each actuator over time (zero-order hold)."""

from dataclasses import dataclass

import numpy as np

from mhsb_model.modes import Mode
from mhsb_model.types import IntArray, ModeArray, as_frozen, frozen

LONG_AGO_NS = -(2**62)
"""Absolute time that stands for an unknown mode switch [ns], far enough in the past to be
ignored."""


@dataclass(frozen=True, eq=False)
class ModeSchedule:
    """Modes of all actuators over time; each row holds until the next row begins.

    The last row holds for all later times. Creating a schedule raises ValueError if shapes
    disagree, times do not increase or a mode code does not exist. All arrays are read-only.

    Attributes:
        stamp_ns: Absolute time of the first row [ns].
        offset_ns: Times of the rows after the stamp, the first is 0, strictly increasing, int64 of
            shape (rows,) [ns].
        modes: Mode codes, uint8 of shape (rows, actuators): 0 N, 1 DB, 2 SB.
        last_switch_ns: Absolute time of each actuator's last switch up to the first row, shape
            (actuators,) [ns]. None if it is unknown, as in a schedule from a message.
    """

    stamp_ns: int
    offset_ns: IntArray
    modes: ModeArray
    last_switch_ns: IntArray | None = None

    def __post_init__(self) -> None:
        """Check shapes, times and mode codes, and make the arrays read-only.

        `last_switch_ns`, if given, must have one time for each actuator.

        Raises:
            ValueError: A shape is wrong, times do not start at 0 or do not increase, or a code is
                no mode.
        """
        offset = np.asarray(self.offset_ns, dtype=np.int64)
        modes = np.asarray(self.modes)
        if offset.ndim != 1 or len(offset) == 0:
            raise ValueError("a mode schedule needs at least one row")
        if offset[0] != 0 or (offset[1:] <= offset[:-1]).any():
            raise ValueError("row times must start at 0 and increase strictly")
        if modes.ndim != 2 or len(modes) != len(offset):
            raise ValueError("modes must have one row of actuators for each time")
        codes = modes.astype(np.uint8)
        if not (codes == modes).all() or codes.max(initial=0) > Mode.SB:
            raise ValueError("modes must be 0 (N), 1 (DB) or 2 (SB)")
        object.__setattr__(self, "stamp_ns", int(self.stamp_ns))
        object.__setattr__(self, "offset_ns", frozen(offset))
        object.__setattr__(self, "modes", as_frozen(codes))
        if self.last_switch_ns is not None:
            before = np.asarray(self.last_switch_ns, dtype=np.int64)
            if before.shape != modes.shape[1:]:
                raise ValueError("the last switches before must be one time for each actuator")
            object.__setattr__(self, "last_switch_ns", frozen(before))

    @property
    def end_ns(self) -> int:
        """Absolute time of the last row [ns]; its modes stay in force for all later times."""
        return self.stamp_ns + int(self.offset_ns[-1])

    @property
    def switch_count(self) -> int:
        """Number of mode changes from row to row, summed over the actuators."""
        return int(np.count_nonzero(self.modes[1:] != self.modes[:-1]))

    def modes_at(self, time_ns: int) -> ModeArray:
        """Return the mode of each actuator at an absolute time, shape (actuators,).

        Before the stamp the first row counts, and after the time of the last row the last row
        counts.

        Args:
            time_ns: Absolute time [ns].
        """
        row = int(np.searchsorted(self.offset_ns, time_ns - self.stamp_ns, "right")) - 1
        return self.modes[max(row, 0)]

    def modes_at_many(self, time_ns: IntArray) -> ModeArray:
        """Return the mode of each actuator at several absolute times.

        Before the stamp the first row counts, and after the time of the last row the last row
        counts.

        Args:
            time_ns: Absolute times in any order, shape (times,) [ns].

        Returns:
            Mode codes, uint8 of shape (times, actuators), aligned with `time_ns`.
        """
        since = np.asarray(time_ns, dtype=np.int64) - self.stamp_ns
        rows = np.searchsorted(self.offset_ns, since, "right") - 1
        return self.modes[np.maximum(rows, 0)]

    def find_last_switches(self, time_ns: int) -> IntArray:
        """Return the time of each actuator's last mode switch up to an absolute time.

        A switch at exactly that time counts.

        Args:
            time_ns: Absolute time [ns].

        Returns:
            Absolute times, shape (actuators,) [ns]. An actuator that has not switched in this
            schedule gets its value in `last_switch_ns`, or `LONG_AGO_NS` if `last_switch_ns` is
            None.
        """
        at_ns = self.stamp_ns + self.offset_ns[1:]
        before = np.full(self.modes.shape[1], LONG_AGO_NS)
        last = before if self.last_switch_ns is None else self.last_switch_ns
        for at, old, new in zip(at_ns, self.modes[:-1], self.modes[1:], strict=True):
            if at <= time_ns:
                last = np.where(old != new, at, last)
        return last
