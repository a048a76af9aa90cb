"""Comparison of the coordinated with the independent controller over all scenarios of a study."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from mhsb_model.types import FloatArray
from mhsb_tools.study.energy_comparison import EnergyPart, sum_parts
from mhsb_tools.study.energy_comparison import as_text as energy_text
from mhsb_tools.study.servo_study import ScenarioResult, StudyRecord

COMPARED_CONTROLLERS = ("coordinated", "independent")

TRACKED_ERROR = 5.0
"""Energies are compared only if both controllers stay within this tip error RMS [mm]."""


def compare(results: Sequence[ScenarioResult]) -> dict[str, Any]:
    """Compare the coordinated controller with the independent one.

    Supply overshoot is the pressure in a supply line beyond what the motion needs; negative values
    count as 0.

    Args:
        results: Results of at least one scenario, each with both controllers.

    Returns:
        A dictionary for JSON. A number "by controller" is a dictionary by name of the controller.

        - scenarios: number of scenarios
        - tip_error_rms_max_mm: largest tip error RMS, by controller
        - tracking_ratio: tip error RMS, independent / coordinated: `least` and `mean` (geometric)
            over the scenarios
        - overshoot_max_mpa, overshoot_mean_mpa: largest and mean supply overshoot, by controller
        - overshoot_ratio: overshoot, coordinated / independent: `of_largest` (ratio of the largest
            values), `of_mean` (ratio of the means) and `worst_scenario` (highest ratio in one
            scenario). Scenarios without overshoot of the independent controller have no ratio; all
            three are None if there are no others
        - energy_ratio: largest energy ratio, coordinated / independent, of the scenarios in which
            both have a tip error RMS of at most 5 mm; None if there is none
        - energy_ratio_scenarios: number of these scenarios
        - planned_ratio: energy of the coordinated controller, planned (reading `series`: servo pump
            in series with the main pump) / simulated: `least` and `largest`
        - energy_elements_j: its planned and simulated energy, part by part, summed over all
            scenarios
        - relief_opened: number of scenarios in which a relief valve opened, by controller
        - goals_refused: a sentence for each refused goal
    """
    pairs = [
        [each.records_by_controller[side] for side in COMPARED_CONTROLLERS] for each in results
    ]
    errors = np.array([[r.tip_error_rms_mm for r in pair] for pair in pairs])
    energies = np.array([[_energy(r) for r in pair] for pair in pairs])
    relief = [sum(r.relief_opened for r in side) for side in zip(*pairs, strict=True)]
    tracking = errors[:, 1] / errors[:, 0]
    tracked = energies[errors.max(axis=1) <= TRACKED_ERROR]
    planned = np.array([a.energy_planned_series_j for a, _ in pairs]) / energies[:, 0]
    return {
        "scenarios": len(pairs),
        "tip_error_rms_max_mm": _by_controller(errors.max(axis=0).tolist()),
        "tracking_ratio": {
            "least": float(tracking.min()),
            "mean": float(np.exp(np.mean(np.log(tracking)))),
        },
        **_compare_overshoot(np.array([[r.supply_overshoot_mpa for r in pair] for pair in pairs])),
        "energy_ratio": max((tracked[:, 0] / tracked[:, 1]).tolist(), default=None),
        "energy_ratio_scenarios": len(tracked),
        "planned_ratio": {"least": float(planned.min()), "largest": float(planned.max())},
        "energy_elements_j": [asdict(element) for element in sum_energies(results)],
        "relief_opened": _by_controller(relief),
        "goals_refused": [reason for result in results for reason in result.refused],
    }


def _compare_overshoot(overshoot: FloatArray) -> dict[str, Any]:
    """Compare the supply overshoot of both controllers.

    Args:
        overshoot: Overshoot [MPa], shape (scenarios, 2): column 0 for the coordinated, column 1 for
            the independent controller. Negative values count as 0.

    Returns:
        `overshoot_max_mpa` and `overshoot_mean_mpa` by controller. `overshoot_ratio`, coordinated /
        independent: `of_largest`, `of_mean` and `worst_scenario` (highest ratio in one scenario).
        Scenarios without overshoot of the independent controller have no ratio. If there are no
        others, all three are None.
    """
    overshoot = overshoot.clip(0.0)
    largest, mean = overshoot.max(axis=0), overshoot.mean(axis=0)
    both = overshoot[overshoot[:, 1] > 0.0]
    return {
        "overshoot_max_mpa": _by_controller(largest.tolist()),
        "overshoot_mean_mpa": _by_controller(mean.tolist()),
        "overshoot_ratio": {
            "of_largest": float(largest[0] / largest[1]) if len(both) else None,
            "of_mean": float(mean[0] / mean[1]) if len(both) else None,
            "worst_scenario": float((both[:, 0] / both[:, 1]).max()) if len(both) else None,
        },
    }


def _by_controller(values: Sequence[float]) -> dict[str, float]:
    """Return the values of both controllers by their names."""
    return dict(zip(COMPARED_CONTROLLERS, values, strict=True))


def as_text(results: Sequence[ScenarioResult], comparison: dict[str, Any]) -> list[str]:
    """Format the results of a servo study as text.

    Args:
        results: Result of each scenario.
        comparison: Result of `compare` for these results.

    Returns:
        Lines without line breaks. First a table with a line for each scenario: RMS and largest tip
        error [mm], supply overshoot [MPa] and energy [J] of both controllers. Then planned and
        simulated energies of the coordinated controller part by part, the other numbers of the
        comparison as JSON, and a line for each refused goal.
    """
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
    lines += ["", "coordinated, all scenarios together:", *energy_text(sum_energies(results)), ""]
    shown = {k: v for k, v in comparison.items() if k not in ("goals_refused", "energy_elements_j")}
    return [*lines, json.dumps(shown), *comparison["goals_refused"]]


def sum_energies(results: Sequence[ScenarioResult]) -> list[EnergyPart]:
    """Return the coordinated controller's planned and simulated energy over all scenarios."""
    return sum_parts(result.elements["coordinated"] for result in results)


def _columns(record: StudyRecord) -> str:
    """Format RMS and largest tip error [mm], overshoot [MPa] and energy [J] of one record."""
    relief = "R" if record.relief_opened else " "
    return (
        f"{record.tip_error_rms_mm:7.2f} {record.tip_error_max_mm:8.2f} "
        f"{record.supply_overshoot_mpa:8.2f}{relief} {_energy(record):7.0f}"
    )


def _energy(record: StudyRecord) -> float:
    """Return the energy of all pumps [J]: main pump's oil and servo pumps' shafts."""
    return record.energy_mp_j + record.energy_sp_j
