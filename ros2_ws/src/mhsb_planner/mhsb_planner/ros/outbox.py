"""What the planner node says and does for the lifecycle of its goals."""

from __future__ import annotations

import traceback
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from std_srvs.srv import Trigger

from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.verdict import GoalVerdict, Report
from mhsb_msgs_py import endpoints, mode_schedule, names, plan_status, topics, trajectory
from mhsb_planner.online.plan_request import PlanRequest
from mhsb_planner.online.replanning import Replan, Replanner
from mhsb_planner.ros import views

Answer = tuple[PlanRequest, Replan | Exception | None]

PUBLISHED = (
    topics.PLAN_STATUS,
    topics.JOINT_TRAJECTORY,
    topics.MODE_COMMANDS,
    topics.PLANNED_PATH,
    topics.PLANNED_PATH_FLAT,
    topics.MARKERS,
    topics.DIAGNOSTICS,
)


class RosOutbox:
    """Publishes, plans in a worker thread, and asks the arm to stop.

    `on_answers` is called in the node's thread when plans have been made; `answers` gives them.
    verdicts counts those that were given.
    """

    def __init__(self, node: Node, machine: Machine, frame_prefix: str) -> None:
        self._node = node
        self._machine = machine
        self._prefix = frame_prefix
        self._publishers = {
            topic.name: endpoints.publisher(node, topic)
            for topic in PUBLISHED
        }
        self._arm_stop = node.create_client(Trigger, f"{names.SIM_NODE}/stop")
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="planning")
        self._answers: deque[Answer] = deque()
        self._replanner: Replanner | None = None
        self._shown: Command | None = None
        self.verdicts = 0

    @property
    def own(self) -> list[Publisher]:
        """Publishers on topics where nobody else should publish."""
        topics_of_one = (topics.JOINT_TRAJECTORY, topics.MODE_COMMANDS, topics.PLAN_STATUS)
        return [self._publishers[topic.name] for topic in topics_of_one]

    def serve(self, replanner: Replanner, on_answers: Callable[[], None]) -> None:
        """Plan with a replanner from now on."""
        self._replanner = replanner
        self._answered = self._node.create_guard_condition(on_answers)

    def rehearse(self, example: Command, arm: Machine) -> None:
        """Encode what a plan sends, before anybody waits for it; loads the types' support."""
        self.halves(example)
        for message in self._views(example, arm):
            serialize_message(message)

    def close(self) -> None:
        """End the worker."""
        self._worker.shutdown(wait=True, cancel_futures=True)

    # --- Planning --------------------------------------------------------------------------------

    def plan(self, request: PlanRequest) -> None:
        """Make a plan in the worker's thread."""
        if self._replanner is None:
            raise RuntimeError("nothing to plan with yet; call serve() first")
        job = self._worker.submit(request.answered_by, self._replanner)
        job.add_done_callback(lambda done: self._keep(request, done))

    def _keep(self, request: PlanRequest, job: Future[Replan | None]) -> None:
        """In the worker's thread: hand the answer over to the node's."""
        error = job.exception()
        if error is None:
            self._answers.append((request, job.result()))
        elif isinstance(error, Exception):
            if not isinstance(error, MhsbError):
                told = "".join(traceback.format_exception(error))
                self._node.get_logger().error(f"planning failed: {told}")
            self._answers.append((request, error))
        self._answered.trigger()

    def answers(self) -> list[Answer]:
        """What planning has given since the last call."""
        made = []
        while self._answers:
            made.append(self._answers.popleft())
        return made

    # --- Talking ---------------------------------------------------------------------------------

    def send(self, command: Command) -> None:
        """Publish both halves of a plan; viewers are shown it by `show`."""
        halves = (topics.JOINT_TRAJECTORY, topics.MODE_COMMANDS)
        for topic, message in zip(halves, self.halves(command), strict=True):
            self.publish(topic, message)
        self._shown = command

    def halves(self, command: Command) -> tuple[bytes, bytes]:
        """Both messages as they go over the wire: an object for every point would take long."""
        return (
            trajectory.to_bytes(command.trajectory, self._machine.joint_names),
            mode_schedule.to_bytes(command.schedule, self._machine.actuator_names),
        )

    def show(self, arm: Machine) -> None:
        """Publish what viewers are shown of the last command that was sent, once."""
        command, self._shown = self._shown, None
        if command is None:
            return
        shown = (topics.PLANNED_PATH, topics.PLANNED_PATH_FLAT, topics.MARKERS)
        for topic, message in zip(shown, self._views(command, arm), strict=True):
            self.publish(topic, message)

    def show_markers(self, arm: Machine, command: Command | None) -> None:
        """Publish obstacles, and the plan in force if there is one."""
        markers = views.markers(arm, command, self._prefix, self._now_ns())
        self.publish(topics.MARKERS, markers)

    def report(self, report: Report) -> None:
        """Publish a verdict or the end of an execution."""
        self.publish(topics.PLAN_STATUS, plan_status.encode(report, self._now_ns()))
        self.verdicts += isinstance(report, GoalVerdict)

    def warn(self, sentence: str) -> None:
        """Write to the log."""
        self._node.get_logger().warning(sentence)

    def stop_arm(self) -> None:
        """Call the arm's own ~/stop."""
        if self._arm_stop.service_is_ready():
            self._arm_stop.call_async(Trigger.Request())

    def connected(self) -> bool:
        """Whether the arm receives both halves of a plan.

        What is sent before the match is lost. An arm that was killed still counts for a while, so
        there must be as many receivers as there are sources of a reference.
        """
        arms = max(1, self._node.count_publishers(topics.REFERENCE.name))
        return all(
            self._publishers[topic.name].get_subscription_count() >= arms
            for topic in (topics.JOINT_TRAJECTORY, topics.MODE_COMMANDS)
        )

    def publish(self, topic: topics.Topic, message: Any) -> None:
        """Publish a message on a topic."""
        self._publishers[topic.name].publish(message)

    def _views(self, command: Command, arm: Machine) -> tuple[Any, ...]:
        return (
            *views.paths(self._machine, command, self._prefix),
            views.markers(arm, command, self._prefix, command.stamp_ns),
        )

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)
