"""Kernels with bound arguments.

A kernel that is called with many arrays a thousand times a second spends most of each call on
determining their types, though these never change.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any


def bind_kernel(kernel: Any, *arguments: Any, integer_count: int = 0) -> Callable[..., Any]:
    """Bind the first arguments of a kernel and compile it for their types.

    Arrays are not copied, so later changes of their contents count. The result is compiled for the
    arguments' present types alone, and its calls skip numba's type dispatch.

    Args:
        kernel: Kernel to bind.
        *arguments: Its first arguments.
        integer_count: Number of its remaining arguments, all of which are integers (int64).

    Returns:
        Function that takes the remaining integer arguments.
    """
    from numba import int64, typeof

    compiled = kernel.compile((*map(typeof, arguments), *[int64] * integer_count))
    return partial(compiled, *arguments)
