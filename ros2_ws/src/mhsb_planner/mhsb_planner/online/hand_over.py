"""Hand-over of commands to the arm: stamps, commit horizons, confirmations and refusals.

A command is a joint trajectory with its mode schedule. The commit horizon is the time from the
stamp of a command until it deviates from the previous command. The time of plans is the arm's clock
minus the delay that speed scaling has caused.
"""

from collections import deque
from collections.abc import Callable

from mhsb_model.arm_reports import HandOverReason
from mhsb_model.circuit.dead_time import compute_dead_time
from mhsb_model.command import Command
from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.online.commit_horizon import (
    LATE_PLAN_FACTOR,
    CommitHorizon,
    CommitHorizonEstimator,
)
from mhsb_planner.online.lifecycle_state import LifecycleState
from mhsb_planner.online.pending_goal import PendingGoal
from mhsb_planner.online.plan_request import UnconfirmedPlan
from mhsb_planner.online.replanning import Replan
from mhsb_planner.online.settings import Settings

LONGEST_WAIT = 2.0
"""Longest time for which a goal waits for a state, a receiver of plans, or an arm at rest [s]."""

CONFIRMATION_TIMEOUT = 0.1
"""Time for the arm to confirm a plan, from the time at which the plan deviates from the previous
plan [s].

After this time, the plan counts as refused once the arm has sent a state.
"""

MAX_LATE_PLANS = 3
"""Number of plans that fail at the longest commit horizon before a goal is refused."""

SENT_COMMAND_CAPACITY = 16
"""Largest number of sent commands that are kept, since the arm may still confirm any of them."""


