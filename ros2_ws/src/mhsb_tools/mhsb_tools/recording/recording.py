"""Decoded content of a recording: a table for each stream, and domain objects for the rest.

Streams have their own stamps in ROS time. Messages without a stamp (`modes`, `plan_in_force`, goals
as they were sent) have only a log time, the system clock at which they were recorded. It is
translated into ROS time by the joint states, each of which has both times.
"""

from __future__ import annotations

from array import array
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from rclpy.serialization import deserialize_message

from mhsb_model.arm_reports import HandOverReport, SimulatorReport
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_msgs_py import (
    actuator_states,
    estimates,
    goal_pose,
    joint_state,
    mode_schedule,
    modes_in_force,
    names,
    plan_status,
    reference,
    sim_status,
    stamps,
    topics,
    trajectory,
)
from mhsb_msgs_py.errors import GoalError, MessageError
from mhsb_msgs_py.topics import Topic
from mhsb_tools.recording.bag_format import BagError, check_structure

MAX_MESSAGE_SIZE = 1024 * 1024
"""Largest message that is decoded [bytes], except for trajectories and schedules; the suite's take
2 KB.
"""

MAX_POINTS_SIZE = 16 * 1024 * 1024
"""Largest trajectory or mode schedule that is decoded [bytes]; 40,000 points of 8 joints take 9."""

MAX_SENTENCES = 1000
"""Number of unreadable messages for which a sentence is kept; further ones are only counted."""

MAX_NUMBER = 1e15
"""Largest magnitude that is accepted as a measurement, in SI units; pressures are below 1e9 Pa."""

TIME_RUNS_BACKWARDS = (
    "time runs backwards in the recording, the simulator was started anew meanwhile; "
    "record each run on its own"
)

MAX_JOINTS = 64
"""Largest number of joints that is read."""

LAST_LOG_NS = 2**62
"""Log times from here on, after the year 2116, are refused as wrong [ns]."""


class RecordedMessage(NamedTuple):
    """A serialized message of one of the suite's topics.

    Attributes:
        topic: The topic.
        type_name: Type that the recording states for it.
        log_ns: Log time (system clock, when it was recorded) [ns].
        data: Serialized message.
    """

    topic: Topic
    type_name: str
    log_ns: int
    data: bytes


RecordedMessages = Callable[[], Iterable[RecordedMessage]]
"""Function that returns an iterable over all messages, in any order, each time it is called."""


@dataclass(frozen=True)
class JointTable:
    """Stream of joint motion with k rows and n joints, in the order of log time.

    Telescopes have m in place of rad.

    Attributes:
        time_ns: ROS time, int64 (k,) [ns].
        position: Joint positions, shape (k, n) [rad].
        velocity: Joint velocities, shape (k, n) [rad/s].
        acceleration: Joint accelerations, shape (k, n) [rad/s²]; nan for measurements.
        recorded_ns: Log times (system clock, when each state was recorded), int64 (k,) [ns].
    """

    time_ns: IntArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    recorded_ns: IntArray


@dataclass(frozen=True)
class ActuatorTable:
    """Stream of hydraulic states with k rows and n actuators, in the order of log time.

    Attributes:
        time_ns: ROS time, int64 (k,) [ns].
        quantity: Each quantity by its name in `ActuatorSample`, shape (k, n), SI units.
    """

    time_ns: IntArray
    quantity: dict[str, FloatArray]


@dataclass(frozen=True)
class TimedValue:
    """A decoded message without a stamp, and its times.

    Attributes:
        time_ns: ROS time at which it was recorded [ns].
        value: The decoded message.
        recorded_ns: Log time (system clock, when it was recorded) [ns].
    """

    time_ns: int
    value: Any
    recorded_ns: int = 0


