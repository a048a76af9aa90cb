"""The command that an arm executes: a trajectory and its mode schedule."""

from dataclasses import dataclass

import numpy as np

from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory, standstill
from mhsb_model.types import FloatArray, ModeArray

MAX_HAND_OVER_JUMP = 1e-6
"""Largest jump of the reference that rounding may cause when a new command replaces another, in
position [rad or m] and velocity [rad/s or m/s].
"""


@dataclass(frozen=True, eq=False)
class Command:
    """A trajectory and its mode schedule, with a common stamp."""

    trajectory: Trajectory
    """Motion of the joints."""
    schedule: ModeSchedule
    """Modes of the actuators over time."""

    @classmethod
    def hold(cls, stamp_ns: int, position: FloatArray, modes: ModeArray) -> "Command":
        """Return a command to stand still at a position in constant modes.

        Args:
            stamp_ns: Absolute time of the command [ns].
            position: Joint positions to hold, shape (n,) [rad or m].
            modes: Mode in which each actuator holds, shape (n,).
        """
        schedule = ModeSchedule(stamp_ns, np.array([0]), modes[None, :])
        return cls(standstill(position, stamp_ns), schedule)

    @property
    def stamp_ns(self) -> int:
        """Absolute time at which both trajectory and mode schedule begin [ns]."""
        return self.trajectory.stamp_ns
