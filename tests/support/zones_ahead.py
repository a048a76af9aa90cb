"""Random zones set ahead of a moving arm, and a check that the arm does what was announced.

An arm in a `LockStepWorld` moves to a random goal. On its way a zone is set at a place that its tip
has yet to pass. The last sentence about the zone is compared with the motion of the reference.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import numpy as np
from benchmarks.lock_step import LockStepWorld

from mhsb_model.command import Command
from mhsb_model.machine import Machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray
from mhsb_model.verdict import Verdict
from mhsb_planner.cases.moves import draw_random_position
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.online.settings import Settings

ZONE_SIZE_RANGE = (0.02, 0.1)
"""Range of half the size of a zone, as shares of the arm's reach."""

SLOW_TRANSPORT = 0.3
"""Largest transport time of a command to a busy arm [s]."""

MOST_LOST = 2
"""Largest number of commands that get lost in a trial; a third command that brakes is still taken.
"""

DEPTH_RESOLUTION = 1e-3
"""Resolution of depths in sentences [m]: whole millimetres."""

DEPTH_SAMPLING_ERROR = 5e-3
"""Largest error of a sampled greatest depth [m].

A tip that passes a zone at 1 m/s is sampled every 5 mm, so half of that may be missed on each side.
"""


PROMISES_NOTHING = "the arm took no command that brakes"
"""Beginning of the sentence on an arm that continues to its goal or is stopped by itself."""


@dataclass(frozen=True)
class ZoneTrial:
    """Announcements about a zone ahead of a moving arm, and what the arm's reference did.

    Attributes:
        sentences: Sentences about the zone that the lifecycle logged, in time order.
        ending: Sentence of the goal's execution report.
        deepest: Least clearance of the reference after the zone was set [m]; its negative is the
            depth in the zone.
        rest: Clearance in the posture in which the reference came to rest [m].
        left: Time from the setting of the zone to the planned end of the motion [s].
        set_ns: Absolute time at which the zone was set [ns].
        crowded: The machine with the zone.
        sent: Commands of the goal's plan and commands that brake, in time order.
    """

    sentences: tuple[str, ...]
    ending: str
    deepest: float
    rest: float
    left: float
    set_ns: int
    crowded: Machine = field(repr=False)
    sent: tuple[Command, ...] = field(repr=False)

    @property
    def stops_before(self) -> bool:
        """True if the arm never touched the zone."""
        return self.deepest > 0.0

    @property
    def is_announcement_true(self) -> bool:
        """True if the last sentence about the zone says what the arm did.

        A stated place of rest must match `rest` within DEPTH_RESOLUTION, a stated greatest depth
        `deepest` within DEPTH_SAMPLING_ERROR. Without a sentence it is true if the arm never
        touched the zone. If the sentence says that the arm took no command that brakes, the
        execution report must not repeat the first sentence. An unknown sentence counts as false.
        """
        if not self.sentences:
            return self.stops_before
        said = self.sentences[-1]
        if said.startswith(PROMISES_NOTHING):
            return self.ending != self.sentences[0]
        if said.endswith("the arm stops before it"):
            return self.stops_before
        if found := re.search(r"its reference rests ([\d.]+ m?m) before it", said):
            return (
                self.stops_before and abs(self.rest - read_distance(found[1])) <= DEPTH_RESOLUTION
            )
        if found := re.search(r"comes to rest ([\d.]+ m?m) deep in it", said):
            return (
                self.rest < DEPTH_RESOLUTION
                and abs(self.rest + read_distance(found[1])) <= DEPTH_RESOLUTION
            )
        if self.stops_before and "already" in said:
            return False
        if found := re.search(r"beyond it, having been ([\d.]+ m?m) deep in it", said):
            return (
                self.rest >= 0.0
                and abs(self.deepest + read_distance(found[1])) <= DEPTH_SAMPLING_ERROR
            )
        if said.endswith("comes to rest beyond it"):
            return self.rest >= 0.0
        return False


def read_distance(text: str) -> float:
    """Read a distance that `format_distance` wrote, such as "9.8 mm" [m]."""
    number, unit = text.split()
    return float(number) * {"m": 1.0, "mm": 1e-3}[unit]


