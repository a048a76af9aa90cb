"""`study`: both servo controllers over all scenarios of config/study_scenarios.yaml, or over draws
of plants that are not as the machine file says, config/variations.yaml, also as a benchmark."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tqdm import tqdm

from mhsb_model import command_line
from mhsb_model.machine import Machine, load_machine
from mhsb_planner.kernel_parts import compile_planner
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_planner.result_files import write_json
from mhsb_planner.work_arguments import Scheduler, jobs_of
from mhsb_planner.workers import Jobs
from mhsb_sim.simulation.kernel_parts import compile_simulator
from mhsb_sim.simulation.plant_files import load_plant
from mhsb_sim.study.draw_limits import as_text as draws_as_text
from mhsb_sim.study.draws import GOALS, run_draws
from mhsb_sim.study.draws import as_dicts as draws_as_dicts
from mhsb_sim.study.energy_comparison import Element, total
from mhsb_sim.study.energy_comparison import as_text as energy_text
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
from mhsb_sim.study.scenarios import load_scenarios
from mhsb_sim.study.servo_study import ScenarioResult, StudyRecord, as_dicts, run_study
from mhsb_sim.study.study_figures import draw_study
from mhsb_sim.study.variations import load_variations

SIDES = ("coordinated", "independent")

DRAWS = 100

TRACKED_ERROR = 5.0
"""Energies are compared where both controllers stay within this tip error RMS [mm]."""


def study(
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/study"),
    machine: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    scenarios: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    variations: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    draws: Annotated[int | None, tyro.conf.arg(metavar="N")] = None,
    seed: int = 0,
    goals: Annotated[int | None, tyro.conf.arg(metavar="N")] = None,
    plant: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    jobs: int | None = None,
    scheduler: Scheduler = None,
    faults: Annotated[list[str] | None, tyro.conf.arg(metavar="FAULT")] = None,
    benchmark: bool = False,
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
        seed: Of the draws.
        goals: Random goals of each draw; six when left out.
        plant: Plant file (YAML) of what is varied, where that is not the machine itself.
        jobs: Processes; as many as there are processors when left out.
        scheduler: Address of a Dask cluster that does it instead (docs/cluster.md).
        faults: What fails, as in the simulator's parameter `fault`; without any, all kinds.
        benchmark: Run the mismatch benchmark.
    """
    if jobs is not None and jobs < 1:
        raise command_line.UsageError(f"--jobs: {jobs} is below 1")
    workers = jobs_of(jobs, scheduler)
    arm = load_machine(machine)
    if benchmark:
        if seed or any(each is not None for each in (scenarios, variations, plant, faults)):
            raise command_line.UsageError(
                "--benchmark: its file is the protocol; leave out --scenarios, --variations, "
                "--plant, --seed and --faults"
            )
        study_benchmark(arm, load_protocol(arm), draws, workers, output)
        return
    if faults is not None:
        study_faults(arm, faults or FAULTS, workers, output)
        return
    if variations is not None or draws is not None:
        if scenarios is not None:
            raise command_line.UsageError(
                "--scenarios: draws make their own goals; leave it out for these"
            )
        real = load_plant(arm, plant) if plant else arm
        count = DRAWS if draws is None else draws
        each = GOALS if goals is None else goals
        study_draws(arm, real, variations, count, seed, workers, output, each)
        return
    if goals is not None:
        raise command_line.UsageError("--goals: goes with --draws; scenarios have their own")
    if plant is not None:
        raise command_line.UsageError("--plant: goes with --draws; scenarios are the machine's own")
    wanted = load_scenarios(scenarios, arm.name)
    compile_simulator()  # so that the processes find compiled kernels
    bar = tqdm(run_study(arm, wanted, workers), total=len(wanted), unit="scenario", disable=None)
    order = {scenario.name: number for number, scenario in enumerate(wanted)}
    results = sorted(bar, key=lambda result: order[result.scenario.name])
    output.mkdir(parents=True, exist_ok=True)
    comparison = compare(results)
    for name, content in (("summary", as_dicts(results)), ("comparison", comparison)):
        (output / f"{name}.json").write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    draw_study(results, output)
    print("\n".join(as_text(results, comparison)))


def study_draws(
    machine: Machine,
    plant: Machine,
    variations: Path | None,
    count: int,
    seed: int,
    jobs: Jobs,
    output: Path,
    goals: int = GOALS,
) -> None:
    """Run all draws; writes summary.json in the folder `output`, prints figures and their limits.

    plant: what is varied while servo and planner know `machine`. goals: of each draw.
    """
    for name, value, lowest in (("draws", count, 1), ("seed", seed, 0), ("goals", goals, 1)):
        if value < lowest:
            raise command_line.UsageError(f"--{name}: {value} is below {lowest}")
    wanted = load_variations(plant, variations)
    compile_planner()
    compile_simulator()  # so that the processes find compiled kernels
    table_for(machine)  # likewise
    runs = run_draws(machine, wanted, count, seed, jobs, plant, goals)
    bar = tqdm(runs, total=count, unit="draw", disable=None)
    records = [record for pair in bar for record in pair]
    output.mkdir(parents=True, exist_ok=True)
    text = json.dumps(draws_as_dicts(records), indent=2)
    (output / "summary.json").write_text(f"{text}\n", encoding="utf-8")
    print("\n".join(draws_as_text(records)))


