"""A recording's time along the axes of figures, and what is marked there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mhsb_model.figure_style import GREY, MODE_COLOR
from mhsb_model.modes import BOOSTED, Mode
from mhsb_model.types import IntArray
from mhsb_sim.report.recorded_goals import take_overs
from mhsb_sim.report.recorded_run import RecordedRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def seconds(run: RecordedRun, time_ns: IntArray | int) -> Any:
    """ROS times [ns] as s since the recording's first joint state."""
    return (time_ns - run.recording.joint_states.time_ns[0]) / 1e9


def time_axis(run: RecordedRun, axes: Axes) -> None:
    """The recording's time along x, on the lowest of several axes."""
    axes.set_xlim(0.0, seconds(run, int(run.recording.joint_states.time_ns[-1])))
    axes.set_xlabel("time [s]")


def mark_take_overs(run: RecordedRun, axes: Axes) -> None:
    """A thin line at every time at which a plan took over."""
    for number, time_ns in enumerate(take_overs(run.recording).values()):
        axes.axvline(
            seconds(run, time_ns),
            color=GREY,
            linewidth=0.7,
            linestyle=":",
            label="plan takes over" if number == 0 else None,
        )


def shade_modes(run: RecordedRun, axes: Axes, actuator: int) -> None:
    """Pale bands behind a plot where an actuator is boosted."""
    for mode in filter(BOOSTED.__getitem__, Mode):
        label: str | None = f"mode {mode.name}"
        for begin, end in mode_spans(run, actuator, mode):
            axes.axvspan(begin, end, color=MODE_COLOR[mode], alpha=0.25, linewidth=0, label=label)
            label = None


def mode_spans(run: RecordedRun, actuator: int, mode: Mode) -> list[tuple[float, float]]:
    """Begin and end [s] of the times in which an actuator is in a mode."""
    schedule = run.modes
    end_ns = max(int(run.recording.joint_states.time_ns[-1]), schedule.end_ns)
    edges = seconds(run, np.append(schedule.stamp_ns + schedule.offset_ns, end_ns))
    rows = np.flatnonzero(schedule.modes[:, actuator] == mode)
    return [(float(edges[row]), float(edges[row + 1])) for row in rows]
