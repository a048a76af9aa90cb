"""Mode schedules: which mode each actuator is in, over time (zero-order hold)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.modes import Mode
from mhsb_model.types import IntArray, ModeArray, as_frozen, frozen

LONG_AGO_NS = -(2**62)
"""When modes were switched of which nothing is known: as good as never."""


@dataclass(frozen=True, eq=False)
class ModeSchedule:
    """Modes of all actuators, each row in force until the next one; the last stays in force.

    stamp_ns   absolute time of the first row, integer ns
    offset_ns  int64[rows], times after the stamp, first 0, strictly increasing
    modes      uint8[rows, actuators], 0/1/2 = N/DB/SB
    before_ns  int64[actuators], absolute times of the last switches up to the first row; long ago
               where nothing is known of them, as where a schedule comes from a message

    Raises ValueError where shapes, order or codes fail.
    """

    stamp_ns: int
    offset_ns: IntArray
    modes: ModeArray
    before_ns: IntArray | None = None

    def __post_init__(self) -> None:
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
        if self.before_ns is not None:
            before = np.asarray(self.before_ns, dtype=np.int64)
            if before.shape != modes.shape[1:]:
                raise ValueError("the last switches before must be one time for each actuator")
            object.__setattr__(self, "before_ns", frozen(before))

    @property
    def end_ns(self) -> int:
        """Absolute time of the last row, from which the holding modes are in force, ns."""
        return self.stamp_ns + int(self.offset_ns[-1])

    @property
    def switches(self) -> int:
        """Number of actuator mode changes between the rows."""
        return int(np.count_nonzero(np.diff(self.modes.astype(np.int64), axis=0)))

    def shifted(self, delta_ns: int) -> ModeSchedule:
        """The same schedule, `delta_ns` later."""
        return ModeSchedule(self.stamp_ns + delta_ns, self.offset_ns, self.modes, self.before_ns)

    def modes_at(self, time_ns: int) -> ModeArray:
        """Modes in force at the absolute time `time_ns`, uint8[actuators]."""
        row = int(np.searchsorted(self.offset_ns, time_ns - self.stamp_ns, "right")) - 1
        return self.modes[max(row, 0)]

    def modes_at_many(self, time_ns: IntArray) -> ModeArray:
        """Modes in force at absolute times, uint8[times, actuators]."""
        since = np.asarray(time_ns, dtype=np.int64) - self.stamp_ns
        rows = np.searchsorted(self.offset_ns, since, "right") - 1
        return self.modes[np.maximum(rows, 0)]

    def switched_ns(self, time_ns: int) -> IntArray:
        """Absolute times of the actuators' last switches up to `time_ns`, int64[actuators]."""
        at_ns = self.stamp_ns + self.offset_ns[1:]
        before = np.full(self.modes.shape[1], LONG_AGO_NS)
        last = before if self.before_ns is None else self.before_ns
        for at, old, new in zip(at_ns, self.modes[:-1], self.modes[1:], strict=True):
            if at <= time_ns:
                last = np.where(old != new, at, last)
        return last
