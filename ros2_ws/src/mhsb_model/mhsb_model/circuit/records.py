"""Types of the structured arrays in which the simulator keeps its state for the kernels."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

Records = NDArray[Any]
"""Structured array with one record per actuator, module or element, or with a single record."""

Record = Any
"""One record of a structured array; kernels read and write its fields as attributes."""
