"""S3: the time trajectory of a discrete path, with the mode schedule that makes it possible.

Tried in this order; the first that keeps every limit is taken, and the result says which:

1. where asked for, the published sixth-degree polynomials; from a moving start only where they do
   not run on further than coming to rest would, and keep near V_max as they are;
2. the discrete path with ramps between its speeds, ever slower ones; a moving start that coasts
   sets out along it at once;
3. from a moving start: coming to rest, and then 2;
4. the discrete path step by step, from rest to rest.

Where a mode has just been switched, 3 and 4 also after a rest in which it may be left again.
Durations are stretched until valves, servo pumps and the main pump can follow, and ramps made
slower until the pressures can; what switches an actuator too soon for that at its end rests there
for a while.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import partial
from itertools import chain
from typing import Literal, Protocol

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.errors import MhsbError
from mhsb_model.holding import HoldingError, holding_modes
from mhsb_model.kinematics import tip_position, tip_positions
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_model.trajectory import LONGEST_NS, SECOND_NS, MotionState, Trajectory, standstill
from mhsb_model.types import FloatArray, ModeArray, frozen
from mhsb_model.workspace import node_set_excess
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.motion import s3_clearance
from mhsb_planner.motion.energy import motion_energy
from mhsb_planner.motion.motion_profile import MotionProfile
from mhsb_planner.motion.overloads import Overload, overloads
from mhsb_planner.motion.ramped_motion import RampedMotion
from mhsb_planner.motion.s3_coasting import Coasting, coasting
from mhsb_planner.motion.s3_following import followed_path
from mhsb_planner.motion.s3_limits import (
    JOINT_TOLERANCE,
    Limit,
    Violation,
    first_violation,
    joint_excess,
    largest_usage,
)
from mhsb_planner.motion.s3_polynomial import fit_polynomial, node_times
from mhsb_planner.motion.s3_stepped import stepped_path
from mhsb_planner.motion.s4_mode_schedule import StartModes, SwitchingRules
from mhsb_planner.motion.scheduled_motion import ScheduledMotion
from mhsb_planner.motion.trajectory_points import SmoothCurve, joined, sampled_trajectory
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics

SHORTEST_MOVE = 0.5
"""Shortest duration of a polynomial [s]."""

SAME_POSTURE = 1e-9  # rad, rounding

START_NOISE = 0.01
"""A start this far outside the limits [rad, m] is taken as measurement noise on a valid one: its
motion returns inside and stays there."""

USAGE_RESERVE = 1.003
"""Durations are stretched by this much more than the points need, for what lies between them."""

THRUST_STRETCH = 1.25
"""By so much a motion is stretched for which pressure lacks: inertia then falls by a third."""

ROUNDS = 8
"""Times that a curve is stretched before it is given up."""

LONGEST_MOTION = LONGEST_NS / SECOND_NS - 10.0
"""What an arm takes, less the longest prefix in which a plan repeats the one before [s]."""

FITTING = "making a trajectory of the path"

TrajectoryKind = Literal["polynomial", "followed"]
"""How S3 begins: with the published polynomials, or with the discrete path followed."""

TRAJECTORY_KINDS: tuple[TrajectoryKind, ...] = ("polynomial", "followed")


class FitMethod(StrEnum):
    """How the trajectory was made of the discrete path."""

    POLYNOMIAL = "polynomial"
    RAMPED = "ramped"
    STEPPED = "stepped"
    BRAKING = "braking"


class Curve(SmoothCurve, Protocol):
    """A joint motion with the times at which the discrete path's nodes are due."""

    @property
    def node_time(self) -> FloatArray:
        """When the path's nodes are due, float64[k + 1] s."""


