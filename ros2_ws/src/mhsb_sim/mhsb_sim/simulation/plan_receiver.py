"""Receiver of plans: pairs each trajectory with its mode schedule, and applies continuous plans.

The trajectory and the mode schedule of a plan come as two messages with the same stamp, in any
order. A complete pair is applied only if the new trajectory equals the present reference at the
arm's present time. Other plans are refused or dropped. Each stamp gets exactly one report.
"""

from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mhsb_model.arm_reports import HandOverOutcome, HandOverReason, HandOverReport
from mhsb_model.command import MAX_HAND_OVER_JUMP
from mhsb_model.feasibility.curve_check import describe_curve_problem
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import count_modules, format_pattern
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory

PAIR_TIMEOUT = 0.5
"""Real time for which a trajectory or mode schedule waits for the other message of its plan [s]."""

MAX_STAMP_ADVANCE = 0.5
"""Largest time by which a plan may be stamped ahead of the arm's time [s]; it waits until then."""

REPORTED_STAMP_CAPACITY = 64
"""Number of recent stamps that are remembered as reported; further messages of them are ignored."""

NEVER_NS = 2**63 - 1
"""Time that never comes [ns]."""


class PlanTarget(Protocol):
    """Interface that an arm needs so that plans can be handed over to it; `Simulator` has it."""

    @property
    def plan_time_ns(self) -> int:
        """Time of plans [ns]: simulated time minus the delay that speed scaling has caused."""

    @property
    def planned(self) -> MotionState:
        """State of the plan in force at the present time of plans.

        Velocity and acceleration are those at full speed: speed scaling does not reduce them.
        """

    def reference_at(self, time_ns: int) -> MotionState | None:
        """Return the reference at an earlier time.

        Args:
            time_ns: Time of plans [ns]: simulated time minus the delay that speed scaling has
                caused.

        Returns:
            The state; None if that time is no longer recorded.
        """

    def set_plan(self, trajectory: Trajectory, schedule: ModeSchedule) -> None:
        """Follow a plan from now on.

        Args:
            trajectory: Trajectory of the plan.
            schedule: Mode schedule of the plan.
        """


@dataclass
class PendingPlan:
    """A plan that waits for its second message or for its hand-over.

    Attributes:
        stamp_ns: Stamp of the plan [ns].
        received: Time of the steady clock at which its first message came [s].
        trajectory: Its trajectory, None until it comes.
        schedule: Its mode schedule, None until it comes.
    """

    stamp_ns: int
    received: float
    trajectory: Trajectory | None = None
    schedule: ModeSchedule | None = None

    @property
    def due_ns(self) -> int:
        """Time from which on the plan can be handed over [ns].

        It is the plan's stamp if both messages have come, else NEVER_NS. It is a time of plans:
        simulated time minus the delay that speed scaling has caused.
        """
        complete = self.trajectory is not None and self.schedule is not None
        return self.stamp_ns if complete else NEVER_NS


