"""Zones that are set ahead of a moving arm: what is said of them is what the arm then does."""

import re
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.lock_step import LockStepWorld
from tests.support.zones_ahead import PROMISES_NOTHING, random_trial, read_distance

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import Outcome
from mhsb_planner.online import zone_ahead
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.online.settings import Settings
from mhsb_planner.planner import PlanOptions
from mhsb_planner.posture.s1_global_search import build_posture_table

FILES = ("mhsb_arm3", "mhsb_arm4", "telescope_arm", "excavator", "forestry_crane")
SAMPLE = 8
WHOLE = 40
ASIDE = (-1.5, 1.5, 0.3)
"""Where an excavator gets in seven seconds, most of them slewing [m]."""


def replanner_of(machine):
    """A planner whose table is coarse, and quickly built."""
    return Replanner(machine, build_posture_table(machine.planar_arm, spacing=3 * machine.spacing))


@pytest.fixture(scope="module")
def excavator():
    return load_machine(find_config_file("excavator.yaml"))


@pytest.fixture(scope="module")
def digging(excavator):
    return replanner_of(excavator)


@pytest.fixture
def digging_world(excavator, digging):
    """An excavator at rest."""
    digging.change_machine(excavator)
    return LockStepWorld(excavator, digging, Settings(excavator, PlanOptions(planner="table")))


def check_trials(machine, replanner, seed, count):
    """Random trials, every second one of a busy arm; no sentence is false. Returns them."""
    random = np.random.default_rng(seed)
    settings = Settings(machine, PlanOptions(planner="table"))
    trials = [
        random_trial(machine, replanner, settings, random, busy=k % 2 == 1) for k in range(count)
    ]
    for k, trial in enumerate(trials):
        assert trial.is_announcement_true, (seed, k, trial)
        promised = trial.sentences and not trial.sentences[-1].startswith(PROMISES_NOTHING)
        assert not promised or trial.sentences[-1] == trial.ending, (seed, k, trial)
    return trials


def test_nothing_false_is_said_of_random_zones_ahead_of_the_suites_arm(
    new_world, machine, fresh_seed
):
    check_trials(machine, new_world().replanner, fresh_seed, SAMPLE)


def test_nothing_false_is_said_of_random_zones_ahead_of_an_excavator(
    excavator, digging, fresh_seed
):
    check_trials(excavator, digging, fresh_seed, SAMPLE)


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES)
def test_nothing_false_is_said_of_many_random_zones_ahead_of_each_arm(file, fresh_seed):
    machine = load_machine(find_config_file(f"{file}.yaml"))
    trials = check_trials(machine, replanner_of(machine), fresh_seed, WHOLE)
    undisturbed = [trial.stops_before for trial in trials[::2]]
    assert np.mean(undisturbed) > 0.7
    print(file, np.mean(undisturbed), np.mean([trial.stops_before for trial in trials]))


def across(world, share, size=0.02):
    """The world's settings with a zone where the tip is after a share of what is left.

    size  its radius, as a share of the arm's reach
    """
    motion, now_ns = world.arm.command.trajectory, world.arm.time_ns
    there = motion.sample(now_ns + round(share * (motion.end_ns - now_ns))).position
    tip = world.machine.tip_in_base(there)
    zone = (*np.asarray(tip).tolist(), size * world.machine.config.workspace.max_radius)
    kind = "tip_spheres" if world.machine.slews else "tip_circles"
    crowded = world.machine.changed(zones=Zones(**{kind: (zone,)}))
    return Settings(crowded, PlanOptions(planner="table"))


def under_way(world, *goal, left):
    """Go to a goal until so much time is left of the motion [s]; the goal's stamp."""
    stamp = world.send_goal(*goal)
    world.pass_time_until(lambda: world.arm.is_moving)
    motion = world.arm.command.trajectory
    world.pass_time((motion.end_ns - world.arm.time_ns) / SECOND_NS - left)
    return stamp


def rests_clear(world, settings):
    """Let the arm come to rest; whether it has been clear of all obstacles on the way."""
    closest = []

    def rests():
        closest.append(settings.machine.clearance(world.arm.reference.position)[0])
        return world.is_idle and not world.arm.is_moving

    world.pass_time_until(rests)
    return min(closest) > 0.0


def test_an_excavator_with_two_seconds_left_stops_before_a_zone_at_its_goal(digging_world):
    """A planned stop would take longer than what is left, and lead on to the goal."""
    world = digging_world
    stamp = under_way(world, *ASIDE, left=2.0)
    settings = across(world, 1.0)
    world.life.change_settings(settings)
    assert rests_clear(world, settings)
    assert world.execution_report(stamp).outcome is Outcome.STOPPED
    assert world.execution_report(stamp).sentence.endswith(
        "across the way; the arm stops before it"
    )


def test_a_zone_far_ahead_is_braked_for_as_softly_as_any_stop(digging_world):
    world = digging_world
    under_way(world, *ASIDE, left=4.0)
    own, now_ns = world.arm.command, world.arm.time_ns
    planned, _ = world.replanner.make_braking_command(own, now_ns, 0.03)
    world.life.change_settings(across(world, 1.0))
    braking = world.sent[-1].trajectory
    assert braking.end_ns == planned.trajectory.end_ns
    assert braking.position[-1] == pytest.approx(planned.trajectory.position[-1], abs=1e-12)


