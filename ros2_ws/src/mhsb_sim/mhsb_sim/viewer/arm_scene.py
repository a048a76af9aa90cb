"""The arm in the browser's scene: links, payload, and cylinders in the colour of their mode.

All that moves hangs below the frame `PLANE`, which turns where the arm slews.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from viser import SceneApi

from mhsb_model.figure_style import MODE_COLOR, rgb
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, ModeArray
from mhsb_sim.mechanics.linkage_shapes import BARREL_PAINT, Bar, bars_in_plane
from mhsb_sim.viewer.shapes import along, bytes_of, turned_left, turned_up

LINK_COLOR = (237, 173, 36)
STEEL = (76, 87, 102)
LOAD_COLOR = (140, 41, 36)
LOAD_RADIUS = 0.05  # m
LINK_WIDTH = 0.036  # m, across the arm's plane
FOOT = (0.4, 0.32, 0.04)  # m
COLUMN = 1.2  # m
PLANE = "/arm/plane"
"""The arm's plane, its origin at the first joint that moves in it."""

SMALLEST_CHANGE = 1e-4  # m, of a bar's length that is drawn
SMALLEST_TURN = 2e-4
"""Of a joint that is drawn [rad]: noise would keep the browser busy while the arm rests."""


def _box_of(machine: Machine, j: int) -> tuple[float, float, float]:
    """Length, width and height of a link; of a telescope all that slides out of the boom [m]."""
    a, size = machine.arrays, machine.scale
    length = float(a.link_length[j])
    if a.slides[j]:
        return length + float(a.joint_max[j]), 0.8 * size * LINK_WIDTH, size * 0.02
    return length, size * LINK_WIDTH, 0.06 * length + size * 0.015


def _add_stand(scene: SceneApi, machine: Machine) -> None:
    """What the arm stands on: foot and column, with a turntable where it slews."""
    size, beside = machine.scale, 0.0 if machine.slews else 0.03
    wide, deep, high = (size * each for each in FOOT)
    column = size * COLUMN - high
    scene.add_box(
        "/arm/column",
        color=STEEL,
        dimensions=(0.1 * size, 0.06 * size, column),
        position=(0.0, beside, -column / 2),
    )
    scene.add_box(
        "/arm/foot",
        color=STEEL,
        dimensions=(wide, deep, high),
        position=(0.0, beside, high / 2 - size * COLUMN),
    )
    if machine.slews:
        radius = max(machine.arrays.slew_offset, 0.1 * size)
        scene.add_cylinder(
            "/arm/turntable",
            radius=radius,
            height=0.05 * size,
            color=STEEL,
            position=(0.0, 0.0, -0.025 * size),
        )


class ArmScene:
    """The arm below `/arm`."""

    def __init__(self, scene: SceneApi, machine: Machine) -> None:
        self._machine = machine
        size, self._first = machine.scale, int(machine.slews)
        """The first joint that moves in the plane, counted from 0."""
        offset = (machine.arrays.slew_offset, 0.0, 0.0)
        self._plane = scene.add_frame(PLANE, show_axes=False, position=offset)
        in_plane = range(self._first, machine.joint_count)
        self._links = {
            j: scene.add_box(
                f"{PLANE}/link_{j + 1}", color=LINK_COLOR, dimensions=_box_of(machine, j)
            )
            for j in in_plane
        }
        self._pivots = {
            j: scene.add_cylinder(
                f"{PLANE}/pivot_{j + 1}",
                radius=0.022 * size,
                height=0.06 * size,
                color=STEEL,
                wxyz=along(np.array([0.0, 1.0, 0.0])),
            )
            for j in in_plane
        }
        self._load = scene.add_icosphere(
            f"{PLANE}/load", radius=LOAD_RADIUS * size, color=LOAD_COLOR
        )
        _add_stand(scene, machine)
        self._bars: list[Any] = []
        self._lengths: list[float] = []
        self._barrels: list[int] = []
        middle = (machine.arrays.joint_min + machine.arrays.joint_max) / 2
        for number, bar in enumerate(bars_in_plane(machine, middle)):
            length = float(np.linalg.norm(bar.end - bar.start))
            self._bars.append(
                scene.add_cylinder(
                    f"{PLANE}/bar_{number}",
                    radius=bar.radius,
                    height=length,
                    color=bytes_of(bar.paint[:3]),
                )
            )
            self._lengths.append(length)
            if bar.paint == BARREL_PAINT:
                self._barrels.append(number)
        self._modes: list[int] = [-1] * machine.joint_count
        self._posture = np.full(machine.joint_count, np.inf)
        self.show(middle, np.zeros(machine.joint_count, dtype=np.uint8))

    def show(self, posture: FloatArray, modes: ModeArray) -> None:
        """The arm in a posture [rad] with its actuators in these modes."""
        if np.abs(posture - self._posture).max() > SMALLEST_TURN:
            self._posture = np.array(posture)
            self._show_posture(posture)
        for j, barrel in enumerate(self._barrels, start=self._first):  # what slews has none
            if modes[j] != self._modes[j]:
                self._modes[j] = int(modes[j])
                self._bars[barrel].color = bytes_of(rgb(MODE_COLOR[Mode(self._modes[j])]))

    def _show_posture(self, posture: FloatArray) -> None:
        if self._machine.slews:
            slew = float(posture[0])
            ahead = self._machine.arrays.slew_offset
            self._plane.position = (ahead * math.cos(slew), ahead * math.sin(slew), 0.0)
            self._plane.wxyz = turned_left(slew)
        joints = self._machine.joint_positions(posture)
        angles = self._machine.link_angles(posture)
        for j, link in self._links.items():
            half = _box_of(self._machine, j)[0] / 2
            middle = joints[j + 1] - half * np.array([np.cos(angles[j]), np.sin(angles[j])])
            link.position = (float(middle[0]), 0.0, float(middle[1]))
            link.wxyz = turned_up(float(angles[j]))
            self._pivots[j].position = (float(joints[j, 0]), 0.0, float(joints[j, 1]))
        self._load.position = (float(joints[-1, 0]), 0.0, float(joints[-1, 1]))
        for number, bar in enumerate(bars_in_plane(self._machine, posture)):
            self._show_bar(number, bar)

    def _show_bar(self, number: int, bar: Bar) -> None:
        handle, way = self._bars[number], bar.end - bar.start
        length = float(np.linalg.norm(way))
        handle.position = tuple(((bar.start + bar.end) / 2).tolist())
        handle.wxyz = along(way / length)
        if abs(length - self._lengths[number]) > SMALLEST_CHANGE:
            self._lengths[number] = length
            handle.height = length
