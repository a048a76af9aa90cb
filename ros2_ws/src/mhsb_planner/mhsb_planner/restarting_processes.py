"""Pool of processes on this machine that loses no work if one of them is killed."""

from __future__ import annotations

import logging
import multiprocessing
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import Any, TypeVar

from mhsb_planner.errors import WorkersLostError
from mhsb_planner.tasks import SharedStateRecipe, link_cancellation, perform, transfer_outcome

Result = TypeVar("Result")

RESTARTS_BEFORE_WARNING = 5
"""Number of lost pools after which tasks fail, because a task itself may end its process."""

_log = logging.getLogger(__name__)


class RestartingProcesses(Executor):
    """Executor on a pool of processes that is replaced if one of its processes ends by itself.

    Finished tasks keep their results; unfinished ones are done again by the next pool. Once more
    than RESTARTS_BEFORE_WARNING pools have been lost, unfinished tasks fail with WorkersLostError.
    """

    def __init__(self, workers: int, preparation: SharedStateRecipe | None) -> None:
        """Start the first pool.

        Args:
            workers: Number of processes.
            preparation: Recipe of the state that tasks share, made once in each process; None: they
                share none.
        """
        self._new = partial(
            ProcessPoolExecutor,
            workers,
            multiprocessing.get_context("spawn"),
            initializer=_store_preparation,
            initargs=(preparation,),
        )
        self._lock = threading.Lock()
        self._pool = self._new()
        self._losses = 0

    def submit(self, work: Callable[..., Result], /, *args: Any, **named: Any) -> Future[Result]:
        """Submit the task work(state, *args, **named).

        If the tasks share no state, it is work(*args, **named). The task is repeated if a process
        of the pool ends before the task is done.

        Args:
            work: Function that can be pickled.
            args: Positional arguments of `work` after the state.
            named: Named arguments of `work`.

        Returns:
            Future of the result.
        """
        task: Future[Result] = Future()
        self._submit_to_pool(task, partial(_perform, work, args, named))
        return task

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop accepting work, also in a pool that replaces the present one during the wait.

        Args:
            wait: Whether to wait for tasks that have begun.
            cancel_futures: Whether to cancel tasks that have not begun.
        """
        pool = None
        while pool is not self._pool:  # it may be replaced during the wait
            pool = self._pool
            pool.shutdown(wait, cancel_futures=cancel_futures)

    def _submit_to_pool(self, task: Future[Result], work: Callable[[], Result]) -> None:
        """Give a task to the present pool; a broken pool is replaced first.

        Args:
            task: Future that the user has.
            work: Function without arguments that does the task.
        """
        with self._lock:
            try:
                part = self._pool.submit(work)
            except BrokenProcessPool:  # its futures may not have ended yet
                self._replace_pool(self._pool)
                part = self._pool.submit(work)
            pool = self._pool
        link_cancellation(task, part)
        part.add_done_callback(partial(self._complete_or_repeat, task, work, pool))

    def _complete_or_repeat(
        self,
        task: Future[Result],
        work: Callable[[], Result],
        pool: ProcessPoolExecutor,
        part: Future[Result],
    ) -> None:
        """Complete a task, or submit it again if its pool is broken.

        After more than RESTARTS_BEFORE_WARNING lost pools the task fails with WorkersLostError.

        Args:
            task: Future that the user has.
            work: Function without arguments that does the task.
            pool: Pool that was to do it.
            part: The pool's future, which has ended.
        """
        if part.cancelled() or not isinstance(part.exception(), BrokenProcessPool):
            transfer_outcome(part, task)
            return
        with self._lock:
            self._replace_pool(pool)
        if self._losses > RESTARTS_BEFORE_WARNING:
            transfer_outcome(part, task, WorkersLostError(f"{self._losses} processes"))
        else:
            self._submit_to_pool(task, work)

    def _replace_pool(self, pool: ProcessPoolExecutor) -> None:
        """Replace a broken pool, unless another task has done so already; the lock must be held.

        Args:
            pool: The broken pool.
        """
        if pool is self._pool:
            self._losses += 1
            self._pool = self._new()
            _log.warning("a process has ended before its work was done; it is done again")


_preparation: list[SharedStateRecipe | None] = []
"""Recipe of the shared state of this process's tasks; one element, set when the process starts."""


def _store_preparation(preparation: SharedStateRecipe | None) -> None:
    """Store the recipe of the state that this process's tasks share."""
    _preparation[:] = [preparation]


def _perform(work: Callable[..., Result], args: tuple[Any, ...], named: dict[str, Any]) -> Result:
    """Do a task in this process, with the state that its tasks share."""
    return perform(_preparation[0], work, *args, **named)
