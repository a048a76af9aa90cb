"""Tuning of the servo by random search, with identical draws for every controller.

The cost of gains is the sum of two parts. One is the 90 % quantile over draws: runs on plants that
differ from the file, also in delays, sensors and supply sags (`draws`). The other is the mean over
the training scenarios of config/study_scenarios.yaml on the exact machine. The incumbent is the set
of gains with the lowest cost so far. Gains are drawn log-uniformly from their ranges first, then
closer and closer around the incumbent. The search has a seed, and its result does not depend on the
number of processes.
"""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mhsb_control import REGISTERED_CONTROLLERS, read_gains
from mhsb_control.cascade import CascadeGains
from mhsb_control.natural_frequency import find_joint_frequency_ranges
from mhsb_control.stability import SLOWEST_DECAY, compute_slowest_decay
from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.files.output_folders import replace_file
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.executor import Jobs, SharedStateExecutor, yield_results
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.errors import TuningError
from mhsb_tools.study.draws import DrawStudy
from mhsb_tools.study.replay import replay
from mhsb_tools.study.servo_study import PlannedScenario, compute_supply_overshoot
from mhsb_tools.study.variations import Variations

Gains = dict[str, float]

GAIN_RANGES: dict[str, dict[str, tuple[float, float]]] = {
    name: ranges
    for name, controller in REGISTERED_CONTROLLERS.items()
    if (ranges := getattr(controller.gains_section, "search_ranges", None))
}
"""Search range of each gain by controller, in the units of the machine file."""

COST_QUANTILE = 0.9
"""Quantile of the draws' costs that counts."""

FALLEN_ERROR_MM = 20.0
"""Tip error beyond which an arm of the paper's size counts as fallen [mm]."""

BATCH_SIZE = 8
"""Number of trials drawn at once, around the same incumbent."""
NARROWING_FACTOR = 0.85
"""Factor from batch to batch on the width of the surroundings, in the second half of the search."""

RELIEF_COST = FALL_COST = 10.0
"""Cost of an opened relief valve, and of a fall."""
FAILURE_COST = 1e3
"""Cost of gains with which a run diverges or the arm is not stable."""

TUNED_COMMENT = "# assumption: tuned by `mhsb tune`"
"""Comment that is written beside each tuned gain in the machine file."""


@dataclass(frozen=True)
class Trial:
    """Gains and their cost.

    Attributes:
        gains: Value by name of the gain, in the units of the machine file.
        cost: Combined cost of all runs of the training; infinity before the first trial.
    """

    gains: Gains
    cost: float


@dataclass(frozen=True, eq=False)
class TuningRun:
    """A plant and planned motions on which gains are tried.

    Attributes:
        machine: The machine that planner and servo know.
        plant: The plant to simulate.
        commands: The plans by increasing stamp.
        duration: Duration of the run [s].
        number: Number of the draw; also the seed of the sensor noise.
    """

    machine: Machine
    plant: Machine
    commands: Sequence[Command]
    duration: float
    number: int = 0


@dataclass(frozen=True, eq=False)
class Training:
    """Runs on which gains are tried.

    Attributes:
        scenarios: Scenarios with their plans, to be run on the exact machine.
        draws: Draws with their plans, to be run on plants that differ from the machine file.
    """

    scenarios: Sequence[TuningRun]
    draws: Sequence[TuningRun] = ()

    @property
    def runs(self) -> tuple[TuningRun, ...]:
        """All scenarios, then all draws."""
        return (*self.scenarios, *self.draws)

    @property
    def payloads(self) -> set[float]:
        """All payloads that the arm carries in the training [kg]."""
        return {run.plant.arrays.payload for run in self.runs}

    def cost(self, costs: FloatArray) -> float:
        """Combine the costs of all runs with one set of gains to one cost.

        Args:
            costs: Cost of each of `runs`, shape (runs,).

        Returns:
            Mean over the scenarios plus the 90 % quantile over the draws. The mean is 0 without
            scenarios, the quantile 0 without draws.
        """
        scenarios, draws = np.split(costs, [len(self.scenarios)])
        mean = float(scenarios.mean()) if len(scenarios) else 0.0
        return mean + (float(np.quantile(draws, COST_QUANTILE)) if len(draws) else 0.0)


def make_scenario_run(script: PlannedScenario) -> TuningRun:
    """Return a planned scenario as a run on the exact machine."""
    return TuningRun(script.machine, script.machine, script.commands, script.scenario.duration)


def make_draws(
    machine: Machine, variations: Variations, count: int, seed: int
) -> Iterator[TuningRun]:
    """Make the draws (random plants with plans for random goals) with numbers 0 … count − 1.

    Args:
        machine: The machine that planner and servo know; its values are varied.
        variations: Variations (how a plant may differ from its machine file) by name.
        count: Number of draws.
        seed: Seed of the draws.

    Yields:
        Each draw, in order.

    Raises:
        MhsbError: The variations do not fit the plant.
    """
    study = DrawStudy(machine, variations, seed)
    for number in range(count):
        sequence, plant, _ = study.draw_plant(number)
        yield TuningRun(machine, plant, sequence.commands, sequence.duration, number)


