"""A Dask cluster, which large work can be sent to; the package `distributed` is an optional extra.

A worker that ends before its tasks are done loses nothing: its scheduler gives them to others, and
to those that join later. What tasks share goes to each worker once, kept by the scheduler's graph,
and is made there once in each of its threads.
"""

from __future__ import annotations

import asyncio
import hashlib
import importlib.util
import logging
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar

from mhsb_planner.errors import ClusterAddressError, ClusterError, WorkersLostError
from mhsb_planner.tasks import Preparation, cancel_with, pass_on, perform

Result = TypeVar("Result")

CONNECTED_WITHIN = 5.0
"""Time in which a scheduler has to answer [s]."""

SOURCES = ("mhsb_model", "mhsb_planner", "mhsb_sim")
LIBRARIES = ("numpy", "scipy", "numba", "mujoco", "mujoco-core")
"""What results depend on: they have to be the same wherever tasks are done."""

OTHERS = (
    "it has another version of the suite, NumPy, SciPy, numba or MuJoCo, so that results would "
    "differ; install there what is here"
)

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Cluster:
    """A cluster whose scheduler answers at an address, such as tcp://10.0.0.2:8786."""

    address: str

    @classmethod
    def at(cls, address: str) -> Cluster:
        """One that answers now, and has what is here; raises ClusterError."""
        with _connected(address) as client:
            try:
                there = {client.run_on_scheduler(versions), *client.run(versions).values()}
            except Exception as error:  # whatever is raised there
                raise ClusterError(
                    address, f"its scheduler or a worker cannot load the suite: {error}"
                ) from error
            if there != {versions()}:
                raise ClusterError(address, OTHERS)
            if not client.scheduler_info()["workers"]:
                _log.warning("the cluster has no worker yet; `dask worker %s` starts one", address)
        return cls(address)

    def executor(self, preparation: Preparation | None) -> Executor:
        """Of the cluster's workers; raises ClusterError where its scheduler does not answer."""
        return _ClusterExecutor(self.address, preparation)


class _ClusterExecutor(Executor):
    """Dask's own, with a preparation, and with errors that are the suite's."""

    def __init__(self, address: str, preparation: Preparation | None) -> None:
        self._address = address
        self._client = _connected(address)
        self._pool = self._client.get_executor(pure=False)
        self._preparation = (
            None
            if preparation is None
            else self._client.submit(_itself, preparation, key=f"given-{preparation.name}")
        )

    def submit(self, work: Callable[..., Result], /, *args: Any, **named: Any) -> Future[Result]:
        task: Future[Result] = Future()
        part = self._pool.submit(
            _perform, self._address, versions(), self._preparation, work, args, named
        )
        cancel_with(task, part)
        part.add_done_callback(lambda ended: pass_on(ended, task, self._trouble(ended, task)))
        return task

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._pool.shutdown(wait and not cancel_futures)
        self._client.close()

    def _trouble(self, part: Future[Result], task: Future[Result]) -> Exception | None:
        """What is to be told instead of Dask's words."""
        from distributed import KilledWorker

        if part.cancelled():
            if task.cancelled():
                return None
            return ClusterError(self._address, "the connection to it was lost before all was done")
        error = part.exception()
        if isinstance(error, KilledWorker):
            return WorkersLostError(
                f"{error.allowed_failures + 1} workers of the cluster, which tried the same task,"
            )
        return None


def _connected(address: str) -> Any:
    """A client; raises ClusterError."""
    try:
        from distributed import Client
    except ImportError:
        raise ClusterError(
            address, "the package distributed is not installed; pip install 'distributed>=2024.1'"
        ) from None
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # errors tell all there is
    if _identity(address)["type"] != "Scheduler":
        raise ClusterError(address, "this is not a scheduler; `dask scheduler` says its address")
    return Client(address, timeout=CONNECTED_WITHIN, set_as_default=False)


def _identity(address: str) -> dict[str, Any]:
    """Who answers there; raises ClusterError."""
    from distributed.core import rpc

    async def asked() -> dict[str, Any]:
        async with rpc(address, timeout=CONNECTED_WITHIN) as there:
            return await asyncio.wait_for(there.identity(), CONNECTED_WITHIN)

    try:
        return asyncio.run(asked())
    except ValueError as error:
        trouble = f"not an address like tcp://10.0.0.2:8786: {error}"
        raise ClusterAddressError(address, trouble) from error
    except (OSError, TimeoutError) as error:
        raise ClusterError(
            address,
            f"no scheduler answers within {CONNECTED_WITHIN:g} s; `dask scheduler` starts one",
        ) from error


@cache
def versions() -> str:
    """Fingerprint of the suite's sources and of the libraries that results depend on."""
    found = hashlib.sha256()
    for library in LIBRARIES:
        with suppress(PackageNotFoundError):
            found.update(f"{library} {version(library)}".encode())
    for package in SOURCES:
        spec = importlib.util.find_spec(package)
        if spec is not None and spec.origin is not None:
            for file in sorted(Path(spec.origin).parent.rglob("*.py")):
                found.update(file.read_bytes())
    return found.hexdigest()


def _itself(preparation: Preparation) -> Preparation:
    return preparation


def _perform(
    address: str,
    wanted: str,
    preparation: Preparation | None,
    work: Callable[..., Result],
    args: tuple[Any, ...],
    named: dict[str, Any],
) -> Result:
    if wanted != versions():
        raise ClusterError(address, OTHERS)
    return perform(preparation, work, *args, **named)
