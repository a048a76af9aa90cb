"""What viewers are shown: a plan's tip path, coloured by mode, its goal posture, and obstacles.

Everything is drawn twice: in the arm's own plane (base_link) and in the same plane laid flat
(work_plane), where tools that know only x and y can show it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Vector3
from nav_msgs.msg import Path
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from mhsb_model.command import Command
from mhsb_model.figure_style import PATH_COLOR, rgb
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode, strongest
from mhsb_model.obstacles.zones import (
    BOX_IN_SPACE,
    CIRCLE,
    CYLINDER,
    KIND,
    LINK,
    NUMBER,
    PART,
    RADIUS,
    SHAPE,
    SPHERE,
)
from mhsb_model.types import FloatArray, IntArray
from mhsb_msgs_py import stamps
from mhsb_msgs_py.names import BASE_FRAME, WORK_PLANE_FRAME, frame_name

PATH_SPACING_NS = 50_000_000
LINE_WIDTH = 0.006  # m
GOAL_SIZE = 0.04  # m
GOAL_COLOR = (0.2, 0.3, 0.8)
OBSTACLE_COLORS = {True: (0.9, 0.5, 0.1), False: (0.8, 0.1, 0.1)}
"""Of what holds for the tip alone, and for links."""

OBSTACLE_OPACITY = 0.4
OBSTACLE_DEPTH = 0.02  # m, across the arm's plane
SEEN_AROUND = 1.2
"""Obstacles are drawn as far as so many reaches of the arm from its base."""

ON_ITS_SIDE = Quaternion(x=math.sqrt(0.5), w=math.sqrt(0.5))
"""Turns the axis of a cylinder from z to y."""


def paths(machine: Machine, command: Command, prefix: str) -> tuple[Path, Path]:
    """The tip's path in base_link and in work_plane."""
    _, postures = _along(command)
    in_base, laid_flat = (
        Path(
            header=_header(command.stamp_ns, frame, prefix),
            poses=[
                PoseStamped(
                    header=_header(command.stamp_ns, frame, prefix), pose=Pose(position=tip)
                )
                for tip in _tips(machine, postures, frame)
            ],
        )
        for frame in (BASE_FRAME, WORK_PLANE_FRAME)
    )
    return in_base, laid_flat


def markers(
    machine: Machine, command: Command | None, prefix: str, stamp_ns: int
) -> MarkerArray:
    """Obstacles and, of a command, path, goal and goal posture, in both frames.

    They replace all that have been shown before.
    """
    shown = [Marker(header=_header(stamp_ns, BASE_FRAME, prefix), action=Marker.DELETEALL)]
    for frame in (BASE_FRAME, WORK_PLANE_FRAME):
        header = _header(stamp_ns, frame, prefix)
        shown += _obstacle_markers(machine, header, frame)
        if command is not None:
            shown += _command_markers(machine, command, header, frame)
    return MarkerArray(markers=shown)


def _obstacle_markers(machine: Machine, header: Header, frame: str) -> Iterable[Marker]:
    """Zones, base, and the ground as far as the arm can get.

    Zones in space stay where they are: they are not shown in work_plane, which turns with the arm.
    """
    flat = frame == WORK_PLANE_FRAME
    edge = SEEN_AROUND * float(machine.arrays.link_length.sum())
    shown: set[int] = set()
    for row in machine.obstacles.rows:
        kind, part, number = row[KIND], row[PART], int(row[NUMBER])
        if kind == LINK or number in shown or (kind >= BOX_IN_SPACE and flat):
            continue
        shown.add(number)
        marker = _marker(header, f"obstacles_{frame}", Marker.CUBE, OBSTACLE_DEPTH)
        if kind >= BOX_IN_SPACE:
            _shape_in_space(marker, row, edge)
        else:
            _shape_in_plane(marker, row, edge, machine, frame)
        marker.id = number
        marker.frame_locked = machine.slews  # stays in place in a viewer whose frame turns
        marker.color = _color(OBSTACLE_COLORS[part == machine.joint_count], OBSTACLE_OPACITY)
        yield marker


def _shape_in_space(marker: Marker, row: FloatArray, edge: float) -> None:
    """Kind, place and size of a zone in `base_link`, of its row."""
    x, y, z, *more = row[SHAPE:RADIUS].tolist()
    if row[KIND] == SPHERE:
        marker.type, size = Marker.SPHERE, 3 * (2 * more[0],)
    elif row[KIND] == CYLINDER:
        low, high = np.clip((z, more[0]), -edge, edge).tolist()
        z, width = (low + high) / 2, 2 * more[1]
        marker.type, size = Marker.CYLINDER, (width, width, high - low)
    else:
        low, high = np.clip(((x, y, z), more), -edge, edge)
        (x, y, z), size = ((low + high) / 2).tolist(), (high - low).tolist()
    marker.pose.position = Point(x=x, y=y, z=z)
    marker.scale = Vector3(**dict(zip("xyz", size, strict=True)))


