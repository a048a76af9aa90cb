"""Where a new plan takes over from what the arm does now.

A plan continues the command in force if that is this planner's own; otherwise it starts from the
reference that the servo follows, and where there is none (hardware without it) from its own
last plan or from measured joint states at rest.
"""

from __future__ import annotations

import numpy as np

from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.trajectory import MotionState
from mhsb_planner.online.arm_view import OLDEST_STATE, ArmView

REST_SPEED = 0.01
"""Measured joint speed up to which an arm counts as standing still [rad/s]."""


class NoStateError(MhsbError):
    """Nothing is known of where the arm is."""

    def __init__(self) -> None:
        super().__init__(
            "nothing is known of the arm: no reference or joint_states in the last "
            f"{OLDEST_STATE:g} s; start the arm or its simulator"
        )


class MovingError(MhsbError):
    """The arm moves under a command that this planner does not know."""


def departure(view: ArmView, wall: float, now_ns: int) -> Command:
    """The command that a plan made now has to continue.

    wall is now by the steady clock [s], now_ns by the arm's. Raises NoStateError where nothing
    fresh is known, MovingError where the arm moves under a command that is not this planner's own.
    """
    own = view.own
    if own is not None and view.in_force_ns == own.stamp_ns:
        return own
    if view.reference is not None and view.fresh(view.reference, wall):
        return _from_reference(view, view.reference.state, now_ns)
    if view.in_force_ns is None and own is not None:
        return own
    if view.measured is not None and view.fresh(view.measured, wall):
        return _from_measured(view, view.measured.state, now_ns)
    raise NoStateError


def _from_reference(view: ArmView, state: MotionState, now_ns: int) -> Command:
    if state.velocity.any() or state.acceleration.any():
        raise MovingError(
            "the arm follows a command that this planner did not give, at "
            f"{np.abs(state.velocity).max():.3g} rad/s; call the arm's ~/stop or wait until "
            "it rests"
        )
    return Command.hold(now_ns, state.position, view.modes_in_force)


def _from_measured(view: ArmView, state: MotionState, now_ns: int) -> Command:
    speed = float(np.abs(state.velocity).max())
    if speed >= REST_SPEED:
        raise MovingError(
            f"the arm moves at {speed:.3g} rad/s and its command is unknown; a first plan "
            f"needs less than {REST_SPEED:g} rad/s"
        )
    return Command.hold(now_ns, state.position, view.modes_in_force)
