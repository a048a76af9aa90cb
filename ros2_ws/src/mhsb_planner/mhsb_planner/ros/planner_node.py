"""Planner node, which receives goals and publishes joint trajectories, mode commands and verdicts.

Messages are decoded here and passed to the `GoalLifecycle`, which makes all decisions. The
`RosOutbox` plans, publishes and calls services for the lifecycle. Planning runs in one worker
thread, everything else in the executor's thread.
"""

import gc
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from mhsb_model import command_line
from mhsb_model.arm_reports import Estimate, HandOverReport, SimulatorReport
from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import ModeArray, Position
from mhsb_model.verdict import GoalVerdict, Level, Verdict
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
from mhsb_msgs_py.endpoints import describe_duplicates
from mhsb_msgs_py.errors import GoalError, MessageError
from mhsb_msgs_py.faults import Faults
from mhsb_msgs_py.joint_state import JointSample
from mhsb_msgs_py.matching import MatchingSubscriptions
from mhsb_msgs_py.node_process import spin_node
from mhsb_msgs_py.reference import Reference
from mhsb_msgs_py.status_values import make_status
from mhsb_planner import deadline
from mhsb_planner.kernel_parts import compile_planner
from mhsb_planner.online.arm_state import NO_PLAN, ArmState
from mhsb_planner.online.goal_lifecycle import GoalLifecycle
from mhsb_planner.online.plan_request import PlanRequest
from mhsb_planner.online.progress import compute_energy_between
from mhsb_planner.online.replanning import Replan, Replanner
from mhsb_planner.online.settings import Settings, choose_payload
from mhsb_planner.online.start_state import NoStateError
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.ros import planner_parameters
from mhsb_planner.ros.message_times import find_message_times
from mhsb_planner.ros.move_tip_server import MoveTipServer
from mhsb_planner.ros.outbox import RosOutbox
from mhsb_planner.ros.zone_parameters import ZONE_PARAMETERS, replace_deletions

TIMER_PERIOD = 0.02
"""Time between two calls of `GoalLifecycle.tick` [s]."""

DIAGNOSTICS_PERIOD = 1.0
"""Time between two statuses on /diagnostics [s]."""

