"""Plans among obstacles: around them, refused where there is no way, and never through."""

import itertools
import re

import numpy as np
import pytest

from mhsb_model.command import Command
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import MIN_PART_TRAVEL, clearances
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.verdict import Verdict
from mhsb_planner.errors import NoPathError, ZoneError
from mhsb_planner.motion.s3_trajectory import FitMethod
from mhsb_planner.online.goal_reports import compose_acceptance_sentence, find_verdict_code
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import PLANNER_KINDS, Planner, PlanOptions
from mhsb_planner.search.s2_graph import StepGraph

START, GOAL = (0.55, -0.05), (0.55, 0.60)
ON_THE_WAY = {
    "box for the tip": Zones(tip_boxes=((0.45, 0.20, 0.90, 0.30),)),
    "circle for the arm": Zones(circles=((0.80, 0.25, 0.10),)),
    "box for the arm": Zones(boxes=((0.65, 0.10, 0.90, 0.30),)),
}


@pytest.fixture(scope="module")
def arm(machine) -> Machine:
    """The suite's arm with thick links that keep apart."""
    content = machine.config.model_dump()
    content["keep_out"] |= {"link_radii": (0.03, 0.03, 0.02), "self_collision": True}
    return Machine.from_config(type(machine.config).model_validate(content))


@pytest.fixture(scope="module")
def only_planner(arm, table) -> Planner:
    return Planner(arm, table)


@pytest.fixture
def planner(only_planner, arm) -> Planner:
    """A planner whose zones are free to be changed."""
    only_planner.change_machine(arm)
    return only_planner


def posture_at(planner, x, z):
    return planner.graph.table.posture[planner.graph.grid.node_at(x, z), 0]


def planned(planner, kind="table", goal=GOAL, start=None, trajectory=None):
    start = posture_at(planner, *START) if start is None else start
    options = PlanOptions(planner=kind, trajectory=trajectory)
    return planner.plan(goal, MotionState.at_rest(start), options=options)


def distances(machine, postures):
    """Clearance of each posture [m]."""
    return clearances(machine.arrays, machine.obstacles.rows, np.array(postures))[0]


def clearance_along(machine, trajectory):
    """Least clearance of a trajectory, looked at every 0.2 ms."""
    at = np.arange(0, trajectory.duration_ns + 1, 200_000)
    return distances(machine, trajectory.sample_many(at)[0]).min()


@pytest.mark.parametrize("kind", PLANNER_KINDS)
def test_paths_go_around_and_motions_stay_clear(planner, arm, kind):
    free = planned(planner, kind).motion.trajectory
    crossed = 0
    for zones in ON_THE_WAY.values():
        crowded = arm.changed(zones=zones)
        crossed += clearance_along(crowded, free) < 0.0
        planner.change_machine(crowded)
        plan = planned(planner, kind)
        margin = crowded.config.keep_out.margin
        assert distances(crowded, plan.path.posture).min() >= margin - MIN_PART_TRAVEL / 2
        assert clearance_along(crowded, plan.motion.trajectory) > 0.0
        assert crowded.tip_position(plan.motion.trajectory.position[-1]) == (
            pytest.approx(GOAL, abs=1e-6)
        )
    assert crossed > 0
    planner.change_machine(arm)
    again = planned(planner, kind).motion.trajectory
    assert again.position.tobytes() == free.position.tobytes()


@pytest.mark.parametrize("kind", PLANNER_KINDS)
def test_a_goal_in_a_zone_is_refused_with_how_deep_it_is(planner, arm, kind):
    planner.change_machine(arm.changed(zones=Zones(boxes=((0.50, 0.58, 0.70, 0.80),))))
    with pytest.raises(
        ZoneError,
        match=r"at \(0\.55, 0\.6\) m the tip is 40 mm deep in the keep-out box \(0\.5, 0\.58\) … "
        r"\(0\.7, 0\.8\) m; a goal must leave it 5 mm away",
    ) as refused:
        planned(planner, kind)
    assert find_verdict_code(refused.value) is Verdict.ZONE


def test_a_goal_nearer_to_a_zone_than_paths_get_is_refused(planner, arm):
    planner.change_machine(arm.changed(zones=Zones(tip_circles=((0.55, 0.703, 0.1),))))
    with pytest.raises(ZoneError, match=r"the tip is 3 mm from the keep-out circle of 0\.1 m"):
        planned(planner)


@pytest.mark.parametrize("kind", PLANNER_KINDS)
def test_a_goal_at_which_every_posture_collides_is_refused_with_the_obstacle(planner, arm, kind):
    planner.change_machine(arm.changed(zones=Zones(circles=((0.50, 0.05, 0.12),))))
    with pytest.raises(ZoneError, match=r"in every posture .* at best from the keep-out circle"):
        planned(planner, kind, goal=(1.0, 0.10), start=posture_at(planner, 0.40, 0.70))


@pytest.mark.parametrize("kind", PLANNER_KINDS)
def test_where_no_way_leads_around_the_plan_fails_and_names_the_obstacles(planner, arm, kind):
    planner.change_machine(arm.changed(zones=Zones(tip_boxes=((-0.1, 0.20, 1.1, 0.30),))))
    with pytest.raises(NoPathError, match=r"clear of the keep-out box \(-0\.1, 0\.2\)"):
        planned(planner, kind)


@pytest.mark.parametrize("kind", PLANNER_KINDS)
def test_a_zone_set_over_the_arm_may_be_left(planner, arm, kind):
    start = posture_at(planner, *START)
    x, z = START
    zones = Zones(tip_boxes=((x - 0.1, z - 0.1, x + 0.1, z + 0.1),))
    crowded = arm.changed(zones=zones)
    planner.change_machine(crowded)
    plan = planned(planner, kind, start=start)
    at = np.arange(0, plan.motion.trajectory.duration_ns, 1_000_000)
    distance = distances(crowded, plan.motion.trajectory.sample_many(at)[0])
    assert distance[0] == pytest.approx(-0.1)
    assert distance.min() >= -0.101
    assert distance[np.argmax(distance > 1e-3) :].min() > 0.0


