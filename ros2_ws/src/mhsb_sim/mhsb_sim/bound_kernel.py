"""Kernels with their arguments bound.

A kernel that is called with many arrays a thousand times a second spends most of its call on
finding out their types, though these never change.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any


def bind(kernel: Any, *arguments: Any, integers: int = 0) -> Callable[..., Any]:
    """The kernel with its first arguments, which may change in value but not in type or place.

    What it returns takes the others, which are `integers` integers.
    """
    from numba import int64, typeof

    compiled = kernel.compile((*map(typeof, arguments), *[int64] * integers))
    return partial(compiled, *arguments)
