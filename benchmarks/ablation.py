"""Measure what every tuned number and every estimator of the servo is worth, over random plants.

    source scripts/env.sh
    python benchmarks/ablation.py run out/ablation.json --draws 20
    python benchmarks/ablation.py report out/ablation.json

A variant of the coordinated servo has one field of its settings 30 % larger or smaller, or it does
without one estimator. All variants follow the same plans on the same plants, which are drawn from
config/variations.yaml. Kernels read settings from records, so that a change compiles nothing.
`run` adds to the file after every simulation and goes on where it was stopped. Draws are the outer
loop, so that an unfinished file still compares all variants over fewer draws. `report` prints the
changes against the servo as it is, by machine.
"""

from __future__ import annotations

import json
import math
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tqdm import tqdm

from mhsb_control import load_machine
from mhsb_control.coordinated import CoordinatedController, CoordinatedSettings
from mhsb_control.governor.mode_guard import ModeGuard
from mhsb_control.governor.reference_governor import GovernorSettings
from mhsb_model.errors import MhsbError
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine
from mhsb_planner.result_files import write_json
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.study.draws import DrawStudy, PlannedSequence
from mhsb_tools.study.replay import replay
from mhsb_tools.study.servo_study import compute_supply_overshoot
from mhsb_tools.study.variations import load_variations

MACHINES = ("mhsb_arm3", "excavator", "forestry_crane", "telescope_arm", "mhsb_arm4")

CHANGE = 0.3
"""Relative change of a field."""

COMPLEMENTED = frozenset(
    {
        "forgetting_factor",
        "min_manifold_pressure_share",
        "open_opening",
        "full_rate_opening",
        "zero_rate_opening",
    }
)
"""Fields near 1, whose distance to 1 is changed instead of the value."""

LOST_MM = 20.0
"""Tip error from which on the arm counts as fallen [mm], as in config/mismatch_benchmark.yaml."""

NEVER = 2**40
"""Number of steps of a window that is never full."""

AS_IT_IS = "as it is"
"""Name of the variant without any change."""

Result = dict[str, float | str]


@dataclass(frozen=True)
class ServoSettings:
    """All tuned numbers of a coordinated servo."""

    controller: CoordinatedSettings = field(default_factory=CoordinatedSettings)
    """Settings of the controller."""
    governor: GovernorSettings = field(default_factory=GovernorSettings)
    """Settings of the reference governor."""

    def apply(self) -> None:
        """Use these settings in all controllers and reference governors that are made from now."""
        CoordinatedController.settings = self.controller
        ModeGuard.settings = self.governor


def change_field(settings: Any, path: Sequence[str], value: float) -> Any:
    """Return a copy of nested settings with another value of one field.

    Args:
        settings: Instance of a settings dataclass.
        path: Names of the fields that lead to the value, outermost first.
        value: The value.

    Returns:
        Instance of the same class.
    """
    first, *rest = path
    return replace(
        settings,
        **{first: change_field(getattr(settings, first), rest, value) if rest else value},
    )


