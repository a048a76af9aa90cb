"""Work shared out: the one place that makes executors, which all large work goes through.

Whole runs go to processes. Index ranges go to threads: kernels release the interpreter while they
run. Both go to a cluster where one is given. No result depends on who works, or on how many.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor, as_completed
from contextlib import AbstractContextManager
from typing import Any, Concatenate, Generic, ParamSpec, TypeAlias, TypeVar, cast

from mhsb_planner.cluster import Cluster
from mhsb_planner.errors import RequestError
from mhsb_planner.restarting_processes import RestartingProcesses
from mhsb_planner.tasks import Preparation, perform

State = TypeVar("State")
P = ParamSpec("P")
Result = TypeVar("Result")

Jobs: TypeAlias = int | Cluster | None
"""So many processes or threads of this machine, or the workers of a cluster; None: one for each
processor that this process may use."""


def processes(jobs: Jobs = None) -> Executor:
    """Who does work(*args), told by submit(work, *args); one process is this one itself.

    Processes that are killed are replaced, and what they had not done is done again. Raises
    RequestError where jobs is below 1, ClusterError.
    """
    return _executor(jobs, None)


class Prepared(AbstractContextManager["Prepared[State]"], Generic[State]):
    """The same for tasks that share a state: submit(work, *args) does work(state, *args).

    The state is make(*given): made once in each process, or thread of a cluster's worker, for all
    that is done there, and never used by two tasks at a time.
    """

    def __init__(self, jobs: Jobs, make: Callable[..., State], *given: Any) -> None:
        self._pool = _executor(jobs, Preparation(make, given))

    def submit(
        self, work: Callable[Concatenate[State, P], Result], *args: P.args, **named: P.kwargs
    ) -> Future[Result]:
        """A task; its future is one of `concurrent.futures`."""
        return self._pool.submit(cast(Callable[..., Result], work), *args, **named)

    def __exit__(self, *failure: object) -> None:
        self._pool.shutdown()


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
    work: Callable[[int, int], Result], total: int, size: int, jobs: Jobs = None
) -> Generator[Result, None, None]:
    """Results of work(begin, end) over ranges of `size` that cover 0 … total, in their order.

    In threads; by the workers of a cluster, to which `work` is sent, and whose results come from
    there. Closing the generator drops what has not begun. Raises RequestError where jobs is below
    1, ClusterError.
    """
    ranges = [(begin, min(begin + size, total)) for begin in range(0, total, size)]
    if isinstance(jobs, Cluster):
        with Prepared(jobs, _itself, work) as pool:
            tasks = [pool.submit(_called, begin, end) for begin, end in ranges]
            yield from results_of(tasks, in_order=True)
    else:
        with threads(jobs) as executor:
            tasks = [executor.submit(work, begin, end) for begin, end in ranges]
            yield from results_of(tasks, in_order=True)


def _executor(jobs: Jobs, preparation: Preparation | None) -> Executor:
    if isinstance(jobs, Cluster):
        return jobs.executor(preparation)
    workers = _workers(jobs)
    if workers == 1:
        return _ThisProcess(preparation)
    return RestartingProcesses(workers, preparation)


class _ThisProcess(ThreadPoolExecutor):
    """One thread."""

    def __init__(self, preparation: Preparation | None) -> None:
        super().__init__(1)
        self._preparation = preparation

    def submit(self, work: Callable[..., Result], /, *args: Any, **named: Any) -> Future[Result]:
        return super().submit(perform, self._preparation, work, *args, **named)


def _workers(jobs: int | None) -> int:
    if jobs is not None and jobs < 1:
        raise RequestError("jobs", jobs, "must be at least 1")
    return jobs or len(os.sched_getaffinity(0))


def _itself(work: Callable[[int, int], Result]) -> Callable[[int, int], Result]:
    return work


def _called(work: Callable[[int, int], Result], begin: int, end: int) -> Result:
    return work(begin, end)
