"""Work shared out."""

import os
import time
from contextlib import closing

import pytest

from mhsb_planner.errors import RequestError
from mhsb_planner.posture.grid import grid_nodes
from mhsb_planner.workers import over_ranges, processes, results_of


@pytest.mark.parametrize("jobs", [None, 1, 3])
def test_ranges_cover_everything_once_and_come_in_order(jobs):
    parts = list(over_ranges(lambda begin, end: list(range(begin, end)), 10, 3, jobs))
    assert parts == [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9]]


def test_nothing_to_do_gives_nothing():
    assert list(over_ranges(lambda begin, end: 1, 0, 3)) == []


def test_closing_drops_what_has_not_begun():
    begun = []

    def work(begin, end):
        begun.append(begin)
        time.sleep(0.01)

    with closing(over_ranges(work, 1000, 1, 1)) as parts:
        next(parts)
    assert len(begun) < 1000


def test_an_error_in_the_work_reaches_the_caller():
    def fail(begin, end):
        raise KeyError(begin)

    with pytest.raises(KeyError):
        list(over_ranges(fail, 10, 5))


def test_no_thread_at_all_is_refused():
    with pytest.raises(RequestError, match="jobs must be at least 1"):
        list(over_ranges(lambda begin, end: None, 10, 5, 0))


def test_one_process_is_this_one_and_is_prepared_like_any():
    prepared = []
    with processes(1, prepared.append, ("given",)) as pool:
        assert list(results_of([pool.submit(os.getpid)])) == [os.getpid()]
    assert prepared == ["given"]


def test_results_come_in_order_where_that_is_asked_for_from_any_number_of_processes():
    with processes(2) as pool:
        tasks = [pool.submit(divmod, number, 3) for number in range(7)]
        assert list(results_of(tasks, in_order=True)) == [divmod(n, 3) for n in range(7)]


def test_an_error_in_another_process_keeps_its_sentence_and_its_data(machine):
    with processes(2) as pool:
        task = pool.submit(grid_nodes, machine, 99.0)
        with pytest.raises(RequestError, match="spacing must be above 0") as caught:
            task.result()
    assert (caught.value.name, caught.value.value) == ("spacing", 99.0)
