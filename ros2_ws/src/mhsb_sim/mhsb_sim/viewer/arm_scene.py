"""The arm in the browser's scene: links, payload, and cylinders in the colour of their mode."""

from __future__ import annotations

from typing import Any

import numpy as np
from viser import SceneApi

from mhsb_model.figure_style import MODE_COLOR, rgb
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, ModeArray
from mhsb_sim.mechanics.linkage_shapes import BARREL_PAINT, Bar, linkage_bars
from mhsb_sim.viewer.shapes import along, bytes_of, turned_up

LINK_COLOR = (237, 173, 36)
STEEL = (76, 87, 102)
LOAD_COLOR = (140, 41, 36)
LOAD_RADIUS = 0.05  # m
LINK_WIDTH = 0.036  # m, across the arm's plane
FOOT = (0.4, 0.32, 0.04)  # m
COLUMN = 1.2  # m
SMALLEST_CHANGE = 1e-4  # m, of a bar's length that is drawn
SMALLEST_TURN = 2e-4
"""Of a joint that is drawn [rad]: noise would keep the browser busy while the arm rests."""


def _box_of(machine: Machine, j: int) -> tuple[float, float, float]:
    """Length, width and height of a link; of a telescope all that slides out of the boom [m]."""
    a = machine.arrays
    length = float(a.link_length[j])
    if a.slides[j]:
        return length + float(a.joint_max[j]), 0.8 * LINK_WIDTH, 0.02
    return length, LINK_WIDTH, 0.06 * length + 0.015


class ArmScene:
    """The arm below `/arm`."""

    def __init__(self, scene: SceneApi, machine: Machine) -> None:
        self._machine = machine
        self._links = [
            scene.add_box(f"/arm/link_{j + 1}", color=LINK_COLOR, dimensions=_box_of(machine, j))
            for j in range(machine.joint_count)
        ]
        self._pivots = [
            scene.add_cylinder(
                f"/arm/pivot_{number}",
                radius=0.022,
                height=0.06,
                color=STEEL,
                wxyz=along(np.array([0.0, 1.0, 0.0])),
            )
            for number in range(1, machine.joint_count + 1)
        ]
        self._load = scene.add_icosphere("/arm/load", radius=LOAD_RADIUS, color=LOAD_COLOR)
        scene.add_box(
            "/arm/column",
            color=STEEL,
            dimensions=(0.1, 0.06, COLUMN - FOOT[2]),
            position=(0.0, 0.03, -(COLUMN - FOOT[2]) / 2),
        )
        scene.add_box(
            "/arm/foot", color=STEEL, dimensions=FOOT, position=(0.0, 0.03, FOOT[2] / 2 - COLUMN)
        )
        self._bars: list[Any] = []
        self._lengths: list[float] = []
        self._barrels: list[int] = []
        middle = (machine.arrays.joint_min + machine.arrays.joint_max) / 2
        for number, bar in enumerate(linkage_bars(machine, middle)):
            length = float(np.linalg.norm(bar.end - bar.start))
            self._bars.append(
                scene.add_cylinder(
                    f"/arm/bar_{number}",
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
        for j, mode in enumerate(modes.tolist()):
            if mode != self._modes[j]:
                self._modes[j] = mode
                color = bytes_of(rgb(MODE_COLOR[Mode(mode)]))
                self._bars[self._barrels[j]].color = color

    def _show_posture(self, posture: FloatArray) -> None:
        joints = self._machine.joint_positions(posture)
        for j, angle in enumerate(self._machine.link_angles(posture).tolist()):
            half = _box_of(self._machine, j)[0] / 2
            middle = joints[j + 1] - half * np.array([np.cos(angle), np.sin(angle)])
            self._links[j].position = (float(middle[0]), 0.0, float(middle[1]))
            self._links[j].wxyz = turned_up(angle)
            self._pivots[j].position = (float(joints[j, 0]), 0.0, float(joints[j, 1]))
        self._load.position = (float(joints[-1, 0]), 0.0, float(joints[-1, 1]))
        for number, bar in enumerate(linkage_bars(self._machine, posture)):
            self._show_bar(number, bar)

    def _show_bar(self, number: int, bar: Bar) -> None:
        handle, way = self._bars[number], bar.end - bar.start
        length = float(np.linalg.norm(way))
        handle.position = tuple(((bar.start + bar.end) / 2).tolist())
        handle.wxyz = along(way / length)
        if abs(length - self._lengths[number]) > SMALLEST_CHANGE:
            self._lengths[number] = length
            handle.height = length