@dataclass(frozen=True)
class Recording:
    """Decoded content of a recording of an arm with n joints.

    Each `TimedValue` has a decoded message and the time at which it was recorded.

    Attributes:
        joint_count: Number of joints n.
        joint_states: Measured motion of the joints.
        references: Motion of the joints that the servo followed.
        actuators: Hydraulic states.
        mode_time_ns: ROS time of each row of `modes`, int64 (m,) [ns].
        modes: Mode codes in force from that time on, uint8 (m, n).
        plans_in_force: Stamp [ns] of each plan that came into force, 0 for a hold, with its time.
        trajectories: Published trajectories, in the order of log time.
        schedules: Published mode schedules, in the order of log time.
        goals: `Goal` of each goal pose, with its time; also of poses that cannot be used.
        reports: Verdicts and execution reports, each with its time.
        hand_overs: `HandOverReport` of each plan that reached the simulator, with its time.
        simulator_reports: `SimulatorReport` of about every second, with its time.
        unreadable: One sentence for each message that breaks its contract, at most MAX_SENTENCES,
            and one more with the number of all others.
        unreadable_count: Number of messages that break their contract.
        estimates: Lists of `Estimate` by the servo's estimators, each with its time.
    """

    joint_count: int
    joint_states: JointTable
    references: JointTable
    actuators: ActuatorTable
    mode_time_ns: IntArray
    modes: ModeArray
    plans_in_force: tuple[TimedValue, ...]
    trajectories: tuple[Trajectory, ...]
    schedules: tuple[ModeSchedule, ...]
    goals: tuple[TimedValue, ...]
    reports: tuple[TimedValue, ...]
    hand_overs: tuple[TimedValue, ...]
    simulator_reports: tuple[TimedValue, ...]
    unreadable: tuple[str, ...] = field(default=())
    unreadable_count: int = 0
    estimates: tuple[TimedValue, ...] = field(default=())


def decode_recording(
    messages: RecordedMessages, source_name: str, namespace: str = "", slews: bool = False
) -> Recording:
    """Decode the messages of a recording to tables and domain objects.

    A message that is damaged, has a wrong type or has impossible values is left out and noted in
    `unreadable`.

    Args:
        messages: Function that returns all messages; it is called twice.
        source_name: Name of the recording in error messages, such as "the recording DIR".
        namespace: Namespace of the topics, such as `/left`, for error messages.
        slews: Whether the arm slews, so that goals have a y coordinate.

    Returns:
        The decoded recording.

    Raises:
        BagError: There are no readable joint states.
    """
    topic = f"{namespace}/{topics.JOINT_STATES.name}"
    return _Decoder(_find_joint_count(messages, source_name, topic), slews).recording(messages)


def _find_joint_count(messages: RecordedMessages, source_name: str, topic_name: str) -> int:
    """Return the number of joints in the first readable joint states.

    Args:
        messages: Function that returns all messages; it is called once.
        source_name: Name of the recording in error messages.
        topic_name: Name of the joint states' topic in error messages.

    Returns:
        The number of joints, at most MAX_JOINTS.

    Raises:
        BagError: There are no readable joint states.
    """
    problem = ""
    for message in messages():
        if message.topic is not topics.JOINT_STATES:
            continue
        try:
            states = _deserialized(message)
            count = len(states.name)
            if not 0 < count <= MAX_JOINTS:
                raise MessageError(f"they are of {count} joints; at most {MAX_JOINTS} are read")
            _check_numbers(joint_state.decode(states, names.joint_names(count)))
            return count
        except MessageError as error:
            problem = problem or str(error)
    if problem:
        raise BagError(f"{source_name} has no messages on {topic_name} that can be read: {problem}")
    raise BagError(f"{source_name} has no messages on {topic_name}; was the simulator running?")


def _deserialized(message: RecordedMessage) -> Any:
    """Deserialize a message after a check of its bytes; raises MessageError if they are wrong."""
    return deserialize_message(_check_message(message, MAX_MESSAGE_SIZE), message.topic.message)


def _check_message(message: RecordedMessage, max_size: int) -> bytes:
    """Check the bytes of a message before they are decoded.

    Args:
        message: The message.
        max_size: Largest size that is accepted [bytes].

    Returns:
        The unchanged bytes.

    Raises:
        MessageError: The message was recorded with another type than `message.topic.type_name`. Or
            its size or log time is out of range, or the bytes cannot be a message of the type.
    """
    topic, type_name, log_ns, data = message
    if type_name != topic.type_name:
        raise MessageError(f"was recorded as {type_name}; it must be {topic.type_name}")
    if len(data) > max_size:
        raise MessageError(f"a message has {len(data)} bytes; at most {max_size} are read")
    if log_ns >= LAST_LOG_NS:
        raise MessageError(f"a message was recorded at {log_ns} ns, which is no time of today")
    check_structure(type_name, data)
    return data


