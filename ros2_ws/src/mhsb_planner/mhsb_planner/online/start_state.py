"""Start state: the command that a new plan continues.

A command is a joint trajectory with its mode schedule. A plan continues the command in force if
this planner has sent it. Otherwise the plan starts from the reference that the servo follows. If
the arm does not publish a reference, the plan starts from this planner's last command, or from
measured joint states at rest. The time of plans is the arm's clock minus the delay that speed
scaling has caused.
"""

import numpy as np

from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_planner.online.arm_state import ArmState
from mhsb_planner.online.rest_detector import OLDEST_STATE, REST_SPEED


class NoStateError(MhsbError):
    """Error: the present state of the arm is not known."""

    def __init__(self, sentence: str = "", mismatch: str = "") -> None:
        """Create the error.

        Args:
            sentence: Sentence of the error. Empty means a sentence that no fresh state of the arm
                was received.
            mismatch: Sentence on publishers whose quality of service does not match. It is appended
                if it is not empty.
        """
        sentence = sentence or (
            "nothing is known of the arm: no reference or joint_states in the last "
            f"{OLDEST_STATE:g} s; start the arm or its simulator"
        )
        super().__init__("; ".join(filter(None, (sentence, mismatch))))


class OtherMachineError(MhsbError):
    """Error: arm and planner were started with different machine files."""


class MovingError(MhsbError):
    """Error: the arm moves under a command that this planner did not send."""


def find_start_command(arm_state: ArmState, steady_time: float, now_ns: int) -> Command:
    """Find the command that a new plan has to continue.

    A state is fresh if it was received at most `OLDEST_STATE` ago. No plan can start from an arm
    that is silent (`ArmState.is_silent`). Otherwise the first of these sources that exists decides:

    1. This planner's last confirmed command, if the arm reports that it executes this command.
    2. A fresh reference of the arm. If it rests, the result holds the arm there. If any velocity or
       acceleration of it is not exactly 0, `MovingError` is raised.
    3. This planner's last confirmed command, if the arm does not report which plan it executes.
    4. A fresh measurement. If it rests, the result holds the arm there. If the speed of a joint is
       `REST_SPEED` or more, `MovingError` is raised.

    Args:
        arm_state: Arm state.
        steady_time: Present time by the steady clock [s].
        now_ns: Present time of plans [ns]. It is the arm's clock minus the delay that the arm's
            speed scaling has caused so far. A command that holds the position gets this stamp.

    Returns:
        This planner's own command, or a command that holds the position in the modes in force.

    Raises:
        OtherMachineError: The arm has another machine file.
        NoStateError: There is no fresh state, or several publishers send references.
        MovingError: The arm moves, but not under a command of this planner.
    """
    if arm_state.machine_difference:
        raise OtherMachineError(arm_state.machine_difference)
    if arm_state.publisher_conflict:
        raise NoStateError(f"where the arm is is not known: {arm_state.publisher_conflict}")
    if arm_state.is_silent(steady_time):
        raise NoStateError(mismatch=arm_state.qos_mismatch)
    own, reference, measured = arm_state.own_command, arm_state.reference, arm_state.measured
    if own is not None and arm_state.plan_in_force_ns == own.stamp_ns:
        return own
    if reference is not None and reference.is_fresh(steady_time):
        if reference.state.velocity.any() or reference.state.acceleration.any():
            raise MovingError(
                "the arm follows a command that this planner did not give, at "
                f"{np.abs(reference.state.velocity).max():.3g} rad/s; call the arm's ~/stop or "
                "wait until it rests"
            )
        return Command.hold(now_ns, reference.state.position, arm_state.modes_in_force)
    if arm_state.plan_in_force_ns is None and own is not None:
        return own
    if measured is not None and measured.is_fresh(steady_time):
        speed = float(np.abs(measured.state.velocity).max())
        if speed >= REST_SPEED:
            raise MovingError(
                f"the arm moves at {speed:.3g} rad/s and its command is unknown; a first plan "
                f"needs less than {REST_SPEED:g} rad/s"
            )
        return Command.hold(now_ns, measured.state.position, arm_state.modes_in_force)
    raise NoStateError(mismatch=arm_state.qos_mismatch)
