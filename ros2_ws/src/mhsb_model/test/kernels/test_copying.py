"""Rows are copied by value, whatever their type and layout, inside kernels as outside."""

import numpy as np
import pytest

from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import frozen


@kernel
def _copy_within(target, source):
    copy_row(target, source)


@pytest.mark.parametrize("copy", [copy_row, _copy_within])
@pytest.mark.parametrize("values", [[0.5, -np.inf, np.nan], [True, False, True]])
def test_a_row_is_copied_by_value(copy, values):
    source = frozen(np.array([values, values[::-1]]))
    target = np.zeros_like(source)
    copy(target[1], source[0])
    np.testing.assert_array_equal(target[1], source[0])
    assert not target[0].any()


def test_a_column_is_copied_by_value():
    source, target = np.arange(6.0).reshape(2, 3), np.zeros((2, 3))
    copy_row(target[:, 1], source[:, 2])
    np.testing.assert_array_equal(target, [[0.0, 2.0, 0.0], [0.0, 5.0, 0.0]])
