import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mhsb_tools.viewer.shapes import bytes_of, get_rotation_to, get_rotation_up


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0.6, 0.0, -0.8)])
def test_a_bar_along_z_is_turned_into_its_direction(direction):
    turn = Rotation.from_quat(get_rotation_to(np.array(direction, dtype=float)), scalar_first=True)
    np.testing.assert_allclose(turn.apply([0.0, 0.0, 1.0]), direction, atol=1e-9)


def test_a_positive_angle_raises_a_link():
    turn = Rotation.from_quat(get_rotation_up(np.pi / 6), scalar_first=True)
    np.testing.assert_allclose(turn.apply([1.0, 0.0, 0.0]), [np.cos(np.pi / 6), 0.0, 0.5])


def test_colours_are_bytes():
    assert bytes_of((0.0, 0.5, 1.0)) == (0, 128, 255)
