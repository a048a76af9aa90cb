"""Compilation of kernels by numba, imported when a kernel is first called.

It corresponds to `numba.njit` with fixed options: kernels release the interpreter lock, divide as
NumPy does, and are cached on disk. Checking each divisor for 0, as Python does, more than doubles
the time of a loop that divides.

It also shortens compilation. Numba makes each kernel callable from Python and from C and optimizes
it fully. Most kernels are only called by other kernels, into which they are linked and optimized
again. So these calls use a lightly optimized version without the wrappers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cached_property
from typing import Any

from mhsb_model.kernels.cache_folder import set_kernel_cache_folder

set_kernel_cache_folder()

# Numba reads its settings when it is imported, hence the import here (E402).
from numba import config, types  # noqa: E402
from numba.core.registry import CPUDispatcher  # noqa: E402

from mhsb_model.kernels.shared_cache import SharedCache, SharedInnerCache  # noqa: E402


class CompiledKernel(CPUDispatcher):
    """Numba dispatcher of a kernel, with a second dispatcher for calls by other kernels."""

    @cached_property
    def _inner(self) -> CPUDispatcher:
        """Dispatcher of the version that other kernels call, without a Python wrapper."""
        options = self.targetoptions | {"no_cpython_wrapper": True}
        inner = CPUDispatcher(self.py_func, targetoptions=options)
        _enable_disk_cache(inner, SharedInnerCache)
        return inner

    def get_call_template(self, args: tuple, kws: dict) -> tuple:
        """Resolve a call by another kernel to the inner, lightly optimized version (numba's hook).

        Constants among the arguments are replaced by their types, so that one compilation serves
        all values.

        Args:
            args: Numba types of the positional arguments.
            kws: Numba types of the keyword arguments, by name.

        Returns:
            Numba's call template, in the form that `CPUDispatcher.get_call_template` returns.
        """
        plain = {name: types.unliteral(kind) for name, kind in kws.items()}
        with _light_optimization():
            return self._inner.get_call_template(tuple(map(types.unliteral, args)), plain)

    def get_overload(self, signature: Any) -> Any:
        """Return the entry point of the inner version that a call by another kernel resolves to."""
        return self._inner.get_overload(signature)

    def enable_caching(self) -> None:
        """Cache compiled versions of this kernel on disk, if numba finds a folder."""
        _enable_disk_cache(self, SharedCache)


def create_dispatcher(function: Callable[..., Any], options: Mapping[str, Any]) -> Any:
    """Create the numba dispatcher of a function, which compiles it at its first call.

    Args:
        function: Python function.
        options: Options of `numba.njit` besides the fixed ones.

    Returns:
        Dispatcher; the function itself if NUMBA_DISABLE_JIT is set.
    """
    if config.DISABLE_JIT:
        return function
    # Without `no_cfunc_wrapper`, numba would also compile a C function for each kernel.
    fixed = {"nopython": True, "nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy"}
    made = CompiledKernel(function, targetoptions={**options, **fixed})
    made.enable_caching()
    return made


@contextmanager
def _light_optimization() -> Iterator[None]:
    """Context manager that limits numba's optimization level to 1.

    Level 0 would also keep LLVM from optimizing the code after it is linked into another kernel.
    """
    full = config.OPT
    config.OPT = type(full)(min(1, full))
    try:
        yield
    finally:
        config.OPT = full


def _enable_disk_cache(dispatcher: Any, kind: type) -> None:
    """Cache on disk what a dispatcher compiles, unless numba finds no folder for it.

    Args:
        dispatcher: Numba dispatcher, changed in place.
        kind: Class of the cache, `SharedCache` or `SharedInnerCache`.
    """
    with suppress(RuntimeError):
        dispatcher._cache = kind(dispatcher.py_func)
