"""`study`: run both servo controllers over scenarios, draws, faults or the mismatch benchmark.

Scenarios are those of config/study_scenarios.yaml. Draws are plants that differ from the machine
file as config/variations.yaml says.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import tyro
from tqdm import tqdm

from mhsb_control import REGISTERED_CONTROLLERS, get_controller_class, load_machine
from mhsb_model import command_line
from mhsb_model.command_line import JobCount, NumberRange
from mhsb_model.files.output_folders import make_output_folder
from mhsb_model.machine import Machine
from mhsb_planner.kernel_parts import compile_planner
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.result_files import write_json
from mhsb_planner.work_arguments import Scheduler, parse_jobs
from mhsb_planner.workers import Jobs
from mhsb_sim.simulation.kernel_parts import compile_simulator
from mhsb_sim.simulation.plant_files import load_plant
from mhsb_tools.study.controller_comparison import COMPARED_CONTROLLERS, as_text, compare
from mhsb_tools.study.draw_limits import as_text as draws_as_text
from mhsb_tools.study.draws import GOAL_COUNT, DrawRecord, run_draws
from mhsb_tools.study.draws import as_dicts as draws_as_dicts
from mhsb_tools.study.fault_figures import draw_faults
from mhsb_tools.study.fault_study import STUDIED_FAULTS, run_faults
from mhsb_tools.study.fault_study import as_text as faults_as_text
from mhsb_tools.study.mismatch_benchmark import (
    Protocol,
    load_protocol,
    run_benchmark,
    summarize,
)
from mhsb_tools.study.mismatch_benchmark import as_markdown as benchmark_as_markdown
from mhsb_tools.study.scenarios import Scenario, load_scenarios
from mhsb_tools.study.servo_study import as_dicts, run_study
from mhsb_tools.study.study_figures import draw_study
from mhsb_tools.study.variations import load_variations

DEFAULT_DRAWS = 100
"""Number of draws when --draws is left out but --variations is given."""


def study(
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/study"),
    machine: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    scenarios: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    variations: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    draws: Annotated[int | None, tyro.conf.arg(metavar="N"), NumberRange(0, 10**6)] = None,
    seed: Annotated[int | None, NumberRange(0, 2**63 - 1)] = None,
    goals: Annotated[int | None, tyro.conf.arg(metavar="N"), NumberRange(0, 10**6)] = None,
    plant: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    controllers: Annotated[list[str] | None, tyro.conf.arg(metavar="NAME")] = None,
    jobs: JobCount = None,
    scheduler: Scheduler = None,
    faults: Annotated[list[str] | None, tyro.conf.arg(metavar="FAULT")] = None,
    benchmark: bool = False,
    json_: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Run every servo controller through every scenario and compare them.

    Writes DIR/summary.json (a list, one record for each scenario and controller: errors in mm,
    pressures in MPa, energies in J), DIR/comparison.json and figures. Equal files give equal
    numbers. With --variations or --draws the runs are draws instead: in each the arm differs from
    the machine file and is sent to some random goals, 0.4 to 5 s apart. Only DIR/summary.json is
    written, one record for each draw and controller. With --faults a part fails during a lift in
    boost; DIR/summary.json has one record for each fault, and there is a figure of each. With
    --benchmark the moves and plants come from config/mismatch_benchmark.yaml
    (docs/benchmark.md): DIR/records.json, DIR/summary.json and the table DIR/results.md.

    Args:
        output: Folder for summary, comparison and figures.
        machine: Machine file (YAML); the suite's own arm when left out.
        scenarios: Scenario file (YAML). When left out, the suite's config/study_scenarios_NAME.yaml
            if there is one for the machine's name, else its config/study_scenarios.yaml.
        variations: File (YAML) of how plants may differ; the suite's own when left out.
        draws: Number of draws; when left out 100 with --variations, the file's with --benchmark.
        seed: Seed of the draws; 0 when left out.
        goals: Number of random goals of each draw; six when left out.
        plant: Plant file (YAML) of the machine that is varied, if it is not the machine itself.
        controllers: Controllers that draws are given to; all when left out.
        jobs: Processes; as many as there are processors when left out.
        scheduler: Address of a Dask cluster that does the work instead (docs/cluster.md).
        faults: Parts that fail, as in the simulator's parameter `fault`; all kinds if none is
            named.
        benchmark: Run the mismatch benchmark.
        json_: Print DIR/summary.json instead of text; without --draws, --faults and --benchmark
            DIR/comparison.json.

    Raises:
        UsageError: `jobs` is below 1, or an option has no effect in this kind of study. The
            benchmark uses only `draws`, for example, so that it does not take `seed`.
    """
    if jobs is not None and jobs < 1:
        raise command_line.UsageError(f"--jobs: {jobs} is below 1")
    kind = _kind(benchmark, faults is not None, draws is not None or variations is not None)
    given = {
        "scenarios": scenarios,
        "variations": variations,
        "draws": draws,
        "seed": seed,
        "goals": goals,
        "plant": plant,
        "controllers": controllers,
        "faults": faults,
    }
    _check_options_have_effect(kind, [name for name, value in given.items() if value is not None])
    workers = parse_jobs(jobs, scheduler)
    arm = load_machine(machine)
    if benchmark:
        lines = study_benchmark(arm, load_protocol(arm), draws, workers, output)
        _print_result(lines, output / "summary.json", json_)
        return
    if faults is not None:
        lines = study_faults(arm, faults or STUDIED_FAULTS, workers, output)
        _print_result(lines, output / "summary.json", json_)
        return
    if kind == "draws":
        real = load_plant(arm, plant) if plant else arm
        count = DEFAULT_DRAWS if draws is None else draws
        each = GOAL_COUNT if goals is None else goals
        names = controllers or list(REGISTERED_CONTROLLERS)
        lines = study_draws(arm, real, variations, count, seed or 0, workers, output, each, names)
        _print_result(lines, output / "summary.json", json_)
        return
    lines = study_scenarios(arm, load_scenarios(scenarios, arm), workers, output)
    _print_result(lines, output / "comparison.json", json_)


