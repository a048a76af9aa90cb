"""Drawing of the workspace: operating regions, border, obstacles, arm, and a picture of them."""

from pathlib import Path
from typing import Any

import numpy as np

from mhsb_model.figure_style import (
    BLACK,
    BROWN,
    GREEN,
    GREY,
    PALE,
    PURPLE,
    TEAL,
    VERMILION,
    YELLOW,
    Axes,
    open_figure,
)
from mhsb_model.machine import Machine
from mhsb_model.obstacles.shadows import compute_shadows
from mhsb_model.obstacles.zones import (
    CIRCLE_KIND,
    KIND_COLUMN,
    LINK_COLUMN,
    LINK_KIND,
    OBSTACLE_COLUMN,
    RADIUS_COLUMN,
    SHAPE_COLUMN,
)
from mhsb_model.types import FloatArray
from mhsb_tools.moves.operating_regions import OperatingRegions

SET_COLORS = {(0,): YELLOW, (1,): GREEN, (0, 1): PURPLE}
"""Colours of the sets of joints that need boost together in the paper's Figure 5."""

OTHER_COLORS = (TEAL, BROWN)
"""Colours of sets of joints that the paper's figure does not have."""
NO_BOOST_LABEL, UNBOOSTABLE_LABEL = "no joint needs boost", "beyond the highest boost"
"""Labels of nodes at which no joint needs boost, and at which the highest boost is too low."""
PICTURE_WIDTH, PICTURE_HEIGHT = 8.6, 7.4  # in
NO_POSTURE_LABEL = "no posture within the joint limits"
"""Label of the white parts of the operating range."""

OUTLINE_STYLE = {"fill": False, "edgecolor": VERMILION, "linestyle": "--", "linewidth": 1.5}
IN_PLANE: tuple[dict[str, Any], ...] = (
    {"facecolor": VERMILION, "alpha": 0.35, "label": "keep-out"},
    {"facecolor": VERMILION, "alpha": 0.15, "label": "keep-out of the tip"},
)
IN_SHADOW: tuple[dict[str, Any], ...] = (
    OUTLINE_STYLE | {"alpha": 0.8, "label": "keep-out at some angle of the slew"},
    OUTLINE_STYLE | {"alpha": 0.4, "label": "the tip's at some angle of the slew"},
)
"""Styles of obstacles in the plane and of shadows of zones in space: for the whole arm, and for its
tip alone.
"""

BORDER_WIDTH = 0.08
"""Margin of the axes around the workspace [m]."""
TICK_SPACING = 0.25
"""Distance of ticks for an arm of the paper's size [m]."""


def draw_workspace_axes(machine: Machine, axes: Axes) -> None:
    """Set up axes x, z [m] of equal scale around the workspace and draw its border.

    Args:
        machine: The arm. If it slews, x and z are in the plane that joint 1 turns, and count from
            joint 2.
        axes: Axes to set up: limits, scale, ticks and labels.
    """
    from matplotlib.ticker import MultipleLocator

    axes.grid(visible=False)
    draw_outline(machine, axes)
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(TICK_SPACING * max(1, round(machine.relative_size))))
    turns = " in the plane that joint 1 turns, from joint 2" if machine.slews else ""
    axes.set(xlabel=f"x{turns} [m]", ylabel="z [m]")


