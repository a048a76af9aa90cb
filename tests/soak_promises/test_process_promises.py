"""Promises about processes, each broken on purpose."""

from __future__ import annotations

import signal
from dataclasses import replace

import numpy as np
from tests.soak import process_promises
from tests.soak.events import PLANNER, SIM, ActionKind, ActionRecord


def test_a_process_that_ends_by_itself_is_told(spoilt, make):
    dead = make.life(PLANNER, 1, 0.5, 12.0, signal=None, exit_code=1)
    kept = process_promises.check_no_process_ends(spoilt(lives=(dead,)))
    assert kept.violations == ("planner-1 ended by itself with exit code 1",)


def test_a_planner_that_is_ready_and_cannot_be_reached_is_told(spoilt, make):
    starts = (
        ActionRecord(ActionKind.START, node, make.ns(second), make.ns(second), done=done)
        for second, (node, done) in enumerate([(SIM, True), (PLANNER, True), (PLANNER, False)])
    )
    kept = process_promises.check_starts(spoilt(actions=tuple(starts)))
    assert kept.tested == 2
    assert kept.violations == ("planner 2 of 2 was ready, but could not be reached over ROS",)


def test_a_traceback_is_told_with_its_last_line(spoilt, make):
    life = make.life(PLANNER, 2, 0.5, 12.0, traceback="ValueError: no")
    kept = process_promises.check_no_tracebacks(spoilt(lives=(life,)))
    assert kept.violations == ("planner-2: ValueError: no",)


def test_an_end_with_a_code_or_after_long_is_told_and_a_kill_is_none(spoilt, make):
    lives = (
        make.life(PLANNER, 1, 0.5, 12.0, exit_code=-2),
        make.life(PLANNER, 2, 0.5, 12.0, end_s=2.1),
        make.life(PLANNER, 3, 0.5, 12.0, signal=signal.SIGKILL, exit_code=None, end_s=9.0),
    )
    kept = process_promises.check_clean_ends(spoilt(lives=lives))
    assert kept.tested == 2
    assert len(kept.violations) == 2


def test_a_strange_setting_that_is_taken_or_not_answered_is_told(spoilt, make):
    taken, refused = (
        ActionRecord(ActionKind.STRANGE, SIM, make.ns(1), make.ns(1), 99, done)
        for done in (False, True)
    )
    deeds = taken, refused
    kept = process_promises.check_invalid_settings_refused(spoilt(actions=deeds))
    assert (kept.tested, kept.violations) == (2, ("sim did not refuse a value of type 99",))


def with_memory(make, sizes):
    memory = tuple((make.ns(second), size) for second, size in enumerate(sizes))
    return replace(make.life(PLANNER, 1, 0.0, 360.0), memory=memory)


def test_growth_counts_after_four_minutes_only(spoilt, make):
    def life(growth_from):
        sizes = [200_000_000 + max(0, second - growth_from) * 100_000 for second in range(360)]
        return with_memory(make, sizes)

    assert process_promises.check_memory_growth(spoilt(lives=(life(320),))).is_kept
    kept = process_promises.check_memory_growth(spoilt(lives=(life(0),)))
    assert kept.violations == ("planner-1 grew by 10.9 MB",)


def test_memory_that_is_given_back_at_once_is_no_growth(spoilt, make):
    def life(lasting):
        sizes = np.full(360, 200_000_000)
        sizes[280 : 280 + lasting] += 20_000_000
        return with_memory(make, sizes.tolist())

    assert process_promises.check_memory_growth(spoilt(lives=(life(3),))).is_kept
    assert not process_promises.check_memory_growth(spoilt(lives=(life(30),))).is_kept
