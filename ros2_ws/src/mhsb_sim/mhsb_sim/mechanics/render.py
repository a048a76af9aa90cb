"""Pictures of the arm, drawn off screen by MuJoCo.

No screen is needed. One of the OpenGL variants EGL or OSMesa must be installed (Debian packages
libegl1, libegl-mesa0 and libgl1-mesa-dri, or libosmesa6). `python -m mhsb_sim.mechanics.render
docs/arm.png` draws the picture of docs/index.md.
"""

from __future__ import annotations

import ctypes.util
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mhsb_control import load_machine
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_sim.mechanics.linkage_shapes import Bar, compute_linkage_bars

RENDER_BACKENDS = {"egl": "EGL", "osmesa": "OSMesa"}
"""Values of MUJOCO_GL and the libraries that they need, in the order in which they are tried."""

GHOST_OPACITY = 0.3
"""Opacity of the postures before the last one."""
README_POSTURES = ((0.30, -1.40, -1.50), (0.75, -0.95, -0.85), (0.95, -0.45, -0.35))
"""Postures of the documentation's picture [rad]."""


def choose_backend() -> str | None:
    """Choose an OpenGL variant for off-screen pictures, and set the variable MUJOCO_GL to it.

    MuJoCo reads the variable when it is imported, so call this function before that import. A value
    that the user has set is kept.

    Returns:
        Value of MUJOCO_GL; None if neither EGL nor OSMesa is installed.
    """
    if "MUJOCO_GL" in os.environ:
        return os.environ["MUJOCO_GL"]
    for name, library in RENDER_BACKENDS.items():
        if ctypes.util.find_library(library):
            os.environ["MUJOCO_GL"] = name
            return name
    return None


def draw_arm(
    machine: Machine, postures: Sequence[FloatArray], width: int = 960, height: int = 720
) -> FloatArray | None:
    """Draw the arm in one or more postures.

    Links, cylinders and linkages are drawn, seen from the side. If neither EGL nor OSMesa is
    installed, one sentence is printed on stderr instead.

    Args:
        machine: The machine.
        postures: Joint positions of each posture, float64[n], [rad or m]. The last posture is drawn
            solid, the others pale.
        width: Width of the picture in pixels.
        height: Height of the picture in pixels.

    Returns:
        Picture, uint8[height, width, 3]; None if it cannot be drawn.
    """
    if choose_backend() is None:
        print(
            "no picture: neither EGL nor OSMesa is installed (apt-get install libegl1 "
            "libegl-mesa0 libgl1-mesa-dri, or libosmesa6)",
            file=sys.stderr,
        )
        return None
    return _draw(machine, postures, width, height)


def save_arm_picture(machine: Machine, postures: Sequence[FloatArray], file: Path) -> bool:
    """Draw the arm and write the picture as a PNG file with 256 colours.

    Args:
        machine: The machine.
        postures: Joint positions of each posture, float64[n], [rad or m]. The last is drawn solid,
            the others pale.
        file: File to be written; missing folders are made.

    Returns:
        True if the file was written. False if neither EGL nor OSMesa is installed; one sentence is
        then printed on stderr.
    """
    from PIL import Image

    pixels = draw_arm(machine, postures, 960, 720)
    if pixels is None:
        return False
    file.parent.mkdir(parents=True, exist_ok=True)
    picture = Image.fromarray(pixels).quantize(256, method=Image.Quantize.FASTOCTREE)
    picture.save(file, optimize=True)
    return True


def _draw(machine: Machine, postures: Sequence[FloatArray], width: int, height: int) -> FloatArray:
    """Draw the arm in each posture, and blend the earlier pictures into the last one.

    Each earlier picture is a pale shadow behind the last one. Its pixels are mixed in with the
    share GHOST_OPACITY, but only where this makes the result darker.

    Args:
        machine: The machine.
        postures: Joint positions of each posture, float64[n], [rad or m].
        width: Width in pixels.
        height: Height in pixels.

    Returns:
        Picture, uint8[height, width, 3].
    """
    import mujoco

    from mhsb_sim.mechanics.mujoco_model import build_model

    model = build_model(machine)
    data = mujoco.MjData(model)
    reach = float(np.sum(machine.arrays.link_length))
    camera = mujoco.MjvCamera()
    camera.lookat[:] = (0.40 * reach, 0.0, -0.12 * reach)
    camera.distance, camera.azimuth, camera.elevation = 2.1 * reach, 78.0, -8.0
    with mujoco.Renderer(model, height, width) as renderer:
        layers = []
        for posture in postures:
            data.qpos[:] = posture
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera)
            for bar in compute_linkage_bars(machine, np.asarray(posture)):
                _add_bar(renderer.scene, bar)
            layers.append(renderer.render().astype(np.float64))
    picture = layers[-1]
    for ghost in layers[:-1]:
        picture = np.minimum(picture, GHOST_OPACITY * ghost + (1.0 - GHOST_OPACITY) * picture)
    return picture.astype(np.uint8)


def _add_bar(scene: Any, bar: Bar) -> None:
    """Add a round bar to a MuJoCo scene as a capsule.

    Args:
        scene: The scene of a renderer, changed in place.
        bar: The bar.
    """
    import mujoco

    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom,
        mujoco.mjtGeom.mjGEOM_CAPSULE,
        np.zeros(3),
        np.zeros(3),
        np.zeros(9),
        np.array(bar.color, dtype=np.float32),
    )
    mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, bar.radius, bar.start, bar.end)
    scene.ngeom += 1


def main() -> None:
    """Draw the picture of docs/index.md, and exit with code 0, or 1 if it cannot be drawn.

    The first argument of the command line names the file. Without an argument, the file is
    docs/arm.png.
    """
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/arm.png")
    drawn = save_arm_picture(load_machine(), [np.array(q) for q in README_POSTURES], file)
    sys.exit(0 if drawn else 1)


if __name__ == "__main__":
    main()
