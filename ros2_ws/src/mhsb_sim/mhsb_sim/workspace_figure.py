"""Figure of the workspace: the tip's path over the regions where joints need boost."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mhsb_model.kinematics import joint_positions
from mhsb_model.modes import Mode
from mhsb_sim.figure_style import (
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
    written_figure,
)
from mhsb_sim.operating_regions import OperatingRegions
from mhsb_sim.recorded_run import RecordedRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAPER_COLORS = {(0,): ORANGE, (1,): SKY, (0, 1): PURPLE}
"""Of the joints that need boost together, as in the paper's Figure 5."""

OTHER_COLORS = (GREEN, YELLOW, BLUE, VERMILION)

PATH_COLOR = {Mode.N: BLACK, Mode.DB: BLUE, Mode.SB: VERMILION}

PATH_STEP = 0.002
"""Length of path between two points that are drawn [m]."""

HEAVY = "beyond the highest boost"
BORDER = 0.08  # m, beside the workspace
TICKS = 0.25  # m
WIDTH, HEIGHT = 8.0, 8.2  # in


def draw_workspace(run: RecordedRun, regions: OperatingRegions, path: Path) -> None:
    """The measured tip's path, coloured by the highest mode in force, with goals and regions."""
    from matplotlib.ticker import MultipleLocator

    with written_figure(path, HEIGHT, WIDTH) as figure:
        axes = figure.subplots()
        axes.grid(visible=False)
        _draw_regions(regions, axes)
        _draw_outline(run, axes)
        _draw_arm(run, axes)
        _draw_path(run, axes)
        _draw_goals(run, axes)
        axes.set_aspect("equal")
        axes.xaxis.set_major_locator(MultipleLocator(TICKS))
        axes.yaxis.set_major_locator(MultipleLocator(TICKS))
        axes.set_xlabel("x [m]")
        axes.set_ylabel("z [m]")
        figure.legend(loc="outside right upper")


def _draw_regions(regions: OperatingRegions, axes: Axes) -> None:
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


def _draw_outline(run: RecordedRun, axes: Axes) -> None:
    area = run.machine.config.workspace
    arcs = []
    for radius, turn in ((area.max_radius, 1), (area.min_radius, -1)):
        widest = np.arccos(np.clip(area.min_x / radius, -1.0, 1.0)) if radius > 0 else 0.0
        angle = turn * np.linspace(-widest, widest, 200)
        arcs.append(radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    outline = np.vstack([*arcs, arcs[0][:1]])
    axes.plot(*outline.T, color=BLACK, linestyle=":", linewidth=1.2, label="operating range")
    low, high = outline.min(axis=0) - BORDER, outline.max(axis=0) + BORDER
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])


def _draw_arm(run: RecordedRun, axes: Axes) -> None:
    """The links at the beginning and at the end."""
    position = run.recording.joint_states.position
    for q, style, label in (
        (position[0], "--", "arm at the start"),
        (position[-1], "-", "arm at the end"),
    ):
        points = joint_positions(run.machine.arrays.link_length, np.ascontiguousarray(q))
        axes.plot(
            *points.T,
            color=GREY,
            linestyle=style,
            linewidth=3.0,
            alpha=0.7,
            marker="o",
            markersize=5,
            label=label,
        )


def _draw_path(run: RecordedRun, axes: Axes) -> None:
    tip = run.tip.measured
    travelled = np.cumsum(np.hypot(*np.diff(tip, axis=0, prepend=tip[:1]).T))
    mode = run.modes.modes_at_many(run.tip.time_ns).max(axis=1).astype(np.int64)
    kept = np.flatnonzero(np.diff(np.floor(travelled / PATH_STEP), append=np.inf) > 0)
    axes.plot(*tip[kept].T, color="white", linewidth=4.5)
    starts = np.flatnonzero(np.diff(mode, prepend=-1))
    for begin, end in zip(starts, [*starts[1:], len(mode) - 1], strict=True):
        inside = kept[(kept > begin) & (kept < end)]
        rows = np.concatenate([[begin], inside, [end]])
        axes.plot(*tip[rows].T, color=PATH_COLOR[Mode(mode[begin])], linewidth=2.0)
    for each, color in PATH_COLOR.items():
        boosted = "all actuators in N" if each is Mode.N else f"an actuator in {each.name}"
        axes.plot([], [], color=color, linewidth=2.0, label=f"tip, {boosted}")


def _draw_goals(run: RecordedRun, axes: Axes) -> None:
    """A numbered circle at each goal, crossed where it was refused; one for several there."""
    numbers: dict[tuple[float, float, bool], list[str]] = {}
    for number, goal in enumerate(run.goals, start=1):
        place = (goal.verdict.goal_x, goal.verdict.goal_z, goal.verdict.code.accepted)
        if np.all(np.isfinite(place)):
            numbers.setdefault(place, []).append(str(number))
    for accepted, marker, label in (
        (True, "o", "goal, numbered in order"),
        (False, "X", "goal, not accepted"),
    ):
        places = [(x, z) for x, z, taken in numbers if taken is accepted]
        if places:
            axes.plot(
                *np.array(places).T,
                linestyle="none",
                marker=marker,
                markersize=8,
                markerfacecolor="white",
                markeredgecolor=BLACK,
                markeredgewidth=1.4,
                zorder=5,
                label=label,
            )
    for (x, z, _), texts in numbers.items():
        axes.annotate(
            ", ".join(texts),
            (x, z),
            xytext=(7, 5),
            textcoords="offset points",
            fontweight="bold",
            zorder=6,
            clip_on=True,
            bbox={"boxstyle": "round,pad=0.15", "color": "white", "alpha": 0.75},
        )