class _GrowingTable:
    """Growing table with two times and some vectors of numbers in each row.

    Attributes:
        time_ns: ROS time of each row [ns].
        log_ns: Log time of each row [ns].
        numbers: All numbers, row after row, and in each row vector after vector.
    """

    def __init__(self) -> None:
        self.time_ns, self.log_ns, self.numbers = array("q"), array("q"), array("d")

    def add(self, time_ns: int, log_ns: int, *columns: FloatArray) -> None:
        """Append a row.

        Args:
            time_ns: ROS time [ns].
            log_ns: Log time [ns].
            columns: Vectors of the row, float64. All rows must have the same number of vectors, and
                all vectors the same size.

        Raises:
            MessageError: The magnitude of a finite number is above MAX_NUMBER; the row is not
                appended.
        """
        _check_numbers(columns)
        self.time_ns.append(time_ns)
        self.log_ns.append(log_ns)
        for column in columns:
            self.numbers.frombytes(column.tobytes())

    def sort_into_arrays(
        self, count: int, width: int
    ) -> tuple[IntArray, IntArray, list[FloatArray]]:
        """Return the rows, sorted by log time, as one array for each vector.

        Args:
            count: Number of vectors in a row.
            width: Numbers in a vector.

        Returns:
            ROS times, int64 (k,) [ns], and log times, int64 (k,) [ns]. Then a list with an array of
            shape (k, width) for each of the `count` vectors of a row. All are in the order of log
            time.
        """
        log_ns = np.array(self.log_ns, dtype=np.int64)
        order = np.argsort(log_ns, kind="stable")
        numbers = np.frombuffer(self.numbers).reshape(len(order), count, width)
        time_ns = np.array(self.time_ns, dtype=np.int64)[order]
        return time_ns, log_ns[order], [numbers[order, each] for each in range(count)]


