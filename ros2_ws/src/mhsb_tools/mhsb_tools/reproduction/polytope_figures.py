"""Figures 3 and 9: admissible joint velocities, and the polytope of the tip's velocities."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from mhsb_model.figure_style import (
    BLUE,
    GREY,
    ORANGE,
    SKY,
    VERMILION,
    Axes,
    Figure,
    legend_above,
    open_figure,
)
from mhsb_model.modes import Mode, format_pattern
from mhsb_model.types import FloatArray
from mhsb_planner.posture.s1_polytope import compute_polytope_vertices, list_piston_speed_corners
from mhsb_planner.result_files import write_rows
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_tools.moves.workspace_drawing import draw_arm, draw_workspace_axes
from mhsb_tools.reproduction.measures import compute_polytope_profile
from mhsb_tools.reproduction.path_figures import PANEL_WIDTH, draw_discrete_path
from mhsb_tools.reproduction.runs import Run, Runs

SHOWN_PATTERN = (Mode.SB, Mode.DB, Mode.N)
"""Mode combination of Figure 3."""

SHOWN_RADIUS = 0.4
"""Radius at which the largest polytope of Figure 9 is drawn [m]."""

STEP_STRIDE = 2
"""Figure 9 shows the polytope of every second step."""

COMPARED_RUNS = ("4-1", "4-2", "4-3")
RUN_COLORS = (BLUE, ORANGE, VERMILION)


def draw_velocity_polytope(runs: Runs, place: Path) -> None:
    """Draw the joint velocities and tip velocities that piston speed limits allow (Figure 3).

    They are for the start of Case 1-1 and the mode combination SHOWN_PATTERN. The posture table
    gives the posture, at the grid node nearest to the start. Writes a PNG and two CSV files:
    corners of the body of joint velocities [rad/s], and vertices of the polygon of tip velocities
    [m/s].

    Args:
        runs: All runs of the machine.
        place: Path of the files without suffix; its folder must exist.
    """
    machine, table = runs.machine, runs.table
    x, z = runs["1-1"].setting.case.start
    node = int(np.argmin(np.hypot(*(table.nodes * table.spacing - (x, z)).T)))
    pattern = int(np.flatnonzero(np.all(table.patterns == SHOWN_PATTERN, axis=1))[0])
    q = table.posture[node, pattern]
    joint = list_piston_speed_corners(machine, q, table.patterns[pattern]) / machine.moment_arms(q)
    tip = compute_polytope_vertices(machine, q, table.patterns[pattern])
    with open_figure(place.with_suffix(".png"), 4.6) as figure:
        _draw_body(joint, figure)
        axes = figure.add_subplot(1, 2, 2)
        axes.fill(*tip.T, facecolor=ORANGE, edgecolor=VERMILION, alpha=0.5)
        axes.set(
            aspect="equal",
            xlabel="tip velocity along x [m/s]",
            ylabel="tip velocity along z [m/s]",
            title=f"{format_pattern(SHOWN_PATTERN)} at ({x:g}, {z:g}) m",
        )
    joint_columns = [f"{name}_rad_s" for name in machine.joint_names]
    write_rows(place.with_name(f"{place.name}_joint_velocities.csv"), joint_columns, joint)
    write_rows(place.with_name(f"{place.name}_tip_velocities.csv"), ("x_m_s", "z_m_s"), tip)


def _draw_body(joint: FloatArray, figure: Figure) -> None:
    """Draw the convex body of allowed velocities of three joints [rad/s] in three dimensions.

    Args:
        joint: Corners of the body [rad/s], shape (corners, 3).
        figure: Figure; the left half is used.
    """
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


def draw_polytopes_along(runs: Runs, place: Path) -> None:
    """Draw the velocity polytopes along the paths of Case 4, and their areas (Figure 9).

    There is a column for each run. The upper panel shows path, arm and polytopes in the plane; it
    is empty if the run has no path. The lower panel shows the areas of all runs over the share of
    steps. Writes a PNG, and a CSV file with the area at the end of each step.

    Args:
        runs: All runs of the machine.
        place: Path of the files without suffix; its folder must exist.
    """
    paths = {name: path for name in COMPARED_RUNS if (path := runs[name].path) is not None}
    areas = {
        name: compute_polytope_profile(runs[name].machine, path) for name, path in paths.items()
    }
    with open_figure(place.with_suffix(".png"), 7.4, PANEL_WIDTH * len(COMPARED_RUNS)) as figure:
        panels = figure.subplots(2, len(COMPARED_RUNS), gridspec_kw={"height_ratios": [3, 1]})
        polytopes = (each for name, path in paths.items() for each in _polytopes(runs[name], path))
        speeds = (float(np.hypot(*corners.T).max()) for _, corners in polytopes)
        scale = SHOWN_RADIUS / max(speeds, default=1.0)
        for name, axes in zip(COMPARED_RUNS, panels[0], strict=True):
            draw_workspace_axes(runs.machine, axes)
            axes.set_title(f"Case {name}")
            if name in paths:
                _draw_along(runs[name], paths[name], scale, axes)
        _draw_areas(paths, areas, panels[1])
        legend_above(figure, *panels.ravel())
    write_rows(
        place.with_suffix(".csv"),
        ("case", "step", "x_m", "z_m", "modes", "area_m2_s2"),
        (
            (name, k + 1, *path.tip[k + 1].round(9), format_pattern(path.modes[k]), areas[name][k])
            for name, path in paths.items()
            for k in range(path.steps)
        ),
    )


def _polytopes(run: Run, path: DiscretePath) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield the velocity polytope of every `STEP_STRIDE`-th step of a path.

    Args:
        run: The run; only its machine is used.
        path: The run's path.

    Yields:
        Tip position at the end of the step, shape (2,) [m], and corners of the polytope of tip
        velocities there, shape (corners, 2) [m/s].
    """
    for k in range(0, path.steps, STEP_STRIDE):
        yield (
            path.tip[k + 1],
            compute_polytope_vertices(run.machine, path.posture[k + 1], path.modes[k]),
        )


