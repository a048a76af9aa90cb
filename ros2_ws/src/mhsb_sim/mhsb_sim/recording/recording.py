"""What has been heard of the suite: one table for each stream, domain objects for the rest.

Streams carry their own stamps in ROS time. What has no stamp (`modes`, `plan_in_force`, goals as
they were sent) is placed by its time of recording, which is translated into ROS time by way of
the joint states: each of those has both times.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

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
from mhsb_sim.recording.bag_format import BagError

RawMessages = Callable[[Topic], Iterable[tuple[int, bytes]]]
"""Serialized messages of a topic, in order, each with the system time of its recording [ns]."""


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
    unreadable         one sentence for each message that breaks its contract
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
    estimates: tuple[Timed, ...] = field(default=())


def decoded(
    raw: RawMessages, what: str, namespace: str = "", slews: bool = False
) -> Recording:
    """The recording that consists of these messages; `what` it is called in errors.

    namespace  below which the topics were, such as `/left`
    slews      whether the arm does, so that goals have a y

    Raises BagError where it has no joint states.
    """
    topic = f"{namespace}/{topics.JOINT_STATES.name}"
    nothing = f"{what} has no messages on {topic}; was the simulator running?"
    return _Messages(raw, nothing).recording(slews)


class _Messages:
    """The decoded messages of a recording, by topic."""

    def __init__(self, raw: RawMessages, nothing: str) -> None:
        self._serialized = raw
        self._unreadable: list[str] = []
        states = self._raw(topics.JOINT_STATES)
        if not states:
            raise BagError(nothing)
        self._joint_count = len(states[0][1].name)
        self._joints = names.joint_names(self._joint_count)
        self._actuators = names.actuator_names(self._joint_count)
        self._log_ns = np.array([log for log, _ in states], dtype=np.int64)
        self._ros_ns = np.array(
            [stamps.from_time(message.header.stamp) for _, message in states], dtype=np.int64
        )

    def recording(self, slews: bool) -> Recording:
        """Everything, decoded."""
        to_base = _unknown_plane if slews else None
        modes = self._decoded(
            topics.MODES, lambda message: modes_in_force.decode(message, self._joint_count)
        )
        diagnostics = self._statuses(topics.DIAGNOSTICS, sim_status.decode)
        return Recording(
            joint_count=self._joint_count,
            joint_states=self._joint_states(),
            references=self._references(),
            actuators=self._actuator_states(),
            mode_time_ns=np.array([each.time_ns for each in modes], dtype=np.int64),
            modes=np.array([each.value for each in modes], dtype=np.uint8).reshape(
                len(modes), self._joint_count
            ),
            plans_in_force=tuple(self._decoded(topics.PLAN_IN_FORCE, stamps.from_time)),
            trajectories=self._values(
                topics.JOINT_TRAJECTORY, lambda message: trajectory.decode(message, self._joints)
            ),
            schedules=self._values(
                topics.MODE_COMMANDS,
                lambda message: mode_schedule.decode(message, self._actuators),
            ),
            goals_sent=len(self._raw(topics.GOAL_POSE)),
            goals=tuple(
                self._decoded(
                    topics.GOAL_POSE, lambda message: goal_pose.decode(message, "", to_base)
                )
            ),
            reports=self._statuses(topics.PLAN_STATUS, plan_status.decode),
            hand_overs=_of_kind(HandOverReport, diagnostics),
            simulator_reports=_of_kind(SimulatorReport, diagnostics),
            estimates=tuple(self._decoded(topics.ESTIMATES, estimates.decode)),
            unreadable=tuple(self._unreadable),
        )

    def _joint_states(self) -> JointTable:
        heard = self._decoded(
            topics.JOINT_STATES, lambda message: joint_state.decode(message, self._joints)
        )
        samples = [each.value for each in heard]
        velocity = self._table([each.velocity for each in samples])
        return JointTable(
            np.array([each.stamp_ns for each in samples], dtype=np.int64),
            self._table([each.position for each in samples]),
            velocity,
            np.full_like(velocity, np.nan),
            _recorded_ns(heard),
        )

    def _references(self) -> JointTable:
        heard = self._decoded(
            topics.REFERENCE, lambda message: reference.decode(message, self._joints)
        )
        samples = [each.value for each in heard]
        return JointTable(
            np.array([each.stamp_ns for each in samples], dtype=np.int64),
            self._table([each.state.position for each in samples]),
            self._table([each.state.velocity for each in samples]),
            self._table([each.state.acceleration for each in samples]),
            _recorded_ns(heard),
        )

    def _actuator_states(self) -> ActuatorTable:
        samples = self._values(
            topics.ACTUATOR_STATES,
            lambda message: actuator_states.decode(message, self._actuators),
        )
        return ActuatorTable(
            np.array([each.stamp_ns for each in samples], dtype=np.int64),
            {
                quantity: self._table([getattr(each, quantity) for each in samples])
                for quantity in actuator_states.QUANTITIES
            },
        )

    def _table(self, rows: Sequence[FloatArray]) -> FloatArray:
        return np.array(rows, dtype=np.float64).reshape(len(rows), self._joint_count)

    def _statuses(self, topic: Topic, decode: Callable[[Any], list[Any]]) -> tuple[Timed, ...]:
        """Every report of messages that hold several."""
        return tuple(
            Timed(each.time_ns, report, each.recorded_ns)
            for each in self._decoded(topic, decode)
            for report in each.value
        )

    def _values(self, topic: Topic, decode: Callable[[Any], Any]) -> tuple[Any, ...]:
        return tuple(each.value for each in self._decoded(topic, decode))

    def _decoded(self, topic: Topic, decode: Callable[[Any], Any]) -> list[Timed]:
        """Messages that keep their contract; the others go to the list of unreadable ones."""
        decoded = []
        for log_ns, message in self._raw(topic):
            try:
                decoded.append(Timed(self._ros_time(log_ns), decode(message), log_ns))
            except MessageError as error:
                self._unreadable.append(f"{topic.name}: {error}")
        return decoded

    def _ros_time(self, log_ns: int) -> int:
        """ROS time [ns] at which something was recorded, by the nearest joint states."""
        if len(self._log_ns) == 1 or log_ns < self._log_ns[0]:
            return int(log_ns - self._log_ns[0] + self._ros_ns[0])
        if log_ns > self._log_ns[-1]:
            return int(log_ns - self._log_ns[-1] + self._ros_ns[-1])
        since = np.interp(
            float(log_ns - self._log_ns[0]),
            (self._log_ns - self._log_ns[0]).astype(np.float64),
            (self._ros_ns - self._ros_ns[0]).astype(np.float64),
        )
        return int(self._ros_ns[0]) + round(float(since))

    def _raw(self, topic: Topic) -> list[tuple[int, Any]]:
        """Messages of a topic with their times of recording [ns]."""
        return [
            (log_ns, deserialize_message(data, topic.message))
            for log_ns, data in self._serialized(topic)
        ]


def _unknown_plane(_: float, height: float) -> Position:
    """Of a goal in `work_plane` of an arm that slews: its verdict tells where that was."""
    return (np.nan, np.nan, height)


def _recorded_ns(heard: Sequence[Timed]) -> IntArray:
    return np.array([each.recorded_ns for each in heard], dtype=np.int64)


def _of_kind(kind: type, statuses: Sequence[Timed]) -> tuple[Timed, ...]:
    return tuple(each for each in statuses if isinstance(each.value, kind))
