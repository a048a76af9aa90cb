"""Work shared among processes: one seam for studies, draws, comparisons and tuning."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from typing import Any, TypeVar

Result = TypeVar("Result")


def processes(
    jobs: int | None = None,
    prepare: Callable[..., object] | None = None,
    given: tuple[Any, ...] = (),
) -> Executor:
    """So many processes, by default one for each processor that this one may use.

    prepare  called with `given` once in each process; what it keeps serves all that is done there
    """
    workers = jobs or len(os.sched_getaffinity(0))
    return ProcessPoolExecutor(
        workers, multiprocessing.get_context("spawn"), initializer=prepare, initargs=given
    )


def results_of(tasks: Iterable[Future[Result]], *, in_order: bool = False) -> Iterator[Result]:
    """Results as they come, or in the order of the tasks; what is left at the end is cancelled."""
    waiting = list(tasks)
    try:
        for task in waiting if in_order else as_completed(waiting):
            yield task.result()
    finally:
        for task in waiting:
            task.cancel()
