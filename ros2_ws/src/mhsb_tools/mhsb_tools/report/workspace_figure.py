"""Figure of the workspace: the tip's path over the regions where joints need boost."""

from pathlib import Path

import numpy as np

from mhsb_model.figure_style import BLACK, Axes, open_figure
from mhsb_tools.moves.move_page import PATH_WIDTH, draw_tip_path
from mhsb_tools.moves.operating_regions import OperatingRegions
from mhsb_tools.moves.workspace_drawing import (
    draw_arm_at_ends,
    draw_regions,
    draw_workspace_axes,
)
from mhsb_tools.report.recorded_run import EvaluatedRecording

PATH_STEP = 0.002
"""Path length between two drawn points of the tip's path [m]."""

FIGURE_WIDTH, FIGURE_HEIGHT = 8.0, 8.2  # in


def draw_workspace(run: EvaluatedRecording, regions: OperatingRegions, path: Path) -> None:
    """Draw the tip's path over the workspace with arm and goals, and write the figure.

    The figure shows the arm's plane, x and z [m]. Coloured squares show which joints need boost at
    each node of the workspace. The path has the colours of all boosted modes in force.

    Args:
        run: The evaluated recording.
        regions: Nodes of the workspace at which joints need boost.
        path: PNG file to write.
    """
    with open_figure(path, FIGURE_HEIGHT, FIGURE_WIDTH) as figure:
        axes = figure.subplots()
        draw_regions(regions, axes)
        draw_workspace_axes(run.machine, axes)
        draw_arm_at_ends(run.machine, run.recording.joint_states.position, axes)
        _draw_path(run, axes)
        _draw_goals(run, axes)
        figure.legend(loc="outside right upper")


def _draw_path(run: EvaluatedRecording, axes: Axes) -> None:
    """Draw the measured path of the tip in the arm's plane, in the colours of the modes.

    Points that are closer than about PATH_STEP along the path are skipped, unless a mode changes
    there. Each mode has a label for the legend.

    Args:
        run: The evaluated recording.
        axes: Axes to draw on.
    """
    tip = run.machine.project_to_plane(run.tip.measured)
    travelled = np.cumsum(np.hypot(*np.diff(tip, axis=0, prepend=tip[:1]).T))
    modes = run.modes.modes_at_many(run.tip.time_ns)
    far = np.diff(np.floor(travelled / PATH_STEP), append=np.inf) > 0
    kept = far | np.any(np.diff(modes.astype(np.int64), axis=0, prepend=-1) != 0, axis=1)
    axes.plot(*tip[kept].T, color="white", linewidth=1.4 * max(PATH_WIDTH.values()))
    draw_tip_path(tip[kept], modes[kept], axes)


def _draw_goals(run: EvaluatedRecording, axes: Axes) -> None:
    """Draw a circle at each goal with an accepted verdict, and a cross at each other goal.

    The goals are numbered from 1 in the order of their verdicts. If goals have the same position
    and the same kind of mark, they share one mark with all their numbers. Crosses are larger than
    circles and drawn first, and their numbers are below them, so that both can be read at one
    place. Positions are projected to the arm's plane. A goal whose position is not finite is left
    out, and its number is not used again.

    Args:
        run: The evaluated recording.
        axes: Axes to draw on.
    """
    numbers: dict[tuple[float, float, bool], list[str]] = {}
    for number, goal in enumerate(run.goals, start=1):
        place = goal.verdict.goal.position
        if np.all(np.isfinite(place)):
            x, z = run.machine.project_to_plane(place).tolist()
            numbers.setdefault((x, z, goal.verdict.code.accepted), []).append(str(number))
    for accepted, marker, size, layer, label in (
        (True, "o", 8, 5.0, "goal, numbered in order"),
        (False, "X", 13, 4.0, "goal, not accepted"),
    ):
        places = [(x, z) for x, z, taken in numbers if taken is accepted]
        if places:
            axes.plot(
                *np.array(places).T,
                linestyle="none",
                marker=marker,
                markersize=size,
                markerfacecolor="white",
                markeredgecolor=BLACK,
                markeredgewidth=1.4,
                zorder=layer,
                label=label,
            )
    for (x, z, accepted), texts in numbers.items():
        axes.annotate(
            ", ".join(texts),
            (x, z),
            xytext=(7, 5) if accepted else (7, -14),
            textcoords="offset points",
            fontweight="bold",
            zorder=6,
            clip_on=True,
            bbox={"boxstyle": "round,pad=0.15", "color": "white", "alpha": 0.75},
        )