def random_trial(
    machine: Machine,
    replanner: Replanner,
    settings: Settings,
    random: np.random.Generator,
    *,
    busy: bool,
) -> ZoneTrial:
    """Move to a random goal and set a random zone on the way.

    A goal without a plan, or a zone that cannot be set, is drawn again, together with everything
    else. The zone is set at a random time of the motion. The replanner is left with a machine of
    the trial.

    Args:
        machine: The arm without the random zone.
        replanner: Plans for it.
        settings: Settings of the lifecycle.
        random: Source of random numbers for goal, times, zone and transport.
        busy: Whether commands are slow and up to MOST_LOST of them get lost after the zone is set.

    Returns:
        The sentences about the zone, and what the reference did.
    """
    while True:
        replanner.change_machine(machine)
        world = LockStepWorld(machine, replanner, settings)
        stamp = world.send_goal(*draw_random_position(machine, random))
        if world.verdict(stamp).code is not Verdict.OK:
            continue
        motion = _wait_for_motion(world)
        world.pass_time(random.uniform(0.0, 0.95) * motion.duration_ns / SECOND_NS)
        zones = random_zone(machine, motion, world.arm.time_ns, random)
        if zones is not None:
            break
    if busy:
        world.transport = random.uniform(0.002, SLOW_TRANSPORT)
        world.lost = int(random.integers(0, MOST_LOST + 1))
    return _run_trial(world, settings, machine.changed(zones=zones), stamp)


def _wait_for_motion(world: LockStepWorld) -> Trajectory:
    """Let time pass until the arm moves, and return the motion in force.

    Args:
        world: The world.

    Returns:
        The trajectory of the command in force.
    """
    world.pass_time_until(lambda: world.arm.is_moving)
    return world.arm.command.trajectory


def _run_trial(world: LockStepWorld, settings: Settings, crowded: Machine, stamp: int) -> ZoneTrial:
    """Set the zones and let time pass until the arm rests and the lifecycle is idle.

    The clearance of the reference is recorded in each time step.

    Args:
        world: The world with a moving arm.
        settings: Settings of the lifecycle before.
        crowded: The machine with the zones.
        stamp: Stamp of the goal that the arm moves to.

    Returns:
        The sentences about the zone, and what the reference did.
    """
    end_ns, now_ns = world.arm.command.trajectory.end_ns, world.arm.time_ns
    said = len(world.warnings)
    world.life.change_settings(replace(settings, machine=crowded))
    clearances = [crowded.clearance(world.arm.reference.position)[0]]

    def record_and_test_rest() -> bool:
        """Record the reference's clearance and return whether arm and lifecycle are at rest."""
        clearances.append(crowded.clearance(world.arm.reference.position)[0])
        return world.is_idle and not world.arm.is_moving

    world.pass_time_until(record_and_test_rest)
    sentences = [each for each in world.warnings[said:] if "keep-out" in each]
    return ZoneTrial(
        tuple(sentences),
        world.execution_report(stamp).sentence,
        min(clearances),
        clearances[-1],
        (end_ns - now_ns) / SECOND_NS,
        now_ns,
        crowded,
        tuple(world.sent),
    )


def random_zone(
    machine: Machine, motion: Trajectory, now_ns: int, random: np.random.Generator
) -> Zones | None:
    """Draw a random zone around a place that the tip has yet to pass.

    It is a box or a round zone, for the whole arm or for the tip alone. Its half size is in
    ZONE_SIZE_RANGE.

    Args:
        machine: The arm.
        motion: Its motion in force.
        now_ns: Absolute time at which the zone is set [ns].
        random: Source of random numbers for place, kind and size.

    Returns:
        The set of zones with this one zone. None if the motion is over, the zone is not allowed
        there, or the arm is already nearer to it than the margin.
    """
    if motion.end_ns <= now_ns:
        return None
    at_ns = now_ns + round(random.uniform(0.02, 1.0) * (motion.end_ns - now_ns))
    centre = np.asarray(machine.tip_in_base(motion.sample(at_ns).position))
    half = random.uniform(*ZONE_SIZE_RANGE) * machine.config.workspace.max_radius
    round_kind = "spheres" if machine.slews else "circles"
    kind = round_kind if random.random() < 0.5 else "boxes"
    values = _zone_numbers(centre, half, kind)
    name = kind if random.random() < 0.5 else f"tip_{kind}"
    zones = Zones(**{name: (values,)})
    try:
        crowded = machine.changed(zones=zones)
    except ValueError:  # zones at joint 1 are not allowed
        return None
    here = motion.sample(now_ns).position
    return zones if crowded.clearance(here)[0] > machine.config.keep_out.margin else None


def _zone_numbers(centre: FloatArray, half: float, kind: str) -> tuple[float, ...]:
    """Return the numbers that describe a zone around a point.

    Args:
        centre: Centre in `base_link`, shape (2,) or (3,) [m].
        half: Radius, or half the edge of a box [m].
        kind: "boxes", or any other kind for a circle or sphere.

    Returns:
        Lower and upper corner of a box, or centre and radius [m].
    """
    if kind == "boxes":
        return (*(centre - half).tolist(), *(centre + half).tolist())
    return (*centre.tolist(), half)
