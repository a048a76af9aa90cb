"""Execution of the plan in force, which ends as reached, replaced, stopped or aborted.

The time of plans is the arm's clock minus the delay that speed scaling has caused.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mhsb_model.circuit.dead_time import compute_dead_time, compute_settling_time
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import Outcome, Verdict
from mhsb_planner.online.arm_state import NO_PLAN, ArmState
from mhsb_planner.online.pending_goal import PendingGoal
from mhsb_planner.online.replanning import Replan
from mhsb_planner.online.settings import Settings

EARLY_NS = 3 * SECOND_NS // 10
"""Time before a plan's end from which on the arm may hold without having dropped the plan [ns].

If the arm holds earlier, a stop, a fault or a reset has ended the plan.
"""

SAME_PLACE = 0.1
"""Largest joint difference at which an arm that has dropped its plan counts as stopped [rad].

If a joint is farther from its planned position, the arm has been restarted elsewhere.
"""

REASON_NS = SECOND_NS
"""Time after an early end of a plan within which the arm may still report the reason [ns].

The topics `plan_in_force` and `/diagnostics` may come in any order.
"""

STAY_TIME_NS = SECOND_NS // 5
"""Time for which the tip must stay at a goal so that the goal counts as reached, without dead times
[ns].
"""

STAY_DEAD_TIMES = 2.0
"""Number of dead times of the machine that are added to `STAY_TIME_NS` [-].

