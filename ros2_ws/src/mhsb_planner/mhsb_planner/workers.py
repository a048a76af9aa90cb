"""Executors for all large work: processes, threads or a cluster.

Whole runs go to processes. Index ranges go to threads, because kernels release the interpreter
lock. Both go to a cluster if one is given. Results do not depend on who does the work, or on how
many do.
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
from mhsb_planner.tasks import SharedStateRecipe, perform

State = TypeVar("State")
P = ParamSpec("P")
Result = TypeVar("Result")

Jobs: TypeAlias = int | Cluster | None
"""Number of processes or threads on this machine, or a cluster. None: one for each processor that
this process may use.
"""


def processes(jobs: Jobs = None) -> Executor:
    """Create an executor on processes or a cluster.

    With one job, the tasks run in a thread of the calling process.

    Processes that end by themselves are replaced, and their unfinished tasks are done again.

    Args:
        jobs: Number of processes, or a cluster; None: one process for each processor.

    Returns:
        The executor, to be used as a context manager.

    Raises:
        RequestError: `jobs` is below 1.
        ClusterError: The cluster does not answer.
    """
    return _create_executor(jobs, None)


class Prepared(AbstractContextManager["Prepared[State]"], Generic[State]):
    """Context manager that does tasks with a shared state, in processes or on a cluster.

    The state is make(*given). It is made once in each process, or in each thread of a cluster's
    worker. No two tasks use one state at a time.
    """

    def __init__(self, jobs: Jobs, make: Callable[..., State], *given: Any) -> None:
        """Create the executor; the state is made when the first task begins.

        Args:
            jobs: Number of processes, or a cluster; None: one process for each processor.
            make: Function that makes the state.
            given: Arguments of `make`.

        Raises:
            RequestError: `jobs` is below 1.
            ClusterError: The cluster does not answer.
        """
        self._pool = _create_executor(jobs, SharedStateRecipe(make, given))

    def submit(
        self, work: Callable[Concatenate[State, P], Result], *args: P.args, **named: P.kwargs
    ) -> Future[Result]:
        """Submit a task work(state, *args, **named).

        Args:
            work: Function that can be pickled.
            args: Positional arguments of `work` after the state.
            named: Named arguments of `work`.

        Returns:
            Future of the result.
        """
        return self._pool.submit(cast(Callable[..., Result], work), *args, **named)

    def __exit__(self, *failure: object) -> None:
        self._pool.shutdown()


def create_thread_executor(jobs: int | None = None) -> Executor:
    """Create a pool of threads.

    Args:
        jobs: Number of threads; None: one for each processor.

    Returns:
        The executor.

    Raises:
        RequestError: `jobs` is below 1.
    """
    return ThreadPoolExecutor(_worker_count(jobs))


def results_of(tasks: Iterable[Future[Result]], *, in_order: bool = False) -> Iterator[Result]:
    """Yield the results of tasks.

    If the generator ends early, by an error or by the consumer, tasks that have not begun are
    cancelled.

    Args:
        tasks: Futures.
        in_order: Whether to yield results in the order of `tasks`; otherwise they come as the tasks
            are completed.

    Yields:
        Results of the tasks. The error of a failed task is raised in its turn.
    """
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
    """Call a function for index ranges that cover 0 … total, and yield the results in order.

    The calls run in threads. On a cluster the function is sent to the workers once. Closing the
    generator cancels calls that have not begun.

    Args:
        work: Function work(begin, end) of a range, which does not contain `end`.
        total: Number of indices.
        size: Number of indices in a range; the last range may be shorter.
        jobs: Number of threads, or a cluster; None: one thread for each processor.

    Yields:
        Result of each range, in the order of the ranges.

    Raises:
        RequestError: `jobs` is below 1.
        ClusterError: The cluster does not answer.
    """
    ranges = [(begin, min(begin + size, total)) for begin in range(0, total, size)]
    if isinstance(jobs, Cluster):
        with Prepared(jobs, _identity_function, work) as pool:
            tasks = [pool.submit(_call_shared_function, begin, end) for begin, end in ranges]
            yield from results_of(tasks, in_order=True)
    else:
        with create_thread_executor(jobs) as executor:
            tasks = [executor.submit(work, begin, end) for begin, end in ranges]
            yield from results_of(tasks, in_order=True)


def _create_executor(jobs: Jobs, preparation: SharedStateRecipe | None) -> Executor:
    """Create the executor for the given jobs and shared state.

    Args:
        jobs: Number of processes, or a cluster; None: one process for each processor.
        preparation: Recipe of the state that tasks share; None: they share none.

    Returns:
        An executor on the cluster, on processes, or on one thread if there is one job.
    """
    if isinstance(jobs, Cluster):
        return jobs.executor(preparation)
    workers = _worker_count(jobs)
    if workers == 1:
        return _SingleThreadExecutor(preparation)
    return RestartingProcesses(workers, preparation)


class _SingleThreadExecutor(ThreadPoolExecutor):
    """Executor on one thread of this process."""

    def __init__(self, preparation: SharedStateRecipe | None) -> None:
        """Create the thread.

        Args:
            preparation: Recipe of the state that tasks share; None: they share none.
        """
        super().__init__(1)
        self._preparation = preparation

    def submit(self, work: Callable[..., Result], /, *args: Any, **named: Any) -> Future[Result]:
        """Submit the task work(state, *args, **named).

        If the tasks share no state, it is work(*args, **named).

        Args:
            work: Function to call.
            args: Positional arguments of `work` after the state.
            named: Named arguments of `work`.

        Returns:
            Future of the result.
        """
        return super().submit(perform, self._preparation, work, *args, **named)


def _worker_count(jobs: int | None) -> int:
    """Return the number of workers: the requested one, or one for each usable processor.

    Args:
        jobs: Requested number; None: default.

    Returns:
        The number.

    Raises:
        RequestError: The requested number is below 1.
    """
    if jobs is not None and jobs < 1:
        raise RequestError("jobs", jobs, "must be at least 1")
    return jobs or len(os.sched_getaffinity(0))


def _identity_function(work: Callable[[int, int], Result]) -> Callable[[int, int], Result]:
    """Return the argument; as a recipe, this makes the function to call the shared state."""
    return work


def _call_shared_function(work: Callable[[int, int], Result], begin: int, end: int) -> Result:
    """Call the shared function for one index range."""
    return work(begin, end)
