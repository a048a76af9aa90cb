"""Kernels that only read have one version for writable and read-only arrays."""

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from mhsb_model.kernels.compiled import register_kernel_class
from mhsb_model.kernels.kernel import Kernel, kernel
from mhsb_model.types import frozen


@kernel(reads=True)
def _total(values):
    total = 0.0
    for each in values:
        total += each
    return total


def _total_of_both(values, constants):
    return _total(values) + _total(constants)


@kernel(reads=True)
def _overwrite(values):
    values[0] = 0.0


@kernel
def _call_overwrite(values):
    _overwrite(values)


def test_writable_and_read_only_arrays_share_a_version():
    writable = np.array([1.0, 2.0])
    register_kernel_class(Kernel)
    compute = njit(_total_of_both)  # compiled anew each time, not loaded from the disk
    assert compute(writable, frozen(2.0 * writable)) == pytest.approx(9.0)
    assert len(_total.inner.dispatcher.signatures) == 1


def test_a_kernel_that_promises_to_read_alone_and_writes_is_refused():
    with pytest.raises(TypingError, match="readonly"):
        _call_overwrite(np.ones(2))
