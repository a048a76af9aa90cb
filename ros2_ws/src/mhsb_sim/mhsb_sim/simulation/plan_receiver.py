"""Receiving plans: pair each trajectory with its mode schedule, and apply only what continues.

The two halves of a plan come as separate messages with the same stamp, in any order. A complete
pair is applied only if, at the arm's own now, the new trajectory equals the present reference;
anything else is refused or dropped. Of every stamp one report is made, whatever else comes of it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mhsb_model.arm_reports import HandOverOutcome, HandOverReason, HandOverReport
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import modules_in_use, pattern_name
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory

LARGEST_JUMP = 1e-6
"""Of the reference at a hand-over [rad] and [rad/s]."""

PAIR_TIMEOUT = 0.5
"""Wall-clock time [s] that half a pair waits for the other half."""

LARGEST_LEAD = 0.5
"""How far ahead of the arm's time [s] a plan may be stamped; it waits until then."""

LIMIT_TOLERANCE = 1e-6
"""By which a trajectory may pass a joint limit [rad], for rounding."""

REMEMBERED = 64
"""Stamps whose report has been made, and of which nothing more is said."""

NEVER_NS = 2**63 - 1


class PlanTarget(Protocol):
    """What plans are handed to; `Simulator` is one."""

    @property
    def plan_time_ns(self) -> int:
        """Its own now by which plans are followed, ns; its clock is ahead where they are slowed."""
        ...

    @property
    def planned(self) -> MotionState:
        """What is followed now, at the pace of the plan."""
        ...

    def reference_at(self, time_ns: int) -> MotionState | None:
        """What was followed at an earlier time of plans, None where that is forgotten."""
        ...

    def set_plan(self, trajectory: Trajectory, schedule: ModeSchedule) -> None:
        """Follow a plan from now on."""
        ...


@dataclass
class Pair:
    """A plan, or what has come of it so far; `received` is when its first half came, wall [s]."""

    stamp_ns: int
    received: float
    trajectory: Trajectory | None = None
    schedule: ModeSchedule | None = None

    @property
    def due_ns(self) -> int:
        """When it can be handed over: its stamp where it is complete."""
        complete = self.trajectory is not None and self.schedule is not None
        return self.stamp_ns if complete else NEVER_NS


