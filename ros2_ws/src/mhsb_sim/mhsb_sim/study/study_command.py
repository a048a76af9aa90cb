"""`study`: both servo controllers over all scenarios of config/study_scenarios.yaml, or over draws
of plants that are not as the machine file says, config/variations.yaml, also as a benchmark."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import tyro
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.command_line import JobCount, Within
from mhsb_model.files.output_folders import make_output_folder
from mhsb_model.machine import Machine, load_machine
from mhsb_planner.kernel_parts import compile_planner
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_planner.result_files import write_json
from mhsb_planner.work_arguments import Scheduler, jobs_of
from mhsb_planner.workers import Jobs
from mhsb_sim.servo import CONTROLLERS, controller_class
from mhsb_sim.simulation.kernel_parts import compile_simulator
from mhsb_sim.simulation.plant_files import load_plant
from mhsb_sim.study.controller_comparison import SIDES, as_text, compare
from mhsb_sim.study.draw_limits import as_text as draws_as_text
from mhsb_sim.study.draws import GOALS, DrawRecord, run_draws
from mhsb_sim.study.draws import as_dicts as draws_as_dicts
from mhsb_sim.study.fault_figures import draw_faults
from mhsb_sim.study.fault_study import FAULTS, run_faults
from mhsb_sim.study.fault_study import as_text as faults_as_text
from mhsb_sim.study.mismatch_benchmark import (
    Protocol,
    load_protocol,
    run_benchmark,
    summarize,
)
from mhsb_sim.study.mismatch_benchmark import as_markdown as benchmark_as_markdown
from mhsb_sim.study.scenarios import Scenario, load_scenarios
from mhsb_sim.study.servo_study import as_dicts, run_study
from mhsb_sim.study.study_figures import draw_study
from mhsb_sim.study.variations import load_variations

DRAWS = 100


def study(
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/study"),
    machine: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    scenarios: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    variations: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    draws: Annotated[int | None, tyro.conf.arg(metavar="N"), Within(0, 10**6)] = None,
    seed: Annotated[int | None, Within(0, 2**63 - 1)] = None,
    goals: Annotated[int | None, tyro.conf.arg(metavar="N"), Within(0, 10**6)] = None,
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
    pressures in MPa, energies in J), DIR/comparison.json and figures. Same files, same numbers.
    With --variations or --draws the runs are draws instead: in each the arm is not as the machine
    file says, and goes after some random goals, 0.4 to 5 s apart; DIR/summary.json alone is
    written, one record for each draw and controller. With --faults something fails during a lift
    in boost; DIR/summary.json has one record for each fault, and there is a figure of each. With
    --benchmark the moves and plants are those of config/mismatch_benchmark.yaml
    (docs/benchmark.md): DIR/records.json, DIR/summary.json and the table DIR/results.md.

    Args:
        output: Folder for summary, comparison and figures.
        machine: Machine file (YAML); the suite's own arm when left out.
        scenarios: Scenario file (YAML); when left out the suite's own, for its machine files
            config/study_scenarios_NAME.yaml where there is one for the machine's name.
        variations: File (YAML) of what plants may be like; the suite's own when left out.
        draws: Number of draws; when left out 100 with --variations, the file's with --benchmark.
        seed: Of the draws; 0 when left out.
        goals: Random goals of each draw; six when left out.
        plant: Plant file (YAML) of what is varied, where that is not the machine itself.
        controllers: Those that draws are given to; all when left out.
        jobs: Processes; as many as there are processors when left out.
        scheduler: Address of a Dask cluster that does it instead (docs/cluster.md).
        faults: What fails, as in the simulator's parameter `fault`; without any, all kinds.
        benchmark: Run the mismatch benchmark.
        json_: Print DIR/summary.json, without --draws, --faults and --benchmark
            DIR/comparison.json, instead of text.
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
    _refuse_idle(kind, [name for name, value in given.items() if value is not None])
    workers = jobs_of(jobs, scheduler)
    arm = load_machine(machine)
    if benchmark:
        lines = study_benchmark(arm, load_protocol(arm), draws, workers, output)
        _tell(lines, output / "summary.json", json_)
        return
    if faults is not None:
        lines = study_faults(arm, faults or FAULTS, workers, output)
        _tell(lines, output / "summary.json", json_)
        return
    if kind == "draws":
        real = load_plant(arm, plant) if plant else arm
        count = DRAWS if draws is None else draws
        each = GOALS if goals is None else goals
        names = controllers or list(CONTROLLERS)
        lines = study_draws(arm, real, variations, count, seed or 0, workers, output, each, names)
        _tell(lines, output / "summary.json", json_)
        return
    lines = study_scenarios(arm, load_scenarios(scenarios, arm), workers, output)
    _tell(lines, output / "comparison.json", json_)


def _kind(benchmark: bool, faults: bool, draws: bool) -> str:
    """Which of the studies is asked for: that of an option, or that of scenarios."""
    kinds = {"benchmark": benchmark, "faults": faults, "draws": draws}
    return next((name for name, asked in kinds.items() if asked), "scenarios")


USED = {
    "benchmark": ("draws",),
    "faults": ("faults",),
    "draws": ("variations", "draws", "seed", "goals", "plant", "controllers"),
    "scenarios": ("scenarios",),
}
"""Options that each kind of study looks at, beside those that all do."""

OWN = {
    "benchmark": "its file is the protocol",
    "faults": "every fault comes during the same lift",
    "draws": "draws make their own goals",
    "scenarios": "scenarios are of the machine's own, and every controller gets them",
}


def _refuse_idle(kind: str, given: Sequence[str]) -> None:
    """Raise UsageError where an option was given that this kind of study does not look at."""
    idle = [f"--{name}" for name in given if name not in USED[kind]]
    if not idle:
        return
    names = ", ".join(idle)
    if kind == "scenarios":
        raise command_line.UsageError(f"{names}: goes with --draws; {OWN[kind]}")
    raise command_line.UsageError(f"--{kind}: {OWN[kind]}; leave out {names}")


def _tell(lines: Sequence[str], file: Path, as_json: bool) -> None:
    print(file.read_text(encoding="utf-8") if as_json else "\n".join(lines))


def study_scenarios(
    arm: Machine, wanted: Sequence[Scenario], workers: Jobs, output: Path
) -> list[str]:
    """Run all scenarios; writes summary.json, comparison.json and figures in the folder `output`;
    their table."""
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
    goals: int = GOALS,
    controllers: Sequence[str] = tuple(CONTROLLERS),
) -> list[str]:
    """Run all draws; writes summary.json in the folder `output`; figures and their limits.

    plant: what is varied while servo and planner know `machine`. goals: of each draw. Raises
    UnknownControllerError.
    """
    for name in controllers:
        controller_class(name)
    for name, value, lowest in (("draws", count, 1), ("seed", seed, 0), ("goals", goals, 1)):
        if value < lowest:
            raise command_line.UsageError(f"--{name}: {value} is below {lowest}")
    wanted = load_variations(plant, variations)
    make_output_folder(output, "the study")
    compile_planner()
    compile_simulator()  # so that the processes find compiled kernels
    table_for(machine)  # likewise
    runs = run_draws(machine, wanted, count, seed, jobs, plant, goals, controllers)
    records: list[DrawRecord] = []
    try:
        for each in tqdm(runs, total=count, unit="draw", disable=None):
            records += each
    finally:  # what has been run is kept, whatever ends it
        if records:
            write_json(output / "summary.json", draws_as_dicts(records))
            done = len({record.draw for record in records})
            command_line.keep(f"{output}/summary.json has {done} of {count} draws")
    return draws_as_text(records)


def study_benchmark(
    machine: Machine, protocol: Protocol, draws: int | None, jobs: Jobs, output: Path
) -> list[str]:
    """Run the mismatch benchmark; writes all records, their summary and a table; the table, and
    failures."""
    count = protocol.file.draws if draws is None else draws
    if count < 1:
        raise command_line.UsageError(f"--draws: {count} is below 1")
    make_output_folder(output, "the study")
    compile_planner()
    compile_simulator()
    table_for(machine)
    total = len(protocol.file.sequences) + count
    runs = run_benchmark(machine, protocol, count, jobs)
    found = list(tqdm(runs, total=total, unit="run", disable=None))
    parts = {
        title: [record for each in found if each.exact is exact for record in each.records]
        for title, exact in (("exact", True), ("draws", False))
    }
    summary = {
        title: summarize(records, protocol.file.lost) for title, records in parts.items()
    }
    write_json(
        output / "records.json", {title: draws_as_dicts(part) for title, part in parts.items()}
    )
    write_json(output / "summary.json", {"version": protocol.file.version} | summary)
    lines = benchmark_as_markdown(summary)
    (output / "results.md").write_text("\n".join(lines), encoding="utf-8")
    failures = {f"{r.controller}, {r.draw}: {r.failure}" for part in parts.values() for r in part}
    return [*lines, *sorted(line for line in failures if not line.endswith(": "))]


def study_faults(
    machine: Machine, faults: Sequence[str], jobs: Jobs, output: Path
) -> list[str]:
    """Run all faults; writes summary.json and figures in the folder `output`; their table."""
    make_output_folder(output, "the study")
    compile_planner()
    compile_simulator()
    bar = tqdm(
        run_faults(machine, faults, SIDES[0], jobs), total=len(faults), unit="fault", disable=None
    )
    results = list(bar)
    text = json.dumps([asdict(result.record) for result in results], indent=2)
    (output / "summary.json").write_text(f"{text}\n", encoding="utf-8")
    draw_faults(results, output)
    return faults_as_text([result.record for result in results])


def main() -> int:
    """Entry point of `ros2 run mhsb_sim study`."""
    return command_line.run(study, name="study")


if __name__ == "__main__":
    sys.exit(main())
