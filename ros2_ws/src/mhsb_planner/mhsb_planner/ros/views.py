"""Messages for viewers such as RViz: tip path coloured by mode, goal posture and obstacles.

The messages are made in two frames. In `base_link`, the arm's plane is vertical. In `work_plane`,
it is the x-y plane, for tools that only draw x and y.
"""

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
from mhsb_model.modes import Mode, find_strongest_modes
from mhsb_model.obstacles.zones import (
    CIRCLE_KIND,
    CYLINDER_KIND,
    KIND_COLUMN,
    LINK_COLUMN,
    LINK_KIND,
    OBSTACLE_COLUMN,
    RADIUS_COLUMN,
    SHAPE_COLUMN,
    SPACE_BOX_KIND,
    SPHERE_KIND,
)
from mhsb_model.types import FloatArray, IntArray
from mhsb_msgs_py import stamps
from mhsb_msgs_py.names import BASE_FRAME, WORK_PLANE_FRAME

PATH_SPACING_NS = 50_000_000
"""Time between the points of a drawn path [ns]."""

LINE_WIDTH = 0.006
"""Width of drawn lines [m]."""

GOAL_SIZE = 0.04
"""Diameter of the sphere at the goal [m]."""

GOAL_COLOR = (0.2, 0.3, 0.8)
"""Colour of goal and goal posture: red, green and blue from 0 to 1."""

OBSTACLE_COLORS = {True: (0.9, 0.5, 0.1), False: (0.8, 0.1, 0.1)}
"""Colours of obstacles: True for obstacles of the tip alone, False for all others."""

OBSTACLE_OPACITY = 0.4
"""Opacity of obstacles, 0 to 1."""

OBSTACLE_DEPTH = 0.02
"""Thickness of planar obstacles across the arm's plane [m]."""

SEEN_AROUND = 1.2
"""Half size of the drawn region around the base, as a multiple of the sum of link lengths [-]."""

ON_ITS_SIDE = Quaternion(x=math.sqrt(0.5), w=math.sqrt(0.5))
"""Orientation that turns the axis of a cylinder from the z direction to the y direction."""


def make_paths(machine: Machine, command: Command, prefix: str) -> tuple[Path, Path]:
    """Make the messages of a command's tip path, in both frames.

    Args:
        machine: Machine that moves.
        command: Command whose trajectory is drawn.
        prefix: Text before the names of frames.

    Returns:
        Path in `base_link`, and path in `work_plane`, in which z of the arm's vertical plane is
        drawn as y. Both paths have the command's stamp, and points every `PATH_SPACING_NS`.
    """
    _, postures = _sample_command(command)
    in_base, laid_flat = (
        Path(
            header=_create_header(command.stamp_ns, frame, prefix),
            poses=[
                PoseStamped(
                    header=_create_header(command.stamp_ns, frame, prefix), pose=Pose(position=tip)
                )
                for tip in _compute_tip_points(machine, postures, frame)
            ],
        )
        for frame in (BASE_FRAME, WORK_PLANE_FRAME)
    )
    return in_base, laid_flat


def make_markers(
    machine: Machine, command: Command | None, prefix: str, stamp_ns: int
) -> MarkerArray:
    """Make the markers of obstacles and of a command, in both frames.

    The frames are `base_link` and `work_plane` (the arm's plane as its x-y plane). The first marker
    deletes all earlier markers in the viewer.

    Args:
        machine: Machine with the zones to draw.
        command: Command whose path, goal and goal posture are drawn; None for obstacles alone.
        prefix: Text before the names of frames.
        stamp_ns: Stamp of the markers [ns].

    Returns:
        All markers.
    """
    shown = [Marker(header=_create_header(stamp_ns, BASE_FRAME, prefix), action=Marker.DELETEALL)]
    for frame in (BASE_FRAME, WORK_PLANE_FRAME):
        header = _create_header(stamp_ns, frame, prefix)
        shown += _make_obstacle_markers(machine, header, frame)
        if command is not None:
            shown += _make_command_markers(machine, command, header, frame)
    return MarkerArray(markers=shown)


