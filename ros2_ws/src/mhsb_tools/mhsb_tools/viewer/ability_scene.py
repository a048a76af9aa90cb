"""Abilities of the arm in the browser's scene: velocity polytope of the tip, regions of boost."""

from typing import Any

import numpy as np
from viser import SceneApi

from mhsb_model.figure_style import GREEN, MODE_COLOR, VERMILION, rgb
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.posture.s1_polytope import compute_polytope_vertices
from mhsb_tools.moves.operating_regions import OperatingRegions
from mhsb_tools.viewer.arm_scene import PLANE_FRAME
from mhsb_tools.viewer.shapes import bytes_of

POLYTOPE_SCALE = 0.75
"""Length at which a tip speed of 1 m/s is drawn [m]."""

POLYTOPE_WIDTH = 0.008  # m
POINT_SIZE = 0.014  # m
REGION_OFFSET = 0.08
"""Distance by which regions are drawn behind the arm's plane [m]."""
REGION_COLORS = (MODE_COLOR[Mode.N], MODE_COLOR[Mode.DB], VERMILION)
"""Colours of points that the main pump holds, that need boost, and that cannot be held."""

SMALLEST_TURN = 2e-3
"""The polytope is drawn again if a joint has changed by at least this angle [rad]."""


class PolytopeScene:
    """Outline of the velocities that the tip can take, drawn around the tip in the arm's plane.

    A slew's contribution across the plane is not shown.
    """

    def __init__(self, scene: SceneApi, machine: Machine) -> None:
        """Prepare the drawing; nothing is added to the scene yet.

        Args:
            scene: Scene of the browser.
            machine: The arm.
        """
        self._scene = scene
        self._machine = machine
        self._first = int(machine.slews)
        self._drawn: tuple[FloatArray, ModeArray] | None = None
        self._outline: Any = None

    def show(self, posture: FloatArray, modes: ModeArray) -> None:
        """Draw the velocity polytope for a posture and its modes around the tip.

        The velocity polytope is the set of tip velocities that the pistons' speed limits allow. The
        drawing is left as it is if the modes are unchanged and no joint has moved by SMALLEST_TURN
        or more since the last drawing.

        Args:
            posture: Joint positions, shape (n,) [rad, telescopes m].
            modes: Mode codes of all actuators, uint8 (n,).
        """
        if self._drawn is not None:
            turned = np.abs(posture - self._drawn[0]).max()
            if turned < SMALLEST_TURN and (modes == self._drawn[1]).all():
                return
        self._drawn = np.array(posture), np.array(modes)
        corners = POLYTOPE_SCALE * compute_polytope_vertices(
            self._machine.planar_arm, posture[self._first :], modes[self._first :]
        )
        x, z = self._machine.tip_position(posture)
        points = np.zeros((len(corners), 3))
        points[:, 0], points[:, 2] = x + corners[:, 0], z + corners[:, 1]
        self._outline = self._scene.add_line_segments(
            f"{PLANE_FRAME}/velocities",
            np.stack([points, np.roll(points, -1, axis=0)], axis=1),
            bytes_of(rgb(GREEN)),
            thickness=POLYTOPE_WIDTH,
        )

    def hide(self) -> None:
        """Remove the outline from the scene."""
        if self._outline is not None:
            self._outline.remove()
            self._outline = self._drawn = None


class RegionScene:
    """Points of the workspace in the colour of the supply that holds the load there."""

    def __init__(self, scene: SceneApi) -> None:
        """Prepare the drawing; nothing is added to the scene yet.

        Args:
            scene: Scene of the browser.
        """
        self._scene = scene
        self._points: Any = None

    def show(self, regions: OperatingRegions) -> None:
        """Draw points of the workspace; they replace those drawn before.

        A point is pale if the main pump alone holds the load there, blue if some joint needs boost,
        and red if even the highest boost is too low.

        Args:
            regions: The points, in the arm's plane.
        """
        self.hide()
        x, z = regions.spacing * regions.nodes.T
        colors = np.array([bytes_of(rgb(each)) for each in REGION_COLORS])
        supply = np.where(regions.beyond_highest_boost, 2, regions.needs_boost)
        self._points = self._scene.add_point_cloud(
            f"{PLANE_FRAME}/regions",
            np.column_stack([x, np.full(len(x), REGION_OFFSET), z]).astype(np.float32),
            colors[supply].astype(np.uint8),
            point_size=POINT_SIZE,
            point_shape="circle",
            point_shading="flat",
        )

    def hide(self) -> None:
        """Remove the points from the scene."""
        if self._points is not None:
            self._points.remove()
            self._points = None
