"""State of the goal lifecycle: goals by their stage, settings, arm state and outbox.

All parts of the goal lifecycle share this state. Its methods move goals from stage to stage.
"""

import math
from dataclasses import dataclass, field

from mhsb_model.errors import MhsbError
from mhsb_model.verdict import GoalVerdict, Verdict
from mhsb_planner.online.arm_state import ArmState
from mhsb_planner.online.execution import Execution
from mhsb_planner.online.goal_reports import GoalReports, find_verdict_code
from mhsb_planner.online.goal_stream import GoalStream
from mhsb_planner.online.pending_goal import PendingGoal
from mhsb_planner.online.plan_request import PlanRequest, UnconfirmedPlan
from mhsb_planner.online.planner_io import PlannerIO
from mhsb_planner.online.settings import Settings
from mhsb_planner.search import goal_clearance


@dataclass(eq=False)
class LifecycleState:
    """State of the goal lifecycle, with four stages for goals.

    The stages are `waiting`, `request`, `unconfirmed` and `execution`. Each has at most one goal. A
    goal is in several stages if further plans are made for it. A new goal enters by `admit`, and a
    goal that must be planned for again by `put_back`. The newest goal waits, and supersedes the
    goal that waited before.

    Attributes:
        settings: Settings for goals that come without settings.
        arm_state: What the planner knows of the arm.
        outbox: Interface that carries out decisions and gives the time.
        reports: Sender of verdicts and execution reports.
        stream: Estimator of the velocity of a moving goal.
        waiting: Goal that waits for planning to begin; None if there is none.
        request: Request for the plan that is being made; None if there is none.
        unconfirmed: Command that was sent and has no answer yet; None if there is none.
        execution: Execution of the plan that the arm has confirmed; None if it has ended or there
            is none.
        epoch: Number of events so far (clock jumps and new settings) that make a plan void while it
            is made.
    """

    settings: Settings
    arm_state: ArmState
    outbox: PlannerIO
    reports: GoalReports
    stream: GoalStream = field(default_factory=GoalStream)
    waiting: PendingGoal | None = None
    request: PlanRequest | None = None
    unconfirmed: UnconfirmedPlan | None = None
    execution: Execution | None = None
    epoch: int = 0
    _void_until: float = -math.inf
    _void_reason: str = ""

    @property
    def now(self) -> float:
        """Present time by the steady clock [s]."""
        return self.outbox.steady_time()

    @property
    def now_ns(self) -> int:
        """Time of plans [ns]: the arm's clock minus the delay that speed scaling has caused."""
        return self.arm_state.get_plan_time_ns(self.now, self.outbox.ros_ns())

    # --- Goals in their places -------------------------------------------------------------------

    @property
    def queued_goals(self) -> list[PendingGoal]:
        """Goals without a sent plan: the waiting goal, and the goal for which a plan is made."""
        planned = None if self.request is None else self.request.pending_goal
        return [each for each in (self.waiting, planned) if each is not None]

    @property
    def unconfirmed_goals(self) -> list[PendingGoal]:
        """Goal of the unconfirmed plan (sent, without an answer) as a list of one element.

        The list is empty if there is no such plan, or if the unconfirmed command only brakes.
        """
        request = None if self.unconfirmed is None else self.unconfirmed.request
        return [] if request is None else [request.pending_goal]

    @property
    def goals_before_confirmation(self) -> list[PendingGoal]:
        """Goals in all stages before execution, newest first."""
        return self.queued_goals + self.unconfirmed_goals

    @property
    def goals_in_progress(self) -> list[PendingGoal]:
        """Goals in all four stages, newest first."""
        executed = [] if self.execution is None else [self.execution.pending_goal]
        return self.goals_before_confirmation + executed

    def executes(self, pending_goal: PendingGoal) -> bool:
        """Return whether the arm executes a plan that was made for this goal."""
        return self.execution is not None and self.execution.pending_goal is pending_goal

    # --- Goals that come and go ------------------------------------------------------------------

    def admit(self, pending_goal: PendingGoal) -> bool:
        """Let a new goal wait for planning, or refuse it at once.

        The goal is refused if the arm reports a fault or another machine file, or if the goal is
        out of reach. It is also refused if its options do not fit, or if it was sent before the
        last stop (`void_goals`). Otherwise it is added to `stream`. An older goal that waits ends
        as superseded. If the arm still executes an earlier plan for the older goal, this goal only
        ceases to wait.

        Args:
            pending_goal: The new goal.

        Returns:
            True if the new goal waits; False if it was refused.
        """
        for code, sentence in (
            (Verdict.FAULT, self.arm_state.fault),
            (Verdict.MACHINE, self.arm_state.machine_difference),
            (Verdict.STOPPED, self._void_reason * (pending_goal.sent_at <= self._void_until)),
        ):
            if sentence:
                self.end(pending_goal, code, sentence)
                return False
        try:
            self.check_place(pending_goal)
        except MhsbError as error:
            self.end(pending_goal, find_verdict_code(error), str(error))
            return False
        self.stream.add_goal(pending_goal.goal, pending_goal.received_at)
        if self.waiting is not None and not self.executes(self.waiting):
            self.reports.supersede(self.waiting)
        self.waiting = pending_goal
        return True

    def check_place(self, pending_goal: PendingGoal) -> None:
        """Check that the tip can be at the goal, and that the goal's options fit.

        Args:
            pending_goal: The goal. Its own settings are derived and cached if necessary.

        Raises:
            MhsbError: The goal lies outside the workspace, is too near to an obstacle, or has
                options that do not fit.
        """
        machine, goal = pending_goal.get_settings(self.settings).machine, pending_goal.goal
        machine.check_in_workspace(goal.position)
        goal_clearance.check_tip_clearance(machine, goal.position)

    def void_goals(self, sent_until: float, reason: str) -> None:
        """Refuse goals that were sent before a stop but arrive after it.

        Args:
            sent_until: Latest time of sending of such a goal, by the steady clock [s]. An earlier
                call with a later time stays in force.
            reason: Sentence for the verdicts of these goals, which says who was asked to stop.
        """
        if sent_until > self._void_until:
            self._void_until, self._void_reason = sent_until, reason

    def put_back(self, pending_goal: PendingGoal) -> None:
        """Let a goal wait for a new plan, or end it as superseded if a newer goal waits.

        A goal for which the arm executes a plan is not superseded. It ends when the arm begins to
        follow a plan for another goal. If the goal has ended already, nothing happens.

        Args:
            pending_goal: The goal. If it waits, its `waiting_since` is set to the present time.
        """
        if pending_goal.has_ended:
            return
        if self.waiting is None:
            pending_goal.waiting_since = self.now
            self.waiting = pending_goal
        elif not self.executes(pending_goal):
            self.reports.supersede(pending_goal)

    def withdraw(self, pending_goal: PendingGoal) -> None:
        """Withdraw a goal from planning.

        The goal waits no longer. A plan that is being made for it will be ignored.

        Args:
            pending_goal: The goal. If it neither waits nor is planned for, nothing happens.
        """
        if self.waiting is pending_goal:
            self.waiting = None
        if self.request is not None and self.request.pending_goal is pending_goal:
            self.request = None

    def revoke(self) -> list[PendingGoal]:
        """Mark the unconfirmed plan (sent, without an answer) as void.

        A void plan is no longer wanted. If the arm still begins to follow it, the arm is stopped.

        Returns:
            The plan's goal as a list of one element. The list is empty if there is no unconfirmed
            plan, or if the unconfirmed command only brakes.
        """
        if self.unconfirmed is not None:
            self.unconfirmed.is_void = True
        return self.unconfirmed_goals

    def end(self, pending_goal: PendingGoal, code: Verdict, sentence: str) -> None:
        """End a goal, and drop or make void its plans that the arm has not confirmed yet.

        The goal gets a verdict, or an execution report if it was accepted before. If it has ended
        already, it gets no report. If the arm executes a plan for the goal, the execution
        continues.

        Args:
            pending_goal: The goal.
            code: Code of the verdict.
            sentence: Reason why the goal ends.
        """
        self.reports.end(pending_goal, GoalVerdict(code, sentence, pending_goal.goal))
        self.withdraw(pending_goal)
        if pending_goal in self.unconfirmed_goals:
            self.revoke()

    def accept_plan_end(self) -> None:
        """Set the target of the plan in force to the goal's own place.

        The plan for a moving goal ends a little beyond the goal's place. After this call, no
        further plan to the exact place is made. If no plan is executed, nothing happens.
        """
        if self.execution is not None:
            self.execution.target = self.execution.pending_goal.goal

    # --- Machine of the arm ----------------------------------------------------------------------

    def store_arm_machine(self, difference: str | None) -> None:
        """Store how the arm's machine file differs from the planner's.

        A difference is logged when it appears or changes.

        Args:
            difference: The difference in one sentence; empty if the files are equal. None if the
                arm does not report its machine. The files then count as equal, and a warning is
                logged if nothing was known before.
        """
        before = self.arm_state.machine_difference
        if difference is None and before is None:
            self.outbox.warn(
                "the arm does not report its machine: whether it is this one is unknown"
            )
        if difference and difference != before:
            self.outbox.warn(difference)
        self.arm_state.machine_difference = difference or ""