def _make_obstacle_markers(machine: Machine, header: Header, frame: str) -> Iterable[Marker]:
    """Yield one marker for each zone, for the base and for the ground.

    Unlimited shapes are cut off at `SEEN_AROUND` times the sum of the link lengths. Zones in space
    do not turn with the arm, so they are not drawn in `work_plane` (the arm's plane as its x-y
    plane). Links that are obstacles for other links are not drawn.

    Args:
        machine: Machine with the zones to draw.
        header: Header of the markers.
        frame: `base_link` or `work_plane`.

    Yields:
        Markers. The id of a marker is the number of its obstacle.
    """
    flat = frame == WORK_PLANE_FRAME
    edge = SEEN_AROUND * float(machine.arrays.link_length.sum())
    shown: set[int] = set()
    for row in machine.obstacles.rows:
        kind, part, number = row[KIND_COLUMN], row[LINK_COLUMN], int(row[OBSTACLE_COLUMN])
        if kind == LINK_KIND or number in shown or (kind >= SPACE_BOX_KIND and flat):
            continue
        shown.add(number)
        marker = _create_marker(header, f"obstacles_{frame}", Marker.CUBE, OBSTACLE_DEPTH)
        if kind >= SPACE_BOX_KIND:
            _set_shape_in_space(marker, row, edge)
        else:
            _set_shape_in_plane(marker, row, edge, machine, frame)
        marker.id = number
        marker.frame_locked = machine.slews  # stays in place in a viewer whose frame turns
        marker.color = _create_color(OBSTACLE_COLORS[part == machine.joint_count], OBSTACLE_OPACITY)
        yield marker


def _set_shape_in_space(marker: Marker, row: FloatArray, half_size: float) -> None:
    """Set type, position and size of the marker of a box, cylinder or sphere in space.

    Boxes are cut off at ± `half_size` in all directions, cylinders at ± `half_size` in z only.

    Args:
        marker: Marker in `base_link`, written in place.
        row: Row of the obstacle table: kind of the obstacle, and the numbers of its shape [m].
            `obstacles.zones` defines the columns.
        half_size: Half size of the drawn region [m].
    """
    x, y, z, *more = row[SHAPE_COLUMN:RADIUS_COLUMN].tolist()
    if row[KIND_COLUMN] == SPHERE_KIND:
        marker.type, size = Marker.SPHERE, 3 * (2 * more[0],)
    elif row[KIND_COLUMN] == CYLINDER_KIND:
        low, high = np.clip((z, more[0]), -half_size, half_size).tolist()
        z, width = (low + high) / 2, 2 * more[1]
        marker.type, size = Marker.CYLINDER, (width, width, high - low)
    else:
        low, high = np.clip(((x, y, z), more), -half_size, half_size)
        (x, y, z), size = ((low + high) / 2).tolist(), (high - low).tolist()
    marker.pose.position = Point(x=x, y=y, z=z)
    marker.scale = Vector3(**dict(zip("xyz", size, strict=True)))


def _set_shape_in_plane(
    marker: Marker, row: FloatArray, half_size: float, machine: Machine, frame: str
) -> None:
    """Set type, pose and size of the marker of a box or circle in the arm's plane.

    Boxes are cut off at ± `half_size`. If the arm slews, the boxes in its plane are the ground and
    the base. In `base_link`, these two are drawn as boxes around the slew's axis, with equal width
    in x and y.

    Args:
        marker: Marker, written in place. For a circle, the thickness `scale.z` is kept.
        row: Row of the obstacle table: kind of the obstacle, and the numbers of its shape [m].
            `obstacles.zones` defines the columns.
        half_size: Half size of the drawn region [m].
        machine: Machine of the arm.
        frame: `base_link`, or `work_plane` (the arm's plane as its x-y plane).
    """
    flat, shape = frame == WORK_PLANE_FRAME, row[SHAPE_COLUMN : SHAPE_COLUMN + 4]
    if row[KIND_COLUMN] == CIRCLE_KIND:
        marker.type = Marker.CYLINDER
        marker.pose.position = _create_point(shape[:2], frame)
        marker.pose.orientation = Quaternion(w=1.0) if flat else ON_ITS_SIDE
        marker.scale.x = marker.scale.y = 2 * float(shape[2])
        return
    x_min, z_min, x_max, z_max = np.clip(shape, -half_size, half_size).tolist()
    if machine.slews and not flat:  # ground and base lie around the slew's axis
        x_max = x_max + machine.arrays.slew_offset
        x_min = -x_max
    marker.pose.position = _create_point(np.array([x_min + x_max, z_min + z_max]) / 2, frame)
    width, height = x_max - x_min, z_max - z_min
    depth = width if machine.slews else OBSTACLE_DEPTH
    marker.scale.x = width
    marker.scale.y, marker.scale.z = (height, OBSTACLE_DEPTH) if flat else (depth, height)


