"""Figures 3 and 9: admissible joint velocities, and the polytope of the tip's velocities."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import ConvexHull

from mhsb_model.figure_style import (
    BLUE,
    GREY,
    ORANGE,
    SKY,
    VERMILION,
    legend_above,
    written_figure,
)
from mhsb_model.modes import Mode, pattern_name
from mhsb_model.types import FloatArray
from mhsb_planner.evaluation.reproduction.measures import polytope_profile
from mhsb_planner.evaluation.reproduction.path_figures import PANEL, draw_discrete_path
from mhsb_planner.evaluation.reproduction.runs import Run, Runs
from mhsb_planner.evaluation.workspace_drawing import draw_arm, draw_workspace_axes
from mhsb_planner.posture.s1_polytope import piston_speed_corners, polytope_vertices
from mhsb_planner.result_files import write_rows
from mhsb_planner.search.discrete_path import DiscretePath

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN_PATTERN = (Mode.SB, Mode.DB, Mode.N)
"""Modes of Figure 3."""

SHOWN_RADIUS = 0.4
"""Size at which the largest polytope of Figure 9 is drawn [m]."""

EVERY = 2
"""Figure 9 shows the polytope of every so many steps."""

COMPARED = ("4-1", "4-2", "4-3")
COLORS = (BLUE, ORANGE, VERMILION)


def draw_velocity_polytope(runs: Runs, folder: Path, figure_name: str) -> list[Path]:
    """Joint velocities on the left, tip velocities on the right, at the start of Case 1-1."""
    machine, table = runs.machine, runs.table
    x, z = runs["1-1"].setting.case.start
    node = int(np.argmin(np.hypot(*(table.nodes * table.spacing - (x, z)).T)))
    pattern = int(np.flatnonzero(np.all(table.patterns == SHOWN_PATTERN, axis=1))[0])
    q = table.posture[node, pattern]
    joint = piston_speed_corners(machine, q, table.patterns[pattern]) / machine.moment_arms(q)
    tip = polytope_vertices(machine, q, table.patterns[pattern])
    picture = folder / f"{figure_name}.png"
    with written_figure(picture, 4.6) as figure:
        _draw_body(joint, figure)
        axes = figure.add_subplot(1, 2, 2)
        axes.fill(*tip.T, facecolor=ORANGE, edgecolor=VERMILION, alpha=0.5)
        axes.set_aspect("equal")
        axes.set_xlabel("tip velocity along x [m/s]")
        axes.set_ylabel("tip velocity along z [m/s]")
        axes.set_title(f"{pattern_name(SHOWN_PATTERN)} at ({x:g}, {z:g}) m")
    joint_columns = [f"{name}_rad_s" for name in machine.joint_names]
    return [
        picture,
        write_rows(folder / f"{figure_name}_joint_velocities.csv", joint_columns, joint),
        write_rows(folder / f"{figure_name}_tip_velocities.csv", ("x_m_s", "z_m_s"), tip),
    ]


def _draw_body(joint: FloatArray, figure: Figure) -> None:
    """The body of admissible velocities of three joints."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    axes: Any = figure.add_subplot(1, 2, 1, projection="3d")
    faces = joint[ConvexHull(joint).simplices]
    axes.add_collection3d(
        Poly3DCollection(faces, facecolor=SKY, edgecolor=GREY, linewidth=0.3, alpha=0.5)
    )
    low, high = joint.min(axis=0), joint.max(axis=0)
    for number, name in enumerate("xyz"):
        getattr(axes, f"set_{name}lim")(low[number], high[number])
        getattr(axes, f"set_{name}label")(f"joint {number + 1} [rad/s]")


def draw_polytopes_along(runs: Runs, folder: Path, figure_name: str) -> list[Path]:
    """Case 4: discrete paths with the polytope at their nodes, and its area along them."""
    picture = folder / f"{figure_name}.png"
    paths = {name: path for name in COMPARED if (path := runs[name].path) is not None}
    areas = {name: polytope_profile(runs[name].machine, path) for name, path in paths.items()}
    with written_figure(picture, 7.4, PANEL * len(COMPARED)) as figure:
        panels = figure.subplots(2, len(COMPARED), gridspec_kw={"height_ratios": [3, 1]})
        scale = SHOWN_RADIUS / max((_largest_speed(runs[name]) for name in paths), default=1.0)
        for name, axes in zip(COMPARED, panels[0], strict=True):
            draw_workspace_axes(runs.machine, axes)
            axes.set_title(f"Case {name}")
            if name in paths:
                _draw_along(runs[name], paths[name], scale, axes)
        _draw_areas(paths, areas, panels[1])
        legend_above(figure, *panels.ravel())
    return [
        picture,
        write_rows(
            folder / f"{figure_name}.csv",
            ("case", "step", "x_m", "z_m", "modes", "area_m2_s2"),
            (row for name, path in paths.items() for row in _area_rows(name, path, areas[name])),
        ),
    ]


def _polytopes(run: Run, path: DiscretePath) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Tip and corners of the polytope, every few steps."""
    for k in range(0, path.steps, EVERY):
        yield path.tip[k + 1], polytope_vertices(run.machine, path.posture[k + 1], path.modes[k])


def _largest_speed(run: Run) -> float:
    assert run.path is not None
    return max(float(np.hypot(*corners.T).max()) for _, corners in _polytopes(run, run.path))


def _draw_along(run: Run, path: DiscretePath, scale: float, axes: Axes) -> None:
    for q in path.posture[::EVERY]:
        draw_arm(run.machine, q, axes, color=GREY, linewidth=1.2, alpha=0.35)
    for tip, corners in _polytopes(run, path):
        label = f"tip velocities, 0.1 m for {0.1 / scale:.2g} m/s"
        axes.fill(*(tip + scale * corners).T, color=ORANGE, alpha=0.35, linewidth=0, label=label)
    draw_discrete_path(path, axes)


def _draw_areas(
    paths: dict[str, DiscretePath], areas: dict[str, FloatArray], row: np.ndarray
) -> None:
    """The same three curves under every panel, its own case's on top."""
    for shown, axes in zip(COMPARED, row, strict=True):
        for name, color in zip(COMPARED, COLORS, strict=True):
            if name in paths:
                share = np.arange(1, paths[name].steps + 1) / paths[name].steps
                width = 2.2 if name == shown else 0.9
                axes.plot(share, areas[name], color=color, linewidth=width, label=f"Case {name}")
        axes.set_xlabel("share of steps [-]")
        axes.set_ylabel("polytope's area [m²/s²]")


def _area_rows(name: str, path: DiscretePath, area: FloatArray) -> Iterator[tuple[Any, ...]]:
    for k in range(path.steps):
        yield name, k + 1, *path.tip[k + 1].round(9), pattern_name(path.modes[k]), area[k]
