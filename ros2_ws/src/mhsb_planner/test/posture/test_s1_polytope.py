"""Area of the velocity polytope, against half-space intersection and hulls."""

import itertools

import numpy as np
import pytest
from scipy.spatial import ConvexHull, HalfspaceIntersection

from mhsb_model.machine import Machine
from mhsb_planner.posture.s1_polytope import (
    MODE_COUNT,
    compute_area_from_limits,
    compute_cross_products,
    compute_polytope_area,
    compute_polytope_vertices,
)

OWN_VALVES = {
    "joints.0.actuator.rated_flow": 5e-5,
    "joints.2.actuator.rated_flow": 2e-5,
    "joints.2.actuator.rated_pressure_drop_per_land": 2e6,
}
NO_PUMP_LIMIT = 0.09  # m³/s, more than any valve passes


def with_main_pump(machine, flow, payload=10.0):
    content = machine.config.model_dump()
    content["hydraulics"]["main_pump"]["max_flow"] = flow
    content["payload"]["mass"] = payload
    return Machine.from_config(type(machine.config).model_validate(content))


def speed_limits(machine, q, pattern):
    """Piston speeds (retraction, extension) that valves and servo pumps allow, float64[n, 2]."""
    a = machine.arrays
    force = machine.gravity_torque(q) / machine.moment_arms(q)
    limits = []
    for j, mode in enumerate(pattern):
        cap, rod = a.cap_area[j], a.rod_area[j]
        supply = a.supply_pressure if mode == 0 else a.max_boost_pressure
        squares = [
            rod * supply - cap * a.tank_pressure + force[j],
            cap * supply - rod * a.tank_pressure - force[j],
        ]
        speed = a.valve_coefficient[j] * np.sqrt(np.maximum(squares, 0.0) / (cap**3 + rod**3))
        if mode > 0:
            pumped = a.modules_per_mode[mode] * a.servo_pump_flow
            speed = np.minimum(speed, [pumped / rod, pumped / cap])
        limits.append(speed)
    return np.array(limits)


def tip_velocities(machine, q):
    return machine.jacobian(q) / machine.moment_arms(q)


def hull_area(machine, q, pattern):
    """The polytope's area from its half-spaces, without any knowledge of its vertices."""
    a, n = machine.arrays, machine.joint_count
    back, out = speed_limits(machine, q, pattern).T
    available = a.main_pump_flow - n * a.leakage_flow
    rows = [[*row, -limit] for row, limit in zip(np.eye(n), out, strict=True)]
    rows += [[*-row, -limit] for row, limit in zip(np.eye(n), back, strict=True)]
    for signs in itertools.product((1.0, -1.0), repeat=n):
        area = np.where(np.array(signs) > 0, a.cap_area, a.rod_area)
        rows.append([*(signs * area), -available])
    scale = np.array([*np.ones(n), 1e3])  # speeds in mm/s, for the sake of the hull code
    inside = 1e3 * 0.01 * (out - back) / 2
    body = HalfspaceIntersection(np.array(rows) * scale, inside)
    return ConvexHull(body.intersections @ tip_velocities(machine, q).T).volume / 1e6


def random_cases(machine, count, seed):
    rng = np.random.default_rng(seed)
    low, high = machine.arrays.joint_min, machine.arrays.joint_max
    for _ in range(count):
        yield rng.uniform(low, high), machine.patterns[rng.integers(len(machine.patterns))]


@pytest.mark.parametrize(
    ("flow", "payload"),
    [(3.333e-5, 10.0), (1.0e-5, 10.0), (6.0e-5, 10.0), (NO_PUMP_LIMIT, 10.0), (3.333e-5, 60.0)],
)
def test_area_equals_half_space_intersection_and_hull(machine, flow, payload):
    arm = with_main_pump(machine, flow, payload)
    for q, pattern in random_cases(arm, 60, seed=1):
        assert compute_polytope_area(arm, q, pattern) == pytest.approx(
            hull_area(arm, q, pattern), rel=1e-9
        )


def test_with_valves_of_their_own_the_area_is_that_of_the_half_spaces(machine):
    arm = machine.with_values(OWN_VALVES)
    for q, pattern in random_cases(arm, 40, seed=5):
        area = compute_polytope_area(arm, q, pattern)
        assert area == pytest.approx(hull_area(arm, q, pattern), rel=1e-9)
        assert area <= compute_polytope_area(machine, q, pattern) * (
            1 + 1e-12
        )  # no valve is larger


