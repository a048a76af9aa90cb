"""Abilities of the arm in the browser's scene: velocity polytope of the tip, regions of boost."""

from typing import Any

import numpy as np
from viser import SceneApi

from mhsb_model.figure_style import GREEN, MODE_COLOR, VERMILION, rgb
from mhsb_model.machine import Machine
from mhsb_model.modes import MODE_COUNT, Mode
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_planner.posture.s1_polytope import compute_flow_limits, compute_polytope_vertices
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_tools.viewer.arm_scene import PLANE_FRAME
from mhsb_tools.viewer.shapes import bytes_of

UNMOVABLE_REGION = MODE_COUNT
"""Code of points at which no mode moves all joints both ways, or that no posture reaches."""


def find_needed_mode(machine: Machine, posture: FloatArray) -> int:
    """Return the weakest mode in which every cylinder can move both ways under its static load.

    A mode lets a cylinder move if the planner's flow limits allow a speed above 0 in both
    directions. Each joint needs the mode with the lowest code (N 0, DB 1, SB 2) that does so. The
    highest code over all joints is the result.

    Args:
        machine: The planar arm (without the slewing joint).
        posture: Joint positions, shape (n,) [rad, telescopes m].

    Returns:
        Mode code; UNMOVABLE_REGION if for some joint no mode is enough.
    """
    limit = np.empty((machine.joint_count, MODE_COUNT, 2))
    compute_flow_limits(machine.arrays, posture, limit)
    moves = limit.min(axis=2) > 0.0  # shape (joints, modes)
    weakest = np.where(np.any(moves, axis=1), np.argmax(moves, axis=1), UNMOVABLE_REGION)
    return int(weakest.max())


def compute_boost_regions(machine: Machine, table: PostureTable) -> IntArray:
    """Compute the mode that each node of a posture table needs.

    A node has one posture for each mode combination. Of these, the posture counts whose needed mode
    has the lowest code (N 0, DB 1, SB 2).

    Args:
        machine: The planar arm (without the slewing joint).
        table: Posture table.

    Returns:
        Mode code of each node, int64 (nodes,). UNMOVABLE_REGION means that no mode is enough, or
        that the arm does not reach the node.
    """
    return np.array(
        [
            min(
                (find_needed_mode(machine, q) for q in node if np.isfinite(q[0])),
                default=UNMOVABLE_REGION,
            )
            for node in (np.unique(each, axis=0) for each in table.posture)
        ]
    )


POLYTOPE_SCALE = 0.75
"""Length at which a tip speed of 1 m/s is drawn [m]."""

POLYTOPE_WIDTH = 0.008  # m
POINT_SIZE = 0.014  # m
REGION_OFFSET = 0.08
"""Distance by which regions are drawn behind the arm's plane [m]."""

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
    """Points of the workspace in the colour of the mode that they need."""

    def __init__(self, scene: SceneApi) -> None:
        """Prepare the drawing; nothing is added to the scene yet.

        Args:
            scene: Scene of the browser.
        """
        self._scene = scene
        self._points: Any = None

    def show(self, places: FloatArray, needed: IntArray) -> None:
        """Draw points of the workspace in the colours of modes; they replace those drawn before.

        Args:
            places: Points (x, z) in the arm's plane, shape (k, 2) [m].
            needed: Code of the mode that each point needs, int64 (k,). UNMOVABLE_REGION means that
                no mode is enough.
        """
        self.hide()
        colors = np.array(
            [bytes_of(rgb(MODE_COLOR[mode])) for mode in Mode] + [bytes_of(rgb(VERMILION))]
        )
        points = np.stack([places[:, 0], np.full(len(places), REGION_OFFSET), places[:, 1]], axis=1)
        self._points = self._scene.add_point_cloud(
            f"{PLANE_FRAME}/regions",
            points.astype(np.float32),
            colors[np.minimum(needed, UNMOVABLE_REGION)].astype(np.uint8),
            point_size=POINT_SIZE,
            point_shape="circle",
            point_shading="flat",
        )

    def hide(self) -> None:
        """Remove the points from the scene."""
        if self._points is not None:
            self._points.remove()
            self._points = None
