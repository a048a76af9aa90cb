import numpy as np
import pytest

from mhsb_sim.circuit.network import add_to_linear_system, solve_in_place


@pytest.mark.parametrize("seed", range(5))
def test_the_sparse_elimination_equals_a_dense_solution(seed: int) -> None:
    rng = np.random.default_rng(seed)
    nodes = 12
    inflow, matrix = np.zeros(nodes), np.zeros((nodes, nodes))
    for _ in range(15):
        i, j = rng.choice(nodes, 2, replace=False)
        add_to_linear_system(inflow, matrix, i, j, rng.normal(), rng.uniform(0.0, 1e3))
    size = nodes - 1
    matrix[np.diag_indices(nodes)] += rng.uniform(0.1, 1.0, nodes)
    expected = np.linalg.solve(matrix[:size, :size], inflow[:size])
    solve_in_place(matrix, inflow, size)
    np.testing.assert_allclose(inflow[:size], expected, rtol=1e-9)


def test_what_leaves_one_node_enters_the_other() -> None:
    inflow, matrix = np.zeros(3), np.zeros((3, 3))
    add_to_linear_system(inflow, matrix, 0, 2, 5.0, 2.0)
    np.testing.assert_array_equal(inflow, [-5.0, 0.0, 5.0])
    np.testing.assert_array_equal(matrix, [[2, 0, -2], [0, 0, 0], [-2, 0, 2]])
