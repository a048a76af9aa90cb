"""The planner's markers (path, goal posture, zones) in the browser's scene."""

from typing import Any

import numpy as np
from viser import SceneApi
from visualization_msgs.msg import Marker, MarkerArray

from mhsb_tools.viewer.shapes import bytes_of


class MarkerScene:
    """Markers below `/plan` in the browser's scene."""

    def __init__(self, scene: SceneApi, frame: str) -> None:
        """Prepare the drawing; nothing is added to the scene yet.

        Args:
            scene: Scene of the browser.
            frame: Name of the frame of the scene. Markers in other frames are ignored.
        """
        self._scene = scene
        self._frame = frame
        self._shown: dict[str, Any] = {}

    def show(self, message: MarkerArray) -> None:
        """Update the shown markers by a message.

        Of the marker actions, ADD and DELETEALL are supported. ADD adds a marker, or replaces the
        one with the same namespace and id. DELETEALL removes all markers that are shown and not
        added again later in the message. Other actions are ignored. Added markers are ignored, too,
        if their frame is not the scene's frame.

        Args:
            message: Markers of the planner.
        """
        kept = self._shown
        for marker in message.markers:
            name = f"/plan/{marker.ns}/{marker.id}"
            if marker.action == Marker.DELETEALL:
                kept, self._shown = {**kept, **self._shown}, {}
            elif marker.header.frame_id == self._frame and marker.action == Marker.ADD:
                self._shown[name] = self._add_marker(name, marker)
        for name in kept.keys() - self._shown.keys():
            kept[name].remove()

    def _add_marker(self, name: str, marker: Marker) -> Any:
        """Add a marker to the scene.

        Types are line strip, cube and cylinder; every other type is drawn as a sphere. A line strip
        is drawn at its points; its pose is ignored.

        Args:
            name: Name of the object in the scene; an object of the same name is replaced.
            marker: The marker.

        Returns:
            Handle of the new object.
        """
        if marker.type == Marker.LINE_STRIP:
            return self._line(name, marker)
        added = self._solid(name, marker)
        place, turn = marker.pose.position, marker.pose.orientation
        added.position = (place.x, place.y, place.z)
        added.wxyz = (turn.w, turn.x, turn.y, turn.z)
        return added

    def _solid(self, name: str, marker: Marker) -> Any:
        """Add the shape of a marker to the scene, at the origin: a box, a cylinder or a sphere.

        Types other than cube and cylinder give a sphere. Colour, opacity and scale are the
        marker's. The radius of cylinder and sphere is half of the x scale.

        Args:
            name: Name of the object in the scene.
            marker: The marker; its pose is not used here.

        Returns:
            Handle of the object.
        """
        color, opacity, size = bytes_of(_rgb(marker.color)), float(marker.color.a), marker.scale
        if marker.type == Marker.CUBE:
            dimensions = (size.x, size.y, size.z)
            return self._scene.add_box(name, color=color, dimensions=dimensions, opacity=opacity)
        radius = size.x / 2
        if marker.type == Marker.CYLINDER:
            return self._scene.add_cylinder(
                name, radius=radius, height=size.z, color=color, opacity=opacity
            )
        return self._scene.add_icosphere(name, radius=radius, color=color, opacity=opacity)

    def _line(self, name: str, marker: Marker) -> Any:
        """Add the polyline of a marker to the scene.

        Each segment has the colour of its first point. If the marker has no colours for points, all
        segments have the marker's colour. The x scale is the thickness [m]. Points are in the
        scene's frame: the marker's pose and opacity are ignored.

        Args:
            name: Name of the object in the scene.
            marker: Marker of type LINE_STRIP.

        Returns:
            Handle of the object.
        """
        points = np.array([(point.x, point.y, point.z) for point in marker.points])
        given = [_rgb(color) for color in marker.colors] or [_rgb(marker.color)] * len(points)
        colors = np.round(255 * np.array(given)).astype(np.uint8)
        return self._scene.add_line_segments(
            name,
            points=np.stack([points[:-1], points[1:]], axis=1),
            colors=np.stack([colors[:-1], colors[:-1]], axis=1),
            thickness=marker.scale.x,
        )


def _rgb(color: Any) -> tuple[float, float, float]:
    """Return red, green and blue of a ROS colour, each from 0 to 1."""
    return (color.r, color.g, color.b)
