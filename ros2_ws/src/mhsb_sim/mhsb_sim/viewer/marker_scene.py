"""What the planner shows, a MarkerArray, in the browser's scene: path, goal posture, zones."""

from __future__ import annotations

from typing import Any

import numpy as np
from viser import SceneApi
from visualization_msgs.msg import Marker, MarkerArray

from mhsb_sim.viewer.shapes import bytes_of


class MarkerScene:
    """Markers below `/plan`; those of other frames than the arm's own are left out."""

    def __init__(self, scene: SceneApi, frame: str) -> None:
        self._scene = scene
        self._frame = frame
        self._shown: dict[str, Any] = {}

    def show(self, message: MarkerArray) -> None:
        """Add, replace and remove as the message says."""
        kept = self._shown
        for marker in message.markers:
            name = f"/plan/{marker.ns}/{marker.id}"
            if marker.action == Marker.DELETEALL:
                kept, self._shown = {**kept, **self._shown}, {}
            elif marker.header.frame_id == self._frame and marker.action == Marker.ADD:
                self._shown[name] = self._added(name, marker)
        for name in kept.keys() - self._shown.keys():
            kept[name].remove()

    def _added(self, name: str, marker: Marker) -> Any:
        if marker.type == Marker.LINE_STRIP:
            return self._line(name, marker)
        added = self._solid(name, marker)
        place, turn = marker.pose.position, marker.pose.orientation
        added.position = (place.x, place.y, place.z)
        added.wxyz = (turn.w, turn.x, turn.y, turn.z)
        return added

    def _solid(self, name: str, marker: Marker) -> Any:
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
    return (color.r, color.g, color.b)
