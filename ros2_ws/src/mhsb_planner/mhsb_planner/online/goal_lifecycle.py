"""Lifecycle of goals: waiting, being planned for, sent, in force, ended; free of ROS.

At most one goal waits (the newest), one is being planned for, one plan is unconfirmed, and one is
in force. A plan replaces the one in force only when the arm has confirmed it. An epoch counter
marks events that make plans void while they are being made: stops, faults, clock jumps and new
settings.

Every goal gets one verdict, and every accepted goal one execution report. A plan that comes too
late is made again with a longer commit horizon as long as its goal is the newest. A plan from rest
is only stamped anew.

A command is a joint trajectory with its mode schedule. From its stamp on it repeats the command
before. From its change on, one commit horizon later, it differs from that command. The time of
plans is the arm's clock less the delay by which speed scaling has slowed plans.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from mhsb_model.arm_reports import HandOverReason
from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import ModeArray
from mhsb_model.verdict import Outcome, Report, Verdict
from mhsb_planner.deadline import Deadline
from mhsb_planner.errors import DeadlineError
from mhsb_planner.online.arm_state import NO_PLAN, ArmState, StampedState
from mhsb_planner.online.commit_horizon import (
    LATE_PLAN_FACTOR,
    CommitHorizon,
    CommitHorizonEstimator,
)
from mhsb_planner.online.execution import EARLY_NS, Execution, ExecutionResult
from mhsb_planner.online.goal_reports import GoalReports
from mhsb_planner.online.goal_stream import GoalStream
from mhsb_planner.online.pending_goal import (
    Adjustment,
    PendingGoal,
    ignore_report,
    keep_settings,
    summarize_plan,
)
from mhsb_planner.online.plan_request import PlanRequest, UnconfirmedPlan
from mhsb_planner.online.planner_io import Clock, PlannerIO
from mhsb_planner.online.replanning import Replan
from mhsb_planner.online.settings import Settings
from mhsb_planner.online.stamp_order import Order, StampOrder
from mhsb_planner.online.start_state import (
    MovingError,
    NoStateError,
    OtherMachineError,
    find_start_command,
)
from mhsb_planner.online.stopping import (
    ARM_STOPPED,
    SETTLING_TIME,
    STOP_ASKED,
    ArmStopCaller,
    Stopping,
)
from mhsb_planner.online.verdicts import compose_acceptance_sentence, find_verdict_code
from mhsb_planner.online.zone_ahead import (
    describe_missing_braking,
    describe_waiting,
    find_obstacle_ahead,
    make_braking_for_obstacle,
)
from mhsb_planner.search import goal_clearance

FIRST_REPORT = 1.2
"""Time after the arm's first state within which it reports its machine [s]; it reports every
second."""

LONGEST_WAIT = 2.0
"""Longest time for which a goal waits for a state, a receiver of plans, or an arm at rest [s]."""

START_UP = 6.0
"""Time after the planner's start during which goals wait for the arm's first state [s].

On a busy machine the discovery of a running arm takes seconds.
"""

CONFIRMATION_TIMEOUT = 0.1
"""Time after a plan's change after which an unconfirmed plan counts as not taken [s]."""

AHEAD_NS = SECOND_NS // 10
"""Largest time by which the last sent stamp may be ahead of the time of plans [ns]."""

REFERENCE_TIMEOUT = 0.1
"""Silence of the arm above which its execution is not judged, as it may have stopped moving [s]."""

MAX_LATE_PLANS = 3
"""Number of plans that fail at the longest commit horizon before a goal is refused."""

SENT_COMMAND_CAPACITY = 16
"""Number of last sent commands that are kept, since the arm may still confirm any of them."""

LATE_SHARE = 0.5
"""Largest share of its commit horizon that a braking for an obstacle may take to compute.

Beyond it the braking is made again with a longer horizon. A larger share lets more of them come too
late.
"""

OLD_STOP = 1.0
"""Largest delay of the arm's clock, as known from its messages, when it reports a stop [s]."""
LATE_REPORT = 0.1
"""Delay of a stop's report beyond which the planner did not run when it was sent [s].

A report takes some milliseconds, also if the planner is busy: the middleware receives it then. A
process that was suspended receives everything at once when it goes on, in any order.
"""


