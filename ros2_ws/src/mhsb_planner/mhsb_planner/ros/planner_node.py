"""The planner node: goals in, joint trajectories, mode commands and verdicts out.

A thin adapter. What to continue is decided by `departure`, planning is `replanning`, executions
are followed by `executions`; here messages are decoded, work is handed to the worker, and results
are published. Planning runs in one worker thread, everything else in the executor's thread.
"""

from __future__ import annotations

import gc
import sys
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path as PathMessage
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import UInt8MultiArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from mhsb_model import command_line
from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.verdict import ExecutionReport, GoalVerdict, PlanSummary, Verdict
from mhsb_msgs_py import (
    goal_pose,
    joint_state,
    mode_schedule,
    modes_in_force,
    names,
    plan_status,
    reference,
    stamps,
    topics,
    trajectory,
)
from mhsb_msgs_py.errors import GoalError, MessageError
from mhsb_msgs_py.node_process import spin_node
from mhsb_planner.deadline import Deadline
from mhsb_planner.motion.s3_clearance import contact_ahead
from mhsb_planner.online.departure import ArmView, MovingError, NoStateError, Received
from mhsb_planner.online.executions import Executions
from mhsb_planner.online.replanning import Replan, Replanner
from mhsb_planner.online.verdicts import code_of, summary_of
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_planner.ros import planner_diagnostics, planner_parameters, views
from mhsb_planner.ros.planner_parameters import PlannerParameters
from mhsb_planner.search import goal_clearance

LONGEST_WAIT = 2.0
"""How long a goal waits for a state, for somebody who receives plans, or for an arm that has
been asked to stop [s]."""

NEWER_GOAL = "a newer goal came before this one was planned"

RETRY_PERIOD = 0.02  # s
DIAGNOSTICS_PERIOD = 1.0  # s