def draw_regions(
    regions: OperatingRegions,
    axes: Axes,
    first_joint: int = 1,
    no_boost_label: str = NO_BOOST_LABEL,
    unboostable_label: str = UNBOOSTABLE_LABEL,
) -> None:
    """Draw a square for each node, coloured by the joints that need boost there.

    The node is at the middle of its square. A cross marks a node at which even the highest boost
    pressure is too low for some joint. Each set of joints that need boost together has its own
    colour and label; the legend itself is not drawn.

    Args:
        regions: The operating regions.
        axes: Axes to draw on.
        first_joint: Number of the joint of the first column of `regions.boosted`.
        no_boost_label: Label of nodes at which no joint needs boost.
        unboostable_label: Label of nodes at which even the highest boost pressure is too low.
    """
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    half = regions.spacing / 2
    for label, color, chosen in _kinds(regions, first_joint, no_boost_label):
        corners = regions.spacing * regions.nodes[chosen] - half
        squares = [Rectangle((x, z), 2 * half, 2 * half) for x, z in corners]
        look: dict[str, Any] = {"facecolor": color, "edgecolor": "white", "alpha": 0.5}
        axes.add_collection(PatchCollection(squares, linewidth=0.4, **look))
        axes.scatter([], [], s=110, marker="s", label=label, **look)
    if np.any(regions.beyond_highest_boost):
        x, z = regions.spacing * regions.nodes[regions.beyond_highest_boost].T
        axes.scatter(x, z, s=12, marker="x", color=GREY, linewidth=0.8, label=unboostable_label)


def _kinds(
    regions: OperatingRegions, first_joint: int, no_boost_label: str
) -> list[tuple[str, str, np.ndarray]]:
    """Group the nodes by the set of joints that need boost there.

    The set may be empty. Sets that no node has are left out.

    Args:
        regions: The operating regions. Only `boosted` is read.
        first_joint: Number of the joint of the first column of `regions.boosted`.
        no_boost_label: Label of the empty set.

    Returns:
        For each set its label, its colour, and flags of the nodes that have it, bool of shape
        (nodes,). Sets with fewer joints come first.
    """
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
            kinds.append((no_boost_label, PALE, chosen))
        else:
            names = " and ".join(f"joint {j + first_joint}" for j in joints)
            needs = "needs" if len(joints) == 1 else "need"
            color = SET_COLORS.get(joints) or next(others, GREY)
            kinds.append((f"{names} {needs} boost", color, chosen))
    return kinds


