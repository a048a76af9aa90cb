"""A figure of each fault: tip error, joint speeds and chamber pressures from the fault on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mhsb_model.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    VERMILION,
    legend_above,
    written_figure,
)
from mhsb_sim.study.fault_study import FaultResult

COLORS = BLUE, VERMILION, GREEN, PURPLE, ORANGE
SHOWN = 2.0
"""Time from the fault that is drawn [s]."""


def draw_faults(results: Sequence[FaultResult], folder: Path) -> list[Path]:
    """One figure for each fault into a folder that is there; returns the files."""
    files = []
    for result in results:
        name = result.record.fault.replace(":", "_").replace(".", "_").replace(", ", "_and_")
        files.append(folder / f"{name}.png")
        draw_fault(result, files[-1])
    return files


def draw_fault(result: FaultResult, path: Path) -> None:
    """The traces of one fault, when it was found and when the valves closed."""
    record, trace = result.record, result.trace[result.trace[:, 0] < SHOWN]
    count = (trace.shape[1] - 2) // 2
    with written_figure(path, 6.0) as figure:
        error, speed, pressure = figure.subplots(3, 1, sharex=True)
        error.plot(trace[:, 0], 1e3 * trace[:, 1], color=BLACK, label="tip to reference")
        for j in range(count):
            color = COLORS[j % len(COLORS)]
            speed.plot(trace[:, 0], trace[:, 2 + j], color=color, label=f"joint {j + 1}")
            pressure.plot(trace[:, 0], 1e-6 * trace[:, 2 + count + j], color=color)
        for axes in (error, speed, pressure):
            if record.found_after_s is not None:
                axes.axvline(record.found_after_s, color=BLACK, linewidth=0.9, linestyle=":")
            axes.axvline(result.closed, color=BLACK, linewidth=0.9, linestyle="--")
        after = record.found_after_s
        found = "not found" if after is None else f"found after {after:.3f} s"
        error.set_title(
            f"{record.fault}: {found} (dotted), valves closed (dashed); "
            f"tip {record.tip_error_max_mm:.1f} mm off until then"
        )
        error.set_ylabel("tip error [mm]")
        speed.set_ylabel("joint speed [rad/s]")
        pressure.set_ylabel("chamber, higher [MPa]")
        pressure.set_xlabel("time from the fault [s]")
        legend_above(figure, error, speed)
