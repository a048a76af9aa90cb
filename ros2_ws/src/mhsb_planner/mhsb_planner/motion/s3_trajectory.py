"""Fit of a trajectory over time, with its mode schedule, to a discrete path (S3).

Curves are tried in this order. The first curve that keeps every limit is taken, and the result
names it.

1. The published polynomial of degree 6 per joint, if the rules ask for it.
2. The discrete path with ramps (smooth changes of speed). If the arm moves at the start, the path
   begins at once.
3. If the arm moves at the start: a motion to rest, and then the path with ramps.
4. The path with ramps, and with a rest before each step in which the boost of an actuator begins.
5. The discrete path step by step, with a rest at every node.

If an actuator was switched so recently that it may not be switched again yet, curves 3 to 5 are
tried once more, after a rest.

For a goal that moves, the motion may have to end near the end of the plan in force. Then the only
curve leads from the moving start straight to the end (`s3_state_to_rest`).

Steps become longer until valves, servo pumps and main pump can follow (`s3_slowing`). Ramps become
longer until the pressures suffice. A standstill is added at the end of a motion if an actuator
would otherwise be switched twice within too short a time.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.errors import MhsbError
from mhsb_model.feasibility.curve_check import compute_slowing_factor
from mhsb_model.holding import HoldingError, choose_holding_modes
from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import tip_position
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import MAX_DURATION_NS, SECOND_NS, MotionState, Trajectory
from mhsb_model.types import FloatArray, ModeArray, as_frozen, frozen
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.motion import s3_limits
from mhsb_planner.motion.energy import compute_motion_energy
from mhsb_planner.motion.fitted_motion import FittedMotion, compute_stretch
from mhsb_planner.motion.limits.joint_range import (
    JOINT_TOLERANCE,
    compute_outward_excess,
)
from mhsb_planner.motion.limits.limit import TimeScaling, Violation
from mhsb_planner.motion.motion_profile import compute_middle_profile
from mhsb_planner.motion.ramped_motion import RampedMotion
from mhsb_planner.motion.s3_blend_in import Coasting, compute_coasting
from mhsb_planner.motion.s3_candidates import (
    TRAJECTORY_KINDS,
    CurveCandidate,
    FitMethod,
    FitRules,
    TrajectoryKind,
    compute_furthest_travel,
    iterate_candidates,
)
from mhsb_planner.motion.s3_hard_braking import iterate_harder_brakings
from mhsb_planner.motion.s3_limits import (
    EndValues,
    compute_position_excess,
    find_first_violation,
    find_violation_between,
)
from mhsb_planner.motion.s3_slowing import (
    USAGE_RESERVE,
    compute_needed_factors,
    compute_ramp_growth,
    spread_over_steps,
)
from mhsb_planner.motion.s3_state_to_rest import Steering
from mhsb_planner.motion.s4_mode_schedule import MIN_DWELL, N, ScheduledMotion, StartModes
from mhsb_planner.motion.trajectory_points import Curve, join_trajectories, sample_curve
from mhsb_planner.motion.via_check import describe_first_missed
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics

__all__ = [
    "TRAJECTORY_KINDS",
    "FitError",
    "FitMethod",
    "FitRules",
    "TrajectoryKind",
    "fit_braking",
    "fit_remainder",
    "fit_trajectory",
    "warm_up",
]

SAME_POSTURE = 1e-9
"""Largest difference of joint positions that count as equal [rad or m]."""

ACCEPTED_LIMIT_USE = 1.0001
"""Largest used share of the limits, reserve included, if a longer duration has no effect [-].

A longer duration may have no effect because ramp times are multiples of RAMP_TIME_STEP."""

MAX_OVERRUN = 2e-3
"""Distance by which a piston may travel farther in its initial direction than braking and the path
need [m].
"""

MAX_STRETCH_ROUNDS = 8
"""Number of times that a curve is stretched before it is refused."""

LONGEST_MOTION = MAX_DURATION_NS / SECOND_NS - 10.0
"""Longest duration of a motion [s].

