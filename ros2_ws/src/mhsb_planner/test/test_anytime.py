"""Plans with a deadline: a first motion soon, better ones while there is time, nothing after."""

import itertools
import math
import time
from dataclasses import replace

import numpy as np
import pytest

from mhsb_model.braking import brake_along
from mhsb_model.errors import MhsbError
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import MotionState
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.errors import DeadlineError
from mhsb_planner.motion.s3_trajectory import FitError, fit_trajectory
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.plan_log import PlanLog
from mhsb_planner.planner import PLANNER_KINDS, Planner, PlanOptions, fit_rules
from mhsb_planner.planners.path_planner import PathProposal
from mhsb_planner.planning import loop, motion_rules

BY_TABLE = PlanOptions(planner="table")

LOOKS_TO_END = 15
"""Looks at the clock that stages may take to see, one after the other, that time is up."""

FIRST_LOOKS = 20
"""Looks at the clock within which an arm at rest has a motion where a straight line is possible."""


@pytest.fixture(scope="module")
def planner(machine, table) -> Planner:
    return Planner(machine, table)


def moves(planner, count, seed=0):
    """Starts at rest and goals off the grid to which the table planner has a plan."""
    random = np.random.default_rng(seed)
    table = planner.graph.table
    nodes = np.flatnonzero(table.feasible)
    while count:
        here, there = random.choice(nodes, 2, replace=False)
        goal = tuple((table.nodes[there] * table.spacing + [0.011, -0.013]).tolist())
        start = MotionState.at_rest(table.posture[here, 0])
        try:
            planner.plan(goal, start, options=BY_TABLE)
        except MhsbError:
            continue
        count -= 1
        yield start, goal


@pytest.mark.parametrize("ends", [True, False], ids=["with a deadline", "without"])
def test_with_a_deadline_other_ramps_of_the_first_path_wait_for_the_motion_of_the_next(
    planner, monkeypatch, ends
):
    made = []

    def noted(machine, path, *arguments):
        made.append(path.tip.tobytes())
        return fit_trajectory(machine, path, *arguments)

    options, deadline = PlanOptions(planner="integrated"), Deadline.after(3600.0)
    for start, goal in moves(planner, 20):
        table = planner.plan(goal, start, options=PlanOptions(planner="table"))
        with monkeypatch.context() as patched:
            patched.setattr(loop, "fit_trajectory", noted)
            planner.plan(goal, start, options=options, deadline=deadline if ends else NO_DEADLINE)
        if table.path.tip.tobytes() in made:  # it may be too dear to be looked at
            break
        made.clear()
    assert made.count(made[0]) > 1
    assert (made[1] != made[0]) == ends


