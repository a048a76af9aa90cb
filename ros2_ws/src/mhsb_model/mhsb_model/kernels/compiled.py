"""Compilation of kernels by numba, imported when a kernel is first called.

Kernels are compiled by `numba.njit` with fixed options. Kernels release the interpreter lock,
divide as NumPy does, and are cached on disk. If each divisor were checked for 0, as in Python, a
loop that divides would take more than twice as long.

This module also shortens compilation. Numba makes each kernel callable from Python and from C and
optimizes it fully. Most kernels are only called by other kernels. They are linked into the caller
and optimized again there. So each kernel has two dispatchers. Calls by other kernels use the inner
dispatcher, whose versions are lightly optimized and have no wrappers.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

from mhsb_model.kernels.cache_folder import set_kernel_cache_folder

set_kernel_cache_folder()

# Numba reads its settings when it is imported, hence the import here (E402).
from numba import config, njit, types  # noqa: E402
from numba.extending import models, register_model, typeof_impl  # noqa: E402

from mhsb_model.kernels.machine_code import store_machine_code_alone  # noqa: E402
from mhsb_model.kernels.shared_cache import SharedDispatcher  # noqa: E402


class KernelType(types.Dispatcher):
    """Numba type of a kernel that another kernel calls, through the kernel's inner dispatcher."""

    def __init__(self, kernel: Any) -> None:
        """Create the type.

        Args:
            kernel: Instance of `Kernel` that is called.
        """
        super().__init__(kernel.inner.dispatcher)
        self._inner, self._reads = kernel.inner, kernel.reads

    def get_call_type(self, context: Any, args: tuple, kws: dict) -> Any:
        """Resolve a call by another kernel, and compile the called version if necessary.

        Numba calls this method as a hook. A version is the kernel compiled for one combination of
        argument types. The value of a constant argument is ignored, so that one version serves all
        values. If the kernel only reads, all arrays count as read-only. The version is compiled
        with low optimization, since it is optimized again in its caller.

        Args:
            context: Numba's typing context.
            args: Numba types of the positional arguments.
            kws: Numba types of the keyword arguments, by name.

        Returns:
            Numba signature of the version.
        """
        plain = tuple(map(types.unliteral, args))
        if self._reads:
            plain = tuple(map(_as_read_only, plain))
        named = {name: types.unliteral(kind) for name, kind in kws.items()}
        resolve = super().get_call_type
        if plain in self.dispatcher.signatures:
            return resolve(context, plain, named)
        # With level 0, LLVM would not optimize the code even after it is linked into a kernel.
        with _numba_setting("OPT", type(config.OPT)(min(1, config.OPT))):
            return self._inner.run_locked(lambda: resolve(context, plain, named))


register_model(KernelType)(models.OpaqueModel)


def _as_read_only(kind: Any) -> Any:
    """Return the read-only variant of a numba array type, and any other type unchanged."""
    return kind.copy(readonly=True) if isinstance(kind, types.Array) else kind


@cache
def register_kernel_class(kind: type) -> None:
    """Tell numba that instances of a class are kernels, which other kernels may call.

    Args:
        kind: Class `Kernel`; subclasses are included. This module cannot import the class, since
            the class's module imports this module.
    """
    typeof_impl.register(kind)(lambda kernel, _: KernelType(kernel))


def create_dispatcher(
    function: Callable[..., Any], options: Mapping[str, Any], *, is_inner: bool
) -> Any:
    """Create the numba dispatcher of a function, which compiles the function at its first call.

    A compiled version belongs to one combination of argument types. Versions are cached in a
    subfolder for this function alone, if the cache folder can be written. Unless `is_inner`, the
    cache has their machine code without bitcode (`store_machine_code_alone`). Versions release the
    interpreter lock while they run. Divisions by 0 give inf or nan as in NumPy.

    Args:
        function: Python function.
        options: Further options of `numba.njit`.
        is_inner: Whether only other kernels call it, so that no wrapper for Python is compiled.

    Returns:
        `SharedDispatcher`; the function itself if NUMBA_DISABLE_JIT is set.
    """
    if config.DISABLE_JIT:
        return function
    # Without `no_cfunc_wrapper`, numba would also compile a C function for each kernel.
    fixed = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
    dispatcher = njit(**options, **fixed, no_cpython_wrapper=is_inner)(function)
    name = f"{function.__module__}.{function.__qualname__}{'-inner' if is_inner else ''}"
    # Each kernel has its own subfolder. A RuntimeError says that no folder can be written.
    with _numba_setting("CACHE_DIR", str(Path(config.CACHE_DIR) / name)), suppress(RuntimeError):
        dispatcher.enable_caching()
        if not is_inner:
            store_machine_code_alone(dispatcher)
    return SharedDispatcher(dispatcher, is_inner=is_inner)


@contextmanager
def _numba_setting(name: str, value: Any) -> Iterator[None]:
    """Change a setting of numba within the block (context manager).

    Args:
        name: Name of the setting.
        value: Its value within the block.
    """
    before = getattr(config, name)
    setattr(config, name, value)
    try:
        yield
    finally:
        setattr(config, name, before)
