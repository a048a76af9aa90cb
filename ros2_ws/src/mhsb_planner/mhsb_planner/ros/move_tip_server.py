"""The action MoveTip: goals whose progress is told and that can be cancelled.

It stands beside `goal_pose`, with the same lifecycle behind: what becomes of a goal is decided
there, and only told here. Its interface, the package mhsb_interfaces, has to be compiled; where
that was not done, `serve` says so and the topics remain.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionServer, CancelResponse
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectory

from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.verdict import GoalVerdict, Outcome, PlanSummary, Report, Verdict
from mhsb_msgs_py import names, stamps
from mhsb_msgs_py.errors import GoalError, MessageError
from mhsb_planner.errors import DeadlineError
from mhsb_planner.online.goal_in_hand import Adjustment, GoalInHand, summary_of
from mhsb_planner.online.goal_lifecycle import GoalLifecycle
from mhsb_planner.online.lead import LONGER
from mhsb_planner.online.plan_request import PlanRequest
from mhsb_planner.online.progress import Progress
from mhsb_planner.online.replanning import Replan
from mhsb_planner.online.settings import Settings
from mhsb_planner.online.verdicts import announcement, code_of
from mhsb_planner.ros import goal_options
from mhsb_planner.ros.outbox import RosOutbox

FEEDBACK_PERIOD = 0.1  # s
RESULT_KEPT = 60  # s, for clients that ask late
MOST_STRETCHED = 20.0
"""A plan that nobody executes is looked for with leads up to so many times the usual one."""


@dataclass(eq=False)
class _Job:
    """A goal of the action; `ended` becomes its result's fields and whether it succeeded."""

    handle: Any
    ended: Future = field(default_factory=Future)
    in_hand: GoalInHand | None = None
    progress: Progress = field(default_factory=Progress)
    result: dict[str, Any] = field(default_factory=dict)

    def told(self, report: Report) -> None:
        """What becomes of the goal, from the lifecycle."""
        if isinstance(report, GoalVerdict):
            self.result |= {"verdict": str(report.code), "message": report.sentence}
            if report.plan is not None:
                self.result |= _figures(report.plan)
            if report.code is not Verdict.OK:
                self.end(report.code is Verdict.AT_GOAL)
        else:
            self.result |= {
                "outcome": str(report.outcome),
                "message": report.sentence,
                "plan_stamp": stamps.to_time(report.plan_stamp_ns),
                "lead_ms": report.lead_ms,
            }
            self.end(report.outcome is Outcome.REACHED)

    def refuse(self, code: Verdict, sentence: str) -> None:
        self.result |= {"verdict": str(code), "message": sentence}
        self.end(False)

    def end(self, success: bool) -> None:
        if not self.ended.done():
            self.ended.set_result(success)