class _Decoder:
    """Decoder of all messages of a recording; unreadable messages are noted and left out."""

    def __init__(self, joint_count: int, slews: bool) -> None:
        """Prepare the decoders of all topics; no message is decoded yet.

        Args:
            joint_count: Number of joints and actuators.
            slews: Whether the arm slews, so that goals have a y coordinate.
        """
        self._joint_count = joint_count
        self._joints = names.joint_names(joint_count)
        self._actuators = names.actuator_names(joint_count)
        self._unreadable: list[str] = []
        self._unreadable_count = 0
        self._states, self._references, self._hydraulics = (
            _GrowingTable(),
            _GrowingTable(),
            _GrowingTable(),
        )
        self._values: dict[Topic, list[tuple[int, Any]]] = defaultdict(list)
        # A goal in `work_plane` depends on where a slewing arm was; its verdict states the place.
        to_base = (lambda _, height: (np.nan, np.nan, height)) if slews else None
        self._decoders: dict[Topic, Callable[[RecordedMessage], Any]] = {
            topics.MODES: lambda each: modes_in_force.decode(_deserialized(each), joint_count),
            topics.PLAN_IN_FORCE: lambda each: stamps.from_time(_deserialized(each)),
            topics.JOINT_TRAJECTORY: lambda each: trajectory.decode(
                _check_message(each, MAX_POINTS_SIZE), self._joints
            ),
            topics.MODE_COMMANDS: lambda each: mode_schedule.decode(
                _check_message(each, MAX_POINTS_SIZE), self._actuators
            ),
            topics.GOAL_POSE: lambda each: goal_pose.decode(_deserialized(each), "", to_base),
            topics.PLAN_STATUS: lambda each: plan_status.decode(_deserialized(each)),
            topics.DIAGNOSTICS: lambda each: sim_status.decode(_deserialized(each)),
            topics.ESTIMATES: lambda each: estimates.decode(_deserialized(each)),
        }

    def recording(self, messages: RecordedMessages) -> Recording:
        """Decode all messages and return the recording.

        Args:
            messages: Function that returns all messages; it is called once. At least one must be a
                readable joint state.

        Returns:
            The decoded recording. Unreadable messages are left out and counted.
        """
        for message in messages():
            try:
                self._decode_message(message)
            except MessageError as error:
                self._unreadable_count += 1
                if len(self._unreadable) < MAX_SENTENCES:
                    self._unreadable.append(f"{message.topic.name}: {error}")
        clock = _RecordedClock(self._states)
        modes = self._timed(topics.MODES, clock)
        diagnostics = _flatten_reports(self._timed(topics.DIAGNOSTICS, clock))
        return Recording(
            joint_count=self._joint_count,
            joint_states=self._joint_table(self._states, 2),
            references=self._joint_table(self._references, 3),
            actuators=self._actuator_table(),
            mode_time_ns=np.array([each.time_ns for each in modes], dtype=np.int64),
            modes=np.array([each.value for each in modes], dtype=np.uint8).reshape(
                len(modes), self._joint_count
            ),
            plans_in_force=tuple(self._timed(topics.PLAN_IN_FORCE, clock)),
            trajectories=tuple(each.value for each in self._timed(topics.JOINT_TRAJECTORY, clock)),
            schedules=tuple(each.value for each in self._timed(topics.MODE_COMMANDS, clock)),
            goals=tuple(self._timed(topics.GOAL_POSE, clock)),
            reports=_flatten_reports(self._timed(topics.PLAN_STATUS, clock)),
            hand_overs=_select_kind(HandOverReport, diagnostics),
            simulator_reports=_select_kind(SimulatorReport, diagnostics),
            estimates=tuple(self._timed(topics.ESTIMATES, clock)),
            unreadable=self._sentences(),
            unreadable_count=self._unreadable_count,
        )

    def _decode_message(self, message: RecordedMessage) -> None:
        """Decode one message and store it with the others of its topic.

        Messages of topics without a decoder, such as markers, are ignored. Goals are stored even if
        they cannot be used.

        Args:
            message: The message.

        Raises:
            MessageError: The message is damaged, has a wrong type, or has impossible values.
        """
        topic, log_ns = message.topic, message.log_ns
        if topic is topics.JOINT_STATES:
            sample = joint_state.decode(_deserialized(message), self._joints)
            self._states.add(sample.stamp_ns, log_ns, sample.position, sample.velocity)
        elif topic is topics.REFERENCE:
            followed = reference.decode(_deserialized(message), self._joints)
            state = followed.state
            self._references.add(
                followed.stamp_ns, log_ns, state.position, state.velocity, state.acceleration
            )
        elif topic is topics.ACTUATOR_STATES:
            hydraulic = actuator_states.decode(_deserialized(message), self._actuators)
            columns = (getattr(hydraulic, each) for each in actuator_states.SAMPLE_FIELDS)
            self._hydraulics.add(hydraulic.stamp_ns, log_ns, *columns)
        elif topic in self._decoders:
            try:
                value = self._decoders[topic](message)
            except GoalError as error:
                self._values[topic].append((log_ns, error.goal))
                raise
            _check_numbers(value)
            self._values[topic].append((log_ns, value))

    def _joint_table(self, rows: _GrowingTable, count: int) -> JointTable:
        """Convert collected rows to a table of joint motion.

        Args:
            rows: Rows of position, velocity and, if `count` is 3, acceleration.
            count: Number of vectors in a row, 2 or 3. With 2, all accelerations in the table are
                nan.

        Returns:
            The table, sorted by log time.
        """
        time_ns, log_ns, columns = rows.sort_into_arrays(count, self._joint_count)
        columns += [np.full_like(columns[0], np.nan)] * (3 - count)
        position, velocity, acceleration = columns
        return JointTable(time_ns, position, velocity, acceleration, log_ns)

    def _actuator_table(self) -> ActuatorTable:
        """Convert the collected hydraulic states to a table.

        Returns:
            The table, sorted by log time; empty arrays if none were recorded.
        """
        quantities = actuator_states.SAMPLE_FIELDS
        time_ns, _, columns = self._hydraulics.sort_into_arrays(len(quantities), self._joint_count)
        return ActuatorTable(time_ns, dict(zip(quantities, columns, strict=True)))

    def _timed(self, topic: Topic, clock: _RecordedClock) -> list[TimedValue]:
        """Return the decoded messages of a topic with their times, in the order of log time.

        Args:
            topic: The topic.
            clock: Translation of log times into ROS time.

        Returns:
            Each decoded message with ROS time and log time.
        """
        values = sorted(self._values[topic], key=itemgetter(0))
        return [TimedValue(clock.ros_time(log_ns), value, log_ns) for log_ns, value in values]

    def _sentences(self) -> tuple[str, ...]:
        """Return a sentence for each unreadable message, at most MAX_SENTENCES.

        If there were more, one further text states how many.
        """
        more = self._unreadable_count - len(self._unreadable)
        return (*self._unreadable, *([f"and {more} more"] if more else []))


