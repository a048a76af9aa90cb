"""Sorting inside kernels."""

import numpy as np
import pytest

from mhsb_model.kernels.sorting import sort_in_place


@pytest.mark.parametrize("count", [0, 1, 2, 7, 40])
def test_the_first_values_are_sorted_and_the_others_stay(count: int) -> None:
    rng = np.random.default_rng(count)
    given = np.append(rng.integers(0, 12, count).astype(float), [3.0, 1.0])  # some values are equal
    values = given.copy()
    sort_in_place(values, count)
    np.testing.assert_array_equal(values[:count], np.sort(given[:count]))
    np.testing.assert_array_equal(values[count:], given[count:])
