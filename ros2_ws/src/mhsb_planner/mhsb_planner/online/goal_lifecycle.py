"""The life of goals: waiting, planned, sent, in force, ended; free of ROS.

At most one goal waits (the newest), one is being planned for, one plan is sent and not confirmed,
one is in force. What the arm has not confirmed replaces nothing. An epoch counts what makes plans
void while they are being made: stops, faults, jumps of the clock, other settings.

Every goal gets one verdict, and every accepted goal one execution report. A plan that comes too
late is made again with a longer lead as long as its goal is the newest; from rest it is only
stamped anew.
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
from mhsb_planner.online.arm_view import NO_PLAN, ArmView, Heard
from mhsb_planner.online.departure import MovingError, NoStateError, departure
from mhsb_planner.online.execution import EARLY_NS, Execution
from mhsb_planner.online.goal_in_hand import (
    Adjustment,
    GoalInHand,
    as_they_are,
    nobody,
    summary_of,
)
from mhsb_planner.online.goal_reports import GoalReports
from mhsb_planner.online.goal_stream import GoalStream
from mhsb_planner.online.lead import LONGER, Lead, LeadEstimate
from mhsb_planner.online.plan_request import PlanRequest, Sent
from mhsb_planner.online.ports import Clock, Outbox
from mhsb_planner.online.replanning import Replan
from mhsb_planner.online.settings import Settings
from mhsb_planner.online.stopping import (
    ARM_STOPPED,
    BRAKINGS,
    STOP_ASKED,
    STOP_TIMEOUT,
    Stopping,
)
from mhsb_planner.online.verdicts import announcement, code_of
from mhsb_planner.online.zone_ahead import (
    brake_for,
    not_braked,
    obstacle_ahead,
    waits_for_plan,
)
from mhsb_planner.search import goal_clearance

LONGEST_WAIT = 2.0
"""How long a goal waits for a state, for a receiver of plans, or for an arm to come to rest [s]."""

UNCONFIRMED = 0.1
"""A plan that the arm has not confirmed so long after its change counts as not taken [s]."""

AHEAD_NS = SECOND_NS // 10
"""A stamp may be so far ahead of what the arm's time turns out to be [ns]."""

SILENT = 0.1
"""An arm that tells its reference and has not for so long may not be where it should be [s]."""

TRIES = 3
"""Plans at the longest lead before it is given up."""

REMEMBERED = 16
"""Commands that were sent last, of which the arm may still confirm one."""

LATE_SHARE = 0.5
"""A braking for an obstacle that took a larger share of its commit horizon to make is made again,
with a longer one. A larger share lets more of them come too late."""

OLD_STOP = 1.0
"""The arm's clock may be so much behind what is told of it, also when it told of a stop [s]."""


