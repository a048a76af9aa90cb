"""Decorator of all compiled functions of the suite.

    @kernel
    def tip_x(length: FloatArray, q: FloatArray) -> float: ...

Numba is imported when the first kernel is called, since its import takes half a second. Many
commands call no kernel, for example if they print their help or refuse their arguments.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial, update_wrapper
from threading import Lock
from typing import Any

_making = Lock()
"""Held while a kernel's dispatcher is created, so that each kernel gets only one."""


class Kernel:
    """Function that is compiled at its first call, by Python or by another kernel."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        """Wrap a function without importing numba or compiling anything.

        Args:
            function: Python function, whose name and docstring the kernel takes over.
            options: Options of `numba.njit`.
        """
        update_wrapper(self, function)
        self.py_func = function
        self.targetoptions = options

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call the compiled function, compiling it first if necessary."""
        return self.compiled(*arguments, **named)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the numba dispatcher, such as its numba type or its signatures.

        Numba is imported for it, unless the name begins with two underscores.

        Args:
            name: Name of the attribute.

        Returns:
            Value of the attribute.

        Raises:
            AttributeError: The name begins with two underscores, or the dispatcher has no such
                attribute.
        """
        if name.startswith("__"):  # Python's own attributes must not import numba
            raise AttributeError(name)
        return getattr(self.compiled, name)

    @cached_property
    def compiled(self) -> Any:
        """Numba dispatcher of the function, created at the first access."""
        from mhsb_model.kernels.compiled import create_dispatcher

        with _making:
            return self.__dict__.get("compiled") or create_dispatcher(
                self.py_func, self.targetoptions
            )


class PlainKernel(Kernel):
    """Kernel that is compiled only for other kernels; from Python the plain function is called."""

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call the function itself, uncompiled; its arguments may then also be arrays."""
        return self.py_func(*arguments, **named)


def kernel(
    function: Callable[..., Any] | None = None,
    *,
    plain: bool = False,
    borrows: bool = False,
    **options: Any,
) -> Any:
    """Decorate a function so that numba compiles it at its first call.

    It can be used with or without arguments: `@kernel` or `@kernel(borrows=True)`.

    Args:
        function: Function to decorate; None if the decorator is used with arguments.
        plain: Compile only for calls by other kernels. Calls from Python run the plain function.
        borrows: The function works on existing arrays: it creates and returns none, and calls no
            kernel that returns one. Numba then does not count references to arrays, which saves
            0.7 µs for a call with a tuple of fifty arrays.
        **options: Further options of `numba.njit`.

    Returns:
        The `Kernel`, or the decorator if `function` is None.
    """
    if function is None:
        return partial(kernel, plain=plain, borrows=borrows, **options)
    return (PlainKernel if plain else Kernel)(function, {**options, "_nrt": not borrows})
