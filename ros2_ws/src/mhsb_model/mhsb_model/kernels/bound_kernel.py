"""Kernels with bound arguments.

A kernel may be called a thousand times a second, with many arrays whose types never change. It then
spends most of each call on determining these types. With bound arguments, the types are determined
only once.
"""

from collections.abc import Callable
from functools import partial
from typing import Any


def bind_kernel(kernel: Any, *arguments: Any, integer_count: int = 0) -> Callable[..., Any]:
    """Compile a kernel for the types of its first arguments, and bind these arguments.

    Calls of the result skip numba's type dispatch. Bound arrays are not copied, so later changes of
    their contents take effect. Bound scalars are fixed.

    Args:
        kernel: Kernel to bind.
        *arguments: First arguments of the kernel, which are bound.
        integer_count: Number of the kernel's remaining arguments, which must be integers (int64).

    Returns:
        Function that takes the remaining integer arguments and returns the kernel's result.
    """
    from numba import int64, typeof

    compiled = kernel.compile((*map(typeof, arguments), *[int64] * integer_count))
    return partial(compiled, *arguments)