class _RecordedClock:
    """Translation of log times into ROS time, from the joint states, which have both."""

    def __init__(self, states: _GrowingTable) -> None:
        """Take the times of all joint states.

        Args:
            states: Rows of the joint states; at least one.
        """
        self._ros_ns, self._log_ns, _ = states.sort_into_arrays(
            1, len(states.numbers) // len(states.log_ns)
        )
        self._ros_since, self._log_since = (
            (each - each[0]).astype(np.float64) for each in (self._ros_ns, self._log_ns)
        )

    def ros_time(self, log_ns: int) -> int:
        """Convert the log time of a message (system clock) to ROS time.

        Joint states have both times, so the time between two of them is interpolated linearly.
        Before the first and after the last joint state, both clocks are assumed to run at the same
        rate.

        Args:
            log_ns: Log time of the message [ns].

        Returns:
            ROS time [ns].
        """
        first_ns, last_ns = int(self._log_ns[0]), int(self._log_ns[-1])
        inside_ns = min(max(log_ns, first_ns), last_ns)
        since_ns = np.interp(float(inside_ns - first_ns), self._log_since, self._ros_since)
        return int(self._ros_ns[0]) + round(float(since_ns)) + log_ns - inside_ns


def check_order(recording: Recording) -> None:
    """Check that the ROS time of joint states and of hydraulic states never decreases.

    It decreases if the simulator was started again during the recording.

    Args:
        recording: The recording; its tables are in the order of log time.

    Raises:
        BagError: A ROS time decreases.
    """
    for time_ns in (recording.joint_states.time_ns, recording.actuators.time_ns):
        if np.any(time_ns[1:] < time_ns[:-1]):
            raise BagError(TIME_RUNS_BACKWARDS)


def _check_numbers(value: Any) -> None:
    """Check that no finite floating-point number in a decoded value is too large.

    Arrays, lists, tuples and dataclasses are searched recursively. Infinite numbers, nan and
    integers are accepted.

    Args:
        value: Decoded message or part of one.

    Raises:
        MessageError: The magnitude of a number is above MAX_NUMBER.
    """
    if isinstance(value, list | tuple):
        for each in value:
            _check_numbers(each)
    elif is_dataclass(value):
        for each in fields(value):
            _check_numbers(getattr(value, each.name))
    elif isinstance(value, float | np.ndarray):
        numbers = np.abs(np.asarray(value, dtype=np.float64))
        if np.any(np.isfinite(numbers) & (numbers > MAX_NUMBER)):
            raise MessageError(f"a number is beyond {MAX_NUMBER:g}; no measurement is")


def _flatten_reports(timed: Sequence[TimedValue]) -> tuple[TimedValue, ...]:
    """Return the single reports of messages that have several reports each.

    Args:
        timed: Messages; the value of each is a list of reports.

    Returns:
        The reports in order, each with the times of its message.
    """
    return tuple(
        TimedValue(each.time_ns, report, each.recorded_ns)
        for each in timed
        for report in each.value
    )


def _select_kind(kind: type, statuses: Sequence[TimedValue]) -> tuple[TimedValue, ...]:
    """Return those elements of `statuses` whose value is an instance of the class `kind`."""
    return tuple(each for each in statuses if isinstance(each.value, kind))