def compute_cost(run: TuningRun, controller: str, gains: Gains) -> float:
    """Simulate one run with given gains, and compute their cost.

    The cost is tip error RMS [mm] plus supply overshoot [MPa], plus 10 if a relief valve opened. A
    negative overshoot counts as 0. Another 10 is added if the arm fell, or if the run was ended
    because the guard (reference governor) held a plan too long. The arm has fallen if the tip error
    was ever above `FALLEN_ERROR_MM` times the arm's size relative to the paper's arm. The cost is
    1000 if the simulation diverges or the gains are invalid.

    Args:
        run: The machine that the servo knows, the plant and the plans.
        controller: Name of the controller.
        gains: Value by name of the gain.

    Returns:
        The cost.
    """
    try:
        tuned = with_gains(run.machine, controller, gains)
        simulator = Simulator(tuned, controller, seed=run.number, plant=run.plant)
        record = replay(simulator, run.commands, run.duration)
    except MhsbError:
        return FAILURE_COST
    error = 1e3 * record.tip_error(run.plant)
    overshoot = float(compute_supply_overshoot(run.plant, record).max() / 1e6)
    relief = record.energies["relief_valves"] > 0.0
    fell = error.max() > run.machine.relative_size * FALLEN_ERROR_MM or bool(record.hold_reason)
    rms = float(np.sqrt(np.mean(error**2)))
    return rms + max(0.0, overshoot) + RELIEF_COST * relief + FALL_COST * float(fell)


def is_stable(machine: Machine, payloads: set[float], controller: str, gains: Gains) -> bool:
    """Return whether oscillations of the controlled arm decay fast enough under every payload.

    Only gains of the cascade are examined, since only this control loop has a linear model. The
    linear model of the controlled arm is examined in several postures. In each posture, the slowest
    decay rate must be above the same threshold for every payload. The threshold is `SLOWEST_DECAY`
    times the lowest natural frequency of `machine` with its own payload, over all joints and
    postures.

    Args:
        machine: The arm; its own payload is the one that the servo knows.
        payloads: Payloads that the arm really carries, to be tested [kg].
        controller: Name of the controller.
        gains: Value by name of the gain.

    Returns:
        True if the decay is fast enough for all payloads, or if the gains are not of the cascade.

    Raises:
        UnknownControllerError: No controller has this name.
        MachineFileError: A gain is out of its range.
    """
    own = read_gains(with_gains(machine, controller, gains), controller)
    if not isinstance(own, CascadeGains):
        return True
    least = SLOWEST_DECAY * float(find_joint_frequency_ranges(machine)[0].min())
    return all(compute_slowest_decay(machine, own, payload) > least for payload in payloads)


def with_gains(machine: Machine, controller: str, gains: Gains) -> Machine:
    """Return a copy of the machine with other gains of one controller.

    Args:
        machine: The arm.
        controller: Name of the controller.
        gains: Value by name of the gain; gains that are not named stay.

    Returns:
        The changed machine.

    Raises:
        MachineFileError: A gain is out of its range. The error comes here only if the machine was
            loaded with a check of its gains; otherwise it comes when the gains are read.
    """
    return machine.with_values({f"servo.{controller}.{name}": gains[name] for name in gains})


def get_present_gains(machine: Machine, controller: str) -> Gains:
    """Return the machine file's values of the gains that are searched, by name.

    Raises:
        UnknownControllerError: No controller has this name.
        MachineFileError: The section of the gains has a wrong value or an unknown key.
    """
    own = read_gains(machine, controller)
    return {name: getattr(own, name) for name in GAIN_RANGES[controller]}


def tune(
    machine: Machine,
    training: Training,
    controller: str,
    budget: int,
    seed: int = 0,
    jobs: Jobs = None,
    progress: Callable[[Trial], None] | None = None,
) -> Trial:
    """Search the gains of one controller with the lowest cost, by random search.

    The present gains are the first trial; they are returned if no other trial is better. In the
    first half of the budget, gains are drawn from their whole ranges. In the second half, they are
    drawn closer and closer around the incumbent (best gains so far). Gains with which the arm is
    not stable under some payload of the training are not simulated; their cost is 1000.

    Args:
        machine: The arm with its present gains.
        training: Scenarios and draws that are simulated with each trial's gains.
        controller: Name of the controller.
        budget: Number of trials.
        seed: Seed of the search.
        jobs: Number of processes, or a cluster; None takes one process for each processor. It does
            not change the result.
        progress: Function that is called with the best trial so far after each trial, or None.

    Returns:
        The best trial.

    Raises:
        TuningError: The controller has no search ranges, or the training is empty.
        MachineFileError: A gain is out of its range.
        ClusterError: The cluster failed.
    """
    if controller not in GAIN_RANGES:
        raise TuningError(f"{controller!r} cannot be tuned; valid are {', '.join(GAIN_RANGES)}")
    if not training.runs:
        raise TuningError("there are neither training scenarios nor draws")
    random = np.random.default_rng(seed)
    best = Trial(get_present_gains(machine, controller), math.inf)
    width = 0.5
    done = 0
    with SharedStateExecutor(jobs, tuple, training.runs) as pool:
        while done < budget:
            around = best.gains if done >= budget // 2 else None
            batch = [
                _draw(random, controller, around, width)
                for _ in range(min(BATCH_SIZE, budget - done))
            ]
            if done == 0:
                batch[0] = best.gains
            stable = [g for g in batch if is_stable(machine, training.payloads, controller, g)]
            costs = iter(_compute_costs(pool, training, controller, stable))
            for gains in batch:
                cost = next(costs) if gains in stable else FAILURE_COST
                if cost < best.cost:
                    best = Trial(gains, cost)
                if progress is not None:
                    progress(best)
            width *= NARROWING_FACTOR if around is not None else 1.0
            done += len(batch)
    return best


