"""Switching times: need, lead, dwell, budget, and no flicker."""

from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mhsb_model.holding import choose_holding_modes
from mhsb_model.hydraulics import needs_boost
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, Trajectory, standstill
from mhsb_planner.motion.motion_profile import MotionProfile
from mhsb_planner.motion.s4_mode_schedule import (
    BOOST_LEAD,
    MIN_DWELL,
    ScheduledMotion,
    StartModes,
    compute_interval_modes,
    keeps_dwell,
)

N, DB, SB = Mode.N, Mode.DB, Mode.SB
LIGHT, HEAVY = 500.0, 3000.0  # N, against extension: below and above what P_S lifts
SPACING = 0.02
NORMAL = StartModes.create_settled([N, N, N])


def profile(seconds, speed, force=(LIGHT, LIGHT, LIGHT), inertia=(0.0, 0.0, 0.0)):
    """Times and profile with speed(t) float64[k, n] or a row, and likewise force and inertia."""
    time = np.arange(0, seconds + SPACING / 2, SPACING)
    speeds, forces, inertias = (
        np.broadcast_to(f(time) if callable(f) else f, (len(time), 3)).copy()
        for f in (speed, force, inertia)
    )
    return time, MotionProfile(speeds, forces, np.zeros((len(time), 2)), inertias, 0.0 * speeds)


def scheduled(machine, time, motion, start, preferred=None):
    """The modes between the instants of a motion that ends in its holding modes."""
    hold = choose_holding_modes(machine, motion.force[-1])
    return compute_interval_modes(machine, time, motion, start, hold, preferred)


def lifts(begin, end):
    """Force on actuator 1: heavy between begin and end, light otherwise."""

    def force(time):
        values = np.full((len(time), 3), LIGHT)
        values[(time >= begin) & (time <= end), 0] = HEAVY
        return values

    return force


