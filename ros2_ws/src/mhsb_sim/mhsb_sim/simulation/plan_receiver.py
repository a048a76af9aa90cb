"""Receiving plans: pair each trajectory with its mode schedule, and apply only what continues.

The two halves of a plan come as separate messages with the same stamp. A complete pair is
applied only if, at the simulator's own now, the new trajectory equals the present reference;
anything else is refused or dropped with one sentence.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import modules_in_use, pattern_name
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory

LARGEST_JUMP = 1e-6
"""Of the reference at a hand-over [rad] and [rad/s]."""

PAIR_TIMEOUT = 0.5
"""Wall-clock time [s] that half a pair waits for the other half."""

LARGEST_LEAD = 0.5
"""How far ahead of the simulator's clock [s] a plan may be stamped; it waits until then."""

LIMIT_TOLERANCE = 1e-6
"""By which a trajectory may pass a joint limit [rad], for rounding."""


class OutcomeKind(StrEnum):
    """What became of a plan or of half a plan."""

    APPLIED = "applied"
    REFUSED = "refused"
    DROPPED = "dropped"


@dataclass(frozen=True)
class Outcome:
    """What became of the plan `stamp_ns`, in one sentence.

    The jumps are max |new − old| of the reference at the instant of the hand-over, in rad and
    rad/s; NaN where it did not come to comparing them.
    """

    kind: OutcomeKind
    stamp_ns: int
    sentence: str
    position_jump: float = float("nan")
    velocity_jump: float = float("nan")


class PlanTarget(Protocol):
    """What plans are handed to; `Simulator` is one."""

    @property
    def time_ns(self) -> int:
        """Its own now, ns."""
        ...

    @property
    def reference(self) -> MotionState:
        """What is followed now."""
        ...

    def set_plan(self, trajectory: Trajectory, schedule: ModeSchedule) -> None:
        """Follow a plan from now on."""
        ...


class PlanReceiver:
    """Collects halves of plans and applies complete pairs that continue the reference."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self.clear()

    def clear(self) -> None:
        """Forget everything: after a reset or a backward clock."""
        self._trajectory: Trajectory | None = None
        self._schedule: ModeSchedule | None = None
        self._received = 0.0
        self._last_stamp_ns = -1

    def add_trajectory(self, trajectory: Trajectory, wall: float) -> list[Outcome]:
        """Take in a trajectory received at the wall-clock time `wall` [s]."""
        problem = trajectory_problem(self._machine, trajectory)
        outcomes, fresh = self._take_in(trajectory.stamp_ns, problem, wall)
        if fresh:
            self._trajectory = trajectory
        return outcomes

    def add_schedule(self, schedule: ModeSchedule, wall: float) -> list[Outcome]:
        """Take in a mode schedule received at the wall-clock time `wall` [s]."""
        problem = schedule_problem(self._machine, schedule)
        outcomes, fresh = self._take_in(schedule.stamp_ns, problem, wall)
        if fresh:
            self._schedule = schedule
        return outcomes

    def update(self, target: PlanTarget, wall: float) -> list[Outcome]:
        """Hand over a complete pair whose time has come; drop half a pair that waited too long."""
        stamp = self._pending_stamp_ns
        if stamp is None:
            return []
        if self._trajectory is None or self._schedule is None:
            if wall - self._received <= PAIR_TIMEOUT:
                return []
            missing = "trajectory" if self._trajectory is None else "mode schedule"
            self._forget_pending()
            return [_dropped(stamp, f"its {missing} did not come within {PAIR_TIMEOUT:g} s")]
        lead = (stamp - target.time_ns) / SECOND_NS
        if lead > LARGEST_LEAD:
            self._forget_pending()
            return [_refused(stamp, f"it is stamped {lead:.3f} s ahead of the clock")]
        if lead > 0.0:
            return []
        outcome = self._hand_over(target, self._trajectory, self._schedule)
        self._forget_pending()
        return [outcome]

    def _take_in(self, stamp: int, problem: str | None, wall: float) -> tuple[list[Outcome], bool]:
        """Outcomes that a half with this stamp causes, and whether it is to be kept."""
        pending = self._pending_stamp_ns
        newest = max(self._last_stamp_ns, -1 if pending is None else pending - 1)
        if stamp <= newest:
            return [_refused(stamp, "its stamp is not newer than that of the plan before")], False
        if problem is not None:
            return [_refused(stamp, problem)], False
        outcomes = []
        if pending is not None and pending != stamp:
            self._forget_pending()
            outcomes.append(_dropped(pending, "a newer plan came before it could be applied"))
        if self._pending_stamp_ns is None:
            self._received = wall
        return outcomes, True

    @property
    def _pending_stamp_ns(self) -> int | None:
        half = self._trajectory or self._schedule
        return None if half is None else half.stamp_ns

    def _forget_pending(self) -> None:
        self._trajectory = None
        self._schedule = None

    def _hand_over(
        self, target: PlanTarget, trajectory: Trajectory, schedule: ModeSchedule
    ) -> Outcome:
        stamp = trajectory.stamp_ns
        self._last_stamp_ns = stamp
        old, new = target.reference, trajectory.sample(target.time_ns)
        position_jump = float(np.max(np.abs(new.position - old.position)))
        velocity_jump = float(np.max(np.abs(new.velocity - old.velocity)))
        jumps = f"{position_jump:.3g} rad and {velocity_jump:.3g} rad/s"
        if position_jump > LARGEST_JUMP or velocity_jump > LARGEST_JUMP:
            late = (target.time_ns - stamp) / SECOND_NS
            sentence = (
                f"it came too late, {late:.3f} s after its stamp: it is {jumps} away from the "
                f"reference, at most {LARGEST_JUMP:g} is allowed"
            )
            kind = OutcomeKind.REFUSED
        else:
            target.set_plan(trajectory, schedule)
            sentence = f"it continues the reference within {jumps}"
            kind = OutcomeKind.APPLIED
        text = f"plan {_seconds(stamp)} was {kind}: {sentence}"
        return Outcome(kind, stamp, text, position_jump, velocity_jump)


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
        return (
            f"its trajectory takes {machine.joint_names[j]} {excess[:, j].max():.3g} rad beyond "
            f"its limits [{lower[j]:.4g}, {upper[j]:.4g}] rad"
        )
    return None


def schedule_problem(machine: Machine, schedule: ModeSchedule) -> str | None:
    """Why the machine cannot obey a mode schedule, or None."""
    actuators = schedule.modes.shape[1]
    if actuators != machine.joint_count:
        return f"its mode schedule has {actuators} actuators, the machine has {machine.joint_count}"
    modules = machine.config.hydraulics.modules
    for pattern in schedule.modes:
        needed = modules_in_use(pattern, modules.per_mode)
        if needed > modules.count:
            return (
                f"its mode pattern {pattern_name(pattern)} needs {needed} booster modules, "
                f"{modules.count} are fitted"
            )
    return None


def _refused(stamp: int, reason: str) -> Outcome:
    return Outcome(OutcomeKind.REFUSED, stamp, f"plan {_seconds(stamp)} was refused: {reason}")


def _dropped(stamp: int, reason: str) -> Outcome:
    return Outcome(OutcomeKind.DROPPED, stamp, f"plan {_seconds(stamp)} was dropped: {reason}")


def _seconds(stamp: int) -> str:
    return f"{stamp / SECOND_NS:.3f} s"
