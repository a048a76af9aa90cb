"""Work on a Dask cluster, and the command-line arguments that choose a cluster or processes.

The package `distributed` is an optional dependency. If a worker ends before its tasks are done, the
scheduler gives the tasks to other workers, even workers that join later. Tasks may share a state.
The function and arguments that make this state are sent to each worker once.
"""

from __future__ import annotations

import asyncio
import hashlib
import importlib.util
import logging
import weakref
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any

import tyro

from mhsb_model.command_line import JobCount, UsageError
from mhsb_planner.errors import ClusterAddressError, ClusterError, WorkersLostError
from mhsb_planner.executor import Jobs, Result, SharedState, perform

CONNECTED_WITHIN = 5.0
"""Time within which a scheduler must answer [s]."""

SUITE_PACKAGES = ("mhsb_model", "mhsb_control", "mhsb_planner", "mhsb_sim", "mhsb_tools")
"""Packages of the suite whose sources must be equal on all workers."""
RESULT_LIBRARIES = ("numpy", "scipy", "numba", "mujoco", "mujoco-core")
"""Libraries whose versions must be equal on all workers, because results depend on them."""

VERSION_MISMATCH_REASON = (
    "it has another version of the suite, NumPy, SciPy, numba or MuJoCo, so that results would "
    "differ; install there what is here"
)
"""Clause of the error that is raised if versions differ."""

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
        """Check that a cluster answers and has the right versions, and return it.

        A cluster without workers is accepted, with a warning in the log. The connection is closed
        after the check.

        Args:
            address: Address of the scheduler, such as tcp://10.0.0.2:8786.

        Returns:
            The cluster.

        Raises:
            ClusterAddressError: The text is not an address.
            ClusterError: The package `distributed` is missing, or the scheduler does not answer. It
                is also raised if the scheduler or a worker cannot load the suite, or has other
                versions than this process.
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

    def create_executor(self, shared: SharedState | None) -> Executor:
        """Connect to the cluster, and return an executor on its workers.

        Args:
            shared: State that becomes the first argument of each task. None means that tasks get
                only their own arguments.

        Returns:
            The executor. It disconnects when it is shut down.

        Raises:
            ClusterError: The scheduler does not answer.
        """
        return _ClusterExecutor(self.address, shared)


class _ClusterExecutor(Executor):
    """Executor on a cluster's workers, whose tasks may share a state.

    Errors of Dask are converted to errors of the suite.
    """

    def __init__(self, address: str, shared: SharedState | None) -> None:
        """Connect to the scheduler, and send it the data from which workers make the shared state.

        Args:
            address: Address of the scheduler.
            shared: Function and arguments with which each worker makes the state that its tasks
                share. None means that nothing is sent, and that tasks get only their own arguments.

        Raises:
            ClusterAddressError: The text is not an address.
            ClusterError: The package `distributed` is missing, or the scheduler does not answer.
        """
        self._address = address
        self._client = _connect(address)
        self._pool = self._client.get_executor(pure=False)
        # a task, not scattered data: if the worker that has it ends, another computes it again
        self._shared = shared and self._client.submit(
            lambda recipe: recipe, shared, key=f"given-{shared.name}"
        )

    def submit(self, work: Callable[..., Result], /, *args: Any, **named: Any) -> Future[Result]:
        """Submit the task work(state, *args, **named), or work(*args, **named) without a state.

        Args:
            work: Function of the task.
            *args: Positional arguments after the state.
            **named: Named arguments.

        Returns:
            Future of the result. Cancelling it cancels the task on the cluster. If the task raises
            an exception, the future gets this exception. If the connection is lost or the worker
            has other versions, it gets a ClusterError. If several workers end during this task, it
            gets a WorkersLostError.
        """
        task: Future[Result] = Future()
        part = self._pool.submit(
            _perform_on_worker,
            self._address,
            versions_fingerprint(),
            self._shared,
            work,
            args,
            named,
        )
        # No strong reference: a cluster keeps a result as long as a future refers to it, and
        # computes it again if its worker ends.
        task.add_done_callback(partial(_cancel, weakref.ref(part)))
        part.add_done_callback(partial(self._copy_result, task))
        return task

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Close the executor and its connection.

        Args:
            wait: True to wait for all tasks.
            cancel_futures: True to close the connection without waiting, which ends the remaining
                tasks.
        """
        self._pool.shutdown(wait and not cancel_futures)
        self._client.close()

    def _copy_result(self, task: Future[Result], part: Future[Result]) -> None:
        """Copy the result or error of Dask's future to the caller's future.

        If the caller's future was cancelled, nothing happens. If the connection was lost, the error
        is a ClusterError. If several workers ended during this task, it is a WorkersLostError.

        Args:
            task: The caller's future.
            part: Dask's future, which is done.
        """
        from distributed import KilledWorker

        if not task.set_running_or_notify_cancel():
            return
        if part.cancelled():
            trouble = "the connection to it was lost before all was done"
            task.set_exception(ClusterError(self._address, trouble))
        elif (error := part.exception()) is None:
            task.set_result(part.result())
        elif isinstance(error, KilledWorker):
            who = f"{error.allowed_failures + 1} workers of the cluster, which tried the same task,"
            task.set_exception(WorkersLostError(who))
        else:
            task.set_exception(error)


