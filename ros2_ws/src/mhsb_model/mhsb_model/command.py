"""What an arm is told to do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory, standstill
from mhsb_model.types import FloatArray, ModeArray


@dataclass(frozen=True, eq=False)
class Command:
    """What an arm has been told to do: a trajectory and the modes that go with it."""

    trajectory: Trajectory
    schedule: ModeSchedule

    @classmethod
    def hold(cls, stamp_ns: int, position: FloatArray, modes: ModeArray) -> Command:
        """Stand still at `position` [rad] in `modes`, from `stamp_ns` on."""
        schedule = ModeSchedule(stamp_ns, np.array([0]), modes[None, :])
        return cls(standstill(position, stamp_ns), schedule)

    @property
    def stamp_ns(self) -> int:
        """Stamp that both halves share."""
        return self.trajectory.stamp_ns
