"""Figures of the motion: joints against their references, and the tip against its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mhsb_model.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    SKY,
    VERMILION,
    draw_line,
    legend_above,
    written_figure,
)
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.online.execution import REACHED_DISTANCE
from mhsb_sim.report.recorded_run import RecordedRun
from mhsb_sim.report.run_axes import mark_take_overs, seconds, time_axis

PER_MM = 1e3
LEAST_DISTANCE = 1e-2
"""Distances below this are drawn as this, since the axis is logarithmic [mm]."""


def draw_joints(run: RecordedRun, path: Path) -> None:
    """Each joint's angle or extension with its reference, and beside it the difference."""
    n = run.machine.joint_count
    states, references = run.recording.joint_states, run.recording.references
    both = np.isin(states.time_ns, run.tip.time_ns)
    reference, _, _ = run.followed.sample_many(states.time_ns[both])
    error = 1e3 * (states.position[both] - reference)
    with written_figure(path, 1.2 + 2.0 * n) as figure:
        axes = figure.subplots(n, 2, sharex=True, squeeze=False)
        for j, (angles, errors) in enumerate(axes):
            slides = run.machine.arrays.slides[j]
            shown = PER_MM if slides else np.degrees(1.0)
            draw_line(
                angles,
                seconds(run, states.time_ns),
                shown * states.position[:, j],
                color=SKY,
                linewidth=3.5,
                label="measured",
            )
            draw_line(
                angles,
                seconds(run, references.time_ns),
                shown * references.position[:, j],
                color=BLACK,
                linewidth=1.0,
                label="reference",
            )
            angles.set_ylabel(f"joint {j + 1} [{'mm' if slides else 'deg'}]")
            draw_line(
                errors,
                seconds(run, states.time_ns[both]),
                error[:, j],
                color=VERMILION,
                linewidth=0.9,
                label="measured − reference",
            )
            errors.set_ylabel(f"error [{'mm' if slides else 'mrad'}]")
            for each in (angles, errors):
                mark_take_overs(run, each)
        for lowest in axes[-1]:
            time_axis(run, lowest)
        legend_above(figure, *axes[0])


def draw_tip_error(run: RecordedRun, path: Path) -> None:
    """The tip's distance from its reference, and from the goal of the plan in force."""
    time_ns = run.tip.time_ns
    error = PER_MM * run.tip.error
    goal_time_ns, distance = goal_distance(run)
    with written_figure(path, 5.2) as figure:
        upper, lower = figure.subplots(2, 1, sharex=True)
        draw_line(upper, seconds(run, time_ns), error, color=BLUE, label="tip from reference")
        if np.any(run.tip.moving):
            rms = np.sqrt(np.mean(error[run.tip.moving] ** 2))
            upper.axhline(
                rms, color=VERMILION, linestyle="--", label=f"root mean square {rms:.2f} mm"
            )
        upper.set_ylabel("tracking error [mm]")
        upper.set_ylim(bottom=0.0)
        draw_line(
            lower,
            seconds(run, goal_time_ns),
            np.maximum(PER_MM * distance, LEAST_DISTANCE),
            color=BLACK,
            label="tip from goal",
        )
        lower.axhline(
            PER_MM * REACHED_DISTANCE, color=GREEN, linestyle="-.", label="counts as reached"
        )
        lower.set_ylim(LEAST_DISTANCE, 2.0 * PER_MM * run.machine.config.workspace.max_radius)
        lower.set_yscale("log")
        lower.set_ylabel("distance to goal [mm]")
        for each in (upper, lower):
            mark_take_overs(run, each)
        time_axis(run, lower)
        legend_above(figure, upper, lower)


def goal_distance(run: RecordedRun) -> tuple[IntArray, FloatArray]:
    """Times [ns] and distances [m] of the measured tip from the goal it was sent to last."""
    goals = [goal for goal in run.goals if goal.taken_over_ns is not None]
    since_ns = np.array([goal.taken_over_ns for goal in goals], dtype=np.int64)
    at = np.array([goal.verdict.goal.position for goal in goals])
    row = np.searchsorted(since_ns, run.tip.time_ns, "right") - 1
    sent = row >= 0
    if not goals:
        return run.tip.time_ns[sent], np.empty(0)
    away = run.tip.measured[sent] - at[row[sent]]
    return run.tip.time_ns[sent], np.linalg.norm(away, axis=1)