def test_heavy_loads_that_leave_one_direction_only_were_among_them(machine):
    arm = with_main_pump(machine, 3.333e-5, 60.0)
    one_sided = [
        np.any(speed_limits(arm, q, pattern) == 0.0) for q, pattern in random_cases(arm, 60, seed=1)
    ]
    assert any(one_sided)


def test_without_the_pump_limit_the_area_is_the_sum_over_pairs_of_joints(machine):
    arm = with_main_pump(machine, NO_PUMP_LIMIT)
    for q, pattern in random_cases(arm, 100, seed=2):
        columns = tip_velocities(arm, q)
        width = speed_limits(arm, q, pattern).sum(axis=1)
        total = sum(
            abs(np.linalg.det(columns[:, [i, j]])) * width[i] * width[j]
            for i, j in itertools.combinations(range(arm.joint_count), 2)
        )
        assert compute_polytope_area(arm, q, pattern) == pytest.approx(total, rel=1e-10)


def test_the_area_is_that_of_the_polygon_of_its_vertices(machine):
    for q, pattern in random_cases(machine, 50, seed=3):
        x, z = compute_polytope_vertices(machine, q, pattern).T
        shoelace = 0.5 * np.sum(x * np.roll(z, -1) - np.roll(x, -1) * z)
        assert compute_polytope_area(machine, q, pattern) == pytest.approx(shoelace, rel=1e-9)


def greedy_hull_area(columns, scale, limit, flow):
    """Hull over all orthants and orders in which the joints take flow, for any joint count."""
    n = columns.shape[1]
    points = []
    for direction in itertools.product((0, 1), repeat=n):
        for order in itertools.permutations(range(n)):
            rest, speed = flow, np.zeros(n)
            for j in order:
                taken = min(limit[j, direction[j]], rest)
                rest -= taken
                speed[j] = taken * scale[j, direction[j]]
            points.append(columns @ speed)
    return ConvexHull(points, qhull_options="QJ Pp").volume


def kernel_area(columns, scale, limit, flow):
    n = columns.shape[1]
    cross = np.empty((n, n))
    compute_cross_products(np.ascontiguousarray(columns), cross)
    by_mode = np.repeat(limit[:, None, :], MODE_COUNT, axis=1)
    pattern = np.zeros(n, dtype=np.uint8)
    pattern.setflags(write=False)
    return compute_area_from_limits(cross, scale, by_mode, pattern, flow)


@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_the_kernel_knows_any_number_of_joints(n):
    rng = np.random.default_rng(n)
    for _ in range(10):
        columns = rng.normal(size=(2, n))
        scale = rng.uniform(0.5, 2.0, (n, 2)) * [1.0, -1.0]
        limit = rng.uniform(0.0, 1.0, (n, 2))
        flow = rng.uniform(0.3, 0.7 * n)
        expected = greedy_hull_area(columns, scale, limit, flow)
        assert kernel_area(columns, scale, limit, flow) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("n", [3, 4])
def test_parallel_columns_and_equal_orders_are_counted_once(n):
    rng = np.random.default_rng(n)
    for _ in range(60):
        columns = rng.integers(-2, 3, (2, n)).astype(float)
        if np.linalg.matrix_rank(columns) < 2:
            continue
        scale = np.repeat([[1.0, -1.0]], n, axis=0)
        limit = rng.integers(0, 3, (n, 2)).astype(float)
        flow = float(rng.integers(1, 5))
        area = kernel_area(columns, scale, limit, flow)
        nearly = columns + 1e-9 * rng.normal(size=columns.shape)
        assert area == pytest.approx(greedy_hull_area(nearly, scale, limit, flow), abs=1e-6)


def test_a_singular_posture_has_no_area(machine):
    columns = np.array([[1.0, 2.0, -3.0], [0.5, 1.0, -1.5]])
    scale = np.repeat([[1.0, -1.3]], 3, axis=0)
    assert kernel_area(columns, scale, np.ones((3, 2)), 2.0) == pytest.approx(0.0, abs=1e-9)
