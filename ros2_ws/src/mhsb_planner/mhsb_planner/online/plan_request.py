"""What the lifecycle asks of whoever plans, and what it knows of a plan that it has sent."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mhsb_model.command import Command
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import Position
from mhsb_planner import deadline
from mhsb_planner.deadline import Deadline
from mhsb_planner.motion.passing import still_ahead
from mhsb_planner.online.goal_in_hand import GoalInHand
from mhsb_planner.online.hand_over import change_over
from mhsb_planner.online.replanning import Replan, Replanner
from mhsb_planner.online.settings import Settings

TRACED_NS = 5_000_000
"""How closely the tip's way is looked at for the points that it has passed."""


@dataclass(frozen=True, eq=False)
class PlanRequest:
    """A plan that is being made.

    epoch      of the lifecycle when it was asked for; another one later makes it void
    target     where it shall lead: the goal, or where a goal that moves will be
    period     s, after which the goal comes again; 0 where it stands
    departure  command that it continues, while the arm said that `in_force_ns` was in force
    now_ns     the arm's time when it was asked for
    lead       s of the arm's time, until it leaves the departure
    began      when it was asked for, by the steady clock [s]
    deadline   for its answer
    under_way  the plan that the departure comes from, where it is one of the same settings
    """

    epoch: int
    in_hand: GoalInHand
    target: Goal
    period: float
    settings: Settings
    departure: Command
    in_force_ns: int | None
    now_ns: int
    lead: float
    began: float
    deadline: Deadline
    under_way: Replan | None = None

    def answered_by(self, replanner: Replanner) -> Replan | None:
        """The worker's part; raises what `Replanner.replan` raises."""
        target, began = self.target, deadline.now()
        replanner.change(self.settings.machine)
        replan = replanner.replan(
            self.departure,
            self.now_ns,
            target.position,
            self.lead,
            replace(self.settings.options, via=self._points_ahead(), period=self.period),
            self.deadline,
        )
        if replan is None:
            return None
        spent = deadline.now() - began
        return replace(replan, improving=spent - replan.plan.seconds["first_motion"])

    def _points_ahead(self) -> tuple[Position, ...]:
        """Points on the way that are left: all of them from rest, else those not passed so far.

        They are passed once between two rests, also where goals follow each other on the way.
        """
        options, before = self.settings.options, self.under_way
        if before is None or not options.via:
            return options.via
        times = change_over(self.departure, self.now_ns, round(self.lead * SECOND_NS))
        motion = self.departure.trajectory
        if times.change_ns >= motion.end_ns:
            return options.via
        at_ns = np.append(np.arange(before.change_ns, times.change_ns, TRACED_NS), times.change_ns)
        tip = self.settings.machine.tip_in_base(motion.sample_many(at_ns)[0])
        passing = tuple((*point, options.via_tolerance) for point in before.via)
        return tuple(tuple(point) for *point, _ in still_ahead(tip, passing))


@dataclass(eq=False)
class Sent:
    """A command that has been sent and that the arm has not confirmed yet.

    change_ns  where it leaves the command before, by the arm's clock
    planned    when it was made, or should have been, by the steady clock [s]
    sent       when it was sent [s]
    replan     where it comes from, with its request; None for a command that brakes
    void       whether the arm should not take it any more: if it does, it is braked
    braked_for  machine with the zones that held when a command that brakes was made
    sentence   where such a command comes to rest, if it brakes for an obstacle
    """

    command: Command
    change_ns: int
    planned: float
    sent: float
    replan: Replan | None = None
    request: PlanRequest | None = None
    void: bool = False
    braked_for: Machine | None = None
    sentence: str = ""
