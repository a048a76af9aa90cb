"""What is measured of a path, on a path whose numbers are known."""

import numpy as np
import pytest

from mhsb_model.modes import Mode
from mhsb_planner.posture.s1_polytope import compute_polytope_area
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_tools.reproduction import measures


@pytest.fixture
def path():
    """1 s in N, 2 s in DB, 1 s in SB; aside to the left and back."""
    return DiscretePath(
        tip=np.array([[0.5, 0.0], [0.4, 0.1], [0.4, 0.3], [0.5, 0.4]]),
        posture=np.array([[0.0, -0.5, 0.0], [0.1, -0.6, 0.2], [0.2, -0.6, -0.1], [0.2, -0.5, 0.0]]),
        modes=np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0]]),
        duration=np.array([1.0, 2.0, 1.0]),
        energy=np.array([10.0, 20.0, 30.0]),
        energy_series=np.array([9.0, 18.0, 27.0]),
        cost=0.0,
        start_modes=np.zeros(3),
        statistics=SearchStatistics(0, 0, 0.0),
    )


def test_sums(path):
    assert measures.energy(path) == 60.0
    assert measures.duration(path) == 4.0
    assert measures.joint_travel(path, 2) == pytest.approx(0.2 + 0.3 + 0.1)


def test_shares_of_the_time(path):
    assert measures.normal_share(path) == pytest.approx(0.25)
    assert measures.normal_share(path, 0.0, 0.5) == pytest.approx(0.5)
    assert measures.mode_share(path, Mode.SB) == pytest.approx(0.25)
    assert measures.mode_share(path, Mode.DB, 0.25, 0.75) == pytest.approx(1.0)


def test_the_way_it_goes(path):
    assert measures.path_ratio(path, 0.05) == pytest.approx((0.2 + 2 * 0.1 * np.sqrt(2)) / 0.4)
    assert measures.folding(path) == pytest.approx(0.1)
    assert measures.bulge(path) == pytest.approx(0.0)
    assert measures.sideways(path) == pytest.approx(0.1)


def test_polytopes_are_those_of_each_step_s_own_modes(machine, path):
    found = measures.compute_polytope_profile(machine, path)
    for area, q, modes in zip(found, path.posture[1:], path.modes, strict=True):
        assert area == compute_polytope_area(machine, q, modes)
