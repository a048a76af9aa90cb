"""Random zones that are set ahead of a moving arm, and whether it does what it then says.

An arm in a `World` goes to a random goal. On its way a zone is set at a place that its tip still
has to pass. The sentence that is given last is compared with where the reference goes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import numpy as np

from mhsb_model.command import Command
from mhsb_model.machine import Machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray
from mhsb_model.verdict import Verdict
from mhsb_planner.evaluation.lock_step import World
from mhsb_planner.evaluation.moves import anywhere
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.online.settings import Settings

SIZES = (0.02, 0.1)
"""Half the size of a zone, as shares of the arm's reach."""

SLOW_TRANSPORT = 0.3
"""A command takes up to so long to a busy arm [s]."""

MOST_LOST = 2
"""Commands of a trial that may get lost: a third one that brakes still is taken."""

AGREES = 1e-3
"""A sentence gives depths in whole millimetres [m]."""

PASSED = 5e-3
"""A tip that passes a zone at 1 m/s is looked at every 5 mm, so its greatest depth is missed by
half of that on each side [m]."""


PROMISES_NOTHING = "the arm took no command that brakes"
"""Begin of the sentence on an arm that goes on to its goal, or is stopped by itself."""


@dataclass(frozen=True)
class ZoneTrial:
    """What was said of a zone ahead of a moving arm, and what the arm's reference did.

    sentences  on the zone, in the order in which they were given
    ending     sentence of the goal's execution report
    deepest    least clearance after the zone was set [m], negative by the depth in it
    rest       clearance where the arm came to rest [m]
    left       time that was left of the motion when the zone was set [s]
    set_ns     absolute time at which the zone was set [ns]
    crowded    the machine with the zone
    sent       commands of the goal's plan, and those that brake, in time order
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
        """Whether the arm never touched the zone."""
        return self.deepest > 0.0

    @property
    def true(self) -> bool:
        """Whether the sentence that was given last says what the arm did."""
        if not self.sentences:
            return self.stops_before
        said = self.sentences[-1]
        if said.startswith(PROMISES_NOTHING):
            return self.ending != self.sentences[0]
        if said.endswith("the arm stops before it"):
            return self.stops_before
        if found := re.search(r"its reference rests ([\d.]+) m before it", said):
            return self.stops_before and abs(self.rest - float(found[1])) <= AGREES
        if found := re.search(r"comes to rest ([\d.]+) m deep in it", said):
            return self.rest < AGREES and abs(self.rest + float(found[1])) <= AGREES
        if self.stops_before and "already" in said:
            return False
        if found := re.search(r"beyond it, having been ([\d.]+) m deep in it", said):
            return self.rest >= 0.0 and abs(self.deepest + float(found[1])) <= PASSED
        if said.endswith("comes to rest beyond it"):
            return self.rest >= 0.0
        return False


def random_trial(
    machine: Machine,
    replanner: Replanner,
    settings: Settings,
    random: np.random.Generator,
    *,
    busy: bool,
) -> ZoneTrial:
    """Move to a random goal and set a random zone on the way.

    Args:
        machine: The arm, without zones that tests have set.
        replanner: Plans for it.
        settings: How it plans.
        random: Decides goal, times, zone and transport.
        busy: Whether commands take long, and get lost, from when the zone is set.
    """
    while True:
        replanner.change(machine)
        world = World(machine, replanner, settings)
        stamp = world.goal(*anywhere(machine, random))
        if world.verdict(stamp).code is not Verdict.OK:
            continue
        motion = _motion_of(world)
        world.pass_time(random.uniform(0.0, 0.95) * motion.duration_ns / SECOND_NS)
        zones = random_zone(machine, motion, world.arm.time_ns, random)
        if zones is not None:
            break
    if busy:
        world.transport = random.uniform(0.002, SLOW_TRANSPORT)
        world.lost = int(random.integers(0, MOST_LOST + 1))
    return _trial(world, settings, machine.changed(zones=zones), stamp)


def _motion_of(world: World) -> Trajectory:
    """Wait until the arm moves, and return the motion in force."""
    world.until(lambda: world.arm.moves)
    return world.arm.command.trajectory


def _trial(world: World, settings: Settings, crowded: Machine, stamp: int) -> ZoneTrial:
    """Set the zones of the machine `crowded`, and let time pass until the arm rests."""
    end_ns, now_ns = world.arm.command.trajectory.end_ns, world.arm.time_ns
    said = len(world.warnings)
    world.life.change(replace(settings, machine=crowded))
    clearances = [crowded.clearance(world.arm.reference.position)[0]]

    def rests() -> bool:
        clearances.append(crowded.clearance(world.arm.reference.position)[0])
        return world.life.idle and not world.arm.moves

    world.until(rests)
    sentences = [each for each in world.warnings[said:] if "keep-out" in each]
    return ZoneTrial(
        tuple(sentences),
        world.ending(stamp).sentence,
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
    """Return a random zone around a place that the tip still has to pass.

    Args:
        machine: The arm.
        motion: Its motion in force.
        now_ns: Absolute time at which the zone is set [ns].
        random: Decides place, kind and size.

    Returns:
        The zone; None if the motion is over or the arm is in the zone, or touches it, already.
    """
    if motion.end_ns <= now_ns:
        return None
    at_ns = now_ns + round(random.uniform(0.02, 1.0) * (motion.end_ns - now_ns))
    centre = np.asarray(machine.tip_in_base(motion.sample(at_ns).position))
    half = random.uniform(*SIZES) * machine.config.workspace.max_radius
    round_kind = "spheres" if machine.slews else "circles"
    kind = round_kind if random.random() < 0.5 else "boxes"
    values = _numbers(centre, half, kind)
    name = kind if random.random() < 0.5 else f"tip_{kind}"
    zones = Zones(**{name: (values,)})
    try:
        crowded = machine.changed(zones=zones)
    except ValueError:  # it lies at joint 1
        return None
    here = motion.sample(now_ns).position
    return zones if crowded.clearance(here)[0] > machine.config.keep_out.margin else None


def _numbers(centre: FloatArray, half: float, kind: str) -> tuple[float, ...]:
    """Return the numbers of a zone around a point [m], in its base's coordinates."""
    if kind == "boxes":
        return (*(centre - half).tolist(), *(centre + half).tolist())
    return (*centre.tolist(), half)
