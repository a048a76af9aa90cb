"""Figures of the motion: joints against their references, and the tip's errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mhsb_model.figure_style import (
    BLACK,
    GREEN,
    PALE,
    PURPLE,
    draw_line,
    legend_above,
    open_figure,
)
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.online.settings import REACHED_TOLERANCE
from mhsb_tools.report.recorded_run import EvaluatedRecording
from mhsb_tools.report.run_axes import limit_time_axis, mark_take_overs, to_seconds

PER_MM = 1e3
LEAST_DISTANCE = 1e-2
"""Smallest distance on the logarithmic axis [mm]; smaller ones are drawn there."""


def draw_joints(run: EvaluatedRecording, path: Path) -> None:
    """Draw position, reference and position error of each joint over time, and write the figure.

    The error is the measured position minus the reference; it is drawn only at times with a
    reference. Positions are in deg and errors in mrad; for telescopes, both are in mm. Vertical
    lines mark the times at which plans took over.

    Args:
        run: The evaluated recording.
        path: PNG file to write.
    """
    n = run.machine.joint_count
    states, references = run.recording.joint_states, run.recording.references
    both = np.isin(states.time_ns, run.tip.time_ns)
    reference, _, _ = run.reference.sample_many(states.time_ns[both])
    error = 1e3 * (states.position[both] - reference)
    with open_figure(path, 1.2 + 2.0 * n) as figure:
        axes = figure.subplots(n, 2, sharex=True, squeeze=False)
        for j, (angles, errors) in enumerate(axes):
            slides = run.machine.arrays.slides[j]
            shown = PER_MM if slides else np.degrees(1.0)
            draw_line(
                angles,
                to_seconds(run, states.time_ns),
                shown * states.position[:, j],
                color=PALE,
                linewidth=3.5,
                label="measured",
            )
            draw_line(
                angles,
                to_seconds(run, references.time_ns),
                shown * references.position[:, j],
                color=BLACK,
                linewidth=1.0,
                label="reference",
            )
            angles.set_ylabel(f"joint {j + 1} [{'mm' if slides else 'deg'}]")
            draw_line(
                errors,
                to_seconds(run, states.time_ns[both]),
                error[:, j],
                color=PURPLE,
                linewidth=0.9,
                label="measured − reference",
            )
            errors.set_ylabel(f"error [{'mm' if slides else 'mrad'}]")
            for each in (angles, errors):
                mark_take_overs(run, each)
        for lowest in axes[-1]:
            limit_time_axis(run, lowest)
        legend_above(figure, *axes[0])


def draw_tip_error(run: EvaluatedRecording, path: Path) -> None:
    """Draw the tip's distance from its reference and from its goal over time; write the figure.

    The upper axes show the distance from the reference [mm]. A dashed line is its root mean square,
    from the first to the last motion of the reference. The lower axes show the distance from the
    goal of the plan in force [mm], on a logarithmic scale, and the distance that counts as reached.

    Args:
        run: The evaluated recording.
        path: PNG file to write.
    """
    time_ns = run.tip.time_ns
    error = PER_MM * run.tip.error
    goal_time_ns, distance = compute_goal_distance(run)
    with open_figure(path, 5.2) as figure:
        upper, lower = figure.subplots(2, 1, sharex=True)
        draw_line(upper, to_seconds(run, time_ns), error, color=GREEN, label="tip from reference")
        if np.any(run.tip.moving):
            rms = np.sqrt(np.mean(error[run.tip.moving] ** 2))
            upper.axhline(rms, color=PURPLE, linestyle="--", label=f"root mean square {rms:.2f} mm")
        upper.set_ylabel("tracking error [mm]")
        upper.set_ylim(bottom=0.0)
        draw_line(
            lower,
            to_seconds(run, goal_time_ns),
            np.maximum(PER_MM * distance, LEAST_DISTANCE),
            color=BLACK,
            label="tip from goal",
        )
        lower.axhline(
            PER_MM * REACHED_TOLERANCE, color=GREEN, linestyle="-.", label="counts as reached"
        )
        lower.set(
            ylim=(LEAST_DISTANCE, 2.0 * PER_MM * run.machine.config.workspace.max_radius),
            yscale="log",
            ylabel="distance to goal [mm]",
        )
        for each in (upper, lower):
            mark_take_overs(run, each)
        limit_time_axis(run, lower)
        legend_above(figure, upper, lower)


def compute_goal_distance(run: EvaluatedRecording) -> tuple[IntArray, FloatArray]:
    """Compute the distance of the measured tip from its goal at each time.

    At each time, the goal is that of the plan in force. Times before the first plan took over are
    left out.

    Args:
        run: The evaluated recording.

    Returns:
        ROS times, int64 (k,) [ns], and distances at these times, shape (k,) [m]. Both are empty if
        no plan took over.
    """
    taken_over = sorted(
        (goal.taken_over_ns, goal.verdict.goal.position)
        for goal in run.goals
        if goal.taken_over_ns is not None
    )
    since_ns = np.array([since for since, _ in taken_over], dtype=np.int64)
    row = np.searchsorted(since_ns, run.tip.time_ns, "right") - 1
    sent = row >= 0
    if not taken_over:
        return run.tip.time_ns[sent], np.empty(0)
    at = np.array([position for _, position in taken_over])
    away = run.tip.measured[sent] - at[row[sent]]
    return run.tip.time_ns[sent], np.linalg.norm(away, axis=1)