def list_fields(settings: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """List the numbers in nested settings.

    Args:
        settings: Instance of a settings dataclass.
        path: Names of the fields that lead to it.

    Yields:
        Path and value of each number, in the order of the fields.
    """
    for each in fields(settings):
        value = getattr(settings, each.name)
        if is_dataclass(value):
            yield from list_fields(value, (*path, each.name))
        else:
            yield (*path, each.name), value


def scale_value(name: str, value: float, factor: float) -> float:
    """Scale the value of a field; the result is an integer if the value is one.

    Args:
        name: Name of the field.
        value: Its value.
        factor: Factor on the value, or on its distance to 1 for the fields of COMPLEMENTED.

    Returns:
        The new value.
    """
    if name in COMPLEMENTED:
        return 1.0 - (1.0 - value) * factor
    return round(value * factor) if isinstance(value, int) else value * factor


def list_variants() -> dict[str, ServoSettings]:
    """Build all variants of the servo.

    Returns:
        Settings by name: `as it is`, `without valve` and so on for each estimator, and for each
        field its path with ` -30 %` and ` +30 %`.
    """
    usual = ServoSettings()
    pumps = ("controller", "pumps")
    windows = {
        "valve": ("controller", "valves", "window_steps"),
        "lag": ("controller", "lags", "window_steps"),
        "pump": (*pumps, "drives", "window_steps"),
        "line": (*pumps, "lines", "window_steps"),
        "load": ("controller", "cascade", "load", "window_steps"),
    }
    variants = {AS_IT_IS: usual}
    variants |= {
        f"without {name}": change_field(usual, path, NEVER) for name, path in windows.items()
    }
    delay = (*pumps, "draws", "observation_delay")
    variants["without draw"] = change_field(usual, delay, float("inf"))
    for path, value in list_fields(usual):
        for sign, factor in (("-", 1.0 - CHANGE), ("+", 1.0 + CHANGE)):
            name = f"{'.'.join(path)} {sign}{100 * CHANGE:.0f} %"
            variants[name] = change_field(usual, path, scale_value(path[-1], value, factor))
    return variants


def load_draw(
    make_study: Callable[[], DrawStudy], draw: int, file: Path
) -> tuple[PlannedSequence, Machine]:
    """Load the plans and the plant of a draw, or make them and keep them in a file.

    Args:
        make_study: Makes the study that makes draws; called if the file does not exist.
        draw: Number of the draw.
        file: File of this draw.

    Returns:
        Plans and plant.

    Raises:
        MhsbError: The variations do not fit the plant.
    """
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(pickle.dumps(make_study().draw_plant(draw)))
    sequence, plant, _ = pickle.loads(file.read_bytes())
    return sequence, plant


def simulate(machine: Machine, plant: Machine, sequence: PlannedSequence, draw: int) -> Result:
    """Simulate the plans of a draw with the settings in use.

    Args:
        machine: The machine that the servo knows.
        plant: The simulated machine.
        sequence: The plans.
        draw: Number of the draw, which is the seed of the sensors' noise.

    Returns:
        `rms` and `max` of the tip error [mm], `overshoot` of the supply [MPa], number of
        `interventions`, and `held` with a reason if the plan was held until the run ended. If the
        simulation failed, `failure` with a reason alone.
    """
    try:
        run = replay(
            Simulator(machine, seed=draw, plant=plant), sequence.commands, sequence.duration
        )
    except MhsbError as reason:
        return {"failure": str(reason)}
    error = 1e3 * run.tip_error(plant)
    return {
        "rms": float(np.sqrt(np.mean(error**2))),
        "max": float(error.max()),
        "overshoot": float(compute_supply_overshoot(plant, run).max() / 1e6),
        "interventions": float(run.interventions),
        "held": run.hold_reason,
    }


def run(
    output: Annotated[Path, tyro.conf.Positional],
    machines: tuple[str, ...] = MACHINES,
    draws: int = 20,
    seed: int = 1,
    plans: Path = Path("out/ablation_plans"),
    only: str = "",
) -> None:
    """Simulate all variants in all draws, and add the results to a file.

    Args:
        output: JSON file: by machine, draw and variant what `simulate` returns.
        machines: Names of machine files in config.
        draws: Number of draws per machine.
        seed: Seed of the draws.
        plans: Folder in which plans and plants are kept. They depend on machine and seed.
        only: Text that the names of the variants have to contain; empty for all.
    """
    found = json.loads(output.read_text()) if output.exists() else {}
    variants = {k: v for k, v in list_variants().items() if only in k or k == AS_IT_IS}
    known = {name: load_machine(find_config_file(f"{name}.yaml")) for name in machines}

    @cache
    def make_study(name: str) -> DrawStudy:
        return DrawStudy(known[name], load_variations(known[name]), seed)

    for draw in range(draws):
        for name, machine in known.items():
            results = found.setdefault(name, {}).setdefault(str(draw), {})
            missing = [variant for variant in variants if variant not in results]
            if not missing:
                continue
            file = plans / f"{name}_{seed}_{draw}.pkl"
            sequence, plant = load_draw(partial(make_study, name), draw, file)
            for variant in tqdm(missing, desc=f"{name}, draw {draw}"):
                variants[variant].apply()
                results[variant] = simulate(machine, plant, sequence, draw)
                write_json(output, found)
    ServoSettings().apply()


@dataclass(frozen=True)
class Effect:
    """Figures of a variant on one machine, over the draws in which it and the usual servo ran.

    Attributes:
        count: Number of draws.
        median: Change of the median of the tip error's RMS [%].
        p95: Change of its 95 % quantile [%].
        mean_ratio: Change of the geometric mean of its ratio to the usual one [%].
        overshoot: Change of the 95 % quantile of the supply overshoot [MPa].
        falls: Number of draws that fell, failed or were held, less that of the usual servo.
    """

    count: int
    median: float
    p95: float
    mean_ratio: float
    overshoot: float
    falls: int


def has_fallen(result: Result) -> bool:
    """Return whether a run failed, was held, or had a tip error above LOST_MM."""
    return "failure" in result or bool(result["held"]) or float(result["max"]) > LOST_MM


def compare(results: Mapping[str, Mapping[str, Result]], variant: str) -> Effect:
    """Compare a variant with the servo as it is, on one machine.

    Args:
        results: By draw and variant what `simulate` returns.
        variant: Name of the variant.

    Returns:
        Its figures; changes are NaN if no draw has both.
    """
    pairs = [
        (each[AS_IT_IS], each[variant])
        for each in results.values()
        if AS_IT_IS in each and variant in each
    ]
    falls = sum(has_fallen(new) - has_fallen(old) for old, new in pairs)
    both = [pair for pair in pairs if not any("failure" in each for each in pair)]
    if not both:
        return Effect(len(pairs), math.nan, math.nan, math.nan, math.nan, falls)
    old, new = (np.array([float(pair[i]["rms"]) for pair in both]) for i in range(2))
    peaks = [np.quantile([float(pair[i]["overshoot"]) for pair in both], 0.95) for i in range(2)]
    return Effect(
        count=len(pairs),
        median=100.0 * float(np.median(new) / np.median(old) - 1.0),
        p95=100.0 * float(np.quantile(new, 0.95) / np.quantile(old, 0.95) - 1.0),
        mean_ratio=100.0 * float(np.exp(np.mean(np.log(new / old))) - 1.0),
        overshoot=float(peaks[1] - peaks[0]),
        falls=falls,
    )


def report(file: Annotated[Path, tyro.conf.Positional]) -> None:
    """Print the effect of every variant on every machine.

    Args:
        file: JSON file of `run`.
    """
    found = json.loads(file.read_text())
    for machine, results in found.items():
        usual = [each[AS_IT_IS] for each in results.values() if AS_IT_IS in each]
        rms = [float(each["rms"]) for each in usual if "rms" in each]
        print(
            f"{machine}: {len(usual)} draws, RMS median {np.median(rms):.3g} mm, "
            f"p95 {np.quantile(rms, 0.95):.3g} mm, fallen {sum(map(has_fallen, usual))}"
        )
        print(f"  {'variant':58s} N  median      p95     mean  overshoot  falls")
        names = dict.fromkeys(name for each in results.values() for name in each)
        for name in names:
            if name == AS_IT_IS:
                continue
            e = compare(results, name)
            print(
                f"  {name:58s}{e.count:2d} {e.median:+6.1f} % {e.p95:+6.1f} % "
                f"{e.mean_ratio:+6.1f} % {e.overshoot:+6.3f} MPa {e.falls:+3d}"
            )


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({"run": run, "report": report})
