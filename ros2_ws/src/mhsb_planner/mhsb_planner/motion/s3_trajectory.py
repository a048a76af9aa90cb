"""S3: the time trajectory of a discrete path, with the mode schedule that makes it possible.

Tried in this order; the first that keeps every limit is taken, and the result says which:

1. where asked for, the published sixth-degree polynomials; from a moving start only where they do
   not run on further than coming to rest would, and keep near V_max as they are;
2. the discrete path with ramps between its speeds, ever slower ones; a moving start that coasts
   sets out along it at once;
3. from a moving start: coming to rest, and then 2;
4. the discrete path step by step, from rest to rest.

A motion that is to end near where the plan in force ends, as that to a goal that moves, steers
straight there from its state of motion (`s3_steered`), or in none of these ways.

Where a mode has just been switched, 3 and 4 also after a rest in which it may be left again.
Durations are stretched until valves, servo pumps and the main pump can follow, and ramps made
slower until the pressures can; what switches an actuator too soon for that at its end rests there
for a while.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.errors import MhsbError
from mhsb_model.holding import HoldingError, holding_modes
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import tip_position
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import LONGEST_NS, SECOND_NS, MotionState, Trajectory
from mhsb_model.types import FloatArray, ModeArray, as_frozen, frozen
from mhsb_model.workspace import node_set_excess
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.motion import s3_clearance, s3_limits
from mhsb_planner.motion.energy import motion_energy
from mhsb_planner.motion.motion_profile import MotionProfile, Profiles
from mhsb_planner.motion.overloads import Overload, overloads
from mhsb_planner.motion.passing import first_missed
from mhsb_planner.motion.ramped_motion import RampedMotion
from mhsb_planner.motion.s3_candidates import (
    TRAJECTORY_KINDS,
    USAGE_RESERVE,
    Candidate,
    Curve,
    FitMethod,
    FitRules,
    TrajectoryKind,
    candidates,
    furthest_of,
)
from mhsb_planner.motion.s3_coasting import Coasting, coasting
from mhsb_planner.motion.s3_limits import (
    JOINT_TOLERANCE,
    EndDemands,
    Limit,
    Violation,
    first_violation,
    joint_excess,
    middle_profile,
    way_out,
)
from mhsb_planner.motion.s3_steered import Steering
from mhsb_planner.motion.s4_mode_schedule import N, StartModes, keeps_dwell
from mhsb_planner.motion.scheduled_motion import ScheduledMotion
from mhsb_planner.motion.trajectory_points import joined, sampled_trajectory
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics

__all__ = [
    "TRAJECTORY_KINDS",
    "FitError",
    "FitMethod",
    "FitRules",
    "FittedMotion",
    "TrajectoryKind",
    "fit_braking",
    "fit_rest",
    "fit_trajectory",
    "warm_up",
]

SAME_POSTURE = 1e-9  # rad, rounding

THRUST_STRETCH = 1.25
"""By so much a motion is stretched for which pressure lacks: inertia then falls by a third."""

ENOUGH = 1.0001
"""Use of limits, with its reserve, that will do where times in whole ticks do not let it sink."""

ROUNDS = 8
"""Times that a curve is stretched before it is given up."""

LONGEST_MOTION = LONGEST_NS / SECOND_NS - 10.0
"""What an arm takes, less the longest prefix in which a plan repeats the one before [s]."""

FITTING = "making a trajectory of the path"

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
    profiles         at the trajectory's points and between them, where they were looked at
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
    profiles: Profiles | None = None


def fit_trajectory(
    machine: Machine,
    path: DiscretePath,
    start: MotionState,
    modes: StartModes,
    brake: Trajectory | Coasting | Steering | None = None,
    rules: FitRules | None = None,
    deadline: Deadline = NEVER,
) -> FittedMotion:
    """Trajectory and mode schedule from `start` along a discrete path, at rest at its end.

    modes  in force at the start
    brake  for a moving start: how it comes to rest, by coasting (`s3_coasting`), at the end of
           the plan in force, to steer elsewhere (`s3_steered`), or on its old way
           (`mhsb_model.braking`); the path begins where it does, and at `start` itself where
           there is none

    Raises ValueError where start, brake and path do not meet, FitError where no curve keeps every
    limit or the modules are too few to hold the arm at its end, DeadlineError where none does in
    time.
    """
    coast = None
    if isinstance(brake, Coasting | Steering):
        coast, brake = brake, brake.trajectory
    if brake is not None and brake.duration_ns == 0:
        brake = None
    _check_meeting(path, start, brake)
    _check_holding(machine, path.posture[-1])
    limits, machine = machine.arrays, _admitting(machine, start.position)
    rules = rules or FitRules()
    refused: list[str] = []
    least = rules.least_duration / float(np.sum(path.duration))
    lacked = False
    for kind in candidates(machine, path, start, brake, coast, modes, rules):
        if kind.for_thrust and not lacked:
            continue
        candidate = kind if kind.stretch >= least else replace(kind, stretch=least)
        outcome = _stretched(machine, limits, path, modes, candidate, rules, deadline)
        if isinstance(outcome, FittedMotion):
            return replace(outcome, refused=tuple(refused)) if refused else outcome
        refused.append(f"{candidate.name}: {outcome}")
        lacked = isinstance(outcome, Violation) and outcome.limit == Limit.THRUST
    raise FitError(tuple(refused))


def fit_rest(
    machine: Machine,
    rest: Trajectory,
    modes: StartModes,
    rules: FitRules,
    deadline: Deadline = NEVER,
) -> FittedMotion:
    """The rest of the plan in force as a motion, with its modes chosen anew.

    Raises FitError where it breaks a limit, as those of another payload or V_max; DeadlineError.
    """
    motion = fit_braking(machine, rest, modes, rules)
    if motion.speed_excess > rules.max_excess:
        raise FitError((f"a piston would pass V_max by {100 * motion.speed_excess:.3g} %",))
    offset, schedule = motion.trajectory.offset_ns, motion.schedule
    at_points = schedule.modes_at_many(offset[:-1])
    if not keeps_dwell(offset / SECOND_NS, at_points, modes, schedule.modes[-1], rules.switching):
        raise FitError((f"an actuator is switched twice within {rules.switching.min_dwell:g} s",))
    violation = first_violation(machine, motion.trajectory, schedule, deadline=deadline)
    if violation is not None:
        raise FitError((str(violation),))
    return replace(motion, method=FitMethod.CONTINUED, braked=False)


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
        tip=machine.tip_in_base(posture),
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
    moving = MotionState(middle, 0.1 * middle, middle)
    coast = coasting(machine, moving)
    following = FitRules.following()
    for candidate in chain(
        candidates(machine, path, start, None, None, modes, rules),
        candidates(machine, path, start, coast.trajectory, coast, modes, following),
        candidates(machine, path, start, None, Steering(moving, coast.trajectory), modes, rules),
    ):
        motion = _stretched(machine, machine.arrays, path, modes, candidate, rules, NEVER)
        if isinstance(motion, FittedMotion):
            for known in (motion.profiles, None):
                motion_energy(machine, motion.trajectory, motion.schedule, known)
    with suppress(FitError):
        fit_trajectory(machine, path, MotionState.at_rest(path.posture[0]), modes)
    s3_clearance.warm_up(machine)
    s3_limits.warm_up(machine)


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
    """Return the machine, its joint limits and workspace widened to a start outside of them.

    Joints then may be as far outside as at the start; `way_out` sees to it that they only return.
    """
    arrays = machine.arrays
    x, z = tip_position(arrays, posture)
    if max(float(joint_excess(arrays, posture)), node_set_excess(arrays, x, z)) <= 0.0:
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


def _stretched(
    machine: Machine,
    limits: MachineArrays,
    path: DiscretePath,
    modes: StartModes,
    candidate: Candidate,
    rules: FitRules,
    deadline: Deadline,
) -> FittedMotion | Violation | str:
    """The candidate's motion, stretched as far as its limits ask; or why there is none.

    The machine admits the start, `limits` are those to which a joint beyond them has to return.
    """
    lead_in, stretch, before = candidate.lead_in, candidate.stretch, math.inf
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
        beyond = way_out(limits, as_frozen(position))
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
        tip = machine.in_base(profile.tip, trajectory.position[:, 0])
        if missed := first_missed(tip, rules.passing):
            return missed
        after = profile[first:]
        fastest = 1.0 + rules.max_excess
        if candidate.coasts:  # what is too fast already becomes slower, but not by stretching
            fastest = max(fastest, USAGE_RESERVE * (1.0 + _speed_excess(machine, profile[:1])))
        quasi_static = (1.0 + _speed_excess(machine, after)) / fastest
        ends = EndDemands.of(machine, profile, scheduled.intervals)
        used = max(ends.largest_usage(first), quasi_static)
        deadline.check(FITTING)
        needed = USAGE_RESERVE * used
        stuck, before = used == before, used
        if needed <= (ENOUGH if stuck else 1.0):
            schedule = scheduled.schedule
            middles = middle_profile(machine, trajectory)
            violation = first_violation(machine, trajectory, schedule, ends, deadline, middles)
            if violation is None:
                profiles = Profiles(profile, middles, scheduled.intervals)
                return _fitted(
                    machine, path, candidate, curve, trajectory, schedule, profiles, stretch
                )
            if violation.limit not in candidate.stretchable or violation.time < time[first]:
                return violation
            if violation.limit == Limit.THRUST:
                needed = THRUST_STRETCH
            else:
                needed = USAGE_RESERVE * (1.0 + violation.amount)
        stretch *= max(needed, USAGE_RESERVE) if stuck else needed
        if stretch > (candidate.longest or rules.max_stretch) * candidate.stretch:
            return f"V_max, valves and pumps would take a duration {stretch:.3g} times the path's"
    return "stretching it did not bring it within what valves and pumps can do"


def _preferred(
    path: DiscretePath, node_time: FloatArray, time: FloatArray, first: int
) -> ModeArray:
    """The discrete path's modes at the points; N during a lead-in of `first` points."""
    return _modes_of_steps(path.modes, node_time, time, first)


