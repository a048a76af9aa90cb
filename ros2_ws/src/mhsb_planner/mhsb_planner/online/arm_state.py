"""Arm state: what the planner knows of the arm from its messages, and the command in force.

The steady clock is the planner's own clock, which is never set.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from mhsb_model.command import Command
from mhsb_model.modes import Mode
from mhsb_model.trajectory import MotionState
from mhsb_model.types import ModeArray
from mhsb_planner.online.arm_clock import ArmClockEstimator
from mhsb_planner.online.rest_detector import OLDEST_STATE, RestDetector

NO_PLAN = 0
"""Value of `plan_in_force` while the arm holds its position without a plan."""

LONGEST_SILENCE = 2.0
"""Largest age of the arm's last state at which its plan in force can be continued [s].

On a busy computer, states may be late by more than a second. If the arm is silent for longer, its
process may have ended during a motion.
"""


@dataclass(frozen=True, eq=False)
class ReceivedState:
    """State of the arm, with the time of its receipt.

    Attributes:
        state: Position, velocity and acceleration of all joints.
        received_at: Time of receipt by the steady clock [s].
    """

    state: MotionState
    received_at: float

    def is_fresh(self, steady_time: float) -> bool:
        """Return whether the state was received at most `OLDEST_STATE` ago.

        Args:
            steady_time: Present time by the steady clock [s].
        """
        return steady_time - self.received_at <= OLDEST_STATE


@dataclass
class ArmState:
    """Latest messages of the arm, and data derived from these.

    A field is None if nothing was received for it.

    Attributes:
        joint_count: Number of joints.
        reference: State that the servo follows.
        measured: Measured joint state; its acceleration is 0.
        plan_in_force_ns: Stamp of the plan that the arm reports to execute [ns]. `NO_PLAN` while it
            holds its position.
        modes: Mode of each actuator as the arm reports it, uint8[n].
        own_command: This planner's last command that the arm has confirmed. If the arm does not
            report its plan in force, every sent command counts as confirmed.
        fault: Sentence on the fault for which the arm has stopped and takes no plan. Empty if there
            is no fault.
        plan_delay_ns: Time by which the arm executes plans later than stamped, because its
            reference governor has slowed them [ns].
        publisher_conflict: Sentence that names the publishers of the arm's reference if there are
            several. Empty if there is one.
        qos_mismatch: Sentence that names publishers whose quality of service does not match. Empty
            if there are none.
        machine_difference: Sentence on how the arm's machine file differs from the planner's; empty
            if they are equal, or if the arm does not report its machine. None until this is known.
        first_state_at: Time of receipt of the first state by the steady clock [s]; infinite before.
        clock_estimator: Estimator of the arm's clock.
        rest_detector: Detector of a measured standstill.
    """

    joint_count: int
    reference: ReceivedState | None = None
    measured: ReceivedState | None = None
    plan_in_force_ns: int | None = None
    modes: ModeArray | None = None
    own_command: Command | None = None
    fault: str = ""
    plan_delay_ns: int = 0
    publisher_conflict: str = ""
    qos_mismatch: str = ""
    machine_difference: str | None = None
    first_state_at: float = math.inf
    clock_estimator: ArmClockEstimator = field(default_factory=ArmClockEstimator)
    rest_detector: RestDetector = field(default_factory=RestDetector)

    def forget(self) -> None:
        """Forget all data that depend on the arm's clock, after a clock jump or a reset.

        These are the reference, the measured state, this planner's command, the stamp of the plan
        in force, the plan delay and the clock estimate. The modes stay, since they have no stamp.
        The report that no plan is in force (`NO_PLAN`) also stays: it has no stamp, so the arm may
        have sent it just after the jump, before the planner noticed the jump.
        """
        self.reference = self.measured = self.own_command = None
        if self.plan_in_force_ns != NO_PLAN:
            self.plan_in_force_ns = None
        self.plan_delay_ns = 0
        self.clock_estimator.forget()

    def add_reference(self, state: MotionState, stamp_ns: int, steady_time: float) -> None:
        """Store the reference that the servo follows, and its stamp.

        The stamp updates the estimate of the arm's clock. If no joint state has come yet, the
        reference also serves to detect rest.

        Args:
            state: Position, velocity and acceleration of all joints.
            stamp_ns: Stamp by the arm's clock [ns].
            steady_time: Time of receipt by the steady clock [s].
        """
        self.clock_estimator.add_stamp(stamp_ns, steady_time)
        self.reference = ReceivedState(state, steady_time)
        self.first_state_at = min(self.first_state_at, steady_time)
        if self.measured is None:
            self.rest_detector.add_measurement(state, steady_time)

    def add_measurement(self, state: MotionState, steady_time: float) -> None:
        """Store the measured state of the joints, and use it to detect rest.

        Args:
            state: Measured position and velocity of all joints; its acceleration is 0.
            steady_time: Time of receipt by the steady clock [s].
        """
        self.measured = ReceivedState(state, steady_time)
        self.first_state_at = min(self.first_state_at, steady_time)
        self.rest_detector.add_measurement(state, steady_time)

    def get_plan_time_ns(self, steady_time: float, ros_ns: int) -> int:
        """Return the present time of plans: the time by which plans are stamped.

        This is the extrapolated time of the arm's clock minus `plan_delay_ns`. If the arm has been
        silent for more than `OLDEST_STATE`, the extrapolated time is limited to the ROS clock. If a
        simulator publishes the ROS clock, it stands still while the simulator is suspended.

        Args:
            steady_time: Present time by the steady clock [s].
            ros_ns: Present time by the ROS clock [ns].

        Returns:
            Time of plans [ns]; `ros_ns` if no stamp has come from the arm.
        """
        silence = self.clock_estimator.time_since_last_stamp(steady_time)
        if silence == math.inf:
            return ros_ns
        now_ns = self.clock_estimator.extrapolate_ns(steady_time)
        return (min(now_ns, ros_ns) if silence > OLDEST_STATE else now_ns) - self.plan_delay_ns

    def is_silent(self, steady_time: float) -> bool:
        """Return whether no state of the arm was received in the last `LONGEST_SILENCE`.

        Args:
            steady_time: Present time by the steady clock [s].
        """
        received = [each.received_at for each in (self.reference, self.measured) if each]
        return steady_time - max(received, default=-math.inf) > LONGEST_SILENCE

    def get_fresh_state(self, steady_time: float) -> MotionState | None:
        """Return the reference that the servo follows, or else the measured state.

        Args:
            steady_time: Present time by the steady clock [s].

        Returns:
            Position, velocity and acceleration of all joints: those of the reference, or of the
            measured state if the reference is missing or older than `OLDEST_STATE`. None if both
            are missing or older.
        """
        received = (self.reference, self.measured)
        fresh = (each.state for each in received if each and each.is_fresh(steady_time))
        return next(fresh, None)

    @property
    def modes_in_force(self) -> ModeArray:
        """Mode of each actuator as the arm reports it, uint8[n].

        If the arm has not reported modes, all are N (fed by the main pump alone).
        """
        if self.modes is not None:
            return self.modes
        return np.full(self.joint_count, Mode.N, dtype=np.uint8)

    def executes_own(self, now_ns: int) -> bool:
        """Return whether the arm moves under a command of this planner.

        Args:
            now_ns: Time of plans [ns]: the arm's clock minus the delay that speed scaling has
                caused.

        Returns:
            True if this planner's last confirmed command has not ended, and the arm reports that it
            executes this command. The second condition is dropped for arms that do not report which
            plan they execute.
        """
        own = self.own_command
        confirmed = own is not None and self.plan_in_force_ns in (None, own.stamp_ns)
        return own is not None and confirmed and now_ns < own.trajectory.end_ns