def _make_command_markers(
    machine: Machine, command: Command, header: Header, frame: str
) -> Iterable[Marker]:
    """Yield markers of the tip's path, the last posture and the last tip position of a command.

    The path is coloured by the modes of the actuators. At each point, the strongest mode of all
    actuators decides: shared boost, then decoupled boost, then normal.

    Args:
        machine: Machine that moves.
        command: Command to draw.
        header: Header of the markers.
        frame: `base_link`, or `work_plane` (the arm's plane as its x-y plane).

    Yields:
        Three markers: line of the path, line through the joints of the last posture, and sphere at
        the last tip position.
    """
    times, postures = _sample_command(command)
    tips = _compute_tip_points(machine, postures, frame)
    boosted = find_strongest_modes(command.schedule.modes_at_many(times))
    line = _create_marker(header, f"path_{frame}", Marker.LINE_STRIP, LINE_WIDTH)
    line.points = tips
    line.colors = [_create_color(rgb(PATH_COLOR[Mode(mode)])) for mode in boosted.tolist()]
    yield line
    posture = _create_marker(header, f"goal_posture_{frame}", Marker.LINE_STRIP, LINE_WIDTH)
    posture.points = _convert_to_points(
        machine, machine.joint_positions(postures[-1]), postures[-1:], frame
    )
    posture.color = _create_color(GOAL_COLOR)
    yield posture
    goal = _create_marker(header, f"goal_{frame}", Marker.SPHERE, GOAL_SIZE)
    goal.pose.position = tips[-1]
    goal.color = _create_color(GOAL_COLOR)
    yield goal


def _sample_command(command: Command) -> tuple[IntArray, FloatArray]:
    """Sample a command's trajectory every `PATH_SPACING_NS` and at its end.

    Args:
        command: The command. Only `trajectory` is read.

    Returns:
        Absolute times, int64[k], [ns], and joint positions at these times, float64[k, n], [rad or
        m].
    """
    trajectory = command.trajectory
    times = np.append(
        np.arange(trajectory.stamp_ns, trajectory.end_ns, PATH_SPACING_NS, dtype=np.int64),
        trajectory.end_ns,
    )
    return times, trajectory.sample_many(times)[0]


def _compute_tip_points(machine: Machine, postures: FloatArray, frame: str) -> list[Point]:
    """Compute the tip position in each posture, as points of a frame.

    Args:
        machine: Machine of the arm.
        postures: Joint positions, float64[k, n], [rad or m].
        frame: `base_link`, or `work_plane` (the arm's plane as its x-y plane).

    Returns:
        One point for each posture [m].
    """
    return _convert_to_points(machine, machine.tip_positions(postures), postures, frame)


def _convert_to_points(
    machine: Machine, in_plane: FloatArray, postures: FloatArray, frame: str
) -> list[Point]:
    """Convert positions in the arm's plane to points of a frame.

    In `base_link`, the plane of an arm that slews is turned by the slew angle; without slew,
    (x, z) becomes (x, 0, z). In `work_plane`, (x, z) becomes (x, z, 0), and the slew angle has no
    effect.

    Args:
        machine: Machine of the arm.
        in_plane: Positions (x, z) in the arm's plane, float64[k, 2], [m].
        postures: Joint positions [rad or m]. One row for each position, float64[k, n], or one row
            for all positions, float64[1, n]. Only the slew angle in column 0 is used.
        frame: `base_link` or `work_plane`.

    Returns:
        One point for each position [m].
    """
    if frame == WORK_PLANE_FRAME or not machine.slews:
        return [_create_point(place, frame) for place in in_plane]
    slew = np.broadcast_to(postures[:, 0], len(in_plane))
    return [Point(x=x, y=y, z=z) for x, y, z in machine.convert_to_base(in_plane, slew).tolist()]


def _create_marker(header: Header, namespace: str, kind: int, size: float) -> Marker:
    """Create a marker with action ADD, id 0 and equal size in all directions.

    Args:
        header: Header of the marker.
        namespace: Namespace of the marker.
        kind: Type of the marker.
        size: Scale along x, y and z [m]. For a line it is the width.

    Returns:
        Marker without pose and colour.
    """
    return Marker(
        header=header,
        ns=namespace,
        id=0,
        type=kind,
        action=Marker.ADD,
        scale=Vector3(x=size, y=size, z=size),
    )


def _create_header(stamp_ns: int, frame: str, prefix: str) -> Header:
    """Create a header with a stamp [ns] and the name of a frame after its prefix."""
    return Header(stamp=stamps.to_time(stamp_ns), frame_id=prefix + frame)


def _create_point(place: FloatArray, frame: str) -> Point:
    """Convert a position in the arm's plane to a point of a frame, without a slew angle.

    Args:
        place: Position (x, z) in the arm's plane [m].
        frame: `base_link` or `work_plane`.

    Returns:
        Point (x, z, 0) in `work_plane`, or (x, 0, z) in `base_link`.
    """
    x, z = float(place[0]), float(place[1])
    return Point(x=x, y=z, z=0.0) if frame == WORK_PLANE_FRAME else Point(x=x, y=0.0, z=z)


def _create_color(rgb: tuple[float, float, float], opacity: float = 1.0) -> ColorRGBA:
    """Create a colour message from red, green and blue (0 to 1) and the opacity (0 to 1)."""
    return ColorRGBA(r=rgb[0], g=rgb[1], b=rgb[2], a=opacity)
