"""Every fitted motion keeps every limit, from rest and from nasty starts."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mhsb_model.braking import brake_along, brake_from
from mhsb_model.holding import choose_holding_modes
from mhsb_model.hydraulics import compute_required_pressure
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, MotionState, standstill
from mhsb_model.types import frozen
from mhsb_planner.deadline import NO_DEADLINE
from mhsb_planner.errors import InfeasibleGoalError
from mhsb_planner.motion import (
    piston_motion,
    ramped_motion,
    s3_limits,
    s3_trajectory,
    s4_mode_schedule,
)
from mhsb_planner.motion.energy import compute_motion_energy
from mhsb_planner.motion.limits import joint_range
from mhsb_planner.motion.limits.limit import TimeScaling, Violation
from mhsb_planner.motion.limits.thrust import THRUST_LIMIT
from mhsb_planner.motion.s3_candidates import iterate_candidates
from mhsb_planner.motion.s3_trajectory import (
    FitError,
    FitMethod,
    FitRules,
    FittedMotion,
    fit_braking,
    fit_trajectory,
    warm_up,
)
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.search.s2_search import PathQuery, Weights, search

NORMAL = StartModes.create_settled([0, 0, 0])
TOLERANCE = {"joint": 1e-7, "tip": 2e-6, "modules": 0.0}


def from_rest(machine, path, rules=None):
    return fit_trajectory(machine, path, MotionState.at_rest(path.posture[0]), NORMAL, rules=rules)


def changed(machine, **numbers):
    """The machine with other numbers in its arrays."""
    fixed = {k: frozen(v) if isinstance(v, np.ndarray) else v for k, v in numbers.items()}
    return replace(machine, arrays=machine.arrays._replace(**fixed))


def assert_keeps_limits(motion, worst, machine):
    measured = worst(motion.trajectory, motion.schedule, machine)
    broken = {k: v for k, v in measured.items() if v > TOLERANCE.get(k, 1e-6)}
    assert not broken, (broken, motion.method, motion.refused)


def assert_well_formed(motion, start, end):
    trajectory, schedule = motion.trajectory, motion.schedule
    assert trajectory.stamp_ns == schedule.stamp_ns == 0
    assert np.diff(trajectory.offset_ns).max() <= 20_000_000
    assert trajectory.position[0] == pytest.approx(start.position, abs=1e-12)
    assert trajectory.velocity[0] == pytest.approx(start.velocity, abs=1e-12)
    assert trajectory.acceleration[0] == pytest.approx(start.acceleration, abs=1e-9)
    assert trajectory.position[-1] == pytest.approx(end, abs=1e-12)
    assert not trajectory.velocity[-1].any()
    assert not trajectory.acceleration[-1].any()
    assert schedule.end_ns == trajectory.end_ns


def moving_starts(machine, walk, random, count):
    """States within fitted motions, with the motion, its schedule and the time."""
    while count > 0:
        path = walk(random, 5)
        motion = from_rest(machine, path)
        at = int(random.uniform(0.05, 0.95) * motion.trajectory.duration_ns)
        yield motion, at
        count -= 1


@settings(max_examples=40)
@given(st.integers(0, 2**32))
def test_every_motion_from_rest_keeps_every_limit(machine, walk, worst, seed):
    random = np.random.default_rng(seed)
    path = walk(random, int(random.integers(1, 14)), leap=float(random.choice([0.0, 0.3])))
    motion = from_rest(machine, path)
    assert_well_formed(motion, MotionState.at_rest(path.posture[0]), path.posture[-1])
    assert_keeps_limits(motion, worst, machine)


@settings(max_examples=40)
@given(st.integers(0, 2**32))
def test_every_motion_from_a_moving_start_keeps_every_limit(machine, walk, worst, seed):
    random = np.random.default_rng(seed)
    ((old, at),) = moving_starts(machine, walk, random, 1)
    start = old.trajectory.sample(at)
    brake = brake_along(machine, old.trajectory, at)
    modes = StartModes.read_from(old.schedule, at)
    path = walk(random, int(random.integers(1, 10)), start=brake.position[-1], leap=0.1)
    motion = fit_trajectory(machine, path, start, modes, brake)
    assert_well_formed(motion, start, path.posture[-1])
    assert_keeps_limits(motion, worst, machine)


@pytest.mark.parametrize("weights", [Weights(0.5, 0.0, 2.0), Weights(0.0, 15.0, 2.0)])
def test_plans_of_the_search_become_motions_that_keep_every_limit(machine, graph, worst, weights):
    random = np.random.default_rng(11)
    posture, fitted, failed = np.array([0.3, -1.4, -1.5]), 0, 0
    for _ in range(40):
        goal = random.uniform([0.05, -0.9], [0.95, 0.9])
        if not 0.3 < np.hypot(*goal) < 1.0:
            continue
        try:
            path = search(graph, PathQuery(posture, np.zeros(3, np.uint8), tuple(goal), weights))
            motion = from_rest(machine, path)
        except InfeasibleGoalError:
            continue
        except FitError:
            failed += 1
            continue
        fitted += 1
        posture = path.posture[-1]
        assert_keeps_limits(motion, worst, machine)
        energy = compute_motion_energy(machine, motion.trajectory, motion.schedule)
        assert 0.6 < energy.paper / path.energy.sum() < 1.4
    assert fitted >= 15
    assert failed == 0


def test_polynomials_are_preferred_and_say_so(machine, walk):
    motions = [from_rest(machine, walk(np.random.default_rng(seed), 5)) for seed in range(12)]
    polynomials = [motion for motion in motions if motion.method == FitMethod.POLYNOMIAL]
    assert len(polynomials) > 4
    assert all(motion.refused == () for motion in polynomials)


def test_where_a_polynomial_breaks_a_limit_the_path_is_followed_and_it_says_why(machine, walk):
    for seed in range(200):
        path = walk(np.random.default_rng(seed), 10, leap=0.4)
        motion = from_rest(machine, path)
        if motion.method == FitMethod.RAMPED:
            break
    assert motion.refused[0].startswith("polynomial: ")
    assert motion.speed_excess < 0.01
    assert motion.tip_deviation < 0.2


def test_the_last_resort_goes_from_node_to_node_at_rest(machine, walk, worst):
    for seed in range(100):
        path = walk(np.random.default_rng(seed), 6)
        narrow = changed(
            machine, joint_min=path.posture.min(axis=0), joint_max=path.posture.max(axis=0)
        )
        rest, rules = MotionState.at_rest(path.posture[0]), FitRules()
        *_, last = iterate_candidates(narrow, path, rest, None, None, NORMAL, rules)
        motion = s3_trajectory._fit_candidate(
            narrow, narrow.arrays, NORMAL, last, rules, NO_DEADLINE
        )
        if isinstance(motion, FittedMotion):
            break
    assert motion.method == FitMethod.STEPPED
    assert motion.joint_deviation < 1e-12
    assert_keeps_limits(motion, worst, narrow)


def test_ramps_that_leave_a_lack_of_pressure_as_it_was_do_not_become_longer_still(
    machine, walk, monkeypatch
):
    path, lack = walk(np.random.default_rng(0), 6), Violation(THRUST_LIMIT, 0.05, 0.01)
    rest, rules = MotionState.at_rest(path.posture[0]), FitRules.create_following()
    first, *_ = iterate_candidates(machine, path, rest, None, None, NORMAL, rules)
    tried = []

    def curve_at(scale, ramp_factor):
        tried.append(ramp_factor)
        return first.curve_at(scale, ramp_factor)

    monkeypatch.setattr(s3_trajectory, "find_violation_between", lambda *_: lack)
    candidate = replace(first, curve_at=curve_at, stretchable=(TimeScaling.SPEED,))
    outcome = s3_trajectory._fit_candidate(
        machine, machine.arrays, NORMAL, candidate, rules, NO_DEADLINE
    )
    assert outcome == lack
    assert 1.0 == min(tried) < max(tried) < candidate.max_ramp_factor
    assert len(set(tried)) == 2


def lifting_path(machine, posture, angle):
    """One step by which the first actuator lifts the arm in mode DB at 60 % of V_max."""
    ends = np.array([posture, posture + np.array([angle, 0.0, 0.0])])
    stroke = np.ptp([machine.cylinder_lengths(q)[0] for q in ends])
    duration = np.array([stroke / (0.6 * machine.arrays.max_piston_speed[0])])
    modes = np.array([[Mode.DB, Mode.N, Mode.N]], dtype=np.uint8)
    return replace(
        s3_trajectory.create_example_path(machine),
        tip=machine.tip_in_base(ends),
        posture=ends,
        modes=modes,
        duration=duration,
    )


@pytest.mark.parametrize("reserve", [1.0, 1.2, 1.4])
def test_ramps_are_hardly_longer_than_the_pressure_asks_for(machine, worst, reserve):
    """The duration is compared with that of many fixed factors on the ramps."""
    path = lifting_path(machine, np.array([0.1, -0.3, -0.1]), 0.3)
    m, speed = machine.arrays, 0.6 * machine.arrays.max_piston_speed[0]
    share = np.linspace(0.0, 1.0, 50)[:, None]
    line = path.posture[0] + share * (path.posture[1] - path.posture[0])
    needed = max(compute_required_pressure(m, 0, machine.piston_forces(q)[0], speed) for q in line)
    weak = changed(machine, max_boost_pressure=needed + reserve * m.boost_margin)
    rules = FitRules.create_following()
    for factor in np.arange(1.0, 8.0, 0.02):
        fixed = replace(rules, ramp_factor=factor, max_ramp_factor=factor, max_stretch=1.01)
        with contextlib.suppress(FitError):
            shortest = from_rest(weak, path, replace(fixed, stepped=False))
            break
    motion = from_rest(weak, path, rules)
    assert factor > 1.3
    assert motion.refused == ()
    assert motion.trajectory.duration_ns <= shortest.trajectory.duration_ns + 0.01 * SECOND_NS
    assert_keeps_limits(motion, worst, weak)


def test_a_small_main_pump_stretches_the_motion(machine, walk, worst):
    path = walk(np.random.default_rng(2), 6)
    small = changed(machine, main_pump_flow=0.7 * machine.arrays.main_pump_flow)
    free, stretched = from_rest(machine, path), from_rest(small, path)
    assert stretched.stretch > 1.1
    assert stretched.trajectory.duration_ns > free.trajectory.duration_ns
    assert_keeps_limits(stretched, worst, small)


def test_the_excess_over_v_max_is_the_fastest_pistons(machine, walk):
    motion = from_rest(machine, walk(np.random.default_rng(3), 5))
    q, qd = motion.trajectory.position, motion.trajectory.velocity
    arms = np.array([machine.moment_arms(row) for row in q])
    fastest = np.abs(arms * qd).max()
    assert motion.speed_excess == pytest.approx(fastest / 0.012 - 1, abs=1e-9)


def test_a_start_that_moves_away_at_full_speed_does_not_run_on(machine, walk, worst):
    random = np.random.default_rng(4)
    turned = 0
    for old, at in moving_starts(machine, walk, random, 12):
        start = old.trajectory.sample(at)
        brake = brake_along(machine, old.trajectory, at)
        back = np.linspace(at, 0, 6)[1:].astype(np.int64)  # to where it came from, on its way
        postures = np.vstack([brake.position[-1:], old.trajectory.sample_many(back)[0]])
        path = replace(
            walk(random, 1, start=brake.position[-1], leap=0.0),
            posture=postures,
            tip=np.array([machine.tip_position(q) for q in postures]),
            modes=np.zeros((5, 3)),
            duration=np.full(5, max(1.0, at / SECOND_NS / 5)),
        )
        motion = fit_trajectory(machine, path, start, StartModes.read_from(old.schedule, at), brake)
        assert_keeps_limits(motion, worst, machine)
        turned += motion.braked

        def furthest(q, start=start):
            return np.max(np.sign(start.velocity) * (q - start.position), axis=0)

        overrun = furthest(motion.trajectory.position) - furthest(
            np.vstack([brake.position, postures])
        )
        assert np.all(overrun * np.abs(machine.moment_arms(start.position)) <= 2e-3 + 1e-9)
    assert turned > 0


def test_a_start_beside_a_joint_limit_does_not_pass_it(machine, walk, worst):
    limits = machine.arrays
    towards = MotionState(
        np.array([0.2, -1.2, limits.joint_max[2] - 0.01]), np.array([0.0, 0.0, 0.1]), np.zeros(3)
    )
    brake = brake_from(machine, towards, 0)
    path = walk(np.random.default_rng(5), 4, start=brake.position[-1], leap=0.0)
    motion = fit_trajectory(machine, path, towards, NORMAL, brake)
    assert_keeps_limits(motion, worst, machine)


def test_a_start_inside_a_mode_change_keeps_the_mode_that_was_just_switched_on(
    machine, walk, worst
):
    path = walk(np.random.default_rng(6), 5)
    start = MotionState.at_rest(path.posture[0])
    changing = ModeSchedule(0, [0, SECOND_NS], [[0, 0, 0], [0, 0, 1]])
    modes = StartModes.read_from(changing, SECOND_NS + 50_000_000)
    motion = fit_trajectory(machine, path, start, modes)
    assert motion.schedule.modes[0][2] > 0
    assert motion.schedule.modes_at(200_000_000)[2] > 0
    assert_keeps_limits(motion, worst, machine)


def test_a_start_outside_the_limits_by_noise_is_led_inside(machine, walk):
    path = walk(np.random.default_rng(7), 4)
    upper = machine.arrays.joint_max.copy()
    upper[1] = path.posture[0][1] - 1e-4
    tight = changed(machine, joint_max=upper)
    path = replace(path, posture=np.minimum(path.posture, [9.0, upper[1], 9.0]))
    start = MotionState.at_rest(path.posture[0] + [0.0, 1e-4, 0.0])
    path = replace(path, posture=np.vstack([start.position, path.posture[1:]]))
    motion = fit_trajectory(tight, path, start, NORMAL)
    assert motion.trajectory.position[:, 1].max() <= start.position[1] + 1e-7


def test_a_path_out_of_the_workspace_is_refused_with_every_reason(machine, walk):
    path = walk(np.random.default_rng(8), 3)
    beyond = path.posture.copy()
    beyond[2] = machine.arrays.joint_max + 0.1
    with pytest.raises(FitError) as refusal:
        from_rest(machine, replace(path, posture=beyond))
    assert len(refusal.value.refused) == 3
    assert "joint limit" in str(refusal.value)


def test_inputs_that_do_not_meet_are_refused(machine, walk):
    path = walk(np.random.default_rng(9), 3)
    rest = MotionState.at_rest(path.posture[0])
    moving = replace(rest, velocity=np.full(3, 0.1))
    elsewhere = MotionState.at_rest(path.posture[0] + 0.1)
    nothing = replace(
        path,
        posture=path.posture[:1],
        tip=path.tip[:1],
        modes=path.modes[:0],
        duration=path.duration[:0],
    )
    for bad_path, start, brake, reason in (
        (path, moving, None, "needs a braking motion"),
        (path, elsewhere, None, "must begin where the start comes to rest"),
        (path, elsewhere, brake_from(machine, moving, 0), "must begin at the start"),
        (nothing, rest, None, "without steps"),
    ):
        with pytest.raises(ValueError, match=reason):
            fit_trajectory(machine, bad_path, start, NORMAL, brake)


def test_stopping_brakes_along_the_path_and_holds(machine, walk, worst):
    random = np.random.default_rng(10)
    for old, at in moving_starts(machine, walk, random, 5):
        brake = brake_along(machine, old.trajectory, at)
        stop = fit_braking(machine, brake, StartModes.read_from(old.schedule, at))
        assert stop.method == FitMethod.BRAKING
        assert stop.trajectory.duration_ns <= 0.8 * SECOND_NS
        assert not stop.trajectory.velocity[-1].any()
        assert_keeps_limits(stop, worst, machine)


def test_an_end_that_too_few_modules_can_hold_is_refused_but_a_stop_there_is_not(machine, walk):
    random, without = np.random.default_rng(13), changed(machine, module_count=0)
    path = walk(random, 6)
    while not choose_holding_modes(machine, machine.piston_forces(path.posture[-1])).any():
        path = walk(random, 6)
    assert from_rest(machine, path).schedule.modes[-1].any()
    with pytest.raises(FitError, match=r"needs \d booster modules, 0 are fitted"):
        from_rest(without, path)
    stop = fit_braking(without, standstill(path.posture[-1]), NORMAL)
    assert not stop.schedule.modes.any()


@pytest.mark.parametrize("coasts", [True, False])
def test_an_interval_uses_the_largest_share_of_v_max_and_of_the_limits_at_its_ends(coasts):
    random, highest, slowing, first = np.random.default_rng(3), np.array([0.5, 1.0, 2.0]), 0.7, 4
    speed, limits = random.normal(0.0, 1.0, (13, 3)), random.uniform(0.0, 2.0, 12)
    share = (np.abs(speed) / highest).max(axis=1)
    fastest = max(1.1, s3_trajectory.USAGE_RESERVE * share[0]) if coasts else 1.1
    expected = np.maximum(np.maximum(share[:-1], share[1:]) / fastest, np.maximum(limits, slowing))
    expected[:first] = 0.0
    used, most = s3_trajectory._compute_uses(
        speed, frozen(highest), limits, 1.1, coasts, slowing, first
    )
    assert used == pytest.approx(expected)
    assert most == used.max()


def test_after_warming_up_nothing_is_compiled_any_more(machine, walk):
    warm_up(machine)
    kernels = [
        s3_limits._measure_states,
        joint_range.bound_joint_excess,
        piston_motion.convert_to_joints,
        ramped_motion._sample_pistons,
        s4_mode_schedule._choose_interval_modes,
    ]
    before = [len(kernel.signatures) for kernel in kernels]
    path = walk(np.random.default_rng(12), 6)
    from_rest(machine, path, FitRules(max_ramp_factor=1.0))
    assert [len(kernel.signatures) for kernel in kernels] == before


def test_a_motion_longer_than_an_arm_takes_is_refused_with_its_duration(machine, walk):
    path = walk(np.random.default_rng(3), 6)
    slow = changed(machine, max_piston_speed=np.full(3, 1e-6))
    slow_path = replace(path, duration=path.duration * machine.arrays.max_piston_speed[0] / 1e-6)
    with pytest.raises(FitError, match=r"it takes .* s, at most 590 s is allowed"):
        from_rest(slow, slow_path)
