"""numba's side of a kernel: what `kernel` has in its place until it is first called.

It is numba's `njit`, of which it fixes the options: kernels release the interpreter, divide as
NumPy does, and are kept for the next process. (To look for a divisor of 0, as Python does, more
than doubles the time of a loop that divides.) And it compiles them in less time: numba makes each
kernel ready to be called from Python and from C, and optimizes it fully, though most are only
called by other kernels, into which they are linked and there optimized once more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cached_property
from typing import Any

from mhsb_model.kernels.cache_folder import use_kernel_cache

use_kernel_cache()

# Below and not at the top (E402): numba reads its settings when it is imported.
from numba import config, types  # noqa: E402
from numba.core.registry import CPUDispatcher  # noqa: E402

from mhsb_model.kernels.shared_cache import SharedCache, SharedInnerCache  # noqa: E402


class CompiledKernel(CPUDispatcher):
    """A compiled function; for other kernels that call it, another one of the same source."""

    @cached_property
    def _inner(self) -> CPUDispatcher:
        """What other kernels call: without a way in from Python, lightly optimized."""
        options = self.targetoptions | {"no_cpython_wrapper": True}
        inner = CPUDispatcher(self.py_func, targetoptions=options)
        _keep(inner, SharedInnerCache)
        return inner

    def get_call_template(self, args: tuple, kws: dict) -> tuple:
        """For a call by another kernel; one compilation serves all constants that it may give."""
        plain = {name: types.unliteral(kind) for name, kind in kws.items()}
        with _light_optimization():
            return self._inner.get_call_template(tuple(map(types.unliteral, args)), plain)

    def get_overload(self, signature: Any) -> Any:
        """What such a call leads to."""
        return self._inner.get_overload(signature)

    def enable_caching(self) -> None:
        """Keep what is compiled, where there is a place to."""
        _keep(self, SharedCache)


def compiled(function: Callable[..., Any], options: Mapping[str, Any]) -> Any:
    """A function as numba compiles it when it is called; the function where numba is told not to.

    options  as of `numba.njit`
    """
    if config.DISABLE_JIT:
        return function
    # Nobody takes a kernel as a C function, which numba would wrap each as.
    fixed = {"nopython": True, "nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy"}
    made = CompiledKernel(function, targetoptions={**options, **fixed})
    made.enable_caching()
    return made


@contextmanager
def _light_optimization() -> Iterator[None]:
    """Of what is compiled in the block; without any, LLVM would not look into it later either."""
    full = config.OPT
    config.OPT = type(full)(min(1, full))
    try:
        yield
    finally:
        config.OPT = full


def _keep(dispatcher: Any, kind: type) -> None:
    """Keep what a dispatcher compiles, unless numba finds no place for it."""
    with suppress(RuntimeError):
        dispatcher._cache = kind(dispatcher.py_func)
