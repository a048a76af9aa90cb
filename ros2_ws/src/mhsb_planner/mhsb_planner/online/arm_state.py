"""Arm state: what the planner knows of the arm from its messages, and the command in force.

Plans are stamped by the arm's clock, which is estimated here from the stamps of the arm's messages.
This clock may run at another speed than real time: a simulator may be slower or faster. A plan that
is in time by any other clock may come too late. The steady clock is the planner's own clock, which
is never set.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from mhsb_model.command import Command
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import FloatArray, ModeArray

STAMP_WINDOW = 1.0
"""Age up to which a stamp is used to compute the time of the arm's clock [s].

The age is relative to the latest stamp that was kept. The least delayed stamp counts.
"""

SPEED_WINDOW = 3.0
"""Age up to which a stamp is used to compute the speed of the arm's clock [s]."""

SHORTEST_SPAN = 0.3
"""Shortest span between two stamps from which a speed is computed [s].

A shorter span gives no reliable speed.
"""

STAMP_SPACING = 0.02
"""Length of a time slot [s]. Of each slot only the least delayed stamp is kept."""

MIN_CLOCK_JUMP = 1.0
"""Time by which a stamp is ahead of its expected time if the clock has jumped [s]."""

MAX_UNIT_RATE_DEVIATION = 0.1
"""Largest deviation of a clock's speed from 1 that is explained by delays of messages [-]."""


class ArmClockEstimator:
    """Estimator of the arm's clock [ns] at a time of the steady clock [s]."""

    def __init__(self) -> None:
        """Begin without a stamp."""
        self.forget()

    def forget(self) -> None:
        """Drop all stamps, because another arm sends them or the arm was restarted."""
        self._stamps: deque[tuple[float, int]] = deque()
        self._last: tuple[float, int] | None = None

    def add_stamp(self, stamp_ns: int, steady_time: float) -> bool:
        """Add a stamp, and return whether it is not earlier than the previous stamp.

        All earlier stamps are dropped if the arm's clock has gone back or has jumped ahead. It has
        jumped ahead if the stamp is more than `MIN_CLOCK_JUMP` later than the earlier stamps let
        expect. In each time slot of `STAMP_SPACING` only the least delayed stamp is kept. Stamps
        older than `SPEED_WINDOW` are dropped.

        Args:
            stamp_ns: Stamp by the arm's clock [ns].
            steady_time: Time of receipt by the steady clock [s].

        Returns:
            False if the stamp is earlier than the previous stamp. True otherwise, also after a jump
            ahead.
        """
        went_back = self._last is not None and stamp_ns < self._last[1]
        if went_back or self._jumps_ahead(stamp_ns, steady_time):
            self.forget()
        self._last = (steady_time, stamp_ns)
        if not self._stamps or steady_time // STAMP_SPACING != self._stamps[-1][0] // STAMP_SPACING:
            self._stamps.append(self._last)
        else:
            kept, kept_ns = self._stamps[-1]
            if stamp_ns - kept_ns > self.speed * (steady_time - kept) * SECOND_NS:
                self._stamps[-1] = self._last
        while steady_time - self._stamps[0][0] > SPEED_WINDOW:
            self._stamps.popleft()
        return not went_back

    def keep_last_stamp_only(self) -> None:
        """Drop all stamps but the last one.

        The caller uses this if the extrapolated time turns out to be ahead of the arm's clock.
        """
        if self._last is not None:
            self._stamps = deque([self._last])

    def _jumps_ahead(self, stamp_ns: int, steady_time: float) -> bool:
        """Return whether a stamp is more than `MIN_CLOCK_JUMP` ahead of its expected time.

        The expected time is the last stamp, extrapolated at the estimated speed of the arm's clock.

        Args:
            stamp_ns: Stamp by the arm's clock [ns].
            steady_time: Time of receipt by the steady clock [s].

        Returns:
            True if the stamp is too far ahead. Always False for the first stamp.
        """
        if self._last is None:
            return False
        last, last_ns = self._last
        return (stamp_ns - last_ns) / SECOND_NS > self.speed * (steady_time - last) + MIN_CLOCK_JUMP

    def time_since_last_stamp(self, steady_time: float) -> float:
        """Return the time since the last stamp was received [s]; infinite if there was none.

        Args:
            steady_time: Present time by the steady clock [s].
        """
        return float("inf") if self._last is None else steady_time - self._last[0]

    @property
    def speed(self) -> float:
        """Speed of the arm's clock: seconds on that clock per second of the steady clock [-].

        It is the slope between the first and the last kept stamp, over at most SPEED_WINDOW. It is
        1 in two cases: the two stamps are less than SHORTEST_SPAN apart, or the slope deviates from
        1 by at most MAX_UNIT_RATE_DEVIATION.
        """
        if not self._stamps:
            return 1.0
        (first, first_ns), (last, last_ns) = self._stamps[0], self._stamps[-1]
        if last - first < SHORTEST_SPAN:
            return 1.0
        speed = (last_ns - first_ns) / SECOND_NS / (last - first)
        return 1.0 if abs(speed - 1.0) <= MAX_UNIT_RATE_DEVIATION else speed

    def convert_duration(self, seconds: float) -> float:
        """Convert a real duration to a duration by the arm's clock.

        It is multiplied by the estimated speed of the arm's clock, or by 1 if this is slower.

        Args:
            seconds: Duration by the steady clock [s].

        Returns:
            Duration by the arm's clock [s], not shorter than `seconds`.
        """
        return seconds * max(1.0, self.speed)

    def extrapolate_ns(self, steady_time: float) -> int:
        """Extrapolate the arm's clock to the present.

        Each stamp that is at most `STAMP_WINDOW` older than the last one is extrapolated at the
        estimated speed of the clock. The latest of these times is returned, since it comes from the
        least delayed stamp.

        Args:
            steady_time: Present time by the steady clock [s].

        Returns:
            Present time by the arm's clock [ns].

        Raises:
            ValueError: No stamp has been received.
        """
        if not self._stamps:
            raise ValueError("no stamp of the arm has been heard")
        speed, latest = self.speed, self._stamps[-1][0]
        return max(
            stamp_ns + round(speed * (steady_time - heard) * SECOND_NS)
            for heard, stamp_ns in self._stamps
            if latest - heard <= STAMP_WINDOW
        )


