"""Hand-over of commands to the arm: stamps, commit horizons, confirmations and refusals.

A command is a joint trajectory with its mode schedule. The commit horizon is the time from the
stamp of a command until it leaves the previous command. The time of plans is the arm's clock minus
the delay that speed scaling has caused.
"""

from __future__ import annotations

from mhsb_model.arm_reports import HandOverReason
from mhsb_model.circuit.dead_time import compute_dead_time
from mhsb_model.command import Command
from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.online.arm_state import ArmState
from mhsb_planner.online.commit_horizon import (
    LATE_PLAN_FACTOR,
    CommitHorizon,
    CommitHorizonEstimator,
)
from mhsb_planner.online.pending_goal import PendingGoal
from mhsb_planner.online.plan_request import UnconfirmedPlan
from mhsb_planner.online.planner_io import Clock, PlannerIO
from mhsb_planner.online.replanning import Replan
from mhsb_planner.online.settings import Settings

LONGEST_WAIT = 2.0
"""Longest time for which a goal waits for a state, a receiver of plans, or an arm at rest [s]."""

CONFIRMATION_TIMEOUT = 0.1
"""Time for the arm to confirm a plan, from the time at which the plan leaves the previous one [s].

After it the plan counts as not taken, if the arm has sent a state since then.
"""

AHEAD_NS = SECOND_NS // 10
"""Largest time by which the last sent stamp may be ahead of the time of plans [ns]."""

MAX_LATE_PLANS = 3
"""Number of plans that fail at the longest commit horizon before a goal is refused."""

SENT_COMMAND_CAPACITY = 16
"""Number of last sent commands that are kept, since the arm may still confirm any of them."""