def _shape_in_plane(
    marker: Marker, row: FloatArray, edge: float, machine: Machine, frame: str
) -> None:
    """Kind, place and size of what is in the arm's plane, of its row."""
    flat, shape = frame == WORK_PLANE_FRAME, row[SHAPE:SHAPE + 4]
    if row[KIND] == CIRCLE:
        marker.type = Marker.CYLINDER
        marker.pose.position = _point(shape[:2], frame)
        marker.pose.orientation = Quaternion(w=1.0) if flat else ON_ITS_SIDE
        marker.scale.x = marker.scale.y = 2 * float(shape[2])
        return
    x_min, z_min, x_max, z_max = np.clip(shape, -edge, edge).tolist()
    if machine.slews and not flat:  # ground and base, which stand around the slew's axis
        x_max = x_max + machine.arrays.slew_offset
        x_min = -x_max
    marker.pose.position = _point(np.array([x_min + x_max, z_min + z_max]) / 2, frame)
    width, height = x_max - x_min, z_max - z_min
    depth = width if machine.slews else OBSTACLE_DEPTH
    marker.scale.x = width
    marker.scale.y, marker.scale.z = (height, OBSTACLE_DEPTH) if flat else (depth, height)


def _command_markers(
    machine: Machine, command: Command, header: Header, frame: str
) -> Iterable[Marker]:
    times, postures = _along(command)
    tips = _tips(machine, postures, frame)
    boosted = strongest(command.schedule.modes_at_many(times))
    line = _marker(header, f"path_{frame}", Marker.LINE_STRIP, LINE_WIDTH)
    line.points = tips
    line.colors = [_color(rgb(PATH_COLOR[Mode(mode)])) for mode in boosted.tolist()]
    yield line
    posture = _marker(header, f"goal_posture_{frame}", Marker.LINE_STRIP, LINE_WIDTH)
    posture.points = _places(machine, machine.joint_positions(postures[-1]), postures[-1:], frame)
    posture.color = _color(GOAL_COLOR)
    yield posture
    goal = _marker(header, f"goal_{frame}", Marker.SPHERE, GOAL_SIZE)
    goal.pose.position = tips[-1]
    goal.color = _color(GOAL_COLOR)
    yield goal


def _along(command: Command) -> tuple[IntArray, FloatArray]:
    """Absolute times [ns] and postures along the trajectory, its end included."""
    trajectory = command.trajectory
    times = np.append(
        np.arange(trajectory.stamp_ns, trajectory.end_ns, PATH_SPACING_NS, dtype=np.int64),
        trajectory.end_ns,
    )
    return times, trajectory.sample_many(times)[0]


def _tips(machine: Machine, postures: FloatArray, frame: str) -> list[Point]:
    """Where the tip is in postures float64[k, n]."""
    return _places(machine, machine.tip_positions(postures), postures, frame)


def _places(
    machine: Machine, in_plane: FloatArray, postures: FloatArray, frame: str
) -> list[Point]:
    """Places float64[k, 2] of the plane of an arm that may slew, as it is in the postures."""
    if frame == WORK_PLANE_FRAME or not machine.slews:
        return [_point(place, frame) for place in in_plane]
    slew = np.broadcast_to(postures[:, 0], len(in_plane))
    return [Point(x=x, y=y, z=z) for x, y, z in machine.in_base(in_plane, slew).tolist()]


def _marker(header: Header, namespace: str, kind: int, size: float) -> Marker:
    return Marker(
        header=header,
        ns=namespace,
        id=0,
        type=kind,
        action=Marker.ADD,
        scale=Vector3(x=size, y=size, z=size),
    )


def _header(stamp_ns: int, frame: str, prefix: str) -> Header:
    return Header(stamp=stamps.to_time(stamp_ns), frame_id=frame_name(frame, prefix))


def _point(place: FloatArray, frame: str) -> Point:
    x, z = float(place[0]), float(place[1])
    return Point(x=x, y=z, z=0.0) if frame == WORK_PLANE_FRAME else Point(x=x, y=0.0, z=z)


def _color(rgb: tuple[float, float, float], opacity: float = 1.0) -> ColorRGBA:
    return ColorRGBA(r=rgb[0], g=rgb[1], b=rgb[2], a=opacity)
