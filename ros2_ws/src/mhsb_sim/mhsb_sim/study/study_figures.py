"""Figures of the servo study: all scenarios at a glance, and how pressures and errors run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mhsb_model.figure_style import BLACK, BLUE, SKY, VERMILION, legend_above, written_figure
from mhsb_sim.study.servo_study import ScenarioResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLORS = {"coordinated": BLUE, "independent": VERMILION}
LEAST_ERROR = 1e-2  # mm
LARGEST_WANTED_ERROR = 1.0  # mm
ROW_HEIGHT = 0.19  # in


def draw_study(results: Sequence[ScenarioResult], folder: Path) -> list[Path]:
    """Every figure of the study into a folder that is there; returns the files."""
    overview = folder / "overview.png"
    draw_overview(results, overview)
    files = [overview]
    for result in telling_results(results):
        files.append(folder / f"{result.scenario.name}.png")
        draw_traces(result, files[-1])
    return files


def telling_results(results: Iterable[ScenarioResult]) -> list[ScenarioResult]:
    """Of each sequence of goals the scenario in which pressures overshoot most."""
    telling: dict[tuple[object, ...], ScenarioResult] = {}
    for result in results:
        key = (result.scenario.goals, result.scenario.interval)
        if key not in telling or _overshoot(result) > _overshoot(telling[key]):
            telling[key] = result
    return list(telling.values())


def draw_overview(results: Sequence[ScenarioResult], path: Path) -> None:
    """Tip error, supply overshoot and energy of every scenario and controller."""
    names = [
        f"{result.scenario.name}{' (held out)' if result.scenario.held_out else ''}"
        for result in results
    ]
    rows = np.arange(len(results))
    with written_figure(path, 1.2 + ROW_HEIGHT * len(results), 12.0) as figure:
        errors, pressures, energies = figure.subplots(1, 3, sharey=True)
        for number, (controller, color) in enumerate(COLORS.items()):
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
        errors.set_xscale("log")
        errors.set_xlabel("tip error RMS [mm]")
        pressures.set_xlabel("supply overshoot [MPa]")
        energies.set_xlabel("energy of all pumps [J]")
        errors.set_yticks(rows, names)
        errors.set_ylim(len(rows) - 0.5, -0.5)
        legend_above(figure, errors, energies)


def draw_traces(result: ScenarioResult, path: Path) -> None:
    """Supply pressures against what the motion needs, and the tip error, of both controllers."""
    with written_figure(path, 6.5) as figure:
        axes = figure.subplots(3, 1, sharex=True)
        for panel, (controller, trace) in zip(axes, result.traces.items(), strict=False):
            _draw_pressures(panel, controller, trace)
            axes[-1].plot(
                trace[:, 0], 1e3 * trace[:, 1], color=COLORS[controller], label=controller
            )
        axes[0].set_title(result.scenario.name)
        axes[-1].set_yscale("log")
        axes[-1].set_ylim(bottom=LEAST_ERROR)
        axes[-1].set_ylabel("tip error [mm]")
        axes[-1].set_xlabel("time [s]")
        legend_above(figure, *axes)


def _draw_pressures(axes: Axes, controller: str, trace: np.ndarray) -> None:
    time, lines, need = trace[:, 0], trace[:, 2:-1], trace[:, -1]
    axes.plot(time, 1e-6 * need, color=BLACK, linewidth=1.0, label="needed by the motion")
    axes.fill_between(
        time, 1e-6 * need, 1e-6 * lines.max(axis=1), color=SKY, alpha=0.5, label="highest line"
    )
    axes.set_ylabel(f"{controller}\nsupply [MPa]")


def _overshoot(result: ScenarioResult) -> float:
    return max(record.supply_overshoot_mpa for record in result.records)
