"""The flow of energy from the pumps to work and to each loss, as a diagram of bands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from mhsb_model.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    PURPLE,
    SKY,
    VERMILION,
    YELLOW,
)
from mhsb_model.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLORS = {  # from above
    "main pump": SKY,
    "servo pumps": ORANGE,
    "work on the loads": GREEN,
    "throttling": VERMILION,
    "leakage": PURPLE,
    "oil to the tank": GREY,
    "servo pump losses": YELLOW,
    "friction": BLACK,
    "compression": BLUE,
}
LEAST_SHARE = 0.004
"""Of all energy; what is less is left out."""

BAR = 0.05
LEFT, RIGHT = 0.30, 0.62
"""Where the bars stand, as shares of the width."""

GAP = 0.045
"""Between two bands on the right, as a share of the height."""

LEAST_PITCH = 0.125
"""Between two labels, likewise."""

LEADER = 0.03
"""How far a label is from its bar, as a share of the width."""


def draw_energy_flow(energy: Mapping[str, float], axes: Axes) -> None:
    """Bands from what gives energy to what takes it.

    energy  J by name, negative where it is given: pumps, and loads that sink
    """
    axes.set_axis_off()
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(1.0, 0.0)
    total = sum(-value for value in energy.values() if value < 0.0)
    if total <= 0.0:
        axes.text(0.5, 0.5, "no energy", ha="center")
        return
    given = _parts(energy, -1.0, total)
    taken = _parts(energy, 1.0, total)
    scale = (1.0 - GAP * max(len(taken) - 1, 0)) / max(sum(taken.values()), total)
    _draw_givers(given, total, scale, axes)
    _draw_takers(taken, total, scale, axes)


def _parts(energy: Mapping[str, float], sign: float, total: float) -> dict[str, float]:
    """What is given (−1) or taken (1), amounts positive [J]."""
    order = [*(name for name in COLORS if name in energy), *(energy.keys() - COLORS.keys())]
    parts = {name: sign * energy[name] for name in order}
    return {name: value for name, value in parts.items() if value > LEAST_SHARE * total}


def _draw_givers(given: Mapping[str, float], total: float, scale: float, axes: Axes) -> None:
    heights = [scale * value for value in given.values()]
    tops = (1.0 - sum(heights)) / 2 + np.cumsum([0.0, *heights[:-1]])
    for name, top, height in zip(given, tops, heights, strict=True):
        _draw_bar(LEFT - BAR, float(top), height, name, axes)
    _write_all(given, tops + np.array(heights) / 2, total, LEFT - BAR, -1, axes)


def _draw_takers(taken: Mapping[str, float], total: float, scale: float, axes: Axes) -> None:
    """Bars on the right, each with its band from the stack on the left."""
    heights = np.array([scale * value for value in taken.values()])
    above = np.cumsum([0.0, *heights[:-1]])
    leaves, tops = (1.0 - heights.sum()) / 2 + above, above + GAP * np.arange(len(heights))
    for name, leave, top, height in zip(taken, leaves, tops, heights, strict=True):
        _draw_band(leave, top, height, name, axes)
        _draw_bar(RIGHT, top, height, name, axes)
    _write_all(taken, tops + heights / 2, total, RIGHT + BAR, 1, axes)


def label_places(middles: FloatArray, pitch: float = LEAST_PITCH) -> FloatArray:
    """Heights of labels as near to their bars' middles as leaves each the pitch, within 0 … 1.

    middles  float64[k], increasing, as shares of the height, from above
    """
    pitch = min(pitch, 1.0 / max(len(middles), 1))
    own = pitch * np.arange(len(middles))
    lowest = 1.0 - pitch / 2 - own[-1] if len(middles) else 0.0
    # Less what the pitch takes, heights may not decrease, which a running maximum sees to.
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
    """Names and amounts beside the bars, to the right (1) or left (-1), with thin lines to them."""
    for (name, value), middle, height in zip(
        parts.items(), middles, label_places(middles), strict=True
    ):
        near, far = edge + side * 0.005, edge + side * LEADER
        axes.plot([near, far], [middle, height], color=GREY, linewidth=0.6)
        text = f"{name}\n{value:.0f} J, {100 * value / total:.0f} %"
        where = "left" if side > 0 else "right"
        axes.text(
            far + side * 0.008, height, text, ha=where, va="center", fontsize=8, linespacing=1.05
        )


def _draw_bar(left: float, top: float, height: float, name: str, axes: Axes) -> None:
    from matplotlib.patches import Rectangle

    color = COLORS.get(name, PALE)
    axes.add_patch(Rectangle((left, top), BAR, height, facecolor=color, edgecolor="none"))


def _draw_band(leaves: float, arrives: float, height: float, name: str, axes: Axes) -> None:
    """From the left, where it leaves, to the right; smooth at both ends."""
    along = np.linspace(0.0, 1.0, 60)
    shift = leaves + (arrives - leaves) * (3.0 - 2.0 * along) * along**2
    x = LEFT + (RIGHT - LEFT) * along
    color = COLORS.get(name, PALE)
    axes.fill_between(x, shift, shift + height, color=color, alpha=0.35, linewidth=0)
