"""Declaration of a limit of a motion, and the violation that reports a broken one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, ModeArray


class TimeScaling(Enum):
    """Effect that a longer duration of a motion has on the quantity of a limit."""

    NONE = "none"
    """The quantity stays the same, so a broken limit refuses the motion."""
    SPEED = "speed"
    """The quantity is proportional to the speed. The motion is stretched by it."""
    INERTIA = "inertia"
    """The quantity falls with the accelerations. Slower ramps are tried before a stretch."""


class LimitInputs(NamedTuple):
    """State of a motion at one instant, from which kernels measure the quantities of limits.

    Within `s3_limits` the arrays also hold k instants, along a first axis.

    Attributes:
        position: Joint positions, shape (n,) [rad or m].
        speed: Piston speeds, positive in extension, shape (n,) [m/s].
        force: Piston forces under gravity, positive if they resist extension, shape (n,) [N].
        inertia: Piston forces from inertia, which add to those of gravity, shape (n,) [N].
        tip: Tip position (x, z), shape (2,) [m].
        modes: Mode codes, shape (n,).
        scratch: Working memory of n numbers that every limit may overwrite.
    """

    position: FloatArray
    speed: FloatArray
    force: FloatArray
    inertia: FloatArray
    tip: FloatArray
    modes: ModeArray
    scratch: FloatArray


@kernel(inline="always")
def select_instant(motion: LimitInputs, k: int, interval: int) -> LimitInputs:
    """Return the state of a motion at one instant, as views of the motion's arrays.

    Args:
        motion: The motion: arrays with a row for each instant, and `modes` with a row for each
            interval between two points, shape (k − 1, n).
        k: Index of the instant.
        interval: Row of `motion.modes` for the state.

    Returns:
        The state.
    """
    return LimitInputs(
        motion.position[k],
        motion.speed[k],
        motion.force[k],
        motion.inertia[k],
        motion.tip[k],
        motion.modes[interval],
        motion.scratch,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Limit:
    """Limit that a motion may not break.

    Attributes:
        name: Name of the limit.
        describe: Returns a clause that says how far a violation goes beyond the limit.
        time_scaling: Effect of a longer duration.
    """

    name: str
    describe: Callable[[Violation], str]
    time_scaling: TimeScaling = TimeScaling.NONE


@dataclass(frozen=True, kw_only=True, eq=False)
class StateLimit(Limit):
    """Limit on a quantity that follows from the state of a motion at one instant.

    An interval between two points is proven to keep the limit in two cases. Either the quantity is
    below `clear_below` at both ends, or a parabola through both ends and the middle stays below
    `proven_below`. All other intervals are looked at closely.

    Attributes:
        measure: Kernel (machine arrays, `LimitInputs`) that returns the quantity. A limit with
            TimeScaling.SPEED measures a share of what is possible.
        limit: Value from which a violation's amount is counted.
        broken_above: Value above which the limit is broken; inf if it only asks for a close look.
        proven_below: Value below which a bound over an interval proves it.
        clear_below: Value below which a state leaves a reserve for nearby states; 20 ms away a
            joint deviates from the chord by 0.05 mrad per rad/s².
    """

    measure: Callable[[MachineArrays, LimitInputs], float]
    limit: float = 1.0
    broken_above: float = 1.0
    proven_below: float = 1.0
    clear_below: float = 0.95


@dataclass(frozen=True)
class Violation:
    """A limit that a motion breaks.

    Attributes:
        limit: The broken limit.
        time: Time from the motion's start [s].
        amount: Excess over the limit, in the unit of its quantity.
        name: Name of the obstacle; empty for other limits.
    """

    limit: Limit
    time: float
    amount: float
    name: str = ""

    def __str__(self) -> str:
        """Return one sentence that describes the violation."""
        return f"{self.limit.describe(self)} at {self.time:.3f} s"