def draw_outline(machine: Machine, axes: Axes) -> None:
    """Draw the border of the workspace and set the limits of the axes.

    The limits show the whole border and the arm's base, with a margin of BORDER_WIDTH.

    Args:
        machine: The arm; its workspace has a smallest radius, a largest radius and a smallest x.
        axes: Axes to draw on.
    """
    area = machine.config.workspace
    arcs = []
    for radius, turn in ((area.max_radius, 1), (area.min_radius, -1)):
        widest = np.arccos(np.clip(area.min_x / radius, -1.0, 1.0)) if radius > 0 else 0.0
        angle = turn * np.linspace(-widest, widest, 200)
        arcs.append(radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    outline = np.vstack([*arcs, arcs[0][:1]])
    axes.plot(*outline.T, color=BLACK, linestyle=":", linewidth=1.2, label="operating range")
    low, high = outline.min(axis=0) - BORDER_WIDTH, outline.max(axis=0) + BORDER_WIDTH
    axes.set_xlim(min(low[0], -BORDER_WIDTH), high[0])  # includes the arm's base
    axes.set_ylim(low[1], high[1])


def draw_obstacles(machine: Machine, axes: Axes, postures: FloatArray) -> None:
    """Draw keep-out zones, ground and base in the arm's plane.

    Obstacles of the whole arm are darker than those that only the tip must keep out of. If the arm
    slews, a zone in space is drawn as the outline of its shadow. The shadow is the part of the
    plane that meets the zone at some slew angle of the move. The drawn arm may therefore be inside
    a shadow without touching the zone.

    Args:
        machine: The arm with its obstacles.
        axes: Axes to draw on.
        postures: Postures of the move, shape (k, n) [rad or m]. Only the range of slew angles is
            used.
    """
    own = machine.obstacles
    _draw_rows(own.rows[~own.is_in_space], machine.joint_count, axes, IN_PLANE)
    if own.is_in_space.any():
        turned = postures[:, 0].min(), postures[:, 0].max()
        shadows = compute_shadows(own, machine.arrays.slew_offset, *turned)
        _draw_rows(shadows.rows, machine.planar_arm.joint_count, axes, IN_SHADOW)


def _draw_rows(rows: FloatArray, tip: int, axes: Axes, looks: tuple[dict[str, Any], ...]) -> None:
    """Draw the circles and boxes of an obstacle table in the arm's plane.

    A shape that several rows describe is drawn once. All obstacles of the whole arm share one
    label, and all obstacles of the tip alone another label. Rows that stand for a link of the arm
    itself are skipped.

    Args:
        rows: Obstacle table with the columns of `obstacles.zones`, without zones in space. A shape
            may have several rows, one for each link that must keep out of it.
        tip: Value in the column `LINK_COLUMN` if only the tip must keep out.
        axes: Axes to draw on.
        looks: Matplotlib patch properties for obstacles of the whole arm, and for those of the tip
            alone.
    """
    from matplotlib.patches import Circle, Rectangle

    drawn: set[tuple[float, ...]] = set()
    labelled: set[bool] = set()
    for row in rows:
        shape, of_tip = (
            (row[OBSTACLE_COLUMN], *row[SHAPE_COLUMN:RADIUS_COLUMN]),
            bool(row[LINK_COLUMN] == tip),
        )
        if row[KIND_COLUMN] == LINK_KIND or shape in drawn:
            continue
        look = looks[of_tip] | ({"label": None} if of_tip in labelled else {})
        drawn.add(shape)
        labelled.add(of_tip)
        first, second, third, fourth = row[SHAPE_COLUMN : SHAPE_COLUMN + 4]
        if row[KIND_COLUMN] == CIRCLE_KIND:
            axes.add_patch(Circle((first, second), third, **look))
        else:
            axes.add_patch(Rectangle((first, second), third - first, fourth - second, **look))


def draw_arm(machine: Machine, q: FloatArray, axes: Axes, **style: Any) -> None:
    """Draw the links of the arm in one posture, as a line with a dot at each joint.

    Args:
        machine: The arm.
        q: Posture, shape (n,) [rad, telescopes m].
        axes: Axes to draw on.
        **style: Line properties that replace the default ones.
    """
    points = machine.joint_positions(q)
    look: dict[str, Any] = {"color": GREY, "linewidth": 3.0, "alpha": 0.7}
    axes.plot(*points.T, marker="o", markersize=5, **(look | style))


def draw_arm_at_ends(machine: Machine, postures: FloatArray, axes: Axes) -> None:
    """Draw the arm at the start of a motion (dashed) and at its end (solid), with labels.

    Args:
        machine: The arm.
        postures: Postures of the motion, shape (k, n) [rad, telescopes m].
        axes: Axes to draw on.
    """
    for row, style, label in ((0, "--", "arm at the start"), (-1, "-", "arm at the end")):
        draw_arm(machine, postures[row], axes, linestyle=style, label=label)


def widen_axes_to_arm(machine: Machine, postures: FloatArray, axes: Axes) -> None:
    """Widen the axes so that the arm fits in, with a margin of BORDER_WIDTH.

    Args:
        machine: The arm.
        postures: Postures of the arm, shape (k, n) [rad or m].
        axes: Axes whose limits are widened.
    """
    points = np.vstack([machine.joint_positions(q) for q in postures])
    low, high = points.min(axis=0) - BORDER_WIDTH, points.max(axis=0) + BORDER_WIDTH
    for limits, put, least, most in (
        (axes.get_xlim(), axes.set_xlim, low[0], high[0]),
        (axes.get_ylim(), axes.set_ylim, low[1], high[1]),
    ):
        put(min(limits[0], least), max(limits[1], most))


def draw_workspace_picture(machine: Machine, regions: OperatingRegions, file: Path) -> None:
    """Draw where the machine holds its load at rest, and write the picture as PNG.

    It shows the arm's plane, x and z [m]. Reachable grid points have the colour of the joints that
    need boost there. Operating range, obstacles and the arm in its start posture are drawn, too. If
    the arm slews,
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
    with open_figure(file, PICTURE_HEIGHT, PICTURE_WIDTH) as figure:
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
