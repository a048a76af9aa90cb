"""What all figures have in common: size, colours, thinning, and how they are written.

matplotlib is imported when a figure is made, so that nothing else has to wait for it. Figures
are made without pyplot: there is no screen and no state.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, IntArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 10.0  # in
RESOLUTION = 120  # dots/in
MOST_POINTS = 4000
"""Points of a line beyond which it is thinned; more than the picture has columns."""

LEGEND_COLUMNS = 4

# The colours of Okabe and Ito, which colour-blind people can tell apart.
BLACK, ORANGE, SKY, GREEN = "#1a1a1a", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
GREY, PALE = "#7f7f7f", "#d9d9d9"

MODE_COLOR = {Mode.N: PALE, Mode.DB: SKY, Mode.SB: ORANGE}
PATH_COLOR = {Mode.N: BLACK, Mode.DB: BLUE, Mode.SB: VERMILION}
"""Of bands and bars, and of lines and dots."""

STYLE: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "savefig.dpi": RESOLUTION,
}


def rgb(text: str) -> tuple[float, float, float]:
    """Red, green, blue of `#rrggbb`, as shares of 1."""
    red, green, blue = (int(text[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return (red, green, blue)


@contextmanager
def written_figure(path: Path, height: float, width: float = WIDTH) -> Iterator[Figure]:
    """A figure to draw on, written as PNG at the end, whole or not at all; sizes in inches."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        yield figure
        figure.align_ylabels()
        part = path.with_name(f"{path.name}.part")
        try:
            figure.savefig(part, format="png")
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)


def draw_line(axes: Axes, x: FloatArray, y: FloatArray, **style: Any) -> None:
    """A line through many points, thinned so that its peaks stay."""
    rows = telling_rows(y)
    axes.plot(x[rows], y[rows], **style)


def telling_rows(values: FloatArray, most: int = MOST_POINTS) -> IntArray:
    """Rows of float64[k] to draw: all, or the smallest and the largest of each of most/2 parts."""
    if len(values) <= most:
        return np.arange(len(values))
    edges = np.linspace(0, len(values), most // 2 + 1).astype(np.int64)
    parts = [
        begin + np.array([np.argmin(values[begin:end]), np.argmax(values[begin:end])])
        for begin, end in pairwise(edges)
    ]
    return np.unique(np.concatenate(parts))


def legend_above(figure: Figure, *all_axes: Axes) -> None:
    """One legend above all axes, where it hides nothing; each label once."""
    entries: dict[str, Any] = {}
    for axes in all_axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    lines = -(-len(entries) // LEGEND_COLUMNS)
    figure.legend(
        list(entries.values()),
        list(entries),
        loc="outside upper center",
        ncols=-(-len(entries) // lines),
    )
