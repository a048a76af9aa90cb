"""Figure 10: energy, time and path length over the weights of energy and time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mhsb_model.figure_style import written_figure
from mhsb_model.types import FloatArray
from mhsb_planner.evaluation.reproduction import measures
from mhsb_planner.evaluation.reproduction.runs import ENERGY_WEIGHTS, TIME_WEIGHTS, Runs, weight_run
from mhsb_planner.result_files import write_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

SHOWN = (
    ("energy [J]", measures.energy),
    ("time [s]", measures.duration),
    ("path length [m]", lambda path: path.length),
)


def draw_weights(runs: Runs, folder: Path, figure_name: str) -> list[Path]:
    """Three maps over (w₁, w₂), `figure_name`.png, and their numbers as CSV; the files written."""
    values = np.full((len(SHOWN), len(ENERGY_WEIGHTS), len(TIME_WEIGHTS)), np.nan)
    for i, w1 in enumerate(ENERGY_WEIGHTS):
        for k, w2 in enumerate(TIME_WEIGHTS):
            path = runs[weight_run(w1, w2)].path
            if path is not None:
                values[:, i, k] = [measure(path) for _, measure in SHOWN]
    picture = folder / f"{figure_name}.png"
    with written_figure(picture, 3.8, 12.0) as figure:
        for (title, _), value, axes in zip(SHOWN, values, figure.subplots(1, 3), strict=True):
            figure.colorbar(_draw_map(value, axes), ax=axes)
            axes.set_title(title)
    rows = [
        (w1, w2, *values[:, i, k])
        for i, w1 in enumerate(ENERGY_WEIGHTS)
        for k, w2 in enumerate(TIME_WEIGHTS)
    ]
    header = ("w1_per_j", "w2_per_s", "energy_j", "time_s", "length_m")
    return [picture, write_rows(folder / f"{figure_name}.csv", header, rows)]


def _draw_map(value: FloatArray, axes: Axes) -> AxesImage:
    """One map with its numbers, w₁ to the right and w₂ upwards."""
    image = axes.imshow(value.T, origin="lower", aspect="auto", cmap="viridis")
    middle = float(np.nanmean(value)) if np.any(np.isfinite(value)) else 0.0
    for i, k in np.ndindex(*value.shape):
        color = "white" if value[i, k] < middle else "black"
        axes.text(i, k, f"{value[i, k]:.3g}", ha="center", va="center", color=color, fontsize=8)
    axes.set_xticks(range(len(ENERGY_WEIGHTS)), [f"{w1:g}" for w1 in ENERGY_WEIGHTS])
    axes.set_yticks(range(len(TIME_WEIGHTS)), [f"{w2:g}" for w2 in TIME_WEIGHTS])
    axes.set_xlabel("w1 of energy [1/J]")
    axes.set_ylabel("w2 of time [1/s]")
    axes.grid(visible=False)
    return image
