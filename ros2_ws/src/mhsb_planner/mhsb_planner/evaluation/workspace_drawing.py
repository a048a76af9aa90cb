"""The workspace on a figure's axes: where joints need boost, its border, the arm."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mhsb_model.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    PURPLE,
    SKY,
    VERMILION,
    YELLOW,
)
from mhsb_model.machine import Machine
from mhsb_model.obstacles.shadows import shadows_between
from mhsb_model.obstacles.zones import CIRCLE, KIND, LINK, NUMBER, PART, RADIUS, SHAPE
from mhsb_model.types import FloatArray
from mhsb_planner.evaluation.operating_regions import OperatingRegions

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAPER_COLORS = {(0,): ORANGE, (1,): SKY, (0, 1): PURPLE}
"""Of the joints that need boost together, as in the paper's Figure 5."""

OTHER_COLORS = (GREEN, YELLOW, BLUE, VERMILION)
HEAVY = "beyond the highest boost"
OUTLINE = {"fill": False, "edgecolor": VERMILION, "linestyle": "--", "linewidth": 1.5}
IN_PLANE: tuple[dict[str, Any], ...] = (
    {"facecolor": VERMILION, "alpha": 0.35, "label": "keep-out"},
    {"facecolor": VERMILION, "alpha": 0.15, "label": "keep-out of the tip"},
)
IN_SHADOW: tuple[dict[str, Any], ...] = (
    OUTLINE | {"alpha": 0.8, "label": "keep-out at some angle of the slew"},
    OUTLINE | {"alpha": 0.4, "label": "the tip's at some angle of the slew"},
)
"""What the whole arm keeps out of, and its tip alone."""

BORDER = 0.08  # m, beside the workspace
TICKS = 0.25  # m


def draw_workspace_axes(machine: Machine, axes: Axes) -> None:
    """Axes x, z [m] of equal scale around the workspace, with its border."""
    from matplotlib.ticker import MultipleLocator

    axes.grid(visible=False)
    draw_outline(machine, axes)
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(TICKS * max(1, round(machine.scale))))
    turns = " in the plane that joint 1 turns, from joint 2" if machine.slews else ""
    axes.set_xlabel(f"x{turns} [m]")
    axes.set_ylabel("z [m]")


def draw_regions(regions: OperatingRegions, axes: Axes) -> None:
    """A square for each node, and a legend entry for each kind of region."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    half = regions.spacing / 2
    for label, color, chosen in _kinds(regions):
        corners = regions.spacing * regions.nodes[chosen] - half
        squares = [Rectangle((x, z), 2 * half, 2 * half) for x, z in corners]
        look: dict[str, Any] = {"facecolor": color, "edgecolor": "white", "alpha": 0.5}
        axes.add_collection(PatchCollection(squares, linewidth=0.4, **look))
        axes.scatter([], [], s=110, marker="s", label=label, **look)
    if np.any(regions.heavy):
        x, z = regions.spacing * regions.nodes[regions.heavy].T
        axes.scatter(x, z, s=12, marker="x", color=GREY, linewidth=0.8, label=HEAVY)


def _kinds(regions: OperatingRegions) -> list[tuple[str, str, np.ndarray]]:
    """Label, colour and nodes (bool) of each set of joints that need boost together."""
    sets = sorted(
        {tuple(np.flatnonzero(row).tolist()) for row in regions.boosted},
        key=lambda joints: (len(joints), joints),
    )
    others = iter(OTHER_COLORS)
    kinds = []
    for joints in sets:
        wanted = np.isin(np.arange(regions.boosted.shape[1]), joints)
        chosen = np.all(regions.boosted == wanted, axis=1)
        if not joints:
            kinds.append(("no joint needs boost", PALE, chosen))
        else:
            names = " and ".join(f"joint {j + 1}" for j in joints)
            needs = "needs" if len(joints) == 1 else "need"
            color = PAPER_COLORS.get(joints) or next(others, GREY)
            kinds.append((f"{names} {needs} boost", color, chosen))
    return kinds


def draw_outline(machine: Machine, axes: Axes) -> None:
    """The border of the region in which the tip may be asked to work."""
    area = machine.config.workspace
    arcs = []
    for radius, turn in ((area.max_radius, 1), (area.min_radius, -1)):
        widest = np.arccos(np.clip(area.min_x / radius, -1.0, 1.0)) if radius > 0 else 0.0
        angle = turn * np.linspace(-widest, widest, 200)
        arcs.append(radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    outline = np.vstack([*arcs, arcs[0][:1]])
    axes.plot(*outline.T, color=BLACK, linestyle=":", linewidth=1.2, label="operating range")
    low, high = outline.min(axis=0) - BORDER, outline.max(axis=0) + BORDER
    axes.set_xlim(min(low[0], -BORDER), high[0])  # with the foot of the arm
    axes.set_ylim(low[1], high[1])


def draw_obstacles(machine: Machine, axes: Axes, postures: FloatArray) -> None:
    """Zones, ground and base: what the whole arm keeps out of, and paler what its tip does.

    postures  float64[k, n] in which the arm is; where it slews, zones in space are drawn as the
              shadows that they have in its plane, at any of the angles that it turns through, only
              outlined: the arm may well be in a shadow while its plane is beside the zone
    """
    own = machine.obstacles
    _draw_rows(own.rows[~own.in_space], machine.joint_count, axes, IN_PLANE)
    if own.in_space.any():
        turned = postures[:, 0].min(), postures[:, 0].max()
        shadows = shadows_between(own, machine.arrays.slew_offset, *turned)
        _draw_rows(shadows.rows, machine.plane.joint_count, axes, IN_SHADOW)


def _draw_rows(
    rows: FloatArray, tip: int, axes: Axes, looks: tuple[dict[str, Any], ...]
) -> None:
    """Patches of obstacles in the plane, each once, as each of the labels is.

    tip    the part of the arm that is its tip alone
    looks  of what holds for the whole arm, and for that part
    """
    from matplotlib.patches import Circle, Rectangle

    drawn: set[tuple[float, ...]] = set()
    labelled: set[bool] = set()
    for row in rows:
        shape, of_tip = (row[NUMBER], *row[SHAPE:RADIUS]), bool(row[PART] == tip)
        if row[KIND] == LINK or shape in drawn:
            continue
        look = looks[of_tip] | ({"label": None} if of_tip in labelled else {})
        drawn.add(shape)
        labelled.add(of_tip)
        first, second, third, fourth = row[SHAPE:SHAPE + 4]
        if row[KIND] == CIRCLE:
            axes.add_patch(Circle((first, second), third, **look))
        else:
            axes.add_patch(Rectangle((first, second), third - first, fourth - second, **look))


def draw_arm(machine: Machine, q: FloatArray, axes: Axes, **style: Any) -> None:
    """The links in posture q [rad]."""
    points = machine.joint_positions(q)
    look: dict[str, Any] = {"color": GREY, "linewidth": 3.0, "alpha": 0.7}
    axes.plot(*points.T, marker="o", markersize=5, **(look | style))
