"""Work on a Dask cluster; the package `distributed` is an optional extra.

If a worker ends before its tasks are done, the scheduler gives them to other workers, also to some
that join later. The recipe of a state that tasks share goes to each worker once, as a node of the
scheduler's task graph. The state itself is made once in each thread of a worker.
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
from mhsb_planner.tasks import SharedStateRecipe, link_cancellation, perform, transfer_outcome

Result = TypeVar("Result")

CONNECTED_WITHIN = 5.0
"""Longest time in which a scheduler must answer [s]."""

SUITE_PACKAGES = ("mhsb_model", "mhsb_control", "mhsb_planner", "mhsb_sim", "mhsb_tools")
"""Packages of the suite that must be equal on all workers."""
RESULT_LIBRARIES = ("numpy", "scipy", "numba", "mujoco", "mujoco-core")
"""Libraries whose versions must be equal on all workers, because results depend on them."""

VERSION_MISMATCH_REASON = (
    "it has another version of the suite, NumPy, SciPy, numba or MuJoCo, so that results would "
    "differ; install there what is here"
)
"""Reason of the error if versions differ."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Cluster:
    """A cluster, given by the address of its scheduler.

    Attributes:
        address: Address, such as tcp://10.0.0.2:8786.
    """

    address: str

    @classmethod
    def connect(cls, address: str) -> Cluster:
        """Connect to a cluster, check its versions, and return it.

        A cluster without workers is accepted with a warning in the log.

        Args:
            address: Address of the scheduler, such as tcp://10.0.0.2:8786.

        Returns:
            The cluster.

        Raises:
            ClusterError: The scheduler does not answer, or the scheduler or a worker has other
                versions of the suite or its libraries or cannot load them.
        """
        with _connect(address) as client:
            try:
                there = {
                    client.run_on_scheduler(versions_fingerprint),
                    *client.run(versions_fingerprint).values(),
                }
            except Exception as error:  # errors of any type may come from the workers
                raise ClusterError(
                    address, f"its scheduler or a worker cannot load the suite: {error}"
                ) from error
            if there != {versions_fingerprint()}:
                raise ClusterError(address, VERSION_MISMATCH_REASON)
            if not client.scheduler_info()["workers"]:
                _log.warning("the cluster has no worker yet; `dask worker %s` starts one", address)
        return cls(address)

    def executor(self, preparation: SharedStateRecipe | None) -> Executor:
        """Connect to the cluster and return an executor on its workers.

        Args:
            preparation: Recipe of the state that tasks share; None: they share none.

        Returns:
            The executor; shutting it down closes the connection.

        Raises:
            ClusterError: The scheduler does not answer.
        """
        return _ClusterExecutor(self.address, preparation)


