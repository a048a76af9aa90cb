"""What the integrated planner saves, as planned and as simulated."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mhsb_model.figure_style import BLACK, BLUE, GREY, VERMILION, written_figure
from mhsb_sim.study.planner_comparison import BASELINE, Comparison, ratios

KEPT = 0.1
"""Shaded: simulated ratios within this share of the planned ones."""


def draw_proportions(
    cases: Sequence[Comparison], others: Sequence[Comparison], path: Path
) -> None:
    """Energy over the baseline's, simulated against planned, a point for each move."""
    with written_figure(path, 5.0, 5.5) as figure:
        axes = figure.subplots()
        ends = (0.0, 1.1)
        axes.fill_between(
            ends,
            [(1.0 - KEPT) * end for end in ends],
            [(1.0 + KEPT) * end for end in ends],
            color=GREY,
            alpha=0.2,
            linewidth=0.0,
            label=f"within {100 * KEPT:.0f} %",
        )
        axes.plot(ends, ends, color=BLACK, linewidth=0.8)
        for moves, color, label in (
            (others, BLUE, "random moves"),
            (cases, VERMILION, "Cases 1 to 4"),
        ):
            found = ratios(moves, "integrated")
            if len(found.series) == 0:
                continue
            axes.scatter(found.series, found.simulated, s=12, color=color, label=label)
        axes.set_xlabel(f"planned energy over the {BASELINE} planner's (pumps in series)")
        axes.set_ylabel("the same, simulated")
        axes.set_aspect("equal")
        axes.legend()
