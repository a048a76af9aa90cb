"""Figures of studies: scenarios in an overview and over time, and the time after each fault."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from mhsb_model.figure_style import (
    BLACK,
    BLUE,
    JOINT_COLORS,
    SKY,
    VERMILION,
    Axes,
    legend_above,
    open_figure,
)
from mhsb_tools.study.fault_study import FaultResult
from mhsb_tools.study.servo_study import ScenarioResult

CONTROLLER_COLORS = {"coordinated": BLUE, "independent": VERMILION}
LEAST_ERROR = 1e-2
"""Lower end of the error axes [mm]."""
LARGEST_WANTED_ERROR = 1.0
"""Tip error that is marked as the goal [mm]."""
ROW_HEIGHT = 0.19
"""Height of a scenario's row in the overview [in]."""
SHOWN_TIME = 2.0
"""Time after a fault that is drawn [s]."""


def draw_study(results: Sequence[ScenarioResult], folder: Path) -> None:
    """Draw the overview of all scenarios, and a figure of signals for some of them.

    Of all scenarios with the same goals and interval, the one with the largest supply overshoot
    gets a figure.

    Args:
        results: Result of each scenario.
        folder: An existing folder.
    """
    draw_overview(results, folder / "overview.png")
    for result in select_largest_overshoots(results):
        draw_traces(result, folder / f"{result.scenario.name}.png")


def select_largest_overshoots(results: Iterable[ScenarioResult]) -> list[ScenarioResult]:
    """Select the scenarios with the largest supply overshoot.

    Of all scenarios with the same goals and the same interval, one is selected. The largest
    overshoot of any controller counts.

    Args:
        results: Result of each scenario.

    Returns:
        The selected results, in the order in which their goals and interval first appear.
    """
    largest: dict[tuple[object, ...], ScenarioResult] = {}
    for result in results:
        key = (result.scenario.goals, result.scenario.interval)
        if key not in largest or _overshoot(result) > _overshoot(largest[key]):
            largest[key] = result
    return list(largest.values())


def draw_overview(results: Sequence[ScenarioResult], path: Path) -> None:
    """Draw tip errors, supply overshoots and energies of all scenarios, and write the figure.

    There is a panel each for tip error RMS [mm], supply overshoot [MPa] and energy of all pumps
    [J]. A panel has a row for each scenario and a point for each controller. A mark shows the
    planned energy, with boosted oil priced as `series` (servo pump in series with the main pump).
    A dotted line marks a tip error of LARGEST_WANTED_ERROR. Tip errors below LEAST_ERROR are drawn
    at LEAST_ERROR.

    Args:
        results: Result of each scenario, with both controllers of CONTROLLER_COLORS.
        path: PNG file to write.
    """
    names = [
        f"{result.scenario.name}{' (held out)' if result.scenario.held_out else ''}"
        for result in results
    ]
    rows = np.arange(len(results))
    with open_figure(path, 1.2 + ROW_HEIGHT * len(results), 12.0) as figure:
        errors, pressures, energies = figure.subplots(1, 3, sharey=True)
        for number, (controller, color) in enumerate(CONTROLLER_COLORS.items()):
            records = [result.records_by_controller[controller] for result in results]
            place = rows + 0.2 * (2 * number - 1)
            style = {"color": color, "s": 14, "label": controller}
            errors.scatter(
                [max(LEAST_ERROR, record.tip_error_rms_mm) for record in records], place, **style
            )
            pressures.scatter([record.supply_overshoot_mpa for record in records], place, **style)
            energies.scatter(
                [record.energy_mp_j + record.energy_sp_j for record in records], place, **style
            )
        energies.scatter(
            [result.records[0].energy_planned_series_j for result in results],
            rows,
            marker="|",
            color=BLACK,
            label="planned (series)",
        )
        errors.axvline(LARGEST_WANTED_ERROR, color=BLACK, linewidth=0.8, linestyle=":")
        errors.set(xscale="log", xlabel="tip error RMS [mm]")
        pressures.set_xlabel("supply overshoot [MPa]")
        energies.set_xlabel("energy of all pumps [J]")
        errors.set_yticks(rows, names)
        errors.set_ylim(len(rows) - 0.5, -0.5)
        legend_above(figure, errors, energies)


def draw_traces(result: ScenarioResult, path: Path) -> None:
    """Draw supply pressures and tip error of one scenario over time, and write the figure.

    Each of the two upper panels is for one controller. It shows the highest pressure of all supply
    lines, and the highest pressure that the motion needs [MPa]. The lowest panel shows the tip
    errors of both controllers [mm].

    Args:
        result: Result of the scenario, with a trace for each controller.
        path: PNG file to write.
    """
    with open_figure(path, 6.5) as figure:
        axes = figure.subplots(3, 1, sharex=True)
        for panel, (controller, trace) in zip(axes, result.traces.items(), strict=False):
            _draw_pressures(panel, controller, trace)
            axes[-1].plot(
                trace[:, 0],
                1e3 * trace[:, 1],
                color=CONTROLLER_COLORS[controller],
                label=controller,
            )
        axes[0].set_title(result.scenario.name)
        axes[-1].set_yscale("log")
        axes[-1].set_ylim(bottom=LEAST_ERROR)
        axes[-1].set(ylabel="tip error [mm]", xlabel="time [s]")
        legend_above(figure, *axes)


def _draw_pressures(axes: Axes, controller: str, trace: np.ndarray) -> None:
    """Draw the highest pressure of all supply lines and the needed pressure [MPa] over time.

    Args:
        axes: Axes to draw on.
        controller: Name of the controller, for the axis label.
        trace: Signals, shape (k, 3 + n). The columns are time [s], tip error [m], supply pressure
            of each of n actuators [Pa], and the highest needed pressure [Pa].
    """
    time, lines, need = trace[:, 0], trace[:, 2:-1], trace[:, -1]
    axes.plot(time, 1e-6 * need, color=BLACK, linewidth=1.0, label="needed by the motion")
    axes.fill_between(
        time, 1e-6 * need, 1e-6 * lines.max(axis=1), color=SKY, alpha=0.5, label="highest line"
    )
    axes.set_ylabel(f"{controller}\nsupply [MPa]")


def _overshoot(result: ScenarioResult) -> float:
    """Return the largest supply overshoot of all controllers in a scenario [MPa]."""
    return max(record.supply_overshoot_mpa for record in result.records)


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
    marks the time at which the fault was detected, a dashed line the time at which the valves
    closed.

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
