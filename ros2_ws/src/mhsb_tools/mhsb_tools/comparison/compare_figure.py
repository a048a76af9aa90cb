"""Figure of the integrated planner's savings, as planned and as simulated."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mhsb_model.figure_style import BLACK, GREEN, GREY, PURPLE, open_figure
from mhsb_tools.comparison.planner_comparison import BASELINE_PLANNER, Comparison, ratios

AGREEMENT_SHARE = 0.1
"""Half width of the shaded band: simulated ratios within this share of the planned ones."""


def draw_proportions(cases: Sequence[Comparison], others: Sequence[Comparison], path: Path) -> None:
    """Draw simulated against planned energy ratio, one point for each move, as PNG.

    Each ratio is the energy of the integrated planner's motion divided by the energy of the
    baseline planner's motion. Planned energies are in the reading `series` (servo pump in series
    with the main pump). The diagonal marks equal ratios, and a shaded band marks ratios that differ
    by at most AGREEMENT_SHARE. Moves that one of the two did not plan have no point.

    Args:
        cases: Results for the paper's cases, possibly none.
        others: Results for the random moves.
        path: PNG file to write.
    """
    with open_figure(path, 5.0, 5.5) as figure:
        axes = figure.subplots()
        ends = (0.0, 1.1)
        axes.fill_between(
            ends,
            [(1.0 - AGREEMENT_SHARE) * end for end in ends],
            [(1.0 + AGREEMENT_SHARE) * end for end in ends],
            color=GREY,
            alpha=0.2,
            linewidth=0.0,
            label=f"within {100 * AGREEMENT_SHARE:.0f} %",
        )
        axes.plot(ends, ends, color=BLACK, linewidth=0.8)
        for moves, color, label in (
            (others, GREEN, "random moves"),
            (cases, PURPLE, "Cases 1 to 4"),
        ):
            found = ratios(moves, "integrated")
            if len(found.series) == 0:
                continue
            axes.scatter(found.series, found.simulated, s=12, color=color, label=label)
        axes.set(
            xlabel=f"planned energy over the {BASELINE_PLANNER} planner's (pumps in series)",
            ylabel="the same, simulated",
            aspect="equal",
        )
        axes.legend()
