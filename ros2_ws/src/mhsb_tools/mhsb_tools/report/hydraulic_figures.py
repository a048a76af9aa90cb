"""Figures of the hydraulics: modes, pressures and energy over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mhsb_model.figure_style import (
    BLACK,
    BROWN,
    GREEN,
    GREY,
    PURPLE,
    TEAL,
    YELLOW,
    Axes,
    draw_line,
    legend_above,
    open_figure,
)
from mhsb_model.modes import Mode, count_modules
from mhsb_model.types import FloatArray
from mhsb_tools.moves.move_page import draw_labelled_mode_bars
from mhsb_tools.report.recorded_run import EvaluatedRecording
from mhsb_tools.report.run_axes import (
    get_mode_rows,
    limit_time_axis,
    mark_take_overs,
    shade_modes,
    to_seconds,
)

PER_MPA = 1e-6
PRESSURE_HEADROOM = 1.15
"""Upper end of the pressure axis over the highest pressure [-]."""
Planned = tuple[FloatArray, str, str, str]
"""Planned energy to draw: values [J], label, colour and line style."""


def draw_modes(run: EvaluatedRecording, path: Path) -> None:
    """Draw the actuators' modes and the number of booster modules in use over time.

    The upper panel has a bar for each actuator, coloured by mode. The lower panel shows the number
    of modules in use and the number that the machine has. Vertical lines mark the times at which
    plans took over.

    Args:
        run: The evaluated recording.
        path: PNG file to write.
    """
    n = run.machine.joint_count
    with open_figure(path, 2.4 + 0.5 * n) as figure:
        bars, modules = figure.subplots(
            2, 1, sharex=True, height_ratios=(0.5 * n, 1.0), squeeze=True
        )
        labels = {mode: f"mode {mode.name}" for mode in Mode}
        draw_labelled_mode_bars(*get_mode_rows(run), labels, bars)
        _draw_modules(run, modules)
        for each in (bars, modules):
            mark_take_overs(run, each)
        limit_time_axis(run, modules)
        legend_above(figure, bars, modules)


def _draw_modules(run: EvaluatedRecording, axes: Axes) -> None:
    """Draw how many booster modules are in use over time [s].

    Args:
        run: The evaluated recording.
        axes: Axes to draw on. A dashed line marks the number of modules that the machine has.
            Limits, ticks and label of the y axis are set.
    """
    fitted = run.machine.config.hydraulics.modules
    time, modes = get_mode_rows(run)
    used = [count_modules(row, fitted.per_mode) for row in modes]
    axes.step(time, used, where="post", color=BLACK, label="booster modules in use")
    axes.axhline(fitted.count, color=GREY, linestyle="--", label="modules fitted")
    axes.set_ylim(-0.2, fitted.count + 0.4)
    axes.set_yticks(range(fitted.count + 1))
    axes.set_ylabel("modules")


def draw_pressures(run: EvaluatedRecording, path: Path) -> None:
    """Draw each actuator's chamber and supply pressures [MPa] over time, and write the figure.

    There is a panel for each actuator. A dashed line marks the main pump's pressure P_S. Further
    lines mark the relief pressures of the pump line and of the chambers; if one is beyond the axis,
    the panel's title names it. Coloured bands mark times in a boosted mode, vertical lines the
    times at which plans took over.

    Args:
        run: The evaluated recording.
        path: PNG file to write.
    """
    n = run.machine.joint_count
    table = run.recording.actuators
    time = to_seconds(run, table.time_ns)
    lines = (
        ("cap_pressure", "cap-side chamber", PURPLE),
        ("rod_pressure", "rod-side chamber", GREEN),
        ("supply_pressure", "supply line", BLACK),
    )
    with open_figure(path, 1.2 + 2.4 * n) as figure:
        axes = figure.subplots(n, 1, sharex=True, sharey=True, squeeze=False)[:, 0]
        for j, each in enumerate(axes):
            shade_modes(run, each, j)
            for quantity, label, color in lines:
                draw_line(
                    each,
                    time,
                    PER_MPA * table.quantity[quantity][:, j],
                    color=color,
                    linewidth=1.0,
                    label=label,
                )
            draw_pressure_limits(run, each, j)
            mark_take_overs(run, each)
            each.set_ylabel(f"actuator {j + 1} [MPa]")
        limit_time_axis(run, axes[-1])
        legend_above(figure, *axes)


def draw_pressure_limits(run: EvaluatedRecording, axes: Axes, actuator: int) -> None:
    """Set the pressure axis of one actuator's panel [MPa], and draw P_S and relief pressures.

    The axis goes from 0 to PRESSURE_HEADROOM times the highest pressure of all actuators, or times
    P_S if that is higher. P_S, the main pump's pressure, is a dashed line. The relief pressures of
    supply line and chambers are lines if they are on the axis. Otherwise the title names them.

    Args:
        run: The evaluated recording.
        axes: Axes of the actuator.
        actuator: Index of the actuator, from 0.
    """
    normal, quantity = run.machine.arrays.supply_pressure, run.recording.actuators.quantity
    seen = [quantity[name] for name in ("cap_pressure", "rod_pressure", "supply_pressure")]
    highest = PRESSURE_HEADROOM * max(normal, np.max(seen, initial=0.0))
    axes.axhline(PER_MPA * normal, color=GREY, linestyle="--", label="main pump, $P_S$")
    beyond = []
    for pressure, label, style in (
        (run.machine.config.circuit.line_relief_pressure, "line relief", "--"),
        (float(run.machine.chamber_reliefs[actuator]), "chamber relief", "-."),
    ):
        if pressure <= highest:
            axes.axhline(PER_MPA * pressure, color=BROWN, linestyle=style, label=label)
        else:
            beyond.append(f"{label} at {PER_MPA * pressure:g} MPa")
    axes.set_title(", ".join(beyond), loc="left", fontsize=8, color=GREY)
    axes.set_ylim(0.0, PER_MPA * highest)


def draw_energy(run: EvaluatedRecording, path: Path) -> None:
    """Draw measured and planned energy and power over time, and write the figure.

    The upper panel stacks the measured energies of main pump and servo pumps [J] since the first
    report of the simulator. Two lines show the planned energy in the readings `paper` and `series`,
    two ways to price boosted oil. The lower panel shows the mean power between consecutive reports
    [W]; it is empty if there are fewer than two.

    Args:
        run: The evaluated recording.
        path: PNG file to write.
    """
    energy = run.energy
    time = to_seconds(run, energy.time_ns)
    measured = energy.main_pump + energy.servo_pumps
    planned: list[Planned] = [
        (energy.planned, "planned, reading paper", BLACK, "-"),
        (energy.planned_series, "planned, reading series", PURPLE, "--"),
    ]
    with open_figure(path, 6.0) as figure:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        upper.stackplot(
            time,
            energy.main_pump,
            energy.servo_pumps,
            colors=(TEAL, YELLOW),
            alpha=0.7,
            linewidth=0,
            labels=("measured, main pump", "measured, servo pumps"),
        )
        for total, label, color, style in planned:
            upper.plot(time, total, color=color, linestyle=style, label=label)
        upper.set_ylabel("energy [J]")
        upper.set_ylim(bottom=0.0)
        if len(time) > 1:
            _draw_power(lower, time, np.vstack([energy.main_pump, measured]), planned)
        lower.set_ylabel("power [W]")
        lower.set_ylim(bottom=0.0)
        for each in (upper, lower):
            mark_take_overs(run, each)
        limit_time_axis(run, lower)
        legend_above(figure, upper)


def _draw_power(axes: Axes, time: FloatArray, measured: FloatArray, planned: list[Planned]) -> None:
    """Draw measured and planned mean power [W] between consecutive reports of the simulator.

    The powers of main pump and servo pumps are stacked. Each planned energy gives a line.

    Args:
        axes: Axes to draw on. Neither axis labels nor labels for a legend are set.
        time: Time of each report, shape (k,) [s], k ≥ 2.
        measured: Energy delivered up to each report, by the main pump (row 0) and by all pumps (row
            1), shape (2, k) [J].
        planned: Energies planned up to each report, each an array of shape (k,) [J] with label,
            colour and line style. The label is not used.
    """
    span = np.diff(time)
    main_pump, all_pumps = np.diff(measured) / span
    axes.stairs(main_pump, time, fill=True, color=TEAL, alpha=0.7, linewidth=0)
    axes.stairs(
        all_pumps, time, baseline=main_pump, fill=True, color=YELLOW, alpha=0.7, linewidth=0
    )
    for total, _, color, style in planned:
        axes.stairs(np.diff(total) / span, time, baseline=None, color=color, linestyle=style)
