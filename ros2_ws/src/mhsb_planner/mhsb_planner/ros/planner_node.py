"""Planner node, which receives goals and publishes joint trajectories, mode commands and verdicts.

Messages are decoded here and passed to the `GoalLifecycle`, which makes all decisions. The
`RosOutbox` plans, publishes and calls services for the lifecycle. Planning runs in one worker
thread, everything else in the executor's thread.
"""

import gc
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import UInt8MultiArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from mhsb_model import command_line
from mhsb_model.arm_reports import HandOverReport
from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import Position
from mhsb_model.verdict import GoalVerdict, Verdict
from mhsb_msgs_py import (
    estimates,
    goal_pose,
    joint_state,
    modes_in_force,
    names,
    parameters,
    qos,
    reference,
    sim_status,
    stamps,
    topics,
)
from mhsb_msgs_py.errors import GoalError, MessageError
from mhsb_msgs_py.faults import Faults
from mhsb_msgs_py.matching import MatchingSubscriptions
from mhsb_msgs_py.node_process import spin_node
from mhsb_planner import deadline
from mhsb_planner.kernel_parts import compile_planner
from mhsb_planner.online.goal_lifecycle import GoalLifecycle
from mhsb_planner.online.plan_request import PlanRequest
from mhsb_planner.online.progress import compute_energy_between
from mhsb_planner.online.replanning import Replan, Replanner
from mhsb_planner.online.settings import Settings, choose_payload
from mhsb_planner.online.start_state import NoStateError
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.ros import planner_diagnostics, planner_parameters
from mhsb_planner.ros.message_times import find_message_times
from mhsb_planner.ros.move_tip_server import MoveTipServer
from mhsb_planner.ros.outbox import RosOutbox
from mhsb_planner.ros.zone_parameters import ZONE_PARAMETERS, replace_deletions

TIMER_PERIOD = 0.02
"""Time between two calls of `GoalLifecycle.tick` [s]."""

DIAGNOSTICS_PERIOD = 1.0
"""Time between two statuses on /diagnostics [s]."""

EXECUTION_TOPICS = (topics.JOINT_STATES, topics.REFERENCE, topics.PLAN_IN_FORCE)
"""Topics by which the execution of a plan is monitored.

The arm is stopped if the callback of one of these topics fails repeatedly.
"""


