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
    top, written = (1.0 - scale * sum(given.values())) / 2, -1.0
    for name, value in given.items():
        height = scale * value
        _draw_bar(LEFT - BAR, top, height, name, axes)
        written = max(top + height / 2, written + LEAST_PITCH)
        _write(LEFT - BAR - 0.02, written, name, value, total, "right", axes)
        top += height


def _draw_takers(taken: Mapping[str, float], total: float, scale: float, axes: Axes) -> None:
    """Bars on the right, each with its band from the stack on the left."""
    leaves, top, written = (1.0 - scale * sum(taken.values())) / 2, 0.0, -1.0
    for name, value in taken.items():
        height = scale * value
        _draw_band(leaves, top, height, name, axes)
        _draw_bar(RIGHT, top, height, name, axes)
        written = max(top + height / 2, written + LEAST_PITCH)
        _write(RIGHT + BAR + 0.02, written, name, value, total, "left", axes)
        leaves += height
        top += height + GAP


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


def _write(
    x: float, y: float, name: str, value: float, total: float, side: str, axes: Axes
) -> None:
    text = f"{name}\n{value:.0f} J, {100 * value / total:.0f} %"
    axes.text(x, y, text, ha=side, va="center", fontsize=8.5, linespacing=1.1)
