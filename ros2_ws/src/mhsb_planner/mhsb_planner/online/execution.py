"""What becomes of a plan in force: reached, replaced, stopped or aborted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mhsb_model.command import Command
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import Outcome, PlanSummary
from mhsb_planner.online.arm_view import NO_PLAN, ArmView
from mhsb_planner.online.goal_in_hand import GoalInHand
from mhsb_planner.online.settings import Settings

REACHED_DISTANCE = 0.010
"""How near the measured tip must come to the goal [m]."""

SETTLING_NS = SECOND_NS
"""Time after a plan's end within which the tip must be there."""

EARLY_NS = 3 * SECOND_NS // 10
"""A plan that ends earlier than this before its time was ended by somebody."""

SAME_PLACE = 0.1
"""An arm within this of where its plan was has been stopped, not started anew [rad]."""


class Ending(NamedTuple):
    """How an execution ends, for a program and for a person."""

    outcome: Outcome
    sentence: str


@dataclass
class Execution:
    """A goal and the command for it that the arm has taken.

    target   where the command leads: to the goal, or a little ahead of one that moves
    plan     what its verdict told of that command
    settings with which it was planned; a goal is the same only if these are
    change_ns where the command leaves the one before, by the arm's clock
    """

    in_hand: GoalInHand
    command: Command
    target: Goal
    plan: PlanSummary
    settings: Settings
    change_ns: int

    def ending(self, machine: Machine, view: ArmView, now_ns: int) -> Ending | None:
        """How it ends by what the arm reports, None while it goes on.

        An arm that never tells which plan is in force is taken to obey.
        """
        end_ns = self.command.trajectory.end_ns
        if view.in_force_ns not in (None, NO_PLAN, self.command.stamp_ns):
            return Ending(Outcome.REPLACED, "the arm follows another plan")
        if view.in_force_ns == NO_PLAN and now_ns < end_ns - EARLY_NS:
            return self._dropped(view, now_ns)
        if now_ns < end_ns:
            return None
        return self._arrival(machine, view, now_ns)

    def _dropped(self, view: ArmView, now_ns: int) -> Ending:
        """The arm holds before the plan's end: it was stopped, or it started anew elsewhere."""
        if view.fault:
            return Ending(Outcome.ABORTED, view.fault)
        planned = self.command.trajectory.sample(now_ns).position
        heard = view.reference
        if heard is not None and np.abs(heard.state.position - planned).max() < SAME_PLACE:
            return Ending(Outcome.STOPPED, "the arm was stopped before the goal")
        return Ending(Outcome.ABORTED, "the arm no longer follows the plan")

    def _arrival(self, machine: Machine, view: ArmView, now_ns: int) -> Ending | None:
        goal = self.in_hand.goal
        if view.measured is None:
            return Ending(Outcome.REACHED, "the plan has ended; nobody measures the tip")
        options = self.settings.options
        distance = options.distance(machine, goal.position, view.measured.state.position)
        where = "goal" if options.goal_region is None else "goal's region"
        sentence = f"the tip is {1e3 * distance:.2f} mm from the {where}"
        if distance <= REACHED_DISTANCE:
            return Ending(Outcome.REACHED, sentence)
        if now_ns < self.command.trajectory.end_ns + SETTLING_NS:
            return None
        return Ending(Outcome.ABORTED, sentence)