def _draw_along(run: Run, path: DiscretePath, scale: float, axes: Axes) -> None:
    """Draw a path, and the arm and its velocity polytope at every `STEP_STRIDE`-th waypoint.

    Each polytope is drawn around the tip position for which it holds.

    Args:
        run: The run; only its machine is used.
        path: The run's path.
        scale: Drawn length per tip speed [s].
        axes: Axes to draw on.
    """
    for q in path.posture[::STEP_STRIDE]:
        draw_arm(run.machine, q, axes, color=GREY, linewidth=1.2, alpha=0.35)
    for tip, corners in _polytopes(run, path):
        label = f"tip velocities, 0.1 m for {0.1 / scale:.2g} m/s"
        axes.fill(*(tip + scale * corners).T, color=ORANGE, alpha=0.35, linewidth=0, label=label)
    draw_discrete_path(path, axes)


def _draw_areas(
    paths: dict[str, DiscretePath], areas: dict[str, FloatArray], row: np.ndarray
) -> None:
    """Draw the area of the velocity polytope over the share of steps, in one panel for each run.

    Each panel shows all runs; the panel's own run has a wide line.

    Args:
        paths: Paths by name of the run. A run that is missing is not drawn.
        areas: Area at the end of each step, by name of the run, each of shape (steps,) [m²/s²].
        row: Axes, one for each of `COMPARED_RUNS`. Their labels are set.
    """
    for shown, axes in zip(COMPARED_RUNS, row, strict=True):
        for name, color in zip(COMPARED_RUNS, RUN_COLORS, strict=True):
            if name in paths:
                share = np.arange(1, paths[name].steps + 1) / paths[name].steps
                width = 2.2 if name == shown else 0.9
                axes.plot(share, areas[name], color=color, linewidth=width, label=f"Case {name}")
        axes.set(xlabel="share of steps [-]", ylabel="polytope's area [m²/s²]")
