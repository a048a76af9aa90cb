"""Outbox of the planner node, which publishes, plans and calls services for the goal lifecycle."""

import gc
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from std_srvs.srv import Trigger

from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.verdict import GoalVerdict, Level, Report
from mhsb_msgs_py import endpoints, mode_schedule, names, plan_status, topics, trajectory
from mhsb_planner import deadline
from mhsb_planner.online.plan_request import PlanRequest
from mhsb_planner.online.replanning import Replan, Replanner
from mhsb_planner.ros import views

Answer = tuple[PlanRequest, Replan | Exception | None]
"""A request and its answer.

The answer is a plan, the error that planning raised, or None if the arm is already at the goal."""

PUBLISHED_TOPICS = (
    topics.PLAN_STATUS,
    topics.JOINT_TRAJECTORY,
    topics.MODE_COMMANDS,
    topics.PLANNED_PATH,
    topics.PLANNED_PATH_FLAT,
    topics.MARKERS,
    topics.DIAGNOSTICS,
)
"""Topics that the planner node publishes on."""

LOG_INTERVAL = 1.0
"""Least time between lines of the log on refused or aborted goals [s]; `plan_status` has all."""


class RosOutbox:
    """Outbox that publishes messages, plans in a worker thread, and calls the arm's ~/stop.

    Attributes:
        verdict_count: Number of verdicts published so far.
    """

    def __init__(self, node: Node, machine: Machine, frame_prefix: str) -> None:
        """Create the publishers, the client of the arm's ~/stop, and an idle planning worker.

        Args:
            node: Planner node.
            machine: Machine of the node, which gives the names of joints and actuators.
            frame_prefix: Text before the names of frames.
        """
        self._node = node
        self._machine = machine
        self._prefix = frame_prefix
        self._publishers = {
            topic.name: endpoints.make_publisher(node, topic) for topic in PUBLISHED_TOPICS
        }
        self._arm_stop = node.create_client(Trigger, f"{names.SIM_NODE}/stop")
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="planning")
        self._answers: deque[Answer] = deque()
        self._replanner: Replanner | None = None
        self._shown: Command | None = None
        self.verdict_count = 0

    @property
    def exclusive_publishers(self) -> list[Publisher]:
        """Publishers on topics on which no other node should publish."""
        topics_of_one = (topics.JOINT_TRAJECTORY, topics.MODE_COMMANDS, topics.PLAN_STATUS)
        return [self._publishers[topic.name] for topic in topics_of_one]

    def start(self, replanner: Replanner, on_answers: Callable[[], None]) -> None:
        """Begin to accept plan requests.

        Args:
            replanner: Planner that makes the plans, in the worker's thread.
            on_answers: Called in the node's thread when requests have been answered. `take_answers`
                then returns the answers.
        """
        self._replanner = replanner
        self._answered = self._node.create_guard_condition(on_answers)

    def encode_example(self, example: Command, arm: Machine) -> None:
        """Encode all messages of an example plan, so that later encodings are fast.

        The first encoding loads the type support of the messages, which takes long. Nothing is
        published.

        Args:
            example: Command to encode.
            arm: Machine with the zones to draw.
        """
        self.encode_command(example)
        for message in self._make_views(example, arm):
            serialize_message(message)

    def close(self) -> None:
        """Wait for the plan that is being made, drop all other requests, and end the worker."""
        self._worker.shutdown(wait=True, cancel_futures=True)

    # --- Clocks ----------------------------------------------------------------------------------

    def steady_time(self) -> float:
        """Return the present time by the steady clock [s]."""
        return deadline.now()

    def ros_ns(self) -> int:
        """Return the present time by the ROS clock [ns]."""
        return int(self._node.get_clock().now().nanoseconds)

    # --- Planning --------------------------------------------------------------------------------

    def start_planning(self, request: PlanRequest) -> None:
        """Queue a plan request for the worker's thread.

        Args:
            request: The request. `take_answers` returns its answer later.

        Raises:
            RuntimeError: `start` has not been called yet.
        """
        if self._replanner is None:
            raise RuntimeError("nothing to plan with yet; call start() first")
        job = self._worker.submit(request.make_plan, self._replanner)
        job.add_done_callback(lambda done: self._store_answer(request, done))

    def _store_answer(self, request: PlanRequest, job: Future[Replan | None]) -> None:
        """Store the worker's answer to a request, and wake the node.

        The method runs in the worker's thread. An exception that is not an MhsbError is also logged
        with its traceback. A request that `close` has dropped gets no answer. After the node has
        been woken, Python's garbage collection is run.

        Args:
            request: The request.
            job: The finished or cancelled work.
        """
        if job.cancelled():
            return
        error = job.exception()
        if error is None:
            self._answers.append((request, job.result()))
        elif isinstance(error, Exception):
            if not isinstance(error, MhsbError):
                text = "".join(traceback.format_exception(error))
                self._node.get_logger().error(f"planning failed: {text}")
            self._answers.append((request, error))
        self._answered.trigger()
        # Errors of searches form cycles with their frames, which hold step graphs of 20 MB.
        gc.collect()

    def take_answers(self) -> Iterator[Answer]:
        """Remove answers from the queue until it is empty, and yield them.

        Yields:
            Pairs of request and answer in time order. An answer is the plan, an exception, or None
            if the arm is at the goal.
        """
        while self._answers:
            yield self._answers.popleft()

    # --- Messages --------------------------------------------------------------------------------

    def send(self, command: Command) -> None:
        """Publish both messages of a command, and store the command for `publish_views`.

        Args:
            command: Trajectory and mode schedule.
        """
        halves = (topics.JOINT_TRAJECTORY, topics.MODE_COMMANDS)
        for topic, message in zip(halves, self.encode_command(command), strict=True):
            self.publish(topic, message)
        self._shown = command

    def encode_command(self, command: Command) -> tuple[bytes, bytes]:
        """Encode a command as the bytes of its two messages.

        The bytes are written directly, because Python message objects for all points take longer.

        Args:
            command: Trajectory and mode schedule.

        Returns:
            Serialized messages of `joint_trajectory` and `mode_commands`.
        """
        return (
            trajectory.to_bytes(command.trajectory, self._machine.joint_names),
            mode_schedule.to_bytes(command.schedule, self._machine.actuator_names),
        )

    def publish_views(self, arm: Machine) -> None:
        """Publish path and markers of the last command that was sent, for viewers such as RViz.

        Nothing is published if no command was sent since the previous call.

        Args:
            arm: Machine with the zones to draw.
        """
        command, self._shown = self._shown, None
        if command is None:
            return
        shown = (topics.PLANNED_PATH, topics.PLANNED_PATH_FLAT, topics.MARKERS)
        for topic, message in zip(shown, self._make_views(command, arm), strict=True):
            self.publish(topic, message)

    def publish_markers(self, arm: Machine, command: Command | None) -> None:
        """Publish markers of all obstacles, and of a command if there is one.

        Args:
            arm: Machine with the zones to draw.
            command: Command to draw; None for obstacles alone.
        """
        markers = views.make_markers(arm, command, self._prefix, self.ros_ns())
        self.publish(topics.MARKERS, markers)

    def report(self, report: Report) -> None:
        """Publish a verdict or an execution report, count verdicts, and log refusals and aborts.

        At most one line is logged in `LOG_INTERVAL`.
        """
        self.publish(topics.PLAN_STATUS, plan_status.encode(report, self.ros_ns()))
        if isinstance(report, GoalVerdict):
            self.verdict_count += 1
            level, fate = report.code.level, f"refused with {report.code}"
        else:
            level, fate = report.outcome.level, report.outcome.value
        if level is Level.ERROR:
            self._node.get_logger().warning(
                f"goal {fate}: {report.sentence}", throttle_duration_sec=LOG_INTERVAL
            )

    def warn(self, sentence: str) -> None:
        """Write a warning to the node's log."""
        self._node.get_logger().warning(sentence)

    def stop_arm(self, on_answer: Callable[[bool, str], None]) -> bool:
        """Call the arm's own ~/stop, without waiting for the answer.

        If several arms provide this service, all of them get the call.

        Args:
            on_answer: Called in the node's thread with success and sentence of the first answer.

        Returns:
            True if the service was called, False if no arm provides it.
        """
        if not self._arm_stop.service_is_ready():
            return False

        def pass_on_answer(done: Any) -> None:
            """Call `on_answer` with success and message of the response, if there is one.

            Args:
                done: rclpy's future of the service call, which is done. The exception of a failed
                    call is raised.
            """
            response = done.result()
            if response is not None:
                on_answer(response.success, response.message)

        self._arm_stop.call_async(Trigger.Request()).add_done_callback(pass_on_answer)
        return True

    def must_call_arm_stop(self) -> bool:
        """Return whether only the arm's own ~/stop can bring the arm to rest for certain.

        Returns:
            True if the arm provides ~/stop, and the ROS graph shows another publisher of
            `joint_trajectory`. A killed publisher is still shown for `endpoints.LEASE_TIME`.
        """
        planners = self._node.count_publishers(topics.JOINT_TRAJECTORY.name)
        return planners > 1 and bool(self._arm_stop.service_is_ready())

    def is_arm_connected(self) -> bool:
        """Return whether the arm would receive both messages of a plan.

        A message is lost if its publisher is not connected to the arm's subscription yet. A killed
        arm still counts as a subscriber for a while. So each of the two topics needs at least as
        many subscribers as `reference` has publishers, and at least one.

        Returns:
            True if both topics have enough subscribers.
        """
        arms = max(1, self._node.count_publishers(topics.REFERENCE.name))
        return all(
            self._publishers[topic.name].get_subscription_count() >= arms
            for topic in (topics.JOINT_TRAJECTORY, topics.MODE_COMMANDS)
        )

    def describe_publisher_conflict(self) -> str:
        """Return a sentence that names the arms that publish `reference`, if there are several.

        `reference` is the arm's topic; the planner only subscribes to it. The sentence contains
        namespace and name of each publishing node. It asks the user to end all nodes except one.

        Returns:
            The sentence; empty if the ROS graph shows one publisher or none.
        """
        found = self._node.get_publishers_info_by_topic(topics.REFERENCE.name)
        if len(found) < 2:
            return ""
        names_of = sorted(f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in found)
        return (
            f"{topics.REFERENCE.name} comes from {len(found)} publishers whose clocks differ "
            f"({', '.join(names_of)}); end all but one"
        )

    def publish(self, topic: topics.Topic, message: Any) -> None:
        """Publish a message on one of `PUBLISHED_TOPICS`."""
        self._publishers[topic.name].publish(message)

    def _make_views(self, command: Command, arm: Machine) -> tuple[Any, ...]:
        """Make the messages by which viewers show a command.

        Args:
            command: The command.
            arm: Machine with the zones to draw.

        Returns:
            The tip's path in `base_link`, this path in `work_plane` (the arm's plane as its x-y
            plane), and markers.
        """
        return (
            *views.make_paths(self._machine, command, self._prefix),
            views.make_markers(arm, command, self._prefix, command.stamp_ns),
        )
