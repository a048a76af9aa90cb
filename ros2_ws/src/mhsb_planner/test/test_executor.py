"""Executors on processes, threads of this process and index ranges."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from contextlib import closing

import pytest

from mhsb_planner.errors import RequestError, WorkersLostError
from mhsb_planner.executor import (
    SharedStateExecutor,
    create_executor,
    yield_results,
    yield_results_of_ranges,
)
from mhsb_planner.posture.grid import list_grid_nodes

INTERRUPTED_WHILE_ONE_IMPORTS = """
import sys
import time
from mhsb_model.command_line import run
from mhsb_planner.executor import create_executor, yield_results

if __name__ != "__main__":
    print("importing\\n", end="", flush=True)  # in one piece, as there are two
    time.sleep(1.0)

def study() -> int:
    with create_executor(2) as pool:
        return sum(yield_results([pool.submit(int, 1) for _ in range(2)]))

if __name__ == "__main__":
    sys.exit(run(study, name="study"))
"""
INTERRUPTED_WHILE_ONE_WAITS = """
import sys
import time
from mhsb_model.command_line import run
from mhsb_planner.executor import create_executor, yield_results

def work() -> int:
    time.sleep(1.0)
    print("working", flush=True)
    time.sleep(60.0)
    return 0

def study() -> int:
    with create_executor(2) as pool:
        return sum(yield_results([pool.submit(int, 1), pool.submit(work)]))

if __name__ == "__main__":
    sys.exit(run(study, name="study"))
"""


@pytest.mark.parametrize(
    ("body", "moment"),
    [
        (INTERRUPTED_WHILE_ONE_IMPORTS, "importing"),
        (INTERRUPTED_WHILE_ONE_WAITS, "working"),
    ],
)
def test_an_interrupt_from_the_terminal_ends_all_processes_in_one_sentence(tmp_path, body, moment):
    script = tmp_path / "study.py"
    script.write_text(body)
    command = [sys.executable, "-P", str(script)]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, stdout=pipe, stderr=pipe, text=True, start_new_session=True
    ) as study:
        assert study.stdout is not None
        assert study.stdout.readline() == f"{moment}\n"
        os.killpg(study.pid, signal.SIGINT)
        _, sentence = study.communicate(timeout=50)
    assert sentence == "study: interrupted; no result was kept\n"
    assert study.returncode == 130


@pytest.mark.parametrize("jobs", [None, 1, 3])
def test_ranges_cover_everything_once_and_come_in_order(jobs):
    parts = list(yield_results_of_ranges(lambda begin, end: list(range(begin, end)), 10, 3, jobs))
    assert parts == [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9]]


def test_nothing_to_do_gives_nothing():
    assert list(yield_results_of_ranges(lambda begin, end: 1, 0, 3)) == []


def test_closing_drops_what_has_not_begun():
    begun = []

    def work(begin, end):
        begun.append(begin)
        time.sleep(0.01)

    with closing(yield_results_of_ranges(work, 1000, 1, 1)) as parts:
        next(parts)
    assert len(begun) < 1000


def test_an_error_in_the_work_reaches_the_caller():
    def fail(begin, end):
        raise KeyError(begin)

    with pytest.raises(KeyError):
        list(yield_results_of_ranges(fail, 10, 5))


def test_no_thread_at_all_is_refused():
    with pytest.raises(RequestError, match="jobs must be at least 1"):
        list(yield_results_of_ranges(lambda begin, end: None, 10, 5, 0))


def test_one_process_is_this_one_and_is_prepared_like_any():
    prepared = []

    def prepare(given):
        prepared.append(given)
        return f"made of what was {given}"

    with SharedStateExecutor(1, prepare, "given") as pool:
        tasks = [pool.submit(lambda state: (state, os.getpid())) for _ in range(3)]
        assert list(yield_results(tasks)) == 3 * [("made of what was given", os.getpid())]
    assert prepared == ["given"]


def test_tasks_in_other_processes_find_there_what_was_prepared():
    with SharedStateExecutor(2, dict, {"a": 1}) as pool:
        assert pool.submit(dict.get, "a").result() == 1
        assert pool.submit(dict.get, "b", 7).result() == 7


def test_an_error_in_the_preparation_reaches_the_caller():
    with SharedStateExecutor(2, int, "one") as pool, pytest.raises(ValueError, match="'one'"):
        pool.submit(int.bit_length).result()


def test_a_process_that_is_killed_loses_nothing(caplog):
    with create_executor(2) as pool:
        done = [pool.submit(divmod, number, 3) for number in range(3)]
        assert [task.result() for task in done] == [divmod(n, 3) for n in range(3)]
        slow = [f"sleep 0.2; echo {number}" for number in range(8)]
        tasks = [pool.submit(subprocess.getoutput, each) for each in slow]
        tasks[1].result()
        os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)
        assert [task.result() for task in tasks] == [str(number) for number in range(8)]
    assert "a process has ended before its work was done; it is done again" in caplog.text


def test_a_task_that_always_ends_its_process_is_told_in_one_sentence():
    with create_executor(2) as pool, pytest.raises(WorkersLostError, match="ended by themselves"):
        pool.submit(os._exit, 1).result()


def test_tasks_that_are_cancelled_do_not_keep_an_executor_waiting():
    with create_executor(2) as pool:
        tasks = [pool.submit(time.sleep, 0.2) for _ in range(200)]
        with closing(yield_results(tasks)) as results:
            next(results)
    assert sum(task.cancelled() for task in tasks) > 150


def test_results_come_in_order_where_that_is_asked_for_from_any_number_of_processes():
    with create_executor(2) as pool:
        tasks = [pool.submit(divmod, number, 3) for number in range(7)]
        assert list(yield_results(tasks, in_order=True)) == [divmod(n, 3) for n in range(7)]


def test_an_error_in_another_process_keeps_its_sentence_and_its_data(machine):
    with create_executor(2) as pool:
        task = pool.submit(list_grid_nodes, machine, 99.0)
        with pytest.raises(RequestError, match="spacing must be above 0") as caught:
            task.result()
    assert (caught.value.name, caught.value.value) == ("spacing", 99.0)
