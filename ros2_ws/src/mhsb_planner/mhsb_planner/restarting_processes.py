"""Processes on this machine, of which none takes work with it when it is killed."""

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
from mhsb_planner.tasks import Preparation, cancel_with, pass_on, perform

Result = TypeVar("Result")

RESTARTS = 5
"""After so many somebody should know: a task may be what ends its process."""

_log = logging.getLogger(__name__)


class RestartingProcesses(Executor):
    """A `ProcessPoolExecutor` that is replaced when one of its processes has ended by itself.

    What it had done stays, what it had not is done by the next one. Tasks fail with
    WorkersLostError where that has happened more than RESTARTS times.
    """

    def __init__(self, workers: int, preparation: Preparation | None) -> None:
        self._new = partial(
            ProcessPoolExecutor,
            workers,
            multiprocessing.get_context("spawn"),
            initializer=_keep,
            initargs=(preparation,),
        )
        self._lock = threading.Lock()
        self._pool = self._new()
        self._losses = 0

    def submit(self, work: Callable[..., Result], /, *args: Any, **named: Any) -> Future[Result]:
        """The task outlives the process that was to do it."""
        task: Future[Result] = Future()
        self._begin(task, partial(_perform, work, args, named))
        return task

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As any executor's."""
        pool = None
        while pool is not self._pool:  # it may be replaced while it is waited for
            pool = self._pool
            pool.shutdown(wait, cancel_futures=cancel_futures)

    def _begin(self, task: Future[Result], work: Callable[[], Result]) -> None:
        with self._lock:
            try:
                part = self._pool.submit(work)
            except BrokenProcessPool:  # which its futures are still to be told
                self._replace(self._pool)
                part = self._pool.submit(work)
            pool = self._pool
        cancel_with(task, part)
        part.add_done_callback(partial(self._end, task, work, pool))

    def _end(
        self,
        task: Future[Result],
        work: Callable[[], Result],
        pool: ProcessPoolExecutor,
        part: Future[Result],
    ) -> None:
        if part.cancelled() or not isinstance(part.exception(), BrokenProcessPool):
            pass_on(part, task)
            return
        with self._lock:
            self._replace(pool)
        if self._losses > RESTARTS:
            pass_on(part, task, WorkersLostError(f"{self._losses} processes"))
        else:
            self._begin(task, work)

    def _replace(self, pool: ProcessPoolExecutor) -> None:
        """A new pool in place of one that is broken, once; the lock is held."""
        if pool is self._pool:
            self._losses += 1
            self._pool = self._new()
            _log.warning("a process has ended before its work was done; it is done again")


_preparation: list[Preparation | None] = []  # of all tasks of this process


def _keep(preparation: Preparation | None) -> None:
    _preparation[:] = [preparation]


def _perform(
    work: Callable[..., Result], args: tuple[Any, ...], named: dict[str, Any]
) -> Result:
    return perform(_preparation[0], work, *args, **named)
