"""Array types used throughout the suite."""

import numpy as np
from numpy.typing import NDArray

Position = tuple[float, ...]
"""Tip position in `base_link` [m]: (x, z), or (x, y, z) for an arm that slews."""

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
ModeArray = NDArray[np.uint8]


def frozen(array: NDArray) -> NDArray:
    """Copy an array into a read-only, C-contiguous array.

    Args:
        array: Any array; it is not changed.

    Returns:
        A new array of the same dtype with its own memory, which refuses assignments.
    """
    copy = np.array(array, order="C")
    copy.setflags(write=False)
    return copy


def as_frozen(array: NDArray) -> NDArray:
    """Return the array itself if it is read-only and C-contiguous, otherwise a frozen copy."""
    flags = array.flags
    return array if flags.c_contiguous and not flags.writeable else frozen(array)
