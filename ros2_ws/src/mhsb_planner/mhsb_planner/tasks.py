"""Common parts of executors: shared state of tasks, and links between futures."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any, TypeVar
from uuid import uuid4

Result = TypeVar("Result")

PREPARATION_CAPACITY = 4
"""Number of shared states that a thread keeps; a cluster's worker may serve several one after
another.
"""


@dataclass(frozen=True)
class SharedStateRecipe:
    """Recipe of a state that tasks share: make(*given), called once in each thread that runs tasks.

    Attributes:
        make: Function that makes the state; it must be picklable for other processes.
        given: Its arguments.
        name: Unique key by which a thread finds the state that it has made.
    """

    make: Callable[..., Any]
    given: tuple[Any, ...] = ()
    name: str = field(default_factory=lambda: uuid4().hex)

    def state(self) -> Any:
        """Return the calling thread's state, made on the first call.

        Each thread has its own state, so no two tasks use one at a time. A thread keeps the states
        of the last PREPARATION_CAPACITY recipes and drops older ones.

        Returns:
            Result of `make`.
        """
        made: dict[str, Any] = _made.__dict__
        if self.name not in made:
            made[self.name] = self.make(*self.given)
            for oldest in list(made)[:-PREPARATION_CAPACITY]:
                del made[oldest]
        return made[self.name]


_made = threading.local()


def perform(
    preparation: SharedStateRecipe | None, work: Callable[..., Result], *args: Any, **named: Any
) -> Result:
    """Do a task: call work(state, *args, **named), or without state if none is shared.

    Args:
        preparation: Recipe of the state that tasks share; None: `work` gets no state.
        work: Function to call.
        args: Positional arguments of `work` after the state.
        named: Named arguments of `work`.

    Returns:
        Result of the function.
    """
    prepared = () if preparation is None else (preparation.state(),)
    return work(*prepared, *args, **named)


def link_cancellation(task: Future[Result], part: Future[Result]) -> None:
    """Let the cancellation of a task also cancel the executor's future that does it.

    The reference to the executor's future is dropped when that future has ended. As long as a
    future refers to a result, a cluster keeps the result, and computes it again if its worker ends.

    Args:
        task: Future that the user has.
        part: Future of the executor.
    """
    held = [part]

    def cancel_parts(ended: Future[Result]) -> None:
        """Cancel the executor's future if the task was cancelled.

        Args:
            ended: The task, which has ended.
        """
        if ended.cancelled():
            for each in tuple(held):
                each.cancel()

    task.add_done_callback(cancel_parts)
    part.add_done_callback(lambda _: held.clear())


def transfer_outcome(
    part: Future[Result], task: Future[Result], error: BaseException | None = None
) -> None:
    """Transfer the outcome of an executor's future to the user's future.

    A cancelled task stays cancelled. If `part` was cancelled and there is no `error`, the task is
    cancelled.

    Args:
        part: Future of the executor, which has ended.
        task: Future that the user has.
        error: Error to set instead of the outcome; None: transfer the outcome.
    """
    if part.cancelled() and error is None:
        task.cancel()
    if not task.set_running_or_notify_cancel():
        return
    error = error or part.exception()
    if error is not None:
        task.set_exception(error)
    else:
        task.set_result(part.result())
