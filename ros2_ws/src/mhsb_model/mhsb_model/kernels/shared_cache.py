"""numba's cache of one kernel, for several processes at once and for a disk that does not hold.

Who misses a kernel in the cache compiles it, while whoever misses it too waits and then loads it:
nodes that start together, and the processes of `pool`, share the work without knowing of each
other. A file that is damaged counts as missing.
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

LONGEST_WAIT = 120.0
"""Time to wait for another process's compilation; it may have been stopped [s]."""

DIGEST = 32  # bytes

_log = logging.getLogger(__name__)


class _MachineCode(CompileResultCacheImpl):
    """Files of what is called from Python.

    numba keeps a kernel's bitcode beside its machine code, to link it into others, and whoever
    loads it reads all of that. Others are linked with the inner kernel: here the names will do by
    which the machine code is found.
    """

    def reduce(self, compiled: Any) -> tuple:
        """What is kept of it."""
        (name, kind, (code, _)), *others = super().reduce(compiled)
        names = compiled.fndesc.llvm_func_name, compiled.fndesc.llvm_cpython_wrapper_name
        empty = "".join(f'define void @"{each}"() {{ ret void }}\n' for each in names)
        return ((name, kind, (code, parse_assembly(empty).as_bitcode())), *others)


class SharedCache(FunctionCache):
    """What is there of one kernel, by signature."""

    _impl_class = _MachineCode

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file.__class__ = _CheckedFile
        self._lock: int | None = None

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """The compiled kernel; None where the caller is to compile and to save it."""
        found = self._load(signature, target_context)
        if found is None and self._lock is None:
            self._lock = _locked(Path(self._cache_file._index_path).with_suffix(".lock"))
            found = self._load(signature, target_context)
            if found is not None:  # compiled by whoever had the lock
                self._unlock()
        return found

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep what has been compiled; a disk that is full costs a compilation next time."""
        try:
            super().save_overload(signature, compiled)
        except OSError as error:
            _log.warning("a compiled kernel cannot be kept in %s: %s", self.cache_path, error)
        finally:
            self._unlock()

    def _load(self, signature: Any, target_context: Any) -> Any:
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
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


class _InnerFiles(CompileResultCacheImpl):
    """Files beside those of the same function as it is called from Python."""

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        return f"inner-{super().get_filename_base(fullname, abiflags)}"


class SharedInnerCache(SharedCache):
    """What is there of one kernel for other kernels that call it."""

    _impl_class = _InnerFiles


class _CheckedFile(IndexDataCacheFile):
    """Files of machine code with their hash: damaged code must not run."""

    def _save_data(self, name: str, data: Any) -> None:
        content = self._dump(data)
        with self._open_for_write(self._data_path(name)) as file:
            file.write(hashlib.sha256(content).digest())
            file.write(content)

    def _load_data(self, name: str) -> Any:
        content = Path(self._data_path(name)).read_bytes()
        if hashlib.sha256(content[DIGEST:]).digest() != content[:DIGEST]:
            raise ValueError("the hash does not fit")
        return pickle.loads(content[DIGEST:])


def _locked(path: Path) -> int | None:
    """Descriptor of a file that this process has locked; None where that cannot be."""
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