class MoveTipServer:
    """Serves ~/move_tip.

    decoded        the goal of a message; raises GoalError and MessageError
    settings_with  settings of plans with some parameters of a goal's own
    """

    def __init__(
        self,
        action: Any,
        node: Any,
        machine: Machine,
        decoded: Callable[[PoseStamped], Goal],
        lifecycle: GoalLifecycle,
        outbox: RosOutbox,
        settings_with: Callable[[Sequence[Parameter]], Settings],
    ) -> None:
        """Raises what rclpy does where the compiled interface does not go with its libraries."""
        self._action = action
        self._node = node
        self._machine = machine
        self._decoded = decoded
        self._lifecycle = lifecycle
        self._outbox = outbox
        self._settings_with = settings_with
        self._jobs: list[_Job] = []
        self._rehearsals: dict[PlanRequest, _Job] = {}
        self._told_at = 0.0
        self._server = ActionServer(
            node,
            action,
            names.MOVE_TIP_ACTION,
            self._execute,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            result_timeout=RESULT_KEPT,
        )

    def close(self) -> None:
        """End the server with the node."""
        self._server.destroy()

    # --- A goal's life ---------------------------------------------------------------------------

    def _on_accepted(self, handle: Any) -> None:
        job = _Job(handle)
        self._jobs.append(job)
        self._begin(job)
        handle.execute()

    def _begin(self, job: _Job) -> None:
        request = job.handle.request
        try:
            goal = self._decoded(request.pose)
            changes = goal_options.decode(self._node, self._machine, request.options)
        except GoalError as error:
            job.refuse(error.code, str(error))
        except MessageError as error:
            job.refuse(Verdict.INTERNAL, str(error))
        except MhsbError as error:
            job.refuse(code_of(error), str(error))
        else:
            goal = replace(goal, stamp_ns=goal.stamp_ns or time.time_ns())
            adjusted = self._adjustment(changes)
            if request.plan_only:
                self._rehearse(job, goal, adjusted)
            else:
                job.in_hand = self._lifecycle.goal(goal, adjusted=adjusted, told=job.told)

    def _adjustment(self, changes: Sequence[Parameter]) -> Adjustment:
        """Settings of all, whose parameters a goal has its own of in part."""
        return lambda settings: self._settings_with(changes) if changes else settings

    async def _execute(self, handle: Any) -> Any:
        """Wait until the lifecycle has told how the goal ended."""
        job = next(job for job in self._jobs if job.handle is handle)
        success = await job.ended
        self._jobs.remove(job)
        if success:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return self._action.Result(**job.result)

    def _on_cancel(self, handle: Any) -> CancelResponse:
        """Brake, where the goal is the newest; a plan alone is thrown away."""
        job = next((job for job in self._jobs if job.handle is handle), None)
        if job is None or job.ended.done():
            return CancelResponse.REJECT
        if job.in_hand is None:
            job.refuse(Verdict.STOPPED, "planning was cancelled")
        else:
            self._lifecycle.cancel(job.in_hand)
        return CancelResponse.ACCEPT

    # --- Plans that nobody executes --------------------------------------------------------------

    def _rehearse(
        self, job: _Job, goal: Goal, adjusted: Adjustment, stretch: float = 1.0
    ) -> None:
        try:
            request = self._lifecycle.rehearsal(goal, adjusted, stretch)
        except MhsbError as error:
            job.refuse(code_of(error), str(error))
        else:
            self._rehearsals[request] = job
            self._outbox.plan(request)

    def planned(self, request: PlanRequest, answer: Replan | Exception | None) -> bool:
        """Take an answer that was asked for here; False where it was not."""
        job = self._rehearsals.pop(request, None)
        if job is None:
            return False
        if job.ended.done():
            return True
        in_hand, longest = request.in_hand, request.settings.lead_max
        elapsed = 1e3 * (self._node.wall() - in_hand.received)
        again = request.lead < longest and in_hand.stretch < MOST_STRETCHED
        if isinstance(answer, DeadlineError) and again:
            self._rehearse(job, in_hand.goal, in_hand.adjusted, LONGER * in_hand.stretch)
        elif isinstance(answer, MhsbError):
            code = Verdict.NOT_FOUND if isinstance(answer, DeadlineError) else code_of(answer)
            job.refuse(code, str(answer))
        elif isinstance(answer, Exception):
            job.refuse(Verdict.INTERNAL, f"planning failed with {type(answer).__name__}")
        elif answer is None:
            nothing = PlanSummary(0, 0.0, 0.0, 0.0, 0, elapsed, 0.0)
            sentence = f"the tip is at {in_hand.goal.place} already"
            job.told(GoalVerdict.of(in_hand.goal, Verdict.AT_GOAL, sentence, nothing))
        else:
            halves = self._outbox.halves(answer.command)
            job.result |= _figures(summary_of(answer, elapsed, elapsed + 1e3 * request.lead))
            job.result |= {
                "verdict": str(Verdict.OK),
                "message": announcement(answer, in_hand.goal),
                "joint_trajectory": deserialize_message(halves[0], JointTrajectory),
                "mode_commands": deserialize_message(halves[1], JointTrajectory),
            }
            job.end(True)
        return True

    # --- Feedback --------------------------------------------------------------------------------

    def tick(self) -> None:
        """Tell of goals in hand how far they are, some times a second."""
        now = self._node.wall()
        if not self._jobs or now - self._told_at < FEEDBACK_PERIOD:
            return
        self._told_at = now
        life, view = self._lifecycle, self._lifecycle.view
        for job in self._jobs:
            if job.ended.done():
                continue
            execution, state = life.execution, "planning"
            if execution is not None and execution.in_hand is job.in_hand:
                job.progress.look(execution, view.now_ns(now, self._node.ros_ns()))
                state = "stopping" if life.stops else "moving"
            job.handle.publish_feedback(
                self._action.Feedback(
                    state=state,
                    progress=job.progress.share,
                    time_left_s=job.progress.left,
                    modes=[] if view.modes is None else view.modes.tolist(),
                    energy_j=job.progress.energy_j,
                    energy_series_j=job.progress.energy_series_j,
                )
            )


def _figures(plan: PlanSummary) -> dict[str, Any]:
    return {
        "plan_stamp": stamps.to_time(plan.plan_stamp_ns),
        "energy_j": plan.energy_j,
        "energy_series_j": plan.energy_series_j,
        "lower_bound_j": plan.lower_bound_j,
        "duration_s": plan.duration_s,
        "switches": plan.switches,
        "plan_ms": plan.plan_ms,
        "lead_ms": plan.lead_ms,
    }
