"""Request for a plan, and record of a sent command that the arm has not confirmed yet.

A command is a joint trajectory with its mode schedule. The time of plans is the arm's clock minus
the delay that speed scaling has caused.
"""

from dataclasses import dataclass, replace

import numpy as np

from mhsb_model.command import Command
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import Position
from mhsb_planner import deadline
from mhsb_planner.deadline import Deadline
from mhsb_planner.motion.via_check import find_points_ahead
from mhsb_planner.online.command_joining import choose_hand_over_times
from mhsb_planner.online.pending_goal import PendingGoal
from mhsb_planner.online.replanning import Replan, Replanner
from mhsb_planner.online.settings import Settings

TRACED_NS = 5_000_000
"""Time between the tip positions that show which via points were passed [ns]."""


@dataclass(frozen=True, eq=False)
class PlanRequest:
    """Request of the goal lifecycle for a plan.

    Attributes:
        epoch: `LifecycleState.epoch` at the request. If it has changed, the answer is void.
        pending_goal: Record of the goal.
        target: Place to which the plan must lead: the goal, or the place where a moving goal will
            be.
        period: Median time between the goal's last messages [s]; 0 if these give no velocity.
        settings: Settings of the plan.
        start_command: Command that the plan continues.
        in_force_ns: Stamp of the plan in force at the request [ns]. `NO_PLAN` if the arm held its
            position; None if it does not report which plan it executes.
        now_ns: Time of plans at the request [ns]: earliest stamp of the new command.
        commit_horizon: Time from the new command's stamp until it deviates from `start_command`, by
            the arm's clock [s].
        requested_at: Time of the request by the steady clock [s].
        deadline: Instant by which the answer is needed.
        previous_plan: Plan from which `start_command` was made, if it has the same settings;
            otherwise None.
    """

    epoch: int
    pending_goal: PendingGoal
    target: Goal
    period: float
    settings: Settings
    start_command: Command
    in_force_ns: int | None
    now_ns: int
    commit_horizon: float
    requested_at: float
    deadline: Deadline
    previous_plan: Replan | None = None

    def make_plan(self, replanner: Replanner) -> Replan | None:
        """Make the requested plan. The method runs in the thread of the planning worker.

        The machine of `replanner` is first changed to that of the request. The plan leaves out via
        points that the tip passes before the plan takes over.

        Args:
            replanner: Planner that makes the plan.

        Returns:
            The plan with its command. Its `improvement_time` is the time spent after the first
            feasible motion was found [s]. None if the arm already rests at the goal.

        Raises:
            MhsbError: No plan could be made; `Planner.plan` lists the errors.
        """
        target, began = self.target, deadline.now()
        replanner.change_machine(self.settings.machine)
        replan = replanner.replan(
            self.start_command,
            self.now_ns,
            target.position,
            self.commit_horizon,
            replace(self.settings.options, via=self._find_via_points_ahead(), period=self.period),
            self.deadline,
        )
        if replan is None:
            return None
        spent = deadline.now() - began
        return replace(replan, improvement_time=spent - replan.plan.seconds["first_motion"])

    def _find_via_points_ahead(self) -> tuple[Position, ...]:
        """Find the via points that the new plan still has to pass.

        These are all via points of the settings if the new plan starts from rest, or if no earlier
        plan with the same settings is in force. Otherwise they are the via points of the earlier
        plan that the tip has not passed when the new plan takes over. So the tip passes each via
        point once between two rests, even if new goals come during the motion.

        Returns:
            Via points in `base_link`, each (x, z) or (x, y, z) [m].
        """
        options, before = self.settings.options, self.previous_plan
        if before is None or not options.via:
            return options.via
        times = choose_hand_over_times(
            self.start_command, self.now_ns, round(self.commit_horizon * SECOND_NS)
        )
        motion = self.start_command.trajectory
        if times.change_ns >= motion.end_ns:
            return options.via
        at_ns = np.append(np.arange(before.change_ns, times.change_ns, TRACED_NS), times.change_ns)
        tip = self.settings.machine.tip_in_base(motion.sample_many(at_ns)[0])
        passing = tuple((*point, options.via_tolerance) for point in before.via)
        return tuple(tuple(point) for *point, _ in find_points_ahead(tip, passing))


@dataclass(eq=False)
class UnconfirmedPlan:
    """Command that has been sent and that the arm has not confirmed yet.

    Attributes:
        command: The command.
        change_ns: Time at which the command deviates from the previous command, in the time of
            plans [ns].
        planned_at: Time at which planning ended, but not later than the deadline, by the steady
            clock [s].
        sent_at: Time at which the command was sent, by the steady clock [s].
        replan: Plan from which the command was made; None for a braking command.
        request: Request of this plan; None for a braking command.
        is_void: True if the command is no longer wanted. If the arm begins to follow it, the arm is
            stopped.
        braking_machine: Machine with the zones for which a braking command was made; None for a
            plan.
        obstacle_sentence: Sentence on the place at which a braking command for an obstacle comes to
            rest; empty for any other command.
    """

    command: Command
    change_ns: int
    planned_at: float
    sent_at: float
    replan: Replan | None = None
    request: PlanRequest | None = None
    is_void: bool = False
    braking_machine: Machine | None = None
    obstacle_sentence: str = ""
