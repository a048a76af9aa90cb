"""Cache of compiled kernels on disk, shared by several processes and safe against damaged files.

The first process that misses a kernel in the cache compiles it. Other processes that miss it
meanwhile wait and then load it. So nodes that start together, and the processes of `pool`, share
the work without knowing of each other. A damaged file counts as missing.
"""

from __future__ import annotations

import fcntl
import hashlib
import logging
import os
import pickle
import time
from pathlib import Path
from typing import Any

from llvmlite.binding import parse_assembly
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile

from mhsb_model.kernels.cache_folder import LOGGED_VARIABLE

LONGEST_WAIT = 120.0
"""Longest time to wait for another process's compilation, which may have been stopped [s]."""

DIGEST_SIZE = 32
"""Length of the SHA-256 hash before the content of a file [B]."""

_log = logging.getLogger(__name__)


class _MachineCode(CompileResultCacheImpl):
    """File format of a kernel that is called from Python.

    Numba stores a kernel's LLVM bitcode beside its machine code, to link it into other kernels, and
    every load reads both. Other kernels are linked with the inner version instead. So this format
    stores only empty functions with the names by which the machine code is found.
    """

    def reduce(self, compiled: Any) -> tuple:
        """Return the data to store for a compiled kernel, with empty functions as its bitcode.

        Args:
            compiled: Numba's compile result.

        Returns:
            Tuple in the format of numba's `CompileResult._reduce`.
        """
        (name, kind, (code, _)), *others = super().reduce(compiled)
        names = compiled.fndesc.llvm_func_name, compiled.fndesc.llvm_cpython_wrapper_name
        empty = "".join(f'define void @"{each}"() {{ ret void }}\n' for each in names)
        return ((name, kind, (code, parse_assembly(empty).as_bitcode())), *others)


class SharedCache(FunctionCache):
    """Cache of one kernel's compiled versions, by signature."""

    _impl_class = _MachineCode

    _storing_has_failed = False
    """Whether storing has failed in this process, common to all kernels."""

    def __init__(self, function: Any) -> None:
        """Create the cache of a kernel, with checked files and without holding its lock.

        Args:
            function: Python function of the kernel.

        Raises:
            RuntimeError: Numba finds no folder for the files.
        """
        super().__init__(function)
        self._cache_file.__class__ = _CheckedFile
        self._lock: int | None = None

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Load a compiled version; wait if another process is compiling this kernel.

        If the version is missing, this process takes the kernel's lock and keeps it. The caller
        must then compile the kernel and call `save_overload`, which releases the lock. If another
        process holds the lock for longer than LONGEST_WAIT, the caller compiles without it.

        Args:
            signature: Numba signature of the version.
            target_context: Numba's target context.

        Returns:
            Compile result; None if the caller must compile.
        """
        found = self._load(signature, target_context)
        if found is None and self._lock is None:
            self._lock = _acquire_lock(Path(self._cache_file._index_path).with_suffix(".lock"))
            found = self._load(signature, target_context)
            if found is not None:  # compiled by the process that had the lock
                self._unlock()
        return found

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Store a compiled version, and release the lock.

        If the disk is full or not writable, this is logged and nothing is raised. From then on this
        process does not try to store any kernel.

        Args:
            signature: Numba signature of the version.
            compiled: Numba's compile result.
        """
        try:
            if not SharedCache._storing_has_failed:
                super().save_overload(signature, compiled)
        except OSError as error:
            SharedCache._storing_has_failed = True
            if not os.environ.get(LOGGED_VARIABLE):
                _log.warning("compiled kernels cannot be kept in %s: %s", self.cache_path, error)
        finally:
            self._unlock()

    def _load(self, signature: Any, target_context: Any) -> Any:
        """Load a compiled version from disk.

        If its file is damaged, this is logged and the index of the kernel is deleted.

        Args:
            signature: Numba signature of the version.
            target_context: Numba's target context.

        Returns:
            Compile result; None if it is missing or damaged.
        """
        try:
            return super().load_overload(signature, target_context)
        except Exception as error:  # unpickling raises anything
            _log.warning(
                "a compiled kernel in %s is damaged (%s) and is compiled anew",
                self.cache_path, type(error).__name__,
            )  # fmt: skip
            Path(self._cache_file._index_path).unlink(missing_ok=True)
            return None

    def _unlock(self) -> None:
        """Release the lock of this kernel if this process holds it."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


class _InnerFiles(CompileResultCacheImpl):
    """File format of a kernel's inner version, with the prefix `inner-` in its file names."""

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        return f"inner-{super().get_filename_base(fullname, abiflags)}"


class SharedInnerCache(SharedCache):
    """Cache of the versions of one kernel that other kernels call."""

    _impl_class = _InnerFiles


class _CheckedFile(IndexDataCacheFile):
    """Cache files that begin with a hash of their content, so that damaged code is never run."""

    def _save_data(self, name: str, data: Any) -> None:
        """Write an object to a file, preceded by the SHA-256 hash of its content.

        Args:
            name: Name of the file in the cache folder.
            data: Object to store, which numba pickles.
        """
        content = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(hashlib.sha256(content).digest())
            file.write(content)

    def _load_data(self, name: str) -> Any:
        """Read an object from a file after checking its hash.

        Args:
            name: Name of the file in the cache folder.

        Returns:
            The unpickled object.

        Raises:
            ValueError: The hash does not match the content.
        """
        content = Path(self._data_path(name)).read_bytes()
        if hashlib.sha256(content[DIGEST_SIZE:]).digest() != content[:DIGEST_SIZE]:
            raise ValueError("the hash does not fit")
        return pickle.loads(content[DIGEST_SIZE:])


def _acquire_lock(path: Path) -> int | None:
    """Lock a file for this process; wait at most LONGEST_WAIT while another process has it.

    Args:
        path: Lock file, created if it is missing.

    Returns:
        Open file descriptor, whose closing releases the lock. None if the file cannot be opened or
        stays locked.
    """
    end = time.monotonic() + LONGEST_WAIT
    try:
        descriptor = os.open(path, os.O_CREAT | os.O_RDWR, 0o600)
    except OSError:
        return None
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return descriptor
        except OSError:
            if time.monotonic() > end:
                os.close(descriptor)
                return None
            time.sleep(0.02)
