"""A zone that is set ahead of the moving arm: whether it is met, and how the arm brakes for it.

The arm brakes along its path by the softest braking that rests before the zone; where none does,
by the hardest one that keeps the machine's limits. The sentence says where the command that is
sent comes to rest, its commit horizon included.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mhsb_model.braking import brake_along
from mhsb_model.command import Command
from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import clearances
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray, IntArray, frozen
from mhsb_planner.motion.s3_clearance import contact_ahead
from mhsb_planner.motion.s3_hard_braking import ever_harder_brakings
from mhsb_planner.motion.s3_limits import Limit, first_violation
from mhsb_planner.motion.s3_trajectory import fit_braking
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.online.hand_over import change_over, hand_over

LOOK_NS = 2_000_000
"""Spacing of the instants at which the depth in an obstacle is measured [ns]."""

DIGITS = 4
"""Clearances are compared to a tenth of a millimetre: what rounding changes decides nothing."""


@dataclass(frozen=True, eq=False)
class ZoneStop:
    """A command that brakes for an obstacle ahead, and how near it gets to it.

    command    repeats the motion in force up to the change, then brakes along its path
    change_ns  absolute time at which it begins to brake [ns]
    contact    whether it gets to an obstacle, or is in one when it begins
    passed     least clearance from when the obstacle was set until the command begins [m]
    begin      clearance where the command begins [m], negative by the depth in an obstacle
    nearest    least clearance from there on [m]
    rest       clearance where it comes to rest [m]
    beside     name of the nearest obstacle there
    margin     clearance that motions should keep [m]
    """

    command: Command
    change_ns: int
    contact: bool
    passed: float
    begin: float
    nearest: float
    rest: float
    beside: str
    margin: float

    @classmethod
    def of(
        cls, machine: Machine, command: Command, change_ns: int, before: Trajectory, since_ns: int
    ) -> ZoneStop:
        """Judge a command that brakes among the machine's obstacles.

        Args:
            machine: With the zones that hold now.
            command: What brakes.
            change_ns: Absolute time at which it begins to brake [ns].
            before: The motion that it leaves.
            since_ns: Absolute time at which the obstacle was set [ns].
        """
        motion = command.trajectory
        clearance, row = _clearances(machine, motion, motion.stamp_ns, motion.end_ns)
        until_ns = max(since_ns, motion.stamp_ns)
        passed = float(_clearances(machine, before, since_ns, until_ns)[0].min())
        begin, nearest, rest = float(clearance[0]), float(clearance.min()), float(clearance[-1])
        contact = begin < 0.0 or contact_ahead(machine, motion, motion.stamp_ns) is not None
        beside, margin = machine.obstacles.name(row[-1]), machine.config.keep_out.margin
        return cls(command, change_ns, contact, passed, begin, nearest, rest, beside, margin)

    @property
    def keeps_margin(self) -> bool:
        """Whether it touches nothing and rests the margin away from everything."""
        return not self.contact and self.rest >= self.margin

    @property
    def rank(self) -> tuple[float, float]:
        """Least clearance and that at rest, rounded [m]; the greater, the better."""
        return round(self.nearest, DIGITS), round(self.rest, DIGITS)

    def sentence(self, obstacle: str) -> str:
        """Return where the arm comes to rest, for log and execution report.

        Args:
            obstacle: Name of what the motion in force gets to.
        """
        if not self.contact and self.passed < 0.0:
            return (
                f"{obstacle} was set across the way; the arm has passed it already "
                "and comes to rest beyond it"
            )
        if not self.contact and (self.keeps_margin or self.beside != obstacle):
            return f"{obstacle} was set across the way; the arm stops before it"
        if not self.contact:
            return (
                f"{obstacle} was set across the way; the arm stops at its edge: its reference "
                f"rests {self.rest:.3f} m before it, nearer than the margin of {self.margin:g} m"
            )
        where = "beyond it" if self.rest >= 0.0 else f"{-self.rest:.3f} m deep in it"
        if self.begin < 0.0:
            return (
                f"{obstacle} was set across the way; the arm is in it already "
                f"and comes to rest {where}"
            )
        if self.rest >= 0.0:
            where = f"{where}, having been {max(0.0, -self.nearest):.3f} m deep in it"
        return (
            f"{obstacle} was set across the way; the arm stops as soon as it can, "
            f"but not before it: it comes to rest {where}"
        )


def obstacle_ahead(machine: Machine, in_force: Command, now_ns: int) -> str | None:
    """Return the name of the first obstacle that the rest of a motion gets to, None without."""
    contact = contact_ahead(machine, in_force.trajectory, now_ns)
    return None if contact is None else contact.name


def waits_for_plan(obstacle: str) -> str:
    """Return the sentence on an obstacle before a command that brakes can be sent."""
    return f"{obstacle} was set across the way; the arm brakes once it has answered the last plan"


def not_braked(obstacle: str, ending: str) -> str:
    """Return the sentence on an obstacle for which the arm took no command that brakes.

    Args:
        obstacle: Its name.
        ending: Sentence on how the stop ended.
    """
    return f"the arm took no command that brakes for {obstacle}: {ending}"


def brake_for(
    machine: Machine, in_force: Command, now_ns: int, lead: float, since_ns: int
) -> ZoneStop:
    """Make the command that brakes for an obstacle ahead.

    Args:
        machine: With the zones that hold now.
        in_force: The command that the arm executes; it still moves.
        now_ns: The arm's time, from which the command repeats the one in force [ns].
        lead: Commit horizon: time until it begins to brake [s].
        since_ns: The arm's time when the obstacle was set [ns].

    Returns:
        The softest braking that touches nothing and rests the machine's margin away from
        everything. If there is none, the one that keeps farthest away or gets least deep, as a
        rule the hardest.
    """
    times = change_over(in_force, now_ns, round(lead * SECOND_NS))
    tried = []
    for brake in _brakings(machine, in_force, times.change_ns):
        command = hand_over(in_force, times, brake)
        stop = ZoneStop.of(machine, command, times.change_ns, in_force.trajectory, since_ns)
        if stop.keeps_margin:
            return stop
        tried.append(stop)
    return max(tried, key=lambda stop: stop.rank)


def _brakings(machine: Machine, in_force: Command, at_ns: int) -> Iterator[Command]:
    """Yield brakings of a motion from `at_ns` on, the planned stop first, then ever harder ones.

    A harder one has to keep all limits but obstacles, unless the planned stop breaks one as well.
    """
    modes = StartModes.during(in_force.schedule, at_ns)
    soft = fit_braking(machine, brake_along(machine, in_force.trajectory, at_ns), modes)
    yield Command(soft.trajectory, soft.schedule)
    for brake in ever_harder_brakings(machine, in_force.trajectory, at_ns):
        hard = fit_braking(machine, brake, modes)
        command = Command(hard.trajectory, hard.schedule)
        if not _keeps_limits(machine, command):
            return
        yield command


def _keeps_limits(machine: Machine, command: Command) -> bool:
    """Return whether a motion breaks no limit, other than by getting to an obstacle."""
    broken = first_violation(machine, command.trajectory, command.schedule)
    return broken is None or broken.limit is Limit.OBSTACLE


def _clearances(
    machine: Machine, motion: Trajectory, from_ns: int, until_ns: int
) -> tuple[FloatArray, IntArray]:
    """Return clearances [m] and nearest rows along a stretch of a motion, both its ends included.

    Args:
        machine: With the zones that hold now.
        motion: The motion.
        from_ns: Absolute time of the stretch's begin [ns].
        until_ns: Absolute time of its end, not before its begin [ns].
    """
    at_ns = np.append(np.arange(from_ns, until_ns, LOOK_NS), until_ns)
    postures = frozen(motion.sample_many(at_ns)[0])
    return clearances(machine.arrays, machine.obstacles.rows, postures)
