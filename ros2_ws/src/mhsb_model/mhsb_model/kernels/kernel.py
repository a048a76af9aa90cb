"""The decorator of every compiled function of the suite.

    @kernel
    def tip_x(length: FloatArray, q: FloatArray) -> float: ...

numba, whose import takes half a second, is not there before the first kernel is called: most of
what a command does, help and refusals included, calls none.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial, update_wrapper
from threading import Lock
from typing import Any

_making = Lock()


class Kernel:
    """A function that is compiled when it is first called, by Python or by another kernel."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        update_wrapper(self, function)
        self.py_func = function
        self.targetoptions = options

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """The function's result."""
        return self.compiled(*arguments, **named)

    def __getattr__(self, name: str) -> Any:
        """What numba, or a test, asks of it: its type in other kernels, its signatures."""
        if name.startswith("__"):  # Python's own questions need no numba
            raise AttributeError(name)
        return getattr(self.compiled, name)

    @cached_property
    def compiled(self) -> Any:
        """numba's dispatcher of it."""
        from mhsb_model.kernels.compiled import compiled

        with _making:
            return self.__dict__.get("compiled") or compiled(self.py_func, self.targetoptions)


class PlainKernel(Kernel):
    """A kernel for kernels; from Python it is the function itself, which takes arrays, too."""

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """The function's result, by Python."""
        return self.py_func(*arguments, **named)


def kernel(
    function: Callable[..., Any] | None = None,
    *,
    plain: bool = False,
    borrows: bool = False,
    **options: Any,
) -> Any:
    """Compile a function with numba when it is first called.

    plain    only for calls by other kernels
    borrows  it works on arrays that are there, and neither makes nor returns any, nor calls what
             returns any: references to arrays are not counted in it. A call with a tuple of fifty
             arrays takes 0.7 µs longer where they are
    options  as of `numba.njit`
    """
    if function is None:
        return partial(kernel, plain=plain, borrows=borrows, **options)
    return (PlainKernel if plain else Kernel)(function, {**options, "_nrt": not borrows})