PLANNER_STATUS = f"{names.PLANNER_NODE}: planner"
"""Name of the planner node's status on /diagnostics."""

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
        life, joints, space = self._lifecycle, self._machine.joint_names, self.get_namespace()
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
            post_callback=self.faults.wrap(
                "the clock's jump",
                lambda jump: life.handle_clock_jump("the clock went back or changed"),
            ),
        )
        for heard in (
            (
                topics.JOINT_STATES,
                "joint_states are",
                lambda message: joint_state.decode(message, joints),
                self._on_joint_states,
            ),
            (
                topics.REFERENCE,
                "reference is",
                lambda message: reference.decode(message, joints),
                self._on_reference,
            ),
            (
                topics.PLAN_IN_FORCE,
                "plan_in_force is",
                stamps.from_time,
                lambda stamp_ns, info: life.handle_plan_in_force(stamp_ns),
            ),
            (
                topics.MODES,
                "modes are",
                lambda message: modes_in_force.decode(message, len(joints)),
                self._on_modes,
            ),
            (
                topics.DIAGNOSTICS,
                "a report of the arm is",
                lambda message: sim_status.decode(message, space),
                self._on_reports,
            ),
            (topics.ESTIMATES, "estimates are", estimates.decode, self._on_estimates),
        ):
            self._listen(*heard)
        self._matching_subscriptions.add(topics.GOAL_POSE, self._on_goal, at_once=True)

    def _listen(
        self,
        topic: topics.Topic,
        words: str,
        decode: Callable[[Any], Any],
        use: Callable[[Any, dict[str, int]], None],
    ) -> None:
        """Subscribe to a topic of the arm.

        Args:
            topic: The topic.
            words: Subject and verb of the warning about a message that cannot be used, such as
                "modes are". The message is dropped.
            decode: Function that decodes a message, or raises `MessageError`.
            use: Function of the decoded message, and of rclpy's information on the message.
        """

        def take(message: Any, info: dict[str, int]) -> None:
            """Decode a message and use it."""
            try:
                decoded = decode(message)
            except MessageError as error:
                self._warn(f"{words} not used: {error}")
            else:
                use(decoded, info)

        subscription = self._matching_subscriptions.add(topic, take)
        if topic in EXECUTION_TOPICS:
            self.faults.watch(subscription)

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
        return planner_parameters.read_settings(
            self, self._machine, own, self._lost_pumps, self._estimated_payload
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

    def _on_joint_states(self, sample: JointSample, info: dict[str, int]) -> None:
        """Store a measured joint state in the arm state."""
        state = MotionState(sample.position, sample.velocity, 0 * sample.velocity)
        self._lifecycle.arm_state.add_measurement(state, deadline.now())

    def _on_reference(self, heard: Reference, info: dict[str, int]) -> None:
        """Pass the reference, the state that the servo follows, to the goal lifecycle."""
        self._lifecycle.handle_reference(heard.state, heard.stamp_ns)

    def _on_modes(self, modes: ModeArray, info: dict[str, int]) -> None:
        """Store the modes in force in the arm state."""
        self._lifecycle.arm_state.modes = modes

    def _on_reports(
        self, reports: list[HandOverReport | SimulatorReport], info: dict[str, int]
    ) -> None:
        """Pass the arm's reports on /diagnostics to the goal lifecycle.

        A report on the arm itself contains fault, last stop, machine, plan delay and failed servo
        pumps. From then on, plans are made without the failed pumps. A report that the arm has
        refused a plan contains the plan's stamp and the reason.

        Args:
            reports: Reports of one message.
            info: rclpy's information on the message, which gives its time of receipt.
        """
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

    def _on_estimates(self, heard: list[Estimate], info: dict[str, int]) -> None:
        """Store the payload that the arm has estimated, and use it if `payload_from` is `estimate`.

        An accurate estimate replaces the previous estimate if the two differ enough
        (`choose_payload`). If the parameter `payload_from` is `estimate`, plans use the new payload
        from now on, which is logged. If planning refuses this payload, the previous payload is
        kept.

        Args:
            heard: Estimates of any quantities of the arm.
            info: rclpy's information on the message.
        """
        payload = choose_payload(heard, self._estimated_payload)
        if payload == self._estimated_payload:
            return
        before, self._estimated_payload = self._estimated_payload, payload
        if self.get_parameter("payload_from").value != "estimate":
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

        Path and markers take milliseconds, so they wait while a plan is unconfirmed. The caller
        catches exceptions of this method, so that they do not affect the motion.
        """
        if self._move_tip is not None:
            self._move_tip.tick()
        if self._lifecycle.state.unconfirmed is None:
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
        The status has these values: number of verdicts, plan in force, and estimated commit horizon
        [s]. The commit horizon is the time until a new plan takes over. Further values are the
        payload [kg], name and hash of the machine, and the faults of callbacks. Its level is WARN
        in three cases: no state of the arm was received recently, there is a duplicate, or a
        callback has failed recently. Another node is a duplicate if it has the name of this node,
        or publishes on the same topics. Duplicates are also logged, at most every 10 s.
        """
        self._matching_subscriptions.update()
        view = self._lifecycle.arm_state
        view.qos_mismatch = self._matching_subscriptions.problem
        doubles = describe_duplicates(self, self._outbox.exclusive_publishers)
        if doubles:
            self.get_logger().warning(doubles, throttle_duration_sec=10.0)
        known = view.get_fresh_state(deadline.now()) is not None
        warnings = "; ".join(filter(None, (doubles, self.faults.get_recent_fault())))
        status = make_status(
            PLANNER_STATUS,
            Level.OK if known and not warnings else Level.WARN,
            warnings or ("ready" if known else "no state of the arm is received"),
            names.PLANNER_NODE,
            {
                "verdicts_given": str(self._outbox.verdict_count),
                "plan_in_force": _describe_plan_in_force(view),
                "lead_s": f"{self._lifecycle.hand_over.horizon_estimator.horizon:.4f}",
                "payload_kg": f"{self._settings.machine.arrays.payload:.3f}",
                "machine": self._machine.name,
                "machine_hash": self._machine.planning_hash,
                "faults": str(self.faults.count),
                "last_fault": self.faults.last,
            },
        )
        header = Header(stamp=self.get_clock().now().to_msg())
        self._outbox.publish(topics.DIAGNOSTICS, DiagnosticArray(header=header, status=[status]))

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


def _describe_plan_in_force(arm_state: ArmState) -> str:
    """Describe the stamp and the origin of the plan in force as text.

    Args:
        arm_state: Arm state.

    Returns:
        "unknown" if the arm has not reported which plan it executes; "none, the arm holds" if the
        arm reports that it executes no plan. Otherwise the stamp, and whether this planner made the
        plan.
    """
    if arm_state.plan_in_force_ns is None:
        return "unknown"
    if arm_state.plan_in_force_ns == NO_PLAN:
        return "none, the arm holds"
    own = (
        arm_state.own_command is not None
        and arm_state.own_command.stamp_ns == arm_state.plan_in_force_ns
    )
    whose = "this planner's" if own else "somebody else's"
    return f"{stamps.to_text(arm_state.plan_in_force_ns)}, {whose}"


def planner_node() -> int:
    """Plan an arm's motion to goal poses, over ROS 2.

    Settings are ROS parameters: `--ros-args -p NAME:=VALUE`; `ros2 param describe mhsb_planner
    NAME` gives meaning and unit of each.
    """
    return spin_node(PlannerNode)


main = command_line.make_main(planner_node, node=True)