@dataclass(frozen=True)
class FitRules:
    """What a fit may do.

    trajectory   whether the published polynomials are tried, or the path is followed at once
    switching    how modes are switched
    slowness     factors on the duration of the shortest ramps, in the order tried
    max_stretch  largest factor on the discrete path's durations
    max_excess   largest |v|/V_max − 1 of a piston
    overrun      m, by which a piston may run on beyond what braking and the path need
    least_duration  s, that the discrete path takes at least
    """

    trajectory: TrajectoryKind = "polynomial"
    switching: SwitchingRules = field(default_factory=SwitchingRules)
    slowness: tuple[float, ...] = (1.0, 1.4, 2.0, 2.8, 4.0, 8.0)
    max_stretch: float = 3.0
    max_excess: float = 0.1
    overrun: float = 2e-3
    least_duration: float = 0.0

    @classmethod
    def following(cls) -> FitRules:
        """Rules for a motion that follows its path, within V_max but for rounding."""
        return cls("followed", max_excess=1.001 * USAGE_RESERVE - 1.0)


class FitError(MhsbError):
    """No trajectory along the discrete path keeps every limit; `refused` says why not."""

    def __init__(self, refused: tuple[str, ...]) -> None:
        self.refused = refused
        super().__init__(f"no motion along the path keeps every limit; {refused[-1]}")


@dataclass(frozen=True, eq=False)
class FittedMotion:
    """A trajectory and its mode schedule, both with stamp 0, and how they came about.

    method           what the part after braking is
    braked           whether it begins with braking
    stretch          factor on the discrete path's durations
    speed_excess     greatest |v|/V_max − 1 of a piston; negative where V_max is kept
    tip_deviation    m, greatest distance of the tip from a node when that node is due
    joint_deviation  rad, likewise of a joint
    refused          one sentence for each curve that was tried before
    overloads        what rests under more than the highest boost can carry
    """

    trajectory: Trajectory
    schedule: ModeSchedule
    method: FitMethod
    braked: bool
    stretch: float
    speed_excess: float
    tip_deviation: float
    joint_deviation: float
    refused: tuple[str, ...] = ()
    overloads: tuple[Overload, ...] = ()


def fit_trajectory(
    machine: Machine,
    path: DiscretePath,
    start: MotionState,
    modes: StartModes,
    brake: Trajectory | Coasting | None = None,
    rules: FitRules | None = None,
    deadline: Deadline = NEVER,
) -> FittedMotion:
    """Trajectory and mode schedule from `start` along a discrete path, at rest at its end.

    modes  in force at the start
    brake  for a moving start: how it comes to rest, by coasting (`s3_coasting`) or on its old way
           (`mhsb_model.braking`); the path begins where it does, and at `start` itself where
           there is none

    Raises ValueError where start, brake and path do not meet, FitError where no curve keeps every
    limit or the modules are too few to hold the arm at its end, DeadlineError where none does in
    time.
    """
    coast = brake if isinstance(brake, Coasting) else None
    if isinstance(brake, Coasting):
        brake = brake.trajectory
    if brake is not None and brake.duration_ns == 0:
        brake = None
    _check_meeting(path, start, brake)
    _check_holding(machine, path.posture[-1])
    limits, machine = machine.arrays, _admitting(machine, start.position)
    rules = rules or FitRules()
    refused: list[str] = []
    least = rules.least_duration / float(np.sum(path.duration))
    lacked = False
    for kind in _candidates(machine, path, start, brake, coast, modes, rules):
        if kind.for_thrust and not lacked:
            continue
        candidate = replace(kind, stretch=max(kind.stretch, least))
        outcome = _stretched(machine, limits, path, modes, candidate, rules, deadline)
        if isinstance(outcome, FittedMotion):
            return replace(outcome, refused=tuple(refused))
        refused.append(f"{candidate.name}: {outcome}")
        lacked = isinstance(outcome, Violation) and outcome.limit == Limit.THRUST
    raise FitError(tuple(refused))


def fit_braking(
    machine: Machine, brake: Trajectory, modes: StartModes, rules: FitRules | None = None
) -> FittedMotion:
    """Braking alone, as a motion with its mode schedule; for stopping."""
    rules, motion = rules or FitRules(), brake.shifted(-brake.stamp_ns)
    scheduled = ScheduledMotion.of(machine, motion, modes, None, rules.switching)
    trajectory, profile = scheduled.trajectory, scheduled.profile
    return FittedMotion(
        trajectory,
        scheduled.schedule,
        FitMethod.BRAKING,
        braked=True,
        stretch=1.0,
        speed_excess=_speed_excess(machine, profile),
        tip_deviation=0.0,
        joint_deviation=0.0,
        overloads=overloads(machine, trajectory.offset_ns / SECOND_NS, profile),
    )