class HandOver:
    """Hand-over of commands, from the choice of their stamp until the arm confirms or refuses them.

    At most one command is unconfirmed. `send` sends it, and `confirm` and `give_up` end its
    hand-over. The other methods choose stamps and commit horizons, or find sent commands.

    Attributes:
        horizon_estimator: Estimator of the commit horizon (time from a command's stamp until it
            deviates from the previous command).
    """

    def __init__(
        self, state: LifecycleState, on_confirmed: Callable[[UnconfirmedPlan], None]
    ) -> None:
        """Begin without a command.

        Args:
            state: State of the lifecycle. `unconfirmed` and the arm's `own_command` are written.
            on_confirmed: Called at once with each sent command if the arm does not report which
                plan it executes, and never otherwise. Such an arm is assumed to follow the command.
        """
        self.horizon_estimator = CommitHorizonEstimator()
        self._state = state
        self._on_confirmed = on_confirmed
        self._sent_commands: deque[UnconfirmedPlan] = deque(maxlen=SENT_COMMAND_CAPACITY)

    # --- Stamps and commit horizons --------------------------------------------------------------

    @property
    def last_stamp_ns(self) -> int:
        """Stamp of the command that was sent last [ns]; 0 if none was sent since a clock jump."""
        return self._sent_commands[-1].command.stamp_ns if self._sent_commands else 0

    def choose_stamp(self) -> int:
        """Return the earliest stamp for a new command.

        Returns:
            The time of plans, or the last stamp sent plus 1 ns if that is later [ns].
        """
        return max(self._state.now_ns, self.last_stamp_ns + 1)

    def choose_horizon(self, pending_goal: PendingGoal) -> CommitHorizon:
        """Choose the commit horizon (time until a new plan takes over) for a goal, in real time.

        Args:
            pending_goal: The goal. Its `horizon_factor` lengthens the horizon if earlier plans for
                it came too late.

        Returns:
            Commit horizon by the steady clock, without the machine's dead time.
        """
        settings = self._state.settings
        return self.horizon_estimator.choose_horizon(
            settings.lead_min,
            settings.lead_max,
            settings.planning_budget,
            pending_goal.horizon_factor,
        )

    def choose_arm_horizon(self, pending_goal: PendingGoal, *, starts_from_rest: bool) -> float:
        """Choose the commit horizon (time until a new plan takes over) for a goal, in arm time.

        A plan from rest is stamped when it is ready. So its horizon covers only transport and
        confirmation.

        Args:
            pending_goal: The goal. Its `horizon_factor` lengthens the horizon.
            starts_from_rest: True if the previous command has ended.

        Returns:
            Commit horizon by the arm's clock, with the machine's dead time [s].
        """
        horizon = self.choose_horizon(pending_goal)
        seconds = horizon.total
        if starts_from_rest:
            seconds = max(horizon.transport_reserve, self._state.settings.lead_min)
        return self._convert_horizon(seconds)

    def choose_braking_horizon(self, tries: int) -> float:
        """Choose the commit horizon of a braking command: the time from stamp to braking.

        The estimated transport time times `LATE_PLAN_FACTOR`^`tries` is limited to `lead_min` …
        `lead_max` of the settings. The result is converted to the arm's clock, and the machine's
        dead time is added.

        Args:
            tries: Number of braking commands of this stop that the arm has refused or dropped.

        Returns:
            Commit horizon by the arm's clock [s].
        """
        settings = self._state.settings
        wanted = LATE_PLAN_FACTOR**tries * self.horizon_estimator.transport_time
        return self._convert_horizon(min(max(settings.lead_min, wanted), settings.lead_max))

    def _convert_horizon(self, seconds: float) -> float:
        """Convert a commit horizon from real time to the arm's clock, and add the dead time.

        The servo must know a new plan one dead time before the new plan deviates from the plan in
        force.

        Args:
            seconds: Commit horizon in real time [s].

        Returns:
            Commit horizon by the arm's clock [s].
        """
        duration = self._state.arm_state.clock_estimator.convert_duration(seconds)
        return duration + compute_dead_time(self._state.settings.machine)

    def lengthen_horizon(self, pending_goal: PendingGoal) -> bool:
        """Lengthen the commit horizon of a goal by `LATE_PLAN_FACTOR`, after a plan came too late.

        The commit horizon is the time until a new plan takes over. The method writes
        `horizon_factor` and `late_plans_at_longest_horizon` of the goal.

        Args:
            pending_goal: The goal.

        Returns:
            False if `MAX_LATE_PLANS` plans for the goal have failed at the longest horizon. True if
            another plan may be tried.
        """
        is_longest = self.choose_horizon(pending_goal).is_longest
        pending_goal.late_plans_at_longest_horizon += is_longest
        pending_goal.horizon_factor *= LATE_PLAN_FACTOR
        return pending_goal.late_plans_at_longest_horizon < MAX_LATE_PLANS

    # --- From sending to the answer --------------------------------------------------------------

    def send(self, sent: UnconfirmedPlan) -> None:
        """Send a command, and store it as unconfirmed (without an answer of the arm).

        Args:
            sent: The command, with the times of its planning and sending and the request for it.
        """
        self._state.outbox.send(sent.command)
        self._sent_commands.append(sent)
        self._state.unconfirmed = sent
        if self._state.arm_state.plan_in_force_ns is None:
            self._on_confirmed(sent)

    def find_new_confirmation(self, stamp_ns: int) -> UnconfirmedPlan | None:
        """Find the sent command that has newly become the arm's plan in force.

        Args:
            stamp_ns: Stamp of the plan in force [ns].

        Returns:
            The command with this stamp. None if this planner did not send it, or if it was
            confirmed before.
        """
        own = self._state.arm_state.own_command
        sent_commands = (each for each in self._sent_commands if each.command is not own)
        return next((each for each in sent_commands if each.command.stamp_ns == stamp_ns), None)

    def find_plan_of_command(self, command: Command, settings: Settings) -> Replan | None:
        """Find the plan from which a command was made, if the plan was made with given settings.

        Args:
            command: Command that a new plan will continue.
            settings: Settings of the new plan. They must be the same object as the settings of the
                earlier plan.

        Returns:
            The plan. None if this planner did not send the command, if the command only brakes, or
            if the settings differ.
        """
        for sent in self._sent_commands:
            if sent.command is command and sent.request is not None:
                return sent.replan if sent.request.settings is settings else None
        return None

    def confirm(self, sent: UnconfirmedPlan) -> None:
        """Store that the arm follows a command.

        The command becomes `own_command` of the arm state, even if `give_up` was called for it
        before. If the arm reports which plan it executes, the time since planning becomes a sample
        of the estimated transport time. Commands that were sent earlier are then forgotten.

        Args:
            sent: The command.
        """
        state = self._state
        if state.unconfirmed is sent:
            state.unconfirmed = None
        state.arm_state.own_command = sent.command
        if state.arm_state.plan_in_force_ns is not None:
            self.horizon_estimator.add_transport_time(state.now - sent.planned_at)
            # The arm takes newer stamps alone, and each plan holds some 300 kB.
            while self._sent_commands[0] is not sent:
                self._sent_commands.popleft()

    def is_overdue(self, sent: UnconfirmedPlan) -> bool:
        """Return whether the arm's answer to a sent command is overdue.

        The command's change is the time at which it deviates from the previous command. The arm's
        last stamp is not extrapolated, since the arm may have become slow or silent.

        Args:
            sent: The command.

        Returns:
            True if the command was sent more than `LONGEST_WAIT` ago in real time. Also True if it
            was sent more than `CONFIRMATION_TIMEOUT` ago, and the arm's last stamp is more than
            `CONFIRMATION_TIMEOUT` after the change.
        """
        arm_state = self._state.arm_state
        last_ns = arm_state.clock_estimator.last_stamp_ns
        waited = self._state.now - sent.sent_at
        if last_ns is None or waited <= CONFIRMATION_TIMEOUT:
            return waited > LONGEST_WAIT
        grace = arm_state.clock_estimator.convert_duration(CONFIRMATION_TIMEOUT)
        late = (last_ns - arm_state.plan_delay_ns - sent.change_ns) / SECOND_NS
        return waited > LONGEST_WAIT or late > grace

    def give_up(self, sent: UnconfirmedPlan, reason: HandOverReason) -> None:
        """Store that the arm has refused or dropped the last command.

        The command is no longer unconfirmed. For the reason `LATE`, the estimated transport time
        becomes longer. For the reason `STAMP` (the arm did not accept the command's stamp), the
        estimate of the arm's clock starts again from the arm's last stamp.

        Args:
            sent: The command. Only `planned_at` is read.
            reason: Reason code; it is `LATE` if the arm gave no answer in time.
        """
        self._state.unconfirmed = None
        estimator = self.horizon_estimator
        if reason == HandOverReason.LATE:
            waited = self._state.now - sent.planned_at
            estimator.add_transport_time(max(waited, LATE_PLAN_FACTOR * estimator.transport_time))
        elif reason == HandOverReason.STAMP:
            self._state.arm_state.clock_estimator.keep_last_stamp_only()

    def forget(self) -> list[PendingGoal]:
        """Drop all commands and stamps after a clock jump.

        Returns:
            Goal of the unconfirmed plan (sent, without an answer) as a list of one element. The
            list is empty in three cases: there is no such plan, the command only brakes, or the
            plan is void.
        """
        sent, goals = self._state.unconfirmed, self._state.unconfirmed_goals
        self._state.unconfirmed = None
        self._sent_commands.clear()
        return [] if sent is not None and sent.is_void else goals
