"""Starts in which the arm should not be: named at once, and left without getting further in."""

import re
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import pytest

from mhsb_model.command import Command
from mhsb_model.goal import Goal
from mhsb_model.machine import load_machine
from mhsb_model.obstacles.clearance import clearances
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.verdict import Verdict
from mhsb_planner.deadline import Deadline
from mhsb_planner.errors import (
    DeadlineError,
    InfeasibleGoalError,
    NoPathError,
    StartError,
    ZoneError,
)
from mhsb_planner.online.goal_reports import compose_acceptance_sentence, find_verdict_code
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import PLANNER_KINDS, Planner, PlanOptions
from mhsb_planner.planning.first_moves import START_NOISE
from mhsb_planner.planning.remarks import describe_limit_excess
from mhsb_planner.posture.posture_table_cache import load_or_build_table

pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

ARMS = ("mhsb_arm3", "mhsb_arm4", "telescope_arm", "excavator", "forestry_crane")
LOOKS_NS = 1_000_000
ROUNDING = 2e-6
"""Excess over a limit that two looks may differ by [rad, m]."""


@pytest.fixture(scope="module", params=ARMS)
def any_planner(request):
    arm = load_machine(f"{request.config.rootpath}/config/{request.param}.yaml")
    return Planner(arm, load_or_build_table(arm))


@dataclass(frozen=True)
class Move:
    """Move from a posture with joint j at a limit; `kinds` are the planners that can do it."""

    at_limit: np.ndarray
    goal: tuple[float, ...]
    j: int
    kinds: tuple[str, ...]


@pytest.fixture(scope="module")
def move(any_planner):
    machine, table = any_planner.machine, any_planner.graph.table
    a, random = machine.arrays, np.random.default_rng(4)
    here, there = random.choice(np.flatnonzero(table.feasible), 2, replace=False)
    start, goal = table.posture[here, 0].copy(), table.nodes[there] * table.spacing
    if machine.slews:
        began, ended = random.uniform(a.joint_min[0], a.joint_max[0], 2)
        start, goal = np.append(began, start), machine.convert_to_base(goal, ended)
    below, above = start - a.joint_min, a.joint_max - start
    j = int(np.argmin(np.minimum(below, above) / machine.radian_equivalents))
    start[j] = a.joint_max[j] if above[j] < below[j] else a.joint_min[j]
    goal, kinds = tuple(goal.tolist()), set(PLANNER_KINDS) - {"fixed"}
    with suppress(InfeasibleGoalError):  # not with the joints that `fixed` keeps
        any_planner.plan(goal, MotionState.at_rest(start), options=PlanOptions(planner="fixed"))
        kinds.add("fixed")
    return Move(start, goal, j, tuple(sorted(kinds)))


def excesses(machine, trajectory):
    """By how much each joint is beyond its limits, looked at every millisecond, 0 inside."""
    a, at = machine.arrays, np.arange(0, trajectory.duration_ns + 1, LOOKS_NS)
    q = trajectory.sample_many(trajectory.stamp_ns + at)[0]
    return np.maximum(0.0, np.maximum(a.joint_min - q, q - a.joint_max))


def assert_only_returns(machine, trajectory):
    excess = excesses(machine, trajectory)
    assert np.all(excess - np.minimum.accumulate(excess, axis=0) <= ROUNDING)
    assert np.all(excess[-1] <= ROUNDING)


@pytest.mark.parametrize("beyond", [0.5 * START_NOISE, 0.02, 0.1])
def test_every_planner_leads_a_joint_back_that_is_beyond_its_limit(any_planner, move, beyond):
    machine, start, j = any_planner.machine, move.at_limit.copy(), move.j
    start[j] += beyond if start[j] == machine.arrays.joint_max[j] else -beyond
    for kind in move.kinds:
        options = PlanOptions(planner=kind)
        plan = any_planner.plan(move.goal, MotionState.at_rest(start), options=options)
        trajectory = plan.motion.trajectory
        assert_only_returns(machine, trajectory)
        np.testing.assert_array_equal(trajectory.position[0], start)
        assert machine.tip_in_base(trajectory.position[-1]) == pytest.approx(move.goal, abs=1e-6)
        said, unit = plan.warnings[0], machine.joint_units[j]
        assert f"the arm starts with {machine.joint_names[j]} at {start[j]:.4g} {unit}" in said
        assert f"{beyond:.4g} {unit} beyond its" in said


def test_the_sentence_names_each_joint_with_value_limit_and_excess(machine):
    a = machine.arrays
    posture = np.array([a.joint_max[0] + 0.02, a.joint_min[1] - 0.1, a.joint_max[2] + 5e-4])
    assert describe_limit_excess(machine, posture) == (
        f"joint_1 at {posture[0]:.4g} rad, 0.02 rad beyond its upper limit of "
        f"{a.joint_max[0]:.4g} rad and joint_2 at {posture[1]:.4g} rad, 0.1 rad beyond its lower "
        f"limit of {a.joint_min[1]:.4g} rad"
    )


