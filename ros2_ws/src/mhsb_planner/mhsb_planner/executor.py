"""Executors for all large work: processes, threads or a cluster.

Whole runs are executed in processes. Index ranges are executed in threads, because kernels release
the interpreter lock. If a cluster is given, it executes both. Results do not depend on the kind or
number of workers.
"""

import logging
import multiprocessing
import operator
import os
import signal
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
"""Number of processes that may crash during one task before the task fails.

The limit is needed because the task itself may be the cause."""

STATES_PER_THREAD = 4
"""Number of shared states that a thread keeps.

A worker thread of a cluster may execute tasks of several executors, each with its own state."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SharedState:
    """Function and arguments, make(*given), that make a state for all tasks of a worker.

    A worker is a thread of this process, or the thread that executes tasks in another process. Each
    worker makes its own state at its first task. Two tasks never use one state at the same time. A
    worker keeps the last STATES_PER_THREAD states.

    Attributes:
        make: Function that makes the state. It must be picklable for other processes.
        given: Arguments of `make`.
        name: Unique key by which a thread finds the state that it has made.
    """

    make: Callable[..., Any] = field(compare=False)
    given: tuple[Any, ...] = field(compare=False)
    name: str = field(default_factory=lambda: uuid4().hex)


class OtherComputers(Protocol):
    """Workers that are not on this computer, such as `mhsb_planner.cluster.Cluster`."""

    def create_executor(self, shared: SharedState | None) -> Executor:
        """Connect to the workers, and return an executor on them.

        Args:
            shared: State that becomes the first argument of each task. None means that tasks get
                only their own arguments.

        Returns:
            The executor. It disconnects when it is shut down.

        Raises:
            ClusterError: The workers cannot be reached.
        """


Jobs: TypeAlias = int | OtherComputers | None
"""Number of processes or threads on this machine, or a cluster.

