"""Largest polytopes of the arm with four joints, beside SLSQP from many starts."""

import numpy as np
import pytest

from mhsb_model.files.config_files import find_config_file
from mhsb_model.inverse_kinematics.closed_form_3r import is_within_limits
from mhsb_model.machine import load_machine
from mhsb_planner.posture.s1_global_search import build_posture_table, find_postures_at
from mhsb_planner.posture.s1_polytope import compute_polytope_area
from mhsb_planner.posture.s1_slsqp import find_largest_polytope_by_slsqp

POINTS = [(0.55, 0.2), (0.9, -0.35), (0.25, 0.6), (1.05, 0.3)]


@pytest.fixture(scope="module")
def arm():
    return load_machine(find_config_file("mhsb_arm4.yaml"))


@pytest.mark.parametrize("point", POINTS)
def test_no_entry_is_smaller_than_what_slsqp_finds_from_30_starts(arm, point):
    found = find_postures_at(arm, *point)
    for p in np.random.default_rng(31).choice(len(arm.patterns), 3, replace=False):
        q, area = find_largest_polytope_by_slsqp(
            arm, *point, arm.patterns[p], seed=int(p), starts=30
        )
        assert is_within_limits(arm.arrays, q)
        assert arm.tip_position(q) == pytest.approx(point, abs=1e-12)
        assert area == compute_polytope_area(arm, q, arm.patterns[p])
        assert found.area[p] >= 0.999 * area


def test_every_posture_has_its_tip_at_the_point_is_within_limits_and_has_its_area(arm):
    for x, z in POINTS:
        found = find_postures_at(arm, x, z)
        for q, area, pattern in zip(found.posture, found.area, arm.patterns, strict=True):
            assert arm.tip_position(q) == pytest.approx((x, z), abs=1e-12)
            assert is_within_limits(arm.arrays, q)
            assert area == pytest.approx(compute_polytope_area(arm, q, pattern), rel=1e-12)


def test_a_small_change_along_the_postures_of_the_point_gives_no_more_area(arm):
    random = np.random.default_rng(5)
    for x, z in POINTS[:2]:
        found = find_postures_at(arm, x, z)
        for p in (0, 17, 49):
            q = found.posture[p]
            near = arm.postures(x, z, q.sum() + random.uniform(-0.05, 0.05, 40))
            near = near[np.abs(near - q).max(axis=1) < 0.2]
            areas = [compute_polytope_area(arm, other, arm.patterns[p]) for other in near]
            assert max(areas, default=0.0) <= found.area[p] * (1.0 + 1e-9)


def test_the_table_does_not_depend_on_the_number_of_threads(arm):
    one, two = (build_posture_table(arm, spacing=0.4, jobs=jobs) for jobs in (1, 2))
    assert np.array_equal(one.posture, two.posture)
    assert one.feasible.all()
