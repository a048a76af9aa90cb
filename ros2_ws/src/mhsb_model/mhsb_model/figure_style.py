"""Style of all figures: size, colours, thinning of lines, and writing to files.

matplotlib is imported only when a figure is made, since the import takes time. Figures are made
without pyplot, which would need a screen and keep global state.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mhsb_model.errors import ArgumentError
from mhsb_model.files.output_folders import replace_file
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, IntArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
else:
    Axes = Figure = Any  # in annotations alone

FIGURE_WIDTH = 10.0
"""Default width of a figure [in]."""
DOTS_PER_INCH = 120
"""Resolution of a figure [dots/in]."""
MAX_LINE_POINTS = 4000
"""Largest number of points of a line that is drawn without thinning; more than the picture has
columns."""

LEGEND_COLUMNS = 4
"""Largest number of columns of a legend."""

# The colours of Okabe and Ito, which colour-blind people can tell apart.
BLACK, ORANGE, SKY, GREEN = "#1a1a1a", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
GREY, PALE = "#7f7f7f", "#d9d9d9"
TEAL, BROWN = "#44AA99", "#8C510A"

MODE_COLOR = {Mode.N: PALE, Mode.DB: SKY, Mode.SB: ORANGE}
"""Colour of bands and bars for each mode."""
PATH_COLOR = {Mode.N: BLACK, Mode.DB: BLUE, Mode.SB: VERMILION}
"""Colour of lines and dots for each mode. In figures with modes, nothing else has these colours."""

JOINT_COLORS = (BLACK, GREEN, PURPLE, BROWN, GREY)
"""Colours of the joints or actuators; none of them stands for a boosted mode."""

RC_PARAMETERS: dict[Any, Any] = {
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
    "savefig.dpi": DOTS_PER_INCH,
}
"""matplotlib settings that are in force while a figure is made."""


class FigureFormatError(ArgumentError):
    """A picture has a format that cannot be written."""


def rgb(text: str) -> tuple[float, float, float]:
    """Convert a colour `#rrggbb` to red, green and blue from 0 to 1."""
    red, green, blue = (int(text[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return (red, green, blue)


@contextmanager
def open_figure(path: Path | None, height: float, width: float = FIGURE_WIDTH) -> Iterator[Figure]:
    """Open a figure to draw on, as a context manager, and write it when the block ends.

    The suffix of the file chooses the format, such as `.png`, `.pdf` or `.svg`. The file is first
    written beside the target under a temporary name, then renamed. So the target is never
    incomplete. Before the figure is written, the labels of its y axes are aligned. If the block
    raises, nothing is written, and the target stays as it was.

    Args:
        path: File to write; an existing file is replaced. None writes no file.
        height: Height of the figure [in].
        width: Width of the figure [in].

    Yields:
        The empty figure, with `RC_PARAMETERS` in force. A notebook shows it
        if it is the last value of a cell.

    Raises:
        FigureFormatError: matplotlib has no format of this suffix. Nothing was drawn.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(RC_PARAMETERS):
        figure = Figure(figsize=(width, height), layout="constrained")
        vars(figure)["_repr_png_"] = partial(_encode_as_png, figure)  # IPython calls it
        suffix = path.suffix.lower().removeprefix(".") if path else ""
        known = figure.canvas.get_supported_filetypes()
        if path and suffix not in known:
            formats = ", ".join(f".{each}" for each in sorted(known))
            raise FigureFormatError(f"picture '{path}': must end in one of {formats}")
        yield figure
        figure.align_ylabels()
        if path:
            with replace_file(path) as part:
                figure.savefig(part, format=suffix)


def _encode_as_png(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file."""
    file = BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()


def draw_line(axes: Axes, x: FloatArray, y: FloatArray, **style: Any) -> None:
    """Draw a line; if it has many points, draw only the points that preserve its peaks.

    A line of more than MAX_LINE_POINTS points is thinned by `choose_extreme_points`.

    Args:
        axes: Axes to draw on.
        x: Abscissae, shape (k,).
        y: Ordinates, shape (k,).
        style: Further arguments of `Axes.plot`.
    """
    rows = choose_extreme_points(y)
    axes.plot(x[rows], y[rows], **style)


def choose_extreme_points(values: FloatArray, max_points: int = MAX_LINE_POINTS) -> IntArray:
    """Choose the points of a line that have to be drawn so that no peak is lost.

    The line is divided into `max_points`/2 parts with about equal numbers of points. From each part
    the points with the smallest and the largest value are chosen.

    Args:
        values: Ordinates of the line, shape (k,).
        max_points: Largest number of points to choose. If k is not larger, all points are chosen.

    Returns:
        Indices of the chosen points, increasing.
    """
    if len(values) <= max_points:
        return np.arange(len(values))
    edges = np.linspace(0, len(values), max_points // 2 + 1).astype(np.int64)
    parts = [
        begin + np.array([np.argmin(values[begin:end]), np.argmax(values[begin:end])])
        for begin, end in pairwise(edges)
    ]
    return np.unique(np.concatenate(parts))


def legend_above(figure: Figure, *all_axes: Axes) -> None:
    """Draw one common legend for several axes above them, outside the plots, with each label once.

    If several lines or bars have the same label, the first one is shown. The legend has at most
    LEGEND_COLUMNS columns.

    Args:
        figure: Figure of the axes.
        all_axes: Axes whose labelled lines and bars are listed. At least one must have a label.
    """
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