This is the longest plan that an arm accepts, minus 10 s for the part that repeats the plan in
force.
"""

FIT_TASK = "making a trajectory of the path"
"""Name of the work in the message of a `DeadlineError`."""


class FitError(MhsbError):
    """Error: no trajectory along the discrete path keeps every limit.

    Attributes:
        refused: One sentence for each curve that was tried, with the reason for its refusal.
    """

    def __init__(self, refused: tuple[str, ...]) -> None:
        """Create the error; its message contains the last reason.

        Args:
            refused: One sentence for each curve that was tried, with the reason for its refusal; at
                least one.
        """
        self.refused = refused
        super().__init__(f"no motion along the path keeps every limit; {refused[-1]}")


def fit_trajectory(
    machine: Machine,
    path: DiscretePath,
    start: MotionState,
    modes: StartModes,
    brake: Trajectory | Coasting | Steering | None = None,
    rules: FitRules | None = None,
    deadline: Deadline = NO_DEADLINE,
) -> FittedMotion:
    """Fit a trajectory and its mode schedule to a discrete path, with a rest at the path's end.

    Several curves are tried: the polynomial, the path with smoothed changes of speed, the path
    after braking, and the path step by step. The first that keeps every limit is taken. Curves are
    slowed as far as the rules allow. A joint that starts beyond its limits may only move back.

    Args:
        machine: Machine with its obstacles.
        path: Discrete path. It begins at `start`, or where `brake` comes to rest.
        start: State of the joints at the start.
        modes: Modes in force at the start, and time since each actuator's last switch.
        brake: Motion that brings a moving arm to rest; None if the arm is at rest. After a
            `Trajectory`, the path begins from rest. With a `Coasting`, the path may begin before
            the arm is at rest. With a `Steering`, the motion leads from `start` straight to the
            path's end; the path then begins at the end of the plan in force.
        rules: Settings of the fit; None means the defaults.
        deadline: Instant at which the work is given up.

    Returns:
        First motion that keeps every limit, with stamp 0. Its `refused` contains the reasons why
        curves before it were refused.

    Raises:
        ValueError: Start, `brake` and path do not meet, a moving arm has no `brake`, or the path
            has no steps.
        FitError: No curve keeps every limit, or there are too few booster modules to hold the arm
            at the path's end.
        DeadlineError: The deadline passed.
    """
    coast = None
    if isinstance(brake, Coasting | Steering):
        coast, brake = brake, brake.trajectory
    if brake is not None and brake.duration_ns == 0:
        brake = None
    _check_continuity(path, start, brake)
    _check_holding(machine, path.posture[-1])
    limits, machine = machine.arrays, _widen_limits_to(machine, start.position)
    rules = rules or FitRules()
    refused: list[str] = []
    least = rules.min_duration / float(path.duration.sum())
    for kind in iterate_candidates(machine, path, start, brake, coast, modes, rules):
        candidate = kind if kind.stretch >= least else replace(kind, stretch=least)
        outcome = _fit_candidate(machine, limits, modes, candidate, rules, deadline)
        if isinstance(outcome, FittedMotion):
            return replace(outcome, refused=tuple(refused)) if refused else outcome
        refused.append(f"{candidate.name}: {outcome}")
    raise FitError(tuple(refused))


def fit_remainder(
    machine: Machine,
    remainder: Trajectory,
    modes: StartModes,
    rules: FitRules,
    deadline: Deadline = NO_DEADLINE,
) -> FittedMotion:
    """Turn the remaining part of the plan in force into a motion, with newly chosen modes.

    The joint trajectory is kept. A standstill is added at its end if the actuators need time to
    switch their modes there.

    Args:
        machine: Machine; its payload, V_max or zones may have changed since the plan was made.
        remainder: Remaining part of the plan's trajectory.
        modes: Modes in force at its beginning, and time since each actuator's last switch.
        rules: Settings of the fit.
        deadline: Instant at which the work is given up.

    Returns:
        Motion with stamp 0 and the method CONTINUED.

    Raises:
        FitError: The trajectory breaks a limit of the machine, a piston exceeds V_max by more than
            `rules.max_excess`, or an actuator is switched twice within MIN_DWELL.
        DeadlineError: The deadline passed.
    """
    motion = fit_braking(machine, remainder, modes)
    if motion.speed_excess > rules.max_excess:
        raise FitError((f"a piston would pass V_max by {100 * motion.speed_excess:.3g} %",))
    if not motion.scheduled.keeps_dwell:
        raise FitError((f"an actuator is switched twice within {MIN_DWELL:g} s",))
    violation = find_first_violation(machine, motion.trajectory, motion.schedule, deadline)
    if violation is not None:
        raise FitError((str(violation),))
    return replace(motion, method=FitMethod.CONTINUED, braked=False)


def fit_braking(machine: Machine, brake: Trajectory, modes: StartModes) -> FittedMotion:
    """Add a mode schedule to a braking trajectory, and return both as a motion.

    Limits are not checked. A standstill is added at the end if the actuators need time to switch
    their modes there.

    Args:
        machine: Machine that moves.
        brake: Braking trajectory; the result has stamp 0.
        modes: Modes in force at the beginning, and time since each actuator's last switch.

    Returns:
        Motion with stamp 0, method BRAKING, stretch 1 and deviations 0. Its `middles` is None.
    """
    scheduled = ScheduledMotion.create(machine, brake.shifted(-brake.stamp_ns), modes)
    return FittedMotion(machine, scheduled, FitMethod.BRAKING, braked=True)


def warm_up(machine: Machine) -> None:
    """Compile the kernels of trajectory, mode schedule, checks and energy for starts at rest.

    `s3_clearance.warm_up` compiles the check against obstacles.

    Args:
        machine: Machine that moves in the trial motions.
    """
    path = create_example_path(machine)
    start = MotionState.at_rest(path.posture[0])
    machine.tip_position(path.posture[0])  # read-only, as the ends of paths
    _fit_each(machine, path, start, [(None, None, FitRules())])
    with suppress(FitError):
        fit_trajectory(machine, path, start, StartModes.create_settled(path.start_modes))
    s3_limits.warm_up(machine)


def warm_up_moving_starts(machine: Machine) -> None:
    """Compile the kernels of motions that begin while the arm moves, and of harder braking.

    Args:
        machine: Machine that moves in the trial motions.
    """
    path = create_example_path(machine)
    middle = path.posture[0]
    moving = MotionState(middle, 0.1 * middle, middle)
    machine.moment_arms(middle)
    coast = compute_coasting(machine, moving)
    next(iterate_harder_brakings(machine, coast.trajectory, coast.trajectory.stamp_ns), None)
    ways: list[tuple[Trajectory | None, Coasting | Steering, FitRules]] = [
        (coast.trajectory, coast, FitRules.create_following()),
        (None, Steering(coast.trajectory), FitRules()),
    ]
    _fit_each(machine, path, MotionState.at_rest(middle), ways)


def create_example_path(machine: Machine) -> DiscretePath:
    """Create a short discrete path of one step in mode N, from the middle of the joint ranges.

    Args:
        machine: Machine that moves.

    Returns:
        The path; its duration is 1 s, its energies are 0.
    """
    arrays, normal = machine.arrays, np.zeros((1, machine.joint_count), dtype=np.uint8)
    middle = 0.5 * (arrays.joint_min + arrays.joint_max)
    posture = np.array([middle, 0.99 * middle + 0.01 * arrays.joint_max])
    return DiscretePath(
        tip=machine.tip_in_base(posture),
        posture=posture,
        modes=normal,
        duration=np.ones(1),
        energy=np.zeros(1),
        energy_series=np.zeros(1),
        cost=0.0,
        start_modes=normal[0],
        statistics=SearchStatistics(0, 0, 0.0),
    )


def _fit_each(
    machine: Machine,
    path: DiscretePath,
    start: MotionState,
    ways: Sequence[tuple[Trajectory | None, Coasting | Steering | None, FitRules]],
) -> None:
    """Fit all curves for several beginnings of a motion, in order to compile kernels.

    For each motion that keeps the limits, the energy and a factor on its ramps are also computed.

    Args:
        machine: Machine that moves.
        path: Path of the motion.
        start: State at the path's first posture.
        ways: Arguments `brake`, `coast` and `rules` of `iterate_candidates` for each way.
    """
    modes = StartModes.create_settled(path.start_modes)
    for brake, steering, rules in ways:
        for candidate in iterate_candidates(machine, path, start, brake, steering, modes, rules):
            motion = _fit_candidate(
                machine, machine.arrays, modes, candidate, FitRules(), NO_DEADLINE
            )
            if isinstance(motion, FittedMotion):
                compute_motion_energy(machine, motion.trajectory, motion.schedule)
                _ = motion.energy, motion.overloads, motion.tip_deviation
                assert motion.middles is not None
                made = motion.scheduled
                compute_ramp_growth(machine, made.profile, motion.middles, made.intervals)


def _check_continuity(path: DiscretePath, start: MotionState, brake: Trajectory | None) -> None:
    """Check that the braking motion begins at the start and ends where the path begins.

    Args:
        path: Discrete path; it must have a step. Without `brake` it must begin at the start.
        start: State of the joints at the start.
        brake: Motion that brings a moving arm to rest; None if the arm is at rest.

    Raises:
        ValueError: Two postures that must be equal differ by more than SAME_POSTURE, a moving arm
            has no braking motion, or the path has no steps.
    """
    if len(path.duration) == 0:
        raise ValueError("a path without steps needs no trajectory")
    if brake is None and start.is_moving:
        raise ValueError("a moving start needs a braking motion")
    if brake is not None and not _are_equal(brake.position[0], start.position):
        raise ValueError("the braking motion must begin at the start")
    first = start.position if brake is None else brake.position[-1]
    if not _are_equal(path.posture[0], first):
        raise ValueError("the path must begin where the start comes to rest")


def _check_holding(machine: Machine, posture: FloatArray) -> None:
    """Check that enough booster modules are fitted to hold the arm in a posture.

    Args:
        machine: Machine with its modules.
        posture: Joint positions, shape (n,) [rad or m].

    Raises:
        FitError: There are too few booster modules for the actuators whose loads the main pump's
            pressure cannot hold.
    """
    m = machine.arrays
    if m.modules_per_mode[Mode.DB] * machine.joint_count <= m.module_count:
        return
    try:
        choose_holding_modes(machine, machine.piston_forces(posture))
    except HoldingError as error:
        raise FitError((str(error),)) from None


def _are_equal(one: FloatArray, other: FloatArray) -> bool:
    """Return whether two postures are equal within SAME_POSTURE."""
    pairs = zip(one.tolist(), other.tolist(), strict=True)
    return all(abs(a - b) <= SAME_POSTURE for a, b in pairs)


def _widen_limits_to(machine: Machine, posture: FloatArray) -> Machine:
    """Return a copy of the machine whose joint limits and workspace are widened to include a start.

    Joints may then be as far outside their limits as at the start. The caller must check that such
    joints only move back.

    Args:
        machine: Machine with the limits of its file.
        posture: Joint positions of the start, shape (n,) [rad or m].

    Returns:
        A machine that admits the start. It is `machine` itself if the start is outside the limits
        by at most JOINT_TOLERANCE, which counts as rounding.
    """
    arrays = machine.arrays
    if max(compute_position_excess(arrays, as_frozen(posture[None]))) <= JOINT_TOLERANCE:
        return machine
    x, z = tip_position(arrays, posture)
    radius = math.hypot(x, z)
    widened = arrays._replace(
        joint_min=frozen(np.minimum(arrays.joint_min, posture)),
        joint_max=frozen(np.maximum(arrays.joint_max, posture)),
        min_x=min(arrays.min_x, x),
        min_radius=min(arrays.min_radius, radius),
        max_radius=max(arrays.max_radius, radius),
    )
    return replace(machine, arrays=widened)


def _fit_candidate(
    machine: Machine,
    limits: MachineArrays,
    modes: StartModes,
    candidate: CurveCandidate,
    rules: FitRules,
    deadline: Deadline,
) -> FittedMotion | Violation | str:
    """Compute the motion of one curve, slowed until it keeps every limit.

    Some curves are refused at once (`_schedule_curve`). The curve is slowed if it is too fast for
    V_max × (1 + `rules.max_excess`), valves, pumps, or the limits of joint acceleration and jerk.
    All steps of the path then become longer; with `candidate.slows_pieces` only those around the
    violation.

    Pressures, obstacles and the times between points are checked last. If inertia asks for too
    much pressure, the fit begins again with longer ramps (changes of speed), as long as these may
    help (`CurveCandidate.may_mend`). For other violations, and after that, the steps become longer
    if `candidate.stretchable` allows it. The curve is also refused if slowing cannot mend a
    violation, if the path would have to become too slow, or after MAX_STRETCH_ROUNDS.

    Args:
        machine: Machine whose joint limits and workspace are widened to include the start.
        limits: Arrays with the limits of the machine file. A joint beyond a limit must not move
            farther out.
        modes: Modes in force at the start, and time since each actuator's last switch.
        candidate: Curve to try, with its path.
        rules: Settings of the fit.
        deadline: Instant at which the work is given up.

    Returns:
        The motion. If the curve is refused: the broken limit with its time, or a clause with
        another reason.

    Raises:
        DeadlineError: The deadline passed.
    """
    lead_in, before, path = candidate.lead_in, math.inf, candidate.path
    first = 0 if lead_in is None else len(lead_in.offset_ns) - 1
    scale, ramp_factor = np.full(path.steps, candidate.stretch), candidate.ramp_factor
    for _ in range(MAX_STRETCH_ROUNDS):
        deadline.check(FIT_TASK)
        curve = candidate.curve_at(scale, ramp_factor)
        made = _schedule_curve(machine, limits, modes, candidate, curve, rules, deadline)
        if isinstance(made, str):
            return made
        scheduled, slowing = made
        trajectory, profile = scheduled.trajectory, scheduled.profile
        time = trajectory.offset_ns / SECOND_NS
        ends = EndValues.from_profile(machine, profile, scheduled.intervals)
        fastest, max_speed = 1.0 + rules.max_excess, machine.arrays.max_piston_speed
        used, most = _compute_uses(
            profile.speed, max_speed, ends.speed_uses, fastest, candidate.coasts, slowing, first
        )
        deadline.check(FIT_TASK)
        stuck, before = most == before, most
        if USAGE_RESERVE * most <= (ACCEPTED_LIMIT_USE if stuck else 1.0):
            middles = compute_middle_profile(machine, trajectory)
            violation = find_violation_between(machine, trajectory, ends, middles, deadline)
            if violation is None:
                fit = candidate.method, lead_in is not None, (path, curve), scale
                return FittedMotion(machine, scheduled, *fit, middles=middles)
            scaling = violation.limit.time_scaling
            is_in_curve = violation.time >= time[first]
            if scaling is TimeScaling.INERTIA and is_in_curve and candidate.may_mend(violation):
                growth = compute_ramp_growth(machine, profile, middles, scheduled.intervals)
                longer = candidate.with_longer_ramps(growth, violation)
                return _fit_candidate(machine, limits, modes, longer, rules, deadline)
            if scaling not in candidate.stretchable or not is_in_curve:
                return violation
            needed = compute_needed_factors(violation, ends, used, time, candidate.slows_pieces)
        else:
            needed = USAGE_RESERVE * used
        since, slows_pieces = time[first:] - time[first], candidate.slows_pieces
        factor = spread_over_steps(needed[first:], since, curve.node_time, slows_pieces)
        scale = scale * (np.maximum(factor, USAGE_RESERVE) if stuck else factor)
        stretch = compute_stretch(path, scale)
        if stretch > (candidate.max_stretch or rules.max_stretch) * candidate.stretch:
            return f"V_max, valves and pumps would take a duration {stretch:.3g} times the path's"
    return "stretching it did not bring it within what valves and pumps can do"


def _schedule_curve(
    machine: Machine,
    limits: MachineArrays,
    modes: StartModes,
    candidate: CurveCandidate,
    curve: Curve,
    rules: FitRules,
    deadline: Deadline,
) -> tuple[ScheduledMotion, float] | str:
    """Sample a curve, join it to the motion before it, and choose the modes of the whole motion.

    The curve is refused if it takes too long, its ramps break the limits of acceleration and jerk,
    or it passes a joint limit. It is also refused if it moves a piston farther than needed, misses
    a via point, or switches an actuator again too soon.

    Args:
        machine: Machine whose joint limits and workspace are widened to include the start.
        limits: Arrays with the limits of the machine file. A joint beyond a limit must not move
            farther out.
        modes: Modes in force at the start, and time since each actuator's last switch.
        candidate: Candidate of the curve, with path and lead-in (motion before the curve).
        curve: Curve of joint positions over time.
        rules: Settings of the fit.
        deadline: Instant at which the work is given up.

    Returns:
        The motion, lead-in included, and the factor on the curve's duration that
        `compute_slowing_factor` gives [-]. If the curve is refused, a clause with the reason.

    Raises:
        DeadlineError: The deadline passed.
    """
    if refused := _describe_refused_curve(curve):
        return refused
    path, lead_in, first = candidate.path, candidate.lead_in, 0
    trajectory = sample_curve(curve, candidate.start, path.posture[-1])
    slowing = compute_slowing_factor(machine.curve_limits.for_planning, trajectory)
    if lead_in is not None:
        trajectory, first = join_trajectories(lead_in, trajectory), len(lead_in.offset_ns) - 1
    deadline.check(FIT_TASK)
    position = trajectory.position[first:]
    if passed := _describe_passed_limit(machine, limits, candidate, position):
        return passed
    time = trajectory.offset_ns / SECOND_NS
    preferred = _assign_step_modes(path.modes, curve.node_time, time, first)
    scheduled = ScheduledMotion.create(machine, trajectory, modes, preferred)
    if not scheduled.keeps_dwell:
        return f"an actuator is switched twice within {MIN_DWELL:g} s"
    if rules.via_points:
        slew = scheduled.trajectory.position[:, 0]
        tip = machine.convert_to_base(scheduled.profile.tip, slew)
        if missed := describe_first_missed(tip, rules.via_points):
            return missed
    return scheduled, slowing


def _describe_refused_curve(curve: Curve) -> str:
    """Describe why a curve must be refused even without sampling.

    Args:
        curve: Curve of joint positions over time.

    Returns:
        Clause with the reason: the curve takes longer than LONGEST_MOTION, or its ramps (changes
        of speed) break the limits of acceleration and jerk. Empty if the curve is not refused.
    """
    if not curve.breaks[-1] <= LONGEST_MOTION:
        return f"it takes {curve.breaks[-1]:.4g} s, at most {LONGEST_MOTION:g} s is allowed"
    if isinstance(curve, RampedMotion) and not curve.keeps_dynamic_limits:
        return "pistons would have to speed up or slow down faster than allowed"
    return ""


def _describe_passed_limit(
    machine: Machine,
    limits: MachineArrays,
    candidate: CurveCandidate,
    position: FloatArray,
) -> str:
    """Describe by how much a curve passes a joint limit, or moves a piston too far.

    Args:
        machine: Machine that moves.
        limits: Arrays of the machine with the joint limits. A joint that starts beyond a limit must
            not move farther out.
        candidate: Curve that is tried. If its `furthest_travel` is set, pistons may exceed this
            travel by at most MAX_OVERRUN.
        position: Joint positions at the sampled points, shape (m, n) [rad or m].

    Returns:
        Clause that says by how much the curve goes too far; empty if it does not go too far.
    """
    beyond = compute_outward_excess(limits.joint_min, limits.joint_max, as_frozen(position))
    if beyond > JOINT_TOLERANCE:
        return f"a joint limit is passed by {beyond:.3g} rad or m"
    if candidate.furthest_travel is not None:
        overrun = _compute_overrun(machine, candidate.start, position, candidate.furthest_travel)
        if overrun > MAX_OVERRUN:
            return f"a piston runs on by {1000 * overrun:.3g} mm more than braking takes"
    return ""


@kernel
def _compute_uses(
    speed: FloatArray,
    max_speed: FloatArray,
    limit_uses: FloatArray,
    fastest: float,
    coasts: bool,
    slowing: float,
    first: int,
) -> tuple[FloatArray, float]:
    """Compute the share of V_max, valves and pumps that each interval of a motion uses.

    The allowed speed of a piston is `fastest` times its V_max. An arm that moves at the start may
    already be faster there, which slowing cannot change. `fastest` is then raised to USAGE_RESERVE
    times the largest ratio of speed to V_max at the start. In each interval of the curve, the share
    is at least `slowing`.

    Tested against the same shares computed with NumPy.

    Args:
        speed: Piston speeds at the motion's k + 1 points, shape (k + 1, n) [m/s].
        max_speed: V_max of each piston, shape (n,) [m/s].
        limit_uses: Share of valves and pumps that each interval uses, shape (k,) [-].
        fastest: Largest allowed ratio of piston speed to V_max [-].
        coasts: True if the curve begins while the arm moves.
        slowing: Share of the limits of joint acceleration and jerk that the curve uses [-].
        first: Index of the curve's first interval. Earlier intervals belong to the motion before
            the curve and get 0.

    Returns:
        Largest share in each interval, shape (k,) [-], and the largest share of all intervals.
        Above 1, the interval is too fast. inf means that no speed is slow enough.
    """
    used, most, before = np.zeros(len(limit_uses)), 0.0, 0.0
    for k in range(len(speed)):
        share = 0.0
        for j in range(len(max_speed)):
            share = max(share, abs(speed[k, j]) / max_speed[j])
        if k == 0 and coasts:
            fastest = max(fastest, USAGE_RESERVE * share)
        if k > first:
            used[k - 1] = max(limit_uses[k - 1], max(before, share) / fastest, slowing)
            most = max(most, used[k - 1])
        before = share
    return used, most


@kernel
def _assign_step_modes(
    steps: ModeArray, node_time: FloatArray, time: FloatArray, first: int
) -> ModeArray:
    """Assign the modes of a path's steps to the points of a trajectory.

    Points after the path's last node get the modes of its last step.

    Args:
        steps: Mode codes of the steps, shape (k, n).
        node_time: Planned time of each node of the path, shape (k + 1,) [s]. It is counted from the
            time of point `first`.
        time: Times of the points in ascending order, shape (m,) [s].
        first: Index of the point at which the path begins; the points before it get mode N.

    Returns:
        Mode codes (N, DB, SB), shape (m, n).
    """
    modes, step = np.empty((len(time), steps.shape[1]), dtype=np.uint8), 0
    modes[:first] = N
    for k in range(first, len(time)):
        while step < len(steps) - 1 and node_time[step + 1] <= time[k] - time[first]:
            step += 1
        copy_row(modes[k], steps[step])
    return modes


def _compute_overrun(
    machine: Machine, start: MotionState, position: FloatArray, furthest: FloatArray
) -> float:
    """Compute how much farther than needed a piston moves in its initial direction.

    The moment arm at the start converts the travel of a joint to the travel of its piston.

    Args:
        machine: Machine that gives the moment arms.
        start: State of the joints at the start.
        position: Joint positions along the motion, shape (k, n) [rad or m].
        furthest: Travel that each joint needs in its initial direction, shape (n,) [rad or m].

    Returns:
        Excess of the worst piston [m]; negative if no piston moves farther than needed.
    """
    beyond = compute_furthest_travel(start, position) - furthest
    return float(np.max(beyond * np.abs(machine.moment_arms(start.position))))
