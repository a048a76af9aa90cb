"""Figures 5 and 7: the tip's paths over the regions in which joints need boost."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mhsb_model.figure_style import BLACK, BLUE, GREY, Axes, legend_above, open_figure
from mhsb_model.modes import format_pattern
from mhsb_planner.result_files import write_rows
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_tools.moves.move_page import draw_tip_path
from mhsb_tools.moves.operating_regions import determine_operating_regions
from mhsb_tools.moves.workspace_drawing import draw_arm, draw_regions, draw_workspace_axes
from mhsb_tools.reproduction.fits import FittedRuns
from mhsb_tools.reproduction.runs import Runs

DRAWN_POSTURES = 5
"""Number of postures drawn along a path."""

PANEL_WIDTH, FIGURE_HEIGHT = 4.4, 7.6  # in
LEAST_WIDTH = 11.0
"""Least width of the figure [in], which the legend needs."""


def draw_paths(runs: Runs, fits: FittedRuns, names: Sequence[str], place: Path) -> None:
    """Draw the tip's paths over the operating regions, one panel for each case.

    A panel shows the regions in which joints need boost, postures of the arm, the discrete path and
    the trajectory. A path or trajectory that does not exist is left out. Writes a PNG, a CSV file
    with the paths and one with the regions.

    Args:
        runs: All runs of the machine.
        fits: Trajectories that were made for some of the runs.
        names: Names of the runs to draw.
        place: Path of the files without suffix; its folder must exist.
    """
    regions = determine_operating_regions(runs.machine, runs.table)
    width = max(LEAST_WIDTH, PANEL_WIDTH * len(names))
    with open_figure(place.with_suffix(".png"), FIGURE_HEIGHT, width) as figure:
        panels = figure.subplots(1, len(names), squeeze=False)[0]
        for name, axes in zip(names, panels, strict=True):
            draw_regions(regions, axes)
            draw_workspace_axes(runs.machine, axes)
            path = runs[name].path
            if path is not None:
                _draw_arms(runs, path, axes)
                draw_discrete_path(path, axes)
            if name in fits.by_run:
                fit = fits.by_run[name]
                draw_tip_path(fit.profile.tip, fit.modes, axes, "trajectory (S3)")
            axes.set_title(f"Case {name}")
        legend_above(figure, *panels)
    write_rows(
        place.with_name(f"{place.name}_paths.csv"),
        ("case", "path", "time_s", "x_m", "z_m", "modes"),
        (row for name in names for row in _path_rows(runs, fits, name)),
    )
    write_rows(
        place.with_name(f"{place.name}_regions.csv"),
        ("x_m", "z_m", *(f"{joint}_needs_boost" for joint in runs.machine.joint_names)),
        (
            (*node.round(9), *boosted.astype(int))
            for node, boosted in zip(regions.nodes * regions.spacing, regions.boosted, strict=True)
        ),
    )


def draw_discrete_path(path: DiscretePath, axes: Axes) -> None:
    """Draw a discrete path as a dotted line with markers at start and goal.

    Args:
        path: The path. Only `tip` is read.
        axes: Axes to draw on.
    """
    axes.plot(*path.tip.T, color=BLUE, linestyle=":", linewidth=1.6, label="discrete path (S2)")
    look: dict[str, Any] = {"linestyle": "none", "markersize": 8, "markeredgecolor": BLACK}
    axes.plot(*path.tip[0], marker="s", markerfacecolor="white", label="start", **look)
    axes.plot(*path.tip[-1], marker="*", markerfacecolor="white", label="goal", **look)


def _draw_arms(runs: Runs, path: DiscretePath, axes: Axes) -> None:
    """Draw the arm in DRAWN_POSTURES postures along a path, evenly spread over its steps.

    Args:
        runs: All runs; only `runs.machine` is used.
        path: The path.
        axes: Axes to draw on.
    """
    chosen = np.unique(np.linspace(0, path.steps, DRAWN_POSTURES).round().astype(np.int64))
    for q in path.posture[chosen]:
        draw_arm(runs.machine, q, axes, color=GREY, linewidth=1.6, alpha=0.45)


def _path_rows(runs: Runs, fits: FittedRuns, name: str) -> Iterator[tuple[Any, ...]]:
    """Yield the CSV rows of one run: its discrete path, then its trajectory.

    Args:
        runs: All runs of the machine.
        fits: Trajectories that were made for some of the runs.
        name: Name of the run.

    Yields:
        First a row for each waypoint of the discrete path, then one for each sample of the
        trajectory. A row has name, `discrete` or `fitted`, time [s], tip x [m] and z [m], and modes
        as one text such as `SB-DB-N`. A path or trajectory that does not exist has no rows.
    """
    path = runs[name].path
    if path is not None:
        modes = [path.start_modes, *path.modes]
        for time, tip, pattern in zip(path.time, path.tip, modes, strict=True):
            yield name, "discrete", time, *tip, format_pattern(pattern)
    if name in fits.by_run:
        fit = fits.by_run[name]
        for time, tip, pattern in zip(fit.time, fit.profile.tip, fit.modes, strict=True):
            yield name, "fitted", time, *tip, format_pattern(pattern)
