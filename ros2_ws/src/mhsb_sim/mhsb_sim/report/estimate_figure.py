"""Figure of what the servo has learnt of its machine, with how well it is known."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np

from mhsb_model.arm_reports import Estimate
from mhsb_model.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    PURPLE,
    VERMILION,
    legend_above,
    written_figure,
)
from mhsb_sim.report.recorded_run import RecordedRun
from mhsb_sim.report.run_axes import seconds, time_axis

INTERVAL = 1.96
"""Standard deviations to either side of which 95 % lie between."""

PANELS = {
    "payload": ("payload [kg]", 1.0),
    "friction": ("friction [times the file's]", 1.0),
    "leakage": ("leakage [times the file's]", 1.0),
    "overlap": ("overlap [% of the stroke]", 100.0),
    "valve_gain": ("valve gain [times the file's]", 1.0),
    "bulk_modulus": ("bulk modulus [times the file's]", 1.0),
}
"""What is drawn: label, and factor from the estimate's own unit."""

COLORS = (BLUE, VERMILION, GREEN, PURPLE)
PALE, PALER = 0.2, 0.05


def draw_estimates(run: RecordedRun, path: Path) -> None:
    """Each quantity over time with its 95 % interval, paler while the motion has not told it."""
    courses: dict[tuple[str, str], list[tuple[float, Estimate]]] = defaultdict(list)
    for heard in run.recording.estimates:
        for each in heard.value:
            courses[each.quantity, each.actuator].append((seconds(run, heard.time_ns), each))
    with written_figure(path, 1.0 + 1.3 * len(PANELS)) as figure:
        panels = figure.subplots(len(PANELS), 1, sharex=True)
        for axes, (quantity, (label, factor)) in zip(panels, PANELS.items(), strict=True):
            owners = [owner for name, owner in courses if name == quantity]
            for number, owner in enumerate(owners):
                time = np.array([moment for moment, _ in courses[quantity, owner]])
                learnt = [each for _, each in courses[quantity, owner]]
                value = factor * np.array([each.value for each in learnt])
                wide = factor * INTERVAL * np.array([each.deviation for each in learnt])
                known = np.array([each.known for each in learnt])
                color = COLORS[number % len(COLORS)] if owner else BLACK
                axes.plot(time, value, color=color, label=owner or "of the whole arm")
                for which, alpha in ((known, PALE), (~known, PALER)):
                    axes.fill_between(
                        time, value - wide, value + wide, where=which, color=color, alpha=alpha,
                        linewidth=0,
                    )  # fmt: skip
            axes.set_ylabel(label.replace(" [", "\n["))
        time_axis(run, panels[-1])
        legend_above(figure, *panels[:2])
