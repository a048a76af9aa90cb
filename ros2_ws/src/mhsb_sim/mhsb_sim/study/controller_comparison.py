"""The coordinated controller beside the independent one, over all scenarios of a study."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from mhsb_sim.study.energy_comparison import Element, total
from mhsb_sim.study.energy_comparison import as_text as energy_text
from mhsb_sim.study.servo_study import ScenarioResult, StudyRecord

SIDES = ("coordinated", "independent")

TRACKED_ERROR = 5.0
"""Energies are compared where both controllers stay within this tip error RMS [mm]."""


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
