"""Promises about motion, each broken on purpose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.soak import motion_promises
from tests.soak.events import PLANNER, SIM, ActionKind

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_sim.simulation.supervision import Phase


def moved(table, rows, offset):
    """A table of joints with some rows moved by an offset [rad]."""
    position = table.position.copy()
    position[rows] += offset
    return replace(table, position=position)


def test_a_jump_at_a_hand_over_is_told(events, spoilt):
    [applied] = events.recording.hand_overs
    for jump in ({"position_jump": 2e-6}, {"velocity_jump": 2e-6}, {"position_jump": np.nan}):
        worse = replace(applied, value=replace(applied.value, **jump))
        kept = motion_promises.check_hand_over_jumps(spoilt(recording={"hand_overs": (worse,)}))
        assert "plan 10.500 s" in kept.violations[0]


def test_a_step_between_two_references_is_told_but_where_everything_starts_anew(
    events, spoilt, make
):
    stepped = moved(events.recording.references, slice(2500, None), 2e-6)
    kept = motion_promises.check_continuous_reference(spoilt(recording={"references": stepped}))
    assert kept.violations == ("at 24.990 s it jumps by 2e-06 rad",)
    anew = (*events.actions, make.deed(ActionKind.RESET, SIM, 24.9, 24.95))
    assert motion_promises.check_continuous_reference(
        spoilt(recording={"references": stepped}, actions=anew)
    ).is_kept
    told = moved(events.recording.references, slice(4080, None), 0.1)  # as a fault is reported
    assert motion_promises.check_continuous_reference(
        spoilt(recording={"references": told})
    ).is_kept


@pytest.mark.parametrize(("step", "held"), [(0.0, True), (2e-5, False)])
def test_a_jump_of_the_jerk_is_told_from_a_jump_of_the_reference(events, spoilt, step, held):
    table, after_s = events.recording.references, 20.0021  # the jerk jumps within a period
    since = np.clip(1e-9 * (table.time_ns - table.time_ns[0]) - after_s, 0.0, 0.05)[:, None]
    jerk = 1000.0
    bent = replace(
        table,
        position=table.position + jerk * since**3 / 6 + step * (since > 0.0),
        velocity=table.velocity + jerk * since**2 / 2,
        acceleration=table.acceleration + jerk * since,
    )
    before = slice(0, 2005)  # the curve holds for a while after the jump
    bent = replace(bent, **{name: getattr(bent, name)[before] for name in vars(bent)})
    kept = motion_promises.check_continuous_reference(spoilt(recording={"references": bent}))
    assert kept.is_kept is held, kept.violations


def test_a_reference_beside_the_plan_in_force_is_told(events, spoilt):
    table = events.recording.references
    beside = moved(table, slice(1200, 1300), 1e-8)
    kept = motion_promises.check_reference_is_plan(spoilt(recording={"references": beside}))
    assert "1e-08 rad from plan" in kept.violations[0]
    unnoticed = moved(table, slice(2000, 2100), 1e-8)  # no plan is in force any more
    assert motion_promises.check_reference_is_plan(
        spoilt(recording={"references": unnoticed})
    ).is_kept


def test_a_plan_that_is_slowed_may_be_left_and_may_bend_but_not_step(events, spoilt, make):
    report = events.recording.simulator_reports[0].value
    late = (make.heard(12.5, replace(report, plan_delay=0.1)),)
    table = events.recording.references
    for offset, held in ((1e-5, True), (1e-4, False)):
        beside = moved(table, slice(1200, 1300), offset)
        slowed = spoilt(recording={"references": beside, "simulator_reports": late})
        assert motion_promises.check_reference_is_plan(slowed).is_kept
        assert motion_promises.check_continuous_reference(slowed).is_kept is held


def test_a_joint_beyond_its_limit_is_told_with_the_worst_of_it(events, spoilt):
    upper = events.machine.arrays.joint_max[0]
    beyond = moved(events.recording.references, slice(700, 710), [upper - 0.3 + 0.01, 0.0, 0.0])
    kept = motion_promises.check_joint_limits(spoilt(recording={"references": beyond}))
    assert kept.violations == ("10 times, 0.01 rad beyond a limit at 7.00 s",)


def test_a_piston_too_fast_is_told(events, spoilt):
    table = events.recording.references
    fast = replace(table, velocity=table.velocity.copy())
    arm = events.machine.moment_arms(table.position[700])[0]
    fast.velocity[700, 0] = 1.1 * events.machine.arrays.max_piston_speed[0] / arm
    kept = motion_promises.check_speed_limits(spoilt(recording={"references": fast}))
    assert kept.violations[0].startswith("1 times, 1.1 of V_max or the flow at 7.00 s")


def test_the_table_planners_polynomials_may_pass_v_max_a_little_and_may_bend_sharply(
    events, spoilt, make
):
    table = events.recording.references
    fast = replace(table, velocity=table.velocity.copy())
    arm = events.machine.moment_arms(table.position[700])[0]
    fast.velocity[700, 0] = 1.08 * events.machine.arrays.max_piston_speed[0] / arm
    told = (*events.actions, make.deed(ActionKind.PARAMETER, PLANNER, 6.0, 6.0, "table"))
    allowed = spoilt(recording={"references": fast}, actions=told)
    assert motion_promises.check_speed_limits(allowed).is_kept
    fast.velocity[700, 0] *= 1.05
    assert not motion_promises.check_speed_limits(allowed).is_kept
    bent = replace(table, acceleration=table.acceleration.copy())
    bent.acceleration[1200::2] += 10.0  # as where its jerk jumps
    rows = np.arange(1200, 1210)
    assert motion_promises.gaps(bent, rows).max() > motion_promises.UNEVEN_IN_MOTION
    assert motion_promises.check_continuous_reference(
        spoilt(recording={"references": bent})
    ).is_kept


@pytest.mark.parametrize("inside_from_the_start", [False, True])
def test_a_zone_that_is_entered_is_told_but_not_one_that_is_left(
    spoilt, make, events, inside_from_the_start
):
    row = 0 if inside_from_the_start else -1
    x, z = events.machine.tip_position(events.recording.references.position[row])
    zones = Zones(tip_circles=((float(x), float(z), 0.02),))
    deeds = (make.deed(ActionKind.ZONES, PLANNER, 5.0, 5.01, zones),)
    kept = motion_promises.check_zones(spoilt(actions=deeds))
    assert kept.is_kept == inside_from_the_start
    assert kept.tested > 0


@pytest.mark.parametrize(("reset_until", "held"), [(15.5, True), (12.0, False)])
def test_an_arm_that_a_reset_puts_into_a_zone_has_not_entered_it(
    spoilt, make, events, reset_until, held
):
    """The arm moves into the zone until 15 s."""
    x, z = map(float, events.machine.tip_position(events.recording.references.position[-1]))
    deeds = (
        make.deed(ActionKind.ZONES, PLANNER, 5.0, 5.01, Zones(tip_circles=((x, z, 0.02),))),
        make.deed(ActionKind.RESET, SIM, 10.0, reset_until),
    )
    assert motion_promises.check_zones(spoilt(actions=deeds)).is_kept is held


def test_zones_hold_from_two_seconds_after_they_were_set_until_they_are_taken_back(
    spoilt, make, events
):
    x, z = map(float, events.machine.tip_position(events.recording.references.position[-1]))
    there = Zones(tip_circles=((x, z, 0.02),))
    for begin, end in ((14.9, 20.0), (5.0, 12.0)):
        deeds = (
            make.deed(ActionKind.ZONES, PLANNER, begin, begin, there),
            make.deed(ActionKind.ZONES, PLANNER, end, end, Zones()),
        )
        assert motion_promises.check_zones(spoilt(actions=deeds)).is_kept


def test_a_zone_in_space_is_entered_where_the_arm_turns_into_it(spoilt, make, events):
    machine = load_machine(find_config_file("excavator.yaml"))
    start = np.array(machine.config.simulation.start_posture)
    table = events.recording.references
    position = np.tile(start, (len(table.time_ns), 1))
    position[:, 0] = np.linspace(0.0, 1.5, len(position))  # turns left for a minute
    turned = replace(table, position=position)
    for slew, held in ((1.0, False), (-1.0, True)):
        x, y, z = machine.tip_in_base(np.array([slew, *start[1:]])).tolist()
        deeds = (make.deed(ActionKind.ZONES, PLANNER, 5.0, 5.01, Zones(spheres=((x, y, z, 0.1),))),)
        recording = {"references": turned}
        kept = motion_promises.check_zones(
            spoilt(machine=machine, recording=recording, actions=deeds)
        )
        assert kept.is_kept is held
        assert kept.tested > 5000


def test_the_zones_of_the_machine_file_hold_from_the_planners_start(spoilt, events):
    x, z = map(float, events.machine.tip_position(events.recording.references.position[-1]))
    machine = events.machine.changed(zones=Zones(tip_circles=((x, z, 0.02),)))
    assert not motion_promises.check_zones(spoilt(machine=machine, actions=())).is_kept


def test_a_motion_after_a_stop_is_told_until_the_next_goal(spoilt, make, events):
    stop = make.deed(ActionKind.STOP, PLANNER, 9.0, 9.01)
    kept = motion_promises.check_rest_after_stops(spoilt(actions=(stop,)))
    assert kept.violations == ("stopped by the planner at 9.00 s, it moves at 11.02 s",)
    goal = make.deed(ActionKind.GOAL, PLANNER, 10.9, 10.9, 1)
    assert motion_promises.check_rest_after_stops(spoilt(actions=(stop, goal))).is_kept
    refused = replace(stop, done=False)
    assert motion_promises.check_rest_after_stops(spoilt(actions=(refused,))).is_kept


def test_an_arm_that_slews_has_longer_to_brake(spoilt, make, events):
    excavator = load_machine(find_config_file("excavator.yaml"))
    stop = make.deed(ActionKind.STOP, PLANNER, 12.4, 12.41)  # moves until 15 s
    assert not motion_promises.check_rest_after_stops(spoilt(actions=(stop,))).is_kept
    allowed = spoilt(machine=excavator, actions=(stop,))
    assert motion_promises.check_rest_after_stops(allowed).is_kept


def test_a_lunge_after_healing_is_told(spoilt, events):
    states = events.recording.joint_states
    lunging = replace(states, position=states.position.copy())
    lunging.position[5100:] += 0.1
    kept = motion_promises.check_healing(spoilt(recording={"joint_states": lunging}))
    assert "after healing main_pump at 50.00 s: 1 rad/s" in kept.violations[0]
    first_goal = events.actions_of(ActionKind.GOAL)[0]
    goal = replace(first_goal, begin_ns=events.actions[-1].begin_ns + 500_000_000)
    moved_by_goal = spoilt(recording={"joint_states": lunging}, actions=(*events.actions, goal))
    assert motion_promises.check_healing(moved_by_goal).is_kept


def test_an_arm_that_still_brakes_when_it_is_healed_does_not_lunge(spoilt, events):
    states, references = events.recording.joint_states, events.recording.references
    lunging = replace(states, position=states.position.copy())
    lunging.position[5100:] += 0.1
    for braked, held in ((4000, False), (5105, True)):
        braking = replace(references, velocity=references.velocity.copy())
        braking.velocity[5000:braked] = 0.1
        braking.velocity[5010:5020] = 0.0
        recording = {"joint_states": lunging, "references": braking}
        assert motion_promises.check_healing(spoilt(recording=recording)).is_kept is held


def test_an_arm_that_swings_behind_closed_valves_is_judged_once_it_rests(spoilt, events, make):
    """The swing begins before the healing at 50 s. It ends at 52 s, and a lunge follows at 54 s."""
    states, (running, faulty, healed) = (
        events.recording.joint_states,
        events.recording.simulator_reports,
    )
    time = np.arange(-100, 200) / 100.0
    swinging = replace(states, position=states.position.copy())
    swinging.position[4900:5200, 0] += 0.01 * np.sin(10.0 * np.pi * time)
    lunging = replace(swinging, position=swinging.position.copy())
    lunging.position[5400:] += 0.1
    for sentence, table, held in (
        (f"a valve fails: {Phase.CLOSED.value}", swinging, True),
        (f"a valve fails: {Phase.CLOSED.value}", lunging, False),
        (f"a valve fails: {Phase.STOPPING.value}", swinging, False),
        (f"a valve fails: {Phase.HELD.value}", swinging, False),
    ):
        closed = replace(faulty, value=replace(faulty.value, sentence=sentence))
        rests = replace(healed, recorded_ns=make.ns(52.0))
        recording = {"joint_states": table, "simulator_reports": (running, closed, rests)}
        assert motion_promises.check_healing(spoilt(recording=recording)).is_kept is held
