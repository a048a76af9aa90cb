"""The planner's markers (path, goal posture, zones) in the browser's scene."""

from __future__ import annotations

from typing import Any

import numpy as np
from viser import SceneApi
from visualization_msgs.msg import Marker, MarkerArray

from mhsb_tools.viewer.shapes import bytes_of


class MarkerScene:
    """Markers below `/plan` in the browser's scene."""

    def __init__(self, scene: SceneApi, frame: str) -> None:
        """Prepare an empty drawing.

        Args:
            scene: Scene of the browser.
            frame: Frame whose markers are shown; markers in other frames are ignored.
        """
        self._scene = scene
        self._frame = frame
        self._shown: dict[str, Any] = {}

    def show(self, message: MarkerArray) -> None:
        """Add and replace markers, and remove all former ones if the message asks for it.

        Of the marker actions, ADD and DELETEALL are supported.

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

        A line strip is drawn at its points, and the marker's pose is ignored. Every other type gets
        the marker's pose.

        Args:
            name: Name of the object in the scene.
            marker: The marker.

        Returns:
            Handle of the object.
        """
        if marker.type == Marker.LINE_STRIP:
            return self._line(name, marker)
        added = self._solid(name, marker)
        place, turn = marker.pose.position, marker.pose.orientation
        added.position = (place.x, place.y, place.z)
        added.wxyz = (turn.w, turn.x, turn.y, turn.z)
        return added

    def _solid(self, name: str, marker: Marker) -> Any:
        """Add a box, a cylinder, or a sphere for any other type, at the origin.

        Colour, opacity and scale are taken from the marker. Half of its x scale is the radius.

        Args:
            name: Name of the object in the scene.
            marker: The marker; its pose is not used.

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
        """Add a polyline.

        Each segment has the colour of its first point, or the marker's colour if there are no
        colours of points. The x scale is the thickness.

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
