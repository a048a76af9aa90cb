"""Work over index ranges, in threads: kernels release the interpreter while they run."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from mhsb_planner.errors import RequestError

Result = TypeVar("Result")


def over_ranges(
    work: Callable[[int, int], Result], total: int, size: int, jobs: int | None = None
) -> Generator[Result, None, None]:
    """Results of work(begin, end) over ranges of `size` that cover 0 … total, in their order.

    jobs is the number of threads, by default one for each processor this process may use.
    Closing the generator drops what has not begun. Raises RequestError where jobs is below 1.
    """
    if jobs is not None and jobs < 1:
        raise RequestError("jobs", jobs, "must be at least 1")
    with ThreadPoolExecutor(jobs or len(os.sched_getaffinity(0))) as pool:
        tasks = [
            pool.submit(work, begin, min(begin + size, total)) for begin in range(0, total, size)
        ]
        try:
            for task in tasks:
                yield task.result()
        finally:
            for task in tasks:
                task.cancel()