class PlanReceiver:
    """Pairs the messages of plans, and hands over complete plans that continue the reference.

    Attributes:
        due_ns: Time from which on `update` has a plan to hand over [ns]; NEVER_NS if no complete
            plan waits. It is a time of plans: simulated time minus the delay that speed scaling has
            caused.
    """

    def __init__(self, machine: Machine, target: PlanTarget) -> None:
        """Prepare the receiver of an arm, without a plan.

        Plans that are stamped before the present time of the target are refused.

        Args:
            machine: The machine; plans must keep its limits.
            target: The arm that plans are handed over to.
        """
        self._machine = machine
        self._target = target
        self._fault = ""
        self.reset()

    def reset(self) -> None:
        """Forget all plans and reports, because the simulated arm's time starts again.

        From now on, plans with a stamp before the target's plan time at this call are refused. A
        fault that `close` has set stays.
        """
        self._reported_stamps: deque[int] = deque(maxlen=REPORTED_STAMP_CAPACITY)
        self._last_stamp_ns = -1
        self._void_until_ns = self._target.plan_time_ns - 1
        self._void_because = HandOverReason.RESET
        self._set_pending(None)

    def invalidate_plans(
        self, event: str, reason: HandOverReason = HandOverReason.STOPPED
    ) -> list[HandOverReport]:
        """Refuse all plans with stamps up to the present time, also if they arrive later.

        A plan that waits to be handed over is dropped.

        Args:
            event: Clause that names the cause, such as "the arm was stopped", for the report.
            reason: Reason code in the reports on these plans.

        Returns:
            Report on the plan that was waiting; an empty list if there was none.
        """
        self._void_until_ns, self._void_because = self._target.plan_time_ns, reason
        return self._drop_pending(reason, f"{event} before it could be applied")

    def close(self, fault: str) -> list[HandOverReport]:
        """Refuse all plans until `open` is called, and drop the waiting plan.

        Args:
            fault: Sentence that describes the fault, for the reports.

        Returns:
            Report on the plan that was waiting; an empty list if there was none.
        """
        self._fault = fault
        return self._drop_pending(HandOverReason.FAULT, fault)

    def open(self) -> None:
        """Take plans again after `close`.

        Plans are stamped with simulated time minus the delay that speed scaling has caused. Only
        plans with stamps later than the present are taken. Other plans are refused, with the reason
        RESET in their reports.
        """
        self._fault = ""
        self._void_until_ns = self._target.plan_time_ns
        self._void_because = HandOverReason.RESET

    @property
    def awaits_message(self) -> bool:
        """True if only one of the two messages of the waiting plan has come."""
        return self._pending is not None and self.due_ns == NEVER_NS

    def add_trajectory(self, trajectory: Trajectory, wall: float) -> list[HandOverReport]:
        """Receive the trajectory of a plan, and store it until `update` hands the plan over.

        A trajectory is ignored if its plan has a report already, or has another usable trajectory.
        If the trajectory is unusable, for instance because it breaks a limit, the plan is refused.

        Args:
            trajectory: The trajectory with its stamp.
            wall: Present time of the steady clock [s].

        Returns:
            A report on this plan if it is refused. Otherwise, if an older plan was still waiting
            for its hand-over, a report that the older plan is dropped. Else an empty list.
        """
        problem = find_trajectory_problem(self._machine, trajectory)
        pair, reports = self._find_pending_plan(trajectory.stamp_ns, problem, wall)
        if pair is not None and pair.trajectory is None:
            pair.trajectory = trajectory
            self._set_pending(pair)
        return reports

    def add_schedule(self, schedule: ModeSchedule, wall: float) -> list[HandOverReport]:
        """Receive the mode schedule of a plan, and store it until `update` hands the plan over.

        The schedule is ignored if its plan has a report already, or has another usable schedule. If
        the schedule is unusable, for instance because it needs too many booster modules, the plan
        is refused.

        Args:
            schedule: The mode schedule with its stamp.
            wall: Present time of the steady clock [s].

        Returns:
            A report on this plan if it is refused. Otherwise, if an older plan was still waiting
            for its hand-over, a report that the older plan is dropped. Else an empty list.
        """
        problem = find_schedule_problem(self._machine, schedule)
        pair, reports = self._find_pending_plan(schedule.stamp_ns, problem, wall)
        if pair is not None and pair.schedule is None:
            pair.schedule = schedule
            self._set_pending(pair)
        return reports

    def add_unusable(self, stamp_ns: int, problem: str, wall: float) -> list[HandOverReport]:
        """Refuse a plan because one of its two messages cannot be read.

        Args:
            stamp_ns: Stamp of the plan [ns].
            problem: Clause that says why it cannot be read.
            wall: Present time of the steady clock [s].

        Returns:
            Report on the plan; an empty list if its stamp has a report already.
        """
        return self._find_pending_plan(stamp_ns, problem, wall)[1]

    def update(self, wall: float) -> list[HandOverReport]:
        """Hand over a complete plan that is due, or drop a plan whose second message is overdue.

        A complete plan is due as soon as the target's time of plans has reached the plan's stamp.
        The second message is overdue `PAIR_TIMEOUT` after the first.

        Args:
            wall: Present time of the steady clock [s].

        Returns:
            Report on the plan that was handed over, refused or dropped; an empty list without one.
        """
        pair = self._pending
        if pair is None:
            return []
        if self._target.plan_time_ns >= self.due_ns:
            self._set_pending(None)
            return [self._hand_over(pair)]
        if self.due_ns < NEVER_NS or wall - pair.received <= PAIR_TIMEOUT:
            return []
        missing = "trajectory" if pair.trajectory is None else "mode schedule"
        reason = f"its {missing} did not come within {PAIR_TIMEOUT:g} s"
        return self._drop_pending(HandOverReason.INCOMPLETE, reason)

    def _find_pending_plan(
        self, stamp: int, problem: str | None, wall: float
    ) -> tuple[PendingPlan | None, list[HandOverReport]]:
        """Find or create the plan to which a message (trajectory or mode schedule) belongs.

        The first of these cases decides:

        1. The stamp has a report already: the message is ignored.
        2. The message belongs to the waiting plan. If the message cannot be used, the plan is
           refused and removed.
        3. The message begins a new plan that `_find_refusal` refuses, because of a fault, `problem`
           or the stamp.
        4. The message begins a new plan. An older plan that waits is dropped. The caller must store
           the new plan.

        Args:
            stamp: Stamp of the message [ns].
            problem: Clause that says why this message cannot be used; None if it can.
            wall: Time of the steady clock at which the message came [s]; stored in a new plan.

        Returns:
            The plan (None if the message is not kept), and a report on each plan that was refused
            or dropped. The stamps of these plans count as reported from now on.
        """
        pending = self._pending
        if stamp in self._reported_stamps:
            return None, []
        if pending is not None and pending.stamp_ns == stamp:
            if problem is None:
                return pending, []
            self._set_pending(None)
            return None, [self._build_report(stamp, HandOverReason.INVALID, problem)]
        refusal = self._find_refusal(stamp, problem)
        if refusal is not None:
            return None, [self._build_report(stamp, *refusal)]
        dropped = self._drop_pending(
            HandOverReason.NEWER, "a newer plan came before it could be applied"
        )
        return PendingPlan(stamp, wall), dropped

    def _find_refusal(self, stamp: int, problem: str | None) -> tuple[HandOverReason, str] | None:
        """Return why the first message of a plan is refused.

        The first of these reasons is returned: the arm has a fault; the message cannot be used; the
        stamp is not after the last start, stop, reset or end of a fault; the stamp is not newer
        than that of the waiting plan or of the last applied one; the stamp is too far ahead of the
        arm's time.

        Args:
            stamp: Stamp of the plan [ns].
            problem: Clause that says why this message cannot be used; None if it can.

        Returns:
            Reason code and sentence; None if the message is accepted.
        """
        newest = max(self._last_stamp_ns, self._pending.stamp_ns if self._pending else -1)
        ahead = (stamp - self._target.plan_time_ns) / SECOND_NS
        if self._fault:
            return HandOverReason.FAULT, self._fault
        if problem is not None:
            return HandOverReason.INVALID, problem
        if stamp <= self._void_until_ns:
            return self._void_because, (
                "it was made before the arm was started, stopped or reset; plan anew"
            )
        if stamp <= newest:
            return HandOverReason.STAMP, (
                "its stamp is not newer than that of the plan before; stamps must increase"
            )
        if ahead > MAX_STAMP_ADVANCE:
            return HandOverReason.STAMP, (
                f"it is stamped {ahead:.3f} s ahead of the arm's time, at most "
                f"{MAX_STAMP_ADVANCE:g} s is allowed; go by the stamps of `reference`"
            )
        return None

    def _set_pending(self, pair: PendingPlan | None) -> None:
        """Set the plan that waits, and the time of its hand-over; None: no plan waits."""
        self._pending = pair
        self.due_ns = NEVER_NS if pair is None else pair.due_ns

    def _hand_over(self, pair: PendingPlan) -> HandOverReport:
        """Apply a complete plan if it continues the reference, else refuse it.

        Position and velocity of each joint are compared between the new plan and the plan in force,
        at the present time of plans. This is simulated time minus the delay that speed scaling
        (slower execution) has caused. The new plan continues the reference if no difference exceeds
        `MAX_HAND_OVER_JUMP`. Velocities are compared at full speed, without speed scaling.

        Args:
            pair: The complete plan, which is due.

        Returns:
            Report on the plan, with the largest jumps of position [rad] and velocity [rad/s].
        """
        trajectory, schedule = pair.trajectory, pair.schedule
        assert trajectory is not None
        assert schedule is not None
        jump = compute_jump(self._target.planned, trajectory.sample(self._target.plan_time_ns))
        if max(jump) <= MAX_HAND_OVER_JUMP:
            self._target.set_plan(trajectory, schedule)
            self._last_stamp_ns = pair.stamp_ns
            reason, text = (
                HandOverReason.NONE,
                f"it continues the reference within {_format_jump(jump)}",
            )
        else:
            reason, text = self._explain_refusal(trajectory, jump)
        return self._build_report(pair.stamp_ns, reason, text, jump=jump)

    def _explain_refusal(
        self, trajectory: Trajectory, jump: tuple[float, float]
    ) -> tuple[HandOverReason, str]:
        """Find out whether a trajectory came too late, or never continued the reference.

        Args:
            trajectory: The trajectory, which is due.
            jump: Present jump of position [rad] and velocity [rad/s].

        Returns:
            Reason code and sentence. The code is JUMP if the trajectory already was off the
            reference at its own stamp. Otherwise it is LATE, also if the reference at the stamp is
            no longer recorded.
        """
        stamp = trajectory.stamp_ns
        then = self._target.reference_at(stamp)
        at_stamp = (0.0, 0.0) if then is None else compute_jump(then, trajectory.sample(stamp))
        allowed = f"at most {MAX_HAND_OVER_JUMP:g} is allowed"
        if max(at_stamp) > MAX_HAND_OVER_JUMP:
            return HandOverReason.JUMP, (
                "it does not continue the reference: at its stamp it is "
                f"{_format_jump(at_stamp)} away from it, {allowed}; plan from `reference`"
            )
        late = (self._target.plan_time_ns - stamp) / SECOND_NS
        return HandOverReason.LATE, (
            f"it came too late, {late:.3f} s after its stamp: the reference has left the curve "
            f"that both share and is {_format_jump(jump)} away, {allowed}; plan further ahead"
        )

    def _drop_pending(self, reason: HandOverReason, text: str) -> list[HandOverReport]:
        """Drop the waiting plan, if there is one.

        Args:
            reason: Reason code for the report.
            text: Clause for the report.

        Returns:
            Report on that plan; an empty list if none was waiting.
        """
        pair = self._pending
        if pair is None:
            return []
        self._set_pending(None)
        return [self._build_report(pair.stamp_ns, reason, text, outcome=HandOverOutcome.DROPPED)]

    def _build_report(
        self,
        stamp: int,
        reason: HandOverReason,
        text: str,
        outcome: HandOverOutcome | None = None,
        jump: tuple[float, float] = (np.nan, np.nan),
    ) -> HandOverReport:
        """Build the one report on a plan, and remember its stamp as reported.

        Args:
            stamp: Stamp of the plan [ns].
            reason: Reason code; NONE if the plan was applied.
            text: Clause for the report's sentence.
            outcome: The outcome. None stands for applied if the reason is NONE, else for refused.
            jump: Jump of position [rad] and velocity [rad/s]; NaN if unknown.

        Returns:
            Report with outcome, sentence, stamp, jumps and reason.
        """
        self._reported_stamps.append(stamp)
        if outcome is None:
            applied = reason is HandOverReason.NONE
            outcome = HandOverOutcome.APPLIED if applied else HandOverOutcome.REFUSED
        sentence = f"plan {stamp / SECOND_NS:.3f} s was {outcome}: {text}"
        return HandOverReport(outcome, sentence, stamp, *jump, reason)


