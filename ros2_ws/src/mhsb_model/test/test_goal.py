"""Positions and distances in messages."""

import pytest

from mhsb_model.goal import format_distance


@pytest.mark.parametrize(
    ("distance", "text"),
    [
        (0.0098, "9.8 mm"),
        (0.0, "0 mm"),
        (-0.02, "-20 mm"),
        (0.0999, "99.9 mm"),
        (0.1 - 1e-12, "0.1 m"),
        (1.23456, "1.23 m"),
    ],
)
def test_small_distances_are_in_millimetres(distance, text):
    assert format_distance(distance) == text
