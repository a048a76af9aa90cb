"""Checks that bytes are a message of a type before anything is built from them.

Middlewares allocate what an array's length states before they look at how many bytes there are.
A message is therefore gone through first (OMG DDS-XTypes, PLAIN_CDR): every length is compared with
the bytes that are left.
"""

from __future__ import annotations

from typing import Any

from rosbags.interfaces import Nodetype

from mhsb_msgs_py.errors import MessageError
from mhsb_sim.recording.bag_format import typestore

ENCAPSULATIONS = {b"\x00\x00": "big", b"\x00\x01": "little"}
ENCAPSULATION_SIZE = 4
SIZES = {
    "bool": 1, "byte": 1, "char": 1, "octet": 1, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2,
    "int32": 4, "uint32": 4, "float32": 4, "int64": 8, "uint64": 8, "float64": 8,
}  # fmt: skip


def check_structure(type_name: str, data: bytes) -> None:
    """Raise MessageError unless bytes are a message of a type, followed by anything."""
    order = ENCAPSULATIONS.get(data[:2])
    if order is None or len(data) < ENCAPSULATION_SIZE:
        raise _wrong(type_name, data)
    _Walk(type_name, data, order).message(type_name)


class _Walk:
    """A place in the bytes of a message."""

    def __init__(self, type_name: str, data: bytes, order: str) -> None:
        self._type_name = type_name
        self._data = data
        self._order: Any = order
        self._at = ENCAPSULATION_SIZE

    def message(self, type_name: str) -> None:
        """Go past a message of a type."""
        for _, (kind, detail) in typestore().fielddefs[type_name][1]:
            self._field(kind, detail)

    def _field(self, kind: Nodetype, detail: Any) -> None:
        if kind == Nodetype.NAME:
            self.message(detail)
        elif kind == Nodetype.BASE:
            self._values(detail[0], 1)
        else:
            (inner, inner_detail), count = detail
            if kind == Nodetype.SEQUENCE:
                count = self._count()
            if inner == Nodetype.BASE:
                self._values(inner_detail[0], count)
                return
            for _ in range(count):
                self.message(inner_detail)

    def _values(self, name: str, count: int) -> None:
        """Go past values of a basic type."""
        if name == "string":
            for _ in range(count):
                self._skip(self._count(), 1)
        elif name in SIZES:
            if count:
                self._skip(count * SIZES[name], SIZES[name])
        else:
            raise _wrong(self._type_name, self._data)

    def _count(self) -> int:
        """Go past a length and return it."""
        self._skip(4, 4)
        return int.from_bytes(self._data[self._at - 4 : self._at], self._order)

    def _skip(self, size: int, alignment: int) -> None:
        self._at += -(self._at - ENCAPSULATION_SIZE) % alignment + size
        if self._at > len(self._data):
            raise _wrong(self._type_name, self._data)


def _wrong(type_name: str, data: bytes) -> MessageError:
    return MessageError(f"{len(data)} bytes were recorded that are no {type_name}")
