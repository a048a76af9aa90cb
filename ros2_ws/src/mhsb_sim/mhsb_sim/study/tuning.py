"""Tuning the servo: the same random search, on the same draws, for every controller.

Gains cost what the worst tenth of draws costs at least, plants that are not as the file says with
delays, sensors and sags (`draws`), and what the training scenarios of config/study_scenarios.yaml
cost on the exact machine in the mean. They are drawn log-uniformly from their ranges first, then
from ever smaller surroundings of the best. The search has a seed, and its result does not depend
on the number of processes.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.workers import Jobs, Prepared, results_of
from mhsb_sim.errors import TuningError
from mhsb_sim.servo.natural_frequency import lowest_joint_frequencies
from mhsb_sim.servo.stability import slowest_decay
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.study.draws import DrawStudy, GoalSequence
from mhsb_sim.study.replay import replay
from mhsb_sim.study.servo_study import Script, judge, perform, supply_overshoot
from mhsb_sim.study.variations import Variations

Gains = dict[str, float]

CASCADE = {
    "position_gain": (0.2, 2.0),
    "integral_gain": (1e-3, 0.1),
    "force_bandwidth": (0.02, 0.5),
    "force_damping": (0.5, 4.0),
}

RANGES: dict[str, dict[str, tuple[float, float]]] = {
    "coordinated": {
        **CASCADE,
        "pressure_gain": (0.3, 4.0),
        "pump_response": (0.2, 3.0),
        "preview": (0.06, 0.2),
        "allowed_rise": (1e4, 1e6),
    },
    "independent": {
        **CASCADE,
        "nominal_valve_drop": (0.03, 1.0),
        "pressure_gain": (10.0, 1000.0),
        "pressure_integral_gain": (10.0, 20000.0),
        "supply_margin": (1e4, 5e5),
    },
}
"""What is searched, in the units of the machine file; an integral gain of 0 is off."""

QUANTILE = 0.9
"""Of the costs of draws, that counts."""

LOST = 20.0
"""Tip error [mm] beyond which an arm of the paper's size has fallen."""

BATCH = 8
NARROWING = 0.85
"""By which the surroundings of the best shrink from batch to batch, in the second half."""

SLOWEST_DECAY = 0.0128
"""At which every swing of the linear loop has to die out, in every posture, with any payload of
the scripts, over the arm's lowest natural frequency [rad/s]; of the suite's own arm 0.3 1/s."""

RELIEF_COST = FALL_COST = 10.0
FAILURE_COST = 1e3

COMMENT = "# assumption: tuned by `ros2 run mhsb_sim tune`"


@dataclass(frozen=True)
class Trial:
    """Gains and what they cost."""

    gains: Gains
    cost: float


@dataclass(frozen=True, eq=False)
class Draw:
    """One draw to be tuned on: what servo and planner know, the plant, and the plans."""

    machine: Machine
    plant: Machine
    sequence: GoalSequence
    number: int


@dataclass(frozen=True, eq=False)
class Training:
    """What gains are tried on: scenarios of the exact machine, and draws of other plants."""

    scripts: Sequence[Script]
    draws: Sequence[Draw] = ()

    @property
    def payloads(self) -> set[float]:
        """All that the arm carries in it [kg]."""
        scenarios = {script.scenario.payload for script in self.scripts}
        return scenarios | {draw.plant.arrays.payload for draw in self.draws}

    def cost(self, costs: FloatArray) -> float:
        """Of gains, from those of all scripts and then of all draws."""
        scripts, draws = np.split(costs, [len(self.scripts)])
        in_the_mean = float(scripts.mean()) if len(scripts) else 0.0
        return in_the_mean + (float(np.quantile(draws, QUANTILE)) if len(draws) else 0.0)


def draws_of(machine: Machine, variations: Variations, count: int, seed: int) -> Iterator[Draw]:
    """Draws 0 … count − 1 of a seed, with their plans; the same as `draws.run_draws` makes."""
    study = DrawStudy(machine, variations, seed)
    for number in range(count):
        sequence, plant, _ = study.drawn(number)
        yield Draw(machine, plant, sequence, number)


def cost_of(script: Script, controller: str, gains: Gains) -> float:
    """Tip error RMS [mm] + supply overshoot [MPa], + 10 where a relief valve opened.

    A run that diverges, or gains that are no gains, cost 1000.
    """
    try:
        tuned = with_gains(script.machine, controller, gains)
        record = judge(script, controller, perform(script, controller, tuned))
    except MhsbError:
        return FAILURE_COST
    return _cost_of_run(
        record.tip_error_rms_mm, record.supply_overshoot_mpa, record.relief_opened, False
    )


def cost_of_draw(draw: Draw, controller: str, gains: Gains) -> float:
    """As `cost_of`, and 10 more for an arm that falls or is held for good."""
    try:
        tuned = with_gains(draw.machine, controller, gains)
        simulator = Simulator(tuned, controller, seed=draw.number, plant=draw.plant)
        run = replay(simulator, draw.sequence.commands, draw.sequence.duration)
    except MhsbError:
        return FAILURE_COST
    error = 1e3 * run.tip_error(draw.plant)
    overshoot = float(supply_overshoot(draw.plant, run).max() / 1e6)
    relief = run.energies["relief_valves"] > 0.0
    fell = bool(error.max() > draw.machine.scale * LOST) or bool(run.held)
    return _cost_of_run(float(np.sqrt(np.mean(error**2))), overshoot, relief, fell)


