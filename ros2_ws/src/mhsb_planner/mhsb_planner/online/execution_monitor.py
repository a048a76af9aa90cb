"""Monitor of executions, from the confirmation of a plan to the execution report.

The time of plans is the arm's clock minus the delay that speed scaling has caused.
"""

import math
from dataclasses import replace

from mhsb_model.verdict import Outcome
from mhsb_planner.online.execution import Execution
from mhsb_planner.online.hand_over import LONGEST_WAIT
from mhsb_planner.online.lifecycle_state import LifecycleState
from mhsb_planner.online.pending_goal import PendingGoal, summarize_plan
from mhsb_planner.online.plan_request import PlanRequest
from mhsb_planner.online.replanning import Replan

REFERENCE_TIMEOUT = 0.1
"""Silence of the arm above which the execution of a plan is not judged [s].

The arm may have stopped moving, or its messages may be late."""


class ExecutionMonitor:
    """Monitor of the plan in force and of its goal, both in `LifecycleState.execution`."""

    def __init__(self, state: LifecycleState) -> None:
        """Store the state of the lifecycle, whose `execution` the other methods write."""
        self._state = state

    def begin(self, request: PlanRequest, replan: Replan) -> None:
        """Begin the execution of a plan that the arm has confirmed.

        Requests for further plans to its goal are withdrawn. Another goal that was being executed
        ends as replaced. If the plan's goal has ended already, no execution begins.

        Args:
            request: Request of the plan.
            replan: The plan.
        """
        state, pending_goal = self._state, request.pending_goal
        state.withdraw(pending_goal)
        if state.execution is not None and not state.executes(pending_goal):
            state.reports.report_end(
                state.execution.pending_goal, Outcome.REPLACED, "a later plan took over"
            )
        state.execution = None
        if not pending_goal.has_ended:
            state.execution = Execution(pending_goal, replan, request.target, request.settings)

    def take_over(self, pending_goal: PendingGoal) -> bool:
        """Let a goal take over the plan in force if this plan leads to the goal already.

        Four conditions must hold. The arm still executes a plan of this planner. The plan's target
        is within 0.1 mm of the goal. Plan and goal have the same settings. The goal does not move.

        The earlier goal of the plan then ends as replaced. The new goal is accepted, with
        `continued` set in its plan summary. If both are the same goal, nothing is reported.

        Args:
            pending_goal: The goal.

        Returns:
            True if the goal needs no new plan. This includes a goal that is being executed already.
        """
        state, execution, now = self._state, self._state.execution, self._state.now
        if (
            execution is None
            or not state.arm_state.executes_own(state.now_ns)
            or execution.replan.command is not state.arm_state.own_command
            or not pending_goal.goal.is_at_same_position(execution.target)
            or execution.settings is not pending_goal.get_settings(state.settings)
            or state.stream.is_moving(now)
        ):
            return False
        if execution.pending_goal is not pending_goal:
            state.reports.report_end(
                execution.pending_goal, Outcome.REPLACED, "the same goal came again and goes on"
            )
            pending_goal.plan_stamp_ns = execution.replan.command.stamp_ns
            elapsed = 1e3 * (now - pending_goal.received_at)
            plan = replace(summarize_plan(execution.replan, elapsed, elapsed), continued=True)
            state.reports.accept(pending_goal, "the arm is on its way there already", plan)
            execution.pending_goal = pending_goal
        return True

    def plan_to_stopped_goal(self) -> None:
        """Plan once more for a goal that moved and now stands still.

        The plan in force ends a little beyond the place of a moving goal. So the goal becomes the
        waiting goal again, with `needs_exact_place` set. Nothing happens in these cases:

        - No plan is being executed.
        - The plan in force already ends at the goal's exact place.
        - The goal still moves.
        - A goal waits, a plan is being made, or a plan was sent without an answer yet.
        """
        state, execution = self._state, self._state.execution
        if execution is None or state.goals_before_confirmation or execution.ends_at_goal:
            return
        if not state.stream.is_moving(state.now):
            execution.pending_goal.needs_exact_place = True
            state.put_back(execution.pending_goal)

    def judge(self) -> None:
        """End and report the execution if the arm's reports say that it is over.

        Nothing happens in these cases:

        - The same goal waits for a further plan, or this plan is being made, or it was sent without
          an answer yet.
        - The arm has been silent for more than `REFERENCE_TIMEOUT`: it may be frozen, or its
          messages may be late. After `LONGEST_WAIT` the latest reports decide, and the execution
          report says for how long the arm has been silent.
        - The tip has reached the end of the plan, but the goal has moved on and still moves.
        """
        state, execution, now = self._state, self._state.execution, self._state.now
        if execution is None or execution.pending_goal in state.goals_before_confirmation:
            return
        silence = state.arm_state.clock_estimator.time_since_last_stamp(now)
        if REFERENCE_TIMEOUT < silence < LONGEST_WAIT:
            return
        ending = execution.judge(state.settings.machine, state.arm_state, state.now_ns)
        if ending is None:
            return
        if LONGEST_WAIT <= silence < math.inf:
            sentence = f"{ending.sentence}; nothing has been heard of the arm for {silence:.1f} s"
            ending = ending._replace(sentence=sentence)
        moves_on = not execution.ends_at_goal and state.stream.is_moving(now)
        if ending.outcome is not Outcome.REACHED or not moves_on:
            state.execution = None
            state.reports.report_end(execution.pending_goal, *ending)
