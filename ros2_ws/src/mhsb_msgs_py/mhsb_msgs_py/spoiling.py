"""Messages spoilt at random, of any type: what a strange or broken sender may send. For tests.

A spoilt message still is one of its type, so that it can be published; `torn` bytes need not be
even that.
"""

from __future__ import annotations

import copy
import math
import random
from collections.abc import MutableSequence
from typing import Any

FLOATS = (
    0.0, -0.0, 5e-324, -2.3e-308, 1e-9, 1.0, -1.0, math.pi, 1e6, -1e12, 1e154, 1.7e308, -1.7e308,
    math.nan, math.inf, -math.inf,
)  # fmt: skip
WHOLE = (0, 1, -1, 255, 10**9, 2**31 - 1, -(2**31), 2**32 - 1)
TEXTS = ("", " ", "map", "base_link", "joint_1", "joint_9", "actuator_1", "é\u2028𝛑", "x" * 2000)
LONGEST = 2000
"""Elements up to which a sequence is lengthened."""

RANGES = {
    "uint8": (0, 2**8 - 1),
    "octet": (0, 2**8 - 1),
    "int32": (-(2**31), 2**31 - 1),
    "uint32": (0, 2**32 - 1),
}
"""Of whole numbers by type; messages hold others, too, which cannot be published."""


def spoilt(message: Any, source: random.Random, times: int = 1) -> Any:
    """A copy of a message with some of its numbers, texts or sequences changed."""
    changed = copy.deepcopy(message)
    for _ in range(times):
        _spoil_somewhere(changed, source)
    return changed


def torn(data: bytes, source: random.Random) -> bytes:
    """Serialized bytes with some flipped, cut off, doubled or put in front."""
    changed = bytearray(data)
    for _ in range(source.randint(1, 12)):
        if changed:
            changed[source.randrange(len(changed))] = source.randrange(256)
    match source.randrange(4):
        case 0:
            del changed[source.randrange(len(changed) + 1) :]
        case 1:
            changed *= 2
        case 2:
            changed = bytearray(source.randbytes(source.randint(1, 8))) + changed
        case _:
            pass
    return bytes(changed)


def _spoil_somewhere(message: Any, source: random.Random) -> None:
    """Change one field, somewhere in a message."""
    name = source.choice(list(message.get_fields_and_field_types()))
    value, kind = getattr(message, name), message.get_fields_and_field_types()[name]
    if hasattr(value, "get_fields_and_field_types"):
        _spoil_somewhere(value, source)
    elif isinstance(value, MutableSequence):
        _spoil_sequence(value, kind.removeprefix("sequence<").removesuffix(">"), source)
    else:
        setattr(message, name, _other(value, kind, source))


def _spoil_sequence(values: MutableSequence[Any], kind: str, source: random.Random) -> None:
    """Change an element, or how many there are, or their order."""
    what = source.randrange(6)
    if len(values) == 0:
        return
    if what <= 2:
        index = source.randrange(len(values))
        if hasattr(values[index], "get_fields_and_field_types"):
            _spoil_somewhere(values[index], source)
        else:
            values[index] = _other(values[index], kind, source)
    elif what == 3:
        del values[source.randrange(len(values)) :]
    elif what == 4 and len(values) < LONGEST:
        values.extend(values[: source.randint(1, len(values))])
    else:
        values.reverse()


def _other(value: Any, kind: str, source: random.Random) -> Any:
    """Another value of the same type, which ROS calls `kind`."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, bytes):
        return bytes([source.randrange(256)])
    if isinstance(value, int):
        lowest, highest = RANGES[kind]
        return min(highest, max(lowest, source.choice((*WHOLE, value + 1, value - 1))))
    if isinstance(value, float):
        return source.choice((*FLOATS, value * (1.0 + 1e-7), -value, source.uniform(-4.0, 4.0)))
    return source.choice((*TEXTS, value + "_"))
