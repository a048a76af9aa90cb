"""Types of the structured arrays in which the simulator keeps its state for the kernels."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

Records = NDArray[Any]
"""A structured array, one record per actuator, module or element; or a single one, [1]."""

Record = Any
"""One record of such an array; kernels read and write its fields as attributes."""
