"""Check that bytes are a message of a type, before the middleware decodes them.

A middleware allocates an array by its stated length before it looks at how many bytes there are.
Every length is therefore first compared with the bytes that are left (OMG DDS-XTypes, PLAIN_CDR).
"""

from __future__ import annotations

from typing import Any

from rosbags.interfaces import Nodetype

from mhsb_msgs_py.errors import MessageError
from mhsb_tools.recording.bag_format import get_typestore_jazzy

BYTE_ORDERS = {b"\x00\x00": "big", b"\x00\x01": "little"}
"""Byte order of a message by its first two bytes, the encapsulation identifier."""
ENCAPSULATION_SIZE = 4
"""Bytes of the encapsulation header, from whose end alignment is counted."""
PRIMITIVE_SIZES = {
    "bool": 1, "byte": 1, "char": 1, "octet": 1, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2,
    "int32": 4, "uint32": 4, "float32": 4, "int64": 8, "uint64": 8, "float64": 8,
}  # fmt: skip
"""Size of each primitive type [bytes]."""


def check_structure(type_name: str, data: bytes) -> None:
    """Check that bytes can be a complete CDR message of a ROS type.

    Two things are checked: the first two bytes are a known byte order, and all fields of the
    message fit into the bytes. The lengths of arrays and texts are those that the bytes themselves
    state. Values are not checked. Bytes after the end of the message are allowed.

    Args:
        type_name: ROS type, such as `std_msgs/msg/String`; it must be known to this package.
        data: Serialized message with its encapsulation header of 4 bytes.

    Raises:
        MessageError: The bytes are not such a message.
    """
    order = BYTE_ORDERS.get(data[:2])
    if order is None or len(data) < ENCAPSULATION_SIZE:
        raise _make_structure_error(type_name, data)
    _CdrPosition(type_name, data, order).skip_message(type_name)


class _CdrPosition:
    """A read position in a serialized message that is moved past one field after the other."""

    def __init__(self, type_name: str, data: bytes, order: str) -> None:
        """Set the read position to the first field, directly after the encapsulation header.

        Args:
            type_name: ROS type of the whole message, for error messages.
            data: The serialized message.
            order: Byte order, `big` or `little`.
        """
        self._type_name = type_name
        self._data = data
        self._order: Any = order
        self._at = ENCAPSULATION_SIZE

    def skip_message(self, type_name: str) -> None:
        """Move the read position past all fields of a message, or of a nested message.

        Args:
            type_name: ROS type of the message.

        Raises:
            MessageError: The data end before the message does, or a field has an unsupported type.
        """
        for _, (kind, detail) in get_typestore_jazzy().fielddefs[type_name][1]:
            self._skip_field(kind, detail)

    def _skip_field(self, kind: Nodetype, detail: Any) -> None:
        """Move the read position past one field of a message.

        Args:
            kind: Kind of the field: nested message, primitive value, array or sequence.
            detail: Description of the field by the package `rosbags`. It is the name of a nested
                type, a primitive type, or a pair of element type and count; the count of a sequence
                is read from the data instead.

        Raises:
            MessageError: The data end before the field does, or the field has an unsupported type.
        """
        if kind == Nodetype.NAME:
            self.skip_message(detail)
        elif kind == Nodetype.BASE:
            self._skip_values(detail[0], 1)
        else:
            (inner, inner_detail), count = detail
            if kind == Nodetype.SEQUENCE:
                count = self._read_count()
            if inner == Nodetype.BASE:
                self._skip_values(inner_detail[0], count)
                return
            for _ in range(count):
                self.skip_message(inner_detail)

    def _skip_values(self, name: str, count: int) -> None:
        """Move the read position past consecutive values of one primitive type.

        Args:
            name: Primitive type, or `string`; each string begins with its length.
            count: Number of values.

        Raises:
            MessageError: The type is unsupported, or the data end before the last value.
        """
        if name == "string":
            for _ in range(count):
                self._skip_bytes(self._read_count(), 1)
        elif name in PRIMITIVE_SIZES:
            if count:
                self._skip_bytes(count * PRIMITIVE_SIZES[name], PRIMITIVE_SIZES[name])
        else:
            raise _make_structure_error(self._type_name, self._data)

    def _read_count(self) -> int:
        """Move past an unsigned 32-bit length and return it.

        Raises:
            MessageError: The data end before the count does.
        """
        self._skip_bytes(4, 4)
        return int.from_bytes(self._data[self._at - 4 : self._at], self._order)

    def _skip_bytes(self, size: int, alignment: int) -> None:
        """Move the read position past padding and then past some bytes.

        Args:
            size: Number of bytes after the padding.
            alignment: The first of these bytes is at a multiple of this number, counted from the
                end of the encapsulation header.

        Raises:
            MessageError: The data end before the new position.
        """
        self._at += -(self._at - ENCAPSULATION_SIZE) % alignment + size
        if self._at > len(self._data):
            raise _make_structure_error(self._type_name, self._data)


def _make_structure_error(type_name: str, data: bytes) -> MessageError:
    """Return the error that the recorded bytes are no message of the type."""
    return MessageError(f"{len(data)} bytes were recorded that are no {type_name}")
