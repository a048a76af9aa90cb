"""Promises about processes, each broken on purpose."""

from __future__ import annotations

import signal
from dataclasses import replace

import numpy as np

from mhsb_sim.live.soak import process_promises
from mhsb_sim.live.soak.events import PLANNER


def test_a_process_that_ends_by_itself_is_told(spoilt, make):
    dead = make.life(PLANNER, 1, 0.5, 12.0, signal=None, exit_code=1)
    kept = process_promises.nobody_dies(spoilt(lives=(dead,)))
    assert kept.broken == ("planner-1 ended by itself with exit code 1",)


def test_a_traceback_is_told_with_its_last_line(spoilt, make):
    life = make.life(PLANNER, 2, 0.5, 12.0, traceback="ValueError: no")
    kept = process_promises.no_tracebacks(spoilt(lives=(life,)))
    assert kept.broken == ("planner-2: ValueError: no",)


def test_an_end_with_a_code_or_after_long_is_told_and_a_kill_is_none(spoilt, make):
    lives = (
        make.life(PLANNER, 1, 0.5, 12.0, exit_code=-2),
        make.life(PLANNER, 2, 0.5, 12.0, end_s=2.1),
        make.life(PLANNER, 3, 0.5, 12.0, signal=signal.SIGKILL, exit_code=None, end_s=9.0),
    )
    kept = process_promises.clean_ends(spoilt(lives=lives))
    assert kept.tested == 2
    assert len(kept.broken) == 2


def with_memory(make, sizes):
    memory = tuple((make.ns(second), size) for second, size in enumerate(sizes))
    return replace(make.life(PLANNER, 1, 0.0, 300.0), memory=memory)


def test_growth_counts_after_three_minutes_only(spoilt, make):
    def life(growth_from):
        sizes = [200_000_000 + max(0, second - growth_from) * 100_000 for second in range(300)]
        return with_memory(make, sizes)

    assert process_promises.memory_is_flat(spoilt(lives=(life(260),))).held
    kept = process_promises.memory_is_flat(spoilt(lives=(life(0),)))
    assert kept.broken == ("planner-1 grew by 10.9 MB",)


def test_memory_that_is_given_back_at_once_is_no_growth(spoilt, make):
    def life(lasting):
        sizes = np.full(300, 200_000_000)
        sizes[220 : 220 + lasting] += 20_000_000
        return with_memory(make, sizes.tolist())

    assert process_promises.memory_is_flat(spoilt(lives=(life(3),))).held
    assert not process_promises.memory_is_flat(spoilt(lives=(life(30),))).held
