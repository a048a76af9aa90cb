"""Figures over weights: Figure 10, and beyond the paper Case 4's polytope area against energy."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mhsb_model.figure_style import (
    BLUE,
    GREY,
    ORANGE,
    VERMILION,
    Axes,
    Figure,
    legend_above,
    open_figure,
)
from mhsb_model.types import FloatArray
from mhsb_planner.result_files import write_rows
from mhsb_planner.search.manipulability_loss import (
    compute_area_along_motion,
    compute_area_along_path,
    compute_reference_area,
)
from mhsb_tools.reproduction import measures
from mhsb_tools.reproduction.fits import FittedRuns
from mhsb_tools.reproduction.measures import energy
from mhsb_tools.reproduction.runs import (
    AREA_WEIGHTS,
    ENERGY_WEIGHTS,
    TIME_WEIGHTS,
    Runs,
    area_run,
    weight_run,
)

SHOWN_MEASURES = (
    ("energy [J]", measures.energy),
    ("time [s]", measures.duration),
    ("path length [m]", lambda path: path.length),
)
"""Title and function of each map."""


def draw_weights(runs: Runs, place: Path) -> None:
    """Draw maps of energy, time and path length over the weights w₁ and w₂ (Figure 10).

    w₁ is the weight of energy [1/J], w₂ the weight of time [1/s]. The cell of a run without a path
    has no colour and the text `nan`. Writes a PNG, and a CSV file with a row for each pair of
    weights.

    Args:
        runs: All runs of the machine.
        place: Path of the files without suffix; its folder must exist.
    """
    values = np.full((len(SHOWN_MEASURES), len(ENERGY_WEIGHTS), len(TIME_WEIGHTS)), np.nan)
    for i, w1 in enumerate(ENERGY_WEIGHTS):
        for k, w2 in enumerate(TIME_WEIGHTS):
            path = runs[weight_run(w1, w2)].path
            if path is not None:
                values[:, i, k] = [measure(path) for _, measure in SHOWN_MEASURES]
    with open_figure(place.with_suffix(".png"), 3.8, 12.0) as figure:
        for (title, _), value, axes in zip(
            SHOWN_MEASURES, values, figure.subplots(1, 3), strict=True
        ):
            _draw_map(value, figure, axes)
            axes.set_title(title)
    rows = [
        (w1, w2, *values[:, i, k])
        for i, w1 in enumerate(ENERGY_WEIGHTS)
        for k, w2 in enumerate(TIME_WEIGHTS)
    ]
    header = ("w1_per_j", "w2_per_s", "energy_j", "time_s", "length_m")
    write_rows(place.with_suffix(".csv"), header, rows)


def _draw_map(value: FloatArray, figure: Figure, axes: Axes) -> None:
    """Draw one map over the weights w₁ (to the right) and w₂ (upwards), and a colour bar.

    Each cell has its value as text.

    Args:
        value: Values over w₁ and w₂, shape (len(ENERGY_WEIGHTS), len(TIME_WEIGHTS)); NaN if a run
            has no path.
        figure: Figure of the axes.
        axes: Axes to draw on.
    """
    image = axes.imshow(value.T, origin="lower", aspect="auto", cmap="viridis")
    middle = float(np.nanmean(value)) if np.any(np.isfinite(value)) else 0.0
    for i, k in np.ndindex(*value.shape):
        color = "white" if value[i, k] < middle else "black"
        axes.text(i, k, f"{value[i, k]:.3g}", ha="center", va="center", color=color, fontsize=8)
    axes.set_xticks(range(len(ENERGY_WEIGHTS)), [f"{w1:g}" for w1 in ENERGY_WEIGHTS])
    axes.set_yticks(range(len(TIME_WEIGHTS)), [f"{w2:g}" for w2 in TIME_WEIGHTS])
    axes.set(xlabel="w1 of energy [1/J]", ylabel="w2 of time [1/s]")
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes)


AREA_RUN_WEIGHTS = {area_run(w4): w4 for w4 in (0.0, *AREA_WEIGHTS)}
"""Weight w₄ [1/m] by name of the integrated planner's run."""
COMPARED_RUNS = {
    "4-1": ("posture table", ORANGE, "s"),
    "4-2": ("conventional, J3 well chosen", GREY, "^"),
    "4-3": ("conventional, J3 badly chosen", VERMILION, "v"),
}
"""Label, colour and marker by name of the runs to compare with."""

LABELS_APART = 6.0  # J
"""Least difference in energy of two points that both have a label [J]."""


