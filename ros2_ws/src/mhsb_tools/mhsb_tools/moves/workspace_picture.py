"""Picture of the workspace: where the machine holds its load, zones, and the arm at the start."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mhsb_model.figure_style import BLACK, GREY, open_figure
from mhsb_model.machine import Machine
from mhsb_tools.moves.operating_regions import OperatingRegions
from mhsb_tools.moves.workspace_drawing import (
    NO_BOOST_LABEL,
    UNBOOSTABLE_LABEL,
    draw_arm,
    draw_obstacles,
    draw_regions,
    draw_workspace_axes,
    widen_axes_to_arm,
)

FIGURE_WIDTH, FIGURE_HEIGHT = 8.6, 7.4  # in
NO_POSTURE_LABEL = "no posture within the joint limits"
"""Label of the white parts of the operating range."""


def draw_workspace_picture(machine: Machine, regions: OperatingRegions, file: Path) -> None:
    """Draw where the machine holds its load at rest, and write the picture as PNG.

    It shows the arm's plane, x and z [m]: the reachable grid points by the joints that need boost
    there, the operating range, obstacles, and the arm in its start posture. If the arm slews,
    obstacles are drawn for all angles of the slew.

    Args:
        machine: The arm.
        regions: Grid points that the arm reaches, with a column for each joint in the arm's plane.
        file: PNG file to write.
    """
    start = np.array(machine.config.simulation.start_posture)
    modules, pressure = machine.arrays.module_count, machine.arrays.supply_pressure / 1e6
    boost = (
        f"boost up to {machine.arrays.max_boost_pressure / 1e6:.1f} MPa" if modules else "no boost"
    )
    with open_figure(file, FIGURE_HEIGHT, FIGURE_WIDTH) as figure:
        axes = figure.subplots()
        draw_regions(
            regions,
            axes,
            first_joint=2 if machine.slews else 1,
            no_boost_label=NO_BOOST_LABEL if modules else "held at supply pressure",
            unboostable_label=UNBOOSTABLE_LABEL if modules else "beyond the supply pressure",
        )
        draw_workspace_axes(machine, axes)
        draw_obstacles(
            machine, axes, np.vstack([machine.arrays.joint_min, machine.arrays.joint_max])
        )
        draw_arm(machine, start, axes, color=BLACK, alpha=1.0, label="arm in its start posture")
        widen_axes_to_arm(machine, start[np.newaxis], axes)
        axes.set_title(
            f"{machine.name}: where a payload of {machine.arrays.payload:g} kg is held at rest\n"
            f"supply pressure {pressure:.1f} MPa, {boost}"
        )
        axes.scatter(
            [], [], s=110, marker="s", facecolor="white", edgecolor=GREY, label=NO_POSTURE_LABEL
        )
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))
