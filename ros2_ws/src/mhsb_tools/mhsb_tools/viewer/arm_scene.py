"""The arm in the browser's scene: links, payload, and cylinders in the colour of their mode.

All moving parts hang below the frame PLANE_FRAME, which turns if the arm slews.
"""

import math
from typing import Any

import numpy as np
from viser import SceneApi

from mhsb_model.figure_style import MODE_COLOR, rgb
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, ModeArray
from mhsb_sim.mechanics.linkage_shapes import BARREL_PAINT, Bar, compute_planar_bars
from mhsb_tools.viewer.shapes import bytes_of, get_rotation_left, get_rotation_to, get_rotation_up

LINK_COLOR = (237, 173, 36)
STEEL_COLOR = (76, 87, 102)
LOAD_COLOR = (140, 41, 36)
LOAD_RADIUS = 0.05  # m
LINK_WIDTH = 0.036  # m, across the arm's plane
FOOT_SIZE = (0.4, 0.32, 0.04)  # m
COLUMN_HEIGHT = 1.2  # m, foot included
FRAME_PERIOD = 0.05  # s
PLANE_FRAME = "/arm/plane"
"""Frame of the arm's plane; its origin is the first joint that moves in the plane."""

SMALLEST_CHANGE = 1e-4  # m, of a bar's length
SMALLEST_TURN = 2e-4
"""Smallest change of a joint that is drawn [rad].

Without it, measurement noise would keep the browser busy while the arm rests.
"""


def _box_of(machine: Machine, j: int) -> tuple[float, float, float]:
    """Compute the size of the box that is drawn for a link.

    Args:
        machine: The arm.
        j: Index of the joint that moves the link, from 0.

    Returns:
        Length, width across the arm's plane, and height [m]. A telescope gets its length at full
        extension. Width and height are chosen for the picture, in proportion to the arm's
        size.
    """
    a, size = machine.arrays, machine.relative_size
    length = float(a.link_length[j])
    if a.slides[j]:
        return length + float(a.joint_max[j]), 0.8 * size * LINK_WIDTH, size * 0.02
    return length, size * LINK_WIDTH, 0.06 * length + size * 0.015


def _add_stand(scene: SceneApi, machine: Machine) -> None:
    """Add the stand to the scene: foot and column, and a turntable if the arm slews.

    Args:
        scene: Scene of the browser.
        machine: The arm. The size of the stand follows from its size.
    """
    size, beside = machine.relative_size, 0.0 if machine.slews else 0.03
    wide, deep, high = (size * each for each in FOOT_SIZE)
    column = size * COLUMN_HEIGHT - high
    scene.add_box(
        "/arm/column",
        color=STEEL_COLOR,
        dimensions=(0.1 * size, 0.06 * size, column),
        position=(0.0, beside, -column / 2),
    )
    scene.add_box(
        "/arm/foot",
        color=STEEL_COLOR,
        dimensions=(wide, deep, high),
        position=(0.0, beside, high / 2 - size * COLUMN_HEIGHT),
    )
    if machine.slews:
        radius = max(machine.arrays.slew_offset, 0.1 * size)
        scene.add_cylinder(
            "/arm/turntable",
            radius=radius,
            height=0.05 * size,
            color=STEEL_COLOR,
            position=(0.0, 0.0, -0.025 * size),
        )


