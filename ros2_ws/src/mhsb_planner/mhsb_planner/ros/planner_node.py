"""The planner node: goals in, joint trajectories, mode commands and verdicts out.

A thin adapter: messages are decoded here and become events of the `GoalLifecycle`, which decides;
what it asks for is done by the `RosOutbox`. Planning runs in one worker thread, everything else
in the executor's thread.
"""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Sequence

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
from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import Position
from mhsb_model.verdict import GoalVerdict, Verdict
from mhsb_msgs_py import (
    endpoints,
    estimates,
    goal_pose,
    joint_state,
    modes_in_force,
    names,
    reference,
    sim_status,
    stamps,
    topics,
)
from mhsb_msgs_py.errors import GoalError, MessageError
from mhsb_msgs_py.node_process import spin_node
from mhsb_msgs_py.sim_status import HandOverReport
from mhsb_planner import deadline
from mhsb_planner.kernel_parts import compile_planner
from mhsb_planner.online.departure import NoStateError
from mhsb_planner.online.goal_lifecycle import LONGEST_WAIT, GoalLifecycle
from mhsb_planner.online.learnt_payload import payload_to_plan_with
from mhsb_planner.online.progress import energy_between
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.online.settings import Settings
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_planner.ros import planner_diagnostics, planner_parameters
from mhsb_planner.ros.move_tip_server import MoveTipServer
from mhsb_planner.ros.outbox import RosOutbox
from mhsb_planner.ros.zone_parameters import ZONES

TICK = 0.02  # s
DIAGNOSTICS_PERIOD = 1.0  # s