OLDEST_STATE = 0.5
"""Largest age at which a measurement or a reference is still used [s]."""

NO_PLAN = 0
"""Value of `plan_in_force` while the arm holds its position without a plan."""

REST_SPEED = 0.01
"""Joint speed below which an arm counts as standing still [rad/s]; for sliding joints [m/s]."""

REST_TIME = 0.2
"""Time for which the arm must stand still before it counts as at rest [s].

No motion stays below `REST_SPEED` for so long. If all joints reverse at the same time, they are
below it for less than 0.1 s.
"""


@dataclass(frozen=True, eq=False)
class StampedState:
    """State of the arm, with the time of its stamp and the time of its receipt.

    Attributes:
        state: Position, velocity and acceleration of all joints.
        stamp_ns: Stamp of the message by the arm's clock [ns].
        received_at: Time of receipt by the steady clock [s].
    """

    state: MotionState
    stamp_ns: int
    received_at: float


class RestDetector:
    """Detector of a measured standstill of the arm.

    An arm that a servo holds vibrates. Measured velocities reach 0.06 rad/s while positions stay
    within 0.1 mrad. Therefore two speeds are computed over the last `REST_TIME` before the last
    measurement, and the smaller one counts. One is the largest measured velocity. The other is the
    largest change of a joint's position, divided by `REST_TIME`.
    """

    def __init__(self) -> None:
        """Begin without a measurement."""
        self._states: deque[tuple[float, float, FloatArray]] = deque()
        self._since = math.inf

    def add_measurement(self, state: MotionState, steady_time: float) -> None:
        """Add a measurement, and drop measurements that are older than `REST_TIME`.

        The series of measurements starts anew after a gap of more than `OLDEST_STATE`. Measurements
        of all publishers are added to one series. If two arms use one name, both must rest.

        Args:
            state: Measured position [rad or m] and velocity [rad/s or m/s] of all joints.
            steady_time: Time of receipt by the steady clock [s].
        """
        if self._states and steady_time - self._states[-1][0] > OLDEST_STATE:
            self._states.clear()
        if not self._states:
            self._since = steady_time
        self._states.append((steady_time, float(np.abs(state.velocity).max()), state.position))
        while steady_time - self._states[0][0] > REST_TIME:
            self._states.popleft()

    def is_at_rest(self, steady_time: float) -> bool:
        """Return whether the arm has been measured at rest for `REST_TIME`.

        Args:
            steady_time: Present time by the steady clock [s].

        Returns:
            True if three conditions hold. The last measurement is at most `OLDEST_STATE` old.
            Measurements have come for at least `REST_TIME`. The joint speed over the last
            `REST_TIME` is below `REST_SPEED`.
        """
        if not self._states or steady_time - self._states[-1][0] > OLDEST_STATE:
            return False
        last = self._states[-1][0]
        return last - self._since >= REST_TIME and self._compute_speed() < REST_SPEED

    def describe_motion(self, steady_time: float) -> str:
        """Describe why the arm does not count as resting.

        Args:
            steady_time: Present time by the steady clock [s].

        Returns:
            Clause without capital letter and full stop. It states that nothing was measured within
            `OLDEST_STATE`, or it states the measured joint speed and its limit [rad/s].
        """
        if not self._states or steady_time - self._states[-1][0] > OLDEST_STATE:
            return f"nothing was measured of the arm in the last {OLDEST_STATE:g} s (joint_states)"
        speed = self._compute_speed()
        return f"a joint of the arm moves at {speed:.3g} rad/s, it rests below {REST_SPEED:g} rad/s"

    def _compute_speed(self) -> float:
        """Compute the joint speed over the measurements of the last `REST_TIME`.

        Two speeds are compared. One is the largest measured velocity of any joint. The other is the
        largest change of any joint's position, divided by `REST_TIME`.

        Returns:
            The smaller of the two speeds, not negative [rad/s]. For a joint that slides it is in
            m/s.
        """
        by_velocity = max(speed for _, speed, _ in self._states)
        by_position = float(np.ptp([position for *_, position in self._states], axis=0).max())
        return min(by_velocity, by_position / REST_TIME)