A correction of the servo acts within this time."""


class ExecutionResult(NamedTuple):
    """Result of an execution.

    Attributes:
        outcome: Code of the result.
        sentence: The result in words.
        reason: Verdict code of the cause; None if there is no cause to report.
    """

    outcome: Outcome
    sentence: str
    reason: Verdict | None = None


@dataclass
class Execution:
    """A goal, and its plan that the arm has confirmed.

    Attributes:
        pending_goal: Record of the goal.
        replan: Plan with the command that the arm has confirmed.
        target: Place to which the plan leads: the goal, or a place a little ahead of a moving goal.
        settings: Settings of the plan. A later goal at the same place may take over the plan only
            if it has the same settings object.
        dropped_since: Time at which the arm was first found to have dropped the plan [ns], and the
            result if no reason is reported. None while the arm follows the plan.
        distances: Times since the plan's end [ns] and distances of the measured tip from the goal
            [m], in time order. Pairs that no longer count for the arrival are removed.
    """

    pending_goal: PendingGoal
    replan: Replan
    target: Goal
    settings: Settings
    dropped_since: tuple[int, ExecutionResult] | None = None
    distances: deque[tuple[int, float]] = field(default_factory=deque)

    @property
    def ends_at_goal(self) -> bool:
        """True if the plan ends at the goal, not a little beyond the place of a moving goal."""
        return self.target.is_at_same_position(self.pending_goal.goal)

    def judge(
        self, machine: Machine, arm_state: ArmState, now_ns: int, *, is_last: bool = False
    ) -> ExecutionResult | None:
        """Judge by the arm's reports whether and how the execution has ended.

        The first of these cases that applies decides:

        - The reference comes from several publishers: `ABORTED`, but not before the plan's end.
        - The arm executes another plan: `REPLACED`.
        - The arm has begun to hold more than `EARLY_NS` before the plan's end: it has dropped the
          plan. If it reports a fault, the outcome is `ABORTED` at once. Otherwise the place of the
          reference decides between `STOPPED` and `ABORTED`; the result is returned `REASON_NS`
          later.
        - The plan has ended: the distances of the measured tip from the goal decide.

        An arm that does not report which plan it executes is assumed to follow this plan. The
        method writes `dropped_since` and `distances`.

        Args:
            machine: Machine from which the tip position is computed.
            arm_state: Arm state.
            now_ns: Time of plans [ns]: the arm's clock minus the delay that speed scaling has
                caused.
            is_last: True if the result is needed now: after the plan's end, the distances so far
                then decide.

        Returns:
            Outcome, sentence and cause; None while the execution goes on.
        """
        end_ns = self.replan.command.trajectory.end_ns
        if arm_state.publisher_conflict:
            unknown = ExecutionResult(
                Outcome.ABORTED, f"where the arm is is not known: {arm_state.publisher_conflict}"
            )
            return unknown if now_ns >= end_ns else None
        if arm_state.plan_in_force_ns not in (None, NO_PLAN, self.replan.command.stamp_ns):
            return ExecutionResult(Outcome.REPLACED, "the arm follows another plan")
        if arm_state.plan_in_force_ns != NO_PLAN:
            self.dropped_since = None
        elif self.dropped_since is not None or now_ns < end_ns - EARLY_NS:
            return self._judge_dropped_plan(arm_state, now_ns)
        if now_ns < end_ns:
            return None
        return self._judge_arrival(machine, arm_state, now_ns - end_ns, is_last)

    def _judge_dropped_plan(self, arm_state: ArmState, now_ns: int) -> ExecutionResult | None:
        """Judge how the execution ends if the arm holds before the plan's end.

        If the arm reports a fault, the execution is aborted at once. Otherwise the first call
        chooses the result (`_judge_by_reference`) and stores it with the time in `dropped_since`.
        The stored result is returned when `REASON_NS` have passed since the first call.

        Args:
            arm_state: Arm state.
            now_ns: Time of plans [ns]: the arm's clock minus the delay that speed scaling has
                caused.

        Returns:
            Outcome, sentence and cause. None while the arm may still report a fault as the reason.
        """
        if arm_state.fault:
            return ExecutionResult(Outcome.ABORTED, arm_state.fault, Verdict.FAULT)
        if self.dropped_since is None:
            self.dropped_since = now_ns, self._judge_by_reference(arm_state, now_ns)
        since_ns, ending = self.dropped_since
        return ending if now_ns - since_ns >= REASON_NS else None

    def _judge_by_reference(self, arm_state: ArmState, now_ns: int) -> ExecutionResult:
        """Judge by the arm's reference whether the arm was stopped, or was restarted elsewhere.

        Args:
            arm_state: Arm state. Only `reference` is read.
            now_ns: Time of plans [ns]: the arm's clock minus the delay that speed scaling has
                caused.

        Returns:
            `STOPPED` if the reference of every joint is within `SAME_PLACE` of the plan's position
            at `now_ns`. `ABORTED` otherwise, or if there is no reference.
        """
        planned = self.replan.command.trajectory.sample(now_ns).position
        heard = arm_state.reference
        if heard is not None and np.abs(heard.state.position - planned).max() < SAME_PLACE:
            return ExecutionResult(Outcome.STOPPED, "the arm was stopped before the goal")
        return ExecutionResult(Outcome.ABORTED, "the arm no longer follows the plan")

    def _judge_arrival(
        self, machine: Machine, arm_state: ArmState, since_ns: int, is_last: bool
    ) -> ExecutionResult | None:
        """Judge after the plan's end whether the measured tip stays at the goal or in its region.

        The check begins one dead time of the machine after the plan's end. From then on the tip
        must stay within `reached_tolerance` of the settings for `STAY_TIME_NS` plus
        `STAY_DEAD_TIMES` dead times. So a tip that only passes the goal does not count as arrived.
        If joint states were never measured, the goal counts as reached. The method writes
        `distances`.

        Args:
            machine: Machine from which the tip position is computed.
            arm_state: Arm state. Only `measured` is read.
            since_ns: Time since the plan's end, in the time of plans [ns].
            is_last: True if the arrival is judged now, by the distances so far. It has no effect
                within one dead time after the plan's end.

        Returns:
            None while the arrival is undecided. `REACHED` as soon as the tip has stayed long
            enough. The check ends when `compute_settling_time` has passed since the plan's end. The
            largest distance within the required time before now then decides between `REACHED` and
            `ABORTED`.
        """
        dead_ns = round(compute_dead_time(machine) * SECOND_NS)
        if since_ns < dead_ns:
            return None
        if arm_state.measured is None:
            return ExecutionResult(
                Outcome.REACHED,
                "the plan has ended; no joint_states came, so the tip was not measured",
            )
        options, distances = self.settings.options, self.distances
        position = arm_state.measured.state.position
        goal = self.pending_goal.goal.position
        distances.append((since_ns, options.distance_to_goal(machine, goal, position)))
        begin_ns = since_ns - STAY_TIME_NS - round(STAY_DEAD_TIMES * dead_ns)
        while len(distances) > 1 and distances[1][0] <= begin_ns:
            distances.popleft()
        largest = max(distance for _, distance in distances)
        is_near = largest <= self.settings.reached_tolerance
        has_stayed = is_near and distances[0][0] <= begin_ns
        is_over = is_last or since_ns >= round(compute_settling_time(machine) * SECOND_NS)
        if not has_stayed and not is_over:
            return None
        where = "goal" if options.goal_region is None else "goal's region"
        sentence = f"the tip is {1e3 * largest:.2f} mm from the {where}"
        return ExecutionResult(Outcome.REACHED if is_near else Outcome.ABORTED, sentence)
