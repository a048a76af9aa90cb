"""Diagram of the energy flow from pumps to work and losses, drawn as bands."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mhsb_model.figure_style import BLACK, BROWN, GREEN, GREY, PALE, PURPLE, TEAL, YELLOW, Axes
from mhsb_model.types import FloatArray

GIVEN_BY_LOADS = "given by sinking loads"
"""Name of the work on the loads if it is negative: the loads then give the energy."""

ITEM_COLORS = {
    "main pump": TEAL,
    "servo pumps": YELLOW,
    "work on the loads": GREEN,
    GIVEN_BY_LOADS: GREEN,
    "throttling": BROWN,
    "leakage": PURPLE,
    "oil to the tank": GREY,
    "servo pump losses": YELLOW,
    "friction": BLACK,
    "compression": PALE,
}
"""Colour of each part of the energy; the order is that in the diagram, from the top."""
LEAST_SHARE = 0.004
"""Share of all energy below which a part is not drawn."""

BAR_WIDTH = 0.05
SOURCE_POSITION, SINK_POSITION = 0.30, 0.62
"""Horizontal positions of the two columns of bars, as shares of the width."""

BAND_GAP = 0.045
"""Gap between two bands on the right, as a share of the height."""

LEAST_PITCH = 0.125
"""Least distance between two labels, as a share of the height."""

LABEL_DISTANCE = 0.03
"""Distance of a label from its bar, as a share of the width."""


def draw_energy_flow(energy: Mapping[str, float], axes: Axes) -> None:
    """Draw bands from the sources of energy on the left to its uses on the right.

    Each part has a label with its name, its energy [J] and its share of all energy that the sources
    give [%]. Parts of at most 0.4 % of that total are left out. If no part gives energy, only the
    text "no energy" is drawn.

    Args:
        energy: Energy by name [J], positive if the part uses energy, negative if it gives energy.
            Pumps give energy, and loads that sink give energy, too. Names that are not in
            `ITEM_COLORS` come last, in a pale colour.
        axes: Axes to draw on. Their scales are replaced.
    """
    axes.set_axis_off()
    axes.set(xlim=(0.0, 1.0), ylim=(1.0, 0.0))
    if energy.get("work on the loads", 0.0) < 0.0:
        energy = {**energy, GIVEN_BY_LOADS: energy["work on the loads"], "work on the loads": 0.0}
    total = sum(-value for value in energy.values() if value < 0.0)
    if total <= 0.0:
        axes.text(0.5, 0.5, "no energy", ha="center")
        return
    given = _parts(energy, -1.0, total)
    taken = _parts(energy, 1.0, total)
    scale = (1.0 - BAND_GAP * max(len(taken) - 1, 0)) / max(sum(taken.values()), total)
    _draw_givers(given, total, scale, axes)
    _draw_takers(taken, total, scale, axes)


def _parts(energy: Mapping[str, float], sign: float, total: float) -> dict[str, float]:
    """Select the parts that give energy, or those that take it, in the order of the diagram.

    Args:
        energy: Energy by name [J], negative if the part gives energy.
        sign: −1 selects the parts that give, 1 those that take.
        total: Sum of the energies that all parts give [J].

    Returns:
        Positive amounts by name [J]. Amounts of at most `LEAST_SHARE` of `total` are left out.
    """
    order = [
        *(name for name in ITEM_COLORS if name in energy),
        *(name for name in energy if name not in ITEM_COLORS),
    ]
    parts = {name: sign * energy[name] for name in order}
    return {name: value for name, value in parts.items() if value > LEAST_SHARE * total}


def _draw_givers(given: Mapping[str, float], total: float, scale: float, axes: Axes) -> None:
    """Draw a bar with a label for each energy source, in a column on the left.

    The label has name, energy [J] and percentage; an energy of 0 has a label, too.
    The bars are stacked without gaps and centred vertically.

    Args:
        given: Energy of each source [J], in order from the top.
        total: Sum of the energies of all sources [J], for the percentages in the labels.
        scale: Height of a bar, as a share of the axes' height, per energy [1/J].
        axes: Axes to draw on.
    """
    heights = [scale * value for value in given.values()]
    tops = (1.0 - sum(heights)) / 2 + np.cumsum([0.0, *heights[:-1]])
    for name, top, height in zip(given, tops, heights, strict=True):
        _draw_bar(SOURCE_POSITION - BAR_WIDTH, float(top), height, name, axes)
    _write_all(given, tops + np.array(heights) / 2, total, SOURCE_POSITION - BAR_WIDTH, -1, axes)


def _draw_takers(taken: Mapping[str, float], total: float, scale: float, axes: Axes) -> None:
    """Draw a bar with a label for each use of energy on the right, and a band that leads to it.

    The label has name, energy [J] and percentage; an energy of 0 has a label, too.
    The bands start at the stack of sources on the left.

    Args:
        taken: Energy of each use [J], in order from the top.
        total: Sum of the energies of all sources [J], for the percentages in the labels.
        scale: Height of a bar, as a share of the axes' height, per energy [1/J].
        axes: Axes to draw on.
    """
    heights = np.array([scale * value for value in taken.values()])
    above = np.cumsum([0.0, *heights[:-1]])
    leaves, tops = (1.0 - heights.sum()) / 2 + above, above + BAND_GAP * np.arange(len(heights))
    for name, leave, top, height in zip(taken, leaves, tops, heights, strict=True):
        _draw_band(leave, top, height, name, axes)
        _draw_bar(SINK_POSITION, top, height, name, axes)
    _write_all(taken, tops + heights / 2, total, SINK_POSITION + BAR_WIDTH, 1, axes)


def label_places(middles: FloatArray) -> FloatArray:
    """Choose heights for the labels of bars so that the labels do not overlap.

    Args:
        middles: Middle of each bar, as a share of the axes' height from the top, increasing, shape
            (k,).

    Returns:
        Height of each label, in the same unit and order, shape (k,). Each is near the middle of its
        bar. Neighbours are at least LEAST_PITCH apart, or 1/k if that is smaller.
    """
    pitch = min(LEAST_PITCH, 1.0 / max(len(middles), 1))
    own = pitch * np.arange(len(middles))
    lowest = 1.0 - pitch / 2 - own[-1] if len(middles) else 0.0
    # After subtracting k times the pitch, heights need only be non-decreasing: a running maximum.
    free = np.clip(middles - own, pitch / 2, lowest)
    return np.asarray(np.maximum.accumulate(free) + own)


def _write_all(
    parts: Mapping[str, float],
    middles: FloatArray,
    total: float,
    edge: float,
    side: int,
    axes: Axes,
) -> None:
    """Write name, energy [J] and share of the total [%] beside each bar, with a thin line to it.

    Args:
        parts: Energy by name [J].
        middles: Middle of each bar, as a share of the axes' height from the top, shape (k,),
            aligned with `parts`.
        total: Sum of the energies of all sources [J], for the percentages.
        edge: Horizontal position of the bars' edge, as a share of the axes' width.
        side: 1 writes to the right, −1 to the left.
        axes: Axes to draw on.
    """
    for (name, value), middle, height in zip(
        parts.items(), middles, label_places(middles), strict=True
    ):
        near, far = edge + side * 0.005, edge + side * LABEL_DISTANCE
        axes.plot([near, far], [middle, height], color=GREY, linewidth=0.6)
        text = f"{name}\n{value:.0f} J, {100 * value / total:.0f} %"
        where = "left" if side > 0 else "right"
        axes.text(
            far + side * 0.008, height, text, ha=where, va="center", fontsize=8, linespacing=1.05
        )


def _draw_bar(left: float, top: float, height: float, name: str, axes: Axes) -> None:
    """Draw one bar of width `BAR_WIDTH`.

    Args:
        left: Left edge, as a share of the axes' width.
        top: Upper edge, as a share of the axes' height from the top.
        height: Height of the bar, as a share of the axes' height.
        name: Part of the energy; it selects the colour.
        axes: Axes to draw on.
    """
    from matplotlib.patches import Rectangle

    color = ITEM_COLORS.get(name, PALE)
    axes.add_patch(Rectangle((left, top), BAR_WIDTH, height, facecolor=color, edgecolor="none"))


def _draw_band(left_edge: float, right_edge: float, height: float, name: str, axes: Axes) -> None:
    """Draw a band from the left column of bars to the right one.

    It has the same height everywhere, and horizontal tangents at both ends.

    Args:
        left_edge: Upper edge at the left column, as a share of the axes' height from the top.
        right_edge: Upper edge at the right column, in the same unit.
        height: Height of the band, in the same unit.
        name: Part of the energy; it selects the colour.
        axes: Axes to draw on.
    """
    along = np.linspace(0.0, 1.0, 60)
    shift = left_edge + (right_edge - left_edge) * (3.0 - 2.0 * along) * along**2
    x = SOURCE_POSITION + (SINK_POSITION - SOURCE_POSITION) * along
    color = ITEM_COLORS.get(name, PALE)
    axes.fill_between(x, shift, shift + height, color=color, alpha=0.35, linewidth=0)