@pytest.mark.parametrize("kind", PLANNER_KINDS)
@pytest.mark.parametrize(
    ("edge", "sentence"),
    [
        (-0.1, r"the arm starts 0.1 m deep in the keep-out box \(0.45, -0.15\) … \(0.65, 0.05\) m"),
        (0.0, r"the arm touches the keep-out box \(0.55, -0.15\) … \(0.75, 0.05\) m at the start"),
    ],
)
def test_a_start_in_or_at_a_zone_is_told_by_name(planner, arm, kind, edge, sentence):
    x, z = START
    zones = Zones(tip_boxes=((x + edge, z - 0.1, x + edge + 0.2, z + 0.1),))
    start = posture_at(planner, *START)
    planner.change_machine(arm.changed(zones=zones))
    plan = planned(planner, kind, start=start)
    assert re.fullmatch(sentence, plan.warnings[0])


def test_a_verdict_tells_in_which_zone_the_arm_starts(planner, arm, table):
    x, z = START
    crowded = arm.changed(zones=Zones(tip_boxes=((x - 0.1, z - 0.1, x + 0.1, z + 0.1),)))
    held = Command.hold(0, posture_at(planner, *START), np.zeros(3, dtype=np.uint8))
    replan = Replanner(crowded, table).replan(
        held, SECOND_NS, GOAL, 0.1, PlanOptions(planner="table")
    )
    told = compose_acceptance_sentence(replan, Goal(1, *GOAL))
    assert "; the arm starts 0.1 m deep in the keep-out box (0.45, -0.15)" in told


def test_a_start_that_is_clear_of_all_zones_is_not_told(planner, arm):
    x, z = START
    planner.change_machine(arm.changed(zones=Zones(tip_boxes=((x + 0.02, z, x + 0.2, z + 0.1),))))
    assert not any("start" in each for each in planned(planner).warnings)


def test_where_no_way_leads_on_the_zone_that_the_start_is_in_is_told_too(planner, arm):
    x, z = START
    start = posture_at(planner, *START)
    around, wall = (x - 0.1, z - 0.1, x + 0.1, z + 0.1), (-0.1, 0.20, 1.1, 0.30)
    planner.change_machine(arm.changed(zones=Zones(tip_boxes=(around, wall))))
    with pytest.raises(NoPathError, match=r"; the arm starts 0\.1 m deep in the keep-out box"):
        planned(planner, start=start)


def test_steps_are_those_that_stay_clear_on_their_way(graph, machine):
    crowded = machine.changed(zones=Zones(boxes=((0.65, 0.10, 0.90, 0.30),)))
    lazily, margin = graph.create_for(crowded), crowded.config.keep_out.margin
    layout, patterns = graph.layout, len(graph.table.patterns)
    kept = dropped = 0
    distance = distances(crowded, layout.posture)
    near = np.flatnonzero((distance >= margin) & (distance < 0.15))
    for i in np.random.default_rng(0).choice(near, 30, replace=False):
        before, after = edges_from(graph, i), edges_from(lazily, i)
        for state in before | after:
            start, end = layout.posture[i], graph.table.posture[divmod(state, patterns)]
            way = start + np.linspace(0, 1, 200)[:, None] * (end - start)
            least = distances(crowded, way).min()
            if state in after:
                assert least >= margin - MIN_PART_TRAVEL / 2
                kept += 1
            else:
                assert least < margin + 5e-3  # of 200 looks
                dropped += 1
    assert kept > 100
    assert dropped > 50
    fresh = StepGraph(crowded, graph.table)
    assert np.array_equal(fresh.edges.state, lazily.edges.state)


def edges_from(graph, posture):
    """States that steps from a posture lead to."""
    edges = graph.edges
    return set(edges.state[edges.first[posture] : edges.last[posture]].tolist())


def test_where_the_polynomial_cuts_a_corner_into_a_zone_the_path_is_followed(planner, arm):
    free = planned(planner, goal=(0.65, 0.45), trajectory="polynomial")
    assert free.motion.method is FitMethod.POLYNOMIAL
    trajectory = free.motion.trajectory
    tips = np.array([arm.tip_position(q) for q in trajectory.position])
    ends, way = free.path.posture, []
    for a, b in itertools.pairwise(ends):
        way += [arm.tip_position(a + s * (b - a)) for s in np.linspace(0, 1, 50)]
    away = np.min(np.hypot(*(tips[:, None, :] - np.array(way)[None]).transpose(2, 0, 1)), axis=1)
    radius = away.max() - arm.config.keep_out.margin - 1e-3
    assert radius > 0.0
    place = tips[np.argmax(away)]
    planner.change_machine(arm.changed(zones=Zones(tip_circles=((*place, radius),))))
    plan = planned(planner, goal=(0.65, 0.45), trajectory="polynomial")
    assert plan.path.posture.tobytes() == free.path.posture.tobytes()
    assert plan.motion.method is not FitMethod.POLYNOMIAL
    assert "polynomial: the arm gets to the keep-out circle" in plan.motion.refused[0]
    assert clearance_along(planner.machine, plan.motion.trajectory) > 0.0


def test_zones_keep_the_posture_table_and_its_hash(planner, arm, table):
    planner.change_machine(arm.changed(zones=ON_THE_WAY["box for the arm"]))
    assert planner.graph.table is table
    assert planner.machine.table_hash == arm.table_hash
