"""Figure of the servo's estimates of machine parameters, with their confidence intervals."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np

from mhsb_model.arm_reports import Estimate
from mhsb_model.figure_style import (
    BLACK,
    BROWN,
    GREEN,
    PURPLE,
    TEAL,
    Axes,
    Figure,
    legend_above,
    open_figure,
)
from mhsb_tools.report.recorded_run import EvaluatedRecording
from mhsb_tools.report.run_axes import limit_time_axis, to_seconds

CONFIDENCE_SIGMAS = 1.96
"""Half width of the 95 % interval of a normal distribution [standard deviations]."""

PANEL_LABELS = {
    "payload": ("payload [kg]", 1.0),
    "friction": ("friction [times the file's]", 1.0),
    "leakage": ("leakage [times the file's]", 1.0),
    "overlap": ("overlap [% of the stroke]", 100.0),
    "valve_gain": ("valve gain [times the file's]", 1.0),
    "bulk_modulus": ("bulk modulus [times the file's]", 1.0),
    "pump_lag": ("lag of pumps [ms]", 1e3),
    "delay": ("delay [ms]", 1e3),
}
"""Label of each drawn quantity, and factor from its SI unit to the unit of the label."""

JOINT_COLORS = (GREEN, PURPLE, BROWN, TEAL)
BAND_OPACITY, WIDE_BAND_OPACITY = 0.22, 0.07
"""Opacity of an interval, and of one that the motion has not determined yet."""


Courses = dict[tuple[str, str], list[tuple[float, Estimate]]]
"""Estimates over time: by quantity and actuator, pairs of time [s] and estimate."""


def draw_estimates(run: EvaluatedRecording, path: Path) -> None:
    """Draw the servo's estimates of machine parameters over time, and write the figure.

    There is a panel for each quantity in PANEL_LABELS that has estimates. Each estimate has its 95
    % interval, which is paler while the motion has not yet determined the quantity.

    Args:
        run: The evaluated recording; it must have estimates of at least one quantity in
            PANEL_LABELS.
        path: PNG file to write.
    """
    courses = group_estimates(run)
    with open_figure(path, 1.0 + 1.3 * len(_find_drawn_quantities(courses))) as figure:
        draw_estimate_panels(run, courses, figure)


def group_estimates(run: EvaluatedRecording) -> Courses:
    """Collect the servo's estimates in a recording by quantity and actuator.

    Args:
        run: The evaluated recording.

    Returns:
        A dictionary. The key is a pair: name of the quantity and name of the actuator. The name of
        the actuator is empty for a quantity of the whole arm. The value is a list of pairs in time
        order: time [s since the first joint state] and estimate.
    """
    courses: Courses = defaultdict(list)
    for timed in run.recording.estimates:
        for each in timed.value:
            courses[each.quantity, each.actuator].append((to_seconds(run, timed.time_ns), each))
    return courses


def _find_drawn_quantities(estimate_series: Courses) -> list[str]:
    """Return the quantities that have estimates and a panel, in the order of PANEL_LABELS."""
    return [
        quantity
        for quantity in PANEL_LABELS
        if any(quantity == name for name, _ in estimate_series)
    ]


def draw_estimate_panels(run: EvaluatedRecording, estimate_series: Courses, figure: Figure) -> None:
    """Draw a panel over time for each estimated quantity, and one legend for all.

    The 95 % interval is drawn as a band, which is paler while the motion has not yet determined the
    quantity. The panels have the units of PANEL_LABELS; quantities that are not in it are left out.

    Args:
        run: The evaluated recording, for the time axis.
        estimate_series: Estimates over time, by quantity and actuator, as `group_estimates` returns
            them. At least one quantity must be in PANEL_LABELS.
        figure: Figure that receives the panels.
    """
    drawn = _find_drawn_quantities(estimate_series)
    panels = figure.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0]
    for axes, quantity in zip(panels, drawn, strict=True):
        _draw_quantity(quantity, estimate_series, axes)
    for label, alpha in (
        ("95 % interval", BAND_OPACITY),
        ("the same, not known yet", WIDE_BAND_OPACITY),
    ):
        panels[-1].fill_between([], [], color=BLACK, alpha=alpha, linewidth=0, label=label)
    limit_time_axis(run, panels[-1])
    legend_above(figure, *panels)


def _draw_quantity(quantity: str, estimate_series: Courses, axes: Axes) -> None:
    """Draw the estimates of one quantity over time.

    Each actuator, or the whole arm, has a line and a band for the 95 % interval. The band is paler
    while the motion has not yet determined the quantity (`known` is False). Values are converted
    from SI to the unit in PANEL_LABELS.

    Args:
        quantity: Key of PANEL_LABELS.
        estimate_series: Estimates over time, by quantity and actuator, as `group_estimates` returns
            them.
        axes: Axes to draw on, with time [s] as x. The label of the y axis is set.
    """
    label, factor = PANEL_LABELS[quantity]
    owners = [owner for name, owner in estimate_series if name == quantity]
    for number, owner in enumerate(owners):
        time = np.array([moment for moment, _ in estimate_series[quantity, owner]])
        learnt = [each for _, each in estimate_series[quantity, owner]]
        value = factor * np.array([each.value for each in learnt])
        wide = factor * CONFIDENCE_SIGMAS * np.array([each.deviation for each in learnt])
        known = np.array([each.known for each in learnt])
        color = JOINT_COLORS[number % len(JOINT_COLORS)] if owner else BLACK
        who = owner.replace("_", " ") if owner else "the whole arm"
        axes.plot(time, value, color=color, label=who)
        for which, alpha in ((known, BAND_OPACITY), (~known, WIDE_BAND_OPACITY)):
            axes.fill_between(
                time, value - wide, value + wide, where=which, color=color, alpha=alpha, linewidth=0
            )
    axes.set_ylabel(label.replace(" [", "\n["))
