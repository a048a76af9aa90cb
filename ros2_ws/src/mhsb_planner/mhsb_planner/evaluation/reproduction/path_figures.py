"""Figures 5 and 7: the tip's paths over the regions in which joints need boost."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mhsb_model.figure_style import BLACK, BLUE, GREY, PATH_COLOR, legend_above, written_figure
from mhsb_model.modes import BOOSTED, pattern_name, strongest
from mhsb_planner.evaluation.operating_regions import OperatingRegions, operating_regions
from mhsb_planner.evaluation.reproduction.fits import Fit, Fits
from mhsb_planner.evaluation.reproduction.runs import Runs
from mhsb_planner.evaluation.workspace_drawing import draw_arm, draw_regions, draw_workspace_axes
from mhsb_planner.result_files import write_rows
from mhsb_planner.search.discrete_path import DiscretePath

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ARMS = 5
"""Postures drawn along a path."""

PANEL, HEIGHT = 4.4, 7.6  # in
LEAST_WIDTH = 11.0
"""What the legend needs [in]."""


def draw_paths(
    runs: Runs, fits: Fits, names: Sequence[str], folder: Path, figure_name: str
) -> list[Path]:
    """One panel for each case, `figure_name`.png, and its data as CSV; the files written."""
    regions = operating_regions(runs.machine, runs.table)
    picture = folder / f"{figure_name}.png"
    width = max(LEAST_WIDTH, PANEL * len(names))
    with written_figure(picture, HEIGHT, width) as figure:
        panels = figure.subplots(1, len(names), squeeze=False)[0]
        for name, axes in zip(names, panels, strict=True):
            draw_regions(regions, axes)
            draw_workspace_axes(runs.machine, axes)
            path = runs[name].path
            if path is not None:
                _draw_arms(runs, path, axes)
                draw_discrete_path(path, axes)
            if name in fits.of:
                _draw_tip(fits.of[name], axes)
            axes.set_title(f"Case {name}")
        legend_above(figure, *panels)
    return [
        picture,
        write_rows(
            folder / f"{figure_name}_paths.csv",
            ("case", "path", "time_s", "x_m", "z_m", "modes"),
            (row for name in names for row in _path_rows(runs, fits, name)),
        ),
        write_rows(
            folder / f"{figure_name}_regions.csv",
            ("x_m", "z_m", *(f"{joint}_needs_boost" for joint in runs.machine.joint_names)),
            _region_rows(regions),
        ),
    ]


def draw_discrete_path(path: DiscretePath, axes: Axes) -> None:
    """The discrete path, dotted, and its ends."""
    axes.plot(*path.tip.T, color=BLUE, linestyle=":", linewidth=1.6, label="discrete path (S2)")
    look: dict[str, Any] = {"linestyle": "none", "markersize": 8, "markeredgecolor": BLACK}
    axes.plot(*path.tip[0], marker="s", markerfacecolor="white", label="start", **look)
    axes.plot(*path.tip[-1], marker="*", markerfacecolor="white", label="goal", **look)


def _draw_arms(runs: Runs, path: DiscretePath, axes: Axes) -> None:
    chosen = np.unique(np.linspace(0, path.steps, ARMS).round().astype(np.int64))
    for q in path.posture[chosen]:
        draw_arm(runs.machine, q, axes, color=GREY, linewidth=1.6, alpha=0.45)


def _draw_tip(fit: Fit, axes: Axes) -> None:
    """The fitted tip path, coloured by the strongest mode in force."""
    modes = strongest(fit.modes)
    for mode, color in PATH_COLOR.items():
        tip = np.where((modes == mode)[:, None], fit.profile.tip, np.nan)
        what = f"an actuator in {mode.name}" if BOOSTED[mode] else f"all in {mode.name}"
        axes.plot(*tip.T, color=color, linewidth=2.0, label=f"trajectory (S3), {what}")


def _path_rows(runs: Runs, fits: Fits, name: str) -> Iterator[tuple[Any, ...]]:
    path = runs[name].path
    if path is not None:
        modes = [path.start_modes, *path.modes]
        for time, tip, pattern in zip(path.time, path.tip, modes, strict=True):
            yield name, "discrete", time, *tip, pattern_name(pattern)
    if name in fits.of:
        fit = fits.of[name]
        for time, tip, pattern in zip(fit.time, fit.profile.tip, fit.modes, strict=True):
            yield name, "fitted", time, *tip, pattern_name(pattern)


def _region_rows(regions: OperatingRegions) -> Iterator[tuple[Any, ...]]:
    for node, boosted in zip(regions.nodes * regions.spacing, regions.boosted, strict=True):
        yield *node.round(9), *boosted.astype(int)