class PlannerNode(Node):
    """Plans the arm's motion to goal poses, from where the arm is and while it moves."""

    def __init__(self) -> None:
        super().__init__(names.PLANNER_NODE)
        self._machine = planner_parameters.declare_machine(self)
        table_path = planner_parameters.declare_table_path(self)
        self._frame_prefix = planner_parameters.declare_frame_prefix(self)
        planner_parameters.declare(self, self._machine)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)
        self._lost_pumps: tuple[int, ...] = ()
        self._learnt_payload: float | None = None
        self._settings = self._settings_with()

        self._outbox = RosOutbox(self, self._machine, self._frame_prefix)
        compile_planner(self.get_logger().info)
        table = table_for(self._machine, table_path)
        replanner = Replanner(self._machine, table)
        replanner.change(self._settings.machine)
        example = replanner.warm_up()
        self._outbox.rehearse(example, self._settings.machine)
        energy_between(self._machine, example, example.stamp_ns, example.trajectory.end_ns)
        self._outbox.serve(replanner, self._on_answers)
        self._lifecycle = GoalLifecycle(self._settings, replanner.stop, self, self._outbox)
        self._make_interfaces()
        self._move_tip = self._serve_action()
        self._show_markers()
        gc.collect()
        gc.freeze()  # what has been loaded stays: later collections need not look at it
        self.get_logger().info(
            f"ready: {self._machine.name}, posture table with {len(table.nodes)} nodes"
        )

    def _make_interfaces(self) -> None:
        """Subscribe the goals last: whoever matches them finds a planner that is ready."""
        self.create_service(
            Trigger, names.STOP_SERVICE, self._on_stop, callback_group=ReentrantCallbackGroup()
        )
        steady = rclpy.clock.Clock(clock_type=rclpy.clock.ClockType.STEADY_TIME)
        self.create_timer(TICK, self._on_timer, clock=steady)
        self.create_timer(DIAGNOSTICS_PERIOD, self._publish_diagnostics, clock=steady)
        self._jump_handler = self.get_clock().create_jump_callback(
            JumpThreshold(
                min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True
            ),
            post_callback=self._on_clock_jump,
        )
        for topic, callback in (
            (topics.JOINT_STATES, self._on_joint_states),
            (topics.REFERENCE, self._on_reference),
            (topics.PLAN_IN_FORCE, self._on_plan_in_force),
            (topics.MODES, self._on_modes),
            (topics.DIAGNOSTICS, self._on_diagnostics),
            (topics.ESTIMATES, self._on_estimates),
        ):
            endpoints.subscription(self, topic, callback)
        goals = topics.GOAL_POSE
        self.create_subscription(goals.message, goals.name, self._on_goal, goals.qos)

    def _serve_action(self) -> MoveTipServer | None:
        """The action, where its interface was built; topics and services do without it."""
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
                MoveTip, self, self._machine, self._decoded, self._lifecycle, self._outbox,
                self._settings_with,
            )
        except Exception as error:
            self.get_logger().warning(
                "the action move_tip cannot be served; build mhsb_interfaces anew (scripts/setup). "
                f"Goals come by {topics.GOAL_POSE.name} all the same. ROS says: {error}"
            )
            return None

    # --- Clock of the lifecycle ------------------------------------------------------------------

    def wall(self) -> float:
        """By the steady clock [s]."""
        return deadline.now()

    def ros_ns(self) -> int:
        """By the clock of ROS [ns]."""
        return int(self.get_clock().now().nanoseconds)

    def _on_clock_jump(self, jump: TimeJump) -> None:
        self._lifecycle.clock_jumped("the clock went back or changed")

    # --- Parameters ------------------------------------------------------------------------------

    def _check_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        reason = planner_parameters.refusal(self, self._machine, changes)
        return SetParametersResult(successful=reason is None, reason=reason or "")

    def _take_parameters(self, changes: list[Parameter]) -> None:
        self._take_settings()
        if any(change.name in ZONES for change in changes):
            self._show_markers()

    def _take_settings(self) -> None:
        """Plan by the parameters, with the servo pumps that work and what the arm has learnt."""
        self._settings = self._settings_with()
        self._lifecycle.change(self._settings)

    def _settings_with(self, own: Sequence[Parameter] = ()) -> Settings:
        """By the parameters of now, some of them replaced by a goal's own."""
        return planner_parameters.read(self, self._machine, own).settings(
            self._machine, self._lost_pumps, self._learnt_payload
        )

    # --- What is heard ---------------------------------------------------------------------------

    def _on_goal(self, message: PoseStamped, info: dict[str, int]) -> None:
        try:
            goal = self._decoded(message)
        except GoalError as error:
            self._outbox.report(GoalVerdict.of(error.goal, error.code, str(error)))
        except MessageError as error:
            self._outbox.report(GoalVerdict(Verdict.INTERNAL, str(error), 0, 0.0, 0.0))
        else:
            self._lifecycle.goal(goal, self._received(info))

    def _decoded(self, message: PoseStamped) -> Goal:
        """The goal of a message; raises GoalError and MessageError."""
        turned = self._turned if self._machine.slews else None
        return goal_pose.decode(message, self._frame_prefix, turned)

    def _turned(self, x: float, z: float) -> Position:
        """From the plane in which the arm is to `base_link`."""
        state = self._lifecycle.view.state(self.wall())
        if state is None:
            raise GoalError(Verdict.NO_STATE, str(NoStateError()))
        tip = self._machine.in_base(np.array([x, z]), float(state.position[0]))
        return tuple(tip.tolist())

    def _on_joint_states(self, message: JointState) -> None:
        try:
            sample = joint_state.decode(message, self._machine.joint_names)
        except MessageError as error:
            self._warn(f"joint_states are not used: {error}")
            return
        state = MotionState(sample.position, sample.velocity, 0 * sample.velocity)
        self._lifecycle.heard_joints(state, sample.stamp_ns)

    def _on_reference(self, message: JointTrajectory) -> None:
        try:
            heard = reference.decode(message, self._machine.joint_names)
        except MessageError as error:
            self._warn(f"reference is not used: {error}")
            return
        self._lifecycle.heard_reference(heard.state, heard.stamp_ns)

    def _on_modes(self, message: UInt8MultiArray) -> None:
        try:
            modes = modes_in_force.decode(message, self._machine.joint_count)
        except MessageError as error:
            self._warn(f"modes are not used: {error}")
            return
        self._lifecycle.heard_modes(modes)

    def _on_plan_in_force(self, message: Time) -> None:
        try:
            stamp_ns = stamps.from_time(message)
        except MessageError as error:
            self._warn(f"plan_in_force is not used: {error}")
            return
        self._lifecycle.heard_in_force(stamp_ns)

    def _on_diagnostics(self, message: DiagnosticArray, info: dict[str, int]) -> None:
        """What the arm says of plans and of itself; others speak on this topic too."""
        try:
            reports = sim_status.decode(message, self.get_namespace())
        except MessageError as error:
            self._warn(f"a report of the arm is not used: {error}")
            return
        for report in reports:
            if not isinstance(report, HandOverReport):
                self._lifecycle.heard_fault(report.sentence if report.faulty else "")
                self._lifecycle.heard_stop(report.last_stop_ns, self._received(info))
                self._lifecycle.heard_delay(round(report.plan_delay * SECOND_NS))
                if report.lost_servo_pumps != self._lost_pumps:
                    self._lost_pumps = report.lost_servo_pumps
                    self._take_settings()
            elif report.reason:
                self._lifecycle.heard_refusal(report.plan_stamp_ns, report.reason, report.sentence)

    def _on_estimates(self, message: JointState) -> None:
        """What the arm has learnt: of that, plans may be made for its payload."""
        try:
            heard = estimates.decode(message)
        except MessageError as error:
            self._warn(f"estimates are not used: {error}")
            return
        payload = payload_to_plan_with(heard, self._learnt_payload)
        if payload == self._learnt_payload:
            return
        self._learnt_payload = payload
        if planner_parameters.read(self, self._machine).payload_from != "estimate":
            return
        try:
            self._take_settings()
        except MhsbError as error:
            self._warn(f"the payload of {payload:.2f} kg that the arm has learnt: {error}")
        else:
            self.get_logger().info(f"plans are made for {payload:.2f} kg, as the arm has learnt")

    def _received(self, info: dict[str, int]) -> float:
        """When a message came, by the steady clock [s]; the node may have been busy since."""
        waited = (time.time_ns() - info["received_timestamp"]) / SECOND_NS
        return self.wall() - min(max(0.0, waited), LONGEST_WAIT)

    # --- What is done ----------------------------------------------------------------------------

    def _on_answers(self) -> None:
        for request, answer in self._outbox.answers():
            if self._move_tip is None or not self._move_tip.planned(request, answer):
                self._lifecycle.planned(request, answer)

    def _on_timer(self) -> None:
        self._on_answers()  # a guard condition may be lost between two waits
        self._lifecycle.tick()
        if self._move_tip is not None:
            self._move_tip.tick()
        self._outbox.show(self._settings.machine)

    async def _on_stop(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Decelerate along the path of the plan in force and hold; answered when that is sure."""
        stopped: Future = Future()
        self._lifecycle.stop(lambda success, sentence: stopped.set_result((success, sentence)))
        response.success, response.message = await stopped
        return response

    def _publish_diagnostics(self) -> None:
        message = planner_diagnostics.message(
            self, self.wall(), self._lifecycle, self._outbox, self._settings.machine.arrays.payload
        )
        self._outbox.publish(topics.DIAGNOSTICS, message)

    def _show_markers(self) -> None:
        self._outbox.show_markers(self._settings.machine, self._lifecycle.view.own)

    def _warn(self, sentence: str) -> None:
        self.get_logger().warning(sentence, throttle_duration_sec=1.0)

    def destroy_node(self) -> None:
        """End the worker with the node."""
        self._outbox.close()
        if self._move_tip is not None:
            self._move_tip.close()
        super().destroy_node()


def planner_node() -> int:
    """Plan an arm's motion to goal poses, over ROS 2.

    Settings are ROS parameters: `--ros-args -p NAME:=VALUE`; `ros2 param describe mhsb_planner
    NAME` gives meaning and unit of each.
    """
    return spin_node(PlannerNode)


def main() -> int:
    """Entry point of `ros2 run mhsb_planner planner_node`."""
    return command_line.run(planner_node, name="planner_node", node=True)


if __name__ == "__main__":
    sys.exit(main())
