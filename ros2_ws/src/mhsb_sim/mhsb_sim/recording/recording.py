"""What has been heard of the suite: one table for each stream, domain objects for the rest.

Streams carry their own stamps in ROS time. What has no stamp (`modes`, `plan_in_force`, goals as
they were sent) is placed by its time of recording, which is translated into ROS time by way of
the joint states: each of those has both times.
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

from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory
from mhsb_model.types import FloatArray, IntArray, ModeArray, Position
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
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.sim_status import HandOverReport, SimulatorReport
from mhsb_msgs_py.topics import Topic
from mhsb_sim.recording import cdr_structure
from mhsb_sim.recording.bag_format import BagError

MAX_MESSAGE_SIZE = 1024 * 1024
"""Largest message that is decoded [bytes]; the suite's take 2 KB, those with points apart."""

MAX_POINTS_SIZE = 16 * 1024 * 1024
"""Largest trajectory or mode schedule that is decoded [bytes]; 40,000 points of 8 joints take 9."""

MAX_SENTENCES = 1000
"""Unreadable messages of which a sentence is kept; further ones are only counted."""

MAX_NUMBER = 1e15
"""Largest number that is taken for a measurement, in SI units; pressures are below 1e9 Pa."""

TIME_RUNS_BACKWARDS = (
    "time runs backwards in the recording, the simulator was started anew meanwhile; "
    "record each run on its own"
)

MAX_JOINTS = 64
LAST_LOG_NS = 2**62
"""Times of recording from here on, after the year 2116, are no times [ns]."""


class RecordedMessage(NamedTuple):
    """A serialized message: its topic, the type it is said to have, when it was recorded [ns]."""

    topic: Topic
    type_name: str
    log_ns: int
    data: bytes


RecordedMessages = Callable[[], Iterable[RecordedMessage]]
"""Function that goes through all messages anew, in any order."""


@dataclass(frozen=True)
class JointTable:
    """A stream of joint motion; acceleration of measurements is not a number.

    time_ns       int64[k], ROS time
    position      float64[k, n], rad
    velocity      float64[k, n], rad/s
    acceleration  float64[k, n], rad/s²
    recorded_ns   int64[k], when they were recorded, by the system's clock
    """

    time_ns: IntArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    recorded_ns: IntArray


@dataclass(frozen=True)
class ActuatorTable:
    """A stream of hydraulic states.

    time_ns   int64[k], ROS time
    quantity  float64[k, n] by the names of `ActuatorSample`, SI units
    """

    time_ns: IntArray
    quantity: dict[str, FloatArray]


@dataclass(frozen=True)
class Timed:
    """Something that has no stamp of its own, and when it was recorded, in ROS time [ns].

    recorded_ns  the same by the system's clock
    """

    time_ns: int
    value: Any
    recorded_ns: int = 0


@dataclass(frozen=True)
class Recording:
    """All that a recording holds of the suite, n joints.

    joint_states       measured motion
    references         motion that the servo followed
    actuators          hydraulic state
    mode_time_ns       int64[m], ROS time
    modes              uint8[m, n], modes in force from that time on
    plans_in_force     stamps [ns] of the plans executed, 0 = hold, each with its time
    trajectories       as published, in order
    schedules          as published, in order
    goals_sent         number of goal poses, readable or not
    goals              `Goal` of each goal pose that can be read, with its time
    reports            verdicts and execution reports, each with its time
    hand_overs         `HandOverReport` of each plan that reached the simulator, with its time
    simulator_reports  `SimulatorReport` of every second, with its time
    estimates          lists of `Estimate`, what the servo has learnt, each with its time
    unreadable         one sentence for each message that breaks its contract, at most MAX_SENTENCES
                       and one more with the number of the others
    unreadable_count   messages that break their contract
    """

    joint_count: int
    joint_states: JointTable
    references: JointTable
    actuators: ActuatorTable
    mode_time_ns: IntArray
    modes: ModeArray
    plans_in_force: tuple[Timed, ...]
    trajectories: tuple[Trajectory, ...]
    schedules: tuple[ModeSchedule, ...]
    goals_sent: int
    goals: tuple[Timed, ...]
    reports: tuple[Timed, ...]
    hand_overs: tuple[Timed, ...]
    simulator_reports: tuple[Timed, ...]
    unreadable: tuple[str, ...] = field(default=())
    unreadable_count: int = 0
    estimates: tuple[Timed, ...] = field(default=())