@dataclass(frozen=True)
class WaitingGoal:
    """A goal that has not been planned yet, and when it came by the steady clock [s].

    late counts the plans for it that were ready too late to be published.
    """

    goal: Goal
    received: float
    late: int = 0

    @property
    def age(self) -> float:
        """Time since it was received [s]."""
        return time.monotonic() - self.received


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
        self._settings = planner_parameters.read(self)
        self._arm = self._settings.machine(self._machine)

        self._view = ArmView(self._machine.joint_count)
        self._executions = Executions(self._machine)
        self._waiting: WaitingGoal | None = None
        self._job: Future[Replan | None] | None = None
        self._planning: WaitingGoal | None = None
        self._planned_among = self._arm.zones
        self._stop_asked = False
        self._last_stamp_ns = 0
        self._verdicts = 0

        self._make_publishers()
        table = table_for(self._machine, table_path)
        self._replanner = Replanner(self._machine, table)
        self._replanner.change(self._arm)
        example = self._replanner.warm_up()
        for message in (*self._messages(example), *self._views(example)):
            serialize_message(message)  # loads the support of its type
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="planning")
        self._job_done = self.create_guard_condition(self._finish_job)
        self._make_subscriptions()
        self._show_markers()
        gc.collect()
        gc.freeze()  # what has been loaded stays: later collections need not look at it
        self.get_logger().info(
            f"ready: {self._machine.name}, posture table with {len(table.nodes)} nodes"
        )

    # --- Set-up ----------------------------------------------------------------------------------

    def _make_publishers(self) -> None:
        self._publishers_by_topic = {
            topic.name: self.create_publisher(topic.message, topic.name, topic.qos)
            for topic in (
                topics.PLAN_STATUS,
                topics.JOINT_TRAJECTORY,
                topics.MODE_COMMANDS,
                topics.PLANNED_PATH,
                topics.PLANNED_PATH_FLAT,
                topics.MARKERS,
                topics.DIAGNOSTICS,
            )
        }

    def _make_subscriptions(self) -> None:
        """Subscribe the goals last: whoever matches them finds a planner that is ready."""
        for topic, callback in (
            (topics.JOINT_STATES, self._on_joint_states),
            (topics.REFERENCE, self._on_reference),
            (topics.PLAN_IN_FORCE, self._on_plan_in_force),
            (topics.MODES, self._on_modes),
        ):
            self.create_subscription(topic.message, topic.name, callback, topic.qos)
        self._arm_stop = self.create_client(Trigger, f"{names.SIM_NODE}/stop")
        self.create_service(Trigger, names.STOP_SERVICE, self._on_stop)
        steady = rclpy.clock.Clock(clock_type=rclpy.clock.ClockType.STEADY_TIME)
        self.create_timer(RETRY_PERIOD, self._on_timer, clock=steady)
        self.create_timer(DIAGNOSTICS_PERIOD, self._publish_diagnostics, clock=steady)
        self._jump_handler = self.get_clock().create_jump_callback(
            JumpThreshold(
                min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True
            ),
            post_callback=self._on_clock_jump,
        )
        goal = topics.GOAL_POSE
        self.create_subscription(goal.message, goal.name, self._on_goal, goal.qos)

    def _check_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        reason = planner_parameters.refusal(self, self._machine, changes)
        return SetParametersResult(successful=reason is None, reason=reason or "")

    def _take_parameters(self, changes: list[Parameter]) -> None:
        self._settings = planner_parameters.read(self)
        self._arm = self._settings.machine(self._machine)
        if any(change.name in planner_parameters.ZONES for change in changes):
            self._show_markers()
            self._stop_before_obstacles()

    # --- What is heard of the arm ----------------------------------------------------------------

    def _on_joint_states(self, message: JointState) -> None:
        try:
            sample = joint_state.decode(message, self._machine.joint_names)
        except MessageError as error:
            self._warn(f"joint_states are not used: {error}")
            return
        state = MotionState(sample.position, sample.velocity, 0 * sample.velocity)
        self._view.measured = Received(state, self._now_ns())

    def _on_reference(self, message: JointTrajectory) -> None:
        try:
            heard = reference.decode(message, self._machine.joint_names)
        except MessageError as error:
            self._warn(f"reference is not used: {error}")
            return
        self._view.reference = Received(heard.state, self._now_ns())

    def _on_modes(self, message: UInt8MultiArray) -> None:
        try:
            self._view.modes = modes_in_force.decode(message, self._machine.joint_count)
        except MessageError as error:
            self._warn(f"modes are not used: {error}")

    def _on_plan_in_force(self, message: Time) -> None:
        self._view.in_force_ns = stamps.from_time(message)
        self._follow_executions()
        self._start_job()

    def _on_clock_jump(self, jump: TimeJump) -> None:
        self.get_logger().warning(
            "the clock went back or changed: what was known of the arm is forgotten"
        )
        self._view.forget()
        self._last_stamp_ns = 0
        self._publish_reports(self._executions.abort_all("the clock went back"))

    # --- Goals -----------------------------------------------------------------------------------

    def _on_goal(self, message: PoseStamped) -> None:
        received = time.monotonic()
        try:
            goal = goal_pose.decode(message, self._frame_prefix)
        except GoalError as error:
            self._refuse(Goal(error.stamp_ns, error.x, error.z), error.code, str(error))
            return
        except MessageError as error:
            self._refuse(Goal(0, 0.0, 0.0), Verdict.INTERNAL, str(error))
            return
        try:
            self._arm.check_in_workspace(goal.x, goal.z)
            goal_clearance.check_tip(self._arm, goal.x, goal.z)
        except MhsbError as error:
            self._refuse(goal, code_of(error), str(error))
            return
        self._supersede_waiting(NEWER_GOAL)
        self._waiting = WaitingGoal(goal, received)
        self._stop_asked = False
        self._start_job()

    def _start_job(self) -> None:
        """Plan the waiting goal, if there is one, the worker is free and the arm is known."""
        waiting = self._waiting
        if waiting is None or self._job is not None or self._plan_on_its_way():
            return
        if not self._connected() and waiting.age < LONGEST_WAIT:
            return
        now_ns = self._now_ns()
        try:
            departure = self._view.departure(now_ns)
        except NoStateError as error:
            self._wait_or_refuse(waiting, error)
            return
        except MovingError as error:
            self._ask_arm_to_stop()
            self._wait_or_refuse(waiting, error)
            return
        self._waiting, self._planning = None, waiting
        self._planned_among = self._arm.zones
        self._job = self._worker.submit(
            self._replan,
            self._arm,
            departure,
            max(now_ns, self._last_stamp_ns + 1),
            waiting.goal,
            self._settings,
        )
        self._job.add_done_callback(lambda _: self._job_done.trigger())

    def _replan(
        self,
        arm: Machine,
        departure: Command,
        now_ns: int,
        goal: Goal,
        parameters: PlannerParameters,
    ) -> Replan | None:
        """The worker's part."""
        deadline = Deadline.after(parameters.planning_budget)
        self._replanner.change(arm)
        return self._replanner.replan(
            departure,
            now_ns,
            (goal.x, goal.z),
            parameters.planning_budget,
            parameters.options,
            deadline,
        )

    def _connected(self) -> bool:
        """Whether the arm receives both halves of a plan, and is heard as far as it speaks.

        What is sent before the match is lost; who tells a reference also tells the plan in force.
        An arm that was killed still counts for a while, so there must be as many receivers as
        there are sources of a reference.
        """
        view = self._view
        arms = max(1, self.count_publishers(topics.REFERENCE.name))
        return (view.reference is None or view.in_force_ns is not None) and all(
            self._publishers_by_topic[topic.name].get_subscription_count() >= arms
            for topic in (topics.JOINT_TRAJECTORY, topics.MODE_COMMANDS)
        )

    def _plan_on_its_way(self) -> bool:
        """Whether a plan has been published that the arm has not yet had time to confirm."""
        own, in_force_ns = self._view.own, self._view.in_force_ns
        if own is None or in_force_ns is None or in_force_ns == own.stamp_ns:
            return False
        return self._executions.awaits_confirmation(own.stamp_ns, self._now_ns())

    def _wait_or_refuse(self, waiting: WaitingGoal, error: MhsbError) -> None:
        if waiting.age < LONGEST_WAIT:
            return
        self._waiting = None
        self._refuse(waiting.goal, code_of(error), str(error))

    def _ask_arm_to_stop(self) -> None:
        if not self._stop_asked and self._arm_stop.service_is_ready():
            self._stop_asked = True
            self._arm_stop.call_async(Trigger.Request())

    def _finish_job(self) -> None:
        job, waiting = self._job, self._planning
        if job is None or waiting is None or not job.done():
            return
        self._job = self._planning = None
        if self._arm.zones != self._planned_among:
            self._plan_among_new_zones(waiting)
            return
        try:
            replan = job.result()
        except MhsbError as error:
            self._refuse(waiting.goal, code_of(error), str(error))
        except Exception as error:  # a fault of the planner must not end the node
            self.get_logger().error(f"planning failed: {error!r}")
            self._refuse(
                waiting.goal, Verdict.INTERNAL, f"planning failed with {type(error).__name__}"
            )
        else:
            if replan is None:
                self._accept_at_goal(waiting)
            else:
                self._publish_plan(waiting, replan)
        self._start_job()

    def _plan_among_new_zones(self, waiting: WaitingGoal) -> None:
        """What has been planned does not count: zones changed meanwhile."""
        if self._waiting is None:
            self._waiting = waiting
        else:
            self._refuse(waiting.goal, Verdict.SUPERSEDED, NEWER_GOAL)
        self._start_job()

    def _accept_at_goal(self, waiting: WaitingGoal) -> None:
        goal = waiting.goal
        nothing = PlanSummary(0, 0.0, 0.0, 0.0, 0, 1e3 * waiting.age, 0.0)
        sentence = f"the tip is at ({goal.x:.4g}, {goal.z:.4g}) m already"
        self._report(
            GoalVerdict(Verdict.AT_GOAL, sentence, goal.stamp_ns, goal.x, goal.z, nothing)
        )

    def _publish_plan(self, waiting: WaitingGoal, replan: Replan) -> None:
        goal, command = waiting.goal, replan.command
        late_ns = self._now_ns() - replan.change_ns
        if late_ns >= 0:
            self._plan_again(waiting, late_ns)
            return
        self._send(command)
        self._view.own = command
        self._last_stamp_ns = command.stamp_ns
        summary = summary_of(replan, 1e3 * waiting.age)
        self._report(
            GoalVerdict(
                Verdict.OK,
                "; ".join([
                    _announcement(replan, goal, summary.duration_s),
                    *map(str, replan.plan.motion.overloads),
                ]),
                goal.stamp_ns,
                goal.x,
                goal.z,
                summary,
            )
        )
        self._executions.add(goal, command, replan.change_ns)
        self._show(command)

    def _plan_again(self, waiting: WaitingGoal, late_ns: int) -> None:
        """A plan was late: once that is a busy machine's hiccup, the next time it is a verdict."""
        if waiting.late == 0 and self._waiting is None:
            self._waiting = replace(waiting, late=1)
            return
        self._refuse(
            waiting.goal,
            Verdict.DEADLINE,
            f"planning ended {late_ns / 1e6:.1f} ms after planning_budget was over; raise it",
        )

    def _messages(self, command: Command) -> tuple[JointTrajectory, JointTrajectory]:
        """Both halves of a plan: joint_trajectory and mode_commands."""
        return (
            trajectory.encode(command.trajectory, self._machine.joint_names),
            mode_schedule.encode(command.schedule, self._machine.actuator_names),
        )

    def _views(self, command: Command) -> tuple[PathMessage, PathMessage, MarkerArray]:
        """What viewers are shown: planned_path in both frames, markers."""
        prefix = self._frame_prefix
        return (
            *views.paths(self._machine, command, prefix),
            views.markers(self._arm, command, prefix, command.stamp_ns),
        )

    def _send(self, command: Command) -> None:
        halves = (topics.JOINT_TRAJECTORY, topics.MODE_COMMANDS)
        for topic, message in zip(halves, self._messages(command), strict=True):
            self._publish(topic, message)

    def _show(self, command: Command) -> None:
        shown = (topics.PLANNED_PATH, topics.PLANNED_PATH_FLAT, topics.MARKERS)
        for topic, message in zip(shown, self._views(command), strict=True):
            self._publish(topic, message)

    def _show_markers(self) -> None:
        now_ns = self._now_ns()
        self._publish(
            topics.MARKERS, views.markers(self._arm, self._view.own, self._frame_prefix, now_ns)
        )

    # --- Executions, stopping, diagnostics -------------------------------------------------------

    def _on_timer(self) -> None:
        self._follow_executions()
        self._start_job()

    def _follow_executions(self) -> None:
        self._publish_reports(self._executions.update(self._view, self._now_ns()))

    def _publish_reports(self, reports: list[ExecutionReport]) -> None:
        for report in reports:
            self._report(report)

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Decelerate along the path of the plan in force and hold there."""
        self._supersede_waiting("the planner was asked to stop")
        own = self._view.own
        if own is None or self._view.in_force_ns not in (None, own.stamp_ns):
            response.success = True
            response.message = "no plan of this planner is being executed"
            return response
        now_ns = max(self._now_ns(), self._last_stamp_ns + 1)
        command = self._stop(own, now_ns)
        self._publish_reports(self._executions.stop_all("the planner was asked to stop"))
        response.success = True
        response.message = (
            f"the arm stands still in {(command.trajectory.end_ns - now_ns) / SECOND_NS:.2f} s"
        )
        return response

    def _stop(self, own: Command, now_ns: int) -> Command:
        """Send the command that brakes along a command's path."""
        command = self._replanner.stop(own, now_ns, self._settings.planning_budget)
        self._send(command)
        self._view.own = command
        self._last_stamp_ns = command.stamp_ns
        return command

    def _stop_before_obstacles(self) -> None:
        """Stop where an obstacle now lies across what is left of this planner's motion."""
        own = self._view.own
        in_force = own is not None and self._view.in_force_ns in (None, own.stamp_ns)
        if own is None or not (in_force or self._plan_on_its_way()):
            return
        now_ns = max(self._now_ns(), self._last_stamp_ns + 1)
        if now_ns >= own.trajectory.end_ns:
            return
        contact = contact_ahead(self._arm, own.trajectory, now_ns)
        if contact is None:
            return
        command = self._stop(own, now_ns)
        met = contact_ahead(self._arm, command.trajectory, now_ns)
        where = "before it" if met is None else "as soon as it can, but not before it"
        reason = f"{contact.name} was set across the way; the arm stops {where}"
        self.get_logger().warning(reason)
        self._publish_reports(self._executions.stop_all(reason))

    def _publish_diagnostics(self) -> None:
        self._publish(
            topics.DIAGNOSTICS,
            planner_diagnostics.message(self._now_ns(), self._view, self._verdicts),
        )

    # --- Talking ---------------------------------------------------------------------------------

    def _supersede_waiting(self, reason: str) -> None:
        if self._waiting is not None:
            self._refuse(self._waiting.goal, Verdict.SUPERSEDED, reason)
            self._waiting = None

    def _refuse(self, goal: Goal, code: Verdict, sentence: str) -> None:
        self._report(GoalVerdict(code, sentence, goal.stamp_ns, goal.x, goal.z))

    def _report(self, report: GoalVerdict | ExecutionReport) -> None:
        message: DiagnosticArray = plan_status.encode(report, self._now_ns())
        self._publish(topics.PLAN_STATUS, message)
        if isinstance(report, GoalVerdict):
            self._verdicts += 1

    def _publish(self, topic: topics.Topic, message: Any) -> None:
        self._publishers_by_topic[topic.name].publish(message)

    def _warn(self, sentence: str) -> None:
        self.get_logger().warning(sentence, throttle_duration_sec=1.0)

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def destroy_node(self) -> None:
        """End the worker with the node."""
        self._worker.shutdown(wait=True, cancel_futures=True)
        super().destroy_node()


def planner_node() -> int:
    """Plan an arm's motion to goal poses, over ROS 2.

    Settings are ROS parameters: `--ros-args -p NAME:=VALUE`; `ros2 param describe mhsb_planner
    NAME` gives meaning and unit of each.
    """
    return spin_node(PlannerNode)


def _announcement(replan: Replan, goal: Goal, duration: float) -> str:
    """One sentence on an accepted goal."""
    sentence = f"the tip goes to ({goal.x:.4g}, {goal.z:.4g}) m in {duration:.1f} s"
    if replan.plan.path.statistics.out_of_time:
        sentence += ", the best found within the planning budget"
    return sentence


def main() -> int:
    """Entry point of `ros2 run mhsb_planner planner_node`."""
    return command_line.run(planner_node, name="planner_node", node=True)


if __name__ == "__main__":
    sys.exit(main())