class GoalLifecycle:
    """Goals in, commands and reports out; every method is one event, none of them takes long.

    brake(command in force, now [ns], lead [s]) gives the command that brakes along it, and where
    it leaves it.
    """

    def __init__(
        self,
        settings: Settings,
        brake: Callable[[Command, int, float], tuple[Command, int]],
        clock: Clock,
        outbox: Outbox,
    ) -> None:
        self.view = ArmView(settings.machine.joint_count)
        self.lead = LeadEstimate()
        self._stream = GoalStream()
        self._settings = settings
        self._brake = brake
        self._clock = clock
        self._out = outbox
        self._tell = GoalReports(clock, outbox)
        self._epoch = 0
        self._waiting: GoalInHand | None = None
        self._request: PlanRequest | None = None
        self._unconfirmed: Sent | None = None
        self._execution: Execution | None = None
        self._stopping: Stopping | None = None
        self._said_of_obstacle = ""
        self._sent: dict[int, Sent] = {}
        self._last_stamp_ns = 0
        self._last_stop_ns = 0
        self._void_until = -math.inf
        self._arm_asked = False
        self._asked_at = -math.inf

    @property
    def pending(self) -> Command | None:
        """The command that the arm has not confirmed yet."""
        return None if self._unconfirmed is None else self._unconfirmed.command

    @property
    def execution(self) -> Execution | None:
        """Of the plan that the arm has confirmed, until it ends."""
        return self._execution

    @property
    def stops(self) -> bool:
        """Whether the arm is being brought to rest."""
        return self._stopping is not None

    @property
    def idle(self) -> bool:
        """Whether nothing waits, is made, is on its way, in force or being stopped."""
        return not (
            self._waiting
            or self._request
            or self._unconfirmed
            or self._execution
            or self._stopping
        )

    # --- Goals -----------------------------------------------------------------------------------

    def goal(
        self,
        goal: Goal,
        received: float | None = None,
        adjusted: Adjustment = as_they_are,
        told: Callable[[Report], None] = nobody,
    ) -> GoalInHand:
        """A goal has come: now, or at `received` by the steady clock [s].

        adjusted  settings for this goal, from those of all
        told      who is told of this goal alone, besides the outbox
        """
        wall = self._clock.wall()
        came = wall if received is None else received
        in_hand = GoalInHand(goal, came, wall, adjusted=adjusted, told=told)
        if self.view.fault:
            self._tell.refuse(in_hand, Verdict.FAULT, self.view.fault)
            return in_hand
        if in_hand.received <= self._void_until:
            self._tell.stop(in_hand, ARM_STOPPED)
            return in_hand
        try:
            self._check_place(in_hand)
        except MhsbError as error:
            self._tell.refuse(in_hand, code_of(error), str(error))
            return in_hand
        self._stream.hear(goal, in_hand.received)
        if self._waiting is not None and not self._is_under_way(self._waiting):
            self._tell.pass_over(self._waiting)
        self._waiting = in_hand
        self._arm_asked = False
        self._begin()
        return in_hand

    def rehearsal(self, goal: Goal, adjusted: Adjustment, stretch: float = 1.0) -> PlanRequest:
        """What would be asked for if this goal came now, its lead longer by `stretch`.

        Nothing comes of the answer. Raises what a goal is refused for before it is planned.
        """
        wall, now_ns = self._clock.wall(), self._now_ns()
        in_hand = GoalInHand(goal, wall, wall, stretch=stretch, exact=True, adjusted=adjusted)
        self._check_place(in_hand)
        start = departure(self.view, wall, now_ns)
        return self._request_for(in_hand, start, wall, now_ns)

    def _check_place(self, in_hand: GoalInHand) -> None:
        machine, goal = in_hand.settings(self._settings).machine, in_hand.goal
        machine.check_in_workspace(goal.position)
        goal_clearance.check_tip(machine, goal.position)

    def tick(self) -> None:
        """Time has passed."""
        sent = self._unconfirmed
        if sent is not None and self._overdue(sent):
            self._not_taken(sent, HandOverReason.LATE, "the arm did not take the plan in time")
        self._go_to_where_the_stream_ended()
        self._judge_execution()
        self._stop_the_unwanted()
        self._go_on_stopping()
        self._begin()

    def _begin(self) -> None:
        """Plan for the waiting goal, if nothing is in the way."""
        in_hand, wall = self._waiting, self._clock.wall()
        if in_hand is None or self._request or self._unconfirmed or self._stopping:
            return
        # Who tells a reference also tells the plan in force: that may come a moment later.
        half_heard = self.view.reference is not None and self.view.in_force_ns is None
        reachable = self._out.connected() and not half_heard
        if not reachable and wall - in_hand.waiting_since < LONGEST_WAIT:
            return
        now_ns = self._now_ns()
        ahead = self._last_stamp_ns > now_ns + AHEAD_NS  # stamps increase: its time has to come
        if ahead and wall - in_hand.waiting_since < LONGEST_WAIT:
            return
        try:
            start = departure(self.view, wall, now_ns)
        except (NoStateError, MovingError) as error:
            foreign = self.view.in_force_ns != NO_PLAN
            if isinstance(error, MovingError) and foreign and not self._arm_asked:
                self._arm_asked = True
                self._stop_arm()
            if wall - in_hand.waiting_since >= LONGEST_WAIT:
                self._waiting = None
                self._tell.refuse(in_hand, code_of(error), str(error))
            return
        self._waiting = None
        if not self._goes_on(in_hand, now_ns):
            self._request = self._request_for(in_hand, start, wall, now_ns)
            self._out.plan(self._request)

    def _request_for(
        self, in_hand: GoalInHand, start: Command, wall: float, now_ns: int
    ) -> PlanRequest:
        lead = self._lead_of(in_hand)
        at_rest = start.trajectory.end_ns <= now_ns
        target, period = self._target_of(in_hand, wall, lead.total)
        return PlanRequest(
            self._epoch,
            in_hand,
            target,
            period,
            in_hand.settings(self._settings),
            start,
            self.view.in_force_ns,
            max(now_ns, self._last_stamp_ns + 1),
            self._in_arm_time(self._from_rest(lead) if at_rest else lead.total),
            wall,
            Deadline(wall + lead.total - lead.flight),
            self._plan_of(start, in_hand.settings(self._settings)),
        )

    def _plan_of(self, command: Command, settings: Settings) -> Replan | None:
        """Where a command comes from, if it was planned under these settings."""
        sent = self._sent.get(command.stamp_ns)
        if sent is None or sent.command is not command or sent.request is None:
            return None
        return sent.replan if sent.request.settings is settings else None

    def _target_of(self, in_hand: GoalInHand, wall: float, lead: float) -> tuple[Goal, float]:
        """Where a plan should lead, and when the goal comes again [s]; 0: it never moved.

        To where a goal has stopped the arm goes as it followed it: a plan that is free to take
        another posture may swing the tip far beyond.
        """
        stream, goal = self._stream, in_hand.goal
        if not any(stream.velocity):
            return goal, 0.0
        if in_hand.exact or not stream.moves(wall):
            return goal, stream.period
        return stream.ahead(goal, lead + stream.period), stream.period

    def _go_to_where_the_stream_ended(self) -> None:
        """A goal that moved comes no more: the plan in force ends a little beyond it."""
        execution = self._execution
        if execution is None or self._stopping or self._before_confirmation():
            return
        in_hand, wall = execution.in_hand, self._clock.wall()
        if execution.target.same_place(in_hand.goal) or self._stream.moves(wall):
            return
        in_hand.exact, in_hand.waiting_since = True, wall
        self._waiting = in_hand

    def _stay_near(self) -> None:
        """The plan in force is good enough for a goal that moved: there is none to its very end."""
        if self._execution is not None:
            self._execution = replace(self._execution, target=self._execution.in_hand.goal)

    def _is_under_way(self, in_hand: GoalInHand) -> bool:
        """Whether the arm executes a plan for this very goal."""
        return self._execution is not None and self._execution.in_hand is in_hand

    def _lead_of(self, in_hand: GoalInHand) -> Lead:
        settings = self._settings
        return self.lead.split(
            settings.lead_min, settings.lead_max, settings.planning_budget, in_hand.stretch
        )

    def _from_rest(self, lead: Lead) -> float:
        """From rest a command is stamped when the plan is made: only its flight lies ahead [s]."""
        return max(lead.flight, self._settings.lead_min)

    def _in_arm_time(self, seconds: float) -> float:
        return seconds * max(1.0, self.view.time.speed)

    def _goes_on(self, in_hand: GoalInHand, now_ns: int) -> bool:
        """Whether the plan in force leads to this goal already; then the goal takes it over."""
        execution, goal = self._execution, in_hand.goal
        if execution is None or not self.view.executes_own(now_ns):
            return False
        if not goal.same_place(execution.target) or execution.command is not self.view.own:
            return False
        settings = in_hand.settings(self._settings)
        if execution.settings is not settings or self._stream.moves(self._clock.wall()):
            return False
        if execution.in_hand is in_hand:
            return True
        self._tell.end(execution.in_hand, Outcome.REPLACED, "the same goal came again and goes on")
        in_hand.plan_stamp_ns = execution.command.stamp_ns
        elapsed = 1e3 * (self._clock.wall() - in_hand.received)
        plan = replace(execution.plan, plan_ms=elapsed, lead_ms=elapsed, continued=True)
        self._tell.accept(in_hand, Verdict.OK, "the arm is on its way there already", plan)
        execution.in_hand = in_hand
        return True

    # --- Plans -----------------------------------------------------------------------------------

    def planned(self, request: PlanRequest, answer: Replan | Exception | None) -> None:
        """A plan has been made, or could not be; None where the arm is at the goal already."""
        if request is not self._request:
            return
        self._request = None
        in_hand, wall = request.in_hand, self._clock.wall()
        if request.epoch != self._epoch or not self._still_departs(request):
            self._again(in_hand)
        elif isinstance(answer, DeadlineError):
            self.lead.add_first_motion(LONGER * (wall - request.began))
            sentence = f"{answer}{self._settings.handicap}"
            self._took_too_long(request, Verdict.NOT_FOUND, sentence)
        elif isinstance(answer, MhsbError) and self._is_under_way(in_hand):
            self._stay_near()
        elif isinstance(answer, MhsbError) and request.target is not in_hand.goal:
            in_hand.exact = True
            self._again(in_hand)
        elif isinstance(answer, MhsbError):
            code = code_of(answer)
            why = self._settings.handicap if code is Verdict.INFEASIBLE else ""
            self._tell.refuse(in_hand, code, f"{answer}{why}")
        elif isinstance(answer, Exception):
            kind = type(answer).__name__
            self._tell.refuse(in_hand, Verdict.INTERNAL, f"planning failed with {kind}")
        elif answer is None:
            self._tell.at_goal(in_hand)
        else:
            self.lead.add_first_motion(wall - request.began - answer.improving)
            self._send_plan(request, answer, wall)
        self._begin()

    def _still_departs(self, request: PlanRequest) -> bool:
        """Whether the arm is still under the command that the plan continues."""
        if self.view.in_force_ns == request.in_force_ns:
            return True
        ended = self._now_ns() >= request.departure.trajectory.end_ns - EARLY_NS
        return (
            ended
            and self.view.in_force_ns == NO_PLAN
            and request.in_force_ns == request.departure.stamp_ns
        )

    def _send_plan(self, request: PlanRequest, replan: Replan, wall: float) -> None:
        now_ns, in_hand = self._now_ns(), request.in_hand
        if replan.from_rest:
            stamp_ns = max(now_ns, self._last_stamp_ns + 1)
            if not replan.may_begin(stamp_ns):  # it is not as late as it seemed: the arm moves
                self._again(in_hand)
                return
            lead = self._in_arm_time(self._from_rest(self._lead_of(in_hand)))
            replan = replan.stamped(stamp_ns, lead)
        if now_ns >= replan.change_ns:
            late = (now_ns - replan.change_ns) / SECOND_NS
            self._took_too_long(
                request, Verdict.DEADLINE, f"the plan was ready {late:.3f} s after its change"
            )
            return
        in_hand.attempts += 1
        in_hand.plan_stamp_ns = replan.command.stamp_ns
        elapsed = 1e3 * (wall - in_hand.received)
        ahead = 1e3 * (replan.change_ns - now_ns) / SECOND_NS
        in_hand.lead_ms = elapsed + ahead / self._in_arm_time(1.0)
        planned = min(wall, request.deadline.instant)
        sent = Sent(replan.command, replan.change_ns, planned, wall, replan, request)
        self._send(sent)
        if not in_hand.answered:
            plan = summary_of(replan, elapsed, in_hand.lead_ms)
            self._tell.accept(in_hand, Verdict.OK, announcement(replan, in_hand.goal), plan)

    def _send(self, sent: Sent) -> None:
        self._out.send(sent.command)
        self._last_stamp_ns = sent.command.stamp_ns
        self._sent[sent.command.stamp_ns] = sent
        while len(self._sent) > REMEMBERED:
            self._sent.pop(next(iter(self._sent)))
        self._unconfirmed = sent
        if self.view.in_force_ns is None:  # nobody ever confirms: the arm is taken to obey
            self._confirmed(sent)

    def _took_too_long(
        self, request: PlanRequest, code: Verdict, sentence: str, replan: Replan | None = None
    ) -> None:
        """A plan was not ready, or not taken, in time: once more with a longer lead.

        A plan from rest that can be stamped anew is given as `replan`.
        """
        in_hand = request.in_hand
        in_hand.too_long += self._lead_of(in_hand).longest
        in_hand.stretch *= LONGER
        if in_hand.too_long >= TRIES:
            if in_hand.answered:
                code = Verdict.DEADLINE
            spent = self._clock.wall() - in_hand.received
            tries = f"{TRIES} tries at the longest lead, {spent:.1f} s in all"
            self._tell.refuse(in_hand, code, f"{sentence}, in {tries}")
        elif replan is not None:
            self._send_plan(request, replan, self._clock.wall())
        else:
            self._again(in_hand)

    def _again(self, in_hand: GoalInHand) -> None:
        """Let a goal be planned anew, if it is still the newest."""
        if in_hand.over:
            return
        if self._waiting is not None:
            self._tell.pass_over(in_hand)
            return
        in_hand.waiting_since = self._clock.wall()
        self._waiting = in_hand

    # --- What the arm says -----------------------------------------------------------------------

    def heard_reference(self, state: MotionState, stamp_ns: int) -> None:
        """What the servo follows."""
        wall = self._clock.wall()
        if not self.view.time.hear(stamp_ns, wall):
            self.clock_jumped("the arm's clock went back")
            self.view.time.hear(stamp_ns, wall)
        self.view.reference = Heard(state, stamp_ns, wall)
        self._begin()

    def heard_joints(self, state: MotionState, stamp_ns: int) -> None:
        """What is measured."""
        self.view.measured = Heard(state, stamp_ns, self._clock.wall())

    def heard_modes(self, modes: ModeArray) -> None:
        """The modes in force."""
        self.view.modes = modes

    def heard_in_force(self, stamp_ns: int) -> None:
        """Which plan is in force, NO_PLAN while the arm holds."""
        self.view.in_force_ns = stamp_ns
        sent = self._sent.get(stamp_ns)
        if sent is not None and sent.command is not self.view.own:
            self._confirmed(sent)
        self._judge_execution()
        self._go_on_stopping()
        self._begin()

    def heard_refusal(self, stamp_ns: int, reason: HandOverReason, sentence: str) -> None:
        """The arm has not taken a plan."""
        sent = self._unconfirmed
        if sent is not None and sent.command.stamp_ns == stamp_ns:
            self._not_taken(sent, reason, sentence)
            self._begin()

    def heard_fault(self, sentence: str) -> None:
        """The arm has stopped at a fault, told in a sentence; an empty one where it is healthy."""
        if sentence == self.view.fault:
            return
        self.view.fault = sentence
        if not sentence:
            return
        self._epoch += 1
        for in_hand in self._before_confirmation():
            self._tell.refuse(in_hand, Verdict.FAULT, sentence)
        self._waiting = self._request = None
        if self._unconfirmed is not None:
            self._unconfirmed.void = True
        if self._execution is not None:
            self._tell.end(self._execution.in_hand, Outcome.ABORTED, sentence, Verdict.FAULT)
            self._execution = None
        self._stopped(True, sentence)

    def heard_delay(self, delay_ns: int) -> None:
        """By which the arm follows plans later than they say: plans are made in that time."""
        self.view.delay_ns = delay_ns

    def heard_stop(self, stop_ns: int, heard: float | None = None) -> None:
        """When the arm was last asked to stop [ns], 0 never: goals that had come are void.

        That is all that came before the arm's report, which came now or at `heard` by the steady
        clock [s]; a goal sent after the arm's answer comes later. An old stop voids nothing.
        """
        if stop_ns in (0, self._last_stop_ns):
            return
        self._last_stop_ns, wall = stop_ns, self._clock.wall()
        if wall - self._asked_at < LONGEST_WAIT:  # by this planner, for a goal that waits
            return
        ago = (self._now_ns() + self.view.delay_ns - stop_ns) / SECOND_NS / self._in_arm_time(1.0)
        self._void_until = min(wall if heard is None else heard, wall - ago + OLD_STOP)
        for in_hand in self._before_confirmation():
            if in_hand.received <= self._void_until:
                self._tell.stop(in_hand, ARM_STOPPED)
        execution = self._execution
        if execution is not None and execution.in_hand.received <= self._void_until:
            if self.view.executes_own(self._now_ns()):  # it took the plan after it was stopped
                self._stopping = self._stopping or Stopping(ARM_STOPPED, wall)
            else:
                self._execution = None
                self._tell.end(execution.in_hand, Outcome.STOPPED, ARM_STOPPED)
        if self._waiting is not None and self._waiting.over:
            self._waiting = None
        if self._request is not None and self._request.in_hand.over:
            self._request = None
        sent = self._unconfirmed
        if sent is not None and sent.request is not None and sent.request.in_hand.over:
            sent.void = True
        self._go_on_stopping()

    def clock_jumped(self, sentence: str) -> None:
        """All that is known of the arm is void; goals that have not been confirmed start anew."""
        self._out.warn(f"{sentence}: what was known of the arm is forgotten")
        self._epoch += 1
        self.view.forget()
        sent, self._unconfirmed = self._unconfirmed, None
        self._sent.clear()
        self._last_stamp_ns = 0
        if self._execution is not None:
            self._tell.end(self._execution.in_hand, Outcome.ABORTED, sentence)
            self._execution = None
        if sent is not None and sent.request is not None:
            self._again(sent.request.in_hand)
        self._stopped(True, sentence)

    def _confirmed(self, sent: Sent) -> None:
        """The arm follows a command; perhaps one that had been given up already."""
        wall = self._clock.wall()
        if self._unconfirmed is sent:
            self._unconfirmed = None
        self.view.own = sent.command
        if self.view.in_force_ns is not None:
            self.lead.add_flight(wall - sent.planned)
        if sent.request is None or sent.replan is None:  # it brakes
            left = (sent.command.trajectory.end_ns - self._now_ns()) / SECOND_NS
            if sent.sentence:
                self._say_of_obstacle(sent.sentence)
            self._stopped(True, f"the arm stands still in {max(0.0, left):.2f} s", braked=True)
            if sent.braked_for is not self._settings.machine:
                self._keep_clear()
            return
        in_hand = sent.request.in_hand
        self._no_further_plan(in_hand)
        if self._execution is not None and self._execution.in_hand is not in_hand:
            self._tell.end(self._execution.in_hand, Outcome.REPLACED, "a later plan took over")
        self._execution = None
        if not in_hand.over:
            plan = summary_of(sent.replan, 0.0, in_hand.lead_ms)
            self._execution = Execution(
                in_hand,
                sent.command,
                sent.request.target,
                plan,
                sent.request.settings,
                sent.change_ns,
            )
        if sent.void:
            self._stopping = self._stopping or Stopping(STOP_ASKED, wall)
            self._go_on_stopping()
        elif sent.request.settings is not in_hand.settings(self._settings):
            self._keep_clear(again=in_hand)

    def _no_further_plan(self, in_hand: GoalInHand) -> None:
        """A plan for the goal is in force: another attempt is not wanted any more."""
        if self._waiting is in_hand:
            self._waiting = None
        if self._request is not None and self._request.in_hand is in_hand:
            self._request = None

    def _overdue(self, sent: Sent) -> bool:
        wall = self._clock.wall()
        if wall - sent.sent > LONGEST_WAIT:  # also where the arm's clock stands still
            return True
        grace = UNCONFIRMED * max(1.0, self.view.time.speed)
        late = (self._now_ns() - sent.change_ns) / SECOND_NS
        return late > grace and wall - sent.sent > UNCONFIRMED

    def _not_taken(self, sent: Sent, reason: HandOverReason, sentence: str) -> None:
        """The arm has not taken a command: it goes on with the one before."""
        self._unconfirmed = None
        wall = self._clock.wall()
        request, replan = sent.request, sent.replan
        if reason == HandOverReason.LATE:
            self.lead.add_flight(max(wall - sent.planned, LONGER * self.lead.flight))
        elif reason == HandOverReason.STAMP:
            self.view.time.go_by_the_latest()
        if request is None or replan is None or sent.void:
            self._go_on_stopping()
            return
        in_hand = request.in_hand
        if in_hand.over:
            return
        if reason == HandOverReason.FAULT:
            self._tell.refuse(in_hand, Verdict.FAULT, sentence)
        elif reason == HandOverReason.INVALID:
            self._tell.refuse(in_hand, Verdict.INTERNAL, sentence)
        elif reason == HandOverReason.STOPPED:
            self._tell.stop(in_hand, sentence)
        elif self._waiting is not None:
            self._tell.pass_over(in_hand)
        else:
            as_before = request.epoch == self._epoch and self._still_departs(request)
            elsewhere = reason in (HandOverReason.JUMP, HandOverReason.RESET)
            anew = replan.from_rest and as_before and not elsewhere
            late = Verdict.DEADLINE
            self._took_too_long(request, late, sentence, replan if anew else None)

    # --- Stopping --------------------------------------------------------------------------------

    def stop(self, done: Callable[[bool, str], None]) -> None:
        """Bring the arm to rest; `done` is told when it cannot do anything else any more."""
        self._epoch += 1
        for in_hand in self._before_sending():
            self._tell.stop(in_hand, STOP_ASKED)
        self._waiting = self._request = None
        self._stay_near()
        stopping = self._stopping = self._stopping or Stopping(STOP_ASKED, self._clock.wall())
        stopping.done.append(done)
        sent = self._unconfirmed
        if sent is not None and sent.request is not None:
            sent.void = True
            stopping.goals.append(sent.request.in_hand)
        if stopping.again is not None:
            stopping.goals.append(stopping.again)
            stopping.again = None
        self._go_on_stopping()

    def cancel(self, in_hand: GoalInHand) -> None:
        """Stop, unless a newer goal has come: then only this one shall not be gone on with."""
        in_hand.unwanted = True
        self._stop_the_unwanted()

    def _stop_the_unwanted(self) -> None:
        """Where the newest goal has been cancelled; also after a newer one was refused."""
        newest = next(iter(self._alive()), None)
        if newest is not None and newest.unwanted and self._stopping is None:
            self.stop(lambda success, sentence: None)

    def change(self, settings: Settings) -> None:
        """Plans are to be made otherwise from now on; the one being made is made anew."""
        zones = settings.machine.zones != self._settings.machine.zones
        self._settings = settings
        self._epoch += 1
        if zones:
            self._keep_clear()

    def _keep_clear(self, again: GoalInHand | None = None) -> None:
        """Stop if an obstacle now lies across what is left of the motion in force.

        A stop that is under way already goes on as one that brakes for the obstacle.
        """
        own, now_ns = self.view.own, self._now_ns()
        if own is None or not self.view.executes_own(now_ns):
            return
        obstacle = obstacle_ahead(self._settings.machine, own, now_ns)
        if obstacle is None:
            return
        if self._stopping is None:
            self._stopping = Stopping("", self._clock.wall(), again=again)
            self._said_of_obstacle = ""
        self._stopping.obstacle, self._stopping.set_ns = obstacle, now_ns
        self._go_on_stopping()
        if self._stopping is not None and not self._stopping.reason:
            self._say_of_obstacle(waits_for_plan(obstacle))

    def _say_of_obstacle(self, sentence: str) -> None:
        """Log a sentence on an obstacle ahead unless it was the last one; it is the stop's reason.

        A stop that somebody has asked for keeps its own reason.
        """
        stopping = self._stopping
        if stopping is not None and stopping.reason not in (STOP_ASKED, ARM_STOPPED):
            stopping.reason = sentence
        if sentence != self._said_of_obstacle:
            self._said_of_obstacle = sentence
            self._out.warn(sentence)

    def _go_on_stopping(self) -> None:
        """The next step to rest, once it is known what the arm has taken."""
        stopping = self._stopping
        if stopping is None:
            return
        if self._clock.wall() - stopping.since > STOP_TIMEOUT:
            self._stopped(False, f"the arm has not confirmed a stop within {STOP_TIMEOUT:g} s")
        elif self._unconfirmed is None:
            now_ns, own = self._now_ns(), self.view.own
            if own is None or not self.view.executes_own(now_ns):
                self._stopped(True, "no plan of this planner is being executed")
            elif stopping.tries < BRAKINGS:
                stopping.tries += 1
                self._send_braking(own, now_ns, LONGER ** (stopping.tries - 1))
            elif stopping.tries == BRAKINGS:
                stopping.tries += 1
                self._stop_arm()

    def _stop_arm(self) -> None:
        self._asked_at = self._clock.wall()
        self._out.stop_arm()

    def _send_braking(self, own: Command, now_ns: int, stretch: float) -> None:
        shortest, longest = self._settings.lead_min, self._settings.lead_max
        lead = self._in_arm_time(min(max(shortest, stretch * self.lead.flight), longest))
        at_ns = max(now_ns, self._last_stamp_ns + 1)
        command, change_ns, sentence = self._braking(own, at_ns, lead)
        wall, machine = self._clock.wall(), self._settings.machine
        self._send(Sent(command, change_ns, wall, wall, braked_for=machine, sentence=sentence))

    def _braking(self, own: Command, at_ns: int, lead: float) -> tuple[Command, int, str]:
        """Return a command that brakes, where it leaves its own, and where the arm then rests.

        The sentence is empty if no obstacle is braked for.
        """
        stopping = self._stopping
        if stopping is None or not stopping.obstacle:
            return *self._brake(own, at_ns, lead), ""
        machine, since_ns = self._settings.machine, stopping.set_ns
        stop = brake_for(machine, own, at_ns, lead, since_ns)
        took = (self._now_ns() - at_ns) / SECOND_NS
        if took > LATE_SHARE * lead:  # what is left of the lead is too short for its way to the arm
            stop = brake_for(machine, own, self._now_ns(), lead + LONGER * took, since_ns)
        sentence = stop.sentence(stopping.obstacle)
        self._say_of_obstacle(sentence)
        return stop.command, stop.change_ns, sentence

    def _stopped(self, success: bool, sentence: str, *, braked: bool = False) -> None:
        """The arm cannot do anything else any more, or does not answer."""
        stopping, self._stopping = self._stopping, None
        if stopping is None:
            return
        if stopping.obstacle and not braked:
            self._out.warn(not_braked(stopping.obstacle, sentence))
        execution = self._execution
        if braked and execution is not None:
            self._execution = None
            if execution.in_hand is not stopping.again:
                self._tell.end(execution.in_hand, Outcome.STOPPED, stopping.reason)
        for in_hand in stopping.goals:
            self._tell.end(in_hand, Outcome.STOPPED, stopping.reason)
        for done in stopping.done:
            done(success, sentence)
        if stopping.again is not None:
            self._again(stopping.again)

    # --- Reports ---------------------------------------------------------------------------------

    def _before_sending(self) -> list[GoalInHand]:
        """Goals that wait or are being planned for."""
        making = None if self._request is None else self._request.in_hand
        return [each for each in (self._waiting, making) if each is not None]

    def _before_confirmation(self) -> list[GoalInHand]:
        """Those, and the one whose plan has been sent."""
        sent = self._unconfirmed
        request = None if sent is None else sent.request
        return self._before_sending() + ([] if request is None else [request.in_hand])

    def _alive(self) -> list[GoalInHand]:
        """Goals that have not ended, newest first."""
        execution = self._execution
        return self._before_confirmation() + ([] if execution is None else [execution.in_hand])

    def _judge_execution(self) -> None:
        execution = self._execution
        if execution is None or self._stopping is not None:
            return
        if SILENT < self.view.time.silence(self._clock.wall()) < LONGEST_WAIT:
            return  # it is frozen, or what it tells is late
        if execution.in_hand in self._before_confirmation():  # another plan for it is being made
            return
        ending = execution.ending(self._settings.machine, self.view, self._now_ns())
        ahead = not execution.target.same_place(execution.in_hand.goal)
        arrived = ending is not None and ending.outcome is Outcome.REACHED
        if arrived and ahead and self._stream.moves(self._clock.wall()):
            return  # soon it is known where the goal stays
        if ending is not None:
            self._execution = None
            self._tell.end(execution.in_hand, *ending)

    def _now_ns(self) -> int:
        return self.view.now_ns(self._clock.wall(), self._clock.ros_ns())
