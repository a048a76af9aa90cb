"""Delay of commands in whole steps: values that were sent, and the one that acts now."""

from __future__ import annotations

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray

MAX_DELAY_STEPS = 60
"""Longest delay that is considered, in steps."""


@kernel(borrows=True)
def delay_value(history: FloatArray, value: float, delay: int) -> float:
    """Add a value to its history, and return the one that is some steps old.

    Args:
        history: Values of the last steps, the newest first, float64[MAX_DELAY_STEPS + 1]. Written
            in place.
        value: Present value.
        delay: Number of steps, 0 … MAX_DELAY_STEPS.

    Returns:
        Value of `delay` steps before.
    """
    for i in range(len(history) - 1, 0, -1):
        history[i] = history[i - 1]
    history[0] = value
    return history[delay]