def warm_up(machine: Machine) -> None:
    """Compile every kernel of S3, S4 and the energy: the first plan then is as fast as others."""
    arrays = machine.arrays
    middle = 0.5 * (arrays.joint_min + arrays.joint_max)
    posture = np.array([middle, 0.99 * middle + 0.01 * arrays.joint_max])
    normal = np.zeros((1, machine.joint_count), dtype=np.uint8)
    nothing = np.zeros(1)
    path = DiscretePath(
        tip=np.array([machine.tip_position(q) for q in posture]),
        posture=posture,
        modes=normal,
        duration=np.ones(1),
        energy=nothing,
        energy_series=nothing,
        cost=0.0,
        start_modes=normal[0],
        lower_bound=0.0,
        statistics=SearchStatistics(0, 0, 0.0),
    )
    start, modes, rules = MotionState.at_rest(middle), StartModes.settled(normal[0]), FitRules()
    coast = coasting(machine, MotionState(middle, 0.1 * middle, middle))
    following = FitRules.following()
    for candidate in chain(
        _candidates(machine, path, start, None, None, modes, rules),
        _candidates(machine, path, start, coast.trajectory, coast, modes, following),
    ):
        motion = _stretched(machine, machine.arrays, path, modes, candidate, rules, NEVER)
        if isinstance(motion, FittedMotion):
            motion_energy(machine, motion.trajectory, motion.schedule)
    with suppress(FitError):
        fit_trajectory(machine, path, MotionState.at_rest(path.posture[0]), modes)
    s3_clearance.warm_up(machine)


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A kind of curve, and how it is tried.

    lead_in      what comes before it
    stretch      the first one
    furthest     how far joints may go, where that is looked at
    coasts       whether it begins with coasting
    stretchable  limits for which it is stretched, rather than refused
    longest      largest factor on the first stretch; None: that of the rules
    for_thrust   whether it is tried only where the one before lacks pressure
    """

    method: FitMethod
    name: str
    curve_at: Callable[[float], Curve]
    start: MotionState
    lead_in: Trajectory | None = None
    stretch: float = 1.0
    furthest: FloatArray | None = None
    coasts: bool = False
    stretchable: tuple[Limit, ...] = (Limit.USAGE, Limit.THRUST)
    longest: float | None = None
    for_thrust: bool = False


def _check_meeting(path: DiscretePath, start: MotionState, brake: Trajectory | None) -> None:
    if len(path.duration) == 0:
        raise ValueError("a path without steps needs no trajectory")
    if brake is None and (start.velocity.any() or start.acceleration.any()):
        raise ValueError("a moving start needs a braking motion")
    if brake is not None and not _same(brake.position[0], start.position):
        raise ValueError("the braking motion must begin at the start")
    first = start.position if brake is None else brake.position[-1]
    if not _same(path.posture[0], first):
        raise ValueError("the path must begin where the start comes to rest")


def _check_holding(machine: Machine, posture: FloatArray) -> None:
    try:
        holding_modes(machine, machine.piston_forces(posture))
    except HoldingError as error:
        raise FitError((str(error),)) from None


def _same(one: FloatArray, other: FloatArray) -> bool:
    return bool(np.max(np.abs(one - other)) <= SAME_POSTURE)


def _admitting(machine: Machine, posture: FloatArray) -> Machine:
    """The machine, its limits widened to a start that noise has put a little outside of them."""
    arrays = machine.arrays
    x, z = tip_position(arrays.link_length, posture)
    beyond, outside = float(joint_excess(arrays, posture)), node_set_excess(arrays, x, z)
    if max(beyond, outside) <= 0.0 or beyond > START_NOISE or outside > START_NOISE:
        return machine
    radius = math.hypot(x, z)
    widened = arrays._replace(
        joint_min=frozen(np.minimum(arrays.joint_min, posture)),
        joint_max=frozen(np.maximum(arrays.joint_max, posture)),
        min_x=min(arrays.min_x, x),
        min_radius=min(arrays.min_radius, radius),
        max_radius=max(arrays.max_radius, radius),
    )
    return replace(machine, arrays=widened)


def _candidates(
    machine: Machine,
    path: DiscretePath,
    start: MotionState,
    brake: Trajectory | None,
    coast: Coasting | None,
    modes: StartModes,
    rules: FitRules,
) -> Iterator[_Candidate]:
    rest = MotionState.at_rest(path.posture[0])
    if rules.trajectory == "polynomial":
        yield _polynomial(path, start, brake)
    if coast is not None:
        yield from _ramped(machine, path, start, None, coast, rules.slowness)
    youngest = rules.switching.min_dwell - float(modes.age.min())
    lead_ins = [("", brake)]
    if youngest > 0.0:
        waited = (brake or standstill(start.position)).rested(round(youngest * SECOND_NS))
        lead_ins.append(("after a rest, ", waited))
    for words, lead_in in lead_ins:
        yield from _ramped(machine, path, rest, lead_in, None, rules.slowness, words)
        stepped = partial(stepped_path, machine, path)
        yield _Candidate(FitMethod.STEPPED, f"{words}stepped", stepped, rest, lead_in)


def _ramped(
    machine: Machine,
    path: DiscretePath,
    start: MotionState,
    lead_in: Trajectory | None,
    coast: Coasting | None,
    slowness: tuple[float, ...],
    words: str = "",
) -> Iterator[_Candidate]:
    """The path followed with ever slower ramps; from rest the slowest are stretched as well."""
    words = words if coast is None else "setting out at once, "
    for slower in slowness:
        last = coast is None and slower == slowness[-1]
        yield _Candidate(
            FitMethod.RAMPED,
            f"{words}with ramps {slower:g} times the shortest",
            partial(followed_path, machine, path, slower, coast),
            start,
            lead_in,
            coasts=coast is not None,
            for_thrust=slower != slowness[0],
            stretchable=(Limit.USAGE, Limit.THRUST) if last else (Limit.USAGE,),
        )


def _polynomial(path: DiscretePath, start: MotionState, brake: Trajectory | None) -> _Candidate:
    """The published curve; from a moving start it is not stretched."""
    shortest = max(1.0, SHORTEST_MOVE / float(node_times(path)[-1]))
    if brake is None:
        rest = MotionState.at_rest(path.posture[0])
        return _Candidate(
            FitMethod.POLYNOMIAL,
            "polynomial",
            lambda stretch: fit_polynomial(path, rest, 0.0, stretch),
            rest,
            stretch=shortest,
        )
    delay = brake.duration_ns / SECOND_NS / 2
    return _Candidate(
        FitMethod.POLYNOMIAL,
        "polynomial from the moving start",
        lambda stretch: fit_polynomial(path, start, delay, stretch),
        start,
        stretch=shortest,
        furthest=_furthest(start, np.vstack([brake.position, path.posture])),
        longest=1.0,
    )


def _stretched(
    machine: Machine,
    limits: MachineArrays,
    path: DiscretePath,
    modes: StartModes,
    candidate: _Candidate,
    rules: FitRules,
    deadline: Deadline,
) -> FittedMotion | Violation | str:
    """The candidate's motion, stretched as far as its limits ask; or why there is none.

    The machine admits the start, `limits` are those to which a joint beyond them has to return.
    """
    lead_in, stretch = candidate.lead_in, candidate.stretch
    for _ in range(ROUNDS):
        deadline.check(FITTING)
        curve = candidate.curve_at(stretch)
        if not curve.breaks[-1] <= LONGEST_MOTION:
            return f"it takes {curve.breaks[-1]:.4g} s, at most {LONGEST_MOTION:g} s is allowed"
        if isinstance(curve, RampedMotion) and not curve.gentle:
            return "pistons would have to speed up or slow down faster than allowed"
        trajectory, first = sampled_trajectory(curve, candidate.start, path.posture[-1]), 0
        if lead_in is not None:
            trajectory, first = joined(lead_in, trajectory), len(lead_in.offset_ns) - 1
        deadline.check(FITTING)
        position = trajectory.position[first:]
        beyond = _going_out(limits, position)
        if beyond > JOINT_TOLERANCE:
            return f"a joint limit is passed by {beyond:.3g} rad"
        if candidate.furthest is not None:
            overrun = _overrun(machine, candidate.start, position, candidate.furthest)
            if overrun > rules.overrun:
                return f"a piston runs on by {1000 * overrun:.3g} mm more than braking takes"
        time = trajectory.offset_ns / SECOND_NS
        preferred = _preferred(path, curve.node_time, time, first)
        scheduled = ScheduledMotion.of(machine, trajectory, modes, preferred, rules.switching)
        if not scheduled.keeps_dwell:
            return f"an actuator is switched twice within {rules.switching.min_dwell:g} s"
        trajectory, profile = scheduled.trajectory, scheduled.profile
        after = profile[first:]
        fastest = 1.0 + rules.max_excess
        if candidate.coasts:  # what is too fast already becomes slower, but not by stretching
            fastest = max(fastest, USAGE_RESERVE * (1.0 + _speed_excess(machine, profile[:1])))
        quasi_static = (1.0 + _speed_excess(machine, after)) / fastest
        used = max(largest_usage(machine, after, scheduled.intervals[first:]), quasi_static)
        deadline.check(FITTING)
        needed = USAGE_RESERVE * used
        if needed <= 1.0:
            schedule = scheduled.schedule
            violation = first_violation(machine, trajectory, schedule, profile, deadline)
            if violation is None:
                return _fitted(
                    machine, path, candidate, curve, trajectory, schedule, profile, stretch
                )
            if violation.limit not in candidate.stretchable or violation.time < time[first]:
                return violation
            if violation.limit == Limit.THRUST:
                needed = THRUST_STRETCH
            else:
                needed = USAGE_RESERVE * (1.0 + violation.amount)
        stretch *= needed
        if stretch > (candidate.longest or rules.max_stretch) * candidate.stretch:
            return f"V_max, valves and pumps would take a duration {stretch:.3g} times the path's"
    return "stretching it did not bring it within what valves and pumps can do"


def _going_out(limits: MachineArrays, position: FloatArray) -> float:
    """How far a joint goes beyond its limits [rad], other than where it comes back from beyond."""
    excess = np.maximum(limits.joint_min - position, position - limits.joint_max)
    before = np.minimum.accumulate(np.maximum(excess, 0.0), axis=0)
    return float((excess - before).max())


def _preferred(
    path: DiscretePath, node_time: FloatArray, time: FloatArray, first: int
) -> ModeArray:
    """The discrete path's modes at the points; N during a lead-in of `first` points."""
    step = np.searchsorted(node_time, time - time[first], "right") - 1
    modes = path.modes[np.clip(step, 0, len(path.modes) - 1)]
    modes[:first] = Mode.N
    return modes


