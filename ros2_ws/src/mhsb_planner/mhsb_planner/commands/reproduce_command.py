"""`reproduce`: all cases and sweeps of the paper, published beside own values, and the figures."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import tyro
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.machine import load_machine
from mhsb_planner.evaluation.reproduction import operating_points
from mhsb_planner.evaluation.reproduction.area_figure import draw_area_tradeoff
from mhsb_planner.evaluation.reproduction.expectations import Record, numbers, records
from mhsb_planner.evaluation.reproduction.fits import Fits, fit_runs
from mhsb_planner.evaluation.reproduction.joint_figures import draw_joints
from mhsb_planner.evaluation.reproduction.operating_points import Found
from mhsb_planner.evaluation.reproduction.path_figures import draw_paths
from mhsb_planner.evaluation.reproduction.polytope_figures import (
    draw_polytopes_along,
    draw_velocity_polytope,
)
from mhsb_planner.evaluation.reproduction.runs import (
    SUPPLY_PRESSURES,
    Runs,
    area_settings,
    evaluate,
    integrated_settings,
    pressure_run,
    settings,
    work_units,
)
from mhsb_planner.evaluation.reproduction.weight_figure import draw_weights
from mhsb_planner.result_files import write_json, write_rows

FITTED = (
    *("1-1", "1-2", "2-1", "2-2", "3-1", "3-2", "4-1", "4-2", "4-3"),
    *(pressure_run(supply) for supply in SUPPLY_PRESSURES),
    *(pressure_run(supply, keep_table=True) for supply in SUPPLY_PRESSURES),
    *integrated_settings(),
    *area_settings(),
)
"""Runs whose trajectory is made as well."""

Figure = Callable[[Runs, Fits, Path, str], list[Path]]
FIGURES: dict[str, Figure] = {
    "figure_3": lambda runs, fits, *place: draw_velocity_polytope(runs, *place),
    "figure_5": lambda runs, fits, *place: draw_paths(runs, fits, ("1-1", "1-2"), *place),
    "figure_6": lambda runs, fits, *place: draw_joints(
        runs, fits, ("1-1", "1-2"), *place, load_lines=True
    ),
    "figure_7": lambda runs, fits, *place: draw_paths(
        runs, fits, ("2-1", "2-2", "3-1", "3-2"), *place
    ),
    "figure_8": lambda runs, fits, *place: draw_joints(
        runs, fits, ("2-2", "3-2"), *place, load_lines=False
    ),
    "figure_9": lambda runs, fits, *place: draw_polytopes_along(runs, *place),
    "figure_10": lambda runs, fits, *place: draw_weights(runs, *place),
    "area_energy": draw_area_tradeoff,
}
"""The figures of the paper, and the area against energy, by the name of their files."""

OPERATING_POINT = "operating_point"


def reproduce(
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/reproduce"),
    machine: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    jobs: Annotated[int | None, tyro.conf.arg(metavar="N")] = None,
) -> None:
    """Run all cases and sweeps of the paper and judge what they show.

    The integrated planner's runs of the same cases are told beside them, Case 4 with a weight on
    the polytope's area, and the supply pressure and V_max that serve Case 5 best.

    Writes table.csv (every run), summary.json (every expectation: published, own, met; the best
    operating points) and the figures as PNG with their data as CSV. Energies are in J, lengths in
    m, times in s.

    Args:
        output: Folder to write to.
        machine: Machine file (YAML); the suite's own arm when left out.
        jobs: Number of threads; one for each processor when left out.
    """
    arm = load_machine(machine)
    output.mkdir(parents=True, exist_ok=True)
    asked = settings() | integrated_settings() | area_settings()
    total = work_units(arm, asked) + len(FITTED) + len(FIGURES) + 1
    with tqdm(total=total, unit="step", desc="reproduce") as bar:
        runs = evaluate(arm, asked, jobs, bar.update)
        fits = fit_runs(runs, [name for name in FITTED if name in runs.runs])
        bar.update(len(FITTED))
        for name, draw in FIGURES.items():
            draw(runs, fits, output, name)
            bar.update()
        points = operating_points.find_points(runs)
        operating_points.draw_points(runs, fits, points, output, OPERATING_POINT)
        bar.update()
    found = records(runs)
    write_rows(output / "table.csv", COLUMNS, _table_rows(runs, fits))
    write_json(output / "summary.json", _summary(runs, fits, found, points))
    print("\n".join([*as_text(found), *operating_points.as_text(points)]))
    print(f"written to {output}")


COLUMNS = (
    "run",
    *("energy_discrete_j", "energy_series_discrete_j", "duration_discrete_s", "length_m"),
    "lower_bound_j",
    *("length_over_shortest", "normal_share", "switches"),
    *("energy_fitted_j", "energy_series_fitted_j", "duration_fitted_s"),
    "failure",
)


def _own(runs: Runs, fits: Fits, name: str) -> dict[str, float]:
    """All numbers of a run."""
    own = numbers(runs, name)
    if name in fits.of:
        fit = fits.of[name]
        own |= {
            "energy_fitted_j": fit.energy.paper,
            "energy_series_fitted_j": fit.energy.series,
            "duration_fitted_s": fit.duration,
        }
    return own


def _table_rows(runs: Runs, fits: Fits) -> Iterator[list[Any]]:
    for name, run in runs.runs.items():
        row = {"run": name, **_own(runs, fits, name)}
        row["failure"] = run.failure or fits.failures.get(name, "")
        yield [row.get(column, "") for column in COLUMNS]


def _summary(
    runs: Runs, fits: Fits, found: list[Record], points: Mapping[str, Found]
) -> dict[str, Any]:
    return {
        "machine": runs.machine.name,
        "machine_hash": runs.machine.hash,
        "met": sum(record.met for record in found),
        "expectations": [
            asdict(record) | {"own": {name: _own(runs, fits, name) for name in record.own}}
            for record in found
        ],
        "operating_points": operating_points.as_summary(points),
    }


def as_text(found: list[Record]) -> list[str]:
    """A line for each expectation, and how many are met."""
    lines = ["expectation   met   published and own"]
    for record in found:
        met = "yes" if record.met else "no"
        lines.append(f"{record.id:13s} {met:5s} {record.published}")
        lines.append(f"{'':19s} {record.sentence}")
    lines.append(f"{sum(record.met for record in found)} of {len(found)} expectations are met")
    return lines


def main() -> int:
    """Entry point of `ros2 run mhsb_planner reproduce`."""
    return command_line.run(reproduce, name="reproduce")


if __name__ == "__main__":
    sys.exit(main())