class HandOver:
    """Record of sent commands until the arm confirms or refuses them.

    At most one command is unconfirmed. The lifecycle of goals sends a command with `send`. It
    reports the arm's confirmation with `confirm`, and a refusal with `give_up`. It also calls
    `give_up` if `is_overdue` returns True. It withdraws a plan with `revoke`. The other methods
    choose stamps and commit horizons.

    Attributes:
        unconfirmed: Command that has been sent and not confirmed; None if there is none.
        horizon_estimator: Estimator of the commit horizon (time from a command's stamp until it
            leaves the previous command).
    """

    def __init__(self, arm_state: ArmState, clock: Clock, outbox: PlannerIO) -> None:
        """Begin without a command.

        Args:
            arm_state: Arm state. A confirmation writes its `own_command`.
            clock: Source of the present time.
            outbox: Sends commands.
        """
        self.unconfirmed: UnconfirmedPlan | None = None
        self.horizon_estimator = CommitHorizonEstimator()
        self._arm_state = arm_state
        self._clock = clock
        self._outbox = outbox
        self._sent_commands: dict[int, UnconfirmedPlan] = {}
        self._last_stamp_ns = 0

    @property
    def goals(self) -> list[PendingGoal]:
        """Goal of the unconfirmed plan (sent, without an answer) as a list of one element.

        The list is empty if there is no such plan, or if the unconfirmed command only brakes.
        """
        request = None if self.unconfirmed is None else self.unconfirmed.request
        return [] if request is None else [request.pending_goal]

    # --- Stamps and commit horizons --------------------------------------------------------------

    def choose_stamp(self, now_ns: int) -> int:
        """Return the earliest stamp for a new command.

        Args:
            now_ns: Time of plans [ns]: the arm's clock minus the arm's delay behind its plans.

        Returns:
            `now_ns`, or the last stamp sent plus 1 ns if that is later [ns].
        """
        return max(now_ns, self._last_stamp_ns + 1)

    def is_ahead(self, now_ns: int) -> bool:
        """Return whether the last stamp sent is more than `AHEAD_NS` ahead of the time of plans.

        Args:
            now_ns: Time of plans [ns]: the arm's clock minus the arm's delay behind its plans.
        """
        return self._last_stamp_ns > now_ns + AHEAD_NS

    def choose_horizon(self, pending_goal: PendingGoal, settings: Settings) -> CommitHorizon:
        """Choose the commit horizon (time until a new plan takes over) for a goal, in real time.

        Args:
            pending_goal: The goal. Its `horizon_factor` lengthens the horizon if earlier plans for
                it came too late.
            settings: Settings for all goals, which give bounds or a fixed horizon.

        Returns:
            Commit horizon by the steady clock, without the machine's dead time.
        """
        return self.horizon_estimator.choose_horizon(
            settings.lead_min,
            settings.lead_max,
            settings.planning_budget,
            pending_goal.horizon_factor,
        )

    def choose_horizon_from_rest(self, commit_horizon: CommitHorizon, settings: Settings) -> float:
        """Choose the commit horizon of a plan that starts from rest, in real time.

        The commit horizon is the time from the stamp until the plan takes over. A plan from rest is
        stamped when it is ready, so its horizon covers transport and confirmation only.

        Args:
            commit_horizon: Commit horizon that a plan for the goal would have in motion. Its
                `transport_reserve` is read.
            settings: Settings for all goals; `lead_min` is the lower bound of the result.

        Returns:
            Commit horizon by the steady clock, without the machine's dead time [s].
        """
        return max(commit_horizon.transport_reserve, settings.lead_min)

    def choose_braking_horizon(self, tries: int, settings: Settings) -> float:
        """Choose the commit horizon of a braking command: the time from stamp to braking.

        It is the estimated transport time times `LATE_PLAN_FACTOR`^`tries`. It is limited to
        `lead_min` and `lead_max` of the settings. It is then converted to the arm's clock, and the
        machine's dead time is added.

        Args:
            tries: Number of braking commands of this stop that the arm has not taken.
            settings: Settings for all goals.

        Returns:
            Commit horizon by the arm's clock [s].
        """
        wanted = LATE_PLAN_FACTOR**tries * self.horizon_estimator.transport_time
        horizon = min(max(settings.lead_min, wanted), settings.lead_max)
        return self.convert_horizon(horizon, settings)

    def convert_horizon(self, seconds: float, settings: Settings) -> float:
        """Convert a commit horizon from real time to the arm's clock, and add the dead time.

        The servo must know a new plan one dead time before the new plan leaves the plan in force.

        Args:
            seconds: Commit horizon in real time [s].
            settings: Settings for all goals. Only `machine` is read.

        Returns:
            Commit horizon by the arm's clock [s].
        """
        duration = self._arm_state.clock_estimator.convert_duration(seconds)
        return duration + compute_dead_time(settings.machine)

    def lengthen_horizon(self, pending_goal: PendingGoal, settings: Settings) -> bool:
        """Lengthen the commit horizon of a goal by `LATE_PLAN_FACTOR`, after a plan came too late.

        The commit horizon is the time until a new plan takes over. The method writes
        `horizon_factor` and `late_plans_at_longest_horizon` of the goal.

        Args:
            pending_goal: The goal.
            settings: Settings for all goals.

        Returns:
            False if `MAX_LATE_PLANS` plans for the goal have failed at the longest horizon. True if
            another plan may be tried.
        """
        is_longest = self.choose_horizon(pending_goal, settings).is_longest
        pending_goal.late_plans_at_longest_horizon += is_longest
        pending_goal.horizon_factor *= LATE_PLAN_FACTOR
        return pending_goal.late_plans_at_longest_horizon < MAX_LATE_PLANS

    def stamp_from_rest(
        self, replan: Replan, pending_goal: PendingGoal, settings: Settings, now_ns: int
    ) -> Replan | None:
        """Return a copy of a plan from rest with a new stamp and a new commit horizon.

        The stamp is `now_ns`, or the last stamp sent plus 1 ns if that is later. The commit horizon
        (time from the stamp until the plan takes over) is chosen by goal and settings.

        Args:
            replan: The plan.
            pending_goal: Its goal, for the commit horizon.
            settings: Settings for all goals, which bound the commit horizon.
            now_ns: Time of plans [ns]: the arm's clock minus the arm's delay behind its plans.

        Returns:
            The copy. None if the previous command still moves at the new stamp, because the arm's
            clock was set back.
        """
        stamp_ns = self.choose_stamp(now_ns)
        if not replan.may_begin_at(stamp_ns):
            return None
        horizon = self.choose_horizon_from_rest(
            self.choose_horizon(pending_goal, settings), settings
        )
        return replan.with_stamp(stamp_ns, self.convert_horizon(horizon, settings))

    # --- From sending to the answer --------------------------------------------------------------

    def send(self, sent: UnconfirmedPlan) -> bool:
        """Send a command, and store it as unconfirmed (without an answer of the arm).

        The last `SENT_COMMAND_CAPACITY` commands are stored by their stamps.

        Args:
            sent: The command, with the times of its planning and sending and the request for it.

        Returns:
            True if the arm is of a kind that does not report which plan it executes. The caller
            must then confirm the command at once.
        """
        self._outbox.send(sent.command)
        self._last_stamp_ns = sent.command.stamp_ns
        self._sent_commands[sent.command.stamp_ns] = sent
        while len(self._sent_commands) > SENT_COMMAND_CAPACITY:
            self._sent_commands.pop(next(iter(self._sent_commands)))
        self.unconfirmed = sent
        return self._arm_state.plan_in_force_ns is None

    def find_new_confirmation(self, stamp_ns: int) -> UnconfirmedPlan | None:
        """Find the sent command that the arm has newly taken as its plan in force.

        Args:
            stamp_ns: Stamp of the plan in force [ns].

        Returns:
            The command with this stamp. None if this planner did not send it, or if it was
            confirmed before.
        """
        sent = self._sent_commands.get(stamp_ns)
        return None if sent is None or sent.command is self._arm_state.own_command else sent

    def find_plan_of_command(self, command: Command, settings: Settings) -> Replan | None:
        """Find the plan from which a command was made, if it was made with given settings.

        Args:
            command: Command that a new plan will continue.
            settings: Settings of the new plan. They must be the same object as the settings of the
                earlier plan.

        Returns:
            The plan. None if this planner did not send the command, if the command only brakes, or
            if the settings differ.
        """
        sent = self._sent_commands.get(command.stamp_ns)
        if sent is None or sent.command is not command or sent.request is None:
            return None
        return sent.replan if sent.request.settings is settings else None

    def confirm(self, sent: UnconfirmedPlan) -> None:
        """Store that the arm follows a command.

        The command becomes `own_command` of the arm state, even if `give_up` was called for it
        before. If the arm reports which plan it executes, the time since planning becomes a sample
        of the estimated transport time.

        Args:
            sent: The command.
        """
        if self.unconfirmed is sent:
            self.unconfirmed = None
        self._arm_state.own_command = sent.command
        if self._arm_state.plan_in_force_ns is not None:
            self.horizon_estimator.add_transport_time(self._clock.steady_time() - sent.planned_at)

    def is_overdue(self, sent: UnconfirmedPlan, now_ns: int) -> bool:
        """Return whether a sent command without an answer counts as not taken by the arm.

        Args:
            sent: The command.
            now_ns: Time of plans [ns]: the arm's clock minus the arm's delay behind its plans.

        Returns:
            True if the command was sent more than `LONGEST_WAIT` ago in real time. Also True if two
            conditions are met: it was sent more than `CONFIRMATION_TIMEOUT` ago, and the arm has
            sent a state more than this time after the command's change. The change is the time at
            which the command leaves the previous one. If the arm has been silent since the change,
            its confirmation may just be late.
        """
        now, estimator = self._clock.steady_time(), self._arm_state.clock_estimator
        waited = now - sent.sent_at
        silence = estimator.convert_duration(estimator.time_since_last_stamp(now))
        grace = estimator.convert_duration(CONFIRMATION_TIMEOUT)
        late = (now_ns - sent.change_ns) / SECOND_NS - silence
        return waited > LONGEST_WAIT or (late > grace and waited > CONFIRMATION_TIMEOUT)

    def give_up(self, sent: UnconfirmedPlan, reason: HandOverReason) -> None:
        """Store that the arm has not taken the command that was sent last.

        For the reason `LATE`, the estimated transport time becomes longer. The reason `STAMP` means
        that the arm did not accept the command's stamp. The estimate of the arm's clock then starts
        again from the last stamp of the arm.

        Args:
            sent: The command. Only `planned_at` is read.
            reason: Reason code; `LATE` also if the arm gave no answer in time.
        """
        self.unconfirmed = None
        estimator = self.horizon_estimator
        if reason == HandOverReason.LATE:
            waited = self._clock.steady_time() - sent.planned_at
            estimator.add_transport_time(max(waited, LATE_PLAN_FACTOR * estimator.transport_time))
        elif reason == HandOverReason.STAMP:
            self._arm_state.clock_estimator.keep_last_stamp_only()

    def revoke(self) -> list[PendingGoal]:
        """Mark the unconfirmed plan (sent, without an answer) as void: it is not wanted any more.

        If the arm takes a void plan after all, the lifecycle of goals stops the arm.

        Returns:
            The plan's goal as a list of one element. The list is empty if there is no unconfirmed
            plan, or if the unconfirmed command only brakes.
        """
        if self.unconfirmed is not None:
            self.unconfirmed.is_void = True
        return self.goals

    def forget(self) -> list[PendingGoal]:
        """Drop all commands and stamps after a clock jump.

        Returns:
            Goal of the unconfirmed plan (sent, without an answer) as a list of one element. The
            list is empty in three cases: there is no such plan, the command only brakes, or
            `revoke` has marked the plan as void.
        """
        revoked = self.unconfirmed is not None and self.unconfirmed.is_void
        goals = [] if revoked else self.goals
        self.unconfirmed = None
        self._sent_commands.clear()
        self._last_stamp_ns = 0
        return goals
