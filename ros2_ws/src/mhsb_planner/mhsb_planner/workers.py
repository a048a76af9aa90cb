"""Work shared out: the one place that makes executors, which all large work goes through.

Whole runs go to processes. Index ranges go to threads: kernels release the interpreter while they
run. No result depends on the number of workers; to send work elsewhere, return another
`concurrent.futures.Executor` here.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import (
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from typing import Any, TypeVar

from mhsb_planner.errors import RequestError

Result = TypeVar("Result")


def processes(
    jobs: int | None = None,
    prepare: Callable[..., object] | None = None,
    given: tuple[Any, ...] = (),
) -> Executor:
    """So many processes, by default one for each processor that this one may use.

    One is this process itself.

    prepare  called with `given` once in each process; what it keeps serves all that is done there.
    Raises RequestError where jobs is below 1.
    """
    workers = _workers(jobs)
    if workers == 1:
        return ThreadPoolExecutor(1, initializer=prepare, initargs=given)
    return ProcessPoolExecutor(
        workers, multiprocessing.get_context("spawn"), initializer=prepare, initargs=given
    )


def threads(jobs: int | None = None) -> Executor:
    """So many threads, by default one for each processor; raises RequestError below 1."""
    return ThreadPoolExecutor(_workers(jobs))


def results_of(tasks: Iterable[Future[Result]], *, in_order: bool = False) -> Iterator[Result]:
    """Results as they come, or in the order of the tasks; what is left at the end is cancelled."""
    waiting = list(tasks)
    try:
        for task in waiting if in_order else as_completed(waiting):
            yield task.result()
    finally:
        for task in waiting:
            task.cancel()


def over_ranges(
    work: Callable[[int, int], Result], total: int, size: int, jobs: int | None = None
) -> Generator[Result, None, None]:
    """Results of work(begin, end) over ranges of `size` that cover 0 … total, in their order.

    In `threads(jobs)`. Closing the generator drops what has not begun. Raises RequestError where
    jobs is below 1.
    """
    with threads(jobs) as pool:
        tasks = [
            pool.submit(work, begin, min(begin + size, total)) for begin in range(0, total, size)
        ]
        yield from results_of(tasks, in_order=True)


def _workers(jobs: int | None) -> int:
    if jobs is not None and jobs < 1:
        raise RequestError("jobs", jobs, "must be at least 1")
    return jobs or len(os.sched_getaffinity(0))
