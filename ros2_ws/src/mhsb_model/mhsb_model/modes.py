"""Hydraulic operating modes, mode combinations and the budget of booster modules.

A mode is defined by its row in `MODE_PROPERTIES` and by the number of booster modules that the
machine gives it. Mode codes are names; their order has no meaning.

A mode combination (pattern) has one mode for each actuator. It occupies the sum of
`modules_per_mode[mode]` over the actuators, at most the number of modules fitted. For example, four
modules allow 23 combinations of three joints (paper, Section 3).
"""

import itertools
from collections.abc import Collection, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from mhsb_model.types import IntArray, ModeArray, frozen


class Mode(IntEnum):
    """Operating mode of one actuator."""

    N = 0
    """Normal: the main pump feeds the actuator through the check valve."""
    DB = 1
    """Decoupled boost: the actuator's own servo pump raises its supply pressure."""
    SB = 2
    """Shared boost: the flows of several servo pumps are summed on the rail."""


class ModeProperties(NamedTuple):
    """Properties that a mode gives to an actuator.

    Attributes:
        boosted: Whether servo pumps raise the supply pressure, so that booster modules are needed.
        on_rail: Whether the actuator's line is connected to the rail. All lines on the rail have
            the same pressure.
        rank: Strength; a mode can do everything that a mode of lower rank can do.
    """

    boosted: bool
    on_rail: bool
    rank: int


MODE_PROPERTIES = {
    Mode.N: ModeProperties(boosted=False, on_rail=False, rank=0),
    Mode.DB: ModeProperties(boosted=True, on_rail=False, rank=1),
    Mode.SB: ModeProperties(boosted=True, on_rail=True, rank=2),
}
"""Properties of each mode."""

MODE_COUNT = len(MODE_PROPERTIES)

# Columns of the table, indexed by mode code, as arrays for kernels.
BOOSTED_MODES = frozen(np.array([MODE_PROPERTIES[mode].boosted for mode in Mode]))
"""Whether each mode is boosted, indexed by its code."""
RAIL_MODES = frozen(np.array([MODE_PROPERTIES[mode].on_rail for mode in Mode]))
"""Whether each mode is on the rail, indexed by its code."""
MODE_RANKS = frozen(np.array([MODE_PROPERTIES[mode].rank for mode in Mode]))
"""Rank of each mode, indexed by its code."""

MODES_BY_RANK = sorted(Mode, key=lambda mode: MODE_PROPERTIES[mode].rank)
"""Modes from the weakest to the strongest."""


def choose_stronger_modes(one: ModeArray, other: ModeArray) -> ModeArray:
    """Return, for each actuator, the stronger of its modes in two mode combinations.

    The order from the weakest to the strongest mode is N, DB, SB.

    Args:
        one: Mode codes, shape (n,) or broadcastable.
        other: Mode codes to compare with, shape (n,) or broadcastable.

    Returns:
        Modes in a new array, uint8 of the broadcast shape.
    """
    return np.where(MODE_RANKS[other] > MODE_RANKS[one], other, one)


def find_strongest_modes(modes: ModeArray) -> ModeArray:
    """Return the strongest mode that occurs in each mode combination.

    The order from the weakest to the strongest mode is N, DB, SB.

    Args:
        modes: Mode combinations with one mode per actuator, uint8 of shape (…, n).

    Returns:
        Modes, uint8 of shape (…).
    """
    return np.array(MODES_BY_RANK, dtype=np.uint8)[MODE_RANKS[modes].max(axis=-1)]


def any_boosted(modes: ModeArray) -> np.ndarray:
    """Return whether any actuator is boosted in each mode combination.

    Args:
        modes: Mode combinations, uint8 of shape (…, n).

    Returns:
        Boolean array of shape (…).
    """
    return np.any(BOOSTED_MODES[modes], axis=-1)


def count_modules(pattern: Sequence[int] | ModeArray, modules_per_mode: Sequence[int]) -> int:
    """Return the number of booster modules that a mode combination occupies.

    Args:
        pattern: Mode of each actuator.
        modules_per_mode: Modules that one actuator occupies in mode N, DB and SB, in this order.
    """
    return sum(modules_per_mode[mode] for mode in pattern)


def list_mode_patterns(
    actuator_count: int, module_count: int, modules_per_mode: Sequence[int]
) -> ModeArray:
    """List all mode combinations that the booster modules of a machine allow.

    Args:
        actuator_count: Number of actuators n.
        module_count: Number of booster modules fitted.
        modules_per_mode: Modules that one actuator occupies in mode N, DB and SB, in this order.

    Returns:
        Mode combinations, uint8 of shape (combinations, n), read-only. Row 0 is all N; the rows are
        in lexicographic order of the mode codes 0 N, 1 DB, 2 SB. So the index of a combination is
        always the same for the same arguments.
    """
    allowed = [
        pattern
        for pattern in itertools.product(sorted(Mode), repeat=actuator_count)
        if count_modules(pattern, modules_per_mode) <= module_count
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
    """Assign booster modules to the actuators of a mode combination.

    Module j belongs to actuator j. Modules beyond the number of actuators are spare. First each
    boosted actuator gets its own module, unless this module is lost. Then the actuators, in their
    order, get as many further modules as their modes need. Spare modules are taken first, then idle
    modules that belong to other actuators, both in the order of their indices. Lost modules are
    never used.

    Args:
        pattern: Mode of each actuator.
        module_count: Number of booster modules fitted.
        modules_per_mode: Modules that one actuator needs in mode N, DB and SB, in this order.
        lost: Indices, from 0, of modules that have failed.

    Returns:
        Index of the actuator that each module serves, int64 of shape (module_count,); −1 if the
        module is idle.

    Raises:
        ValueError: The mode combination needs more modules than are left.
    """
    actuator_count = len(pattern)
    needed = [modules_per_mode[mode] for mode in pattern]
    if sum(needed) > module_count - len(lost):
        raise ValueError(
            f"mode pattern {format_pattern(pattern)} needs {sum(needed)} modules, "
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


def format_pattern(pattern: Sequence[int] | ModeArray) -> str:
    """Return the short name of a mode combination, for instance `SB-DB-N`."""
    return "-".join(Mode(int(mode)).name for mode in pattern)
