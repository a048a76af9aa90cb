"""Array types used throughout the suite."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Position = tuple[float, ...]
"""Of the tip in `base_link` [m]: (x, z), of arms that slew (x, y, z)."""

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
ModeArray = NDArray[np.uint8]
Records = NDArray[Any]
"""An `np.recarray`: rows with named fields."""


def frozen(array: NDArray) -> NDArray:
    """The same data as a read-only, contiguous array of its own."""
    copy = np.array(array, order="C")
    copy.setflags(write=False)
    return copy


def as_frozen(array: NDArray) -> NDArray:
    """The array itself where it is read-only and contiguous, else `frozen`."""
    flags = array.flags
    return array if flags.c_contiguous and not flags.writeable else frozen(array)
