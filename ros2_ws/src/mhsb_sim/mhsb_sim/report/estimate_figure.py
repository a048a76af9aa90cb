"""Figure of what the servo has learnt of its machine, with how well it is known."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INTERVAL = 1.96
"""Standard deviations to either side of which 95 % lie between."""

PANELS = {
    "payload": ("payload [kg]", 1.0),
    "friction": ("friction [times the file's]", 1.0),
    "leakage": ("leakage [times the file's]", 1.0),
    "overlap": ("overlap [% of the stroke]", 100.0),
    "valve_gain": ("valve gain [times the file's]", 1.0),
    "bulk_modulus": ("bulk modulus [times the file's]", 1.0),
    "pump_lag": ("lag of pumps [ms]", 1e3),
    "delay": ("delay [ms]", 1e3),
}
"""What is drawn: label, and factor from the estimate's own unit."""

COLORS = (BLUE, VERMILION, GREEN, PURPLE)
PALE, PALER = 0.22, 0.07


Courses = dict[tuple[str, str], list[tuple[float, Estimate]]]


def draw_estimates(run: RecordedRun, path: Path) -> None:
    """Each quantity over time with its 95 % interval, paler while the motion has not told it."""
    courses = courses_of(run)
    with written_figure(path, 1.0 + 1.3 * len(_told(courses))) as figure:
        draw_courses(run, courses, figure)


def courses_of(run: RecordedRun) -> Courses:
    """By quantity and actuator what was told of them, with its times [s]."""
    courses: Courses = defaultdict(list)
    for heard in run.recording.estimates:
        for each in heard.value:
            courses[each.quantity, each.actuator].append((seconds(run, heard.time_ns), each))
    return courses


def _told(courses: Courses) -> list[str]:
    return [quantity for quantity in PANELS if any(quantity == name for name, _ in courses)]


def draw_courses(run: RecordedRun, courses: Courses, figure: Figure) -> None:
    """A panel for each quantity that was told of, and one legend."""
    told = _told(courses)
    panels = figure.subplots(len(told), 1, sharex=True, squeeze=False)[:, 0]
    for axes, quantity in zip(panels, told, strict=True):
        _draw_quantity(quantity, courses, axes)
    for label, alpha in (("95 % interval", PALE), ("the same, not known yet", PALER)):
        panels[-1].fill_between([], [], color=BLACK, alpha=alpha, linewidth=0, label=label)
    time_axis(run, panels[-1])
    legend_above(figure, *panels)


def _draw_quantity(quantity: str, courses: Courses, axes: Axes) -> None:
    """A quantity of the whole arm, or of each actuator."""
    label, factor = PANELS[quantity]
    owners = [owner for name, owner in courses if name == quantity]
    for number, owner in enumerate(owners):
        time = np.array([moment for moment, _ in courses[quantity, owner]])
        learnt = [each for _, each in courses[quantity, owner]]
        value = factor * np.array([each.value for each in learnt])
        wide = factor * INTERVAL * np.array([each.deviation for each in learnt])
        known = np.array([each.known for each in learnt])
        color = COLORS[number % len(COLORS)] if owner else BLACK
        who = owner.replace("_", " ") if owner else "the whole arm"
        axes.plot(time, value, color=color, label=who)
        for which, alpha in ((known, PALE), (~known, PALER)):
            axes.fill_between(
                time, value - wide, value + wide, where=which, color=color, alpha=alpha, linewidth=0
            )
    axes.set_ylabel(label.replace(" [", "\n["))