class PlanReceiver:
    """Collects halves of plans and hands complete pairs that continue the reference to a target.

    due_ns  when `update` has a plan to hand over, in the target's time of plans; its clock is never
            behind that; looked at in every step
    """

    def __init__(self, machine: Machine, target: PlanTarget) -> None:
        self._machine = machine
        self._target = target
        self._fault = ""
        self.forget()

    def forget(self) -> None:
        """As if nothing had ever come: the target's time begins anew, from now."""
        self._told: deque[int] = deque(maxlen=REMEMBERED)
        self._last_stamp_ns = -1
        self._void_until_ns = self._target.plan_time_ns - 1
        self._void_because = HandOverReason.RESET
        self._wait_for(None)

    def void(
        self, event: str, reason: HandOverReason = HandOverReason.STOPPED
    ) -> list[HandOverReport]:
        """Let no plan take effect that is stamped up to now, whether it has come or not.

        event: what has happened, such as `the arm was stopped`.
        """
        self._void_until_ns, self._void_because = self._target.plan_time_ns, reason
        return self._drop(reason, f"{event} before it could be applied")

    def close(self, fault: str) -> list[HandOverReport]:
        """Refuse what waits and all that comes, for this reason, until `open`."""
        self._fault = fault
        return self._drop(HandOverReason.FAULT, fault)

    def open(self) -> None:
        """Take plans again, if they are made from now on."""
        self._fault = ""
        self._void_until_ns = self._target.plan_time_ns
        self._void_because = HandOverReason.RESET

    def add_trajectory(self, trajectory: Trajectory, wall: float) -> list[HandOverReport]:
        """Take in a trajectory received at the wall-clock time `wall` [s]."""
        problem = trajectory_problem(self._machine, trajectory)
        pair, reports = self._pair_for(trajectory.stamp_ns, problem, wall)
        if pair is not None and pair.trajectory is None:
            pair.trajectory = trajectory
            self._wait_for(pair)
        return reports

    def add_schedule(self, schedule: ModeSchedule, wall: float) -> list[HandOverReport]:
        """Take in a mode schedule received at the wall-clock time `wall` [s]."""
        problem = schedule_problem(self._machine, schedule)
        pair, reports = self._pair_for(schedule.stamp_ns, problem, wall)
        if pair is not None and pair.schedule is None:
            pair.schedule = schedule
            self._wait_for(pair)
        return reports

    def add_unusable(self, stamp_ns: int, problem: str, wall: float) -> list[HandOverReport]:
        """A half that cannot be read, for the reason `problem`."""
        return self._pair_for(stamp_ns, problem, wall)[1]

    def update(self, wall: float) -> list[HandOverReport]:
        """Hand over a complete pair whose time has come; drop half a pair that waited too long."""
        pair = self._pending
        if pair is None:
            return []
        if self._target.plan_time_ns >= self.due_ns:
            self._wait_for(None)
            return [self._hand_over(pair)]
        if self.due_ns < NEVER_NS or wall - pair.received <= PAIR_TIMEOUT:
            return []
        missing = "trajectory" if pair.trajectory is None else "mode schedule"
        reason = f"its {missing} did not come within {PAIR_TIMEOUT:g} s"
        return self._drop(HandOverReason.INCOMPLETE, reason)

    def _pair_for(
        self, stamp: int, problem: str | None, wall: float
    ) -> tuple[Pair | None, list[HandOverReport]]:
        """The pair that a half belongs to, None where it is not to be kept; and what it causes."""
        pending = self._pending
        if stamp in self._told:
            return None, []
        if pending is not None and pending.stamp_ns == stamp:
            if problem is None:
                return pending, []
            self._wait_for(None)
            return None, [self._tell(stamp, HandOverReason.INVALID, problem)]
        refusal = self._refusal(stamp, problem)
        if refusal is not None:
            return None, [self._tell(stamp, *refusal)]
        dropped = self._drop(HandOverReason.NEWER, "a newer plan came before it could be applied")
        return Pair(stamp, wall), dropped

    def _refusal(self, stamp: int, problem: str | None) -> tuple[HandOverReason, str] | None:
        """Why the first half of a plan is not kept, or None."""
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
        if ahead > LARGEST_LEAD:
            return HandOverReason.STAMP, (
                f"it is stamped {ahead:.3f} s ahead of the arm's time, at most {LARGEST_LEAD:g} s "
                "is allowed; go by the stamps of `reference`"
            )
        return None

    def _wait_for(self, pair: Pair | None) -> None:
        self._pending = pair
        self.due_ns = NEVER_NS if pair is None else pair.due_ns

    def _hand_over(self, pair: Pair) -> HandOverReport:
        trajectory, schedule = pair.trajectory, pair.schedule
        assert trajectory is not None
        assert schedule is not None
        jump = jump_between(self._target.planned, trajectory.sample(self._target.plan_time_ns))
        if max(jump) <= LARGEST_JUMP:
            self._target.set_plan(trajectory, schedule)
            self._last_stamp_ns = pair.stamp_ns
            reason, text = HandOverReason.NONE, f"it continues the reference within {_text(jump)}"
        else:
            reason, text = self._why_not(trajectory, jump)
        return self._tell(pair.stamp_ns, reason, text, jump=jump)

    def _why_not(
        self, trajectory: Trajectory, jump: tuple[float, float]
    ) -> tuple[HandOverReason, str]:
        """Whether a trajectory was on the reference at its stamp, and came too late, or never."""
        stamp = trajectory.stamp_ns
        then = self._target.reference_at(stamp)
        at_stamp = (0.0, 0.0) if then is None else jump_between(then, trajectory.sample(stamp))
        allowed = f"at most {LARGEST_JUMP:g} is allowed"
        if max(at_stamp) > LARGEST_JUMP:
            return HandOverReason.JUMP, (
                f"it does not continue the reference: at its stamp it is {_text(at_stamp)} away "
                f"from it, {allowed}; plan from `reference`"
            )
        late = (self._target.plan_time_ns - stamp) / SECOND_NS
        return HandOverReason.LATE, (
            f"it came too late, {late:.3f} s after its stamp: the reference has left the curve "
            f"that both share and is {_text(jump)} away, {allowed}; plan further ahead"
        )

    def _drop(self, reason: HandOverReason, text: str) -> list[HandOverReport]:
        """Forget the pair that waits, if there is one."""
        pair = self._pending
        if pair is None:
            return []
        self._wait_for(None)
        return [self._tell(pair.stamp_ns, reason, text, outcome=HandOverOutcome.DROPPED)]

    def _tell(
        self,
        stamp: int,
        reason: HandOverReason,
        text: str,
        outcome: HandOverOutcome | None = None,
        jump: tuple[float, float] = (np.nan, np.nan),
    ) -> HandOverReport:
        """The one report of a plan; outcome: by the reason applied or refused, unless given."""
        self._told.append(stamp)
        if outcome is None:
            applied = reason is HandOverReason.NONE
            outcome = HandOverOutcome.APPLIED if applied else HandOverOutcome.REFUSED
        sentence = f"plan {stamp / SECOND_NS:.3f} s was {outcome}: {text}"
        return HandOverReport(outcome, sentence, stamp, *jump, reason)


