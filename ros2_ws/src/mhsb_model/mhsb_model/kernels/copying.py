"""Copies of rows inside kernels.

If an array is assigned to a slice or a row, numba checks the shapes. It compiles the error message
for unequal shapes, with all its formatting of text, into each kernel with such an assignment.
Kernels that call such a kernel get the message too. Compiling the message takes longer than
compiling most kernels.
"""

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import BoolArray, FloatArray, ModeArray


@kernel(borrows=True)
def copy_row(
    target: FloatArray | ModeArray | BoolArray, source: FloatArray | ModeArray | BoolArray
) -> None:
    """Copy all values of an array into another array.

    Args:
        target: Receives the values in place, shape (n,).
        source: Values to copy, shape (n,). It must not overlap the target.
    """
    for i in range(len(target)):
        target[i] = source[i]
