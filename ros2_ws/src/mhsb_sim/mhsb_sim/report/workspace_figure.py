"""Figure of the workspace: the tip's path over the regions where joints need boost."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mhsb_model.figure_style import BLACK, PATH_COLOR, written_figure
from mhsb_model.modes import BOOSTED, Mode, strongest
from mhsb_planner.evaluation.operating_regions import OperatingRegions
from mhsb_planner.evaluation.workspace_drawing import draw_arm, draw_regions, draw_workspace_axes
from mhsb_sim.report.recorded_run import RecordedRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PATH_STEP = 0.002
"""Length of path between two points that are drawn [m]."""

WIDTH, HEIGHT = 8.0, 8.2  # in


def draw_workspace(run: RecordedRun, regions: OperatingRegions, path: Path) -> None:
    """The measured tip's path, coloured by the strongest mode in force, with goals and regions."""
    with written_figure(path, HEIGHT, WIDTH) as figure:
        axes = figure.subplots()
        draw_regions(regions, axes)
        draw_workspace_axes(run.machine, axes)
        _draw_arm(run, axes)
        _draw_path(run, axes)
        _draw_goals(run, axes)
        figure.legend(loc="outside right upper")


def _draw_arm(run: RecordedRun, axes: Axes) -> None:
    """The links at the beginning and at the end."""
    position = run.recording.joint_states.position
    for q, style, label in (
        (position[0], "--", "arm at the start"),
        (position[-1], "-", "arm at the end"),
    ):
        draw_arm(run.machine, q, axes, linestyle=style, label=label)


def _draw_path(run: RecordedRun, axes: Axes) -> None:
    tip = run.machine.from_the_side(run.tip.measured)
    travelled = np.cumsum(np.hypot(*np.diff(tip, axis=0, prepend=tip[:1]).T))
    mode = strongest(run.modes.modes_at_many(run.tip.time_ns)).astype(np.int64)
    kept = np.flatnonzero(np.diff(np.floor(travelled / PATH_STEP), append=np.inf) > 0)
    axes.plot(*tip[kept].T, color="white", linewidth=4.5)
    starts = np.flatnonzero(np.diff(mode, prepend=-1))
    for begin, end in zip(starts, [*starts[1:], len(mode) - 1], strict=True):
        inside = kept[(kept > begin) & (kept < end)]
        rows = np.concatenate([[begin], inside, [end]])
        axes.plot(*tip[rows].T, color=PATH_COLOR[Mode(mode[begin])], linewidth=2.0)
    for each, color in PATH_COLOR.items():
        who = "an actuator" if BOOSTED[each] else "all actuators"
        axes.plot([], [], color=color, linewidth=2.0, label=f"tip, {who} in {each.name}")


def _draw_goals(run: RecordedRun, axes: Axes) -> None:
    """A numbered circle at each goal, crossed where it was refused; one for several there."""
    numbers: dict[tuple[float, float, bool], list[str]] = {}
    for number, goal in enumerate(run.goals, start=1):
        place = goal.verdict.goal.position
        if np.all(np.isfinite(place)):
            x, z = run.machine.from_the_side(place).tolist()
            numbers.setdefault((x, z, goal.verdict.code.accepted), []).append(str(number))
    for accepted, marker, label in (
        (True, "o", "goal, numbered in order"),
        (False, "X", "goal, not accepted"),
    ):
        places = [(x, z) for x, z, taken in numbers if taken is accepted]
        if places:
            axes.plot(
                *np.array(places).T,
                linestyle="none",
                marker=marker,
                markersize=8,
                markerfacecolor="white",
                markeredgecolor=BLACK,
                markeredgewidth=1.4,
                zorder=5,
                label=label,
            )
    for (x, z, _), texts in numbers.items():
        axes.annotate(
            ", ".join(texts),
            (x, z),
            xytext=(7, 5),
            textcoords="offset points",
            fontweight="bold",
            zorder=6,
            clip_on=True,
            bbox={"boxstyle": "round,pad=0.15", "color": "white", "alpha": 0.75},
        )