def decoded(
    messages: RecordedMessages, what: str, namespace: str = "", slews: bool = False
) -> Recording:
    """Decode messages into what they say.

    Args:
        messages: Goes through them; it is called twice.
        what: They are called in errors.
        namespace: Below which the topics were, such as `/left`.
        slews: Whether the arm does, so that goals have a y.

    Raises:
        BagError: There are no joint states that can be read.
    """
    topic = f"{namespace}/{topics.JOINT_STATES.name}"
    return _Decoder(_first_joint_count(messages, what, topic), slews).recording(messages)


def _first_joint_count(messages: RecordedMessages, what: str, name: str) -> int:
    """Return the number of joints in the first joint states that can be read."""
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
        raise BagError(f"{what} has no messages on {name} that can be read: {problem}")
    raise BagError(f"{what} has no messages on {name}; was the simulator running?")


def _deserialized(message: RecordedMessage) -> Any:
    """Return the message that bytes are; raises MessageError unless they are one of its topic."""
    return deserialize_message(_checked(message, MAX_MESSAGE_SIZE), message.topic.message)


def _checked(message: RecordedMessage, largest: int) -> bytes:
    """Return the bytes of a message; raises MessageError unless they are one of its topic."""
    topic, type_name, log_ns, data = message
    if type_name != topic.type_name:
        raise MessageError(f"was recorded as {type_name}; it must be {topic.type_name}")
    if len(data) > largest:
        raise MessageError(f"a message has {len(data)} bytes; at most {largest} are read")
    if log_ns >= LAST_LOG_NS:
        raise MessageError(f"a message was recorded at {log_ns} ns, which is no time of today")
    cdr_structure.check_structure(type_name, data)
    return data


class _Rows:
    """A growing table: times [ns], numbers, and times of recording [ns]."""

    def __init__(self) -> None:
        self.time_ns, self.log_ns, self.numbers = array("q"), array("q"), array("d")

    def add(self, time_ns: int, log_ns: int, *columns: FloatArray) -> None:
        """Append a row; raises MessageError for a number beyond MAX_NUMBER."""
        _check_numbers(columns)
        self.time_ns.append(time_ns)
        self.log_ns.append(log_ns)
        for column in columns:
            self.numbers.frombytes(column.tobytes())

    def tables(self, count: int, width: int) -> tuple[IntArray, IntArray, list[FloatArray]]:
        """Return times, times of recording, and that many tables of a width, as recorded."""
        log_ns = np.array(self.log_ns, dtype=np.int64)
        order = np.argsort(log_ns, kind="stable")
        numbers = np.frombuffer(self.numbers).reshape(len(order), count, width)
        time_ns = np.array(self.time_ns, dtype=np.int64)[order]
        return time_ns, log_ns[order], [numbers[order, each] for each in range(count)]


