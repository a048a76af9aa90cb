"""Hydraulic operating modes, mode patterns and the budget of booster modules.

What a mode means is told by its row in `PROPERTIES`, and by how many booster modules the machine
gives it; codes are names, their order says nothing.

A mode pattern names one mode per actuator. Modules in use by a pattern:
sum over actuators of `modules_per_mode[mode]`, at most the number of modules fitted
(paper, Section 3: four modules give 23 patterns of three joints).
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from mhsb_model.types import IntArray, ModeArray, frozen


class Mode(IntEnum):
    """Operating mode of one actuator."""

    N = 0  # normal: the main pump feeds through the check valve
    DB = 1  # decoupled boost: the actuator's own servo pump raises its supply pressure
    SB = 2  # shared boost: the flows of several servo pumps are summed


class ModeProperties(NamedTuple):
    """What a mode means for an actuator that is in it.

    boosted  servo pumps raise its supply pressure, so that it takes booster modules
    on_rail  its line is joined to the rail, at one pressure with all others there
    rank     a mode can do all that modes of lower rank can
    """

    boosted: bool
    on_rail: bool
    rank: int


PROPERTIES = {
    Mode.N: ModeProperties(boosted=False, on_rail=False, rank=0),
    Mode.DB: ModeProperties(boosted=True, on_rail=False, rank=1),
    Mode.SB: ModeProperties(boosted=True, on_rail=True, rank=2),
}

MODE_COUNT = len(PROPERTIES)

# The columns of the table by mode code, as kernels take them.
BOOSTED = frozen(np.array([PROPERTIES[mode].boosted for mode in Mode]))
ON_RAIL = frozen(np.array([PROPERTIES[mode].on_rail for mode in Mode]))
RANK = frozen(np.array([PROPERTIES[mode].rank for mode in Mode]))

BY_RANK = sorted(Mode, key=lambda mode: PROPERTIES[mode].rank)
"""The modes from the weakest to the strongest."""


def stronger(one: ModeArray, other: ModeArray) -> ModeArray:
    """Actuator by actuator the mode of higher rank of two patterns, uint8[n]."""
    return np.where(RANK[other] > RANK[one], other, one)


def strongest(modes: ModeArray) -> ModeArray:
    """The mode of highest rank in each of the patterns uint8[…, n], uint8[…]."""
    return np.array(BY_RANK, dtype=np.uint8)[RANK[modes].max(axis=-1)]


def any_boosted(modes: ModeArray) -> np.ndarray:
    """Whether any actuator is boosted in each of the patterns uint8[…, n], bool[…]."""
    return np.any(BOOSTED[modes], axis=-1)


def modules_in_use(pattern: Sequence[int] | ModeArray, modules_per_mode: Sequence[int]) -> int:
    """Number of booster modules that a mode pattern occupies."""
    return sum(modules_per_mode[mode] for mode in pattern)


def mode_patterns(
    actuator_count: int, module_count: int, modules_per_mode: Sequence[int]
) -> ModeArray:
    """All patterns within the module budget, uint8[patterns, actuators], all-N first.

    The order is lexicographic in the mode codes, so an index is stable for a given budget.
    """
    allowed = [
        pattern
        for pattern in itertools.product(sorted(Mode), repeat=actuator_count)
        if modules_in_use(pattern, modules_per_mode) <= module_count
    ]
    patterns = np.array(allowed, dtype=np.uint8)
    patterns.setflags(write=False)
    return patterns


def assign_modules(
    pattern: Sequence[int] | ModeArray,
    module_count: int,
    modules_per_mode: Sequence[int],
    lost: Collection[int] = (),
) -> IntArray:
    """Which actuator each module serves, int64[module_count], -1 where the module is idle.

    Module j belongs to actuator j, those beyond the actuators are spare. A boosted actuator
    takes its own module, then the spares, then the modules of actuators that leave theirs
    idle, in order; none that is lost. Raises ValueError where the pattern needs more modules than
    there are.
    """
    actuator_count = len(pattern)
    needed = [modules_per_mode[mode] for mode in pattern]
    if sum(needed) > module_count - len(lost):
        raise ValueError(
            f"mode pattern {pattern_name(pattern)} needs {sum(needed)} modules, "
            f"{module_count - len(lost)} are there"
        )
    serves = np.full(module_count, -1, dtype=np.int64)
    for actuator, count in enumerate(needed):
        if count > 0 and actuator < module_count and actuator not in lost:
            serves[actuator] = actuator
    spares_first = [*range(actuator_count, module_count), *range(min(actuator_count, module_count))]
    for actuator, count in enumerate(needed):
        missing = count - int(np.sum(serves == actuator))
        free = [m for m in spares_first if serves[m] < 0 and m not in lost]
        for module in free[:missing]:
            serves[module] = actuator
    return serves


def pattern_name(pattern: Sequence[int] | ModeArray) -> str:
    """Short name of a pattern, for instance `SB-DB-N`."""
    return "-".join(Mode(int(mode)).name for mode in pattern)
