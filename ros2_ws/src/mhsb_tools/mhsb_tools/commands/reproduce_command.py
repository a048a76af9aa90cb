"""`reproduce`: run all cases and sweeps of the paper, and compare with the published values."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import tyro
from tqdm import tqdm

from mhsb_control import load_machine
from mhsb_model import command_line
from mhsb_model.command_line import JsonFlag, OptionalFile
from mhsb_model.files.output_folders import make_output_folder
from mhsb_planner.cluster import WorkArguments
from mhsb_planner.errors import RequestError
from mhsb_planner.result_files import write_json, write_rows
from mhsb_planner.search.s2_published import DEFAULT_HEURISTIC_SCALE
from mhsb_tools.reproduction import operating_points
from mhsb_tools.reproduction.expectations import (
    ExpectationResult,
    collect_path_values,
    judge_expectations,
)
from mhsb_tools.reproduction.fits import FittedRuns, fit_runs
from mhsb_tools.reproduction.joint_figures import draw_joints
from mhsb_tools.reproduction.operating_points import BestPoint
from mhsb_tools.reproduction.path_figures import draw_paths
from mhsb_tools.reproduction.polytope_figures import (
    draw_polytopes_along,
    draw_velocity_polytope,
)
from mhsb_tools.reproduction.runs import (
    HEURISTIC_SCALES,
    SUPPLY_PRESSURES,
    Runs,
    area_settings,
    count_work_units,
    evaluate,
    integrated_settings,
    pressure_run,
    published_settings,
    settings,
)
from mhsb_tools.reproduction.weight_figures import draw_area_tradeoff, draw_weights

FITTED_RUNS = (
    *("1-1", "1-2", "2-1", "2-2", "3-1", "3-2", "4-1", "4-2", "4-3"),
    *(pressure_run(supply) for supply in SUPPLY_PRESSURES),
    *(pressure_run(supply, keep_table=True) for supply in SUPPLY_PRESSURES),
    *integrated_settings(),
    *area_settings(),
)
"""Names of the runs for which a trajectory is made as well."""

PAPER_FIGURES: dict[str, Callable[[Runs, FittedRuns, Path], None]] = {
    "figure_3": lambda runs, _, place: draw_velocity_polytope(runs, place),
    "figure_5": lambda runs, fits, place: draw_paths(runs, fits, ("1-1", "1-2"), place),
    "figure_6": lambda runs, fits, place: draw_joints(
        runs, fits, ("1-1", "1-2"), place, load_lines=True
    ),
    "figure_7": lambda runs, fits, place: draw_paths(
        runs, fits, ("2-1", "2-2", "3-1", "3-2"), place
    ),
    "figure_8": lambda runs, fits, place: draw_joints(
        runs, fits, ("2-2", "3-2"), place, load_lines=False
    ),
    "figure_9": lambda runs, _, place: draw_polytopes_along(runs, place),
    "figure_10": lambda runs, _, place: draw_weights(runs, place),
    "area_energy": draw_area_tradeoff,
}
"""Functions that draw the paper's figures, and area against energy, by file name without suffix."""

PAPER_JOINT_COUNT = 3
"""Number of joints of the paper's arm. The paper's statements are checked only for such arms."""

OPERATING_POINT = "operating_point"


