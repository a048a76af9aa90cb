"""Case 5 beyond the paper: the best supply pressure and V_max, found instead of swept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mhsb_model.figure_style import BLACK, BLUE, ORANGE, legend_above, written_figure
from mhsb_model.trajectory import MotionState
from mhsb_planner.evaluation.operating_point import (
    OperatingPoint,
    Range,
    Sample,
    best_operating_point,
)
from mhsb_planner.evaluation.paper_cases import paper_case
from mhsb_planner.evaluation.reproduction.expectations import PUBLISHED_ENERGY
from mhsb_planner.evaluation.reproduction.fits import Fits
from mhsb_planner.evaluation.reproduction.runs import (
    PISTON_SPEEDS,
    SUPPLY_PRESSURES,
    Runs,
    pressure_run,
)
from mhsb_planner.planner import Planner
from mhsb_planner.result_files import write_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PLANNERS = ("table", "integrated")
COLOR = {"table": ORANGE, "integrated": BLUE}
MEGA, MILLI = 1e6, 1e-3


@dataclass(frozen=True, eq=False)
class Found:
    """The best point of a case's move for one of the planners; `varied` names what was chosen."""

    case: str
    varied: str
    planner: str
    point: OperatingPoint


def find_points(runs: Runs) -> dict[str, Found]:
    """P_S in the conditions of Case 1-1 and V_max in those of Case 1-2, over the paper's ranges."""
    found = {}
    for case_name, varied, pressures, speeds in (
        ("1-1", "ps", Range(SUPPLY_PRESSURES[0], SUPPLY_PRESSURES[-1]), None),
        ("1-2", "vmax", None, Range(PISTON_SPEEDS[0], PISTON_SPEEDS[-1])),
    ):
        case = paper_case(case_name)
        start = MotionState.at_rest(case.start_posture(runs.machine))
        for kind in PLANNERS:
            planner = Planner(runs.machine, runs.table)
            options = replace(case.options, planner=kind)
            point = best_operating_point(planner, case.goal, start, options, pressures, speeds)
            found[f"c5.{varied} best {kind}"] = Found(case_name, varied, kind, point)
    return found


def as_summary(points: Mapping[str, Found]) -> dict[str, Any]:
    """The best points and how many were looked at, in plain types."""
    return {
        name: {"case": found.case, "looked_at": len(found.point.curve), **asdict(found.point.best)}
        for name, found in points.items()
    }


def as_text(points: Mapping[str, Found]) -> list[str]:
    """A line for each best point."""
    return [
        f"{name}: {found.point.best.supply_pressure / MEGA:.3f} MPa, "
        f"{found.point.best.v_max / MILLI:.2f} mm/s: {found.point.best.energy:.0f} J, "
        f"{found.point.best.duration:.2f} s, {found.point.best.switches} switches"
        for name, found in points.items()
    ]


def draw_points(
    runs: Runs, fits: Fits, points: Mapping[str, Found], folder: Path, figure_name: str
) -> list[Path]:
    """Energy over P_S and cost over V_max, `figure_name`.png, and all samples as CSV."""
    picture = folder / f"{figure_name}.png"
    with written_figure(picture, 4.6) as figure:
        pressure, speed = figure.subplots(1, 2)
        for found in points.values():
            _draw_curve(found, pressure if found.varied == "ps" else speed)
        _draw_published(fits, pressure)
        pressure.set_xlabel("supply pressure [MPa]")
        pressure.set_ylabel("energy of the motion [J]")
        pressure.set_title("Case 1-1")
        speed.set_xlabel("V_max [mm/s]")
        speed.set_ylabel("15 T + 2 switches of the motion [-]")
        speed.set_title("Case 1-2")
        legend_above(figure, pressure, speed)
    header = (
        *("run", "supply_pressure_pa", "v_max_m_s", "energy_j", "energy_series_j", "duration_s"),
        *("switches", "cost", "failure"),
    )
    rows = [
        (name, *asdict(sample).values())
        for name, found in points.items()
        for sample in found.point.curve
    ]
    return [picture, write_rows(folder / f"{figure_name}.csv", header, rows)]


def _draw_curve(found: Found, axes: Axes) -> None:
    def at(sample: Sample) -> tuple[float, float]:
        if found.varied == "ps":
            return sample.supply_pressure / MEGA, sample.energy
        return sample.v_max / MILLI, sample.cost

    color = COLOR[found.planner]
    planned = [at(sample) for sample in found.point.curve if not sample.failure]
    axes.plot(*zip(*planned, strict=True), color=color, marker=".", label=found.planner)
    axes.plot(*at(found.point.best), color=color, marker="*", markersize=14, linestyle="")


def _draw_published(fits: Fits, axes: Axes) -> None:
    """The paper's sweep, and the own motions of the same runs, their tables built anew."""
    joules = dict(PUBLISHED_ENERGY.values())
    published = [(pressure / MEGA, joules[pressure_run(pressure)]) for pressure in SUPPLY_PRESSURES]
    axes.scatter(*zip(*published, strict=True), color=BLACK, marker="x", label="published")
    own = [
        (pressure / MEGA, fits.of[pressure_run(pressure)].energy.paper)
        for pressure in SUPPLY_PRESSURES
        if pressure_run(pressure) in fits.of
    ]
    if own:
        label = "table built for that pressure"
        axes.scatter(*zip(*own, strict=True), color=ORANGE, facecolor="none", label=label)