def _kind(benchmark: bool, faults: bool, draws: bool) -> str:
    """Return the kind of study that the options ask for: a key of `OPTIONS_BY_KIND`.

    Benchmark comes before faults, faults before draws; `scenarios` if none is asked for.

    Args:
        benchmark: Whether the benchmark is asked for.
        faults: Whether faults are asked for.
        draws: Whether draws are asked for.
    """
    kinds = {"benchmark": benchmark, "faults": faults, "draws": draws}
    return next((name for name, asked in kinds.items() if asked), "scenarios")


OPTIONS_BY_KIND = {
    "benchmark": ("draws",),
    "faults": ("faults",),
    "draws": ("variations", "draws", "seed", "goals", "plant", "controllers"),
    "scenarios": ("scenarios",),
}
"""Options that each kind of study uses, beside those that all kinds use."""

FIXED_PROTOCOLS = {
    "benchmark": "its file is the protocol",
    "faults": "every fault comes during the same lift",
    "draws": "draws make their own goals",
    "scenarios": "scenarios are of the machine's own, and every controller gets them",
}
"""Why each kind of study does not use the other options, for error messages."""


def _check_options_have_effect(kind: str, given: Sequence[str]) -> None:
    """Raise UsageError if an option was given that this kind of study does not use.

    Args:
        kind: Kind of the study.
        given: Names of the options that were given.
    """
    idle = [f"--{name}" for name in given if name not in OPTIONS_BY_KIND[kind]]
    if not idle:
        return
    names = ", ".join(idle)
    if kind == "scenarios":
        raise command_line.UsageError(f"{names}: goes with --draws; {FIXED_PROTOCOLS[kind]}")
    raise command_line.UsageError(f"--{kind}: {FIXED_PROTOCOLS[kind]}; leave out {names}")


def _print_result(lines: Sequence[str], file: Path, as_json: bool) -> None:
    """Print a file's content as JSON, or lines of text."""
    print(file.read_text(encoding="utf-8") if as_json else "\n".join(lines))


def study_scenarios(
    arm: Machine, wanted: Sequence[Scenario], workers: Jobs, output: Path
) -> list[str]:
    """Run all scenarios and write summary.json, comparison.json and figures.

    Args:
        arm: The machine.
        wanted: The scenarios.
        workers: Number of processes or a cluster.
        output: Folder to write to; made if it does not exist.

    Returns:
        The comparison as lines of text.
    """
    make_output_folder(output, "the study")
    compile_simulator()  # so that the processes find compiled kernels
    bar = tqdm(run_study(arm, wanted, workers), total=len(wanted), unit="scenario", disable=None)
    order = {scenario.name: number for number, scenario in enumerate(wanted)}
    results = sorted(bar, key=lambda result: order[result.scenario.name])
    comparison = compare(results)
    for name, content in (("summary", as_dicts(results)), ("comparison", comparison)):
        (output / f"{name}.json").write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    draw_study(results, output)
    return as_text(results, comparison)