def reproduce(
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/reproduce"),
    machine: OptionalFile = None,
    *,
    work: WorkArguments,
    json_: JsonFlag = False,
) -> None:
    """Run all cases and sweeps of the paper and judge what they show.

    All runs use the paper's own search and the exact one. The integrated planner plans the same
    cases, and Case 4 with a weight on the polytope's area. The supply pressure and V_max that serve
    Case 5 best are looked for, too.

    Writes table.csv (every run), summary.json and the figures as PNG with their data as CSV. The
    summary has every expectation: what the paper says, and what the published and the exact search
    give. It also says how many expectations are met if the published heuristic is multiplied by
    other factors, and has the best operating points. Energies are in J, lengths in m, times in s.
    After Ctrl-C, only the figures that were ready exist. At the end, the summary is printed.

    Args:
        output: Folder to write to.
        machine: Machine file (YAML) of three joints; the suite's own arm when left out.
        work: Number of processes, or the Dask cluster, that computes.
        json_: Print summary.json instead of text.

    Raises:
        RequestError: The machine has another number of joints than the paper's arm.
        MhsbError: The machine file is invalid, the folder or a file cannot be written, or a run
            failed.
    """
    arm = load_machine(machine)
    if arm.joint_count != PAPER_JOINT_COUNT:
        raise RequestError(
            "the machine", arm.name, f"must have {PAPER_JOINT_COUNT} joints, as the paper's"
        )
    workers = work.connect()
    make_output_folder(output, "what is reproduced")
    command_line.set_interrupt_note(
        f"{output} has the figures that were ready, and no new table and summary"
    )
    asked = settings() | integrated_settings() | area_settings()
    for scale in HEURISTIC_SCALES:
        asked |= published_settings(scale=scale)
    total = count_work_units(asked) + len(FITTED_RUNS) + len(PAPER_FIGURES) + 1
    with tqdm(total=total, unit="step", desc="reproduce") as bar:
        runs = evaluate(arm, asked, workers, bar.update)
        fits = fit_runs(runs, [name for name in FITTED_RUNS if name in runs.runs])
        bar.update(len(FITTED_RUNS))
        for name, draw in PAPER_FIGURES.items():
            draw(runs, fits, output / name)
            bar.update()
        points = operating_points.find_points(runs)
        operating_points.draw_points(fits, points, output / OPERATING_POINT)
        bar.update()
    exact = judge_expectations(runs)
    by_scale = {
        scale: judge_expectations(runs.by_published_search(scale)) for scale in HEURISTIC_SCALES
    }
    write_rows(output / "table.csv", TABLE_COLUMNS, _table_rows(runs, fits))
    write_json(output / "summary.json", _summary(runs, fits, exact, by_scale, points))
    if json_:
        print((output / "summary.json").read_text(encoding="utf-8"), end="")
        return
    print("\n".join([*as_text(exact, by_scale), *operating_points.as_text(points)]))
    print(f"written to {output}")


TABLE_COLUMNS = (
    "run",
    *("energy_discrete_j", "energy_series_discrete_j", "duration_discrete_s", "length_m"),
    "lower_bound_j",
    *("length_over_shortest", "normal_share", "switches"),
    *("energy_fitted_j", "energy_series_fitted_j", "duration_fitted_s"),
    "failure",
)
"""Columns of table.csv, in order."""


Judgements = dict[float, list[ExpectationResult]]
"""Judgements of all expectations by the published search, by the scale of its heuristic [1/m]."""


def count_met(found: list[ExpectationResult]) -> int:
    """Return the number of expectations that are met."""
    return sum(record.met for record in found)


def _run_values(runs: Runs, fits: FittedRuns, name: str) -> dict[str, float]:
    """Collect energies, durations and other numbers of one run for tables.

    Args:
        runs: All runs.
        fits: Trajectories that were made for some of the runs.
        name: Name of the run.

    Returns:
        Values of the run's discrete path, by column name of table.csv. If the run has a trajectory,
        also `energy_fitted_j`, `energy_series_fitted_j` and `duration_fitted_s`. Empty if the run
        found no path.
    """
    own = collect_path_values(runs, name)
    if name in fits.by_run:
        fit = fits.by_run[name]
        own |= {
            "energy_fitted_j": fit.energy.paper,
            "energy_series_fitted_j": fit.energy.series,
            "duration_fitted_s": fit.duration,
        }
    return own


def _table_rows(runs: Runs, fits: FittedRuns) -> Iterator[list[Any]]:
    """Yield the rows of table.csv.

    Args:
        runs: All runs; each gives one row.
        fits: Trajectories that were made for some of the runs.

    Yields:
        A row for each run, with values in the order of `TABLE_COLUMNS`. An empty string stands for
        a value that the run does not have.
    """
    for name, run in runs.runs.items():
        row = {"run": name, **_run_values(runs, fits, name)}
        row["failure"] = run.failure or fits.failures.get(name, "")
        yield [row.get(column, "") for column in TABLE_COLUMNS]