None means one for each processor that this process may use."""


def create_executor(jobs: Jobs = None, shared: SharedState | None = None) -> Executor:
    """Create an executor on processes or a cluster.

    With one job, the tasks run in a thread of the calling process. If a process crashes, its task
    is repeated in a new process. After MAX_ATTEMPTS crashes the task fails with WorkersLostError.

    Args:
        jobs: Number of processes, or a cluster. None means one process for each processor that this
            process may use.
        shared: State that becomes the first argument of each task. None means that tasks get only
            their own arguments.

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
    """Context manager that executes tasks with a shared state, in processes or on a cluster.

    Each worker makes the state at its first task (`SharedState`).
    """

    def __init__(self, jobs: Jobs, make: Callable[..., State], *given: Any) -> None:
        """Create the executor. Each worker makes the state make(*given) at its first task.

        Args:
            jobs: Number of processes, or a cluster. None means one process for each processor that
                this process may use.
            make: Function that makes the state. It must be picklable for other processes.
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


def yield_results(tasks: Iterable[Future[Result]], *, in_order: bool = False) -> Iterator[Result]:
    """Yield the results of tasks.

    If the generator is closed early or a task has failed, all tasks that have not begun are
    cancelled.

    Args:
        tasks: Futures.
        in_order: True to yield results in the order of `tasks`, False to yield them in the order in
            which the tasks are completed.

    Yields:
        Results of the tasks. If a task has failed, the generator raises the task's error in place
        of its result.
    """
    waiting = list(tasks)
    try:
        for task in waiting if in_order else as_completed(waiting):
            yield task.result()
    finally:
        for task in waiting:
            task.cancel()


def yield_results_of_ranges(
    work: Callable[[int, int], Result], total: int, size: int, jobs: Jobs = None
) -> Generator[Result, None, None]:
    """Call a function for index ranges that cover 0 … total − 1, and yield the results in order.

    The calls run in threads of this process, or on a cluster. Each worker of a cluster gets the
    function once. If the generator is closed early, calls that have not begun are cancelled, and
    the generator waits for the others.

    Args:
        work: Function work(begin, end) for the range from `begin` to `end` − 1.
        total: Number of indices.
        size: Number of indices in a range; the last range may be shorter.
        jobs: Number of threads, or a cluster. None means one thread for each processor that this
            process may use.

    Yields:
        Result of each range, in the order of the ranges. If a call has failed, the generator raises
        the call's error in place of its result.

    Raises:
        RequestError: `jobs` is below 1.
        ClusterError: The cluster does not answer.
    """
    ranges = [(begin, min(begin + size, total)) for begin in range(0, total, size)]
    if jobs is None or isinstance(jobs, int):
        with ThreadPoolExecutor(_worker_count(jobs)) as threads:
            tasks = [threads.submit(work, begin, end) for begin, end in ranges]
            yield from yield_results(tasks, in_order=True)
    else:
        with SharedStateExecutor(jobs, partial, work) as workers:
            tasks = [workers.submit(operator.call, begin, end) for begin, end in ranges]
            yield from yield_results(tasks, in_order=True)


class _LocalExecutor(ThreadPoolExecutor):
    """Executor on this computer: one thread, or several threads with one process each.

    If a process crashes, only its own task is affected. Its thread starts another process and
    repeats the task.
    """

    def __init__(self, workers: int, shared: SharedState | None) -> None:
        """Create the executor. Threads and processes start with their first tasks.

        Args:
            workers: Number of processes. With 1, tasks run in a thread of this process instead.
            shared: State that tasks share, made once in each process. None means that tasks get
                only their own arguments.
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
            *args: Positional arguments after the state.
            **named: Named arguments.

        Returns:
            Future of the result.
        """
        return super().submit(self._perform, work, args, named)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop the threads as `ThreadPoolExecutor` does, then end the processes.

        Args:
            wait: True to wait for the threads. Also with False, the call waits until each process
                has ended its present task.
            cancel_futures: True to cancel tasks that have not begun.
        """
        super().shutdown(wait, cancel_futures=cancel_futures)
        self._processes.close()

    def _start_process(self) -> None:
        """Prepare a process for the calling thread, at its beginning or after a crash.

        The process starts with its first task. The calling thread blocks SIGINT from now on, and
        the process inherits the block. Otherwise SIGINT would end the process with a traceback
        while it imports modules or waits for a task.
        """
        spawn = multiprocessing.get_context("spawn")
        process = ProcessPoolExecutor(
            1, spawn, initializer=_set_process_state, initargs=(self._shared,)
        )
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        self._own.process = self._processes.enter_context(process)

    def _perform_in_process(
        self, work: Callable[..., Result], args: tuple[Any, ...], named: dict[str, Any]
    ) -> Result:
        """Execute a task in the process that belongs to the calling thread.

        If the process crashes, a new process repeats the task, with a warning in the log.

        Args:
            work: Function of the task.
            args: Positional arguments of `work` after the state.
            named: Named arguments of `work`.

        Returns:
            Result of the task.

        Raises:
            WorkersLostError: MAX_ATTEMPTS processes crashed during the task.
        """
        for _ in range(MAX_ATTEMPTS):
            try:
                task = self._own.process.submit(_perform_with_process_state, work, args, named)
                return task.result()
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
    """Execute a task in the calling thread.

    The call is work(state, *args, **named), or work(*args, **named) if `shared` is None. The first
    task of a thread makes the state, and the thread keeps it (STATES_PER_THREAD).

    Args:
        shared: Function and arguments that make the state. None means that there is no state.
        work: Function of the task.
        args: Positional arguments after the state.
        named: Named arguments.

    Returns:
        Result of the task.
    """
    states = () if shared is None else (_states.state_of(shared),)
    return work(*states, *args, **named)


class _ThreadStates(threading.local):
    """Shared states that the calling thread has made.

    Attributes:
        state_of: Function that returns the state of a `SharedState`. It makes the state at the
            first call, and keeps the last STATES_PER_THREAD states.
    """

    def __init__(self) -> None:
        """Begin without states. `threading.local` calls this method once in each thread."""
        self.state_of = lru_cache(STATES_PER_THREAD)(lambda shared: shared.make(*shared.given))


_states = _ThreadStates()

_process_state: list[SharedState | None] = []
"""State for the tasks of this process, as a list of one element.

`_set_process_state` sets it when `_LocalExecutor` starts the process."""


def _set_process_state(shared: SharedState | None) -> None:
    """Store the function and arguments of the state for the tasks of this process."""
    _process_state[:] = [shared]


def _perform_with_process_state(
    work: Callable[..., Result], args: tuple[Any, ...], named: dict[str, Any]
) -> Result:
    """Execute a task with the shared state of this process; SIGINT can interrupt it.

    Args:
        work: Function of the task.
        args: Positional arguments of `work` after the state.
        named: Named arguments of `work`.

    Returns:
        Result of the task.

    Raises:
        KeyboardInterrupt: SIGINT came during the task, or before it while the process waited.
    """
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        return perform(_process_state[0], work, args, named)
    finally:
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def _worker_count(jobs: int | None) -> int:
    """Determine the number of workers.

    Args:
        jobs: The number. None means one for each processor that this process may use.

    Returns:
        Number of workers, at least 1.

    Raises:
        RequestError: The number is below 1.
    """
    if jobs is not None and jobs < 1:
        raise RequestError("jobs", jobs, "must be at least 1")
    return jobs or len(os.sched_getaffinity(0))
