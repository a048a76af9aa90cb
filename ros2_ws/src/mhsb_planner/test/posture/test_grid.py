"""The grid of tip positions."""

import numpy as np
import pytest

from mhsb_planner.errors import RequestError
from mhsb_planner.posture.grid import Grid, list_grid_nodes

SPACING = 0.05


@pytest.fixture(scope="module")
def grid(machine):
    return Grid(list_grid_nodes(machine, SPACING), SPACING)


def test_the_papers_grid_has_its_642_nodes(machine):
    expected = {(i, k) for i in range(22) for k in range(-21, 22) if 25 <= i * i + k * k <= 423}
    nodes = list_grid_nodes(machine, SPACING)
    assert len(nodes) == 642
    assert set(map(tuple, nodes.tolist())) == expected


def test_neighbours_are_the_nodes_one_move_away(grid):
    for node, row in zip(grid.nodes, grid.neighbors, strict=True):
        near = np.flatnonzero(np.max(np.abs(grid.nodes - node), axis=1) == 1)
        assert sorted(row[row >= 0]) == sorted(near)


def test_a_node_is_found_by_its_position_and_no_other_point_is(grid):
    for number, (i, k) in enumerate(grid.nodes):
        assert grid.node_at(i * SPACING, k * SPACING) == number
    assert grid.node_at(0.51, 0.5) is None
    assert grid.node_at(0.0, 0.0) is None


@pytest.mark.parametrize(
    ("point", "corners"),
    [
        ((0.52, 0.31), {(10, 6), (10, 7), (11, 6), (11, 7)}),
        ((0.50, 0.31), {(9, 6), (9, 7), (10, 6), (10, 7), (11, 6), (11, 7)}),
        ((0.50, 0.30), {(i, k) for i in (9, 10, 11) for k in (5, 6, 7)} - {(10, 6)}),
        ((0.02, 0.24), {(1, 5), (0, 5)}),
    ],
)
def test_a_point_is_joined_to_the_corners_of_all_cells_it_lies_in(grid, point, corners):
    assert {tuple(grid.nodes[node]) for node in grid.cell_corners(*point)} == corners


def test_a_ring_adds_the_nodes_around_the_corners(grid):
    wide = {tuple(grid.nodes[node]) for node in grid.cell_corners(0.52, 0.31, rings=1)}
    assert wide == {(i, k) for i in range(9, 13) for k in range(5, 9)}


@pytest.mark.parametrize(
    ("a", "b", "together"),
    [
        ((0.51, 0.31), (0.54, 0.34), True),
        ((0.51, 0.31), (0.56, 0.34), False),
        ((0.50, 0.31), (0.54, 0.34), True),
        ((0.50, 0.30), (0.55, 0.35), True),
        ((0.50, 0.30), (0.60, 0.30), False),
        ((0.49, 0.31), (0.51, 0.31), False),
        ((0.50, 0.30), (0.50, 0.30), True),
    ],
)
def test_points_share_a_cell_where_one_closed_cell_holds_both(grid, a, b, together):
    assert grid.share_cell(a, b) is together
    assert grid.share_cell(b, a) is together


@pytest.mark.parametrize("spacing", [0.0, -0.05, 2.0, float("nan"), float("inf")])
def test_a_useless_spacing_is_refused(machine, spacing):
    with pytest.raises(RequestError, match="spacing must be above 0"):
        list_grid_nodes(machine, spacing)
