"""Plans for an arm whose actuators have valves and V_max of their own."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.lower_bounds import energy_lower_bound

from mhsb_model.braking import brake_along
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine, load_machine
from mhsb_model.trajectory import MotionState
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planner import ENERGY_OPTIMAL, Planner, PlanOptions
from mhsb_planner.posture.s1_global_search import build_posture_table, find_postures_at
from mhsb_planner.search.s2_search import Weights

KINDS = st.sampled_from(["table", "fixed", "integrated"])
WEIGHTS = st.sampled_from([ENERGY_OPTIMAL, Weights(0.0, 15.0, 2.0)])
LIMITS = {"joint": 1e-7, "tip": 2e-6, "modules": 0.0}
OWN = {
    "joints.0.actuator.rated_flow": 7e-5,
    "joints.1.actuator.max_piston_speed": 0.007,
    "joints.2.actuator.rated_flow": 4e-5,
    "joints.2.actuator.rated_pressure_drop_per_land": 2e6,
    "joints.2.actuator.max_piston_speed": 0.009,
}


@pytest.fixture(scope="module")
def arm(machine: Machine) -> Machine:
    return machine.with_values(OWN)


@pytest.fixture(scope="module")
def planner(arm: Machine) -> Planner:
    return Planner(arm, build_posture_table(arm, spacing=0.1))


def moves(planner: Planner, seed: int, count: int = 2) -> tuple[np.ndarray, list[tuple]]:
    """A posture at a node of the table, and the positions of others."""
    random, table = np.random.default_rng(seed), planner.graph.table
    first, *others = random.choice(np.flatnonzero(table.feasible), count, replace=False)
    goals = [tuple((table.nodes[node] * table.spacing).tolist()) for node in others]
    return table.posture[first, 0], goals


def assert_keeps_limits(measured: dict[str, float]) -> None:
    broken = {name: by for name, by in measured.items() if by > LIMITS.get(name, 1e-6)}
    assert not broken, broken


@settings(max_examples=40)
@given(KINDS, WEIGHTS, st.integers(0, 2**32))
def test_every_piston_keeps_its_own_v_max_and_its_own_valve(planner, worst, kind, weights, seed):
    start, (goal,) = moves(planner, seed)
    options = PlanOptions(weights, planner=kind, trajectory="followed")
    plan = planner.plan(goal, MotionState.at_rest(start), options=options)
    motion = plan.motion
    assert_keeps_limits(
        worst(motion.trajectory, motion.schedule, machine=planner.machine, v_max=True)
    )
    assert motion.speed_excess <= 1e-9
    assert plan.energy.paper >= plan.lower_bound * (1 - 1e-9)


@settings(max_examples=15)
@given(KINDS, st.integers(0, 2**32))
def test_a_piston_keeps_its_own_v_max_where_a_goal_changes_in_motion(planner, worst, kind, seed):
    start, (first, second) = moves(planner, seed, 3)
    options = PlanOptions(Weights(0.0, 15.0, 2.0), planner=kind, trajectory="followed")
    plan = planner.plan(first, MotionState.at_rest(start), options=options)
    trajectory, schedule = plan.motion.trajectory, plan.motion.schedule
    at_ns = int(0.4 * trajectory.duration_ns)
    again = planner.plan(
        second,
        trajectory.sample(at_ns),
        modes=StartModes.read_from(schedule, at_ns),
        brake=brake_along(planner.machine, trajectory, at_ns),
        options=options,
    ).motion
    measured = worst(again.trajectory, again.schedule, machine=planner.machine, v_max=True)
    assert measured["speed"] <= 1e-6


def test_the_excess_of_a_polynomial_is_that_of_the_piston_that_passes_its_own_v_max_the_most(
    planner, worst
):
    passed = 0
    for seed in range(12):
        start, (goal,) = moves(planner, seed)
        options = PlanOptions(planner="table", trajectory="polynomial")
        motion = planner.plan(goal, MotionState.at_rest(start), options=options).motion
        measured = worst(motion.trajectory, motion.schedule, machine=planner.machine, v_max=True)
        assert measured["speed"] <= max(0.1, motion.speed_excess) + 1e-3
        assert motion.speed_excess == pytest.approx(measured["speed"], abs=5e-3)
        passed += motion.speed_excess > 0.01
    assert passed > 2


def test_a_slower_piston_takes_as_long_as_its_own_v_max_lets_it(machine, table):
    """Joint 2 alone, as fast as can be, and one ramp."""
    start, took = np.array([0.3, -1.4, -1.0]), []
    goal = tuple(machine.tip_position(start + [0.0, 0.3, 0.0]).tolist())
    psi = float(start.sum() + 0.3)
    for own in (0.012, 0.007):
        arm = machine.with_values({"joints.1.actuator.max_piston_speed": own})
        options = PlanOptions(Weights(0.0, 15.0, 2.0), planner="integrated", goal_psi=psi)
        planner = Planner(arm, table)
        took.append(planner.plan(goal, MotionState.at_rest(start), options=options).duration)
    way = np.ptp([machine.cylinder_lengths(q)[1] for q in (start, start + [0.0, 0.3, 0.0])])
    for duration, fastest in zip(took, (0.012, 0.007), strict=True):
        assert way / fastest < duration < way / fastest + 0.17  # a ramp at most


@given(st.integers(0, 2**32))
def test_the_lower_bound_lasts_as_long_as_the_slowest_piston_for_its_way(arm, seed):
    random, a = np.random.default_rng(seed), arm.arrays
    start, end = random.uniform(a.joint_min, a.joint_max, (2, 3))
    delta = arm.cylinder_lengths(end) - arm.cylinder_lengths(start)
    oil = np.where(delta > 0.0, a.cap_area, a.rod_area) @ np.abs(delta)
    leaks = 3 * a.leakage_flow
    least = max(*(np.abs(delta) / [0.012, 0.007, 0.009]), oil / (a.main_pump_flow - leaks))
    expected = a.supply_pressure * (oil + leaks * least)
    assert energy_lower_bound(arm, start, end[None, :]) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("kind", ["table", "fixed", "integrated"])
def test_a_slew_and_a_bucket_keep_what_is_their_own(worst, kind):
    usual = load_machine(find_config_file("excavator.yaml"))
    own = {"rated_flow": 4e-4, "max_piston_speed": 0.05}
    arm = usual.with_values({"joints.0.actuator": own, "joints.3.actuator.max_piston_speed": 0.04})
    planner = Planner(arm, build_posture_table(arm.planar_arm, spacing=6.0 * arm.spacing))
    place = arm.convert_to_plane((2.6, 0.0, -1.0), preferred_slew=0.0)
    start = np.append(place.slew, find_postures_at(arm.planar_arm, *place.tip).posture[0])
    options = PlanOptions(Weights(0.0, 15.0, 2.0), planner=kind, trajectory="followed")
    plan = planner.plan((1.3, 1.8, 0.5), MotionState.at_rest(start), options=options)
    motion = plan.motion
    assert_keeps_limits(worst(motion.trajectory, motion.schedule, machine=arm, v_max=True))
    turned = abs(motion.trajectory.position[-1, 0] - start[0])
    at_least = 0.2 * turned / 0.05  # on the ring gear's pitch circle of 0.2 m
    assert at_least < plan.duration
    leaks = 4 * arm.arrays.leakage_flow * arm.arrays.supply_pressure
    assert leaks * at_least < plan.lower_bound <= plan.energy.paper