def _furthest(start: MotionState, position: FloatArray) -> FloatArray:
    """How far each joint gets in the direction of its first velocity, float64[n] rad."""
    return np.max(np.sign(start.velocity) * (position - start.position), axis=0)


def _overrun(
    machine: Machine, start: MotionState, position: FloatArray, furthest: FloatArray
) -> float:
    """By how much a piston runs further in its first direction than it has to [m]."""
    beyond = _furthest(start, position) - furthest
    return float(np.max(beyond * np.abs(machine.moment_arms(start.position))))


def _fitted(
    machine: Machine,
    path: DiscretePath,
    candidate: _Candidate,
    curve: Curve,
    trajectory: Trajectory,
    schedule: ModeSchedule,
    profile: MotionProfile,
    stretch: float,
) -> FittedMotion:
    at_nodes = curve.sample(curve.node_time)[0]
    tips = tip_positions(machine.arrays.link_length, at_nodes)
    return FittedMotion(
        trajectory,
        schedule,
        candidate.method,
        candidate.lead_in is not None,
        stretch,
        _speed_excess(machine, profile),
        float(np.max(np.hypot(*(tips - path.tip).T))),
        float(np.max(np.abs(at_nodes - path.posture))),
        overloads=overloads(machine, trajectory.offset_ns / SECOND_NS, profile),
    )


def _speed_excess(machine: Machine, profile: MotionProfile) -> float:
    return float(np.max(np.abs(profile.speed))) / machine.arrays.max_piston_speed - 1.0
