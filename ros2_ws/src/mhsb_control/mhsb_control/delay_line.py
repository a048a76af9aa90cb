"""Delay of commands in whole steps: values that were sent, and the one that acts now."""

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray

MAX_DELAY = 0.06
"""Longest delay that is considered [s]."""


def build_delay_lines(count: int, step: float) -> FloatArray:
    """Build histories of values for delays up to `MAX_DELAY`.

    Args:
        count: Number of histories.
        step: Control period [s].

    Returns:
        Zeros, float64[count, d + 1], the newest value first. d is the longest delay in steps.
    """
    return np.zeros((count, round(MAX_DELAY / step) + 1))


def describe_uncompensated_delay(machine: Machine) -> str | None:
    """Say in a sentence that the declared delay of commands exceeds `MAX_DELAY`, if it does.

    Args:
        machine: The machine as declared in its file (the real one may differ).

    Returns:
        One sentence for the user; None if the delay is compensated.
    """
    delay = machine.config.imperfections.computing_delay
    if delay <= MAX_DELAY:
        return None
    return (
        f"imperfections.computing_delay is {1e3 * delay:.4g} ms, of which the controller "
        f"coordinated compensates {1e3 * MAX_DELAY:.4g} ms; use lag_compensated for longer delays"
    )


@kernel(borrows=True)
def delay_value(history: FloatArray, value: float, delay: int) -> float:
    """Add a value to a history, and return the value that is some steps old.

    Args:
        history: Values of the last steps, the newest first, float64[d + 1]. Written in place.
        value: Present value.
        delay: Number of steps, 0 … d.

    Returns:
        Value of `delay` steps before.
    """
    for i in range(len(history) - 1, 0, -1):
        history[i] = history[i - 1]
    history[0] = value
    return history[delay]
