"""Sorting inside kernels.

Numba's own `ndarray.sort` is compiled again with each kernel that calls it. This takes a second,
longer than compiling most kernels.
"""

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray


@kernel(borrows=True)
def sort_in_place(values: FloatArray, count: int) -> None:
    """Sort the first values of an array in ascending order, by insertion.

    The time grows with the square of `count`; for nearly sorted values, in proportion to `count`.

    Args:
        values: Values without NaN, shape (count or more,), changed in place.
        count: Number of values to sort.
    """
    for i in range(1, count):
        value, k = values[i], i
        while k > 0 and values[k - 1] > value:
            values[k] = values[k - 1]
            k -= 1
        values[k] = value
