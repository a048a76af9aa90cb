"""Command `tune`: find the servo's gains by random search and write them into the machine file."""

import json
from dataclasses import asdict, dataclass
from typing import Annotated

import tyro
from tqdm import tqdm

from mhsb_control import load_machine, select_controllers
from mhsb_model import command_line
from mhsb_model.command_line import Count, JsonFlag, NumberRange, OptionalFile, Seed
from mhsb_model.files.machine_files import find_machine_file
from mhsb_model.machine import Machine
from mhsb_planner.cluster import WorkArguments
from mhsb_tools.study.scenarios import load_scenarios
from mhsb_tools.study.servo_study import plan_scenario
from mhsb_tools.study.tuning import (
    GAIN_RANGES,
    Training,
    Trial,
    check_gain_sections,
    get_present_gains,
    make_draws,
    make_scenario_run,
    tune,
    write_gains,
)
from mhsb_tools.study.variations import load_variations

DEFAULT_DRAWS = 24
"""Number of draws when the option is left out."""


@dataclass(frozen=True)
class TrainingArguments:
    """Options for the scenarios and draws by which gains are judged.

    Attributes:
        scenarios: Scenario file (YAML); the suite's own when left out, as for `study`.
        draws: Number of draws; with 0 the scenarios alone count.
        variations: File (YAML) of how plants may differ; the suite's own when left out. Not with
            --draws 0.
        seed: Seed of the search and of the draws.
    """

    scenarios: OptionalFile = None
    draws: Annotated[Count, tyro.conf.arg(metavar="N")] = DEFAULT_DRAWS
    variations: OptionalFile = None
    seed: Seed = 0


def tune_servo(
    *,
    machine: OptionalFile = None,
    budget: Annotated[int, NumberRange(1, 10**6)] = 96,
    training: TrainingArguments,
    work: WorkArguments,
    dry_run: bool = False,
    json_: JsonFlag = False,
) -> None:
    """Tune the gains of the servo controllers with equal effort; write them into the machine file.

    The cost of a run is tip error RMS [mm] + supply overshoot [MPa], and 10 more for an opened
    relief valve, and if the arm falls. The sum of two parts is minimised: the 90 % quantile over
    draws of plants that differ from the file, and the mean over the study's training scenarios on
    the exact machine. Gains of the cascade (coordinated, independent) with which the arm would
    oscillate with growing amplitude in some posture are excluded. If no trial is better, the file's
    own gains are kept. Run it again whenever linkages, masses, cylinders or pumps of a machine
    change. Equal arguments give equal gains.

    Args:
        machine: Machine file (YAML) to tune and to change; the suite's own arm when left out.
        budget: Trials of each controller, each of them on all scenarios and draws.
        training: Scenarios and draws by which gains are judged.
        work: Number of processes, or the Dask cluster, that computes.
        dry_run: Only print the gains; leave the machine file as it is.
        json_: Print one JSON object instead of text: cost and gains of each controller.

    Raises:
        UsageError: A file of variations has no effect, or no controller for this machine has gains
            to tune.
        TuningError: The machine file has no section for the gains of a controller, or there are
            neither training scenarios nor draws.
        MhsbError: A file or the cluster cannot be used.
    """
    if training.draws == 0 and training.variations is not None:
        raise command_line.UsageError(
            f"--variations {training.variations} has no effect: with --draws 0 nothing is varied; "
            "leave out one of the two"
        )
    workers = work.connect()
    file = find_machine_file(machine)
    arm = load_machine(file)
    controllers = _select_controllers(arm)
    if not dry_run:
        check_gain_sections(file)
    plans = _build_training(arm, training)
    best: dict[str, Trial] = {}
    for controller in controllers:
        with tqdm(total=budget, desc=controller, leave=False, disable=None) as bar:

            def show_best(best: Trial, bar: tqdm = bar) -> None:
                """Show the best cost so far in the progress bar and advance it by one trial.

                Args:
                    best: Best trial so far.
                    bar: Progress bar of the controller.
                """
                bar.set_postfix(cost=f"{best.cost:.3f}", refresh=False)
                bar.update()

            found = tune(arm, plans, controller, budget, training.seed, workers, show_best)
        best[controller] = found
        if not json_:
            gains = ", ".join(f"{name} {value:g}" for name, value in found.gains.items())
            kept = found.gains == get_present_gains(arm, controller)
            note = f", the file's own: none of {budget} trials was better" if kept else ""
            print(f"{controller}: cost {found.cost:.3f} with {gains}{note}", flush=True)
        if not dry_run:
            write_gains(file.resolve(), controller, found.gains)
            command_line.set_interrupt_note(f"{file} has the new gains of {', '.join(best)}")
    if json_:
        print(json.dumps({name: asdict(trial) for name, trial in best.items()}))


def _select_controllers(arm: Machine) -> list[str]:
    """Return the controllers that suit a machine's sensors and have gains to tune.

    Args:
        arm: The machine to tune.

    Raises:
        UsageError: No controller both suits the sensors and has gains.
    """
    suitable = select_controllers(arm)
    found = [name for name in GAIN_RANGES if name in suitable]
    if not found:
        raise command_line.UsageError(
            f"{', '.join(suitable)}, which suits {arm.name}, has no gains to tune: it learns while "
            "the arm moves"
        )
    return found


def _build_training(arm: Machine, asked: TrainingArguments) -> Training:
    """Plan the motions of all training scenarios and of all draws (random plants).

    Args:
        arm: The machine whose gains are tuned.
        asked: Options for scenarios and draws.

    Returns:
        Training scenarios and draws with their plans.

    Raises:
        MhsbError: A file of scenarios or variations cannot be read, or does not fit the machine.
    """
    wanted = [each for each in load_scenarios(asked.scenarios, arm) if not each.held_out]
    scenarios = [
        make_scenario_run(plan_scenario(arm, each))
        for each in tqdm(wanted, "plans", leave=False, disable=None)
    ]
    drawn = make_draws(arm, load_variations(arm, asked.variations), asked.draws, asked.seed)
    return Training(scenarios, list(tqdm(drawn, "draws", asked.draws, leave=False, disable=None)))


main = command_line.make_main(tune_servo)
