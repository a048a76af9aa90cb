"""The log of a plan: every proposal has its fate, and the plan is what was taken last."""

import math

import numpy as np
import pytest

from mhsb_model.errors import MhsbError
from mhsb_model.trajectory import MotionState
from mhsb_planner.deadline import Deadline
from mhsb_planner.errors import DeadlineError
from mhsb_planner.motion.s3_blend_in import compute_coasting
from mhsb_planner.plan_log import PlanLog, ProposalOutcome
from mhsb_planner.planner import PLANNER_KINDS, Planner, PlanOptions

GOAL = (0.55, 0.60)


@pytest.fixture(scope="module")
def planner(machine, table) -> Planner:
    return Planner(machine, table)


@pytest.fixture
def start(planner) -> MotionState:
    node = planner.graph.grid.node_at(0.55, -0.05)
    return MotionState.at_rest(planner.graph.table.posture[node, 0])


@pytest.mark.parametrize("kind", PLANNER_KINDS)
def test_costs_of_motions_that_were_taken_fall_to_that_of_the_plan(planner, start, kind):
    options = PlanOptions(planner=kind, trajectory="followed")
    plan = planner.plan(GOAL, start, options=options)
    taken = [each.motion_cost for each in plan.log.entries if each.outcome == ProposalOutcome.TAKEN]
    assert taken == sorted(taken, reverse=True)
    assert taken[-1] == plan.cost(options)
    assert plan.log.entries[0].proposer == kind
    times = [each.time for each in plan.log.entries]
    assert times == sorted(times)
    assert times[-1] <= plan.planning_time
    for each in plan.log.entries:
        assert math.isnan(each.motion_cost) == (each.outcome not in ("taken", "dearer"))
        assert bool(each.reason) == (each.outcome in ("refused", "no path", "too late"))


def test_all_baselines_of_the_integrated_planner_are_in_the_log(planner, start):
    plan = planner.plan(GOAL, start, options=PlanOptions(planner="integrated"))
    names = {each.proposer for each in plan.log.entries}
    assert names >= {"integrated", "table", "fixed"}


def test_a_search_that_fails_has_its_reason_in_the_log(planner, start):
    hindered = Planner(planner.machine.changed(payload=200.0), planner.graph.table)
    log = PlanLog()
    with pytest.raises(MhsbError) as error:
        hindered.plan(GOAL, start, options=PlanOptions(planner="integrated"), log=log)
    assert {each.outcome for each in log.entries} == {ProposalOutcome.NO_PATH}
    reasons = {each.proposer: each.reason for each in log.entries}
    assert reasons["integrated"] in str(error.value)
    assert "integrated at 0.5 V_max" in reasons


def test_a_log_that_is_given_is_filled_even_if_the_time_is_up(planner, start, looks):
    log = PlanLog()
    with pytest.raises(DeadlineError):
        planner.plan(
            GOAL,
            start,
            options=PlanOptions(planner="integrated"),
            deadline=looks.deadline_after(6),
            log=log,
        )
    assert all(each.outcome != ProposalOutcome.TAKEN for each in log.entries)


def test_the_table_has_a_line_for_each_entry(planner, start):
    log = PlanLog()
    plan = planner.plan(
        GOAL, start, options=PlanOptions(planner="table"), deadline=Deadline.after(60.0), log=log
    )
    lines = str(log).splitlines()
    assert len(lines) == 1 + len(plan.log.entries)
    assert "taken" in lines[1]


def test_a_start_that_comes_to_rest_at_its_goal_is_not_planned_at_lower_speeds(planner, start):
    machine = planner.machine
    moving = MotionState(start.position, np.full(machine.joint_count, 0.05), start.acceleration)
    goal = machine.tip_position(compute_coasting(machine, moving).trajectory.position[-1])
    plan = planner.plan(tuple(goal.tolist()), moving)
    assert plan.log.entries
    assert not [each for each in plan.log.entries if "V_max" in each.proposer]