def _cost_of_run(rms_mm: float, overshoot_mpa: float, relief: bool, fell: bool) -> float:
    return rms_mm + max(0.0, overshoot_mpa) + RELIEF_COST * relief + FALL_COST * fell


def is_stable(machine: Machine, payloads: set[float], controller: str, gains: Gains) -> bool:
    """Whether the arm does not swing itself up in any posture under any payload [kg].

    The servo goes by the machine's own payload.
    """
    own = getattr(with_gains(machine, controller, gains).config.servo, controller)
    least = SLOWEST_DECAY * float(lowest_joint_frequencies(machine).min())
    return all(slowest_decay(machine, own, payload) > least for payload in payloads)


def with_gains(machine: Machine, controller: str, gains: Gains) -> Machine:
    """The machine with other gains of one controller."""
    servo = machine.config.servo
    own = getattr(servo, controller).model_copy(update=gains)
    changed = servo.model_copy(update={controller: own})
    return Machine.from_config(machine.config.model_copy(update={"servo": changed}))


def present_gains(machine: Machine, controller: str) -> Gains:
    """The gains that the machine file has, of those that are searched."""
    own = getattr(machine.config.servo, controller)
    return {name: getattr(own, name) for name in RANGES[controller]}


def tune(
    machine: Machine,
    training: Training,
    controller: str,
    budget: int,
    seed: int = 0,
    jobs: Jobs = None,
    progress: Callable[[Trial], None] | None = None,
) -> Trial:
    """The best of `budget` trials, each on all of the training; the present gains are the first.

    Gains with which the machine's servo is not stable under every payload in it cost 1000.
    progress is called with the best so far after each trial. Raises TuningError where the
    controller has no ranges or there is nothing to train on.
    """
    if controller not in RANGES:
        raise TuningError(f"{controller!r} cannot be tuned; valid are {', '.join(RANGES)}")
    if not training.scripts and not training.draws:
        raise TuningError("there are neither training scenarios nor draws")
    random = np.random.default_rng(seed)
    best = Trial(present_gains(machine, controller), math.inf)
    width = 0.5
    done = 0
    with _evaluator(training, controller, jobs) as evaluate:
        while done < budget:
            around = best.gains if done >= budget // 2 else None
            batch = [
                _draw(random, controller, around, width) for _ in range(min(BATCH, budget - done))
            ]
            if done == 0:
                batch[0] = best.gains
            stable = [g for g in batch if is_stable(machine, training.payloads, controller, g)]
            costs = iter(evaluate(stable))
            for gains in batch:
                cost = next(costs) if gains in stable else FAILURE_COST
                if cost < best.cost:
                    best = Trial(gains, cost)
                if progress is not None:
                    progress(best)
            width *= NARROWING if around is not None else 1.0
            done += len(batch)
    return best


@contextmanager
def _evaluator(
    training: Training, controller: str, jobs: Jobs
) -> Iterator[Callable[[Sequence[Gains]], list[float]]]:
    """Cost of each gains over the training, done by `jobs`."""
    count = len(training.scripts) + len(training.draws)

    def costs_of(batch: Sequence[Gains]) -> list[float]:
        tasks = [
            pool.submit(_cost, controller, gains, number)
            for gains in batch
            for number in range(count)
        ]
        found = np.reshape(list(results_of(tasks, in_order=True)), (len(batch), count))
        return [training.cost(costs) for costs in found]

    with Prepared(jobs, tuple, (*training.scripts, *training.draws)) as pool:
        yield costs_of


def write_gains(file: Path, controller: str, gains: Gains) -> None:
    """Write gains into the servo section of a machine file, leaving all else as it is.

    Raises TuningError where the file has no such section.
    """
    text = file.read_text(encoding="utf-8")
    head, section, rest = _split_section(text, controller)
    for name, value in gains.items():
        written = f"    {name}: {value:.3g}  {COMMENT}"
        section, found = re.subn(rf"(?m)^\s+{name}:.*$", written, section)
        if not found:
            section += f"{written}\n"
    part = file.with_name(f"{file.name}.part")
    part.write_text(head + section + rest, encoding="utf-8")
    os.replace(part, file)


def _split_section(text: str, controller: str) -> tuple[str, str, str]:
    """The text before, of and after the servo's section of a controller."""
    servo, own = r"^servo:\n(?:[ #].*\n|\n)*?", rf"  {controller}:.*\n(?P<own>(?:    .*\n)+)"
    found = re.search(servo + own, text, re.MULTILINE)
    if found is None:
        raise TuningError(f"the machine file has no section servo.{controller}")
    begin, end = found.span("own")
    return text[:begin], text[begin:end], text[end:]


def _draw(
    random: np.random.Generator, controller: str, around: Gains | None, width: float
) -> Gains:
    """Gains from the whole of their ranges, or near others: `width` as a share of a range's log."""
    gains = {}
    for name, (lowest, highest) in RANGES[controller].items():
        span = math.log(highest / lowest)
        if around is None:
            value = lowest * math.exp(span * random.uniform())
        else:
            value = around[name] * math.exp(span * width * random.normal() / 2.0)
        gains[name] = float(f"{min(max(value, lowest), highest):.3g}")
    return gains


def _cost(
    training: Sequence[Script | Draw], controller: str, gains: Gains, number: int
) -> float:
    each = training[number]
    if isinstance(each, Draw):
        return cost_of_draw(each, controller, gains)
    return cost_of(each, controller, gains)
