"""Time axis of figures of a recording, and marks on it."""

from __future__ import annotations

from typing import Any

import numpy as np

from mhsb_model.figure_style import GREY, MODE_COLOR, Axes
from mhsb_model.modes import BOOSTED_MODES
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_tools.moves.move_page import yield_mode_spans
from mhsb_tools.report.recorded_goals import find_take_over_times
from mhsb_tools.report.recorded_run import EvaluatedRecording


def to_seconds(run: EvaluatedRecording, time_ns: IntArray | int) -> Any:
    """Convert ROS times [ns] to seconds since the recording's first joint state."""
    return (time_ns - run.recording.joint_states.time_ns[0]) / 1e9


def limit_time_axis(run: EvaluatedRecording, axes: Axes) -> None:
    """Set limits and label of the time axis, which spans the recording's joint states."""
    axes.set(
        xlim=(0.0, to_seconds(run, int(run.recording.joint_states.time_ns[-1]))), xlabel="time [s]"
    )


def mark_take_overs(run: EvaluatedRecording, axes: Axes) -> None:
    """Draw a thin vertical line at each time at which the arm began to follow a plan.

    Args:
        run: The evaluated recording.
        axes: Axes to draw on, with time [s since the first joint state] as x.
    """
    for time_ns in find_take_over_times(run.recording).values():
        axes.axvline(
            to_seconds(run, time_ns),
            color=GREY,
            linewidth=0.7,
            linestyle=":",
            label="plan takes over",
        )


def shade_modes(run: EvaluatedRecording, axes: Axes, actuator: int) -> None:
    """Draw a pale band behind each time span in which an actuator is boosted.

    The band has the colour and the label of the mode.

    Args:
        run: The evaluated recording.
        axes: Axes to draw on, with time [s since the first joint state] as x.
        actuator: Index of the actuator, from 0.
    """
    time, modes = get_mode_rows(run)
    for begin, end, mode in yield_mode_spans(modes[:, actuator]):
        if BOOSTED_MODES[mode]:
            axes.axvspan(
                time[begin],
                time[end],
                color=MODE_COLOR[mode],
                alpha=0.25,
                linewidth=0,
                label=f"mode {mode.name}",
            )


def get_mode_rows(run: EvaluatedRecording) -> tuple[FloatArray, ModeArray]:
    """Return the modes of all n actuators over time, with a last row for the recording's end.

    Args:
        run: The evaluated recording.

    Returns:
        Times from which on each row of modes is in force, shape (k,) [s since the first joint
        state], and the rows, shape (k, n). The last row repeats the one before.
    """
    schedule = run.modes
    end_ns = max(int(run.recording.joint_states.time_ns[-1]), schedule.end_ns)
    time_ns = np.append(schedule.stamp_ns + schedule.offset_ns, end_ns)
    return to_seconds(run, time_ns), np.vstack([schedule.modes, schedule.modes[-1:]])
