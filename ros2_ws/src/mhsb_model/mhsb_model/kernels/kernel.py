"""The decorator of every compiled function of the suite.

    @kernel
    def tip_x(length: FloatArray, q: FloatArray) -> float: ...

It is numba's `njit`, of which it fixes the options: kernels release the interpreter, raise where
Python does, and are kept for the next process.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from numba import config, types
from numba.core.registry import CPUDispatcher

from mhsb_model.kernels.cache_folder import use_kernel_cache
from mhsb_model.kernels.shared_cache import SharedCache

use_kernel_cache()


class Kernel(CPUDispatcher):
    """numba's compiled function, compiled less often."""

    def get_call_template(self, args: tuple, kws: dict) -> tuple:
        """What another kernel calls: one compilation for all constants that it may give."""
        plain = {name: types.unliteral(kind) for name, kind in kws.items()}
        return super().get_call_template(tuple(map(types.unliteral, args)), plain)

    def enable_caching(self) -> None:
        """Keep what is compiled, where there is a place to."""
        try:
            self._cache = SharedCache(self.py_func)
        except RuntimeError:  # numba's, for a function without such a place
            return


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function with numba when it is first called; options as of `numba.njit`."""
    if function is None:
        return partial(kernel, **options)
    if config.DISABLE_JIT:
        return function
    # Nobody takes a kernel as a C function, which numba would wrap each as.
    options |= {"nopython": True, "nogil": True, "no_cfunc_wrapper": True}
    compiled = Kernel(function, targetoptions=options)
    compiled.enable_caching()
    return compiled
