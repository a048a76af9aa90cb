"""Goals that are cancelled, that have settings of their own, that are only rehearsed or watched."""

from dataclasses import replace

import pytest

from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.verdict import ExecutionReport, Outcome, Verdict
from mhsb_planner.motion.energy import compute_motion_energy
from mhsb_planner.online.pending_goal import keep_settings
from mhsb_planner.online.progress import Progress, compute_energy_between

UP, OUT = (0.55, 0.60), (0.75, 0.55)
STRETCHED = (0.95, 0.30)


def send(world, place, **options):
    """A goal with options, and what is told of it alone."""
    told = []
    world.goals += 1
    return world.life.add_goal(Goal(world.goals, *place), on_report=told.append, **options), told


def without_boosters(settings):
    return replace(settings, machine=settings.machine.changed(module_count=0))


def test_a_cancel_in_motion_brakes_at_once(world):
    goal, told = send(world, UP)
    world.pass_time(1.0)
    began = world.now
    world.life.cancel(goal)
    world.pass_time(3.0)
    assert [each.outcome for each in told if isinstance(each, ExecutionReport)] == ["stopped"]
    braking = world.sent[-1]
    assert world.is_idle
    assert braking.trajectory.end_ns < world.arm.clock_ns
    assert began < world.now
    world.check_that_nothing_sent_jumps()


def test_a_cancel_during_planning_sends_nothing(world):
    world.planning_time = 0.5
    goal, told = send(world, UP)
    world.pass_time(0.01)
    world.life.cancel(goal)
    world.pass_time(2.0)
    assert [each.code for each in told] == [Verdict.STOPPED]
    assert not world.sent
    assert world.is_idle


def test_a_cancelled_goal_leaves_the_newer_one_alone(world):
    goal, told = send(world, UP)
    world.pass_time(1.0)
    newer = world.send_goal(*OUT)
    world.life.cancel(goal)
    assert world.execution_report(newer).outcome is Outcome.REACHED
    assert told[-1].outcome is Outcome.REPLACED


def test_a_cancelled_goal_is_not_gone_on_with_when_the_newer_one_is_refused(world):
    goal, told = send(world, UP)
    world.pass_time(1.0)
    _, told_of_newer = send(world, STRETCHED, adjust_settings=without_boosters)
    world.life.cancel(goal)
    world.pass_time(4.0)
    assert [each.code for each in told_of_newer] == [Verdict.INFEASIBLE]
    assert told[-1].outcome is Outcome.STOPPED


def test_settings_of_a_goals_own_hold_for_it_alone(world):
    _, told = send(world, STRETCHED, adjust_settings=without_boosters)
    world.pass_time(1.0)
    assert [each.code for each in told] == [Verdict.INFEASIBLE]
    assert world.verdict(world.send_goal(*STRETCHED)).code is Verdict.OK


def test_a_rehearsal_asks_for_what_a_goal_would_and_changes_nothing(world):
    request = world.life.planning.build_trial_request(Goal(1, *UP), keep_settings)
    assert world.is_idle
    assert not world.planned
    rehearsed = request.make_plan(world.replanner)
    verdict = world.verdict(world.send_goal(*UP))
    assert rehearsed.plan.energy.paper == pytest.approx(verdict.plan.energy_j, rel=1e-9)
    with pytest.raises(MhsbError, match="workspace"):
        world.life.planning.build_trial_request(Goal(1, 3.0, 0.0), keep_settings)


def test_progress_grows_to_the_whole_and_its_energy_to_the_plans(world):
    _, told = send(world, UP)
    progress, shares = Progress(), []
    while len(told) < 2:
        world.pass_time(0.05)
        if world.life.state.execution is not None:
            progress.update(world.life.state.execution, world.arm.clock_ns)
            shares.append(progress.time_share)
    assert shares == sorted(shares)
    assert (progress.time_share, progress.time_left) == pytest.approx((1.0, 0.0), abs=0.02)
    plan = told[0].plan
    assert progress.energy_j == pytest.approx(plan.energy_j, rel=0.01)
    assert progress.energy_series_j == pytest.approx(plan.energy_series_j, rel=0.01)


def test_energy_between_two_times_is_that_of_the_motion(world):
    world.verdict(world.send_goal(*UP))
    command = world.sent[-1]
    whole = compute_motion_energy(world.machine, command.trajectory, command.schedule)
    middle = command.stamp_ns + command.trajectory.duration_ns // 3
    parts = [
        compute_energy_between(world.machine, command, *span)
        for span in ((command.stamp_ns, middle), (middle, command.trajectory.end_ns))
    ]
    assert sum(part.paper for part in parts) == pytest.approx(whole.paper, rel=0.01)
    assert sum(part.main_pump for part in parts) == pytest.approx(whole.main_pump, rel=0.01)
