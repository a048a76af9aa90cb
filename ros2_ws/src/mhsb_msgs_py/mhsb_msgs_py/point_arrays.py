"""trajectory_msgs/JointTrajectory, array by array, from a message or from its bytes.

rclpy makes an object for each point and for each of its arrays, some 20 µs a point. NumPy reads a
whole message from its bytes at once: points whose arrays have the same lengths stand in CDR (OMG
DDS-XTypes, PLAIN_CDR, little endian) at even distances,

    uint32 count, padding to 8 bytes where the array is not empty, float64[count]    four times
    int32 sec, uint32 nanosec

with alignment counted from behind the 4 bytes of the encapsulation (what every middleware of ROS 2
Jazzy sends on today's processors; anything else is no message here). A point with positions, and
with velocities and accelerations or neither, ends 4 bytes beyond a multiple of 8, where the next
one needs no padding. What stands otherwise is left to rclpy.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import JointTrajectory

from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, IntArray
from mhsb_msgs_py import stamps
from mhsb_msgs_py.errors import MessageError

ENCAPSULATION = b"\x00\x01\x00\x00"
FIELDS = ("positions", "velocities", "accelerations", "effort")
FULL, POSITIONS_ONLY = FIELDS[:3], FIELDS[:1]
"""Which arrays the points of a trajectory, and those of a mode schedule, are to have."""

COUNT, TIME = struct.Struct("<I"), struct.Struct("<iI")

Rows = FloatArray | Sequence[Sequence[float]]
"""float64[points, values], or where points do not all have as many values, a row for each."""


@dataclass(frozen=True, eq=False)
class PointArrays:
    """What a JointTrajectory says.

    stamp_ns  of its header, ns
    time_ns   of its points, int64[points] ns after the stamp
    """

    stamp_ns: int
    joint_names: Sequence[str]
    time_ns: IntArray
    positions: Rows
    velocities: Rows
    accelerations: Rows
    effort: Rows


def point_arrays(message: JointTrajectory | bytes, what: str, most: int) -> PointArrays:
    """All arrays of a message, or of its bytes, with at most so many points.

    Raises MessageError where there are more, before anything else is looked at, where bytes are no
    message, and for impossible times. `what` is what the message is called there.
    """
    if isinstance(message, bytes):
        head = _Head(message)
        _check_count(what, head.point_count, most)
        return _of_bytes(message, head) or _of_message(_by_rclpy(message))
    _check_count(what, len(message.points), most)
    return _of_message(message)


def stamp_of(raw: bytes) -> int:
    """Stamp [ns] of a message, also of one that cannot be used otherwise; 0 where it has none."""
    try:
        sec, nanosec = _Head(raw).stamp
        stamps.check_nanoseconds(nanosec)
    except MessageError:
        return 0
    return sec * SECOND_NS + nanosec


def to_bytes(arrays: PointArrays) -> bytes:
    """The bytes of a message with at least one point; positions are not empty."""
    head = bytearray(TIME.pack(*_seconds_and_rest(arrays.stamp_ns)))
    _append_text(head, "")  # the frame
    _append_count(head, len(arrays.joint_names))
    for name in arrays.joint_names:
        _append_text(head, name)
    _append_count(head, len(arrays.time_ns))
    values = {field: np.asarray(getattr(arrays, field), dtype=np.float64) for field in FIELDS}
    given = tuple(field for field in FIELDS if values[field].size > 0)
    columns = values["positions"].shape[1]
    points = np.zeros(len(arrays.time_ns), _record(columns, given))
    for field in given:
        points[f"{field} count"], points[field] = columns, values[field]
    points["sec"], points["nanosec"] = _seconds_and_rest(arrays.time_ns)
    body = points.tobytes()
    if len(head) % 8 == 0:  # the first point's positions need padding
        body = body[:4] + bytes(4) + body[4:]
    return ENCAPSULATION + bytes(head) + body


def _check_count(what: str, count: int, most: int) -> None:
    if count > most:
        raise MessageError(f"{what} has {count} points; give at most {most}")


class _Head:
    """What stands before the points; MessageError where bytes are no message.

    start: where the points begin, counted as alignment is.
    """

    def __init__(self, raw: bytes) -> None:
        if raw[:2] != ENCAPSULATION[:2]:  # two bytes of options follow
            raise _unreadable(raw)
        self._raw = raw
        self._at = len(ENCAPSULATION)
        try:
            self.stamp = self._numbers(TIME)
            self._text()  # the frame has no meaning here
            self.joint_names = [self._text() for _ in range(self._count())]
            self.point_count = self._count()
        except (struct.error, UnicodeDecodeError) as error:
            raise _unreadable(raw) from error
        self.start = self._at - len(ENCAPSULATION)

    def _numbers(self, layout: struct.Struct) -> tuple[int, ...]:
        self._at += -self._at % 4
        numbers = layout.unpack_from(self._raw, self._at)
        self._at += layout.size
        return numbers

    def _count(self) -> int:
        return self._numbers(COUNT)[0]

    def _text(self) -> str:
        length = self._count()
        if length > len(self._raw) - self._at:
            raise _unreadable(self._raw)
        self._at += length
        return self._raw[self._at - length : self._at].rstrip(b"\0").decode()


def _of_message(message: JointTrajectory) -> PointArrays:
    times = [stamps.from_duration(point.time_from_start) for point in message.points]
    return PointArrays(
        stamps.from_time(message.header.stamp),
        message.joint_names,
        np.array(times, dtype=np.int64),
        *([getattr(point, field) for point in message.points] for field in FIELDS),
    )


def _of_bytes(raw: bytes, head: _Head) -> PointArrays | None:
    """The arrays in these bytes; None where they do not stand at even distances."""
    count, base = head.point_count, head.start + len(ENCAPSULATION)
    if len(raw) < base + COUNT.size:
        return None
    (columns,) = COUNT.unpack_from(raw, base)
    if not 0 < 8 * columns <= len(raw):
        return None
    padded = head.start % 8 == 0
    for given in (FULL, POSITIONS_ONLY):
        record = _record(columns, given)
        if base + 4 * padded + count * record.itemsize > len(raw):
            continue
        points = np.frombuffer(raw, record, count, base + 4 * padded)
        # Where the first point is padded, its record begins behind its own count.
        expected = {field: columns if field in given else 0 for field in FIELDS}
        if all(
            np.all(points[f"{field} count"][padded and field == "positions" :] == number)
            for field, number in expected.items()
        ):
            return _of_points(head, points, given)
    return None


def _of_points(head: _Head, points: np.ndarray, given: tuple[str, ...]) -> PointArrays:
    sec, nanosec = head.stamp
    for each in (nanosec, int(points["nanosec"].max())):
        stamps.check_nanoseconds(each)
    return PointArrays(
        sec * SECOND_NS + nanosec,
        head.joint_names,
        points["sec"].astype(np.int64) * SECOND_NS + points["nanosec"],
        *(points[field] if field in given else np.zeros((len(points), 0)) for field in FIELDS),
    )


def _by_rclpy(raw: bytes) -> JointTrajectory:
    try:
        return deserialize_message(raw, JointTrajectory)
    except Exception as error:  # rclpy has no error of its own for this
        raise _unreadable(raw) from error


def _record(columns: int, given: tuple[str, ...]) -> np.dtype:
    """Layout of a point that begins 4 bytes beyond a multiple of 8."""
    fields: dict[str, tuple[object, int]] = {}
    at = 0
    for field in FIELDS:
        fields[f"{field} count"] = ("<u4", at)
        at += 4
        if field in given:
            at += -(at + 4) % 8
            fields[field] = (("<f8", (columns,)), at)
            at += 8 * columns
    fields["sec"], fields["nanosec"] = ("<i4", at), ("<u4", at + 4)
    return np.dtype(
        {
            "names": list(fields),
            "formats": [form for form, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": at + 8,
        }
    )


def _seconds_and_rest(time_ns: int | IntArray) -> tuple[int | IntArray, int | IntArray]:
    return time_ns // SECOND_NS, time_ns % SECOND_NS


def _append_count(head: bytearray, count: int) -> None:
    head += bytes(-len(head) % 4) + COUNT.pack(count)


def _append_text(head: bytearray, text: str) -> None:
    content = text.encode() + b"\0"
    _append_count(head, len(content))
    head += content


def _unreadable(raw: bytes) -> MessageError:
    return MessageError(f"{len(raw)} bytes came that are no JointTrajectory; send one")