def _summary(
    runs: Runs,
    fits: FittedRuns,
    exact: list[ExpectationResult],
    by_scale: Judgements,
    points: Mapping[str, BestPoint],
) -> dict[str, Any]:
    """Collect the content of summary.json.

    Args:
        runs: All runs.
        fits: Trajectories that were made for some of the runs.
        exact: Judgement of all expectations (statements of the paper) by the exact search.
        by_scale: Their judgements by the published search.
        points: Best supply pressure, and best V_max (piston speed for planning), for Case 5, by
            name.

    Returns:
        A dictionary. Keys:

        - machine: its name; machine_hash: hash of all values on which its posture table depends
        - met, met_exact: number of expectations that the published search and the exact search meet
        - met_by_heuristic_scale: number that the published search meets, by scale of its heuristic
          [1/m] as text
        - expectations: a list, each entry made by `expectation_entry`
        - operating_points: by name, with case, number of examined points `looked_at`, and the
          fields of `OperatingPointResult`
    """
    published, judged = runs.by_published_search(), by_scale[DEFAULT_HEURISTIC_SCALE]

    def expectation_entry(record: ExpectationResult, exact: ExpectationResult) -> dict[str, Any]:
        """Combine the two judgements of one expectation to a dictionary for JSON.

        Uses `published`, `runs` and `fits` of the enclosing function.

        Args:
            record: Judgement by the published search.
            exact: Judgement of the same expectation by the exact search.

        Returns:
            All fields of `record`. The key `own` has the values of the runs that were judged, by
            name of the run. The key `exact` has the same fields for the exact search.
        """
        own = {name: collect_path_values(published, name) for name in record.own}
        by_exact = {name: _run_values(runs, fits, name) for name in exact.own}
        return asdict(record) | {"own": own, "exact": asdict(exact) | {"own": by_exact}}

    return {
        "machine": runs.machine.name,
        "machine_hash": runs.machine.table_hash,
        "met": count_met(judged),
        "met_exact": count_met(exact),
        "met_by_heuristic_scale": {
            f"{scale:g}": count_met(each) for scale, each in by_scale.items()
        },
        "expectations": list(map(expectation_entry, judged, exact)),
        "operating_points": {
            name: {
                "case": each.case,
                "looked_at": len(each.point.curve),
                **asdict(each.point.best),
            }
            for name, each in points.items()
        },
    }


def as_text(exact: list[ExpectationResult], by_scale: Judgements) -> list[str]:
    """Format the judgement of all expectations (statements of the paper) as text.

    Args:
        exact: Judgement of all expectations by the exact search.
        by_scale: Their judgements by the published search.

    Returns:
        Lines without line breaks: column titles, three lines for each expectation, and a last line.
        The three lines have the paper's statement, the result of the published search, and the
        result of the exact search. A result says yes if the expectation is met, else no. The last
        line counts the expectations that each search meets, and the published one also with other
        scales of its heuristic.
    """
    lines = ["expectation   search     met   what the paper says, and own"]
    judged = by_scale[DEFAULT_HEURISTIC_SCALE]
    for published, exactly in zip(judged, exact, strict=True):
        lines.append(f"{published.id:13s} {'':16s} {published.published}")
        for search, record in (("published", published), ("exact", exactly)):
            lines.append(
                f"{'':13s} {search:10s} {'yes' if record.met else 'no':5s} {record.sentence}"
            )
    counts = ", ".join(f"{count_met(each)} at {scale:g}" for scale, each in by_scale.items())
    return [
        *lines,
        f"{count_met(judged)} of {len(exact)} expectations are met by the published search, "
        f"{count_met(exact)} by the exact one; with other scales of the published "
        f"heuristic [1/m]: {counts}",
    ]


main = command_line.make_main(reproduce)