@pytest.mark.parametrize("kind", PLANNER_KINDS)
def test_where_no_cylinder_moves_the_joint_back_the_first_answer_says_so(machine, table, kind):
    planner, top = Planner(machine, table), float(machine.arrays.joint_max[0])
    start = MotionState.at_rest(np.array([top + 0.43, -1.4, -0.6]))
    with pytest.raises(
        StartError,
        match=rf"the arm starts with joint_1 at {top + 0.43:.4g} rad, 0\.43 rad beyond its upper "
        rf"limit of {top:.4g} rad; no motion was found that only lessens this: bring",
    ) as refused:
        planner.plan(
            (0.55, 0.4), start, options=PlanOptions(planner=kind), deadline=Deadline.after(60.0)
        )
    assert find_verdict_code(refused.value) is Verdict.INFEASIBLE


def test_what_takes_too_long_from_such_a_start_names_the_joint_as_well(machine, table):
    planner, top = Planner(machine, table), float(machine.arrays.joint_max[0])
    start = MotionState.at_rest(np.array([top + 0.02, -1.4, -0.6]))
    with pytest.raises(DeadlineError, match=r"before the deadline; the arm starts with joint_1"):
        planner.plan(
            (0.55, 0.4),
            start,
            options=PlanOptions(planner="table"),
            deadline=Deadline.after(1e-4),
        )


def test_what_takes_too_long_names_the_zones_that_may_be_the_cause(machine, table):
    start = MotionState.at_rest(np.array([0.3, -1.4, -0.6]))
    blocked = machine.changed(zones=Zones(circles=((0.6, 0.1, 0.1),)))
    named = re.escape(f"; all motions must keep clear of {blocked.obstacles.names[0]}")
    for arm, clause in ((machine, ""), (blocked, named)):
        with pytest.raises(DeadlineError, match=rf"before the deadline{clause}$"):
            Planner(arm, table).plan((0.55, 0.4), start, deadline=Deadline.after(0.0))


def test_a_new_goal_on_the_way_back_leads_back_as_well(machine, table):
    """The second plan begins in motion, while the joint is still beyond its limit."""
    replanner = Replanner(machine, table)
    top = float(machine.arrays.joint_max[0])
    start = Command.hold(0, np.array([top + 0.1, -1.4, -0.6]), np.zeros(3, dtype=np.uint8))
    options = PlanOptions(planner="integrated")
    first = replanner.replan(start, SECOND_NS, (0.55, 0.4), 0.03, options)
    assert "joint_1" in compose_acceptance_sentence(first, Goal(1, 0.55, 0.4))
    on_the_way = first.change_ns + SECOND_NS // 5
    second = replanner.replan(first.command, on_the_way, (0.7, 0.1), 0.03, options)
    excess = excesses(machine, second.command.trajectory)[:, 0]
    at_change = (second.change_ns - second.command.stamp_ns) // LOOKS_NS
    assert excess[at_change] > 1e-3
    assert_only_returns(machine, second.command.trajectory)


@pytest.mark.parametrize("name", ["mhsb_arm3", "excavator"])
def test_an_arm_deep_in_a_zone_gets_out_or_the_answer_names_the_zone(name, request):
    """At least 9 of 12 get out; none gets deeper than START_LEEWAY allows."""
    arm = load_machine(f"{request.config.rootpath}/config/{name}.yaml")
    planner, random, planned, seen = (
        Planner(arm, load_or_build_table(arm)),
        np.random.default_rng(6),
        0,
        0,
    )
    refused = []
    table = planner.graph.table
    nodes = np.flatnonzero(table.feasible)
    while seen < 12:
        here, there = random.choice(nodes, 2, replace=False)
        start, goal = table.posture[here, 0], table.nodes[there] * table.spacing
        if arm.slews:
            start, goal = np.append(0.2, start), arm.convert_to_base(goal, 0.9)
        size = 0.15 * arm.relative_size
        tip = arm.tip_in_base(start)
        place = (*(tip + random.normal(0.0, 0.3 * size, len(tip))).tolist(), size)
        zones = Zones(spheres=(place,)) if arm.slews else Zones(circles=(place,))
        away = np.linalg.norm(goal - np.array(place[:-1]))
        crowded = arm.changed(zones=zones)
        if away < 2.5 * size or crowded.clearance(start)[0] > -0.01 * arm.relative_size:
            continue
        seen += 1
        planner.change_machine(crowded)
        try:
            plan = planner.plan(
                tuple(goal.tolist()),
                MotionState.at_rest(start),
                options=PlanOptions(planner="table"),
            )
        except (NoPathError, ZoneError) as error:  # a goal by the zone has no clear posture
            refused.append(str(error))
            continue
        planned += 1
        assert "deep in the keep-out" in plan.warnings[0]
        motion = plan.motion.trajectory
        q = motion.sample_many(np.arange(0, motion.duration_ns + 1, LOOKS_NS))[0]
        clear = clearances(crowded.arrays, crowded.obstacles.rows, np.ascontiguousarray(q))[0]
        assert clear.min() >= clear[0] - 1.1e-3
        out = int(np.argmax(clear > 1e-3))
        assert clear[out:].min() > 0.0
    assert planned >= 9
    assert all("deep in the keep-out" in sentence for sentence in refused)
