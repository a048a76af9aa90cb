"""Promises about the processes: they live, end when asked, and do not grow."""

from __future__ import annotations

import signal

import numpy as np
from tests.soak.events import PLANNER, ActionKind, Events
from tests.soak.kept import PromiseResult

from mhsb_model.trajectory import SECOND_NS

CLEAN = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that must end a process cleanly."""
LONGEST_END = 2.0
"""Largest time for a clean end [s]."""

WARM_NS = 240 * SECOND_NS
"""Age from which on a process must not need more memory [ns].

A planner grew by 1.8 MB from its first to its fourth minute, while goals and zones filled its heap.
"""

LARGEST_GROWTH = 5_000_000
"""Largest growth of the memory that a process keeps [bytes].

Without a leak a planner grew by up to 3.0 MB in four to eight minutes after `WARM_NS`.
"""

KEPT_FOR = 10
"""Number of memory readings, a second apart, for which memory must be held to count as kept. A
search of a second takes 15 MB for a while.
"""


def check_no_process_ends(events: Events) -> PromiseResult:
    """Check that no process ends by itself.

    Args:
        events: Actions and processes of the soak.

    Returns:
        The result; each process is one case.
    """
    broken = tuple(
        f"{life.name} ended by itself with exit code {life.exit_code}"
        for life in events.lives
        if life.signal is None
    )
    return PromiseResult(len(events.lives), broken)


def check_starts(events: Events) -> PromiseResult:
    """Check that every planner answers a goal after it has become ready.

    Args:
        events: Actions and processes of the soak.

    Returns:
        The result; each start of a planner is one case.
    """
    starts = [deed for deed in events.actions_of(ActionKind.START) if deed.node == PLANNER]
    broken = tuple(
        f"planner {number} of {len(starts)} was ready, but could not be reached over ROS"
        for number, deed in enumerate(starts, 1)
        if not deed.done
    )
    return PromiseResult(len(starts), broken)


def check_no_tracebacks(events: Events) -> PromiseResult:
    """Check that no process prints a traceback.

    Args:
        events: Actions and processes of the soak.

    Returns:
        The result; each process is one case.
    """
    broken = tuple(
        f"{life.name}: {life.traceback}" for life in events.lives if life.traceback is not None
    )
    return PromiseResult(len(events.lives), broken)


def check_invalid_settings_refused(events: Events) -> PromiseResult:
    """Check that a running node refuses a setting of unknown type, or one that deletes a parameter.

    Args:
        events: Actions and processes of the soak.

    Returns:
        The result; each such setting is one case.
    """
    asked = [deed for deed in events.actions if deed.kind is ActionKind.STRANGE]
    broken = tuple(
        f"{deed.node} did not refuse a value of type {deed.value}"
        for deed in asked
        if not deed.done
    )
    return PromiseResult(len(asked), broken)


def check_clean_ends(events: Events) -> PromiseResult:
    """Check that SIGINT, SIGTERM and SIGHUP end a process within 2 s, with exit code 0.

    Args:
        events: Actions and processes of the soak.

    Returns:
        The result; each process that got such a signal is one case.
    """
    asked = [life for life in events.lives if life.signal in CLEAN]
    broken = tuple(
        f"{life.name} ended after {life.end_s:.1f} s with exit code {life.exit_code}"
        for life in asked
        if life.exit_code != 0 or life.end_s > LONGEST_END
    )
    return PromiseResult(len(asked), broken)


def check_memory_growth(events: Events) -> PromiseResult:
    """Check that the memory that a process keeps grows by less than 5 MB after four minutes.

    Memory counts as kept if it is not given back for ten readings, a second apart.

    Args:
        events: Actions and processes of the soak.

    Returns:
        The result; each process that is old enough is one case.
    """
    broken, tested = [], 0
    for life in events.lives:
        later = [size for time_ns, size in life.memory if time_ns > life.ready_ns + WARM_NS]
        if len(later) < KEPT_FOR:
            continue
        tested += 1
        kept = np.lib.stride_tricks.sliding_window_view(later, KEPT_FOR).min(axis=1)
        if (growth := kept.max() - kept[0]) > LARGEST_GROWTH:
            broken.append(f"{life.name} grew by {1e-6 * growth:.1f} MB")
    return PromiseResult(tested, tuple(broken))
