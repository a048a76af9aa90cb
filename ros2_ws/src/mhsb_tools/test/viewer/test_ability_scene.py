"""What the arm is able to do, as the scene is told, by a server without a browser."""

import numpy as np
import pytest

from mhsb_model.figure_style import MODE_COLOR, VERMILION
from mhsb_model.machine import load_machine
from mhsb_model.modes import Mode
from mhsb_planner.posture.s1_polytope import compute_polytope_area
from mhsb_tools.moves.operating_regions import OperatingRegions
from mhsb_tools.viewer.ability_scene import (
    POLYTOPE_SCALE,
    PolytopeScene,
    RegionScene,
)
from mhsb_tools.viewer.server import open_server


@pytest.fixture(scope="module")
def server():
    opened = open_server("127.0.0.1", 0)
    yield opened
    opened.stop()


def test_the_outline_at_the_tip_has_the_polytopes_area(server):
    machine = load_machine()
    scene = PolytopeScene(server.scene, machine)
    posture = machine.arrays.joint_min + 0.4 * (machine.arrays.joint_max - machine.arrays.joint_min)
    modes = np.zeros(3, dtype=np.uint8)
    scene.show(posture, modes)
    x, z = machine.tip_position(posture)
    corners = scene._outline.points[:, 0, ::2] - (x, z)
    ahead = np.roll(corners, -1, axis=0)
    area = 0.5 * (corners[:, 0] * ahead[:, 1] - corners[:, 1] * ahead[:, 0]).sum()
    wanted = POLYTOPE_SCALE**2 * compute_polytope_area(machine, posture, modes)
    assert area == pytest.approx(wanted, rel=1e-3)
    scene.hide()
    scene.show(posture, modes)
    assert scene._outline is not None


def test_points_are_pale_blue_or_red_by_the_supply_that_holds_the_load(server):
    scene = RegionScene(server.scene)
    nodes = np.array([[6, 2], [10, 4], [12, 6], [18, 8]])
    boosted = np.array([[False, False], [True, False], [False, False], [True, True]])
    heavy = np.array([False, False, True, True])
    scene.show(OperatingRegions(0.05, nodes, boosted, heavy))
    np.testing.assert_allclose(scene._points.points[:, ::2], 0.05 * nodes, rtol=1e-3)
    colors = MODE_COLOR[Mode.N], MODE_COLOR[Mode.DB], VERMILION, VERMILION
    shown = [f"#{bytes(color).hex()}".upper() for color in scene._points.colors.tolist()]
    assert shown == [color.upper() for color in colors]
    scene.hide()
    assert scene._points is None
