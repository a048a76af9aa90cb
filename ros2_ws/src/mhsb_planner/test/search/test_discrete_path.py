"""What a discrete path says of itself."""

import numpy as np
import pytest

from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics


@pytest.fixture
def path():
    return DiscretePath(
        tip=np.array([[0.5, 0.0], [0.55, 0.0], [0.6, 0.05]]),
        posture=np.zeros((3, 3)),
        modes=np.array([[1, 0, 0], [2, 0, 1]]),
        duration=np.array([1.0, 0.5]),
        energy=np.array([10.0, 20.0]),
        energy_series=np.array([9.0, 18.0]),
        cost=40.0,
        start_modes=np.zeros(3),
        statistics=SearchStatistics(3, 9, 0.001),
    )


def test_switches_are_counted_from_the_modes_in_force_on(path):
    assert path.switches == 3


def test_time_and_length_add_up(path):
    assert path.time == pytest.approx([0.0, 1.0, 1.5])
    assert path.length == pytest.approx(0.05 + np.hypot(0.05, 0.05))
    assert path.steps == 2


def test_its_arrays_are_read_only(path):
    for name in ("tip", "posture", "modes", "duration", "energy", "energy_series", "start_modes"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(path, name)[...] = 0
