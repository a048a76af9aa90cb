import numpy as np
from numba import njit

from mhsb_model.circuit.quantities import ModuleState
from mhsb_model.kernels.bound_kernel import bind_kernel
from mhsb_model.records import create_records


@njit
def weighted_sum(values, modules, first, last):
    total = 0.0
    for k in range(first, last):
        total += values[k] * modules[k].flow
    return total


def test_a_bound_kernel_does_what_the_kernel_does_with_what_its_arrays_hold_then():
    values, modules = np.arange(5.0), create_records(ModuleState, 5)
    bound = bind_kernel(weighted_sum, values, modules, integer_count=2)
    modules["flow"] = 2.0
    assert bound(1, 4) == weighted_sum(values, modules, 1, 4) == 12.0
    values[3] = 10.0
    assert bound(3, 4) == 20.0


def test_read_only_arrays_can_be_bound():
    values, modules = np.arange(5.0), create_records(ModuleState, 5)
    modules["flow"] = 1.0
    values.setflags(write=False)
    assert bind_kernel(weighted_sum, values, modules, integer_count=2)(0, 5) == values.sum()
