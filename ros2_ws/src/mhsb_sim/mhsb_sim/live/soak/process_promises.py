"""Promises about the processes: they live, they end when asked, they do not grow."""

from __future__ import annotations

import signal

import numpy as np

from mhsb_model.trajectory import SECOND_NS
from mhsb_sim.live.soak.events import Events
from mhsb_sim.live.soak.kept import Kept

CLEAN = (signal.SIGINT, signal.SIGTERM)
LONGEST_END = 2.0
"""Time for a clean end [s]."""

WARM_NS = 180 * SECOND_NS
"""After this time a process needs no more memory than it has."""

LARGEST_GROWTH = 5_000_000  # bytes

KEPT_FOR = 10
"""Looks, a second apart, in which memory is not given back: a search of a second takes 15 MB."""


def nobody_dies(events: Events) -> Kept:
    """No process ends by itself."""
    broken = tuple(
        f"{life.name} ended by itself with exit code {life.exit_code}"
        for life in events.lives
        if life.signal is None
    )
    return Kept(len(events.lives), broken)


def no_tracebacks(events: Events) -> Kept:
    """No process prints a traceback."""
    broken = tuple(
        f"{life.name}: {life.traceback}" for life in events.lives if life.traceback is not None
    )
    return Kept(len(events.lives), broken)


def clean_ends(events: Events) -> Kept:
    """SIGINT and SIGTERM end a process within 2 s, with exit code 0."""
    asked = [life for life in events.lives if life.signal in CLEAN]
    broken = tuple(
        f"{life.name} ended after {life.end_s:.1f} s with exit code {life.exit_code}"
        for life in asked
        if life.exit_code != 0 or life.end_s > LONGEST_END
    )
    return Kept(len(asked), broken)


def memory_is_flat(events: Events) -> Kept:
    """What a process that is three minutes old keeps grows by less than 5 MB."""
    broken, tested = [], 0
    for life in events.lives:
        later = [size for time_ns, size in life.memory if time_ns > life.ready_ns + WARM_NS]
        if len(later) < KEPT_FOR:
            continue
        tested += 1
        kept = np.lib.stride_tricks.sliding_window_view(later, KEPT_FOR).min(axis=1)
        if (growth := kept.max() - kept[0]) > LARGEST_GROWTH:
            broken.append(f"{life.name} grew by {1e-6 * growth:.1f} MB")
    return Kept(tested, tuple(broken))
