"""Postures of largest velocity polytope, against a dense scan."""

import numpy as np
import pytest

from mhsb_model.inverse_kinematics.closed_form_3r import is_within_limits
from mhsb_planner.errors import InfeasibleGoalError
from mhsb_planner.posture.s1_global_search import build_posture_table, find_postures_at
from mhsb_planner.posture.s1_polytope import compute_polytope_area

DENSE = np.linspace(-np.pi, np.pi, 2401)


@pytest.fixture(scope="module")
def coarse(machine):
    return build_posture_table(machine, spacing=0.2)


def test_every_entry_has_its_tip_on_its_node_within_the_joint_limits(machine, table):
    for node in np.flatnonzero(table.feasible):
        position = table.nodes[node] * table.spacing
        for q in table.posture[node]:
            assert is_within_limits(machine.arrays, q)
            assert machine.tip_position(q) == pytest.approx(position, abs=1e-12)


def test_every_entry_has_the_area_that_is_recorded(machine, table):
    for node in np.flatnonzero(table.feasible):
        for pattern, q, area in zip(
            table.patterns, table.posture[node], table.area[node], strict=True
        ):
            assert compute_polytope_area(machine, q, pattern) == area


def test_no_posture_of_a_dense_scan_has_a_larger_area(machine, table):
    rng = np.random.default_rng(8)
    for node in rng.choice(np.flatnonzero(table.feasible), 15, replace=False):
        x, z = table.nodes[node] * table.spacing
        postures = machine.postures(x, z, DENSE)
        for p in rng.choice(len(table.patterns), 3, replace=False):
            areas = [compute_polytope_area(machine, q, table.patterns[p]) for q in postures]
            assert table.area[node, p] >= max(areas, default=0.0) * (1 - 1e-6)


def test_nodes_without_entry_have_no_posture_in_a_dense_scan(machine, table):
    assert np.array_equal(table.feasible, np.all(np.isfinite(table.posture), axis=(1, 2)))
    for x, z in table.nodes[~table.feasible] * table.spacing:
        assert len(machine.postures(x, z, DENSE)) == 0


def test_the_number_of_threads_does_not_change_a_bit(machine, coarse):
    alone = build_posture_table(machine, spacing=0.2, jobs=1)
    assert alone.posture.tobytes() == coarse.posture.tobytes()
    assert alone.area.tobytes() == coarse.area.tobytes()


def test_a_point_on_a_node_gets_the_postures_of_the_table(machine, table):
    node = int(np.flatnonzero(table.feasible)[100])
    here = find_postures_at(machine, *(table.nodes[node] * table.spacing))
    assert here.posture.tobytes() == table.posture[node].tobytes()


def test_a_point_without_posture_is_refused(machine, table):
    x, z = table.nodes[~table.feasible][0] * table.spacing
    with pytest.raises(InfeasibleGoalError, match="no posture within the joint limits"):
        find_postures_at(machine, x, z)


def test_progress_rises_to_the_number_of_nodes(machine, coarse):
    told = []
    build_posture_table(machine, 0.2, progress=lambda done, total: told.append((done, total)))
    assert told == sorted(told)
    assert told[-1] == (len(coarse.nodes), len(coarse.nodes))