def study_draws(
    machine: Machine,
    plant: Machine,
    variations: Path | None,
    count: int,
    seed: int,
    jobs: Jobs,
    output: Path,
    goals: int = GOAL_COUNT,
    controllers: Sequence[str] = tuple(REGISTERED_CONTROLLERS),
) -> list[str]:
    """Run all draws and write summary.json.

    Draws that have been run are written even if an error or an interrupt ends the study.

    Args:
        machine: The machine that planner and servo know.
        plant: The machine that is varied.
        variations: File of variations; None takes the suite's own.
        count: Number of draws.
        seed: Seed of the draws.
        jobs: Number of processes or a cluster.
        output: Folder to write to; made if it does not exist.
        goals: Number of goals of each draw.
        controllers: Names of the controllers that run.

    Returns:
        Lines of text: each count and quantile of `figures_of` beside its limit, and what failed.

    Raises:
        UnknownControllerError: A controller does not exist.
        UsageError: A number is too small.
    """
    for name in controllers:
        get_controller_class(name)
    for name, value, lowest in (("draws", count, 1), ("seed", seed, 0), ("goals", goals, 1)):
        if value < lowest:
            raise command_line.UsageError(f"--{name}: {value} is below {lowest}")
    wanted = load_variations(plant, variations)
    make_output_folder(output, "the study")
    compile_planner()
    compile_simulator()  # so that the processes find compiled kernels
    load_or_build_table(machine)  # so that the processes find the table
    runs = run_draws(machine, wanted, count, seed, jobs, plant, goals, controllers)
    records: list[DrawRecord] = []
    try:
        for each in tqdm(runs, total=count, unit="draw", disable=None):
            records += each
    finally:  # draws that were run are kept after an error or interrupt
        if records:
            write_json(output / "summary.json", draws_as_dicts(records))
            done = len({record.draw for record in records})
            command_line.set_interrupt_note(f"{output}/summary.json has {done} of {count} draws")
    return draws_as_text(records)


def study_benchmark(
    machine: Machine, protocol: Protocol, draws: int | None, jobs: Jobs, output: Path
) -> list[str]:
    """Run the mismatch benchmark and write records.json, summary.json and results.md.

    Args:
        machine: The machine that planner and servo know.
        protocol: The benchmark.
        draws: Number of draws; None takes the protocol's.
        jobs: Number of processes or a cluster.
        output: Folder to write to; made if it does not exist.

    Returns:
        The table as lines of Markdown, then a line for each failure.

    Raises:
        UsageError: The number of draws is below 1.
    """
    count = protocol.file.draws if draws is None else draws
    if count < 1:
        raise command_line.UsageError(f"--draws: {count} is below 1")
    make_output_folder(output, "the study")
    compile_planner()
    compile_simulator()
    load_or_build_table(machine)
    total = len(protocol.file.sequences) + count
    runs = run_benchmark(machine, protocol, count, jobs)
    found = list(tqdm(runs, total=total, unit="run", disable=None))
    parts = {
        title: [record for each in found if each.exact is exact for record in each.records]
        for title, exact in (("exact", True), ("draws", False))
    }
    summary = {title: summarize(records, protocol.file.lost) for title, records in parts.items()}
    write_json(
        output / "records.json", {title: draws_as_dicts(part) for title, part in parts.items()}
    )
    write_json(output / "summary.json", {"version": protocol.file.version} | summary)
    lines = benchmark_as_markdown(summary)
    (output / "results.md").write_text("\n".join(lines), encoding="utf-8")
    failures = {f"{r.controller}, {r.draw}: {r.failure}" for part in parts.values() for r in part}
    return [*lines, *sorted(line for line in failures if not line.endswith(": "))]


def study_faults(machine: Machine, faults: Sequence[str], jobs: Jobs, output: Path) -> list[str]:
    """Run all faults with the coordinated controller and write summary.json and figures.

    Args:
        machine: The machine.
        faults: Faults as in the simulator's parameter `fault`.
        jobs: Number of processes or a cluster.
        output: Folder to write to; made if it does not exist.

    Returns:
        A table of the faults as lines of text.

    Raises:
        FaultError: A fault does not exist.
    """
    make_output_folder(output, "the study")
    compile_planner()
    compile_simulator()
    bar = tqdm(
        run_faults(machine, faults, COMPARED_CONTROLLERS[0], jobs),
        total=len(faults),
        unit="fault",
        disable=None,
    )
    results = list(bar)
    text = json.dumps([asdict(result.record) for result in results], indent=2)
    (output / "summary.json").write_text(f"{text}\n", encoding="utf-8")
    draw_faults(results, output)
    return faults_as_text([result.record for result in results])


def main() -> int:
    """Entry point of `ros2 run mhsb_tools study`."""
    return command_line.run(study, name="study")


if __name__ == "__main__":
    sys.exit(main())
