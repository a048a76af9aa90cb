"""Fast codec between arrays and the serialized bytes of trajectory_msgs/JointTrajectory.

rclpy makes an object for each point and for each of its arrays, which takes some 20 µs a point.
NumPy reads a whole message from its bytes at once. If the arrays of all points have the same
lengths, the points are in CDR (OMG DDS-XTypes, PLAIN_CDR, little endian) at even distances:

    uint32 count, padding to 8 bytes if the array is not empty, float64[count]    four times
    int32 sec, uint32 nanosec

Alignment is counted from the end of the encapsulation, the first 4 bytes of a message. Every
middleware of ROS 2 Jazzy sends this encapsulation on today's processors; bytes with another one are
refused. A point ends 4 bytes beyond a multiple of 8 if it has positions alone, or positions,
velocities and accelerations. The next point then needs no padding. rclpy decodes all other layouts.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory

from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, IntArray
from mhsb_msgs_py import stamps
from mhsb_msgs_py.errors import MessageError

CDR_ENCAPSULATION = b"\x00\x01\x00\x00"
"""First bytes of a message in little-endian CDR."""

POINT_FIELDS = ("positions", "velocities", "accelerations", "effort")
"""Arrays of a point, in their order in the bytes."""

STATE_FIELDS, MODE_FIELDS = POINT_FIELDS[:3], POINT_FIELDS[:1]
"""Arrays that the points of a trajectory, and of a mode schedule, have."""

COUNT_FORMAT, TIME_FORMAT = struct.Struct("<I"), struct.Struct("<iI")
"""Layouts of a number of elements, and of a time in seconds and nanoseconds."""

Rows = FloatArray | Sequence[Sequence[float]]
"""Values of all points, float64[points, values], or one sequence for each point if lengths differ.
"""


@dataclass(frozen=True, eq=False)
class PointArrays:
    """Content of a JointTrajectory.

    Attributes:
        stamp_ns: Stamp of its header [ns].
        joint_names: Names of its joints.
        time_ns: Times of its points after the stamp, int64[points], [ns].
        positions: Positions of its points, float64[points, joints], or one sequence for each point.
        velocities: Velocities of its points, in the same form; rows may be empty.
        accelerations: Accelerations of its points, in the same form; rows may be empty.
        effort: Efforts of its points, in the same form; rows may be empty.
    """

    stamp_ns: int
    joint_names: Sequence[str]
    time_ns: IntArray
    positions: Rows
    velocities: Rows
    accelerations: Rows
    effort: Rows


def read_point_arrays(message: JointTrajectory | bytes, what: str, max_points: int) -> PointArrays:
    """Return the content of a message, or of its bytes, as arrays.

    The number of points is checked before any point is read. Joint names, lengths of the arrays and
    values are not checked.

    Args:
        message: Message, or its serialized bytes.
        what: Name of the message, for the error.
        max_points: Largest number of points.

    Returns:
        The content. Its arrays have two dimensions if bytes are given whose layout is regular
        (`_read_regular_bytes`). Otherwise each is a list of sequences, one for each point.

    Raises:
        MessageError: There are too many points, the bytes are no message, or the nanoseconds of a
            time are 10⁹ or more.
    """
    if isinstance(message, bytes):
        head = _HeadReader(message)
        _check_count(what, head.point_count, max_points)
        return _read_regular_bytes(message, head) or _read_message(_decode_by_rclpy(message))
    _check_count(what, len(message.points), max_points)
    return _read_message(message)


def read_stamp(raw: bytes) -> int:
    """Return the stamp of a serialized message, even if the rest of the message cannot be used.

    Args:
        raw: Bytes of the message.

    Returns:
        Stamp [ns]; 0 if the stamp, the joint names or the number of points cannot be read.
    """
    try:
        sec, nanosec = _HeadReader(raw).stamp
        stamps.check_nanoseconds(nanosec)
    except MessageError:
        return 0
    return sec * SECOND_NS + nanosec


def to_bytes(arrays: PointArrays) -> bytes:
    """Serialize a message from its arrays.

    rclpy serializes stamp and names; the points follow as one NumPy array.

    Args:
        arrays: Content with at least one point. The positions must have at least one column. Every
            other array is empty or has as many columns as the positions.

    Returns:
        Bytes of the message, as rclpy would serialize it.
    """
    header = Header(stamp=stamps.to_time(arrays.stamp_ns))
    empty = serialize_message(JointTrajectory(header=header, joint_names=list(arrays.joint_names)))
    head = empty[: -COUNT_FORMAT.size] + COUNT_FORMAT.pack(len(arrays.time_ns))
    values = {field: np.asarray(getattr(arrays, field), dtype=np.float64) for field in POINT_FIELDS}
    given = tuple(field for field in POINT_FIELDS if values[field].size > 0)
    columns = values["positions"].shape[1]
    points = np.zeros(len(arrays.time_ns), _make_point_dtype(columns, given))
    for field in given:
        points[f"{field} count"], points[field] = columns, values[field]
    points["sec"], points["nanosec"] = np.divmod(arrays.time_ns, SECOND_NS)
    body = points.tobytes()
    if (len(head) - len(CDR_ENCAPSULATION)) % 8 == 0:  # the first point's positions need padding
        body = body[:4] + bytes(4) + body[4:]
    return head + body


def _check_count(what: str, count: int, most: int) -> None:
    """Raise MessageError if a message has more points than allowed.

    Args:
        what: Name of the message, for the error.
        count: Number of points.
        most: Largest allowed number.
    """
    if count > most:
        raise MessageError(f"{what} has {count} points; give at most {most}")


class _HeadReader:
    """Reader of the first part of a serialized message, which comes before the points.

    Attributes:
        stamp: Stamp as seconds and nanoseconds.
        joint_names: Names of the joints.
        point_count: Number of points.
        start: Offset of the points, counted from the end of the encapsulation [bytes].
    """

    def __init__(self, raw: bytes) -> None:
        """Read the start of a message: stamp, joint names and number of points.

        Args:
            raw: Bytes of the message.

        Raises:
            MessageError: The bytes are no JointTrajectory in little-endian CDR.
        """
        if raw[:2] != CDR_ENCAPSULATION[:2]:  # two bytes of options follow
            raise _make_unreadable_error(raw)
        self._raw = raw
        self._at = len(CDR_ENCAPSULATION)
        try:
            self.stamp = self._read_numbers(TIME_FORMAT)
            self._read_text()  # the frame has no meaning here
            self.joint_names = [self._read_text() for _ in range(self._read_count())]
            self.point_count = self._read_count()
        except (struct.error, UnicodeDecodeError) as error:
            raise _make_unreadable_error(raw) from error
        self.start = self._at - len(CDR_ENCAPSULATION)

    def _read_numbers(self, layout: struct.Struct) -> tuple[int, ...]:
        """Skip padding up to a multiple of 4 bytes, and read numbers from the present offset.

        The offset is moved to the end of the numbers.

        Args:
            layout: Layout of the numbers.

        Returns:
            The numbers.

        Raises:
            struct.error: The bytes end before the numbers do.
        """
        self._at += -self._at % 4
        numbers = layout.unpack_from(self._raw, self._at)
        self._at += layout.size
        return numbers

    def _read_count(self) -> int:
        """Read a number of elements, and move the offset to its end."""
        return self._read_numbers(COUNT_FORMAT)[0]

    def _read_text(self) -> str:
        """Read a text with its length, and move the offset to its end.

        Returns:
            The text without its final zero byte.

        Raises:
            MessageError: The text is longer than the remaining bytes.
            UnicodeDecodeError: The text is not in UTF-8.
            struct.error: The bytes end before the length does.
        """
        length = self._read_count()
        if length > len(self._raw) - self._at:
            raise _make_unreadable_error(self._raw)
        self._at += length
        return self._raw[self._at - length : self._at].rstrip(b"\0").decode()


def _read_message(message: JointTrajectory) -> PointArrays:
    """Return the content of a message that rclpy has decoded, as arrays.

    Raises:
        MessageError: The nanoseconds of a time are 10⁹ or more.
    """
    times = [stamps.from_time(point.time_from_start) for point in message.points]
    return PointArrays(
        stamps.from_time(message.header.stamp),
        message.joint_names,
        np.array(times, dtype=np.int64),
        *([getattr(point, field) for point in message.points] for field in POINT_FIELDS),
    )


def _read_regular_bytes(raw: bytes, head: _HeadReader) -> PointArrays | None:
    """Read all points of a message at once from its bytes, if their layout is regular.

    The layout is regular if all points have the same non-empty arrays, and all these arrays have
    one length. They are the positions alone, or positions, velocities and accelerations.

    Args:
        raw: Bytes of the message.
        head: Start of the message.

    Returns:
        The content. None if the layout is not regular, or if there are no points.

    Raises:
        MessageError: The nanoseconds of a time are 10⁹ or more.
    """
    count, base = head.point_count, head.start + len(CDR_ENCAPSULATION)
    if count == 0 or len(raw) < base + COUNT_FORMAT.size:
        return None
    (columns,) = COUNT_FORMAT.unpack_from(raw, base)
    if not 0 < 8 * columns <= len(raw):
        return None
    padded = head.start % 8 == 0
    for given in (STATE_FIELDS, MODE_FIELDS):
        record = _make_point_dtype(columns, given)
        if base + 4 * padded + count * record.itemsize > len(raw):
            continue
        points = np.frombuffer(raw, record, count, base + 4 * padded)
        # If the first point is padded, its record begins behind its own count.
        expected = {field: columns if field in given else 0 for field in POINT_FIELDS}
        if all(
            np.all(points[f"{field} count"][padded and field == "positions" :] == number)
            for field, number in expected.items()
        ):
            return _read_points(head, points, given)
    return None


def _read_points(head: _HeadReader, points: np.ndarray, given: tuple[str, ...]) -> PointArrays:
    """Return the content of a message from its records.

    Args:
        head: Start of the message.
        points: One record for each point, as laid out by `_make_point_dtype`.
        given: Names of the arrays that are not empty.

    Returns:
        The content. Arrays that are not in `given` have no columns.

    Raises:
        MessageError: The nanoseconds of a time are 10⁹ or more.
    """
    sec, nanosec = head.stamp
    for each in (nanosec, int(points["nanosec"].max())):
        stamps.check_nanoseconds(each)
    return PointArrays(
        sec * SECOND_NS + nanosec,
        head.joint_names,
        points["sec"].astype(np.int64) * SECOND_NS + points["nanosec"],
        *(
            points[field] if field in given else np.zeros((len(points), 0))
            for field in POINT_FIELDS
        ),
    )


def _decode_by_rclpy(raw: bytes) -> JointTrajectory:
    """Decode the bytes of a message by rclpy.

    Args:
        raw: Bytes of the message.

    Returns:
        The message.

    Raises:
        MessageError: The bytes are no JointTrajectory.
    """
    try:
        return deserialize_message(raw, JointTrajectory)
    except Exception as error:  # rclpy has no special error for this
        raise _make_unreadable_error(raw) from error


def _make_point_dtype(columns: int, given: tuple[str, ...]) -> np.dtype:
    """Return the NumPy record type of a serialized trajectory point.

    Values of 8 bytes are aligned to multiples of 8 in the message. The padding in this type is
    right for a point that begins 4 bytes beyond a multiple of 8.

    Args:
        columns: Number of values in each array that is not empty.
        given: Names of the arrays that are not empty, in the order of POINT_FIELDS.

    Returns:
        Type with these fields: `<array> count` for all four arrays, `<array>` for those in `given`,
        `sec` and `nanosec`.
    """
    fields: dict[str, tuple[object, int]] = {}
    at = 0
    for field in POINT_FIELDS:
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


def _make_unreadable_error(raw: bytes) -> MessageError:
    """Return the error for bytes that are no JointTrajectory."""
    return MessageError(f"{len(raw)} bytes came that are no JointTrajectory; send one")
