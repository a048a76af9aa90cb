"""Lattice points that a search has reached, and their states.

A state is a lattice point and the mode combination in which it was reached. Points and states get
memory only when the search reaches them, since most lattices have far more points. The first access
to new memory takes longer than the search of a point.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.records import Record, Records, create_records
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.search.open_list import NO_STATE

ROW_COUNT, STATE_COUNT = 0, 1
"""Indices into `LatticePoints.counts`: rows and states in use."""

HASH_FACTOR, HASH_SHIFT = 0x9E3779B1, 20
"""Factor on a lattice point's number, and number of low bits of the product that are dropped. The
remaining bits give the point's slot in the hash table (Knuth, multiplicative hashing).
"""


class LatticePoint(Record):
    """One lattice point that the search has reached. Its fields share a cache line."""

    number: int
    """Number of the point in the lattice."""
    remaining: float
    """Lower bound on the cost from the point to the cheapest goal posture [-]."""
    cost: float
    """Cost of the cheapest state of the point so far; inf if the point has no state [-]."""
    pattern: int
    """Index of the mode combination of the cheapest state."""
    newest: int
    """State of the point that was created last; NO_STATE if there is none."""


class LatticeState(Record):
    """Point and mode combination of one state of the search."""

    row: int
    """Row of the lattice point."""
    pattern: int
    """Index of the mode combination in which the point was reached."""
    sibling: int
    """State of the same point that was created before this state; NO_STATE if there is none."""


class LatticePoints(NamedTuple):
    """Data of the lattice points that the search has reached, and of their states.

    There is one row for each reached point, and one record for each state. A hash table with open
    addressing gives the row of a point.

    Attributes:
        table: Hash table, shape (slots,). An entry is the row of a point, plus 1; 0 if the slot is
            free. The number of slots is a power of 2, at least twice the number of rows.
        counts: Numbers of rows and of states in use, shape (2,).
        records: Number, lower bound and cheapest state of each row's point, shape (rows,).
        indices: Lattice indices of each row's point, shape (rows, n).
        force: Piston forces at each row's point, shape (rows, n) [N]; NaN until they are computed.
        states: Point and mode combination of each state, shape (states,).
        reached: Index of the goal posture at the end of the best path so far, shape (1,).
    """

    table: IntArray
    counts: IntArray
    records: Records[LatticePoint]
    indices: IntArray
    force: FloatArray
    states: Records[LatticeState]
    reached: IntArray


def create_lattice_points(joints: int, rows: int, states: int) -> LatticePoints:
    """Create the data of reached lattice points for a search that has not begun.

    Args:
        joints: Number of joints n.
        rows: Number of lattice points for which memory is allocated.
        states: Number of states for which memory is allocated.

    Returns:
        Data without any row or state in use.
    """
    records = create_records(LatticePoint, rows)
    return LatticePoints(
        table=_create_table(records, 0),
        counts=np.zeros(2, dtype=np.int64),
        records=records,
        indices=np.empty((rows, joints), dtype=np.int64),
        force=np.empty((rows, joints)),
        states=create_records(LatticeState, states),
        reached=np.full(1, NO_STATE),
    )


def _create_table(points: Records[LatticePoint], used: int) -> IntArray:
    """Create a hash table with the rows of lattice points.

    Args:
        points: Lattice point of each row. The table gets slots for all of them.
        used: Number of rows in use; only these are entered.

    Returns:
        The table (`LatticePoints.table`): row plus 1 for each point entered, 0 in free slots.
    """
    table = np.zeros(2 << len(points).bit_length(), dtype=np.int64)
    _fill_table(table, points, used)
    return table


def with_more_rows(known: LatticePoints) -> LatticePoints:
    """Return a copy of the data of reached lattice points with room for twice as many rows.

    Args:
        known: Data of the lattice points that the search has reached.

    Returns:
        The data. Fields that do not grow are shared with `known`.
    """
    records = with_more_room(known.records)
    return known._replace(
        table=_create_table(records, int(known.counts[ROW_COUNT])),
        records=records,
        indices=with_more_room(known.indices),
        force=with_more_room(known.force),
    )


def with_more_room(array: Any) -> Any:
    """Return a copy of an array with twice as many rows; the new rows are undefined."""
    longer = np.empty((2 * len(array), *array.shape[1:]), array.dtype)
    longer[: len(array)] = array
    return longer


@kernel(borrows=True, forceinline=True)
def find_slot(table: IntArray, points: Records[LatticePoint], number: int) -> int:
    """Return the slot of a lattice point in the hash table, or the free slot where it belongs.

    Args:
        table: Hash table whose entries are rows plus 1; at least one slot must be free.
        points: Lattice point of each row.
        number: Number of the lattice point.
    """
    last = len(table) - 1
    slot = ((number * HASH_FACTOR) >> HASH_SHIFT) & last
    row: int = table[slot] - 1
    while row >= 0 and points[row].number != number:
        slot = (slot + 1) & last
        row = table[slot] - 1
    return slot


@kernel(borrows=True)
def _fill_table(table: IntArray, points: Records[LatticePoint], rows: int) -> None:
    """Enter the rows of lattice points into an empty hash table.

    Args:
        table: Hash table, written in place.
        points: Lattice point of each row.
        rows: Number of rows in use.
    """
    for row in range(rows):
        table[find_slot(table, points, points[row].number)] = row + 1


@kernel(borrows=True, forceinline=True)
def find_state(known: LatticePoints, row: int, pattern: int) -> int:
    """Return the state of a lattice point in a mode combination; create it if it is missing.

    Args:
        known: Data of the lattice points that the search has reached, changed in place. Room for a
            state must be left.
        row: Row of the point.
        pattern: Index of the mode combination.

    Returns:
        Number of the state.
    """
    point = known.records[row]
    state: int = point.newest
    while state != NO_STATE and known.states[state].pattern != pattern:
        state = known.states[state].sibling
    if state == NO_STATE:
        state = known.counts[STATE_COUNT]
        known.counts[STATE_COUNT] += 1
        created = known.states[state]
        created.row = row
        created.pattern = pattern
        created.sibling = point.newest
        point.newest = state
    return state