@kernel
def _modes_of_steps(
    steps: ModeArray, node_time: FloatArray, time: FloatArray, first: int
) -> ModeArray:
    """Kernel of `_preferred`."""
    modes, step = np.empty((len(time), steps.shape[1]), dtype=np.uint8), 0
    modes[:first] = N
    for k in range(first, len(time)):
        while step < len(steps) - 1 and node_time[step + 1] <= time[k] - time[first]:
            step += 1
        modes[k] = steps[step]
    return modes


def _overrun(
    machine: Machine, start: MotionState, position: FloatArray, furthest: FloatArray
) -> float:
    """By how much a piston runs further in its first direction than it has to [m]."""
    beyond = furthest_of(start, position) - furthest
    return float(np.max(beyond * np.abs(machine.moment_arms(start.position))))


def _fitted(
    machine: Machine,
    path: DiscretePath,
    candidate: Candidate,
    curve: Curve,
    trajectory: Trajectory,
    schedule: ModeSchedule,
    profiles: Profiles,
    stretch: float,
) -> FittedMotion:
    at_nodes = curve.sample(curve.node_time)[0]
    tips = machine.tip_in_base(at_nodes)
    return FittedMotion(
        trajectory,
        schedule,
        candidate.method,
        candidate.lead_in is not None,
        stretch,
        _speed_excess(machine, profiles.points),
        float(np.linalg.norm(tips - path.tip, axis=1).max()),
        float(np.max(np.abs(at_nodes - path.posture))),
        overloads=overloads(machine, trajectory.offset_ns / SECOND_NS, profiles.points),
        profiles=profiles,
    )


def _speed_excess(machine: Machine, profile: MotionProfile) -> float:
    fastest = np.maximum(profile.speed.max(axis=0), -profile.speed.min(axis=0))
    return float((fastest / machine.arrays.max_piston_speed).max()) - 1.0