class GoalLifecycle:
    """State machine of goals, from their arrival to their execution report.

    Goals and the arm's messages come in as events; plan requests, commands and reports go out.
    Every public method handles one event, and none of them takes long.

    Attributes:
        arm_state: Arm state.
        horizon_estimator: Estimator of the commit horizon.
    """

    def __init__(
        self,
        settings: Settings,
        brake: Callable[[Command, int, float], tuple[Command, int]],
        clock: Clock,
        outbox: PlannerIO,
    ) -> None:
        """Begin without a goal and without knowledge of the arm.

        Args:
            settings: Settings for goals that have none of their own.
            brake: Makes a braking command from the command in force, the present time of plans [ns]
                and the commit horizon [s]. It returns that command and the time at which it leaves
                the one in force [ns].
            clock: Steady clock and ROS clock.
            outbox: Carries out what the lifecycle asks for: plan, send, report.
        """
        self.arm_state = ArmState(settings.machine.joint_count)
        self.horizon_estimator = CommitHorizonEstimator()
        self._stream = GoalStream()
        self._settings = settings
        self._brake = brake
        self._clock = clock
        self._outbox = outbox
        self._reports = GoalReports(clock, outbox)
        self._started_at = clock.steady_time()
        self._epoch = 0
        self._waiting: PendingGoal | None = None
        self._request: PlanRequest | None = None
        self._unconfirmed: UnconfirmedPlan | None = None
        self._execution: Execution | None = None
        self._stopping: Stopping | None = None
        self._last_obstacle_sentence = ""
        self._sent_commands: dict[int, UnconfirmedPlan] = {}
        self._last_stamp_ns = 0
        self._arm_stops = ArmStopCaller(clock, outbox)
        self._stamp_order = StampOrder(outbox.describe_publisher_conflict)
        self._void_until = -math.inf
        self._arm_stop_called = False

    @property
    def unconfirmed_command(self) -> Command | None:
        """Command that has been sent and not confirmed; None if there is none."""
        return None if self._unconfirmed is None else self._unconfirmed.command

    @property
    def execution(self) -> Execution | None:
        """Execution of the plan that the arm has confirmed; None once it has ended."""
        return self._execution

    @property
    def is_stopping(self) -> bool:
        """True while the arm is being brought to rest."""
        return self._stopping is not None

    @property
    def is_idle(self) -> bool:
        """True if every goal has ended, no command is unconfirmed and no stop is under way."""
        return not (
            self._waiting or self._request or self._unconfirmed or self._execution or self._stopping
        )

    # --- Goals -----------------------------------------------------------------------------------

    def add_goal(
        self,
        goal: Goal,
        received_at: float | None = None,
        adjust_settings: Adjustment = keep_settings,
        on_report: Callable[[Report], None] = ignore_report,
    ) -> PendingGoal:
        """Accept a goal for planning or refuse it, and begin to plan if nothing is in the way.

        The goal is refused at once if the arm reports a fault or another machine file, or if its
        place is out of reach. It ends as stopped if it came before the last stop of the arm.
        Otherwise it becomes the waiting goal, and `_start_planning` decides whether planning
        begins. A goal that waited before ends as superseded, unless the arm is executing a plan for
        it.

        Args:
            goal: Where the tip shall go.
            received_at: Time of receipt by the steady clock [s]; None means now.
            adjust_settings: Derives this goal's settings from the settings for all goals.
            on_report: Called with each report on this goal, in addition to the outbox.

        Returns:
            The goal's record, also if it was refused.
        """
        wall = self._clock.steady_time()
        came = wall if received_at is None else received_at
        in_hand = PendingGoal(
            goal, came, wall, adjust_settings=adjust_settings, on_report=on_report
        )
        if self.arm_state.fault:
            self._reports.refuse(in_hand, Verdict.FAULT, self.arm_state.fault)
            return in_hand
        if self.arm_state.machine_difference:
            self._reports.refuse(in_hand, Verdict.MACHINE, self.arm_state.machine_difference)
            return in_hand
        if in_hand.received_at <= self._void_until:
            self._reports.end_by_stop(in_hand, ARM_STOPPED)
            return in_hand
        try:
            self._check_place(in_hand)
        except MhsbError as error:
            self._reports.refuse(in_hand, find_verdict_code(error), str(error))
            return in_hand
        self._stream.add_goal(goal, in_hand.received_at)
        if self._waiting is not None and not self._is_being_executed(self._waiting):
            self._reports.supersede(self._waiting)
        self._waiting = in_hand
        self._arm_stop_called = False
        self._start_planning()
        return in_hand

    def build_trial_request(
        self, goal: Goal, adjust_settings: Adjustment, horizon_factor: float = 1.0
    ) -> PlanRequest:
        """Build the request for a plan that shall not be executed.

        The request equals that for a goal that comes now and stands still. Nothing changes in the
        lifecycle.

        Args:
            goal: Where the tip would go.
            adjust_settings: Derives this goal's settings from the settings for all goals.
            horizon_factor: Factor on the commit horizon.

        Returns:
            Request for the planning worker.

        Raises:
            MhsbError: The goal is out of reach, or no plan can start from the arm's state.
        """
        wall, now_ns = self._clock.steady_time(), self._now_ns()
        in_hand = PendingGoal(
            goal,
            wall,
            wall,
            horizon_factor=horizon_factor,
            needs_exact_place=True,
            adjust_settings=adjust_settings,
        )
        self._check_place(in_hand)
        start = find_start_command(self.arm_state, wall, now_ns)
        return self._build_request(in_hand, start, wall, now_ns)

    def _check_place(self, pending_goal: PendingGoal) -> None:
        """Raise an MhsbError if the tip can never be at the goal.

        That is the case if the goal lies outside the workspace, or too near to an obstacle.

        Args:
            pending_goal: The goal, whose own settings are computed if they are not known yet.
        """
        machine, goal = pending_goal.get_settings(self._settings).machine, pending_goal.goal
        machine.check_in_workspace(goal.position)
        goal_clearance.check_tip_clearance(machine, goal.position)

    def tick(self) -> None:
        """Handle the passing of time; to be called periodically.

        In this order: an unconfirmed plan that is overdue is given up. A moving goal that has
        stopped waits for a plan to its exact place. The execution is judged. If the newest goal was
        cancelled, a stop begins. A stop under way takes its next step. Planning for a waiting goal
        begins.
        """
        sent = self._unconfirmed
        if sent is not None and self._is_overdue(sent):
            self._handle_refused_command(
                sent, HandOverReason.LATE, "the arm did not take the plan in time"
            )
        self._plan_to_stopped_goal()
        self._judge_execution()
        self._stop_for_cancelled_goal()
        self._continue_stop()
        self._start_planning()

    def _start_planning(self) -> None:
        """Begin to plan for the waiting goal, if nothing is in the way.

        Nothing happens while a plan is made or unconfirmed, or while the arm is being stopped. The
        goal waits at most `LONGEST_WAIT` for these:

        - the arm receives plans,
        - it has reported its plan in force, if it sends a reference,
        - it has reported its machine, or its first state is `FIRST_REPORT` ago,
        - the time of plans has come within `AHEAD_NS` of the last stamp sent.

        After `LONGEST_WAIT`, planning goes on without these conditions. The goal also waits that
        long for a known state of the arm, or for the end of a motion that is not this planner's. It
        is then refused, but not during `START_UP` after the planner's start if no state has come.
        If the arm moves under a foreign command, its own ~/stop is called once for each goal. If
        the arm has another machine file, the goal is refused at once.

        If the plan in force leads to the goal already, the goal takes that plan over. Otherwise a
        plan is requested.
        """
        in_hand, wall = self._waiting, self._clock.steady_time()
        if in_hand is None or self._request or self._unconfirmed or self._stopping:
            return
        # An arm that sends a reference also reports its plan in force, perhaps a moment later.
        half_heard = (
            self.arm_state.reference is not None and self.arm_state.plan_in_force_ns is None
        )
        unknown = (
            not self.arm_state.is_machine_known
            and wall - self.arm_state.first_state_at < FIRST_REPORT
        )
        reachable = self._outbox.is_arm_connected() and not half_heard and not unknown
        if not reachable and wall - in_hand.waiting_since < LONGEST_WAIT:
            return
        now_ns = self._now_ns()
        ahead = self._last_stamp_ns > now_ns + AHEAD_NS  # stamps must increase
        if ahead and wall - in_hand.waiting_since < LONGEST_WAIT:
            return
        if not self.arm_state.is_machine_known and self.arm_state.first_state_at < math.inf:
            self.handle_arm_machine(None)
        try:
            start = find_start_command(self.arm_state, wall, now_ns)
        except OtherMachineError as error:
            self._waiting = None
            self._reports.refuse(in_hand, Verdict.MACHINE, str(error))
            return
        except (NoStateError, MovingError) as error:
            foreign = self.arm_state.plan_in_force_ns != NO_PLAN
            if isinstance(error, MovingError) and foreign and not self._arm_stop_called:
                self._arm_stop_called = True
                self._arm_stops.call(lambda success, sentence: None)
            starts = (
                self.arm_state.first_state_at == math.inf and wall - self._started_at < START_UP
            )
            if wall - in_hand.waiting_since >= LONGEST_WAIT and not starts:
                self._waiting = None
                self._reports.refuse(in_hand, find_verdict_code(error), str(error))
            return
        self._waiting = None
        if not self._take_over_plan_in_force(in_hand, now_ns):
            self._request = self._build_request(in_hand, start, wall, now_ns)
            self._outbox.start_planning(self._request)

    def _build_request(
        self, pending_goal: PendingGoal, start: Command, steady_time: float, now_ns: int
    ) -> PlanRequest:
        """Build the request for a plan to a goal.

        The arm is at rest if the trajectory of `start` has ended at `now_ns`. The commit horizon
        then covers only transport and confirmation, because the plan is stamped when it is ready.
        The deadline is `steady_time` plus the whole commit horizon, less the part that is reserved
        for transport. The target of a moving goal is extrapolated.

        Args:
            pending_goal: The goal.
            start: Command that the plan continues.
            steady_time: Present time by the steady clock [s].
            now_ns: Present time of plans [ns].

        Returns:
            Request with epoch, target, settings, commit horizon by the arm's clock [s], and
            deadline by the steady clock.
        """
        lead = self._get_commit_horizon(pending_goal)
        at_rest = start.trajectory.end_ns <= now_ns
        target, period = self._choose_target(pending_goal, steady_time, lead.total)
        return PlanRequest(
            self._epoch,
            pending_goal,
            target,
            period,
            pending_goal.get_settings(self._settings),
            start,
            self.arm_state.plan_in_force_ns,
            max(now_ns, self._last_stamp_ns + 1),
            self._convert_to_arm_time(self._get_horizon_from_rest(lead) if at_rest else lead.total),
            steady_time,
            Deadline(steady_time + lead.total - lead.transport_reserve),
            self._find_plan_of_command(start, pending_goal.get_settings(self._settings)),
        )

    def _find_plan_of_command(self, command: Command, settings: Settings) -> Replan | None:
        """Return the plan from which a command was made, if it was made under these settings.

        Args:
            command: Command that a new plan shall continue.
            settings: Settings of the new plan; they must be the same object.

        Returns:
            None if this planner did not send the command, if it only brakes, or if the settings
            differ.
        """
        sent = self._sent_commands.get(command.stamp_ns)
        if sent is None or sent.command is not command or sent.request is None:
            return None
        return sent.replan if sent.request.settings is settings else None

    def _choose_target(
        self, pending_goal: PendingGoal, steady_time: float, commit_horizon: float
    ) -> tuple[Goal, float]:
        """Choose the target of a plan for a goal, and return it with the goal's period.

        A moving goal is extrapolated by the commit horizon plus one period. A goal that has
        stopped, or whose `needs_exact_place` is set, is planned for at its exact place. It keeps
        its period. The arm then goes there as it followed the goal: a free plan may choose another
        posture and swing the tip far beyond.

        Args:
            pending_goal: The goal.
            steady_time: Present time by the steady clock [s].
            commit_horizon: Commit horizon [s].

        Returns:
            Target, and period of the goal: median time from one of its messages to the next [s].
            The period is 0 if the last messages give no velocity.
        """
        stream, goal = self._stream, pending_goal.goal
        if not any(stream.velocity):
            return goal, 0.0
        if pending_goal.needs_exact_place or not stream.is_moving(steady_time):
            return goal, stream.period
        return stream.extrapolate(goal, commit_horizon + stream.period), stream.period

    def _plan_to_stopped_goal(self) -> None:
        """Let a moving goal that has stopped wait for a plan to its exact place.

        It becomes the waiting goal with `needs_exact_place` set, because the plan in force ends a
        little beyond its place. Nothing happens while the goal moves, while another plan is made or
        unconfirmed, or while the arm is being stopped.
        """
        execution = self._execution
        if execution is None or self._stopping or self._goals_before_confirmation():
            return
        in_hand, wall = execution.pending_goal, self._clock.steady_time()
        if execution.target.is_at_same_position(in_hand.goal) or self._stream.is_moving(wall):
            return
        in_hand.needs_exact_place, in_hand.waiting_since = True, wall
        self._waiting = in_hand

    def _accept_plan_end(self) -> None:
        """Declare the goal's own place the target of the plan in force.

        The plan ends a little beyond that place. With this, no further plan is made to the exact
        place.
        """
        if self._execution is not None:
            self._execution = replace(self._execution, target=self._execution.pending_goal.goal)

    def _is_being_executed(self, pending_goal: PendingGoal) -> bool:
        """Return whether the arm executes a plan for this very goal."""
        return self._execution is not None and self._execution.pending_goal is pending_goal

    def _get_commit_horizon(self, pending_goal: PendingGoal) -> CommitHorizon:
        """Return the commit horizon for a goal; earlier plans that came too late make it longer."""
        settings = self._settings
        return self.horizon_estimator.choose_horizon(
            settings.lead_min,
            settings.lead_max,
            settings.planning_budget,
            pending_goal.horizon_factor,
        )

    def _get_horizon_from_rest(self, commit_horizon: CommitHorizon) -> float:
        """Return the commit horizon of a plan from rest [s].

        Such a plan is stamped when it has been made, so only transport and confirmation lie ahead.
        """
        return max(commit_horizon.transport_reserve, self._settings.lead_min)

    def _convert_to_arm_time(self, seconds: float) -> float:
        """Convert a real duration to the arm's clock [s].

        An arm's clock that is slower than real time counts as real time.
        """
        return seconds * max(1.0, self.arm_state.clock_estimator.speed)

    def _take_over_plan_in_force(self, pending_goal: PendingGoal, now_ns: int) -> bool:
        """Let a goal take over the plan in force if that plan leads to it already.

        This needs an executed plan of this planner whose target is within 0.1 mm of the goal, the
        same settings, and a goal that does not move. The earlier goal then ends as replaced. The
        new goal gets the verdict `OK` with `continued` set. If it is the very goal being executed,
        nothing changes and nothing is reported.

        Args:
            pending_goal: The goal.
            now_ns: Present time of plans [ns]; the plan must not have ended yet.

        Returns:
            True if the goal needs no plan of its own, also if it is the very goal being executed.
        """
        execution, goal = self._execution, pending_goal.goal
        if execution is None or not self.arm_state.executes_own(now_ns):
            return False
        if (
            not goal.is_at_same_position(execution.target)
            or execution.command is not self.arm_state.own_command
        ):
            return False
        settings = pending_goal.get_settings(self._settings)
        if execution.settings is not settings or self._stream.is_moving(self._clock.steady_time()):
            return False
        if execution.pending_goal is pending_goal:
            return True
        self._reports.report_end(
            execution.pending_goal, Outcome.REPLACED, "the same goal came again and goes on"
        )
        pending_goal.plan_stamp_ns = execution.command.stamp_ns
        elapsed = 1e3 * (self._clock.steady_time() - pending_goal.received_at)
        plan = replace(execution.plan, plan_ms=elapsed, lead_ms=elapsed, continued=True)
        self._reports.accept(pending_goal, Verdict.OK, "the arm is on its way there already", plan)
        execution.pending_goal = pending_goal
        return True

    # --- Plans -----------------------------------------------------------------------------------

    def handle_plan_answer(self, request: PlanRequest, answer: Replan | Exception | None) -> None:
        """Handle the answer to a plan request: send the plan, plan anew, or end the goal.

        Nothing happens if the request has been withdrawn or replaced since. If the epoch or the
        plan in force has changed since the request, the goal is planned anew. A plan is sent; None
        ends the goal as reached. After a missed deadline the goal is planned again with a longer
        commit horizon. It is refused after MAX_LATE_PLANS tries at the longest horizon. After a
        plan or a missed deadline, `horizon_estimator` gets the time that planning took.

        Any other MhsbError has three cases. If the arm executes a plan for this very goal, that
        plan stays. If the target was extrapolated from a moving goal, the goal's own place becomes
        the target. Otherwise the goal is refused. Other exceptions refuse it with `INTERNAL`.
        Finally planning begins if a goal waits.

        Args:
            request: The request that was answered.
            answer: The plan, the error that planning raised, or None if the arm is at the goal
                already.
        """
        if request is not self._request:
            return
        self._request = None
        in_hand, wall = request.pending_goal, self._clock.steady_time()
        if request.epoch != self._epoch or not self._is_start_still_valid(request):
            self._plan_again(in_hand)
        elif isinstance(answer, DeadlineError):
            self.horizon_estimator.add_first_motion(
                LATE_PLAN_FACTOR * (wall - request.requested_at)
            )
            sentence = f"{answer}{self._settings.lost_pumps_clause}"
            self._handle_late_plan(request, Verdict.NOT_FOUND, sentence)
        elif isinstance(answer, MhsbError) and self._is_being_executed(in_hand):
            self._accept_plan_end()
        elif isinstance(answer, MhsbError) and request.target is not in_hand.goal:
            in_hand.needs_exact_place = True
            self._plan_again(in_hand)
        elif isinstance(answer, MhsbError):
            code = find_verdict_code(answer)
            why = self._settings.lost_pumps_clause if code is Verdict.INFEASIBLE else ""
            self._reports.refuse(in_hand, code, f"{answer}{why}")
        elif isinstance(answer, Exception):
            kind = type(answer).__name__
            self._reports.refuse(in_hand, Verdict.INTERNAL, f"planning failed with {kind}")
        elif answer is None:
            self._reports.report_at_goal(in_hand)
        else:
            self.horizon_estimator.add_first_motion(
                wall - request.requested_at - answer.improvement_time
            )
            self._send_plan(request, answer, wall)
        self._start_planning()

    def _is_start_still_valid(self, request: PlanRequest) -> bool:
        """Return whether the arm is still under the command that a plan continues.

        Args:
            request: Request of the plan.

        Returns:
            True if the plan in force is the one at the time of the request. Also True if that was
            `start_command`, its end is at most `EARLY_NS` ahead or past, and the arm holds.
        """
        if self.arm_state.plan_in_force_ns == request.in_force_ns:
            return True
        ended = self._now_ns() >= request.start_command.trajectory.end_ns - EARLY_NS
        return (
            ended
            and self.arm_state.plan_in_force_ns == NO_PLAN
            and request.in_force_ns == request.start_command.stamp_ns
        )

    def _send_plan(self, request: PlanRequest, replan: Replan, steady_time: float) -> None:
        """Send a plan, and give its goal a verdict if it has none.

        A plan from rest first gets the present time as its stamp; if the old command still moves
        then, the goal is planned anew. A plan whose change has passed is not sent but counts as too
        late. Otherwise `attempts`, `plan_stamp_ns` and `lead_ms` of the goal are updated.

        Args:
            request: Request of the plan.
            replan: The plan.
            steady_time: Present time by the steady clock [s].
        """
        now_ns, in_hand = self._now_ns(), request.pending_goal
        if replan.starts_from_rest:
            stamp_ns = max(now_ns, self._last_stamp_ns + 1)
            if not replan.may_begin_at(stamp_ns):  # the clock is behind: the arm moves
                self._plan_again(in_hand)
                return
            lead = self._convert_to_arm_time(
                self._get_horizon_from_rest(self._get_commit_horizon(in_hand))
            )
            replan = replan.with_stamp(stamp_ns, lead)
        if now_ns >= replan.change_ns:
            late = (now_ns - replan.change_ns) / SECOND_NS
            self._handle_late_plan(
                request, Verdict.DEADLINE, f"the plan was ready {late:.3f} s after its change"
            )
            return
        in_hand.attempts += 1
        in_hand.plan_stamp_ns = replan.command.stamp_ns
        elapsed = 1e3 * (steady_time - in_hand.received_at)
        ahead = 1e3 * (replan.change_ns - now_ns) / SECOND_NS
        in_hand.lead_ms = elapsed + ahead / self._convert_to_arm_time(1.0)
        planned = min(steady_time, request.deadline.instant)
        sent = UnconfirmedPlan(
            replan.command, replan.change_ns, planned, steady_time, replan, request
        )
        self._send(sent)
        if not in_hand.has_verdict:
            plan = summarize_plan(replan, elapsed, in_hand.lead_ms)
            self._reports.accept(
                in_hand, Verdict.OK, compose_acceptance_sentence(replan, in_hand.goal), plan
            )

    def _send(self, sent: UnconfirmedPlan) -> None:
        """Send a command, and keep it as unconfirmed.

        The last `SENT_COMMAND_CAPACITY` commands are remembered by stamp. If the arm never reports
        its plan in force, the command counts as confirmed at once.

        Args:
            sent: The command, with the times of its planning and sending and the request for it.
        """
        self._outbox.send(sent.command)
        self._last_stamp_ns = sent.command.stamp_ns
        self._sent_commands[sent.command.stamp_ns] = sent
        while len(self._sent_commands) > SENT_COMMAND_CAPACITY:
            self._sent_commands.pop(next(iter(self._sent_commands)))
        self._unconfirmed = sent
        if self.arm_state.plan_in_force_ns is None:  # the arm reports no plans
            self._handle_confirmation(sent)

    def _handle_late_plan(
        self, request: PlanRequest, code: Verdict, sentence: str, replan: Replan | None = None
    ) -> None:
        """Plan again with a longer commit horizon, or refuse the goal after too many tries.

        The goal's factor on the horizon grows by `LATE_PLAN_FACTOR`. After `MAX_LATE_PLANS`
        failures at the longest horizon the goal is refused, or aborted if it was accepted.

        Args:
            request: Request of the plan that was too late.
            code: Verdict of a refusal; an accepted goal is aborted with `DEADLINE` instead.
            sentence: What went wrong; begins the sentence of the refusal.
            replan: Plan from rest that is only stamped anew and sent again; None to plan anew.
        """
        in_hand = request.pending_goal
        in_hand.late_plans_at_longest_horizon += self._get_commit_horizon(in_hand).is_longest
        in_hand.horizon_factor *= LATE_PLAN_FACTOR
        if in_hand.late_plans_at_longest_horizon >= MAX_LATE_PLANS:
            if in_hand.has_verdict:
                code = Verdict.DEADLINE
            spent = self._clock.steady_time() - in_hand.received_at
            tries = f"{MAX_LATE_PLANS} tries at the longest lead, {spent:.1f} s in all"
            self._reports.refuse(in_hand, code, f"{sentence}, in {tries}")
        elif replan is not None:
            self._send_plan(request, replan, self._clock.steady_time())
        else:
            self._plan_again(in_hand)

    def _plan_again(self, pending_goal: PendingGoal) -> None:
        """Let a goal wait for a new plan, or end it as superseded if a newer goal waits.

        Args:
            pending_goal: The goal; nothing happens if it has ended.
        """
        if pending_goal.has_ended:
            return
        if self._waiting is not None:
            self._reports.supersede(pending_goal)
            return
        pending_goal.waiting_since = self._clock.steady_time()
        self._waiting = pending_goal

    # --- Messages of the arm ---------------------------------------------------------------------

    def handle_reference(self, state: MotionState, stamp_ns: int) -> None:
        """Store the reference that the servo follows, and begin to plan if a goal waits.

        The order of stamps shows whether several publishers send references; a change of this is
        logged. A reference is ignored if its stamp is behind and may come from another publisher.
        If the clock was set back, what is known of the arm is dropped as in `handle_clock_jump`. If
        no joint state has come yet, the reference also serves to detect rest.

        Args:
            state: Position, velocity and acceleration of all joints.
            stamp_ns: Stamp by the arm's clock [ns].
        """
        wall = self._clock.steady_time()
        order = self._stamp_order.add_stamp(stamp_ns, wall)
        if self._stamp_order.publisher_conflict != self.arm_state.publisher_conflict:
            self.arm_state.publisher_conflict = self._stamp_order.publisher_conflict
            self._outbox.warn(
                self.arm_state.publisher_conflict or "the arm's topics have one publisher again"
            )
        if order is Order.MIXED:
            return
        if order is Order.BACK:
            self.handle_clock_jump("the arm's clock went back")
        self.arm_state.clock_estimator.add_stamp(stamp_ns, wall)
        self.arm_state.reference = StampedState(state, stamp_ns, wall)
        self.arm_state.first_state_at = min(self.arm_state.first_state_at, wall)
        if self.arm_state.measured is None:
            self.arm_state.rest_detector.add_measurement(state, wall)
        self._start_planning()

    def handle_joint_state(self, state: MotionState, stamp_ns: int) -> None:
        """Store the measured state of the joints, also for the detection of rest.

        Args:
            state: Measured position and velocity of all joints; its acceleration is 0.
            stamp_ns: Stamp by the arm's clock [ns].
        """
        wall = self._clock.steady_time()
        self.arm_state.measured = StampedState(state, stamp_ns, wall)
        self.arm_state.first_state_at = min(self.arm_state.first_state_at, wall)
        self.arm_state.rest_detector.add_measurement(state, wall)

    def handle_modes(self, modes: ModeArray) -> None:
        """Store the mode that each actuator has in force, uint8[n]."""
        self.arm_state.modes = modes

    def handle_plan_in_force(self, stamp_ns: int) -> None:
        """Store which plan the arm has in force, and act on it.

        If it is a command of this planner that was not confirmed before, it is confirmed. Three
        steps follow for any stamp, also a foreign one. The execution ends if the arm's reports say
        so. A stop under way takes its next step. Planning begins if a goal waits.

        Args:
            stamp_ns: Stamp of the plan [ns], `NO_PLAN` while the arm holds.
        """
        self.arm_state.plan_in_force_ns = stamp_ns
        sent = self._sent_commands.get(stamp_ns)
        if sent is not None and sent.command is not self.arm_state.own_command:
            self._handle_confirmation(sent)
        self._judge_execution()
        self._continue_stop()
        self._start_planning()

    def handle_plan_refusal(self, stamp_ns: int, reason: HandOverReason, sentence: str) -> None:
        """Handle the arm's report that it has not taken a plan.

        If that plan is the unconfirmed one, it is given up as `_handle_refused_command` says, and
        planning begins if a goal waits. A report on any other plan is ignored.

        Args:
            stamp_ns: Stamp of the plan [ns].
            reason: Reason code.
            sentence: The reason in words.
        """
        sent = self._unconfirmed
        if sent is not None and sent.command.stamp_ns == stamp_ns:
            self._handle_refused_command(sent, reason, sentence)
            self._start_planning()

    def handle_arm_fault(self, sentence: str) -> None:
        """Store the fault that the arm reports; a new fault ends all goals.

        Goals without a verdict are refused with `FAULT`, accepted ones are aborted. An unconfirmed
        plan becomes void: if the arm takes it, the arm is stopped. A stop under way goes on.

        Args:
            sentence: The fault in words; empty if the arm is healthy.
        """
        if sentence == self.arm_state.fault:
            return
        self.arm_state.fault = sentence
        if not sentence:
            return
        self._epoch += 1
        for in_hand in self._goals_before_confirmation():
            self._reports.refuse(in_hand, Verdict.FAULT, sentence)
        self._waiting = self._request = None
        if self._unconfirmed is not None:
            self._unconfirmed.is_void = True
        if self._execution is not None:
            self._reports.report_end(
                self._execution.pending_goal, Outcome.ABORTED, sentence, Verdict.FAULT
            )
            self._execution = None
        self._continue_stop()

    def handle_arm_machine(self, difference: str | None) -> None:
        """Store how the arm's machine file differs from the planner's.

        A difference is logged when it appears or changes.

        Args:
            difference: One sentence; empty if the files agree. None if the arm does not report its
                machine: that counts as agreement and is logged the first time.
        """
        if difference is None and not self.arm_state.is_machine_known:
            self._outbox.warn(
                "the arm does not report its machine: whether it is this one is unknown"
            )
        if difference and difference != self.arm_state.machine_difference:
            self._outbox.warn(difference)
        self.arm_state.machine_difference, self.arm_state.is_machine_known = difference or "", True

    def handle_plan_delay(self, delay_ns: int) -> None:
        """Store the time by which the arm follows plans later than stamped [ns]."""
        self.arm_state.plan_delay_ns = delay_ns

    def handle_arm_stop(self, stop_ns: int, received_at: float | None = None) -> None:
        """Handle the arm's report of its last stop, and end the goals that had come until then.

        A stop that was reported before, or that this planner has called for, is ignored. Otherwise
        every goal ends as stopped that was received before the report, and at most `OLD_STOP` after
        the stop. If the planner did not run when the report was sent, the present time counts as
        its receipt. If the arm still executes a plan for a goal that ends, the arm is stopped.

        Args:
            stop_ns: Time of the stop by the arm's clock [ns]; 0 means never.
            received_at: Time of receipt of the report by the steady clock [s]; None means now.
        """
        if not self._arm_stops.is_stop_by_others(stop_ns):
            return
        wall = self._clock.steady_time()
        ago = (
            (self._now_ns() + self.arm_state.plan_delay_ns - stop_ns)
            / SECOND_NS
            / self._convert_to_arm_time(1.0)
        )
        heard = wall if received_at is None else received_at
        if ago - (wall - heard) > LATE_REPORT:
            heard = wall + LATE_REPORT
        self._void_until = min(heard, wall - ago + OLD_STOP)
        for in_hand in self._goals_before_confirmation():
            if in_hand.received_at <= self._void_until:
                self._reports.end_by_stop(in_hand, ARM_STOPPED)
        execution = self._execution
        if execution is not None and execution.pending_goal.received_at <= self._void_until:
            if self.arm_state.executes_own(self._now_ns()):  # it took the plan after the stop
                self._stopping = self._stopping or Stopping(ARM_STOPPED, wall)
            else:
                self._execution = None
                self._reports.report_end(execution.pending_goal, Outcome.STOPPED, ARM_STOPPED)
        if self._waiting is not None and self._waiting.has_ended:
            self._waiting = None
        if self._request is not None and self._request.pending_goal.has_ended:
            self._request = None
        sent = self._unconfirmed
        if sent is not None and sent.request is not None and sent.request.pending_goal.has_ended:
            sent.is_void = True
        self._continue_stop()

    def handle_clock_jump(self, sentence: str) -> None:
        """Drop what is known of the arm after a clock jump, and plan unconfirmed goals anew.

        The execution ends as aborted. A plan that is being made becomes void, and its goal is
        planned anew.

        Args:
            sentence: What has happened to the clock; logged and reported.
        """
        self._outbox.warn(f"{sentence}: what was known of the arm is forgotten")
        self._epoch += 1
        self.arm_state.forget()
        sent, self._unconfirmed = self._unconfirmed, None
        self._sent_commands.clear()
        self._last_stamp_ns = 0
        if self._execution is not None:
            self._reports.report_end(self._execution.pending_goal, Outcome.ABORTED, sentence)
            self._execution = None
        if sent is not None and sent.request is not None:
            self._plan_again(sent.request.pending_goal)

    def _handle_confirmation(self, sent: UnconfirmedPlan) -> None:
        """Store that the arm follows a command, also one that had been given up.

        If the arm reports its plan in force, the time since planning is added to the estimate of
        the transport time. A confirmed braking command usually finishes the stop. After a plan, the
        goal executed before ends as replaced, and the execution of the new plan begins. If that
        plan is void by then, the arm is stopped. If settings have changed since the plan's request
        and an obstacle lies ahead, the arm stops first, and the goal is planned for again.

        Args:
            sent: The command that the arm has confirmed.
        """
        wall = self._clock.steady_time()
        if self._unconfirmed is sent:
            self._unconfirmed = None
        self.arm_state.own_command = sent.command
        if self.arm_state.plan_in_force_ns is not None:
            self.horizon_estimator.add_transport_time(wall - sent.planned_at)
        if sent.request is None or sent.replan is None:  # a braking command
            if sent.obstacle_sentence:
                self._report_obstacle(sent.obstacle_sentence)
            self._handle_confirmed_braking(sent.command)
            if sent.braking_machine is not self._settings.machine:
                self._stop_for_obstacle_ahead()
            return
        in_hand = sent.request.pending_goal
        self._withdraw_further_plans(in_hand)
        if self._execution is not None and self._execution.pending_goal is not in_hand:
            self._reports.report_end(
                self._execution.pending_goal, Outcome.REPLACED, "a later plan took over"
            )
        self._execution = None
        if not in_hand.has_ended:
            plan = summarize_plan(sent.replan, 0.0, in_hand.lead_ms)
            self._execution = Execution(
                in_hand,
                sent.command,
                sent.request.target,
                plan,
                sent.request.settings,
                sent.change_ns,
            )
        if sent.is_void:
            self._stopping = self._stopping or Stopping(STOP_ASKED, wall)
            self._continue_stop()
        elif sent.request.settings is not in_hand.get_settings(self._settings):
            self._stop_for_obstacle_ahead(goal_after_stop=in_hand)

    def _withdraw_further_plans(self, pending_goal: PendingGoal) -> None:
        """Withdraw a further plan for a goal, since one is in force.

        Args:
            pending_goal: The goal. It no longer waits, and an answer for it is ignored.
        """
        if self._waiting is pending_goal:
            self._waiting = None
        if self._request is not None and self._request.pending_goal is pending_goal:
            self._request = None

    def _is_overdue(self, sent: UnconfirmedPlan) -> bool:
        """Return whether an unconfirmed command counts as not taken.

        Args:
            sent: The unconfirmed command.

        Returns:
            True from `LONGEST_WAIT` after sending on. Earlier, True if `CONFIRMATION_TIMEOUT` has
            passed both since sending, in real time, and since the change, in the time of plans.
        """
        wall = self._clock.steady_time()
        if wall - sent.sent_at > LONGEST_WAIT:  # even if the arm's clock stands still
            return True
        grace = CONFIRMATION_TIMEOUT * max(1.0, self.arm_state.clock_estimator.speed)
        late = (self._now_ns() - sent.change_ns) / SECOND_NS
        return late > grace and wall - sent.sent_at > CONFIRMATION_TIMEOUT

    def _handle_refused_command(
        self, sent: UnconfirmedPlan, reason: HandOverReason, sentence: str
    ) -> None:
        """Handle that the arm has not taken a command and goes on with the one before.

        A late command lengthens the estimated transport time. A refused stamp resets the estimate
        of the arm's clock. After a braking or void command the stop goes on. After a plan, the
        reason decides: the goal is refused on a fault or an invalid plan, and ended by a stop. For
        any other reason, it ends as superseded if a newer goal waits. Otherwise it is planned again
        with a longer horizon. A plan from rest is only stamped anew if the arm still stands at the
        plan's start.

        Args:
            sent: The unconfirmed command.
            reason: Reason code; `LATE` also if the arm gave no answer in time.
            sentence: The reason in words.
        """
        self._unconfirmed = None
        wall = self._clock.steady_time()
        request, replan = sent.request, sent.replan
        if reason == HandOverReason.LATE:
            self.horizon_estimator.add_transport_time(
                max(
                    wall - sent.planned_at, LATE_PLAN_FACTOR * self.horizon_estimator.transport_time
                )
            )
        elif reason == HandOverReason.STAMP:
            self.arm_state.clock_estimator.keep_last_stamp_only()
        if request is None or replan is None or sent.is_void:
            self._continue_stop()
            return
        in_hand = request.pending_goal
        if in_hand.has_ended:
            return
        if reason == HandOverReason.FAULT:
            self._reports.refuse(in_hand, Verdict.FAULT, sentence)
        elif reason == HandOverReason.INVALID:
            self._reports.refuse(in_hand, Verdict.INTERNAL, sentence)
        elif reason == HandOverReason.STOPPED:
            self._reports.end_by_stop(in_hand, sentence)
        elif self._waiting is not None:
            self._reports.supersede(in_hand)
        else:
            as_before = request.epoch == self._epoch and self._is_start_still_valid(request)
            elsewhere = reason in (HandOverReason.JUMP, HandOverReason.RESET)
            anew = replan.starts_from_rest and as_before and not elsewhere
            late = Verdict.DEADLINE
            self._handle_late_plan(request, late, sentence, replan if anew else None)

    # --- Stopping --------------------------------------------------------------------------------

    def stop(self, done: Callable[[bool, str], None]) -> None:
        """Bring the arm to rest, whatever has set it in motion, and end all goals.

        A stop that is under way goes on, and `done` joins it. Goals that wait or are being planned
        for end with `STOPPED` at once. An unconfirmed plan becomes void: if the arm takes it, it is
        stopped, and its goal ends with the stop.

        Args:
            done: Called once with success and sentence. Success means that the arm is measured at
                rest or has confirmed that it brakes; otherwise the sentence says why it may still
                move.
        """
        self._epoch += 1
        for in_hand in self._goals_before_sending():
            self._reports.end_by_stop(in_hand, STOP_ASKED)
        self._waiting = self._request = None
        self._accept_plan_end()
        stopping = self._stopping = self._stopping or Stopping(
            STOP_ASKED, self._clock.steady_time()
        )
        stopping.on_finished.append(done)
        sent = self._unconfirmed
        if sent is not None and sent.request is not None:
            sent.is_void = True
            stopping.goals.append(sent.request.pending_goal)
        if stopping.goal_after_stop is not None:
            stopping.goals.append(stopping.goal_after_stop)
            stopping.goal_after_stop = None
        self._continue_stop()

    def cancel(self, pending_goal: PendingGoal) -> None:
        """Cancel a goal: stop the arm, unless a newer goal has come.

        The goal's `is_cancelled` is set. If a newer goal has come and ends first, such as by a
        refusal, the arm is stopped then.

        Args:
            pending_goal: The goal.
        """
        pending_goal.is_cancelled = True
        self._stop_for_cancelled_goal()

    def _stop_for_cancelled_goal(self) -> None:
        """Stop the arm if the newest goal that has not ended was cancelled.

        Goals count that wait, are being planned for, are unconfirmed or in force. The stop is that
        of `stop`, which ends all goals. Nothing happens while a stop is under way. A newer goal
        keeps a cancelled one from stopping the arm at once (`cancel`). Once the newer goal has
        ended, the arm is stopped here.
        """
        newest = next(iter(self._goals_not_ended()), None)
        if newest is not None and newest.is_cancelled and self._stopping is None:
            self.stop(lambda success, sentence: None)

    def change_settings(self, settings: Settings) -> None:
        """Use other settings for all goals; a plan that is being made is made anew.

        After a change of zones, the arm is stopped if an obstacle lies across its motion.

        Args:
            settings: The new settings.
        """
        zones = settings.machine.zones != self._settings.machine.zones
        self._settings = settings
        self._epoch += 1
        if zones:
            self._stop_for_obstacle_ahead()

    def _stop_for_obstacle_ahead(self, goal_after_stop: PendingGoal | None = None) -> None:
        """Begin a stop if an obstacle lies across the rest of the motion in force.

        Nothing happens if the arm executes no command of this planner. A stop that is under way
        already goes on as one that brakes for the obstacle.

        Args:
            goal_after_stop: Goal to plan for once the arm has stopped, None for no goal.
        """
        own, now_ns = self.arm_state.own_command, self._now_ns()
        if own is None or not self.arm_state.executes_own(now_ns):
            return
        obstacle = find_obstacle_ahead(self._settings.machine, own, now_ns)
        if obstacle is None:
            return
        if self._stopping is None:
            self._stopping = Stopping(
                "", self._clock.steady_time(), goal_after_stop=goal_after_stop
            )
            self._last_obstacle_sentence = ""
        self._stopping.obstacle, self._stopping.obstacle_set_ns = obstacle, now_ns
        self._stopping.is_braking_confirmed = False  # one in force was not made for this obstacle
        self._continue_stop()
        if self._stopping is not None and not self._stopping.reason:
            self._report_obstacle(describe_waiting(obstacle))

    def _report_obstacle(self, sentence: str) -> None:
        """Make a sentence on an obstacle ahead the reason of the stop, and log it.

        A sentence that equals the last one is not logged again. A stop that was asked for by a user
        or at the arm keeps its own reason.

        Args:
            sentence: The sentence.
        """
        stopping = self._stopping
        if stopping is not None and stopping.reason not in (STOP_ASKED, ARM_STOPPED):
            stopping.reason = sentence
        if sentence != self._last_obstacle_sentence:
            self._last_obstacle_sentence = sentence
            self._outbox.warn(sentence)

    def _continue_stop(self) -> None:
        """Take the next step to rest: brake the own plan, or have the arm stop by itself.

        A braking command is sent if the arm executes a plan of this planner and no command is
        unconfirmed. Each further try has a longer commit horizon. Otherwise the arm's own ~/stop is
        called until it answers. Once the arm rests or cannot be brought to rest, the stop is
        finished.
        """
        stopping = self._stopping
        if stopping is None:
            return
        own, now_ns, wall = self.arm_state.own_command, self._now_ns(), self._clock.steady_time()
        if own is not None and stopping.may_brake(self.arm_state, now_ns, wall):
            if self._unconfirmed is None:
                stopping.tries += 1
                self._send_braking(own, now_ns, LATE_PLAN_FACTOR ** (stopping.tries - 1))
        elif not stopping.is_braking_confirmed:
            self._arm_stops.call_until_answered(stopping)
        result = stopping.get_result(self.arm_state, now_ns, wall)
        if result is not None and (self._unconfirmed is None or not result[0]):
            self._finish_stop(*result)

    def _send_braking(self, own: Command, now_ns: int, horizon_factor: float) -> None:
        """Send a command that brakes the own plan.

        It brakes along the plan's path, or for the obstacle ahead if the stop is due to one. It is
        unconfirmed until the arm reports it. Braking begins `horizon_factor` times the estimated
        transport time after the stamp, within `lead_min` … `lead_max`.

        Args:
            own: Command that the arm executes.
            now_ns: Present time of plans [ns].
            horizon_factor: Factor on the transport time, above 1 after a failed try.
        """
        shortest, longest = self._settings.lead_min, self._settings.lead_max
        lead = self._convert_to_arm_time(
            min(max(shortest, horizon_factor * self.horizon_estimator.transport_time), longest)
        )
        at_ns = max(now_ns, self._last_stamp_ns + 1)
        command, change_ns, sentence = self._make_braking_command(own, at_ns, lead)
        wall, machine = self._clock.steady_time(), self._settings.machine
        self._send(
            UnconfirmedPlan(
                command, change_ns, wall, wall, braking_machine=machine, obstacle_sentence=sentence
            )
        )

    def _make_braking_command(
        self, own: Command, at_ns: int, commit_horizon: float
    ) -> tuple[Command, int, str]:
        """Make a command that brakes, with regard to the obstacle ahead if there is one.

        A command for an obstacle that took more than `LATE_SHARE` of the commit horizon to compute
        is made again with a longer one. The reason of the stop becomes the returned sentence.

        Args:
            own: Command that the arm executes.
            at_ns: Stamp of the result in the time of plans [ns].
            commit_horizon: Commit horizon [s].

        Returns:
            The command, the time at which it leaves `own` [ns], and a sentence on where the arm
            then rests. The sentence is empty if no obstacle is braked for.
        """
        stopping = self._stopping
        if stopping is None or not stopping.obstacle:
            return *self._brake(own, at_ns, commit_horizon), ""
        machine, since_ns = self._settings.machine, stopping.obstacle_set_ns
        stop = make_braking_for_obstacle(machine, own, at_ns, commit_horizon, since_ns)
        took = (self._now_ns() - at_ns) / SECOND_NS
        if took > LATE_SHARE * commit_horizon:  # the rest is too short for transport
            stop = make_braking_for_obstacle(
                machine, own, self._now_ns(), commit_horizon + LATE_PLAN_FACTOR * took, since_ns
            )
        sentence = stop.describe(stopping.obstacle)
        self._report_obstacle(sentence)
        return stop.command, stop.change_ns, sentence

    def _handle_confirmed_braking(self, command: Command) -> None:
        """Store that the arm has confirmed a braking command, and finish the stop if possible.

        The stop is finished at once if it is known when the arm rests. That is not known if the
        reference governor has delayed plans, or if the arm never reports its plan in force. Only a
        measured rest then finishes the stop.

        Args:
            command: The braking command.
        """
        if self._stopping is None:
            return
        self._stopping.is_braking_confirmed = True
        if self.arm_state.plan_delay_ns == 0 and self.arm_state.plan_in_force_ns is not None:
            left = max(0.0, (command.trajectory.end_ns - self._now_ns()) / SECOND_NS)
            left = left / min(1.0, self.arm_state.clock_estimator.speed) + SETTLING_TIME
            self._finish_stop(True, f"the arm stands still in {left:.2f} s")

    def _finish_stop(self, success: bool, sentence: str) -> None:
        """Finish the stop: answer whoever asked for it, and end the goals that end with it.

        On success the execution ends too, as reached if the tip is at the goal, else as stopped. A
        goal that shall be planned for after the stop waits again.

        Args:
            success: Whether the arm rests or has confirmed that it brakes.
            sentence: The result in words.
        """
        stopping = self._stopping
        if stopping is None:
            return
        if stopping.obstacle and not stopping.is_braking_confirmed:
            self._report_obstacle(describe_missing_braking(stopping.obstacle, sentence))
        self._stopping = None
        execution = self._execution
        if success and execution is not None:
            self._execution = None
            if execution.pending_goal is not stopping.goal_after_stop:
                ending = execution.judge(self._settings.machine, self.arm_state, self._now_ns())
                if ending is None or ending.outcome is not Outcome.REACHED:
                    ending = ExecutionResult(Outcome.STOPPED, stopping.reason)
                self._reports.report_end(execution.pending_goal, *ending)
        for in_hand in stopping.goals:
            self._reports.report_end(in_hand, Outcome.STOPPED, stopping.reason)
        for done in stopping.on_finished:
            done(success, sentence)
        if stopping.goal_after_stop is not None:
            self._plan_again(stopping.goal_after_stop)

    # --- Reports ---------------------------------------------------------------------------------

    def _goals_before_sending(self) -> list[PendingGoal]:
        """Return the goals that wait or are being planned for, the waiting one first."""
        making = None if self._request is None else self._request.pending_goal
        return [each for each in (self._waiting, making) if each is not None]

    def _goals_before_confirmation(self) -> list[PendingGoal]:
        """Return the goals without a confirmed plan, newest first.

        Returns:
            Goals that wait, are being planned for, or have an unconfirmed plan.
        """
        sent = self._unconfirmed
        request = None if sent is None else sent.request
        return self._goals_before_sending() + ([] if request is None else [request.pending_goal])

    def _goals_not_ended(self) -> list[PendingGoal]:
        """Return the goals that have not ended, newest first."""
        execution = self._execution
        return self._goals_before_confirmation() + (
            [] if execution is None else [execution.pending_goal]
        )

    def _judge_execution(self) -> None:
        """End the execution if the arm's reports say so.

        Nothing is judged during a stop, or while another plan for the same goal is made or
        unconfirmed. Nothing is judged either while the last message of the arm is
        `REFERENCE_TIMEOUT` to `LONGEST_WAIT` old. A goal that moves is not reached before it
        stands.
        """
        execution = self._execution
        if execution is None or self._stopping is not None:
            return
        if (
            REFERENCE_TIMEOUT
            < self.arm_state.clock_estimator.time_since_last_stamp(self._clock.steady_time())
            < LONGEST_WAIT
        ):
            return  # the arm is frozen, or its messages are late
        if (
            execution.pending_goal in self._goals_before_confirmation()
        ):  # another plan is on its way
            return
        ending = execution.judge(self._settings.machine, self.arm_state, self._now_ns())
        ahead = not execution.target.is_at_same_position(execution.pending_goal.goal)
        arrived = ending is not None and ending.outcome is Outcome.REACHED
        if arrived and ahead and self._stream.is_moving(self._clock.steady_time()):
            return  # wait until the goal stands
        if ending is not None:
            self._execution = None
            self._reports.report_end(execution.pending_goal, *ending)

    def _now_ns(self) -> int:
        """Return the present time of plans [ns]."""
        return self.arm_state.get_plan_time_ns(self._clock.steady_time(), self._clock.ros_ns())
