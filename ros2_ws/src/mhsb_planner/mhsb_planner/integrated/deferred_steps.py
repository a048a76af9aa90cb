"""Steps that an A* search has found but not priced yet, in buckets by a lower bound on cost.

If a search priced each step as soon as it is found, most prices would be useless. Often a cheaper
way to the same point turns up first, or the path over the step costs more than the best path to the
goal. A deferred step is priced only when the search is about to expand a state whose estimate is as
high. By then a cheaper way to the step's target may be known. Deferring does not change the path
that the search finds.

Source:
    B. Cohen, M. Phillips, M. Likhachev, Planning Single-arm Manipulations with n-Arm Robots, RSS
    2014 (lazy weighted A*).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.records import Record, Records, create_records
from mhsb_model.types import FloatArray, IntArray

NO_STEP = -1
"""Number that stands for no step."""

BUCKET_COUNT, BUCKETS_PER_START_BOUND = 2048, 512
"""Number of buckets, and number of buckets that cover an interval as wide as the lower bound at the
start [-]. The last bucket holds all higher bounds.
"""

MIN_START_BOUND = 1e-9
"""Smallest lower bound at the start from which the ranges of buckets are computed [-]."""

FIRST_BUCKET, STEP_COUNT = 0, 1
"""Indices into `DeferredSteps.counts`: first bucket that may hold steps, and number of steps."""


class DeferredStep(Record):
    """Step to a lattice point that the search has found, but not priced yet."""

    cost: float
    """Lower bound on the cost of the path from the start to the point over this step."""
    following: int
    """Next step of the same bucket; NO_STEP if there is none."""
    origin: int
    """State from which the step leads; NO_STATE stands for the start."""
    row: int
    """Row of the lattice point to which the step leads."""


class DeferredSteps(NamedTuple):
    """Steps that wait to be priced, in buckets by the estimate of the cost of a path over them.

    Attributes:
        records: Steps in the order in which the search found them, shape (room,).
        first: First step of each bucket, shape (BUCKET_COUNT,); NO_STEP if the bucket is empty.
        counts: First bucket that may hold steps, and number of entries of `records` in use, shape
            (2,).
        start_bound: Lower bound on the cost from the start to the goal, shape (1,) [-]. The ranges
            of the buckets follow from it.
    """

    records: Records[DeferredStep]
    first: IntArray
    counts: IntArray
    start_bound: FloatArray


def create_deferred_steps(room: int) -> DeferredSteps:
    """Create empty buckets with room for a number of steps; the caller must set `start_bound`."""
    return DeferredSteps(
        create_records(DeferredStep, room),
        np.full(BUCKET_COUNT, NO_STEP),
        np.zeros(2, dtype=np.int64),
        np.zeros(1),
    )


@kernel(borrows=True, forceinline=True)
def _find_bucket(deferred: DeferredSteps, estimate: float) -> int:
    """Return the number of the bucket for an estimate of the cost of a path to the goal.

    With N = BUCKETS_PER_START_BOUND, bucket k begins at 1 + k/N times the lower bound at the start.
    Smaller estimates belong to bucket 0, all greater ones to the last bucket.
    """
    start = max(deferred.start_bound[0], MIN_START_BOUND)
    bucket = BUCKETS_PER_START_BOUND * (estimate / start - 1.0)
    return int(min(max(bucket, 0.0), BUCKET_COUNT - 1.0))


@kernel(borrows=True, forceinline=True)
def defer_step(
    deferred: DeferredSteps, origin: int, row: int, cost: float, lower_bound: float
) -> None:
    """Put a step at the front of the bucket of its estimate, which is `cost` plus `lower_bound`.

    Args:
        deferred: Steps that wait to be priced, changed in place. Room for a step must be left.
        origin: State from which the step leads; NO_STATE stands for the start.
        row: Row of the lattice point to which the step leads.
        cost: Lower bound on the cost of the path from the start to the point over this step.
        lower_bound: Heuristic: estimated cost from the point to the goal.
    """
    bucket = _find_bucket(deferred, cost + lower_bound)
    number: int = deferred.counts[STEP_COUNT]
    step = deferred.records[number]
    step.cost = cost
    step.following = deferred.first[bucket]
    step.origin = origin
    step.row = row
    deferred.first[bucket] = number
    deferred.counts[FIRST_BUCKET] = min(deferred.counts[FIRST_BUCKET], bucket)
    deferred.counts[STEP_COUNT] = number + 1


@kernel(borrows=True, forceinline=True)
def take_due_step(deferred: DeferredSteps, estimate: float) -> int:
    """Remove a step that must be priced before a state with a given estimate is expanded.

    A step is due if its bucket is that of the given estimate, or an earlier one. Some steps are
    therefore priced although their estimate is slightly higher. The step in the earliest bucket is
    taken; in a bucket, the one that was put there last.

    Args:
        deferred: Steps that wait to be priced, changed in place.
        estimate: Estimate of the first open state; inf if no state is open.

    Returns:
        Number of the step in `deferred.records`; NO_STEP if none is due.
    """
    last, bucket = _find_bucket(deferred, estimate), deferred.counts[FIRST_BUCKET]
    while bucket < last and deferred.first[bucket] == NO_STEP:
        bucket += 1
    deferred.counts[FIRST_BUCKET] = bucket
    number: int = deferred.first[bucket]
    if bucket > last or number == NO_STEP:
        return NO_STEP
    deferred.first[bucket] = deferred.records[number].following
    return number
