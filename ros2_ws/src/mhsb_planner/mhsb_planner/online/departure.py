"""Where a new plan takes over from what the arm does now.

A plan continues the previous one only if that one is in force; otherwise it starts from the
reference that the servo follows, and where there is none (hardware without it) from its own
last plan or from measured joint states at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import ModeArray

OLDEST_STATE_NS = SECOND_NS // 2
"""A measured or commanded state older than this says nothing about now."""

REST_SPEED = 0.01
"""Measured joint speed up to which an arm counts as standing still [rad/s]."""

NO_PLAN = 0
"""What `plan_in_force` says while the arm holds its position."""


class NoStateError(MhsbError):
    """Nothing is known of where the arm is."""


class MovingError(MhsbError):
    """The arm moves under a command that this planner does not know."""


@dataclass(frozen=True, eq=False)
class Received:
    """A state and when it was received, by the planner's clock."""

    state: MotionState
    received_ns: int


@dataclass
class ArmView:
    """The latest that the planner has heard of the arm; None where it has heard nothing."""

    joint_count: int
    reference: Received | None = None
    measured: Received | None = None
    in_force_ns: int | None = None
    modes: ModeArray | None = None
    own: Command | None = None

    def forget(self) -> None:
        """Drop everything: the clock went back, or the arm was reset."""
        self.reference = self.measured = self.in_force_ns = self.modes = self.own = None

    def departure(self, now_ns: int) -> Command:
        """The command that a plan made now has to continue.

        Raises NoStateError where nothing fresh is known, MovingError where the arm moves under
        a command that is not this planner's own.
        """
        if self.own is not None and self.in_force_ns == self.own.stamp_ns:
            return self.own
        modes = self.modes if self.modes is not None else self._all_normal()
        if self.reference is not None and self._fresh(self.reference, now_ns):
            return self._from_reference(self.reference.state, now_ns, modes)
        if self.in_force_ns is None and self.own is not None:
            return self.own
        if self.measured is not None and self._fresh(self.measured, now_ns):
            return self._from_measured(self.measured.state, now_ns, modes)
        raise NoStateError(
            "nothing is known of the arm: no reference or joint_states in the last "
            f"{OLDEST_STATE_NS / SECOND_NS:g} s; start the arm or its simulator"
        )

    def knows_state(self, now_ns: int) -> bool:
        """Whether something fresh is known of where the arm is."""
        heard = [state for state in (self.reference, self.measured) if state is not None]
        return any(self._fresh(state, now_ns) for state in heard)

    def _from_reference(self, state: MotionState, now_ns: int, modes: ModeArray) -> Command:
        if state.velocity.any() or state.acceleration.any():
            raise MovingError(
                "the arm follows a command that this planner did not give, at "
                f"{np.abs(state.velocity).max():.3g} rad/s; call the arm's ~/stop or wait until "
                "it rests"
            )
        return Command.hold(now_ns, state.position, modes)

    def _from_measured(self, state: MotionState, now_ns: int, modes: ModeArray) -> Command:
        speed = float(np.abs(state.velocity).max())
        if speed >= REST_SPEED:
            raise MovingError(
                f"the arm moves at {speed:.3g} rad/s and its command is unknown; a first plan "
                f"needs less than {REST_SPEED:g} rad/s"
            )
        return Command.hold(now_ns, state.position, modes)

    def _all_normal(self) -> ModeArray:
        return np.full(self.joint_count, Mode.N, dtype=np.uint8)

    @staticmethod
    def _fresh(received: Received, now_ns: int) -> bool:
        return abs(now_ns - received.received_ns) <= OLDEST_STATE_NS