class ArmScene:
    """The arm with its stand below `/arm` in the browser's scene."""

    def __init__(self, scene: SceneApi, machine: Machine) -> None:
        """Add all parts of the arm to the scene.

        The arm is shown in the middle of its joint ranges, with all actuators in mode N.

        Args:
            scene: Scene of the browser.
            machine: The arm.
        """
        self._machine = machine
        size, self._first = machine.relative_size, int(machine.slews)
        """Index from 0 of the first joint that moves in the plane."""
        offset = (machine.arrays.slew_offset, 0.0, 0.0)
        self._plane = scene.add_frame(PLANE_FRAME, show_axes=False, position=offset)
        in_plane = range(self._first, machine.joint_count)
        self._links = {
            j: scene.add_box(
                f"{PLANE_FRAME}/link_{j + 1}", color=LINK_COLOR, dimensions=_box_of(machine, j)
            )
            for j in in_plane
        }
        self._pivots = {
            j: scene.add_cylinder(
                f"{PLANE_FRAME}/pivot_{j + 1}",
                radius=0.022 * size,
                height=0.06 * size,
                color=STEEL_COLOR,
                wxyz=get_rotation_to(np.array([0.0, 1.0, 0.0])),
            )
            for j in in_plane
        }
        self._load = scene.add_icosphere(
            f"{PLANE_FRAME}/load", radius=LOAD_RADIUS * size, color=LOAD_COLOR
        )
        _add_stand(scene, machine)
        self._bars: list[Any] = []
        self._lengths: list[float] = []
        self._barrels: list[int] = []
        middle = (machine.arrays.joint_min + machine.arrays.joint_max) / 2
        for number, bar in enumerate(compute_planar_bars(machine, middle)):
            length = float(np.linalg.norm(bar.end - bar.start))
            self._bars.append(
                scene.add_cylinder(
                    f"{PLANE_FRAME}/bar_{number}",
                    radius=bar.radius,
                    height=length,
                    color=bytes_of(bar.color[:3]),
                )
            )
            self._lengths.append(length)
            if bar.color == BARREL_PAINT:
                self._barrels.append(number)
        self._modes: list[int] = [-1] * machine.joint_count
        self._posture = np.full(machine.joint_count, np.inf)
        self.show(middle, np.zeros(machine.joint_count, dtype=np.uint8))

    def show(self, posture: FloatArray, modes: ModeArray) -> None:
        """Show the arm in a posture, with cylinders in the colours of their modes.

        If no joint has moved by more than SMALLEST_TURN since the last change, the shown posture
        stays. The colours are updated in any case.

        Args:
            posture: Joint positions, shape (n,) [rad; m for telescopes].
            modes: Mode codes of all actuators, uint8 (n,).
        """
        if np.abs(posture - self._posture).max() > SMALLEST_TURN:
            self._posture = np.array(posture)
            self._show_posture(posture)
        for j, barrel in enumerate(self._barrels, start=self._first):  # a slew has no cylinder
            if modes[j] != self._modes[j]:
                self._modes[j] = int(modes[j])
                self._bars[barrel].color = bytes_of(rgb(MODE_COLOR[Mode(self._modes[j])]))

    def _show_posture(self, posture: FloatArray) -> None:
        """Move all parts of the drawing to a posture.

        Args:
            posture: Joint positions, shape (n,) [rad; m for telescopes].
        """
        if self._machine.slews:
            slew = float(posture[0])
            ahead = self._machine.arrays.slew_offset
            self._plane.position = (ahead * math.cos(slew), ahead * math.sin(slew), 0.0)
            self._plane.wxyz = get_rotation_left(slew)
        joints = self._machine.joint_positions(posture)
        angles = self._machine.link_angles(posture)
        for j, link in self._links.items():
            half = _box_of(self._machine, j)[0] / 2
            middle = joints[j + 1] - half * np.array([np.cos(angles[j]), np.sin(angles[j])])
            link.position = (float(middle[0]), 0.0, float(middle[1]))
            link.wxyz = get_rotation_up(float(angles[j]))
            self._pivots[j].position = (float(joints[j, 0]), 0.0, float(joints[j, 1]))
        self._load.position = (float(joints[-1, 0]), 0.0, float(joints[-1, 1]))
        for number, bar in enumerate(compute_planar_bars(self._machine, posture)):
            self._show_bar(number, bar)

    def _show_bar(self, number: int, bar: Bar) -> None:
        """Move a bar of a linkage, such as a cylinder's barrel or a lever, in the drawing.

        Its drawn length is changed only if the new one differs by more than SMALLEST_CHANGE.

        Args:
            number: Index of the bar in `compute_planar_bars`.
            bar: The bar with its new ends in the arm's plane [m].
        """
        handle, way = self._bars[number], bar.end - bar.start
        length = float(np.linalg.norm(way))
        handle.position = tuple(((bar.start + bar.end) / 2).tolist())
        handle.wxyz = get_rotation_to(way / length)
        if abs(length - self._lengths[number]) > SMALLEST_CHANGE:
            self._lengths[number] = length
            handle.height = length
