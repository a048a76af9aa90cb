"""Executors for all large work: processes, threads or a cluster.

Whole runs go to processes. Index ranges go to threads, because kernels release the interpreter
lock. Both go to a cluster if one is given. Results do not depend on who does the work, or on how
many do.
"""

from __future__ import annotations

import logging
import multiprocessing
import operator
import os
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import (
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any, Concatenate, Generic, ParamSpec, Protocol, TypeAlias, TypeVar, cast
from uuid import uuid4

from mhsb_planner.errors import RequestError, WorkersLostError

State = TypeVar("State")
P = ParamSpec("P")
Result = TypeVar("Result")

MAX_ATTEMPTS = 6
"""Number of processes that may end during one task before it fails: the task may end them."""

STATES_PER_THREAD = 4
"""Number of shared states that a thread keeps; a cluster's worker may serve several one after
another.
"""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SharedState:
    """State that tasks share: make(*given), made by each worker at its first task.

    A worker is a thread: of this process, or the one that does tasks in another process.

    No two tasks use one state at a time. A worker keeps the last STATES_PER_THREAD states.

    Attributes:
        make: Function that makes the state; it must be picklable for other processes.
        given: Its arguments.
        name: Unique key by which a thread finds the state that it has made.
    """

    make: Callable[..., Any] = field(compare=False)
    given: tuple[Any, ...] = field(compare=False)
    name: str = field(default_factory=lambda: uuid4().hex)


class OtherComputers(Protocol):
    """Workers that are not on this computer, such as `mhsb_planner.cluster.Cluster`."""

    def create_executor(self, shared: SharedState | None) -> Executor:
        """Connect and return an executor, which disconnects when it is shut down.

        Args:
            shared: State that becomes the first argument of each task; None: tasks get only their
                own arguments.

        Raises:
            ClusterError: The workers cannot be reached.
        """


Jobs: TypeAlias = int | OtherComputers | None
"""Number of processes or threads on this machine, or a cluster. None: one for each processor that
this process may use.
"""


def create_executor(jobs: Jobs = None, shared: SharedState | None = None) -> Executor:
    """Create an executor on processes or a cluster.

    With one job, the tasks run in a thread of the calling process. If a process crashes, its task
    is done again in a new process. After MAX_ATTEMPTS crashes the task fails with WorkersLostError.

    Args:
        jobs: Number of processes, or a cluster. None: one process for each processor that this
            process may use.
        shared: State that becomes the first argument of each task; None: tasks get only their own
            arguments.

    Returns:
        The executor, to be used as a context manager.

    Raises:
        RequestError: `jobs` is below 1.
        ClusterError: The cluster does not answer.
    """
    if jobs is None or isinstance(jobs, int):
        return _LocalExecutor(_worker_count(jobs), shared)
    return jobs.create_executor(shared)


class SharedStateExecutor(AbstractContextManager["SharedStateExecutor[State]"], Generic[State]):
    """Context manager that does tasks with a shared state, in processes or on a cluster.

    The state is make(*given), see `SharedState`.
    """

    def __init__(self, jobs: Jobs, make: Callable[..., State], *given: Any) -> None:
        """Create the executor; each worker makes the state when its first task begins.

        Args:
            jobs: Number of processes, or a cluster. None: one process for each processor that this
                process may use.
            make: Function that makes the state; picklable for other processes.
            given: Arguments of `make`.

        Raises:
            RequestError: `jobs` is below 1.
            ClusterError: The cluster does not answer.
        """
        self._pool = create_executor(jobs, SharedState(make, given))

    def submit(
        self, work: Callable[Concatenate[State, P], Result], *args: P.args, **named: P.kwargs
    ) -> Future[Result]:
        """Submit the task work(state, *args, **named), with the worker's own state.

        Function, arguments and result must be picklable if the work is done in other processes.

        Args:
            work: Function of the task.
            *args: Positional arguments after the state.
            **named: Named arguments.

        Returns:
            Future of the result.
        """
        return self._pool.submit(cast(Callable[..., Result], work), *args, **named)

    def __exit__(self, *failure: object) -> None:
        """Wait for all tasks and release the workers."""
        self._pool.shutdown()


def results_of(tasks: Iterable[Future[Result]], *, in_order: bool = False) -> Iterator[Result]:
    """Yield the results of tasks.

    If the generator ends early, by an error or by the consumer, the tasks that have not begun are
    cancelled.

    Args:
        tasks: Futures.
        in_order: True to yield results in the order of `tasks`, False to yield them in the order in
            which the tasks are completed.

    Yields:
        Results of the tasks. If a task has failed, its error is raised when its turn comes.
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
    """Call a function for index ranges that cover 0 … total − 1, and yield the results in order.

    The calls run in threads of this process, or on a cluster. A cluster gets the function once.
    Closing the generator cancels calls that have not begun.

    Args:
        work: Function work(begin, end) of the range from `begin` to `end` − 1.
        total: Number of indices.
        size: Number of indices in a range; the last range may be shorter.
        jobs: Number of threads, or a cluster. None: one thread for each processor that this process
            may use.

    Yields:
        Result of each range, in the order of the ranges.

    Raises:
        RequestError: `jobs` is below 1.
        ClusterError: The cluster does not answer.
    """
    ranges = [(begin, min(begin + size, total)) for begin in range(0, total, size)]
    if jobs is None or isinstance(jobs, int):
        with ThreadPoolExecutor(_worker_count(jobs)) as threads:
            tasks = [threads.submit(work, begin, end) for begin, end in ranges]
            yield from results_of(tasks, in_order=True)
    else:
        with SharedStateExecutor(jobs, partial, work) as workers:
            tasks = [workers.submit(operator.call, begin, end) for begin, end in ranges]
            yield from results_of(tasks, in_order=True)


class _LocalExecutor(ThreadPoolExecutor):
    """Executor on this computer: one thread, or several threads that have a process each.

    If a process ends by itself, only its own task is affected: the thread starts another process
    and does the task again.
    """

    def __init__(self, workers: int, shared: SharedState | None) -> None:
        """Store the arguments; threads and processes start with their first tasks.

        Args:
            workers: Number of processes. With 1, tasks run in a thread of this process instead.
            shared: State that tasks share, made once in each process; None: tasks get only their
                own arguments.
        """
        super().__init__(workers, initializer=self._start_process if workers > 1 else None)
        self._perform = partial(perform, shared) if workers == 1 else self._perform_in_process
        self._shared = shared
        self._processes = ExitStack()
        self._own = threading.local()

    def submit(self, work: Callable[..., Result], /, *args: Any, **named: Any) -> Future[Result]:
        """Submit the task work(state, *args, **named), or work(*args, **named) without a state.

        Args:
            work: Function of the task.
            *args: Positional arguments.
            **named: Named arguments.

        Returns:
            Future of the result.
        """
        return super().submit(self._perform, work, args, named)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop the threads as `ThreadPoolExecutor` does, then end the processes.

        Args:
            wait: Whether to wait for the threads.
            cancel_futures: Whether to cancel tasks that have not begun.
        """
        super().shutdown(wait, cancel_futures=cancel_futures)
        self._processes.close()

    def _start_process(self) -> None:
        """Start a process for the calling thread.

        If the thread's process has crashed, the new one replaces it.
        """
        spawn = multiprocessing.get_context("spawn")
        process = ProcessPoolExecutor(
            1, spawn, initializer=_set_process_state, initargs=(self._shared,)
        )
        self._own.process = self._processes.enter_context(process)

    def _perform_in_process(self, work: Callable[..., Result], *given: Any) -> Result:
        """Do a task in the process that belongs to the calling thread.

        If the process crashes, a new one does the task again, with a warning in the log.

        Args:
            work: Function of the task.
            *given: Its positional arguments as a tuple, and its named arguments as a mapping.

        Returns:
            Result of the task.

        Raises:
            WorkersLostError: MAX_ATTEMPTS processes ended during the task.
        """
        for _ in range(MAX_ATTEMPTS):
            try:
                return self._own.process.submit(_perform_here, work, *given).result()
            except BrokenProcessPool:
                self._start_process()
                _log.warning("a process has ended before its work was done; it is done again")
        raise WorkersLostError(f"{MAX_ATTEMPTS} processes")


def perform(
    shared: SharedState | None,
    work: Callable[..., Result],
    args: tuple[Any, ...],
    named: dict[str, Any],
) -> Result:
    """Call the function of a task in the calling thread, and return its result.

    The call is work(state, *args, **named), or work(*args, **named) if `shared` is None. The first
    task of a thread makes the state.

    Args:
        shared: Function and arguments that make the state; None: no state.
        work: Function of the task.
        args: Positional arguments.
        named: Named arguments.
    """
    states = () if shared is None else (_states.state_of(shared),)
    return work(*states, *args, **named)


class _ThreadStates(threading.local):
    """States that the calling thread has made."""

    def __init__(self) -> None:
        """Begin without states; `threading.local` calls this once in each thread."""
        self.state_of = lru_cache(STATES_PER_THREAD)(lambda shared: shared.make(*shared.given))


_states = _ThreadStates()

_process_state: list[SharedState | None] = []
"""State that the tasks of a process share; one element, set when `_LocalExecutor` starts it."""


def _set_process_state(shared: SharedState | None) -> None:
    """Set the state that the tasks of this process share."""
    _process_state[:] = [shared]


def _perform_here(work: Callable[..., Result], *given: Any) -> Result:
    """Do a task with the shared state of this process, and return its result.

    Args:
        work: Function of the task.
        *given: Its positional arguments as a tuple, and its named arguments as a mapping.
    """
    return perform(_process_state[0], work, *given)


def _worker_count(jobs: int | None) -> int:
    """Return the number of workers.

    Args:
        jobs: The number; None: one for each processor that this process may use.

    Raises:
        RequestError: The number is below 1.
    """
    if jobs is not None and jobs < 1:
        raise RequestError("jobs", jobs, "must be at least 1")
    return jobs or len(os.sched_getaffinity(0))