def _compute_costs(
    pool: SharedStateExecutor[tuple[TuningRun, ...]],
    training: Training,
    controller: str,
    batch: Sequence[Gains],
) -> list[float]:
    """Compute the combined cost of each set of gains over the whole training, in parallel.

    A run that diverges, or whose gains are invalid, costs `FAILURE_COST`.

    Args:
        pool: Executor whose workers have the runs of the training.
        training: Scenarios, and draws of plants that differ from the machine file.
        controller: Name of the controller.
        batch: Sets of gains.

    Returns:
        Costs in the same order.
    """
    count = len(training.runs)
    tasks = [
        pool.submit(_cost, controller, gains, number) for gains in batch for number in range(count)
    ]
    found = np.reshape(list(yield_results(tasks, in_order=True)), (len(batch), count))
    return [training.cost(costs) for costs in found]


def check_gain_sections(file: Path) -> None:
    """Check that a machine file has a section for each controller in GAIN_RANGES.

    Args:
        file: The machine file.

    Raises:
        TuningError: A section is missing, so that `write_gains` could not write into it.
    """
    text = file.read_text(encoding="utf-8")
    for controller in GAIN_RANGES:
        _split_section(text, controller)


def write_gains(file: Path, controller: str, gains: Gains) -> None:
    """Write gains of one controller into the servo section of a machine file.

    A gain that the section does not have is appended to it. Each written line gets the comment
    `TUNED_COMMENT`; all other lines of the file stay. The file is replaced as a whole.

    Args:
        file: The machine file.
        controller: Name of the controller.
        gains: Value by name of the gain; three significant digits are written.

    Raises:
        TuningError: The file has no section of this controller.
    """
    text = file.read_text(encoding="utf-8")
    head, section, rest = _split_section(text, controller)
    for name, value in gains.items():
        written = f"    {name}: {value:.3g}  {TUNED_COMMENT}"
        section, found = re.subn(rf"(?m)^\s+{name}:.*$", written, section)
        if not found:
            section += f"{written}\n"
    with replace_file(file) as part:
        part.write_text(head + section + rest, encoding="utf-8")


def _split_section(text: str, controller: str) -> tuple[str, str, str]:
    """Split a machine file at the section of one controller.

    Args:
        text: Content of the whole file.
        controller: Name of the controller.

    Returns:
        Text before the section's entries, the entries, and the text after.

    Raises:
        TuningError: The file has no such section.
    """
    servo, own = r"^servo:\n(?:[ #].*\n|\n)*?", rf"  {controller}:.*\n(?P<own>(?:    .*\n)+)"
    found = re.search(servo + own, text, re.MULTILINE)
    if found is None:
        raise TuningError(
            f"the machine file has no section servo.{controller} to write gains into; add one, "
            "with a gain of any value"
        )
    begin, end = found.span("own")
    return text[:begin], text[begin:end], text[end:]


def _draw(
    random: np.random.Generator, controller: str, around: Gains | None, width: float
) -> Gains:
    """Draw a set of gains at random.

    Values are clipped to their ranges and rounded to three significant digits.

    Args:
        random: Generator of random numbers; its state changes.
        controller: Name of the controller.
        around: Gains at the centre of a log-normal distribution; None draws log-uniformly from the
            whole ranges.
        width: Twice the standard deviation of the logarithm of a gain, as a share of the
            logarithmic range ln(highest/lowest). Not used if `around` is None.

    Returns:
        Value by name of the gain.
    """
    gains = {}
    for name, (lowest, highest) in GAIN_RANGES[controller].items():
        span = math.log(highest / lowest)
        if around is None:
            value = lowest * math.exp(span * random.uniform())
        else:
            value = around[name] * math.exp(span * width * random.normal() / 2.0)
        gains[name] = float(f"{min(max(value, lowest), highest):.3g}")
    return gains


def _cost(training: Sequence[TuningRun], controller: str, gains: Gains, number: int) -> float:
    """Compute the cost of gains in the run with index `number`; called in a worker process."""
    return compute_cost(training[number], controller, gains)