def study_benchmark(
    machine: Machine, protocol: Protocol, draws: int | None, jobs: Jobs, output: Path
) -> None:
    """Run the mismatch benchmark; writes all records, their summary and a table, and prints it."""
    count = protocol.file.draws if draws is None else draws
    if count < 1:
        raise command_line.UsageError(f"--draws: {count} is below 1")
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
    print("\n".join([*lines, *sorted(line for line in failures if not line.endswith(": "))]))


def study_faults(
    machine: Machine, faults: Sequence[str], jobs: Jobs, output: Path
) -> None:
    """Run all faults; writes summary.json and figures in the folder `output`, prints a table."""
    compile_planner()
    compile_simulator()
    bar = tqdm(
        run_faults(machine, faults, SIDES[0], jobs), total=len(faults), unit="fault", disable=None
    )
    results = list(bar)
    output.mkdir(parents=True, exist_ok=True)
    text = json.dumps([asdict(result.record) for result in results], indent=2)
    (output / "summary.json").write_text(f"{text}\n", encoding="utf-8")
    draw_faults(results, output)
    print("\n".join(faults_as_text([result.record for result in results])))


def compare(results: Sequence[ScenarioResult]) -> dict[str, Any]:
    """The coordinated controller against the independent one, the worst over all scenarios.

    tracking_ratio  independent over coordinated tip error RMS: least and geometric mean
    overshoot_max_mpa, overshoot_mean_mpa  supply overshoot, not below 0: over all scenarios
    overshoot_ratio  coordinated over independent supply overshoot: of the largest and of the mean
                     ones over all scenarios, and the worst of those where the latter overshoots
    energy_ratio    coordinated over independent, largest, where both track within 5 mm RMS
    planned_ratio   planned (series) over simulated energy of the coordinated controller
    energy_elements_j  both, element by element, summed over all scenarios
    """
    pairs = [[each.records_by_controller[side] for side in SIDES] for each in results]
    tracking = np.array([b.tip_error_rms_mm / a.tip_error_rms_mm for a, b in pairs])
    overshoot = np.array([[r.supply_overshoot_mpa for r in pair] for pair in pairs]).clip(0.0)
    largest, mean = overshoot.max(axis=0), overshoot.mean(axis=0)
    both = overshoot[overshoot[:, 1] > 0.0]
    tracked = [pair for pair in pairs if max(r.tip_error_rms_mm for r in pair) <= TRACKED_ERROR]
    planned = np.array([a.energy_planned_series_j / _energy(a) for a, _ in pairs])
    return {
        "scenarios": len(pairs),
        "tip_error_rms_max_mm": {
            "coordinated": max(a.tip_error_rms_mm for a, _ in pairs),
            "independent": max(b.tip_error_rms_mm for _, b in pairs),
        },
        "tracking_ratio": {
            "least": float(tracking.min()),
            "mean": float(np.exp(np.mean(np.log(tracking)))),
        },
        "overshoot_max_mpa": dict(zip(SIDES, largest.tolist(), strict=True)),
        "overshoot_mean_mpa": dict(zip(SIDES, mean.tolist(), strict=True)),
        "overshoot_ratio": {
            "of_largest": float(largest[0] / largest[1]) if len(both) else None,
            "of_mean": float(mean[0] / mean[1]) if len(both) else None,
            "worst_scenario": float((both[:, 0] / both[:, 1]).max()) if len(both) else None,
        },
        "energy_ratio": max((_energy(a) / _energy(b) for a, b in tracked), default=None),
        "energy_ratio_scenarios": len(tracked),
        "planned_ratio": {"least": float(planned.min()), "largest": float(planned.max())},
        "energy_elements_j": [asdict(element) for element in energy_totals(results)],
        "relief_opened": {
            "coordinated": sum(a.relief_opened for a, _ in pairs),
            "independent": sum(b.relief_opened for _, b in pairs),
        },
        "goals_refused": [reason for result in results for reason in result.refused],
    }


def as_text(results: Sequence[ScenarioResult], comparison: dict[str, Any]) -> list[str]:
    """The study for a person."""
    lines = [
        f"{'':30s} {'coordinated':^32s}   {'independent':^32s}",
        f"{'scenario':30s}" + 2 * "   RMS    max mm  over MPa      J   ",
    ]
    for result in results:
        mark = " " if result.scenario.held_out else "*"
        lines.append(
            f"{result.scenario.name:28s} {mark}"
            + "  ".join(_columns(record) for record in result.records)
        )
    lines.append("* gains were tuned on this scenario; R: a relief valve opened")
    lines += ["", "coordinated, all scenarios together:", *energy_text(energy_totals(results)), ""]
    shown = {k: v for k, v in comparison.items() if k not in ("goals_refused", "energy_elements_j")}
    return [*lines, json.dumps(shown), *comparison["goals_refused"]]


def energy_totals(results: Sequence[ScenarioResult]) -> list[Element]:
    """Planned and simulated energy of the coordinated controller, over all scenarios."""
    return total(result.elements["coordinated"] for result in results)


def _columns(record: StudyRecord) -> str:
    relief = "R" if record.relief_opened else " "
    return (
        f"{record.tip_error_rms_mm:7.2f} {record.tip_error_max_mm:8.2f} "
        f"{record.supply_overshoot_mpa:8.2f}{relief} {_energy(record):7.0f}"
    )


def _energy(record: StudyRecord) -> float:
    return record.energy_mp_j + record.energy_sp_j


def main() -> int:
    """Entry point of `ros2 run mhsb_sim study`."""
    return command_line.run(study, name="study")


if __name__ == "__main__":
    sys.exit(main())