@dataclass
class ArmState:
    """Latest messages of the arm, and what follows from them.

    None means that nothing was received.

    Attributes:
        joint_count: Number of joints.
        reference: State that the servo follows.
        measured: Measured joint state; its acceleration is 0.
        plan_in_force_ns: Stamp of the plan that the arm reports to execute [ns]. `NO_PLAN` while it
            holds its position.
        modes: Mode of each actuator as the arm reports it, uint8[n].
        own_command: This planner's last command that the arm has confirmed. Some arms do not report
            their plan in force; for these every sent command counts as confirmed.
        fault: Sentence on the fault for which the arm has stopped and takes no plan. Empty if there
            is no fault.
        plan_delay_ns: Time by which the arm executes plans later than stamped, because its
            reference governor has slowed them [ns].
        publisher_conflict: Sentence that names the publishers of the arm's reference if there are
            several. Empty if there is one.
        qos_mismatch: Sentence that names publishers whose quality of service does not match. Empty
            if there are none.
        machine_difference: Sentence on how the arm's machine file differs from the planner's. Empty
            if they are equal.
        is_machine_known: True if the arm has reported its machine, or turned out not to report it.
        first_state_at: Time of receipt of the first state by the steady clock [s]; infinite before.
        clock_estimator: Estimator of the arm's clock.
        rest_detector: Detector of a measured standstill.
    """

    joint_count: int
    reference: StampedState | None = None
    measured: StampedState | None = None
    plan_in_force_ns: int | None = None
    modes: ModeArray | None = None
    own_command: Command | None = None
    fault: str = ""
    plan_delay_ns: int = 0
    publisher_conflict: str = ""
    qos_mismatch: str = ""
    machine_difference: str = ""
    is_machine_known: bool = False
    first_state_at: float = math.inf
    clock_estimator: ArmClockEstimator = field(default_factory=ArmClockEstimator)
    rest_detector: RestDetector = field(default_factory=RestDetector)

    def forget(self) -> None:
        """Drop all data that depend on the arm's clock, after a clock jump or a reset.

        These are the reference, the measured state, this planner's command, the stamp of the plan
        in force, the plan delay and the clock estimate. The modes stay, since they have no stamp.
        The report that no plan is in force (`NO_PLAN`) stays, too. It may have come before the
        stamp that shows the jump.
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
        self.reference = StampedState(state, stamp_ns, steady_time)
        self.first_state_at = min(self.first_state_at, steady_time)
        if self.measured is None:
            self.rest_detector.add_measurement(state, steady_time)

    def add_measurement(self, state: MotionState, stamp_ns: int, steady_time: float) -> None:
        """Store the measured state of the joints, and use it to detect rest.

        Args:
            state: Measured position and velocity of all joints; its acceleration is 0.
            stamp_ns: Stamp by the arm's clock [ns]; it does not update the estimate of that clock.
            steady_time: Time of receipt by the steady clock [s].
        """
        self.measured = StampedState(state, stamp_ns, steady_time)
        self.first_state_at = min(self.first_state_at, steady_time)
        self.rest_detector.add_measurement(state, steady_time)

    def get_plan_time_ns(self, steady_time: float, ros_ns: int) -> int:
        """Return the present time of plans: the time by which plans are stamped.

        It is the extrapolated time of the arm's clock minus `plan_delay_ns`. If the arm has been
        silent for more than `OLDEST_STATE`, the ROS clock replaces the extrapolated time if it is
        earlier. The arm itself may publish the ROS clock, which then stands still with the arm.

        Args:
            steady_time: Present time by the steady clock [s].
            ros_ns: Present time by the ROS clock [ns].

        Returns:
            Time of plans [ns]. If no stamp has come from the arm, it is `ros_ns` without a
            subtraction.
        """
        silence = self.clock_estimator.time_since_last_stamp(steady_time)
        if silence == math.inf:
            return ros_ns
        now_ns = self.clock_estimator.extrapolate_ns(steady_time)
        return (min(now_ns, ros_ns) if silence > OLDEST_STATE else now_ns) - self.plan_delay_ns

    def has_fresh_state(self, steady_time: float) -> bool:
        """Return whether a reference or measurement was received at most `OLDEST_STATE` ago."""
        return self.is_fresh(self.reference, steady_time) or self.is_fresh(
            self.measured, steady_time
        )

    def get_fresh_state(self, steady_time: float) -> MotionState | None:
        """Return the reference that the servo follows, or else the measured state.

        Args:
            steady_time: Present time by the steady clock [s].

        Returns:
            Position, velocity and acceleration of all joints. It is the reference if this was
            received at most `OLDEST_STATE` ago, otherwise the measured state. None if both are
            older or missing.
        """
        for heard in (self.reference, self.measured):
            if heard is not None and self.is_fresh(heard, steady_time):
                return heard.state
        return None

    @staticmethod
    def is_fresh(stamped_state: StampedState | None, steady_time: float) -> bool:
        """Return whether a state exists and was received at most `OLDEST_STATE` ago."""
        return stamped_state is not None and steady_time - stamped_state.received_at <= OLDEST_STATE

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
            now_ns: Time of plans [ns]: the arm's clock minus the arm's delay behind its plans.

        Returns:
            True if this planner's last confirmed command has not ended, and if it is the one that
            the arm reports to execute. Some arms do not report which plan they execute; for these,
            the first condition suffices.
        """
        own = self.own_command
        confirmed = own is not None and self.plan_in_force_ns in (None, own.stamp_ns)
        return own is not None and confirmed and now_ns < own.trajectory.end_ns