class _Decoder:
    """Sorts messages by topic and decodes them; what cannot be read is noted and left out."""

    def __init__(self, joint_count: int, slews: bool) -> None:
        self._joint_count = joint_count
        self._joints = names.joint_names(joint_count)
        self._actuators = names.actuator_names(joint_count)
        self._unreadable: list[str] = []
        self._unreadable_count = 0
        self._states, self._references, self._hydraulics = _Rows(), _Rows(), _Rows()
        self._values: dict[Topic, list[tuple[int, Any]]] = defaultdict(list)
        self._goals_sent = 0
        to_base = _unknown_plane if slews else None
        self._decoders: dict[Topic, Callable[[RecordedMessage], Any]] = {
            topics.MODES: lambda each: modes_in_force.decode(_deserialized(each), joint_count),
            topics.PLAN_IN_FORCE: lambda each: stamps.from_time(_deserialized(each)),
            topics.JOINT_TRAJECTORY: lambda each: trajectory.decode(
                _checked(each, MAX_POINTS_SIZE), self._joints
            ),
            topics.MODE_COMMANDS: lambda each: mode_schedule.decode(
                _checked(each, MAX_POINTS_SIZE), self._actuators
            ),
            topics.GOAL_POSE: lambda each: goal_pose.decode(_deserialized(each), "", to_base),
            topics.PLAN_STATUS: lambda each: plan_status.decode(_deserialized(each)),
            topics.DIAGNOSTICS: lambda each: sim_status.decode(_deserialized(each)),
            topics.ESTIMATES: lambda each: estimates.decode(_deserialized(each)),
        }

    def recording(self, messages: RecordedMessages) -> Recording:
        """Decode everything."""
        for message in messages():
            try:
                self._take(message)
            except MessageError as error:
                self._unreadable_count += 1
                if len(self._unreadable) < MAX_SENTENCES:
                    self._unreadable.append(f"{message.topic.name}: {error}")
        clock = _RecordedClock(self._states)
        modes = self._timed(topics.MODES, clock)
        diagnostics = _flat(self._timed(topics.DIAGNOSTICS, clock))
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
            trajectories=self._all(topics.JOINT_TRAJECTORY),
            schedules=self._all(topics.MODE_COMMANDS),
            goals_sent=self._goals_sent,
            goals=tuple(self._timed(topics.GOAL_POSE, clock)),
            reports=_flat(self._timed(topics.PLAN_STATUS, clock)),
            hand_overs=_of_kind(HandOverReport, diagnostics),
            simulator_reports=_of_kind(SimulatorReport, diagnostics),
            estimates=tuple(self._timed(topics.ESTIMATES, clock)),
            unreadable=self._sentences(),
            unreadable_count=self._unreadable_count,
        )

    def _take(self, message: RecordedMessage) -> None:
        """Decode one message; raises MessageError if it cannot be read."""
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
            columns = (getattr(hydraulic, each) for each in actuator_states.QUANTITIES)
            self._hydraulics.add(hydraulic.stamp_ns, log_ns, *columns)
        elif topic in self._decoders:
            self._goals_sent += topic is topics.GOAL_POSE
            value = self._decoders[topic](message)
            _check_numbers(value)
            self._values[topic].append((log_ns, value))

    def _joint_table(self, rows: _Rows, count: int) -> JointTable:
        """Return joint motion of which that many derivatives are known, position included."""
        time_ns, log_ns, columns = rows.tables(count, self._joint_count)
        columns += [np.full_like(columns[0], np.nan)] * (3 - count)
        position, velocity, acceleration = columns
        return JointTable(time_ns, position, velocity, acceleration, log_ns)

    def _actuator_table(self) -> ActuatorTable:
        quantities = actuator_states.QUANTITIES
        time_ns, _, columns = self._hydraulics.tables(len(quantities), self._joint_count)
        return ActuatorTable(time_ns, dict(zip(quantities, columns, strict=True)))

    def _all(self, topic: Topic) -> tuple[Any, ...]:
        """Return what was decoded of a topic, in the order of recording."""
        return tuple(value for _, value in sorted(self._values[topic], key=itemgetter(0)))

    def _timed(self, topic: Topic, clock: _RecordedClock) -> list[Timed]:
        """Return what was decoded of a topic with its times, in the order of recording."""
        values = sorted(self._values[topic], key=itemgetter(0))
        return [Timed(clock.ros_time(log_ns), value, log_ns) for log_ns, value in values]

    def _sentences(self) -> tuple[str, ...]:
        """Return why messages could not be read, the last ones as their number."""
        more = self._unreadable_count - len(self._unreadable)
        return (*self._unreadable, *([f"and {more} more"] if more else []))


class _RecordedClock:
    """Translates times of recording into ROS time, by the nearest joint states."""

    def __init__(self, states: _Rows) -> None:
        self._ros_ns, self._log_ns, _ = states.tables(1, len(states.numbers) // len(states.log_ns))

    def ros_time(self, log_ns: int) -> int:
        """Return the ROS time at which something was recorded [ns]."""
        ros, log = self._ros_ns, self._log_ns
        if len(log) == 1 or log_ns < log[0]:
            return int(log_ns) - int(log[0]) + int(ros[0])
        if log_ns > log[-1]:
            return int(log_ns) - int(log[-1]) + int(ros[-1])
        right = min(max(int(np.searchsorted(log, log_ns, side="right")), 1), len(log) - 1)
        part = slice(right - 1, right + 1)
        since = np.interp(
            float(log_ns - log[0]),
            (log[part] - log[0]).astype(np.float64),
            (ros[part] - ros[0]).astype(np.float64),
        )
        return int(ros[0]) + round(float(since))


def check_order(recording: Recording) -> None:
    """Raise BagError if the time of joint states or hydraulic states runs backwards."""
    for time_ns in (recording.joint_states.time_ns, recording.actuators.time_ns):
        if np.any(time_ns[1:] < time_ns[:-1]):
            raise BagError(TIME_RUNS_BACKWARDS)


def _check_numbers(value: Any) -> None:
    """Raise MessageError if a finite number in a decoded value is beyond MAX_NUMBER."""
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


def _flat(timed: Sequence[Timed]) -> tuple[Timed, ...]:
    """Return every report of messages that hold several."""
    return tuple(
        Timed(each.time_ns, report, each.recorded_ns) for each in timed for report in each.value
    )


def _unknown_plane(_: float, height: float) -> Position:
    """Of a goal in `work_plane` of an arm that slews: its verdict tells where that was."""
    return (np.nan, np.nan, height)


def _of_kind(kind: type, statuses: Sequence[Timed]) -> tuple[Timed, ...]:
    return tuple(each for each in statuses if isinstance(each.value, kind))
