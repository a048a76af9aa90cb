"""What the planner knows of the arm: what it has heard, and the command that is in force."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mhsb_model.command import Command
from mhsb_model.modes import Mode
from mhsb_model.trajectory import MotionState
from mhsb_model.types import ModeArray
from mhsb_planner.online.arm_time import ArmTime

OLDEST_STATE = 0.5
"""A measured or commanded state heard longer ago says nothing about now [s]."""

NO_PLAN = 0
"""What `plan_in_force` says while the arm holds its position."""


@dataclass(frozen=True, eq=False)
class Heard:
    """A state, its stamp by the arm's clock [ns], and when it was heard by the steady clock [s]."""

    state: MotionState
    stamp_ns: int
    wall: float


@dataclass
class ArmView:
    """The latest that has been heard of the arm; None where nothing has been heard.

    own       the command that the arm has confirmed, or is taken to obey where it tells nothing
    fault     why the arm stands still and takes no plan; empty while it does
    delay_ns  by which the arm follows plans later than they say: its guard slows them
    """

    joint_count: int
    reference: Heard | None = None
    measured: Heard | None = None
    in_force_ns: int | None = None
    modes: ModeArray | None = None
    own: Command | None = None
    fault: str = ""
    delay_ns: int = 0
    time: ArmTime = field(default_factory=ArmTime)

    def forget(self) -> None:
        """Drop everything: the clock went back, or the arm was reset."""
        self.reference = self.measured = self.in_force_ns = self.modes = self.own = None
        self.delay_ns = 0
        self.time.forget()

    def now_ns(self, wall: float, ros_ns: int) -> int:
        """The arm's time of plans; that of ROS where nothing has been heard, and where the arm has
        been silent for long and that of ROS has come less far: it stands still with the arm's."""
        silence = self.time.silence(wall)
        if silence == math.inf:
            return ros_ns
        now_ns = self.time.now_ns(wall)
        return (min(now_ns, ros_ns) if silence > OLDEST_STATE else now_ns) - self.delay_ns

    def knows_state(self, wall: float) -> bool:
        """Whether something fresh is known of where the arm is."""
        return self.fresh(self.reference, wall) or self.fresh(self.measured, wall)

    def state(self, wall: float) -> MotionState | None:
        """Where the arm is commanded to be, or else where it is; None where nothing fresh says."""
        for heard in (self.reference, self.measured):
            if heard is not None and self.fresh(heard, wall):
                return heard.state
        return None

    @staticmethod
    def fresh(heard: Heard | None, wall: float) -> bool:
        """Whether a state has been heard lately."""
        return heard is not None and wall - heard.wall <= OLDEST_STATE

    @property
    def modes_in_force(self) -> ModeArray:
        """Modes that the arm reports; all N where it reports none."""
        if self.modes is not None:
            return self.modes
        return np.full(self.joint_count, Mode.N, dtype=np.uint8)

    def executes_own(self, now_ns: int) -> bool:
        """Whether the arm moves under a command of this planner."""
        own = self.own
        confirmed = own is not None and self.in_force_ns in (None, own.stamp_ns)
        return own is not None and confirmed and now_ns < own.trajectory.end_ns
