"""`reproduce`: all cases and sweeps of the paper, published beside own values, and the figures."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.command_line import JobCount
from mhsb_model.files.output_folders import make_output_folder
from mhsb_model.machine import load_machine
from mhsb_planner.errors import RequestError
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
    HEURISTIC_SCALES,
    SUPPLY_PRESSURES,
    Runs,
    area_settings,
    evaluate,
    integrated_settings,
    pressure_run,
    published_settings,
    settings,
    work_units,
)
from mhsb_planner.evaluation.reproduction.weight_figure import draw_weights
from mhsb_planner.result_files import write_json, write_rows
from mhsb_planner.work_arguments import Scheduler, jobs_of

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

JOINTS = 3
"""Of the arm that the paper speaks of, joint by joint."""

OPERATING_POINT = "operating_point"


def reproduce(
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/reproduce"),
    machine: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    jobs: Annotated[JobCount, tyro.conf.arg(metavar="N")] = None,
    scheduler: Scheduler = None,
    json_: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Run all cases and sweeps of the paper and judge what they show.

    By the paper's own search, and beside it by the exact one. The integrated planner's runs of the
    same cases are told beside them, Case 4 with a weight on the polytope's area, and the supply
    pressure and V_max that serve Case 5 best.

    Writes table.csv (every run), summary.json (every expectation: what the paper says, own and met
    by the published search, and by the exact one; how many are met with other scales of the
    published heuristic; the best operating points) and the figures as PNG with their data as CSV.
    Energies are in J, lengths in m, times in s.

    Args:
        output: Folder to write to.
        machine: Machine file (YAML) of three joints; the suite's own arm when left out.
        jobs: Number of threads; one for each processor when left out.
        scheduler: Address of a Dask cluster that does it instead (docs/cluster.md).
        json_: Print summary.json instead of text.
    """
    arm = load_machine(machine)
    if arm.joint_count != JOINTS:
        raise RequestError("the machine", arm.name, f"must have {JOINTS} joints, as the paper's")
    workers = jobs_of(jobs, scheduler)
    make_output_folder(output, "what is reproduced")
    command_line.keep(f"{output} has the figures that were ready, and no new table and summary")
    asked = settings() | integrated_settings() | area_settings()
    for scale in HEURISTIC_SCALES:
        asked |= published_settings(scale=scale)
    total = work_units(arm, asked) + len(FITTED) + len(FIGURES) + 1
    with tqdm(total=total, unit="step", desc="reproduce") as bar:
        runs = evaluate(arm, asked, workers, bar.update)
        fits = fit_runs(runs, [name for name in FITTED if name in runs.runs])
        bar.update(len(FITTED))
        for name, draw in FIGURES.items():
            draw(runs, fits, output, name)
            bar.update()
        points = operating_points.find_points(runs)
        operating_points.draw_points(runs, fits, points, output, OPERATING_POINT)
        bar.update()
    found = Judged.of(runs)
    write_rows(output / "table.csv", COLUMNS, _table_rows(runs, fits))
    write_json(output / "summary.json", _summary(runs, fits, found, points))
    if json_:
        print((output / "summary.json").read_text(encoding="utf-8"))
        return
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


@dataclass(frozen=True)
class Judged:
    """The same expectations, judged by the published and by the exact search.

    published, exact  records, in the same order
    by_scale          expectations met by the published search, by its heuristic's scale [1/m]
    """

    published: list[Record]
    exact: list[Record]
    by_scale: dict[float, int]

    @classmethod
    def of(cls, runs: Runs) -> Judged:
        """Of runs that hold `settings` and `published_settings` of all scales."""
        by_scale = {
            scale: met(records(runs.by_published_search(scale))) for scale in HEURISTIC_SCALES
        }
        return cls(records(runs.by_published_search()), records(runs), by_scale)


def met(found: list[Record]) -> int:
    """How many expectations are met."""
    return sum(record.met for record in found)


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
    runs: Runs, fits: Fits, found: Judged, points: Mapping[str, Found]
) -> dict[str, Any]:
    published = runs.by_published_search()

    def told(record: Record, exact: Record) -> dict[str, Any]:
        own = {name: numbers(published, name) for name in record.own}
        by_exact = {name: _own(runs, fits, name) for name in exact.own}
        return asdict(record) | {"own": own, "exact": asdict(exact) | {"own": by_exact}}

    return {
        "machine": runs.machine.name,
        "machine_hash": runs.machine.hash,
        "met": met(found.published),
        "met_exact": met(found.exact),
        "met_by_heuristic_scale": {f"{scale:g}": count for scale, count in found.by_scale.items()},
        "expectations": list(map(told, found.published, found.exact)),
        "operating_points": operating_points.as_summary(points),
    }


def as_text(found: Judged) -> list[str]:
    """What the paper says and what both searches show, and how many expectations are met."""
    lines = ["expectation   search     met   what the paper says, and own"]
    for published, exact in zip(found.published, found.exact, strict=True):
        lines.append(f"{published.id:13s} {'':16s} {published.published}")
        for search, record in (("published", published), ("exact", exact)):
            lines.append(
                f"{'':13s} {search:10s} {'yes' if record.met else 'no':5s} {record.sentence}"
            )
    count = len(found.exact)
    by_scale = ", ".join(f"{each} at {scale:g}" for scale, each in found.by_scale.items())
    return [
        *lines,
        f"{met(found.published)} of {count} expectations are met by the published search, "
        f"{met(found.exact)} by the exact one; with other scales of the published heuristic [1/m]: "
        f"{by_scale}",
    ]


def main() -> int:
    """Entry point of `ros2 run mhsb_planner reproduce`."""
    return command_line.run(reproduce, name="reproduce")


if __name__ == "__main__":
    sys.exit(main())
