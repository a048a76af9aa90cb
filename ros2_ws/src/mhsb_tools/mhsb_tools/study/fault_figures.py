"""Figures of the faults: tip error, joint speeds and chamber pressures after the fault."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mhsb_model.figure_style import (
    BLACK,
    JOINT_COLORS,
    legend_above,
    open_figure,
)
from mhsb_tools.study.fault_study import FaultResult

SHOWN_TIME = 2.0
"""Time after the fault that is drawn [s]."""


def draw_faults(results: Sequence[FaultResult], folder: Path) -> None:
    """Draw one figure for each fault and write it as PNG.

    Args:
        results: Result of each fault.
        folder: An existing folder. Each file has the name of its fault.
    """
    for result in results:
        name = result.record.fault.replace(":", "_").replace(".", "_").replace(", ", "_and_")
        draw_fault(result, folder / f"{name}.png")


def draw_fault(result: FaultResult, path: Path) -> None:
    """Draw tip error, joint speeds and chamber pressures over the time since a fault, as PNG.

    The three panels have mm, rad/s and MPa. `SHOWN_TIME` after the fault is drawn. A dotted line
    marks the time at which the fault was detected, a dashed line that at which the valves closed.

    Args:
        result: Measured numbers and signals of the fault.
        path: PNG file to write.
    """
    record, trace = result.record, result.trace[result.trace[:, 0] < SHOWN_TIME]
    count = (trace.shape[1] - 2) // 2
    with open_figure(path, 6.0) as figure:
        error, speed, pressure = figure.subplots(3, 1, sharex=True)
        error.plot(trace[:, 0], 1e3 * trace[:, 1], color=BLACK, label="tip to reference")
        for j in range(count):
            color = JOINT_COLORS[j % len(JOINT_COLORS)]
            speed.plot(trace[:, 0], trace[:, 2 + j], color=color, label=f"joint {j + 1}")
            pressure.plot(trace[:, 0], 1e-6 * trace[:, 2 + count + j], color=color)
        for axes in (error, speed, pressure):
            if record.found_after_s is not None:
                axes.axvline(record.found_after_s, color=BLACK, linewidth=0.9, linestyle=":")
            axes.axvline(result.closed, color=BLACK, linewidth=0.9, linestyle="--")
        after = record.found_after_s
        found = "not found" if after is None else f"found after {after:.3f} s"
        error.set(
            title=f"{record.fault}: {found} (dotted), valves closed (dashed); "
            f"tip {record.tip_error_max_mm:.1f} mm off until then",
            ylabel="tip error [mm]",
        )
        speed.set_ylabel("joint speed [rad/s]")
        pressure.set(ylabel="chamber, higher [MPa]", xlabel="time from the fault [s]")
        legend_above(figure, error, speed)
