"""Draw docs/arm.png: the suite's own arm in three postures, off screen by MuJoCo.

python docs/arm_picture.py [FILE]

No screen is needed. One of the OpenGL variants EGL or OSMesa must be installed (Debian packages
libegl1, libegl-mesa0 and libgl1-mesa-dri, or libosmesa6).
"""

from __future__ import annotations

import ctypes.util
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from mhsb_model.arrays import FloatArray
from mhsb_model.machine import Machine, load_machine
from mhsb_sim.mechanics.linkage_shapes import Bar, compute_planar_bars

RENDER_BACKENDS = {"egl": "EGL", "osmesa": "OSMesa"}
"""Values of MUJOCO_GL and the libraries that they need, in the order in which they are tried."""

GHOST_OPACITY = 0.3
"""Opacity of the postures before the last one."""

PICTURE_WIDTH, PICTURE_HEIGHT = 960, 720
"""Size of the picture [pixels]."""

SHOWN_POSTURES = ((0.30, -1.40, -1.50), (0.75, -0.95, -0.85), (0.95, -0.45, -0.35))
"""Postures [rad]; the last one is drawn solid, the others pale."""


def choose_backend() -> str | None:
    """Choose an OpenGL variant for off-screen pictures, and set the variable MUJOCO_GL to it.

    MuJoCo reads the variable when it is imported, so call this function before that import. A value
    that the user has set is kept.

    Returns:
        Value of MUJOCO_GL; None if neither EGL nor OSMesa is installed.
    """
    installed = (
        name for name, library in RENDER_BACKENDS.items() if ctypes.util.find_library(library)
    )
    if "MUJOCO_GL" not in os.environ and (first := next(installed, None)):
        os.environ["MUJOCO_GL"] = first
    return os.environ.get("MUJOCO_GL")


def draw_arm(machine: Machine) -> FloatArray:
    """Draw the arm in each of SHOWN_POSTURES, seen from the side, and blend the pictures.

    Each earlier picture is a pale shadow behind the last one. Its pixels are mixed in with the
    share GHOST_OPACITY, but only where this makes the result darker.

    Args:
        machine: The machine; it must not slew.

    Returns:
        Picture, uint8[PICTURE_HEIGHT, PICTURE_WIDTH, 3].
    """
    import mujoco

    from mhsb_sim.mechanics.mujoco_model import build_model

    model = build_model(machine)
    data = mujoco.MjData(model)
    reach = float(np.sum(machine.arrays.link_length))
    camera = mujoco.MjvCamera()
    camera.lookat[:] = (0.40 * reach, 0.0, -0.12 * reach)
    camera.distance, camera.azimuth, camera.elevation = 2.1 * reach, 78.0, -8.0
    layers = []
    with mujoco.Renderer(model, PICTURE_HEIGHT, PICTURE_WIDTH) as renderer:
        for posture in SHOWN_POSTURES:
            data.qpos[:] = posture
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera)
            for bar in compute_planar_bars(machine, np.array(posture)):
                _add_bar(renderer.scene, bar)
            layers.append(renderer.render().astype(np.float64))
    picture = layers.pop()
    for ghost in layers:
        picture = np.minimum(picture, GHOST_OPACITY * ghost + (1.0 - GHOST_OPACITY) * picture)
    return picture.astype(np.uint8)


def _add_bar(scene: Any, bar: Bar) -> None:
    """Add a round bar to a MuJoCo scene as a capsule.

    Args:
        scene: The scene of a renderer, changed in place.
        bar: The bar.
    """
    import mujoco

    geom, kind = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_CAPSULE
    color = np.array(bar.color, dtype=np.float32)
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), color)
    mujoco.mjv_connector(geom, kind, bar.radius, bar.start, bar.end)
    scene.ngeom += 1


def main() -> None:
    """Draw the picture with 256 colours into FILE; end with a sentence if it cannot be drawn."""
    if choose_backend() is None:
        sys.exit(
            "no picture: neither EGL nor OSMesa is installed (apt-get install libegl1 "
            "libegl-mesa0 libgl1-mesa-dri, or libosmesa6)"
        )
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("arm.png")
    picture = Image.fromarray(draw_arm(load_machine()))
    picture.quantize(256, method=Image.Quantize.FASTOCTREE).save(file, optimize=True)


if __name__ == "__main__":
    main()
