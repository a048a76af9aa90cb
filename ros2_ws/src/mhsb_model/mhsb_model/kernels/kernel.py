"""Decorator of all compiled functions of the suite.

    @kernel
    def tip_x(length: FloatArray, q: FloatArray) -> float: ...

Numba is imported when the first kernel is called, since its import takes half a second. A command
that prints its help or refuses its arguments calls no kernel.
"""

from collections.abc import Callable
from functools import cached_property, partial, update_wrapper
from threading import Lock
from typing import Any

_making = Lock()
"""Lock that is held while a dispatcher is created, so that it is created only once."""


class Kernel:
    """Function that is compiled at its first call, by Python or by another kernel."""

    def __init__(
        self, function: Callable[..., Any], options: dict[str, Any], *, reads: bool = False
    ) -> None:
        """Wrap a function without importing numba or compiling anything.

        Args:
            function: Python function. The kernel gets its name and docstring.
            options: Options of `numba.njit`.
            reads: True if the function writes to no argument.
        """
        update_wrapper(self, function)
        self.reads = reads
        self.py_func = function
        self.targetoptions = options
        self._run: Callable[..., Any] = self._run_first

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call the compiled function; the first call for new argument types compiles it.

        A version is the code for one combination of argument types. It is compiled, or loaded from
        the disk, while the kernel's file lock is held. So other processes wait instead of compiling
        the version too. If it cannot be stored on disk, this is logged, and it is used from memory.
        """
        return self._run(*arguments, **named)

    def _run_first(self, *arguments: Any, **named: Any) -> Any:
        """Run the first call; later calls then go straight to numba's dispatcher.

        If NUMBA_DISABLE_JIT is set, the plain function runs instead.

        Args:
            *arguments: Positional arguments of the call.
            **named: Keyword arguments of the call.

        Returns:
            Result of the function.
        """
        compiled = self.compiled
        self._run = self.py_func if compiled is self.py_func else compiled.dispatcher
        return self._run(*arguments, **named)

    @cached_property
    def compiled(self) -> Any:
        """Dispatcher for calls from Python, created at the first access."""
        return self._create_dispatcher("compiled")

    @cached_property
    def inner(self) -> Any:
        """Dispatcher for calls by other kernels, created at the first access."""
        return self._create_dispatcher("inner")

    def _create_dispatcher(self, name: str) -> Any:
        """Create one of the two dispatchers, or return it if another thread has just created it.

        Args:
            name: Name of the property that keeps the dispatcher, `compiled` (for calls from Python)
                or `inner` (for calls by other kernels).

        Returns:
            Dispatcher; the plain function if NUMBA_DISABLE_JIT is set.
        """
        from mhsb_model.kernels.compiled import create_dispatcher, register_kernel_class

        register_kernel_class(Kernel)
        with _making:
            return self.__dict__.get(name) or create_dispatcher(
                self.py_func, self.targetoptions, is_inner=name == "inner"
            )

    def compile(self, types: tuple) -> Any:
        """Compile the kernel for calls from Python.

        Args:
            types: Numba types of all arguments.

        Returns:
            Entry point of the compiled version, callable from Python.
        """
        return self.compiled.dispatcher.compile(types)

    @property
    def signatures(self) -> list:
        """Argument types for which the kernel can be called from Python without compilation."""
        return self.compiled.dispatcher.signatures


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
    reads: bool = False,
    **options: Any,
) -> Any:
    """Decorate a function so that numba compiles it at its first call.

    The decorator is written with or without arguments: `@kernel` or `@kernel(borrows=True)`.

    Args:
        function: Function to decorate; None if the decorator is written with arguments.
        plain: Compile the function only for calls by other kernels. Calls from Python then run the
            plain Python function.
        borrows: Promise that the function only works on existing arrays: it creates and returns no
            array, and calls no kernel that returns one. Numba then does not count references to
            arrays, which saves 0.7 µs for a call with a tuple of fifty arrays.
        reads: Promise that the function neither writes to an argument nor returns one. Other
            kernels then share one version of it for writable and read-only arrays.
        **options: Further options of `numba.njit`. `forceinline=True` compiles a function once and
            copies its code into each caller. `inline="always"` compiles it again at each call,
            which pays for functions that are called once.

    Returns:
        The `Kernel`, or the decorator if `function` is None.
    """
    if function is None:
        return partial(kernel, plain=plain, borrows=borrows, reads=reads, **options)
    kind = PlainKernel if plain else Kernel
    return kind(function, {**options, "_nrt": not borrows}, reads=reads)