class Tradeoff(NamedTuple):
    """Energy and polytope area of one run.

    Attributes:
        run: Name of the run.
        w4: Weight of the area [1/m]; NaN for runs without one.
        energy_discrete: Energy of the discrete path [J].
        area_discrete: Mean area along the discrete path [m²/s²]; NaN if the tip does not move.
        shortfall_discrete: ∫ max(0, 1 − area/reference) ds along the discrete path [m].
        energy: Energy of the motion [J]; NaN if there is no motion.
        area: Mean area along the motion [m²/s²]; NaN if there is no motion.
    """

    run: str
    w4: float
    energy_discrete: float
    area_discrete: float
    shortfall_discrete: float
    energy: float
    area: float


def compute_tradeoffs(runs: Runs, fits: FittedRuns) -> Iterator[Tradeoff]:
    """Compute energy and polytope area of the runs of Case 4.

    The velocity polytope is the set of tip velocities that the pistons' speed limits allow.

    Args:
        runs: All runs of the machine.
        fits: Trajectories that were made for some of the runs.

    Yields:
        First the integrated planner's runs by increasing weight w₄ of the area, then the runs of
        `COMPARED_RUNS`. A run without a path is left out.
    """
    full = compute_reference_area(runs.table)
    for name in (*AREA_RUN_WEIGHTS, *COMPARED_RUNS):
        path = runs.runs[name].path if name in runs.runs else None
        if path is None:
            continue
        along, fit = compute_area_along_path(runs.machine, path), fits.by_run.get(name)
        of_motion = (np.nan, np.nan)
        if fit is not None:
            motion = fit.motion
            area = compute_area_along_motion(runs.machine, motion.trajectory, motion.schedule).mean
            of_motion = (fit.energy.paper, area or np.nan)
        yield Tradeoff(
            name,
            AREA_RUN_WEIGHTS.get(name, np.nan),
            energy(path),
            along.mean or np.nan,
            along.compute_area_loss(full),
            *of_motion,
        )


def draw_area_tradeoff(runs: Runs, fits: FittedRuns, place: Path) -> None:
    """Draw the velocity polytope's mean area over energy for the runs of Case 4.

    The left panel shows the discrete paths, the right one the motions. The integrated planner's
    runs with different weights w₄ of the area are joined by a line. The runs of `COMPARED_RUNS` are
    single points. Runs without a path are left out. Writes a PNG, and a CSV file with the fields of
    `Tradeoff` for each run.

    Args:
        runs: All runs of the machine.
        fits: Trajectories that were made for some of the runs.
        place: Path of the files without suffix; its folder must exist.
    """
    found = list(compute_tradeoffs(runs, fits))
    with open_figure(place.with_suffix(".png"), 4.6) as figure:
        both = figure.subplots(1, 2, sharey=True)
        for title, axes, of_motion in zip(
            ("discrete paths", "motions"), both, (False, True), strict=True
        ):
            _draw(found, axes, of_motion)
            axes.set(title=title, xlabel="energy [J]")
        both[0].set_ylabel("polytope's mean area [m²/s²]")
        legend_above(figure, *both)
    header = (
        *("run", "w4_per_m", "energy_discrete_j", "area_discrete_m2_s2", "shortfall_discrete_m"),
        *("energy_j", "area_m2_s2"),
    )
    write_rows(place.with_suffix(".csv"), header, found)


def _draw(found: list[Tradeoff], axes: Axes, of_motion: bool) -> None:
    """Draw the velocity polytope's mean area over energy for all runs in one panel.

    The integrated planner's runs are joined by a line and labelled with their weight w₄ of the
    area. A run has a label only if its energy is more than `LABELS_APART` above the energy of the
    last labelled run; labels would overlap otherwise.

    Args:
        found: Energy and area of each run.
        axes: Axes to draw on: energy [J] as x, area [m²/s²] as y. Labels of the axes are not set.
        of_motion: True draws the values of the motions, False the values of the discrete paths.
    """
    at = {
        each.run: (each.energy, each.area)
        if of_motion
        else (each.energy_discrete, each.area_discrete)
        for each in found
    }
    front = np.array([at[name] for name in AREA_RUN_WEIGHTS if name in at]).reshape(-1, 2)
    axes.plot(*front.T, color=BLUE, marker="o", label="integrated, with its w4 [1/m]")
    labelled = -np.inf
    for name in AREA_RUN_WEIGHTS:
        if name in at and at[name][0] > labelled + LABELS_APART:
            labelled = at[name][0]
            axes.annotate(
                f"{AREA_RUN_WEIGHTS[name]:g}", at[name], (4, -11), textcoords="offset points"
            )
    for name, (label, color, marker) in COMPARED_RUNS.items():
        if name in at:
            axes.plot(*at[name], color=color, marker=marker, linestyle="", label=label)