def test_a_zone_that_no_braking_stays_clear_of_is_entered_less_far_than_by_a_planned_stop(
    digging_world,
):
    world = digging_world
    stamp = under_way(world, *ASIDE, left=2.5)
    settings = across(world, 0.15, size=0.06)
    planned, _ = world.replanner.make_braking_command(world.arm.command, world.arm.time_ns, 0.03)
    world.life.change_settings(settings)
    assert not rests_clear(world, settings)
    end = world.arm.command.trajectory.position[-1]
    sentence = world.execution_report(stamp).sentence
    assert "the arm stops as soon as it can, but not before it: it comes to rest" in sentence
    depth = read_distance(re.search(r"comes to rest ([\d.]+ m?m) deep in it$", sentence)[1])
    assert depth == pytest.approx(-settings.machine.clearance(end)[0], abs=1e-3)
    begin = world.sent[0].trajectory.position[0]
    assert np.abs(end - begin).sum() < np.abs(planned.trajectory.position[-1] - begin).sum()


def test_a_sentence_that_a_lost_command_made_false_is_corrected_and_reported(digging_world):
    world = digging_world
    stamp = under_way(world, *ASIDE, left=2.5)
    settings = across(world, 0.2)
    world.lost = 1
    world.life.change_settings(settings)
    assert not rests_clear(world, settings)
    assert world.warnings[0].endswith("the arm stops before it")
    assert not world.warnings[-1].endswith("the arm stops before it")
    assert world.execution_report(stamp).sentence == world.warnings[-1]


def test_a_zone_set_while_a_plan_is_on_its_way_is_braked_for_when_that_is_answered(digging_world):
    world = digging_world
    first = under_way(world, *ASIDE, left=3.0)
    world.transport = 0.2
    second = world.send_goal(-1.4, 1.6, 0.4)
    world.pass_time_until(lambda: world.life.state.unconfirmed is not None)
    settings = across(world, 0.6)
    world.life.change_settings(settings)
    assert world.warnings[-1].endswith("the arm brakes once it has answered the last plan")
    world.pass_time_until(lambda: len(world.warnings) > 1)
    assert "the arm stops" in world.warnings[1] or "it is in it already" in world.warnings[1]
    world.pass_time_until(lambda: world.is_idle)
    world.execution_report(first)
    world.verdict(second)


def test_a_second_zone_that_is_set_while_the_arm_brakes_softly_is_braked_for_harder(digging_world):
    world = digging_world
    under_way(world, *ASIDE, left=4.0)
    world.life.change_settings(across(world, 1.0))
    world.pass_time_until(lambda: world.life.arm_state.own_command is world.sent[-1])
    soft = world.sent[-1].trajectory
    settings = across(world, 0.9)
    world.life.change_settings(settings)
    assert rests_clear(world, settings)
    assert world.sent[-1].trajectory.end_ns < soft.end_ns
    assert world.warnings[-1].endswith("the arm stops before it")


def test_a_zone_set_during_a_stop_that_was_asked_for_is_braked_for_and_keeps_the_stops_reason(
    digging_world,
):
    world = digging_world
    stamp = under_way(world, *ASIDE, left=2.5)
    planned, _ = world.replanner.make_braking_command(world.arm.command, world.arm.time_ns, 0.03)
    settings = across(world, 0.3)
    answers = []
    world.life.stop(lambda *answer: answers.append(answer))
    assert zone_ahead.find_contact_ahead(settings.machine, planned.trajectory, planned.stamp_ns)
    world.life.change_settings(settings)
    assert rests_clear(world, settings)
    assert answers[0][0]
    assert world.execution_report(stamp).sentence == "the planner was asked to stop"
    assert world.warnings[-1].endswith("the arm stops before it")


def test_an_arm_that_takes_no_braking_command_is_said_to_have_taken_none(digging_world):
    world = digging_world
    under_way(world, *ASIDE, left=2.0)
    world.lost = 99
    world.life.change_settings(across(world, 1.0))
    world.pass_time_until(lambda: world.is_idle)
    assert "the arm took no command that brakes for the keep-out sphere" in world.warnings[-1]


def test_a_braking_that_took_long_to_make_gets_a_longer_commit_horizon(digging_world, monkeypatch):
    """As on a busy machine: while it is made, the arm moves on."""
    world = digging_world
    under_way(world, *ASIDE, left=2.5)
    make, took = zone_ahead.make_braking_for_obstacle, 0.1

    def slow(*request):
        world.now += took
        world.arm.pass_time(took)
        world.life.handle_reference(world.arm.reference, world.arm.clock_ns)
        return make(*request)

    monkeypatch.setattr("mhsb_planner.online.stop_sequence.make_braking_for_obstacle", slow)
    began_ns = world.arm.time_ns
    settings = across(world, 1.0)
    world.life.change_settings(replace(settings, lead_min=0.12))
    assert len(world.sent) == 2
    assert rests_clear(world, settings)
    assert world.arm.command is world.sent[1]
    assert world.sent[1].stamp_ns - began_ns == pytest.approx(took * SECOND_NS, rel=0.2)
