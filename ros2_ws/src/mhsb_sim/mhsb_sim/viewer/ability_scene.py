"""What the arm is able to do, in the browser's scene: velocities of the tip, regions of boost."""

from __future__ import annotations

from typing import Any

import numpy as np
from viser import SceneApi

from mhsb_model.figure_style import GREEN, MODE_COLOR, VERMILION, rgb
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_planner.posture.s1_polytope import polytope_vertices
from mhsb_sim.viewer.arm_scene import PLANE
from mhsb_sim.viewer.boost_regions import BEYOND
from mhsb_sim.viewer.shapes import bytes_of

POLYTOPE_SCALE = 0.75
"""A speed of the tip of 1 m/s is drawn so many metres long."""

POLYTOPE_WIDTH = 0.008  # m
POINT_SIZE = 0.014  # m
BEHIND = 0.08
"""Regions lie so far behind the arm's plane [m]."""

SMALLEST_TURN = 2e-3
"""Of a joint for which the polytope is drawn anew [rad]."""


class PolytopeScene:
    """Velocities that the tip can take in its posture and modes, as an outline about the tip.

    In the arm's plane, without what slewing adds across it.
    """

    def __init__(self, scene: SceneApi, machine: Machine) -> None:
        self._scene = scene
        self._machine = machine
        self._first = int(machine.slews)
        self._drawn: tuple[FloatArray, ModeArray] | None = None
        self._outline: Any = None

    def show(self, posture: FloatArray, modes: ModeArray) -> None:
        """Draw it for a posture [rad] and modes, where these differ from what is drawn."""
        if self._drawn is not None:
            turned = np.abs(posture - self._drawn[0]).max()
            if turned < SMALLEST_TURN and (modes == self._drawn[1]).all():
                return
        self._drawn = np.array(posture), np.array(modes)
        corners = POLYTOPE_SCALE * polytope_vertices(
            self._machine.plane, posture[self._first :], modes[self._first :]
        )
        x, z = self._machine.tip_position(posture)
        points = np.zeros((len(corners), 3))
        points[:, 0], points[:, 2] = x + corners[:, 0], z + corners[:, 1]
        self._outline = self._scene.add_line_segments(
            f"{PLANE}/velocities",
            np.stack([points, np.roll(points, -1, axis=0)], axis=1),
            bytes_of(rgb(GREEN)),
            thickness=POLYTOPE_WIDTH,
        )

    def hide(self) -> None:
        """Draw nothing."""
        if self._outline is not None:
            self._outline.remove()
            self._outline = self._drawn = None


class RegionScene:
    """Points of the workspace in the colour of the mode that they need."""

    def __init__(self, scene: SceneApi) -> None:
        self._scene = scene
        self._points: Any = None

    def show(self, places: FloatArray, needed: IntArray) -> None:
        """Points (x, z) float64[k, 2] m and the mode codes that they need."""
        self.hide()
        colors = np.array(
            [bytes_of(rgb(MODE_COLOR[mode])) for mode in Mode] + [bytes_of(rgb(VERMILION))]
        )
        points = np.stack([places[:, 0], np.full(len(places), BEHIND), places[:, 1]], axis=1)
        self._points = self._scene.add_point_cloud(
            f"{PLANE}/regions",
            points.astype(np.float32),
            colors[np.minimum(needed, BEYOND)].astype(np.uint8),
            point_size=POINT_SIZE,
            point_shape="circle",
            point_shading="flat",
        )

    def hide(self) -> None:
        """Show none."""
        if self._points is not None:
            self._points.remove()
            self._points = None
