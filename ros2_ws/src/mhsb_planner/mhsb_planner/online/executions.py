"""What becomes of accepted goals: reached, replaced, stopped or aborted, once for each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.command import Command
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import ExecutionReport, Outcome
from mhsb_planner.online.departure import NO_PLAN, ArmView

REACHED_DISTANCE = 0.010
"""How near the measured tip must come to the goal [m]."""

SETTLING_NS = SECOND_NS
"""Time after a plan's end within which the tip must be there."""

CONFIRMATION_NS = 3 * SECOND_NS // 10
"""Time after the change to a new plan within which the arm must have confirmed it."""


@dataclass
class Execution:
    """A goal whose plan has been published."""

    goal: Goal
    command: Command
    change_ns: int
    confirmed: bool = False

    def ended(self, outcome: Outcome, sentence: str) -> ExecutionReport:
        """The report that closes it."""
        return ExecutionReport(outcome, sentence, self.goal.stamp_ns, self.command.stamp_ns)


class Executions:
    """Follows all published plans; every call returns the reports that have become due."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._open: list[Execution] = []

    def add(self, goal: Goal, command: Command, change_ns: int) -> None:
        """Follow a goal whose plan leaves the previous one at `change_ns`."""
        self._open.append(Execution(goal, command, change_ns))

    def awaits_confirmation(self, stamp_ns: int, now_ns: int) -> bool:
        """Whether the arm may still confirm the plan with this stamp."""
        return any(
            execution.command.stamp_ns == stamp_ns
            and not execution.confirmed
            and now_ns < execution.change_ns + CONFIRMATION_NS
            for execution in self._open
        )

    def stop_all(self, reason: str) -> list[ExecutionReport]:
        """Close all because the planner stops the arm."""
        return self._close_all(Outcome.STOPPED, reason)

    def abort_all(self, reason: str) -> list[ExecutionReport]:
        """Close all because they can no longer be followed."""
        return self._close_all(Outcome.ABORTED, reason)

    def update(self, view: ArmView, now_ns: int) -> list[ExecutionReport]:
        """Look at what the arm reports; `view.in_force_ns` None counts as obedience."""
        for execution in self._open:
            execution.confirmed |= view.in_force_ns == execution.command.stamp_ns
        reports: list[ExecutionReport] = []
        last_confirmed = max(
            (i for i, e in enumerate(self._open) if self._in_force(e, view)), default=-1
        )
        still_open: list[Execution] = []
        for index, execution in enumerate(self._open):
            report: ExecutionReport | None
            if index < last_confirmed:
                report = execution.ended(Outcome.REPLACED, "a later plan took over")
            else:
                report = self._judge(execution, view, now_ns)
            if report is None:
                still_open.append(execution)
            else:
                reports.append(report)
        self._open = still_open
        return reports

    def _in_force(self, execution: Execution, view: ArmView) -> bool:
        """Whether the arm has taken a plan; while it says nothing at all, the last one counts."""
        return execution.confirmed or (
            view.in_force_ns is None and execution is self._open[-1]
        )

    def _judge(self, execution: Execution, view: ArmView, now_ns: int) -> ExecutionReport | None:
        end_ns = execution.command.trajectory.end_ns
        if not self._in_force(execution, view):
            if now_ns < execution.change_ns + CONFIRMATION_NS:
                return None
            return execution.ended(
                Outcome.ABORTED, "the arm did not take the plan; its /diagnostics say why"
            )
        in_force_ns = view.in_force_ns
        dropped = in_force_ns not in (None, execution.command.stamp_ns)
        if dropped and in_force_ns != NO_PLAN and now_ns > execution.change_ns:
            own = [e for e in self._open if e.command.stamp_ns == in_force_ns]
            if not own:
                return execution.ended(Outcome.REPLACED, "the arm follows another plan")
        if dropped and in_force_ns == NO_PLAN and now_ns < end_ns - CONFIRMATION_NS:
            return self._dropped(execution, view, now_ns)
        if now_ns < end_ns:
            return None
        return self._arrival(execution, view, now_ns)

    def _dropped(self, execution: Execution, view: ArmView, now_ns: int) -> ExecutionReport:
        """The arm holds before the plan's end: it was stopped, or it started anew elsewhere."""
        planned = execution.command.trajectory.sample(now_ns).position
        heard = view.reference
        if heard is not None and np.abs(heard.state.position - planned).max() < 0.1:
            return execution.ended(Outcome.STOPPED, "the arm was stopped before the goal")
        return execution.ended(Outcome.ABORTED, "the arm no longer follows the plan")

    def _arrival(
        self, execution: Execution, view: ArmView, now_ns: int
    ) -> ExecutionReport | None:
        goal = execution.goal
        if view.measured is None:
            return execution.ended(Outcome.REACHED, "the plan has ended; nobody measures the tip")
        tip = self._machine.tip_position(view.measured.state.position)
        distance = float(np.hypot(tip[0] - goal.x, tip[1] - goal.z))
        sentence = f"the tip is {1e3 * distance:.2f} mm from the goal"
        if distance <= REACHED_DISTANCE:
            return execution.ended(Outcome.REACHED, sentence)
        if now_ns < execution.command.trajectory.end_ns + SETTLING_NS:
            return None
        return execution.ended(Outcome.ABORTED, sentence)

    def _close_all(self, outcome: Outcome, sentence: str) -> list[ExecutionReport]:
        reports = [execution.ended(outcome, sentence) for execution in self._open]
        self._open = []
        return reports