def _cancel(part: weakref.ref[Future[Result]], task: Future[Result]) -> None:
    """Cancel Dask's future if the caller's future was cancelled.

    Args:
        part: Weak reference to Dask's future. If the future no longer exists, nothing happens.
        task: The caller's future, which is done or cancelled.
    """
    if task.cancelled() and (living := part()) is not None:
        living.cancel()


def _connect(address: str) -> Any:
    """Connect a client of `distributed` to a scheduler, and return the client.

    Log messages of Dask's clients are switched off for the process, because the errors raised here
    say the same.

    Args:
        address: Address of the scheduler, such as tcp://10.0.0.2:8786.

    Returns:
        The client, of the type `distributed.Client`.

    Raises:
        ClusterAddressError: The text is not an address.
        ClusterError: The package `distributed` is missing, nothing answers within CONNECTED_WITHIN,
            or the server at the address is not a scheduler.
    """
    try:
        from distributed import Client
        from distributed.core import rpc
    except ImportError:
        raise ClusterError(
            address, "the package distributed is not installed; pip install 'distributed>=2024.1'"
        ) from None
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)

    async def request_identity() -> dict[str, Any]:
        """Ask the server to describe itself, and return its description.

        `distributed.Client` would wait without end for a server that does not answer.

        Raises:
            TimeoutError: The server does not answer within CONNECTED_WITHIN.
            OSError: No server can be reached.
            ValueError: The address is not valid.
        """
        async with rpc(address, timeout=CONNECTED_WITHIN) as server:
            return await asyncio.wait_for(server.identity(), CONNECTED_WITHIN)

    try:
        identity = asyncio.run(request_identity())
    except ValueError as error:
        trouble = f"not an address like tcp://10.0.0.2:8786: {error}"
        raise ClusterAddressError(address, trouble) from error
    except (OSError, TimeoutError) as error:
        raise ClusterError(
            address,
            f"no scheduler answers within {CONNECTED_WITHIN:g} s; `dask scheduler` starts one",
        ) from error
    if identity["type"] != "Scheduler":
        raise ClusterError(address, "this is not a scheduler; `dask scheduler` says its address")
    return Client(address, timeout=CONNECTED_WITHIN, set_as_default=False)


@cache
def versions_fingerprint() -> str:
    """Compute a fingerprint of the suite's sources and of the versions of RESULT_LIBRARIES.

    The fingerprint is computed once in each process and cached.

    Returns:
        SHA-256 hash in hexadecimal digits. Packages and libraries that are not installed do not
        change the hash.
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


def _perform_on_worker(
    address: str,
    wanted: str,
    shared: SharedState | None,
    work: Callable[..., Result],
    args: tuple[Any, ...],
    named: dict[str, Any],
) -> Result:
    """Execute a task on a worker, if the worker has the same versions as the caller.

    Args:
        address: Address of the scheduler, for the error.
        wanted: Fingerprint of the caller's versions.
        shared: Function and arguments that make the state that tasks share. None means that the
            task gets only its own arguments.
        work: Function of the task.
        args: Positional arguments of `work` after the state.
        named: Named arguments of `work`.

    Returns:
        Result of the task.

    Raises:
        ClusterError: The worker's fingerprint differs from `wanted`.
    """
    if wanted != versions_fingerprint():
        raise ClusterError(address, VERSION_MISMATCH_REASON)
    return perform(shared, work, args, named)


@dataclass(frozen=True)
class WorkArguments:
    """Options that choose where the large work of a command is done: on this machine or a cluster.

    Attributes:
        jobs: Processes or threads; as many as there are processors when left out.
        scheduler: Address of a Dask cluster that does the work instead (docs/cluster.md).
    """

    jobs: Annotated[JobCount, tyro.conf.arg(metavar="N")] = None
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None

    def connect(self) -> Jobs:
        """Return the number of processes, or the cluster after a check of its connection.

        Returns:
            The cluster if `scheduler` is given. Otherwise `jobs`; None means one process for each
            processor.

        Raises:
            UsageError: Both `jobs` and `scheduler` are given.
            ClusterError: The cluster cannot be used.
        """
        if self.scheduler is None:
            return self.jobs
        if self.jobs is not None:
            raise UsageError("--jobs: a cluster has its workers; leave it out with --scheduler")
        return Cluster.connect(self.scheduler)