def compute_jump(old: MotionState, new: MotionState) -> tuple[float, float]:
    """Return the largest differences of position and of velocity between two states.

    Args:
        old: First state.
        new: Second state.

    Returns:
        Largest |Δq| [rad or m] and largest |Δq̇| [rad/s or m/s] over all joints.
    """
    return (
        float(np.max(np.abs(new.position - old.position))),
        float(np.max(np.abs(new.velocity - old.velocity))),
    )


def find_trajectory_problem(machine: Machine, trajectory: Trajectory) -> str | None:
    """Return why the machine cannot follow a trajectory.

    Three things are checked: the number of joints, rest at the end (within `MAX_HAND_OVER_JUMP`),
    and the machine's limits along the curve (`describe_curve_problem`).

    Args:
        machine: The machine.
        trajectory: The trajectory.

    Returns:
        A clause that describes the first problem; None if the machine can follow the trajectory.
    """
    if trajectory.joint_count != machine.joint_count:
        return (
            f"its trajectory has {trajectory.joint_count} joints, "
            f"the machine has {machine.joint_count}"
        )
    if np.any(np.abs(trajectory.velocity[-1]) > MAX_HAND_OVER_JUMP):
        return "its trajectory does not end at rest"
    return describe_curve_problem(machine, trajectory)


def find_schedule_problem(machine: Machine, schedule: ModeSchedule) -> str | None:
    """Return why the machine cannot execute a mode schedule.

    Two things are checked: the number of actuators, and whether the machine has the booster modules
    that each mode combination needs.

    Args:
        machine: The machine.
        schedule: The mode schedule.

    Returns:
        A clause that describes the first problem; None if the machine can execute the schedule.
    """
    actuators = schedule.modes.shape[1]
    if actuators != machine.joint_count:
        return f"its mode schedule has {actuators} actuators, the machine has {machine.joint_count}"
    modules = machine.config.hydraulics.modules
    for pattern in np.unique(schedule.modes, axis=0):
        needed = count_modules(pattern, modules.per_mode)
        if needed > modules.count:
            return (
                f"its mode pattern {format_pattern(pattern)} needs {needed} booster modules, "
                f"{modules.count} are fitted"
            )
    return None


def _format_jump(jump: tuple[float, float]) -> str:
    """Return the jumps of position and velocity as text for a person."""
    return f"{jump[0]:.3g} rad and {jump[1]:.3g} rad/s"
