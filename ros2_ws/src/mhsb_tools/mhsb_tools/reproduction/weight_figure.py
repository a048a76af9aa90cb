"""Figure 10: energy, time and path length over the weights of energy and time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mhsb_model.figure_style import Axes, Figure, open_figure
from mhsb_model.types import FloatArray
from mhsb_planner.result_files import write_rows
from mhsb_tools.reproduction import measures
from mhsb_tools.reproduction.runs import ENERGY_WEIGHTS, TIME_WEIGHTS, Runs, weight_run

SHOWN_MEASURES = (
    ("energy [J]", measures.energy),
    ("time [s]", measures.duration),
    ("path length [m]", lambda path: path.length),
)
"""Title and function of each map."""


def draw_weights(runs: Runs, place: Path) -> None:
    """Draw maps of energy, time and path length over the weights w₁ and w₂ (Figure 10).

    w₁ is the weight of energy [1/J], w₂ that of time [1/s]. The cell of a run without a path has no
    colour and the text `nan`. Writes a PNG, and a CSV file with a row for each pair of weights.

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