def runs(modes, time, j=0):
    """(mode, begin, end) of the runs of actuator j."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(modes[:, j])) + 1, [len(modes)]])
    return [(int(modes[a, j]), float(time[a]), float(time[b])) for a, b in pairwise(edges)]


def test_a_light_motion_stays_in_normal_mode(machine):
    time, motion = profile(3, [0.012, -0.012, 0.012])
    assert not scheduled(machine, time, motion, NORMAL).any()


def test_boost_begins_before_its_need_and_ends_with_it(machine):
    time, motion = profile(5, [0.006, 0.0, 0.0], lifts(2.0, 4.0))
    found = runs(scheduled(machine, time, motion, NORMAL), time)
    assert [mode for mode, _, _ in found] == [N, DB, N]
    assert found[1][1] == pytest.approx(2.0 - SPACING - 0.1, abs=0.021)
    assert found[1][2] == pytest.approx(4.0 + SPACING, abs=0.021)


def test_what_the_pump_cannot_accelerate_is_boosted_meanwhile(machine):
    def accelerated(time):
        return lifts(2.0, 2.4)(time) - LIGHT

    time, motion = profile(5, [0.006, 0.0, 0.0], inertia=accelerated)
    found = runs(scheduled(machine, time, motion, NORMAL), time)
    assert [mode for mode, _, _ in found] == [N, DB, N]
    assert found[1][1] == pytest.approx(2.0 - SPACING - 0.1, abs=0.021)
    assert found[1][2] == pytest.approx(2.4 + SPACING, abs=0.021)
    _, slowed = profile(5, [0.006, 0.0, 0.0], inertia=lambda time: -accelerated(time))
    assert not scheduled(machine, time, slowed, NORMAL).any()


def test_the_margin_covers_inertia_up_to_a_half(machine):
    oil, cap = machine.arrays, machine.arrays.cap_area[0]
    rod = machine.arrays.rod_area[0]
    load = cap * (oil.supply_pressure - oil.boost_margin) - rod * oil.tank_pressure
    load -= 20.0  # the valve's drop at 0.5 mm/s, and rounding
    for share, boosted in ((0.0, False), (0.4, False), (0.6, True)):
        push = [share * cap * oil.boost_margin, 0.0, 0.0]
        time, motion = profile(2, [0.0005, 0.0, 0.0], [load, LIGHT, LIGHT], push)
        assert scheduled(machine, time, motion, NORMAL).any() == boosted


def test_more_flow_than_one_servo_pump_has_is_shared_boost(machine):
    time, motion = profile(5, [0.012, 0.0, 0.0], lifts(2.0, 4.0))
    found = runs(scheduled(machine, time, motion, NORMAL), time)
    assert [mode for mode, _, _ in found] == [N, SB, N]


def test_shared_boost_chosen_by_the_search_is_kept_while_boosted(machine):
    time, motion = profile(5, [0.006, 0.0, 0.0], lifts(2.0, 4.0))
    preferred = np.full((len(time), 3), SB)
    found = runs(scheduled(machine, time, motion, NORMAL, preferred), time)
    assert [mode for mode, _, _ in found] == [N, SB, N]


def test_a_lowered_load_needs_no_boost_however_heavy_it_is(machine):
    time, motion = profile(4, [-0.012, 0.0, 0.0], [HEAVY, LIGHT, LIGHT])
    modes = scheduled(machine, time, motion, NORMAL)
    assert runs(modes, time)[0][0] == N
    assert runs(modes, time)[-1][2] == pytest.approx(4.0)


def test_short_gaps_are_closed_and_short_needs_are_lengthened(machine):
    def force(time):
        values = np.full((len(time), 3), LIGHT)
        needed = ((time > 1.0) & (time < 1.1)) | ((time > 1.35) & (time < 1.4))
        values[needed | ((time > 3.0) & (time < 3.02 + SPACING)), 0] = HEAVY
        return values

    time, motion = profile(5, [0.006, 0.0, 0.0], force)
    found = runs(scheduled(machine, time, motion, NORMAL), time)
    assert [mode for mode, _, _ in found] == [N, DB, N, DB, N]
    assert all(end - begin >= 0.3 - 1e-9 for _, begin, end in found)


def test_nothing_switches_around_standstill(machine):
    def speed(time):
        return 5e-5 * np.sin(7 * time)[:, None] * [1.0, 1.0, 1.0]

    for force in (LIGHT, HEAVY):
        time, motion = profile(6, speed, [force, LIGHT, -LIGHT])
        modes = scheduled(machine, time, motion, NORMAL)
        assert len(runs(modes, time)) == 1
        assert runs(modes, time)[0][0] == (DB if force == HEAVY else N)


def test_a_heavy_load_is_boosted_while_it_is_held_for_long_but_not_at_a_short_stop(machine):
    def speed(pause):
        def values(time):
            rows = np.zeros((len(time), 3))
            rows[:, 0] = np.where((time > 2) & (time < 2 + pause), 0.0, -0.01)
            return rows

        return values

    def force(time):  # light again at the end, so that holding it needs nothing
        rows = np.full((len(time), 3), LIGHT)
        rows[time < 5.5, 0] = HEAVY
        return rows

    for pause, expected in ((0.6, [N]), (1.6, [N, DB, N])):
        time, motion = profile(6, speed(pause), force)
        found = runs(scheduled(machine, time, motion, NORMAL), time)
        assert [mode for mode, _, _ in found] == expected


def test_boost_in_force_at_the_start_goes_on_if_it_is_needed_again_soon(machine):
    time, motion = profile(3, [0.006, 0.0, 0.0], lifts(0.25, 2.0))
    boosted = StartModes.create_settled([DB, N, N])
    assert runs(scheduled(machine, time, motion, boosted), time)[0][0] == DB


def test_boost_in_force_at_the_start_ends_at_once_if_it_is_not_needed(machine):
    time, motion = profile(3, [0.006, 0.0, 0.0])
    boosted = StartModes.create_settled([DB, N, N])
    assert not scheduled(machine, time, motion, boosted).any()


def test_a_mode_that_has_just_been_switched_on_stays_for_its_dwell(machine):
    time, motion = profile(3, [0.006, 0.0, 0.0])
    for mode in (DB, SB):
        young = StartModes(np.array([mode, N, N]), np.array([0.1, 9.0, 9.0]))
        found = runs(scheduled(machine, time, motion, young), time)
        assert [kind for kind, _, _ in found] == [mode, N]
        assert found[0][2] == pytest.approx(0.2, abs=SPACING)


def test_start_modes_know_since_when_they_are_in_force():
    schedule = ModeSchedule(1000, [0, SECOND_NS, 3 * SECOND_NS], [[0, 0, 0], [1, 0, 0], [1, 2, 0]])
    start = StartModes.read_from(schedule, 1000 + 4 * SECOND_NS)
    assert start.modes.tolist() == [1, 2, 0]
    assert start.age == pytest.approx([3.0, 1.0, np.inf])
    early = StartModes.read_from(schedule, 1000 + 2 * SECOND_NS)
    assert early.modes.tolist() == [1, 0, 0]
    assert early.age == pytest.approx([1.0, np.inf, np.inf])


def test_where_modules_are_short_the_least_demand_gives_way(machine):
    time, motion = profile(4, [0.012, 0.0115, 0.011], [HEAVY, HEAVY, HEAVY])
    modes = scheduled(machine, time, motion, NORMAL)
    assert modes[0].tolist() == [SB, DB, DB]


def test_a_short_boost_begins_with_its_lead_and_lasts_the_dwell(machine):
    time, motion = profile(5, [0.006, 0.0, 0.0], lifts(2.0, 2.1))
    found = runs(scheduled(machine, time, motion, NORMAL), time)
    assert found[1][1] == pytest.approx(2.0 - BOOST_LEAD, abs=0.05)
    assert found[1][2] - found[1][1] == pytest.approx(MIN_DWELL, abs=0.05)


def test_a_schedule_begins_with_the_trajectory_and_ends_with_its_holding_modes(machine):
    start = np.array([0.0, 0.0, 0.0])
    u = np.linspace(0, 1, 101)[:, None]
    lift = np.array([0.1, 0.0, 0.0])
    motion = Trajectory(
        77,
        np.arange(101) * 20_000_000,
        start + lift * (10 * u**3 - 15 * u**4 + 6 * u**5),
        lift * (30 * u**2 - 60 * u**3 + 30 * u**4) / 2,
        lift * (60 * u - 180 * u**2 + 120 * u**3) / 4,
    )
    schedule = ScheduledMotion.create(machine, motion, NORMAL).schedule
    assert schedule.stamp_ns == 77
    assert schedule.offset_ns[0] == 0
    assert schedule.end_ns == motion.end_ns
    assert (
        schedule.modes[-1].tolist()
        == choose_holding_modes(machine, machine.piston_forces(motion.position[-1])).tolist()
    )
    assert np.all(schedule.modes[:, 0] > 0)


def test_an_arm_that_does_not_move_gets_its_holding_modes(machine):
    stretched = np.zeros(3)
    scheduled = ScheduledMotion.create(machine, standstill(stretched, 5), NORMAL)
    schedule = scheduled.schedule
    assert scheduled.switch_count == 0
    assert schedule.offset_ns.tolist() == [0]
    expected = choose_holding_modes(machine, machine.piston_forces(stretched))
    assert schedule.modes[0].tolist() == expected.tolist()


def random_motion(seed):
    """Smooth speeds and forces of three actuators, from rest to rest, 3 to 12 s; start modes."""
    random = np.random.default_rng(seed)
    time = np.arange(0, random.uniform(3, 12), SPACING)
    rate, phase = random.uniform(0.2, 2.0, (2, 1, 3)), random.uniform(0, 6, (2, 1, 3))
    waves = np.sin(rate * time[:, None] + phase)
    fade = np.minimum(1, 4 * np.minimum(time, time[-1] - time))[:, None]
    speed = random.uniform(0.003, 0.014) * waves[0] * fade
    force = random.uniform(-500, 1500, 3) + random.uniform(0, 2500, 3) * waves[1]
    while True:
        modes = random.integers(0, 3, 3)
        if modes.sum() <= 4:  # modules
            break
    start = StartModes(modes, random.choice([0.0, 0.1, 0.25, 5.0], 3))
    return (
        time,
        MotionProfile(speed, force, np.zeros((len(time), 2)), 0.0 * force, 0.0 * force),
        start,
    )


@settings(max_examples=150)
@given(st.integers(0, 2**32))
def test_every_schedule_covers_every_need_within_the_budget_and_without_flicker(machine, seed):
    time, motion, start = random_motion(seed)
    modes = scheduled(machine, time, motion, start)
    hold = choose_holding_modes(machine, motion.force[-1])
    m = machine.arrays
    # SB stays for 0.3 s, so that at first another need may be beyond the budget: the limits then
    # refuse the motion (`find_first_violation`).
    kept_in_sb = (0.3 - start.age)[start.modes == SB].max(initial=0.0)
    free = time[:-1] >= kept_in_sb - 1e-9
    assert m.modules_per_mode[modes[free]].sum(axis=1).max(initial=0) <= m.module_count
    for j in range(3):
        kept = 0.3 - start.age[j]  # until then a mode that has just been switched stays
        for i in range(len(modes)):
            if time[i] < kept - 1e-9:
                assert modes[i, j] == start.modes[j], (j, time[i])
                continue
            for k in (i, i + 1):
                v, f = motion.speed[k, j], motion.force[k, j]
                if abs(v) > 2e-4 and needs_boost(m, j, f, v):
                    assert modes[i, j] != N, (j, time[k])
        switched = switches(modes, time, start, hold, j)
        assert all(later - earlier >= 0.3 - 1e-9 for earlier, later in pairwise(switched))
    assert keeps_dwell(time, modes, start, hold)


@settings(max_examples=300)
@given(
    steps=st.lists(st.sampled_from([0.05, 0.1, 0.15, 0.3]), min_size=6, max_size=6),
    heavy=st.lists(st.booleans(), min_size=7, max_size=7),
    shares=st.lists(st.booleans(), min_size=7, max_size=7),
    modes=st.tuples(st.sampled_from([N, DB, SB]), st.sampled_from([N, DB, SB])),
    age=st.sampled_from([0.0, 0.1, 0.2, 9.0]),
)
@example([0.1] * 6, 6 * [False] + [True], 7 * [False], (N, SB), 9.0)  # boost shortly before SB
def test_the_dwell_is_kept_if_any_sequence_of_modes_keeps_it(
    machine, steps, heavy, shares, modes, age
):
    """All sequences of actuator 1 are tried, at rest in `modes[1]` after the last instant."""
    time, (before, after) = np.cumsum([0.0, *steps]), modes
    force, preferred = np.full((7, 3), LIGHT), np.full((7, 3), N)
    force[heavy, 0], preferred[shares, 0] = HEAVY, SB
    motion = MotionProfile(np.full((7, 3), 0.006), force, np.zeros((7, 2)), 0 * force, 0 * force)
    start, hold = StartModes([before, N, N], [age, 9.0, 9.0]), np.array([after, N, N], np.uint8)
    found = compute_interval_modes(machine, time, motion, start, hold, preferred)
    stays = time[:-1] < 0.3 - age - 1e-9
    needs = np.logical_or(heavy[:-1], heavy[1:]) & ~stays
    assert np.all(found[stays, 0] == before)
    assert np.all(found[needs, 0] != N)

    def is_kept(sequence):
        switched = switches(np.array(sequence)[:, None], time, start, hold, 0)
        return all(later - earlier >= 0.3 - 1e-9 for earlier, later in pairwise(switched))

    assert is_kept(found[:, 0]) or not any(
        is_kept(sequence)
        for sequence in product(*[(before,) if at else (N, DB, SB) for at in stays])
        if N not in np.array(sequence)[needs]
    )


def switches(modes, time, start, hold, j):
    """When actuator j is switched, the last time before the first instant included."""
    sequence = [start.modes[j], *modes[:, j], hold[j]]
    at = [time[i] for i, (old, new) in enumerate(pairwise(sequence)) if old != new]
    return [time[0] - start.age[j], *at]


def test_a_motion_that_is_too_short_for_its_switches_is_told_from_others(machine):
    time, motion = profile(0.2, [0.006, 0.0, 0.0], [HEAVY, LIGHT, LIGHT])
    hold = np.array([N, N, N], dtype=np.uint8)
    modes = compute_interval_modes(machine, time, motion, NORMAL, hold)
    assert modes[:, 0].all()
    assert not keeps_dwell(time, modes, NORMAL, hold)
    assert keeps_dwell(time, modes, StartModes.create_settled([DB, N, N]), hold)
    assert not keeps_dwell(time, modes, StartModes([DB, N, N], [0.05, 9.0, 9.0]), hold)


def test_normal_mode_that_has_just_been_switched_to_stays_although_boost_is_needed(machine):
    time, motion = profile(3, [0.006, 0.0, 0.0], [HEAVY, LIGHT, LIGHT])
    young = StartModes([N, N, N], [0.1, 9.0, 9.0])
    found = runs(scheduled(machine, time, motion, young), time)
    assert [kind for kind, _, _ in found] == [N, DB]
    assert found[0][2] == pytest.approx(0.2, abs=SPACING)


def test_shared_boost_after_boost_that_has_just_begun_lasts_long_enough(machine):
    def fast_at_first(time):
        speed = np.where((time > 0.1) & (time < 0.3), 0.012, 0.006)
        return np.column_stack([speed, 0 * time, 0 * time])

    time, motion = profile(3, fast_at_first, lifts(0.0, 0.3))
    young = StartModes([DB, N, N], [0.1, 9.0, 9.0])
    found = runs(scheduled(machine, time, motion, young), time)
    assert [kind for kind, _, _ in found] == [DB, SB, N]
    assert found[1][2] - found[1][1] >= 0.3 - 1e-9