def jump_between(old: MotionState, new: MotionState) -> tuple[float, float]:
    """max |new − old| of positions [rad] and of velocities [rad/s]."""
    return (
        float(np.max(np.abs(new.position - old.position))),
        float(np.max(np.abs(new.velocity - old.velocity))),
    )


def trajectory_problem(machine: Machine, trajectory: Trajectory) -> str | None:
    """Why the machine cannot follow a trajectory, or None."""
    if trajectory.joint_count != machine.joint_count:
        return (
            f"its trajectory has {trajectory.joint_count} joints, "
            f"the machine has {machine.joint_count}"
        )
    if np.any(np.abs(trajectory.velocity[-1]) > LARGEST_JUMP):
        return "its trajectory does not end at rest"
    lower, upper = machine.arrays.joint_min, machine.arrays.joint_max
    excess = np.maximum(lower - trajectory.position, trajectory.position - upper)
    if np.max(excess) > LIMIT_TOLERANCE:
        j = int(np.argmax(np.max(excess, axis=0)))
        unit = machine.joint_units[j]
        return (
            f"its trajectory takes {machine.joint_names[j]} {excess[:, j].max():.3g} {unit} beyond "
            f"its limits [{lower[j]:.4g}, {upper[j]:.4g}] {unit}"
        )
    return _speed_problem(machine, trajectory)


def _speed_problem(machine: Machine, trajectory: Trajectory) -> str | None:
    """Where a joint is to move faster than the main pump's flow could ever move it, or None."""
    seconds = np.diff(trajectory.offset_ns)[:, None] / SECOND_NS
    speed = np.abs(trajectory.velocity).max(axis=0)
    if len(seconds) > 0:
        mean = np.abs(np.diff(trajectory.position, axis=0)) / seconds
        speed = np.maximum(speed, mean.max(axis=0))
    fastest = machine.fastest_joints
    if np.all(speed <= fastest):
        return None
    j = int(np.argmax(speed / fastest))
    unit = f"{machine.joint_units[j]}/s"
    return (
        f"its trajectory moves {machine.joint_names[j]} at {speed[j]:.3g} {unit}; the main pump "
        f"cannot move it faster than {fastest[j]:.3g} {unit}"
    )


def schedule_problem(machine: Machine, schedule: ModeSchedule) -> str | None:
    """Why the machine cannot obey a mode schedule, or None."""
    actuators = schedule.modes.shape[1]
    if actuators != machine.joint_count:
        return f"its mode schedule has {actuators} actuators, the machine has {machine.joint_count}"
    modules = machine.config.hydraulics.modules
    for pattern in np.unique(schedule.modes, axis=0):
        needed = modules_in_use(pattern, modules.per_mode)
        if needed > modules.count:
            return (
                f"its mode pattern {pattern_name(pattern)} needs {needed} booster modules, "
                f"{modules.count} are fitted"
            )
    return None


def _text(jump: tuple[float, float]) -> str:
    return f"{jump[0]:.3g} rad and {jump[1]:.3g} rad/s"