class PlannerNode(Node):
    """Node that plans the arm's motion to goal poses, from rest and while the arm moves.

    Attributes:
        faults: Record of exceptions in the node's callbacks.
    """

    deletable_parameters = frozenset(ZONE_PARAMETERS)
    """Parameters that may be deleted: a deleted zone parameter means no zones."""

    def __init__(self) -> None:
        """Declare parameters, compile the planner, load the posture table, and open all interfaces.

        If there is no table, it is built, which takes long. The subscription to goals is created
        last, so that its presence shows that the planner is ready.
        """
        super().__init__(names.PLANNER_NODE)
        self.faults = Faults(self, stop=self._stop_unmonitored_arm)
        self._take_answer = self.faults.wrap("an answer of planning", self._on_answer)
        self._publish_guarded = self.faults.wrap("the feedback", self._publish_feedback_and_views)
        self._machine = parameters.declare_machine(self)
        table_path = planner_parameters.declare_table_path(self)
        self._frame_prefix = planner_parameters.declare_frame_prefix(self)
        planner_parameters.declare_changeable(self, self._machine)
        self.add_pre_set_parameters_callback(replace_deletions)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)
        self._lost_pumps: tuple[int, ...] = ()
        self._estimated_payload: float | None = None
        self._settings = self._make_settings()

        self._outbox = RosOutbox(self, self._machine, self._frame_prefix)
        self._matching_subscriptions = MatchingSubscriptions(self)
        compile_planner(self.get_logger().info)
        table = load_or_build_table(self._machine, table_path)
        replanner = Replanner(self._machine, table)
        replanner.change_machine(self._settings.machine)
        example = replanner.warm_up()
        self._outbox.encode_example(example, self._settings.machine)
        compute_energy_between(self._machine, example, example.stamp_ns, example.trajectory.end_ns)
        self._outbox.start(replanner, self._on_answers)
        self._lifecycle = GoalLifecycle(
            self._settings, replanner.make_braking_command, self._outbox
        )
        self._make_interfaces()
        self._move_tip = self._serve_action()
        self._show_markers()
        gc.collect()
        gc.freeze()  # later collections need not look at what has been loaded
        self.get_logger().info(
            f"ready: {self._machine.name}, posture table with {len(table.nodes)} nodes"
        )

    def _make_interfaces(self) -> None:
        """Create the service, the timers, the handler of clock jumps, and the subscriptions.

        The arm is stopped if the callback of the first timer or of one of `EXECUTION_TOPICS` fails
        repeatedly. The subscription to goals is created last, so that its presence shows that the
        planner is ready.
        """
        self.create_service(
            Trigger,
            names.STOP_SERVICE,
            self._on_stop,
            qos_profile=qos.SERVICE,
            callback_group=ReentrantCallbackGroup(),
        )
        steady = rclpy.clock.Clock(clock_type=rclpy.clock.ClockType.STEADY_TIME)
        self.faults.watch(self.create_timer(TIMER_PERIOD, self._on_timer, clock=steady))
        self.create_timer(DIAGNOSTICS_PERIOD, self._publish_diagnostics, clock=steady)
        self._jump_handler = self.get_clock().create_jump_callback(
            JumpThreshold(
                min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True
            ),
            post_callback=self.faults.wrap("the clock's jump", self._on_clock_jump),
        )
        for topic, callback in (
            (topics.JOINT_STATES, _drop_info(self._on_joint_states)),
            (topics.REFERENCE, _drop_info(self._on_reference)),
            (topics.PLAN_IN_FORCE, _drop_info(self._on_plan_in_force)),
            (topics.MODES, _drop_info(self._on_modes)),
            (topics.DIAGNOSTICS, self._on_diagnostics),
            (topics.ESTIMATES, _drop_info(self._on_estimates)),
        ):
            heard = self._matching_subscriptions.add(topic, callback)
            if topic in EXECUTION_TOPICS:
                self.faults.watch(heard)
        self._matching_subscriptions.add(topics.GOAL_POSE, self._on_goal, at_once=True)

    def _serve_action(self) -> MoveTipServer | None:
        """Start the server of the action ~/move_tip if its interface was built.

        Returns:
            The server; None if the interface is missing or does not fit, which is logged. Goals can
            then only come by the topic.
        """
        try:
            from mhsb_interfaces.action import MoveTip
        except ImportError:
            self.get_logger().info(
                "the action move_tip is not served: mhsb_interfaces was not built; goals come by "
                f"{topics.GOAL_POSE.name}"
            )
            return None
        try:
            return MoveTipServer(
                MoveTip,
                self,
                self._machine,
                self._decode_goal,
                self._lifecycle,
                self._outbox,
                self._make_settings,
            )
        except Exception as error:
            self.get_logger().warning(
                "the action move_tip cannot be served; build mhsb_interfaces anew (scripts/setup). "
                f"Goals come by {topics.GOAL_POSE.name} all the same. ROS says: {error}"
            )
            return None

    # --- Parameters ------------------------------------------------------------------------------

    def _check_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Check a set of parameter changes; either all or none of them are accepted.

        Args:
            changes: Parameters with their new values.

        Returns:
            Success, or the reason of the refusal.
        """
        reason = planner_parameters.find_refusal(self, self._machine, changes)
        return SetParametersResult(successful=reason is None, reason=reason or "")

    def _take_parameters(self, changes: list[Parameter]) -> None:
        """Apply changed parameters, and publish new markers if zones have changed.

        Args:
            changes: The changed parameters, which the node has stored already.
        """
        self._take_settings()
        if any(change.name in ZONE_PARAMETERS for change in changes):
            self._show_markers()

    def _take_settings(self) -> None:
        """Make new settings of plans from all parameters, and apply them from now on.

        A plan that is being made is started again. Plans are made without failed servo pumps. The
        estimated payload is used if the parameter `payload_from` is `estimate`.
        """
        self._settings = self._make_settings()
        self._lifecycle.change_settings(self._settings)

    def _make_settings(self, own: Sequence[Parameter] = ()) -> Settings:
        """Make the settings of plans from the present parameters.

        Args:
            own: Parameters of one goal, which replace the node's parameters.

        Returns:
            Settings for the machine without its failed servo pumps. The estimated payload is used
            if `payload_from` is `estimate` and there is an estimate.
        """
        return planner_parameters.read_parameters(self, self._machine, own).make_settings(
            self._machine, self._lost_pumps, self._estimated_payload
        )

    # --- Messages received -----------------------------------------------------------------------

    def _on_goal(self, message: PoseStamped, info: dict[str, int]) -> None:
        """Decode a goal and pass it to the goal lifecycle (state machine of goals).

        If the message cannot be used, a verdict on it is published. An unexpected exception in
        decoding is recorded as a fault and gives the verdict `INTERNAL`.

        Args:
            message: Message of `goal_pose`.
            info: rclpy's information on the message, which gives its time of receipt.
        """
        try:
            goal = self._decode_goal(message)
        except GoalError as error:
            self._outbox.report(GoalVerdict(error.code, str(error), error.goal))
        except MessageError as error:
            self._outbox.report(GoalVerdict(Verdict.INTERNAL, str(error), Goal(0, 0.0, 0.0)))
        except Exception as error:
            sentence = self.faults.record_fault(f"the topic {topics.GOAL_POSE.name}", error)
            self._outbox.report(GoalVerdict(Verdict.INTERNAL, sentence, Goal(0, 0.0, 0.0)))
        else:
            sent_at, received_at = self._find_message_times(info)
            self._lifecycle.add_goal(goal, received_at, sent_at)

    def _decode_goal(self, message: PoseStamped) -> Goal:
        """Decode the goal of a message.

        For an arm that slews, a goal in the frame `work_plane` is converted to `base_link` at the
        present slew angle.

        Args:
            message: Message of `goal_pose`, or pose of an action goal.

        Returns:
            The goal in `base_link`.

        Raises:
            GoalError: The goal cannot be used. The error contains goal and verdict code.
            MessageError: The message cannot be read.
        """
        turned = self._convert_to_base if self._machine.slews else None
        return goal_pose.decode(message, self._frame_prefix, turned)

    def _convert_to_base(self, x: float, z: float) -> Position:
        """Convert a point in the plane of a slewing arm to `base_link`.

        The plane is vertical and turns with the slew. The present slew angle of the arm is used.

        Args:
            x: Coordinate forward in the plane [m].
            z: Coordinate upward in the plane [m].

        Returns:
            Point (x, y, z) in `base_link` [m].

        Raises:
            GoalError: No state of the arm was received in the last `OLDEST_STATE`.
        """
        state = self._lifecycle.arm_state.get_fresh_state(deadline.now())
        if state is None:
            raise GoalError(Verdict.NO_STATE, str(NoStateError()))
        tip = self._machine.convert_to_base(np.array([x, z]), float(state.position[0]))
        return tuple(tip.tolist())

    def _on_clock_jump(self, jump: TimeJump) -> None:
        """Report to the goal lifecycle that the ROS clock went back or was changed."""
        self._lifecycle.handle_clock_jump("the clock went back or changed")

    def _on_joint_states(self, message: JointState) -> None:
        """Decode a measured joint state and store it in the arm state.

        Args:
            message: Message of `joint_states`. If it cannot be used, it is logged and dropped.
        """
        try:
            sample = joint_state.decode(message, self._machine.joint_names)
        except MessageError as error:
            self._warn(f"joint_states are not used: {error}")
            return
        state = MotionState(sample.position, sample.velocity, 0 * sample.velocity)
        self._lifecycle.arm_state.add_measurement(state, deadline.now())

    def _on_reference(self, message: JointTrajectory) -> None:
        """Decode the reference, the state that the servo follows, and pass it to the lifecycle.

        Args:
            message: Message of `reference`. If it cannot be used, it is logged and dropped.
        """
        try:
            heard = reference.decode(message, self._machine.joint_names)
        except MessageError as error:
            self._warn(f"reference is not used: {error}")
            return
        self._lifecycle.handle_reference(heard.state, heard.stamp_ns)

    def _on_modes(self, message: UInt8MultiArray) -> None:
        """Decode the modes in force and store them in the arm state.

        Args:
            message: Message of `modes`. If it cannot be used, it is logged and dropped.
        """
        try:
            self._lifecycle.arm_state.modes = modes_in_force.decode(
                message, self._machine.joint_count
            )
        except MessageError as error:
            self._warn(f"modes are not used: {error}")

    def _on_plan_in_force(self, message: Time) -> None:
        """Decode the stamp of the plan in force and pass it to the goal lifecycle.

        Args:
            message: Message of `plan_in_force`. If it cannot be used, it is logged and dropped.
        """
        try:
            stamp_ns = stamps.from_time(message)
        except MessageError as error:
            self._warn(f"plan_in_force is not used: {error}")
            return
        self._lifecycle.handle_plan_in_force(stamp_ns)

    def _on_diagnostics(self, message: DiagnosticArray, info: dict[str, int]) -> None:
        """Decode the arm's reports on /diagnostics and pass them to the goal lifecycle.

        A report on the arm itself contains fault, last stop, machine, plan delay and failed servo
        pumps. From then on, plans are made without the failed pumps. A report that the arm has
        refused a plan contains the plan's stamp and the reason. Other statuses are ignored.

        Args:
            message: Message of `/diagnostics`. If a report in it cannot be read, the message is
                logged and dropped.
            info: rclpy's information on the message, which gives its time of receipt.
        """
        try:
            reports = sim_status.decode(message, self.get_namespace())
        except MessageError as error:
            self._warn(f"a report of the arm is not used: {error}")
            return
        for report in reports:
            if not isinstance(report, HandOverReport):
                self._lifecycle.handle_arm_fault(report.sentence if report.faulty else "")
                self._lifecycle.handle_arm_stop(
                    report.last_stop_ns,
                    (report.sim_time_ns - report.last_stop_ns) / SECOND_NS,
                    self._find_message_times(info)[1],
                )
                self._lifecycle.state.store_arm_machine(
                    self._machine.describe_difference(report.machine, report.machine_hash)
                    if report.machine_hash
                    else None
                )
                self._lifecycle.arm_state.plan_delay_ns = round(report.plan_delay * SECOND_NS)
                if report.lost_servo_pumps != self._lost_pumps:
                    self._lost_pumps = report.lost_servo_pumps
                    self._take_settings()
            elif report.reason:
                self._lifecycle.handle_plan_refusal(
                    report.plan_stamp_ns, report.reason, report.sentence
                )

    def _on_estimates(self, message: JointState) -> None:
        """Store the payload that the arm has estimated, and use it if `payload_from` is `estimate`.

        An accurate estimate replaces the previous estimate if the two differ enough
        (`choose_payload`). If the parameter `payload_from` is `estimate`, plans use the new payload
        from now on, which is logged. If planning refuses this payload, the previous payload is
        kept.

        Args:
            message: Message of `estimates`. If it cannot be used, it is logged and dropped.
        """
        try:
            heard = estimates.decode(message)
        except MessageError as error:
            self._warn(f"estimates are not used: {error}")
            return
        payload = choose_payload(heard, self._estimated_payload)
        if payload == self._estimated_payload:
            return
        before, self._estimated_payload = self._estimated_payload, payload
        if planner_parameters.read_parameters(self, self._machine).payload_from != "estimate":
            return
        try:
            self._take_settings()
        except MhsbError as error:
            self._estimated_payload = before
            self._warn(f"the payload of {payload:.2f} kg that the arm has learnt: {error}")
        else:
            self.get_logger().info(f"plans are made for {payload:.2f} kg, as the arm has learnt")

    def _find_message_times(self, info: dict[str, int]) -> tuple[float, float]:
        """Find the times at which a message was sent and received, by the steady clock [s].

        Args:
            info: rclpy's information on the message, which gives both times by the system clocks.
        """
        return find_message_times(info, deadline.now(), time.time_ns())

    # --- Actions and outputs ---------------------------------------------------------------------

    def _stop_unmonitored_arm(self) -> None:
        """Call the arm's own ~/stop, because a callback that monitors the plan fails repeatedly.

        An error is logged if the service is not available or does not succeed.
        """

        def log_failed_stop(success: bool, sentence: str) -> None:
            """Log an error if the arm's ~/stop did not succeed.

            Args:
                success: True if the arm has stopped.
                sentence: The arm's answer in words.
            """
            if not success:
                self.get_logger().error(f"the arm may still move: {sentence}")

        if not self._outbox.stop_arm(log_failed_stop):
            log_failed_stop(
                False, f"nobody serves {names.SIM_NODE}/stop; stop the arm by other means"
            )

    def _on_answers(self) -> None:
        """Handle all answers of the planning worker."""
        for request, answer in self._outbox.take_answers():
            self._take_answer(request, answer)

    def _on_answer(self, request: PlanRequest, answer: Replan | Exception | None) -> None:
        """Pass an answer of the planning worker to the object that requested the plan.

        The action server requests plans that will not be executed. The goal lifecycle (state
        machine of goals) requests all other plans.

        Args:
            request: Request that was answered.
            answer: The plan, the error that planning raised, or None if the arm is at the goal
                already.
        """
        if self._move_tip is None or not self._move_tip.handle_plan_answer(request, answer):
            self._lifecycle.handle_plan_answer(request, answer)

    def _on_timer(self) -> None:
        """Do the periodic work of the node.

        Answers of the planning worker are handled, the goal lifecycle gets its periodic call, and
        feedback, path and markers are published.
        """
        self._on_answers()  # the executor may lose a guard condition
        self._lifecycle.tick()
        self._publish_guarded()

    def _publish_feedback_and_views(self) -> None:
        """Publish feedback for action clients, and path and markers for viewers.

        The caller catches exceptions of this method, so that they do not affect the motion.
        """
        if self._move_tip is not None:
            self._move_tip.tick()
        self._outbox.publish_views(self._settings.machine)

    async def _on_stop(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Serve ~/stop: bring the arm to rest and end all goals.

        An arm that follows a plan of this planner brakes along the plan's path. If the arm does not
        follow such a plan, or does not confirm braking commands, the service ~/stop of the arm's
        own node is called. The response is sent when the arm rests, when it has confirmed a braking
        command, or when it cannot be stopped.

        Args:
            request: Empty request.
            response: Response to fill.

        Returns:
            The response with success and a sentence.
        """
        stopped: Future = Future()
        self._lifecycle.stop(lambda success, sentence: stopped.set_result((success, sentence)))
        response.success, response.message = await stopped
        return response

    def _publish_diagnostics(self) -> None:
        """Adapt subscriptions to publishers' quality of service, and publish the node's status.

        A sentence on publishers whose quality of service does not match is stored in the arm state.
        """
        self._matching_subscriptions.update()
        self._lifecycle.arm_state.qos_mismatch = self._matching_subscriptions.problem
        message = planner_diagnostics.compose_diagnostics(
            self,
            deadline.now(),
            self._lifecycle,
            self._outbox,
            self._settings.machine.arrays.payload,
            self._machine,
            self.faults,
        )
        self._outbox.publish(topics.DIAGNOSTICS, message)

    def _show_markers(self) -> None:
        """Publish markers of all obstacles and of this planner's confirmed command."""
        self._outbox.publish_markers(self._settings.machine, self._lifecycle.arm_state.own_command)

    def _warn(self, sentence: str) -> None:
        """Log a warning, at most once a second."""
        self.get_logger().warning(sentence, throttle_duration_sec=1.0)

    def destroy_node(self) -> None:
        """End the planning worker and the action server, then destroy the node.

        The method waits for the plan that is being made.
        """
        self._outbox.close()
        if self._move_tip is not None:
            self._move_tip.close()
        super().destroy_node()


def _drop_info(callback: Callable[[Any], None]) -> Callable[[Any, dict[str, int]], None]:
    """Return a subscription callback that passes on the message alone, without rclpy's information.

    Args:
        callback: Function of the message alone.

    Returns:
        Function of the message and rclpy's information on it.
    """
    return lambda message, info: callback(message)


def planner_node() -> int:
    """Plan an arm's motion to goal poses, over ROS 2.

    Settings are ROS parameters: `--ros-args -p NAME:=VALUE`; `ros2 param describe mhsb_planner
    NAME` gives meaning and unit of each.
    """
    return spin_node(PlannerNode)


def main() -> int:
    """Run the executable `ros2 run mhsb_planner planner_node`."""
    return command_line.run(planner_node, name="planner_node", node=True)


if __name__ == "__main__":
    sys.exit(main())
