"""Random damage to messages of any type, as a faulty sender may send them.

A damaged message still is one of its type, so that it can be published. Bytes from `damage_bytes`
need not be even that.
"""

from __future__ import annotations

import copy
import math
import random
from collections.abc import MutableSequence
from typing import Any

SPOILED_FLOATS = (
    0.0, -0.0, 5e-324, -2.3e-308, 1e-9, 1.0, -1.0, math.pi, 1e6, -1e12, 1e154, 1.7e308, -1.7e308,
    math.nan, math.inf, -math.inf,
)  # fmt: skip
"""Numbers that replace a floating-point number."""

SPOILED_INTEGERS = (0, 1, -1, 255, 10**9, 2**31 - 1, -(2**31), 2**32 - 1)
"""Numbers that replace an integer, limited to its range."""

SPOILED_TEXTS = (
    "",
    " ",
    "map",
    "base_link",
    "joint_1",
    "joint_9",
    "actuator_1",
    "é\u2028𝛑",
    "x" * 2000,
)
"""Texts that replace a text."""

MAX_SEQUENCE_LENGTH = 2000
"""Length from which on a sequence is not lengthened."""

INTEGER_RANGES = {
    "uint8": (0, 2**8 - 1),
    "octet": (0, 2**8 - 1),
    "int32": (-(2**31), 2**31 - 1),
    "uint32": (0, 2**32 - 1),
}
"""Least and greatest value of an integer by ROS type.

Messages accept others, but cannot be published with them.
"""


def damage_message(message: Any, source: random.Random, times: int = 1) -> Any:
    """Return a copy of a message with random changes to its numbers, texts or sequences.

    Args:
        message: The message.
        source: Source of random numbers.
        times: Number of changes.

    Returns:
        The damaged copy.
    """
    changed = copy.deepcopy(message)
    for _ in range(times):
        _damage_one_field(changed, source)
    return changed


def damage_bytes(data: bytes, source: random.Random) -> bytes:
    """Return serialized bytes with random damage.

    1 to 12 bytes at random places are replaced by random ones. Then one of four things happens,
    with equal probability: the end is cut off at a random place, a copy of all bytes is appended, 1
    to 8 random bytes are put in front, or nothing.

    Args:
        data: Bytes of a message.
        source: Source of random numbers.

    Returns:
        The damaged bytes.
    """
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


def _damage_one_field(message: Any, source: random.Random) -> None:
    """Change one random field of a message in place.

    If the field is a nested message, one random field of the nested message is changed. If it is a
    sequence, `_damage_sequence` changes it.

    Args:
        message: The message.
        source: Source of random numbers.
    """
    name = source.choice(list(message.get_fields_and_field_types()))
    value, kind = getattr(message, name), message.get_fields_and_field_types()[name]
    if hasattr(value, "get_fields_and_field_types"):
        _damage_one_field(value, source)
    elif isinstance(value, MutableSequence):
        _damage_sequence(value, kind.removeprefix("sequence<").removesuffix(">"), source)
    else:
        setattr(message, name, _choose_other_value(value, kind, source))


def _damage_sequence(values: MutableSequence[Any], kind: str, source: random.Random) -> None:
    """Change an element, the length or the order of a sequence in place.

    With a probability of one half, a random element is changed. Otherwise the end is cut off, some
    of the first elements are appended again, or the order is reversed. An empty sequence stays
    empty.

    Args:
        values: The sequence.
        kind: ROS type of its elements.
        source: Source of random numbers.
    """
    what = source.randrange(6)
    if len(values) == 0:
        return
    if what <= 2:
        index = source.randrange(len(values))
        if hasattr(values[index], "get_fields_and_field_types"):
            _damage_one_field(values[index], source)
        else:
            values[index] = _choose_other_value(values[index], kind, source)
    elif what == 3:
        del values[source.randrange(len(values)) :]
    elif what == 4 and len(values) < MAX_SEQUENCE_LENGTH:
        values.extend(values[: source.randint(1, len(values))])
    else:
        values.reverse()


def _choose_other_value(value: Any, kind: str, source: random.Random) -> Any:
    """Return a random value of the same Python type, which may by chance be the same value.

    Args:
        value: The value to replace.
        kind: ROS type of the value, which gives the range of an integer.
        source: Source of random numbers.

    Returns:
        The inverse of a Boolean, or a random byte for a bytes value. For a number or a text, one of
        the module's values for its type, or the old value changed: text with "_", integer ± 1
        (limited to the range of its ROS type), float negated or 1e-7 of its value larger. A float
        may also be replaced by a random one from −4 to 4.
    """
    if isinstance(value, bool):
        return not value
    if isinstance(value, bytes):
        return bytes([source.randrange(256)])
    if isinstance(value, int):
        lowest, highest = INTEGER_RANGES[kind]
        return min(highest, max(lowest, source.choice((*SPOILED_INTEGERS, value + 1, value - 1))))
    if isinstance(value, float):
        return source.choice(
            (*SPOILED_FLOATS, value * (1.0 + 1e-7), -value, source.uniform(-4.0, 4.0))
        )
    return source.choice((*SPOILED_TEXTS, value + "_"))
