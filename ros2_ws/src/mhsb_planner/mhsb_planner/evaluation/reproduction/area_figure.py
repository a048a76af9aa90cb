"""Case 4 beyond the paper: the polytope's area against energy, over the weight of the area."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mhsb_model.figure_style import BLUE, GREY, ORANGE, VERMILION, legend_above, written_figure
from mhsb_planner.evaluation.reproduction.fits import Fits
from mhsb_planner.evaluation.reproduction.measures import energy
from mhsb_planner.evaluation.reproduction.runs import AREA_WEIGHTS, Runs, area_run
from mhsb_planner.result_files import write_rows
from mhsb_planner.search.area_shortfall import area_along_motion, area_along_path, reference_area

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WEIGHED = {area_run(w4): w4 for w4 in (0.0, *AREA_WEIGHTS)}
COMPARED = {
    "4-1": ("posture table", ORANGE, "s"),
    "4-2": ("conventional, J3 well chosen", GREY, "^"),
    "4-3": ("conventional, J3 badly chosen", VERMILION, "v"),
}

LABELS_APART = 6.0  # J


class Tradeoff(NamedTuple):
    """A run's energies [J], mean areas along the tip's path [m²/s²], and area shortfall [m].

    Of the discrete path, and of the motion; NaN where there is none.
    """

    run: str
    w4: float
    energy_discrete: float
    area_discrete: float
    shortfall_discrete: float
    energy: float
    area: float


def tradeoffs(runs: Runs, fits: Fits) -> Iterator[Tradeoff]:
    """All runs of Case 4 that have a path."""
    full = reference_area(runs.table)
    for name in (*WEIGHED, *COMPARED):
        path = runs.runs[name].path if name in runs.runs else None
        if path is None:
            continue
        along, fit = area_along_path(runs.machine, path), fits.of.get(name)
        of_motion = (np.nan, np.nan)
        if fit is not None:
            motion = fit.motion
            area = area_along_motion(runs.machine, motion.trajectory, motion.schedule).mean
            of_motion = (fit.energy.paper, area or np.nan)
        yield Tradeoff(
            name,
            WEIGHED.get(name, np.nan),
            energy(path),
            along.mean or np.nan,
            along.shortfall(full),
            *of_motion,
        )


def draw_area_tradeoff(runs: Runs, fits: Fits, folder: Path, figure_name: str) -> list[Path]:
    """Mean area over energy, `figure_name`.png, and the numbers as CSV; the files written."""
    found = list(tradeoffs(runs, fits))
    picture = folder / f"{figure_name}.png"
    with written_figure(picture, 4.6) as figure:
        both = figure.subplots(1, 2, sharey=True)
        for title, axes, of_motion in zip(
            ("discrete paths", "motions"), both, (False, True), strict=True
        ):
            _draw(found, axes, of_motion)
            axes.set_title(title)
            axes.set_xlabel("energy [J]")
        both[0].set_ylabel("polytope's mean area [m²/s²]")
        legend_above(figure, *both)
    header = (
        *("run", "w4_per_m", "energy_discrete_j", "area_discrete_m2_s2", "shortfall_discrete_m"),
        *("energy_j", "area_m2_s2"),
    )
    return [picture, write_rows(folder / f"{figure_name}.csv", header, found)]


def _draw(found: list[Tradeoff], axes: Axes, of_motion: bool) -> None:
    at = {
        each.run: (each.energy, each.area)
        if of_motion
        else (each.energy_discrete, each.area_discrete)
        for each in found
    }
    front = np.array([at[name] for name in WEIGHED if name in at]).reshape(-1, 2)
    axes.plot(*front.T, color=BLUE, marker="o", label="integrated, with its w4 [1/m]")
    labelled = -np.inf
    for name in WEIGHED:
        if name in at and at[name][0] > labelled + LABELS_APART:
            labelled = at[name][0]
            axes.annotate(f"{WEIGHED[name]:g}", at[name], (4, -11), textcoords="offset points")
    for name, (label, color, marker) in COMPARED.items():
        if name in at:
            axes.plot(*at[name], color=color, marker=marker, linestyle="", label=label)
