"""Tasks wherever they are done: what they have in common, and how their futures hang together."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any, TypeVar
from uuid import uuid4

Result = TypeVar("Result")

KEPT = 4
"""Preparations whose result a thread keeps: workers of a cluster may serve several in turn."""


@dataclass(frozen=True)
class Preparation:
    """make(*given), to be called once in each thread that does such tasks.

    name  by which a thread finds again what it has made
    """

    make: Callable[..., Any]
    given: tuple[Any, ...] = ()
    name: str = field(default_factory=lambda: uuid4().hex)

    def state(self) -> Any:
        """The calling thread's own: no two tasks use one at the same time."""
        made: dict[str, Any] = _made.__dict__
        if self.name not in made:
            made[self.name] = self.make(*self.given)
            for oldest in list(made)[:-KEPT]:
                del made[oldest]
        return made[self.name]


_made = threading.local()


def perform(
    preparation: Preparation | None, work: Callable[..., Result], *args: Any, **named: Any
) -> Result:
    """work(*args, **named), with what was prepared before them."""
    prepared = () if preparation is None else (preparation.state(),)
    return work(*prepared, *args, **named)


def cancel_with(task: Future[Result], part: Future[Result]) -> None:
    """Cancel what does a task when the task is cancelled.

    What has ended is forgotten: a cluster keeps a result, and makes it again when its worker dies,
    for as long as somebody holds its future.
    """
    held = [part]

    def follow(ended: Future[Result]) -> None:
        if ended.cancelled():
            for each in tuple(held):
                each.cancel()

    task.add_done_callback(follow)
    part.add_done_callback(lambda _: held.clear())


def pass_on(
    part: Future[Result], task: Future[Result], error: BaseException | None = None
) -> None:
    """What has become of the part becomes of its task, unless an `error` does."""
    if part.cancelled() and error is None:
        task.cancel()
    if not task.set_running_or_notify_cancel():
        return
    error = error or part.exception()
    if error is not None:
        task.set_exception(error)
    else:
        task.set_result(part.result())
