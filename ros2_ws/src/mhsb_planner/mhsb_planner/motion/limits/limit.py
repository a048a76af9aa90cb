"""Declaration of a limit of a motion, and the violation that reports a broken limit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray, ModeArray


class TimeScaling(Enum):
    """Effect of a longer duration of a motion on the quantity that a limit bounds."""

    NONE = "none"
    """The quantity stays the same. A motion that breaks the limit is refused."""
    SPEED = "speed"
    """The quantity is proportional to the speed, so the motion is slowed by the quantity as a
    factor.
    """
    INERTIA = "inertia"
    """The quantity falls with the accelerations. Slower ramps are tried first, then a longer
    duration of the whole motion."""


class LimitInputs(NamedTuple):
    """State of a motion at one instant, from which kernels compute the quantities of limits.

    In `s3_limits` all arrays but `scratch` may have a further first axis for several instants.

    Attributes:
        position: Joint positions, shape (n,) [rad or m].
        speed: Piston speeds, positive in extension, shape (n,) [m/s].
        force: Piston forces under gravity, positive if they resist extension, shape (n,) [N].
        inertia: Piston forces from inertia, to be added to the gravity forces, shape (n,) [N].
        tip: Tip position (x, z), shape (2,) [m].
        modes: Mode codes (N, DB, SB), shape (n,).
        scratch: Working memory that every limit may overwrite, shape (n,).
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
    """Limit that a motion must keep.

    Attributes:
        name: Name of the limit.
        describe: Function that returns a clause about the size of a violation.
        time_scaling: Effect of a longer duration.
    """

    name: str
    describe: Callable[[Violation], str]
    time_scaling: TimeScaling = TimeScaling.NONE


@dataclass(frozen=True, kw_only=True, eq=False)
class StateLimit(Limit):
    """Limit on a quantity that follows from the state of a motion at one instant.

    An interval between two points is proven to keep the limit if the quantity is below
    `clear_below` at both ends. It is also proven if an upper bound of the quantity, from a
    parabola, is below `proven_below`. All other intervals are checked at close instants.

    Attributes:
        measure: Kernel with the arguments machine arrays and `LimitInputs` that returns the
            quantity. For TimeScaling.SPEED it returns the share of the possible speed that is used.
        limit: Value above which the amount of a violation is counted.
        broken_above: Value above which the limit is broken. inf means never; the limit then only
            selects intervals for the check at close instants.
        proven_below: Upper bound over an interval below which the interval is proven.
        clear_below: Value at both ends of an interval below which the interval is proven. Its
            distance from the limit covers the states between the ends: over 20 ms a joint deviates
            from a straight line by 0.05 mrad per rad/s².
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
        amount: Excess over the limit, in the unit of the limit's quantity.
        name: Name of the obstacle; empty if the limit does not concern obstacles.
    """

    limit: Limit
    time: float
    amount: float
    name: str = ""

    def __str__(self) -> str:
        """Return one sentence that describes the violation."""
        return f"{self.limit.describe(self)} at {self.time:.3f} s"
