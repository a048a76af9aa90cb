"""Braking for a zone that is set ahead of the moving arm.

The arm brakes along its path. The softest braking is chosen that comes to rest before the zone, at
least the margin away from it. If there is none, the braking within the machine's limits with the
greatest clearance is chosen, usually the hardest. A sentence for log and report says where the arm
comes to rest. Absolute times are in the time of plans: the arm's clock minus the delay that speed
scaling has caused.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mhsb_model.braking import brake_along
from mhsb_model.command import Command
from mhsb_model.goal import format_distance
from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import clearances
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray, IntArray, frozen
from mhsb_planner.motion.limits.obstacles import OBSTACLE_LIMIT
from mhsb_planner.motion.s3_clearance import find_contact_ahead
from mhsb_planner.motion.s3_hard_braking import iterate_harder_brakings
from mhsb_planner.motion.s3_limits import find_first_violation
from mhsb_planner.motion.s3_trajectory import fit_braking
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.online.command_joining import choose_hand_over_times, join_commands

LOOK_NS = 2_000_000
"""Time between the postures at which clearances are measured [ns]."""

CLEARANCE_DIGITS = 4
"""Number of decimals to which compared clearances [m] are rounded: 0.1 mm.

So numerical differences have no effect.
"""


@dataclass(frozen=True, eq=False)
class ZoneStop:
    """Command that brakes for an obstacle ahead, with its clearances.

    Attributes:
        command: Command that first repeats the motion in force, and then brakes along its path.
        change_ns: Absolute time at which the command begins to brake [ns].
        touches_obstacle: True if the arm touches an obstacle during the command, or is in an
            obstacle at the command's stamp.
        passed_clearance: Least clearance of the old motion, from the time at which the obstacle was
            set to the command's stamp [m]. Negative inside an obstacle, like all clearances.
        begin_clearance: Clearance at the command's stamp [m].
        least_clearance: Least clearance during the command [m].
        rest_clearance: Clearance in the posture in which the arm comes to rest [m].
        nearest_obstacle: Name of the obstacle that is nearest in this posture.
        margin: Clearance that motions should keep [m].
    """

    command: Command
    change_ns: int
    touches_obstacle: bool
    passed_clearance: float
    begin_clearance: float
    least_clearance: float
    rest_clearance: float
    nearest_obstacle: str
    margin: float

    @classmethod
    def measure(
        cls,
        machine: Machine,
        command: Command,
        change_ns: int,
        previous_motion: Trajectory,
        since_ns: int,
    ) -> "ZoneStop":
        """Measure the clearances of a braking command among the machine's obstacles.

        Clearances are sampled every `LOOK_NS`.

        Args:
            machine: Machine with the zones in force.
            command: Command that brakes.
            change_ns: Time at which the command begins to brake [ns].
            previous_motion: Trajectory that was in force before this command.
            since_ns: Time at which the obstacle was set, by the clock of the stamps [ns].

        Returns:
            The command with its clearances.
        """
        motion = command.trajectory
        clearance, row = _compute_clearances(machine, motion, motion.stamp_ns, motion.end_ns)
        until_ns = max(since_ns, motion.stamp_ns)
        passed = float(_compute_clearances(machine, previous_motion, since_ns, until_ns)[0].min())
        begin, nearest, rest = float(clearance[0]), float(clearance.min()), float(clearance[-1])
        contact = begin < 0.0 or find_contact_ahead(machine, motion, motion.stamp_ns) is not None
        beside, margin = machine.obstacles.name(row[-1]), machine.config.keep_out.margin
        return cls(command, change_ns, contact, passed, begin, nearest, rest, beside, margin)

    @property
    def keeps_margin(self) -> bool:
        """True if the arm touches no obstacle, and keeps the margin from all obstacles at rest."""
        return not self.touches_obstacle and self.rest_clearance >= self.margin

    @property
    def rank(self) -> tuple[float, float]:
        """Sort key of braking commands; the greatest key is the best command.

        The key is the least clearance during the command, then the clearance at rest [m], both
        rounded to `CLEARANCE_DIGITS` decimals.
        """
        return round(self.least_clearance, CLEARANCE_DIGITS), round(
            self.rest_clearance, CLEARANCE_DIGITS
        )

    def describe(self, obstacle: str) -> str:
        """Describe where the arm comes to rest, for the log and the execution report.

        The first case that applies is stated:

        - The arm touches nothing and has already passed the obstacle.
        - It touches nothing and stops before the obstacle.
        - It stops nearer to the obstacle than the margin. Distance and margin are stated.
        - It was in an obstacle at the command's stamp. The sentence has the depth at rest, or says
          that the arm rests beyond the obstacle.
        - It cannot stop before the obstacle. The depth at rest is stated. If it rests beyond the
          obstacle, the greatest depth on the way is stated.

        Args:
            obstacle: Name of the obstacle that the motion in force meets.

        Returns:
            A sentence without a full stop.
        """
        if not self.touches_obstacle and self.passed_clearance < 0.0:
            return (
                f"{obstacle} was set across the way; the arm has passed it already "
                "and comes to rest beyond it"
            )
        if not self.touches_obstacle and (self.keeps_margin or self.nearest_obstacle != obstacle):
            return f"{obstacle} was set across the way; the arm stops before it"
        if not self.touches_obstacle:
            return (
                f"{obstacle} was set across the way; the arm stops at its edge: its reference "
                f"rests {format_distance(self.rest_clearance)} before it, nearer than the margin "
                f"of {format_distance(self.margin)}"
            )
        where = (
            "beyond it"
            if self.rest_clearance >= 0.0
            else f"{format_distance(-self.rest_clearance)} deep in it"
        )
        if self.begin_clearance < 0.0:
            return (
                f"{obstacle} was set across the way; the arm is in it already "
                f"and comes to rest {where}"
            )
        if self.rest_clearance >= 0.0:
            deepest = format_distance(max(0.0, -self.least_clearance))
            where = f"{where}, having been {deepest} deep in it"
        return (
            f"{obstacle} was set across the way; the arm stops as soon as it can, "
            f"but not before it: it comes to rest {where}"
        )


def make_braking_for_obstacle(
    machine: Machine, in_force: Command, now_ns: int, commit_horizon: float, since_ns: int
) -> ZoneStop:
    """Make the command that brakes along the path in force for an obstacle ahead.

    The result is the softest braking that touches no obstacle and comes to rest at least the
    machine's margin away from all obstacles. If there is none, brakings are compared by their least
    clearance on the way. The one with the greatest value is taken, usually the hardest. If several
    are equal, the clearance at rest decides.

    Args:
        machine: Machine with the zones in force.
        in_force: Command that the arm executes; it still moves.
        now_ns: Earliest stamp of the result, in the time of plans [ns].
        commit_horizon: Time from the stamp to the beginning of braking [s]. The result repeats
            `in_force` during this time.
        since_ns: Time at which the obstacle was set, in the time of plans [ns]. `passed_clearance`
            of the result is measured from this time to the stamp. If this clearance is negative
            and the arm is clear at the stamp, the arm has passed the obstacle.

    Returns:
        The command with its clearances.
    """
    times = choose_hand_over_times(in_force, now_ns, round(commit_horizon * SECOND_NS))
    tried = []
    for brake in _generate_brakings(machine, in_force, times.change_ns):
        command = join_commands(in_force, times, brake)
        stop = ZoneStop.measure(machine, command, times.change_ns, in_force.trajectory, since_ns)
        if stop.keeps_margin:
            return stop
        tried.append(stop)
    return max(tried, key=lambda stop: stop.rank)


def _generate_brakings(machine: Machine, in_force: Command, at_ns: int) -> Iterator[Command]:
    """Yield braking commands along the path of a motion, the softest first.

    The first command brakes as in a usual stop and is not checked. The others brake ever harder,
    until one would break a limit of the machine. Obstacles do not count as limits.

    Args:
        machine: Machine with its limits.
        in_force: Command that is braked.
        at_ns: Time at which braking begins, by the clock of the command's stamp [ns].

    Yields:
        Commands that begin at `at_ns`.
    """
    modes = StartModes.read_from(in_force.schedule, at_ns)
    soft = fit_braking(machine, brake_along(machine, in_force.trajectory, at_ns), modes)
    yield Command(soft.trajectory, soft.schedule)
    for brake in iterate_harder_brakings(machine, in_force.trajectory, at_ns):
        hard = fit_braking(machine, brake, modes)
        command = Command(hard.trajectory, hard.schedule)
        broken = find_first_violation(machine, command.trajectory, command.schedule)
        if broken is not None and broken.limit is not OBSTACLE_LIMIT:
            return
        yield command


def _compute_clearances(
    machine: Machine, motion: Trajectory, from_ns: int, until_ns: int
) -> tuple[FloatArray, IntArray]:
    """Compute clearances along a stretch of a motion, every `LOOK_NS` and at both ends.

    Args:
        machine: Machine with the zones in force.
        motion: The motion.
        from_ns: Beginning of the stretch, by the clock of the motion's stamp [ns].
        until_ns: End of the stretch, not before its beginning [ns].

    Returns:
        Clearance at each of k samples, negative inside an obstacle, float64[k], [m], and row of the
        nearest obstacle in `machine.obstacles` at each sample, int64[k].
    """
    at_ns = np.append(np.arange(from_ns, until_ns, LOOK_NS), until_ns)
    postures = frozen(motion.sample_many(at_ns)[0])
    return clearances(machine.arrays, machine.obstacles.rows, postures)
