"""Draws the picture of docs/linkages.md: `python docs/four_bar_sketch.py docs/four_bar.png`."""

from __future__ import annotations

import math
import sys

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from mhsb_model.linkages import four_bar, linkage
from mhsb_model.schema import FourBar, Pin, SliderCrank
from mhsb_model.types import FloatArray

BARS = FourBar(
    kind="four_bar",
    rocker_pivot=Pin(radius=0.0522, angle=2.1243),
    rocker_length=0.0968,
    rocker_side="left",
    coupler_length=0.0776,
    child_pin=Pin(radius=0.0603, angle=-1.8112),
    parent_pin=Pin(radius=0.3241, angle=-1.8675),
)
LOWER, UPPER, SHOWN = math.radians(-90.0), math.radians(130.0), 1.5
CRANK = SliderCrank(
    kind="slider_crank",
    parent_pin=Pin(radius=0.25, angle=-1.57),
    child_pin=Pin(radius=0.05, angle=-0.26),
)
CRANK_LOWER, CRANK_UPPER = math.radians(-48.0), math.radians(87.0)
LINK, ROCKER, COUPLER, CYLINDER = "#E69F00", "#009E73", "#CC79A7", "#0072B2"


def place(pin: Pin, turned: float = 0.0) -> FloatArray:
    """Where a pin is [mm]."""
    angle = pin.angle + turned
    return 1e3 * pin.radius * np.array([math.cos(angle), math.sin(angle)])


def draw_geometry(axes: Axes) -> None:
    """Draw the linkage at one joint angle, with the symbols of the equations."""
    pivot, base = place(BARS.rocker_pivot), place(BARS.parent_pin)
    child = place(BARS.child_pin, SHOWN)
    x, z, *_ = four_bar.evaluate_four_bar(
        linkage.build_linkage_row(BARS), math.cos(SHOWN), math.sin(SHOWN)
    )
    tip, joint = pivot + 1e3 * np.array([x, z]), np.zeros(2)
    along = 160.0 * np.array([math.cos(SHOWN), math.sin(SHOWN)])
    for start, end, colour, width, name in (
        (joint, along, LINK, 9, "child link"),
        (joint, child, LINK, 4, None),
        (pivot, tip, ROCKER, 4, "rocker $a$"),
        (tip, child, COUPLER, 4, "coupler $b$"),
        (base, tip, CYLINDER, 2, "cylinder $L$"),
        (base, base + 0.6 * (tip - base), CYLINDER, 7, None),
    ):
        axes.plot(*zip(start, end, strict=True), color=colour, lw=width, label=name, zorder=1)
    for point, name, shift in (
        (joint, "O", (8, -16)),
        (pivot, "R", (-14, 6)),
        (base, "K", (10, -4)),
        (child, "C", (10, -10)),
        (tip, "P", (0, 9)),
    ):
        axes.plot(*point, "o", color="#333333", ms=6, zorder=2)
        axes.annotate(name, (point[0], point[1]), textcoords="offset points", xytext=shift)
    axes.set(aspect="equal", xlim=(-140, 260), xlabel="x [mm]", ylabel="z [mm]")
    axes.legend(loc="lower right", fontsize="small", frameon=False)


def draw_arms(axes: Axes) -> None:
    """Moment arms of this four-bar and of a slider-crank, each over its widest limits."""
    for bars, lower, upper, colour, name in (
        (BARS, LOWER, UPPER, ROCKER, "four-bar"),
        (CRANK, CRANK_LOWER, CRANK_UPPER, LINK, "slider-crank"),
    ):
        row = linkage.build_linkage_row(bars)
        q = np.linspace(lower, upper, 300)
        arm = [1e3 * linkage.moment_arm(row, each) for each in q]
        axes.plot(np.degrees(q), arm, color=colour, label=name)
    axes.legend(loc="lower left", frameon=False)
    axes.set(xlabel="joint angle [°]", ylabel="moment arm [mm]", ylim=(0, 60))


if __name__ == "__main__":
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4.2), layout="constrained")
    draw_geometry(left)
    draw_arms(right)
    figure.savefig(sys.argv[1], dpi=90)
