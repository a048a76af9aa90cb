"""When the plane turns among zones, against SciPy's Dijkstra over steps that are priced here."""

import itertools
import math

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from mhsb_model.obstacles.clearance import clearances
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import MotionState
from mhsb_model.types import frozen
from mhsb_planner.motion.resting import insert_rests
from mhsb_planner.motion.s3_ramps import compute_shortest_ramp
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planner import PlanOptions
from mhsb_planner.planners.path_planner import PathRequest
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.manipulability_loss import WITHOUT_AREA
from mhsb_planner.slewing.among_zones import (
    MAX_PARTS_PER_STEP,
    SLEW_PART_ANGLE,
    find_quickest_turning,
)
from mhsb_planner.slewing.slew_distribution import compute_path_oil
from mhsb_planner.slewing.turned_path import REST_STEP, combine_with_slew, find_rest_steps

POST = Zones(cylinders=((2.6, 0.2, -2.0, 0.2, 0.15),))
LIFTED = 10  # steps of the path up to where it is highest
BEGAN, ENDED = -0.5, 0.7


@pytest.fixture(scope="module")
def over_a_post(excavator):
    """The excavator, a post, and a path of its plane that lifts the tip over it and lowers it."""
    machine, plane = excavator.changed(zones=POST), excavator.planar_arm
    low, high = np.array([-0.1, -1.0, -0.9]), np.array([0.75, -1.0, -0.9])
    share = np.concatenate([np.linspace(0, 1, LIFTED + 1), np.linspace(1, 0, LIFTED + 1)[1:]])
    posture = low + share[:, None] * (high - low)
    steps, modes = 2 * LIFTED, np.zeros((2 * LIFTED, 3), dtype=np.uint8)
    path = DiscretePath(
        tip=plane.tip_positions(posture),
        posture=posture,
        modes=modes,
        duration=np.full(steps, 0.2),
        energy=np.full(steps, 100.0),
        energy_series=np.full(steps, 100.0),
        cost=0.0,
        start_modes=modes[0],
        statistics=SearchStatistics(0, 0, 0.0),
    )
    return machine, path


def is_clear(machine, begin, end):
    """By looks that lie close together, with the margin that paths keep."""
    margin = machine.config.keep_out.margin
    way = frozen(begin + np.linspace(0.0, 1.0, 40)[:, None] * (end - begin))
    return clearances(machine.arrays, machine.obstacles.rows, way)[0].min() >= margin - 6e-4


def least_time(machine, path):
    """From the first corner to the last, over all steps that are clear."""
    a, plane = machine.arrays, machine.planar_arm
    flow = a.main_pump_flow - machine.joint_count * a.leakage_flow
    oil = compute_path_oil(plane, path.posture)
    parts = math.ceil((ENDED - BEGAN) / SLEW_PART_ANGLE)
    angle = np.linspace(BEGAN, ENDED, parts + 1)
    way = 1.2 / parts * abs(machine.moment_arms(np.zeros(4))[0])
    postures = np.column_stack([np.zeros(path.steps + 1), path.posture])

    def state(i, k):
        return i * (parts + 1) + k

    def at(i, k):
        return np.append(angle[k], postures[i, 1:])

    edges = {}
    for i in range(path.steps + 1):
        for k in range(parts + 1):
            if k < parts and is_clear(machine, at(i, k), at(i, k + 1)):
                alone = max(way / a.max_piston_speed[0], a.cap_area[0] * way / flow)
                edges[state(i, k), state(i, k + 1)] = alone
            for more in range(MAX_PARTS_PER_STEP + 1):
                if i == path.steps or k + more > parts:
                    continue
                if is_clear(machine, at(i, k), at(i + 1, k + more)):
                    slewed = more * way
                    edges[state(i, k), state(i + 1, k + more)] = max(
                        path.duration[i],
                        slewed / a.max_piston_speed[0],
                        (oil[i] + a.cap_area[0] * slewed) / flow,
                    )
    pairs = np.array(list(edges))
    count = (path.steps + 1) * (parts + 1)
    graph = csr_matrix((list(edges.values()), pairs.T), (count, count))
    return dijkstra(graph, indices=0)[-1]


def test_the_plane_turns_as_soon_as_dijkstra_lets_it(over_a_post):
    machine, path = over_a_post
    turning = find_quickest_turning(machine, path, BEGAN, ENDED)
    assert turning.duration.sum() == pytest.approx(least_time(machine, path), rel=1e-9)
    assert turning.duration.sum() > path.duration.sum() + 0.01  # the post takes time


def test_a_turned_path_takes_every_step_once_and_keeps_clear(over_a_post):
    machine, path = over_a_post
    turning = find_quickest_turning(machine, path, BEGAN, ENDED)
    assert turning.step[turning.step != REST_STEP].tolist() == list(range(path.steps))
    assert turning.angle[[0, -1]] == pytest.approx([BEGAN, ENDED])
    assert np.all(np.diff(turning.angle) >= -1e-12)
    whole = combine_with_slew(machine, _task(machine, path), path, turning)
    assert whole.posture[:, 1:][-1] == pytest.approx(path.posture[-1])
    for start, end in itertools.pairwise(whole.posture):
        assert is_clear(machine, start, end)
    a = machine.arrays
    slewed = 1.2 * abs(machine.moment_arms(np.zeros(4))[0]) * a.cap_area[0]
    leaks = 4 * a.leakage_flow * (whole.duration.sum() - path.duration.sum())
    added = a.supply_pressure * (slewed + leaks)
    assert whole.energy.sum() == pytest.approx(path.energy.sum() + added)


def _task(machine, path):
    start = np.append(BEGAN, path.posture[0])
    modes = StartModes.create_settled(np.zeros(4, dtype=np.uint8))
    goal = tuple(machine.tip_in_base(np.append(ENDED, path.posture[-1])).tolist())
    state = MotionState.at_rest(start)
    return PathRequest(goal, state, modes, None, start, PlanOptions(planner="table"), WITHOUT_AREA)


def test_behind_a_wall_that_the_path_does_not_pass_there_is_no_turning(over_a_post):
    machine, path = over_a_post
    wall = Zones(boxes=((0.8, 0.0, -3.0, 4.0, 0.1, 4.0),))
    assert find_quickest_turning(machine.changed(zones=wall), path, BEGAN, ENDED) is None


def test_rests_stand_at_the_corner_and_where_the_slew_turns_alone(over_a_post):
    machine, path = over_a_post
    turning = find_quickest_turning(machine, path, BEGAN, ENDED)
    task = _task(machine, path)
    whole, before = (
        combine_with_slew(machine, task, path, turning),
        find_rest_steps(turning, LIFTED),
    )
    assert int(np.flatnonzero(turning.step == LIFTED)[0]) in before
    alone = turning.step == REST_STEP
    for step in np.flatnonzero(alone[1:] != alone[:-1]) + 1:
        assert step in before
    rested = insert_rests(machine, whole, before, task.options.weights)
    seconds = compute_shortest_ramp(machine).duration
    assert rested.duration.sum() == pytest.approx(whole.duration.sum() + seconds * len(before))
    still = np.flatnonzero((np.diff(rested.posture, axis=0) == 0.0).all(axis=1))
    assert set(before + np.arange(len(before))) <= set(still.tolist())
    a = machine.arrays
    leaks = 4 * a.leakage_flow * a.supply_pressure * seconds * len(before)
    assert rested.energy.sum() == pytest.approx(whole.energy.sum() + leaks)
    assert rested.switches == whole.switches