class _ClusterExecutor(Executor):
    """Executor on a cluster's workers, with a shared state and the suite's own errors."""

    def __init__(self, address: str, preparation: SharedStateRecipe | None) -> None:
        """Connect to the scheduler and send it the recipe of the shared state.

        Args:
            address: Address of the scheduler.
            preparation: Recipe of the state that tasks share; None: they share none.

        Raises:
            ClusterError: The scheduler does not answer.
        """
        self._address = address
        self._client = _connect(address)
        self._pool = self._client.get_executor(pure=False)
        self._preparation = (
            None
            if preparation is None
            else self._client.submit(
                _identity_function, preparation, key=f"given-{preparation.name}"
            )
        )

    def submit(self, work: Callable[..., Result], /, *args: Any, **named: Any) -> Future[Result]:
        """Submit the task work(state, *args, **named) to the cluster.

        If the tasks share no state, it is work(*args, **named).

        Args:
            work: Function that can be pickled.
            args: Positional arguments of `work` after the state.
            named: Named arguments of `work`.

        Returns:
            A future of `concurrent.futures`; cancelling it cancels the task.
        """
        task: Future[Result] = Future()
        part = self._pool.submit(
            _perform_on_worker,
            self._address,
            versions_fingerprint(),
            self._preparation,
            work,
            args,
            named,
        )
        link_cancellation(task, part)
        part.add_done_callback(
            lambda ended: transfer_outcome(ended, task, self._translate_error(ended, task))
        )
        return task

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop accepting work and close the connection.

        Args:
            wait: Whether to wait until all tasks are done.
            cancel_futures: Whether to give up all tasks; `wait` is then ignored.
        """
        self._pool.shutdown(wait and not cancel_futures)
        self._client.close()

    def _translate_error(self, part: Future[Result], task: Future[Result]) -> Exception | None:
        """Return the error of the suite that replaces an error of Dask.

        Args:
            part: Dask's future of the task.
            task: Future that the user has.

        Returns:
            ClusterError if the connection was lost, WorkersLostError if several workers ended while
            they did the task. Otherwise None: nothing is replaced, such as an error of the task
            itself.
        """
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


def _connect(address: str) -> Any:
    """Connect to a scheduler.

    Log messages of Dask's client are switched off in the whole process, because the errors raised
    here say the same.

    Args:
        address: Address of the scheduler.

    Returns:
        A client of `distributed`.

    Raises:
        ClusterError: The package is missing, or no scheduler answers at the address.
    """
    try:
        from distributed import Client
    except ImportError:
        raise ClusterError(
            address, "the package distributed is not installed; pip install 'distributed>=2024.1'"
        ) from None
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # its errors say the same
    if _request_identity(address)["type"] != "Scheduler":
        raise ClusterError(address, "this is not a scheduler; `dask scheduler` says its address")
    return Client(address, timeout=CONNECTED_WITHIN, set_as_default=False)


def _request_identity(address: str) -> dict[str, Any]:
    """Return the identity of the server that listens at an address.

    Args:
        address: Address such as tcp://10.0.0.2:8786.

    Returns:
        Dask's description of the server; "type" is "Scheduler" for a scheduler.

    Raises:
        ClusterAddressError: The text is not an address.
        ClusterError: There is no answer within CONNECTED_WITHIN.
    """
    from distributed.core import rpc

    async def asked() -> dict[str, Any]:
        """Return the server's answer to `identity`."""
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
def versions_fingerprint() -> str:
    """Compute a fingerprint of the suite's sources and of the libraries on which results depend.

    Returns:
        Hexadecimal SHA-256; computed once for each process.
    """
    found = hashlib.sha256()
    for library in RESULT_LIBRARIES:
        with suppress(PackageNotFoundError):
            found.update(f"{library} {version(library)}".encode())
    for package in SUITE_PACKAGES:
        spec = importlib.util.find_spec(package)
        if spec is not None and spec.origin is not None:
            for file in sorted(Path(spec.origin).parent.rglob("*.py")):
                found.update(file.read_bytes())
    return found.hexdigest()


def _identity_function(preparation: SharedStateRecipe) -> SharedStateRecipe:
    """Return the argument; as a task, this keeps the recipe in the cluster."""
    return preparation


def _perform_on_worker(
    address: str,
    wanted: str,
    preparation: SharedStateRecipe | None,
    work: Callable[..., Result],
    args: tuple[Any, ...],
    named: dict[str, Any],
) -> Result:
    """Run a task on a worker, after a check that versions are equal.

    Args:
        address: Address of the scheduler, for the error.
        wanted: Fingerprint of the versions that are required.
        preparation: Recipe of the state that tasks share, which becomes the first argument of
            `work`; None: they share none.
        work: Function to call.
        args: Positional arguments of `work` after the state.
        named: Named arguments of `work`.

    Returns:
        Result of the function.

    Raises:
        ClusterError: The worker has other versions.
    """
    if wanted != versions_fingerprint():
        raise ClusterError(address, VERSION_MISMATCH_REASON)
    return perform(preparation, work, *args, **named)