@pytest.mark.parametrize("kind", PLANNER_KINDS)
def test_wherever_the_deadline_finds_it_planning_ends_with_a_motion_or_without(
    planner, looks, worst, kind
):
    options = PlanOptions(planner=kind)
    start, goal = next(moves(planner, 1))
    free = planner.plan(goal, start, options=options, deadline=looks.deadline_after(math.inf))
    assert not free.path.statistics.out_of_time
    needed = looks.count
    costs = []
    for after in range(0, needed, max(1, needed // 25)):
        try:
            plan = planner.plan(goal, start, options=options, deadline=looks.deadline_after(after))
        except DeadlineError:
            assert not costs  # what has been found once is found earlier or not at all
            continue
        finally:
            assert looks.count <= after + LOOKS_TO_END
        assert max(worst(plan.motion.trajectory, plan.motion.schedule).values()) < 1e-3
        costs.append(plan.cost(options))
    assert costs
    assert costs[-1] == pytest.approx(free.cost(options), rel=0.05)


@pytest.mark.parametrize("kind", PLANNER_KINDS)
def test_after_the_deadline_nothing_is_begun(planner, looks, kind):
    start, goal = next(moves(planner, 1))
    deadline = looks.deadline_after(0)
    with pytest.raises(DeadlineError, match="planning did not end before the deadline"):
        planner.plan(goal, start, options=PlanOptions(planner=kind), deadline=deadline)
    assert looks.count == 1


def test_a_deadline_that_is_not_reached_changes_nothing(planner):
    for kind in PLANNER_KINDS:
        options = PlanOptions(planner=kind)
        for start, goal in moves(planner, 3, seed=1):
            free = planner.plan(goal, start, options=options)
            plan = planner.plan(goal, start, options=options, deadline=Deadline.after(600.0))
            assert np.array_equal(plan.motion.trajectory.position, free.motion.trajectory.position)
            assert np.array_equal(plan.motion.schedule.modes, free.motion.schedule.modes)
            assert plan.lower_bound == free.lower_bound


def test_the_first_motion_comes_before_the_work_that_improves_it(planner, looks):
    options = PlanOptions(planner="integrated")
    improved = 0
    for start, goal in moves(planner, 6, seed=2):
        free = planner.plan(goal, start, options=options, deadline=looks.deadline_after(math.inf))
        assert looks.count > FIRST_LOOKS
        deadline = looks.deadline_after(FIRST_LOOKS)
        plan = planner.plan(goal, start, options=options, deadline=deadline)
        assert plan.path.statistics.out_of_time
        assert 0.0 < plan.seconds["first_motion"] <= plan.planning_time
        improved += free.cost(options) < 0.999 * plan.cost(options)
    assert improved >= 2


def test_a_moving_start_has_its_first_motion_in_time_too(planner, looks):
    options = PlanOptions(planner="integrated")
    pairs = list(moves(planner, 4, seed=3))
    for (start, goal), (_, other) in itertools.pairwise(pairs):
        first = planner.plan(goal, start, options=options)
        at = first.motion.trajectory.duration_ns // 2
        modes = StartModes.read_from(first.motion.schedule, at)
        brake = brake_along(planner.machine, first.motion.trajectory, at)
        moving = first.motion.trajectory.sample(at)

        def replanned(after, **motion):
            deadline = looks.deadline_after(after)
            return planner.plan(options=options, deadline=deadline, **motion)

        motion = {"goal": other, "start": moving, "modes": modes, "brake": brake}
        free = replanned(math.inf, **motion)
        for after in (looks.count // 2, looks.count - 2):
            plan = replanned(after, **motion)
            assert looks.count <= after + LOOKS_TO_END
            assert plan.cost(options) >= 0.95 * free.cost(options)


def test_where_straight_lines_are_barred_the_first_motion_is_another_s(machine, table, looks):
    """The table's path comes first, and the integrated planner's own when it is found."""
    barred = machine.changed(zones=Zones(tip_boxes=((0.45, 0.20, 0.90, 0.30),)))
    planner = Planner(barred, table)
    start = MotionState.at_rest(table.posture[planner.graph.grid.node_at(0.55, -0.05), 0])
    options = PlanOptions(planner="integrated")
    plan = planner.plan((0.55, 0.60), start, options=options)
    by_table = planner.plan(
        (0.55, 0.60), start, options=PlanOptions(planner="table", trajectory="followed")
    )
    assert plan.cost(options) <= by_table.cost(options)
    assert plan.seconds["first_motion"] < plan.planning_time


def test_a_fit_ends_with_the_first_look_that_finds_the_deadline_passed(planner, looks):
    start, goal = next(moves(planner, 1))
    path = planner.plan(goal, start, options=BY_TABLE).path
    modes = StartModes.create_settled(np.zeros(3, dtype=np.uint8))
    arguments = planner.machine, path, start, modes, None, fit_rules(BY_TABLE)
    fit_trajectory(*arguments, looks.deadline_after(math.inf))
    needed = looks.count
    assert needed > 1
    for after in range(needed):
        with pytest.raises(DeadlineError):
            fit_trajectory(*arguments, looks.deadline_after(after))
        assert looks.count == after + 1


def test_other_ramps_that_are_refused_are_not_told_of_the_motion_that_is_taken(
    planner, monkeypatch
):
    def without_faster_ones(machine, path, start, modes, brake, rules, deadline):
        if rules.ramp_factor in motion_rules.FASTER_RAMP_FACTORS:
            raise FitError(("too fast",))
        return fit_trajectory(machine, path, start, modes, brake, rules, deadline)

    monkeypatch.setattr(loop, "fit_trajectory", without_faster_ones)
    for start, goal in moves(planner, 5):
        plan = planner.plan(goal, start, options=PlanOptions(planner="integrated"))
        assert "too fast" not in plan.motion.refused


@pytest.mark.parametrize(("deadline", "error"), [(0.5, DeadlineError), (math.inf, FitError)])
def test_a_path_that_is_refused_is_no_verdict_on_the_goal_when_the_time_is_up(
    planner, deadline, error
):
    start, goal = next(moves(planner, 1))
    path = planner.plan(goal, start, options=BY_TABLE).path
    posture = path.posture.copy()
    posture[-1] = planner.machine.arrays.joint_max + 0.1
    beyond = replace(path, posture=posture)
    task = planner._create_request(goal, start, None, None, BY_TABLE)
    under_way = loop.PlanningLoop(planner.machine, task, Deadline.after(deadline), PlanLog())

    def until_the_time_is_up():
        yield PathProposal(beyond)
        while under_way.progress.has_deadline and not under_way.progress.search_deadline.has_passed:
            time.sleep(0.01)

    with pytest.raises(error):
        under_way.choose_best(until_the_time_is_up())
