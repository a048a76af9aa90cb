"""Cache of compiled kernels on disk, shared by several processes and safe against damaged files.

The first process that misses a kernel in the cache compiles it. Other processes that need it
meanwhile wait, and then load it. So nodes that start together share the work, as do the processes
of `pool`. A damaged file counts as missing.

A compiled version of a kernel belongs to one combination of argument types and has its own file.
Numba reads and writes these files. Each dispatcher has its own folder, to which this module adds a
lock and the hashes of the compiled versions.
"""

import fcntl
import hashlib
import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

from numba import errors

from mhsb_model.kernels.cache_folder import LOGGED_VARIABLE

LONGEST_WAIT = 120.0
"""Longest time to wait for another process's compilation, since that process may have been stopped
[s].
"""

LOCK_NAME = "kernel.lock"
"""Name of the file that a process locks while it compiles or loads the kernel."""

HASHES_NAME = "sha256"
"""Name of the file with the hashes of the compiled versions, in the format of sha256sum."""

Version = TypeVar("Version")

_log = logging.getLogger(__name__)


class SharedDispatcher:
    """Numba dispatcher that shares its compiled versions with other processes."""

    _storing_has_failed = False
    """Whether storing has failed in this process, common to all kernels."""

    def __init__(self, dispatcher: Any, *, is_inner: bool) -> None:
        """Wrap a dispatcher, and delete damaged files of its cache folder.

        A file is damaged if its hash differs from the recorded hash.

        Args:
            dispatcher: Numba dispatcher, changed in place. If it has no cache folder, nothing is
                checked. Unless `is_inner`, its method `compile` then holds the kernel's file lock.
                Numba calls this method only for a new version, so a call of a compiled version
                needs no lock.
            is_inner: Whether only other kernels call the kernel. The lock is then taken by the
                caller, through `run_locked`.
        """
        self.dispatcher = dispatcher
        path = dispatcher.stats.cache_path
        self._folder = Path(path) if path else None
        if self._folder:
            self._check_versions(self._folder)
            if not is_inner:
                compile_version = dispatcher.compile
                dispatcher.compile = lambda types: self.run_locked(lambda: compile_version(types))

    def run_locked(self, compile_version: Callable[[], Version]) -> Version:
        """Run a function that compiles or loads a version, while the kernel's file lock is held.

        A version is the kernel compiled for one combination of argument types.

        If another process holds the lock for longer than LONGEST_WAIT, the function runs without
        it. If the kernel has no cache folder, the function runs once, without a lock, and its
        errors are raised. Otherwise, if the function fails, it runs once more:

        - If the version was compiled but could not be stored, this is logged. The second run finds
          the version in memory.
        - If a stored version could not be read, all stored versions are deleted. The second run
          compiles.

        Errors of numba's compiler and all errors of the second run are raised at once. After a
        success, the hashes of all stored versions are recorded if this dispatcher has compiled any.

        Args:
            compile_version: Function without arguments that compiles or loads a version.

        Returns:
            Result of the function.
        """
        if not self._folder:
            return compile_version()
        known_count = len(self.dispatcher.signatures)
        with _locked(self._folder / LOCK_NAME):
            try:
                result = compile_version()
            except errors.NumbaError:
                raise
            except Exception as error:  # unpickling raises anything
                if len(self.dispatcher.signatures) > known_count:  # compiled, but not stored
                    self.log_failed_storing(error)
                else:
                    _delete_damaged([*self._folder.glob("*.nb?")], type(error).__name__)
                result = compile_version()
            if self.dispatcher.stats.cache_misses:
                self._store_hashes(self._folder)
        return result

    def log_failed_storing(self, error: Exception) -> None:
        """Log that compiled kernels cannot be kept on disk, at most once in a process.

        Nothing is logged if `set_kernel_cache_folder` has already warned about the cache folder, in
        this process or in a parent of it.

        Args:
            error: Error that has prevented the storing.
        """
        if not SharedDispatcher._storing_has_failed and not os.environ.get(LOGGED_VARIABLE):
            _log.warning("compiled kernels cannot be kept in %s: %s", self._folder, error)
        SharedDispatcher._storing_has_failed = True

    def _check_versions(self, folder: Path) -> None:
        """Delete the compiled versions of the kernel whose files are damaged.

        A version is the kernel compiled for one combination of argument types. A file is damaged if
        its hash differs from the recorded hash. A version without a recorded hash is trusted, and
        its hash is recorded.

        Args:
            folder: Cache folder of this kernel.
        """
        hashes = {}
        with suppress(OSError):
            lines = (folder / HASHES_NAME).read_text().splitlines()
            hashes = {name: digest for digest, _, name in (line.partition("  ") for line in lines)}
        with suppress(OSError):  # another process has deleted a file
            versions = {file: _hash_file(file) for file in folder.glob("*.nbc")}
            damaged = [file for file, has in versions.items() if hashes.get(file.name, has) != has]
            _delete_damaged(damaged, "the hash does not fit")
            if any(file.name not in hashes for file in versions):
                self._store_hashes(folder)

    def _store_hashes(self, folder: Path) -> None:
        """Record the hashes of all compiled versions in the kernel's cache folder.

        If the file cannot be written, this is logged.

        Args:
            folder: Cache folder of this kernel.
        """
        new = folder / f"{HASHES_NAME}.{os.getpid()}"
        try:
            with new.open("w") as file:
                file.writelines(
                    f"{_hash_file(each)}  {each.name}\n" for each in folder.glob("*.nbc")
                )
            new.replace(folder / HASHES_NAME)
        except OSError as error:
            self.log_failed_storing(error)


def _hash_file(file: Path) -> str:
    """Return the SHA-256 hash of a file's content in hexadecimal digits."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _delete_damaged(files: Sequence[Path], reason: str) -> None:
    """Delete damaged files of one kernel and log the reason.

    Args:
        files: Damaged files in one folder. If there are none, nothing is logged.
        reason: Reason in a few words.

    Raises:
        OSError: A file exists and cannot be deleted.
    """
    for file in files:
        file.unlink(missing_ok=True)
    if files:
        _log.warning(
            "a compiled kernel in %s is damaged (%s) and is compiled anew", files[0].parent, reason
        )


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Context manager that locks a file against other processes.

    It waits for the lock for at most LONGEST_WAIT seconds. After that time, or if the file cannot
    be opened, the block runs without the lock.

    Args:
        path: Lock file, created if it is missing.
    """
    end = time.monotonic() + LONGEST_WAIT
    try:
        descriptor = os.open(path, os.O_CREAT | os.O_RDWR, 0o600)
    except OSError:
        yield
        return
    try:
        while not _try_lock(descriptor) and time.monotonic() < end:
            time.sleep(0.02)
        yield
    finally:
        os.close(descriptor)


def _try_lock(descriptor: int) -> bool:
    """Lock a file for this process, without waiting if another process has locked it.

    Args:
        descriptor: Descriptor of the open file.

    Returns:
        True if the file is locked now. False if another process has it, or if locking fails.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
