"""`study`: run the servo controllers over scenarios, draws, faults or the mismatch benchmark.

Scenarios are those of config/study_scenarios.yaml. Draws are plants that differ from the machine
file as config/variations.yaml says.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro
from tqdm import tqdm

from mhsb_control import (
    default_controller,
    get_controller_class,
    load_machine,
    select_controllers,
)
from mhsb_model import command_line
from mhsb_model.command_line import JsonFlag, NumberRange, OptionalFile
from mhsb_model.files.output_folders import make_output_folder
from mhsb_model.machine import Machine
from mhsb_planner.cluster import WorkArguments
from mhsb_planner.executor import Jobs
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.result_files import write_json
from mhsb_sim.simulation.plant_files import load_plant
from mhsb_tools.study.draw_limits import as_text as draws_as_text
from mhsb_tools.study.draws import GOAL_COUNT, DrawRecord, DrawStudy, run_draws
from mhsb_tools.study.draws import as_dicts as draws_as_dicts
from mhsb_tools.study.fault_study import STUDIED_FAULTS, run_faults
from mhsb_tools.study.fault_study import as_text as faults_as_text
from mhsb_tools.study.headless import compile_kernels
from mhsb_tools.study.mismatch_benchmark import (
    Protocol,
    load_protocol,
    run_benchmark,
    summarize,
)
from mhsb_tools.study.mismatch_benchmark import as_markdown as benchmark_as_markdown
from mhsb_tools.study.scenarios import Scenario, load_scenarios
from mhsb_tools.study.servo_study import COMPARED_CONTROLLERS, as_text, compare, run_study
from mhsb_tools.study.study_figures import draw_faults, draw_study
from mhsb_tools.study.variations import load_variations

DEFAULT_DRAWS = 100
"""Number of draws when --draws is left out but --variations is given."""


@dataclass(frozen=True)
class KindArguments:
    """Options for the kind of study; without any of them, it runs the suite's scenarios.

    Attributes:
        scenarios: Scenario file (YAML). When left out, the suite's config/study_scenarios_NAME.yaml
            if there is one for the machine's name, else its config/study_scenarios.yaml.
        faults: Parts that fail, as in the simulator's parameter `fault`; all kinds if none is
            named.
        benchmark: Run the mismatch benchmark.
    """

    scenarios: OptionalFile = None
    faults: Annotated[list[str] | None, tyro.conf.arg(metavar="FAULT")] = None
    benchmark: bool = False


@dataclass(frozen=True)
class DrawArguments:
    """Options for draws.

    Attributes:
        variations: File (YAML) of how plants may differ; the suite's own when left out.
        draws: Number of draws; when left out 100 with --variations, the file's with --benchmark.
        seed: Seed of the draws; 0 when left out.
        goals: Number of random goals of each draw; six when left out.
        plant: Plant file (YAML) of the machine that is varied, if it is not the machine itself.
        controllers: Controllers that are run on the draws; all that suit the machine's sensors when
            left out.
    """

    variations: OptionalFile = None
    draws: Annotated[int | None, tyro.conf.arg(metavar="N"), NumberRange(1, 10**6)] = None
    seed: Annotated[int | None, NumberRange(0, 2**63 - 1)] = None
    goals: Annotated[int | None, tyro.conf.arg(metavar="N"), NumberRange(1, 10**6)] = None
    plant: OptionalFile = None
    controllers: Annotated[list[str] | None, tyro.conf.arg(metavar="NAME")] = None


def study(
    *,
    output: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/study"),
    machine: OptionalFile = None,
    kind: KindArguments,
    draws: DrawArguments,
    work: WorkArguments,
    json_: JsonFlag = False,
) -> None:
    """Run every servo controller through every scenario and compare them.

    Writes DIR/summary.json (a list, one record for each scenario and controller: errors in mm,
    pressures in MPa, energies in J), DIR/comparison.json and figures. Equal files give equal
    numbers. With --variations or --draws the runs are draws instead: in each the arm differs from
    the machine file and is sent to some random goals, 0.4 to 5 s apart. Only DIR/summary.json is
    written, one record for each draw and controller. With --faults a part fails during a lift in
    boost; DIR/summary.json has one record for each fault, and there is a figure of each. With
    --benchmark the moves and plants come from config/mismatch_benchmark.yaml
    (docs/studies.md): DIR/records.json, DIR/summary.json and the table DIR/results.md.

    Args:
        output: Folder for summary, comparison and figures.
        machine: Machine file (YAML); the suite's own arm when left out.
        kind: Scenarios, faults or benchmark.
        draws: Number and kind of draws.
        work: Number of processes, or the Dask cluster, that computes.
        json_: Print DIR/summary.json instead of text; without --draws, --faults and --benchmark
            DIR/comparison.json.

    Raises:
        UsageError: `jobs` is below 1, or an option has no effect in this kind of study. The
            benchmark uses only `draws`, for example, so that it does not take `seed`. Or scenarios
            are to be run, and the compared controllers do not suit the machine's sensors.
        MhsbError: A file, the output folder or the cluster cannot be used, or a name or motion of
            the study does not suit the machine.
    """
    asked = _kind(kind, draws)
    _check_options_have_effect(asked, kind, draws)
    workers = work.connect()
    arm = load_machine(machine)
    if asked == "benchmark":
        lines = study_benchmark(arm, load_protocol(arm), draws.draws, workers, output)
    elif asked == "faults":
        lines = study_faults(arm, kind.faults or STUDIED_FAULTS, workers, output)
    elif asked == "draws":
        lines = study_draws(arm, draws, workers, output)
    else:
        lines = study_scenarios(arm, load_scenarios(kind.scenarios, arm), workers, output)
    if json_:
        file = "comparison.json" if asked == "scenarios" else "summary.json"
        print((output / file).read_text(encoding="utf-8"), end="")
    else:
        print("\n".join(lines))


def _kind(kind: KindArguments, draws: DrawArguments) -> str:
    """Return which kind of study the options ask for.

    If options ask for several kinds, the benchmark comes first, then faults, then draws.

    Args:
        kind: Options for the kind of study.
        draws: Options for random plants (draws); a number of draws or a file of variations asks for
            them.

    Returns:
        `benchmark`, `faults`, `draws`, or `scenarios` if none of the others is asked for.
    """
    if kind.benchmark:
        return "benchmark"
    if kind.faults is not None:
        return "faults"
    return "scenarios" if draws.draws is None and draws.variations is None else "draws"


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


def _check_options_have_effect(asked: str, kind: KindArguments, draws: DrawArguments) -> None:
    """Check that every given option has an effect in this kind of study.

    Args:
        asked: Kind of the study: `benchmark`, `faults`, `draws` or `scenarios`.
        kind: Options for the kind of study.
        draws: Options for draws.

    Raises:
        UsageError: An option has no effect; the message names all such options.
    """
    given = {"scenarios": kind.scenarios, **vars(draws), "faults": kind.faults}
    names = ", ".join(
        f"--{name}"
        for name, value in given.items()
        if value is not None and name not in OPTIONS_BY_KIND[asked]
    )
    if not names:
        return
    if asked == "scenarios":
        raise command_line.UsageError(f"{names}: goes with --draws; {FIXED_PROTOCOLS[asked]}")
    raise command_line.UsageError(f"--{asked}: {FIXED_PROTOCOLS[asked]}; leave out {names}")


def _prepare_processes(machine: Machine, output: Path) -> None:
    """Create the output folder, compile all kernels, and build the posture table if needed.

    The processes of the study then load kernels and table from the cache.

    Args:
        machine: The machine whose posture table is built if it is not cached.
        output: Folder for the results; created if it does not exist.

    Raises:
        MhsbError: The output folder cannot be used, or the posture table has no posture.
    """
    make_output_folder(output, "the study")
    compile_kernels()
    load_or_build_table(machine)


def study_scenarios(
    arm: Machine, wanted: Sequence[Scenario], workers: Jobs, output: Path
) -> list[str]:
    """Simulate all controllers made for the machine's sensors, and write results and figures.

    Each controller runs in all scenarios. The controllers of `COMPARED_CONTROLLERS` (coordinated
    and independent) are compared.

    Args:
        arm: The machine that planner and servo know.
        wanted: The scenarios.
        workers: Number of processes, or a cluster; None takes one process for each processor.
        output: Folder for summary.json (one record for each scenario and controller),
            comparison.json and the figures; created if it does not exist.

    Returns:
        Results of all scenarios and the comparison as lines of text.

    Raises:
        UsageError: The compared controllers do not suit the machine's sensors.
        MhsbError: A part of the output folder's path exists and is not a folder. Or a scenario
            cannot be planned, a simulation diverges, the number of workers is below 1, or the
            cluster does not answer.
    """
    if not set(COMPARED_CONTROLLERS) <= set(select_controllers(arm)):
        raise command_line.UsageError(
            f"scenarios compare {' and '.join(COMPARED_CONTROLLERS)}, which read pressures that "
            f"{arm.name} does not measure; --draws studies {default_controller(arm)}"
        )
    _prepare_processes(arm, output)
    bar = tqdm(run_study(arm, wanted, workers), total=len(wanted), unit="scenario", disable=None)
    order = {scenario.name: number for number, scenario in enumerate(wanted)}
    results = sorted(bar, key=lambda result: order[result.scenario.name])
    comparison = compare(results)
    records = [asdict(record) for result in results for record in result.records]
    write_json(output / "summary.json", records)
    write_json(output / "comparison.json", comparison)
    draw_study(results, output)
    return as_text(results, comparison)


def study_draws(machine: Machine, asked: DrawArguments, jobs: Jobs, output: Path) -> list[str]:
    """Simulate controllers on random plants (draws), and write their records.

    If an error or an interrupt ends the study, the draws that were finished are written.

    Args:
        machine: The machine that planner and servo know.
        asked: Number of draws, and how plants, goals and controllers are chosen.
        jobs: Number of processes, or a cluster; None takes one process for each processor.
        output: Folder for summary.json, with one record for each draw and controller; created if it
            does not exist.

    Returns:
        Lines of text: counts and quantiles of each controller beside their limits, and the draws
        that failed.

    Raises:
        UnknownControllerError: A controller does not exist.
        MachineFileError: The plant file cannot be used.
        YamlFileError: The file of variations cannot be read.
        VariationError: The file of variations is invalid.
        MhsbError: The variations do not fit the plant, or the output folder cannot be used.
    """
    controllers = tuple(asked.controllers or select_controllers(machine))
    for name in controllers:
        get_controller_class(name)
    count = asked.draws or DEFAULT_DRAWS
    seed, goals = asked.seed or 0, asked.goals or GOAL_COUNT
    plant = load_plant(machine, asked.plant) if asked.plant else machine
    variations = load_variations(plant, asked.variations)
    _prepare_processes(machine, output)
    make_study = partial(DrawStudy, machine, variations, seed, plant, goals, controllers)
    records: list[DrawRecord] = []
    try:
        for each in tqdm(
            run_draws(make_study, count, jobs), total=count, unit="draw", disable=None
        ):
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
    """Run the mismatch benchmark and write its results.

    Args:
        machine: The machine that planner and servo know.
        protocol: Definition of the benchmark.
        draws: Number of draws (random plants); None takes the protocol's.
        jobs: Number of processes, or a cluster; None takes one process for each processor.
        output: Folder for records.json, summary.json and results.md; created if it does not exist.

    Returns:
        The tables of results.md as lines of Markdown, then a line for each run that failed.

    Raises:
        MhsbError: The output folder cannot be used, or the posture table has no posture.
    """
    count = draws or protocol.file.draws
    _prepare_processes(machine, output)
    total = len(protocol.file.sequences) + count
    runs = run_benchmark(machine, protocol, count, jobs)
    found = list(tqdm(runs, total=total, unit="run", disable=None))
    parts = {
        title: [record for of, records in found if of is exact for record in records]
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
    """Simulate faults with the machine's default controller, and write results and figures.

    Args:
        machine: The machine.
        faults: Names of the faults, as in the simulator's parameter `fault`.
        jobs: Number of processes, or a cluster; None takes one process for each processor.
        output: Folder for summary.json and a figure for each fault; created if it does not exist.

    Returns:
        A table of the faults as lines of text.

    Raises:
        FaultError: A fault does not exist.
        MhsbError: The output folder cannot be used, or the motion in which the faults occur cannot
            be planned.
    """
    _prepare_processes(machine, output)
    bar = tqdm(
        run_faults(machine, faults, default_controller(machine), jobs),
        total=len(faults),
        unit="fault",
        disable=None,
    )
    results = list(bar)
    write_json(output / "summary.json", [asdict(result.record) for result in results])
    draw_faults(results, output)
    return faults_as_text([result.record for result in results])


main = command_line.make_main(study)
