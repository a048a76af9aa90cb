"""Figures of many draws, each beside the limit that the suite sets itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mhsb_sim.servo import CONTROLLERS
from mhsb_sim.study.draws import DrawRecord

MEDIAN, HIGH, WORST = 0.5, 0.95, 1.0
QUANTILE = {MEDIAN: "median", HIGH: "p95", WORST: "worst"}


@dataclass(frozen=True)
class Figure:
    """A number of a controller's draws, the most and least that it may be, and of how many runs."""

    name: str
    value: float
    most: float
    least: float = 0.0
    runs: int = 0

    @property
    def holds(self) -> bool:
        """Whether it is within its limits."""
        return self.least <= self.value <= self.most


def figures_of(records: Sequence[DrawRecord]) -> list[Figure]:
    """All figures of one controller; those that no run tells are left out."""
    found = [Figure("failed [draws]", sum(bool(r.failure) for r in records), 0, runs=len(records))]

    def add(
        name: str, of: Callable[[DrawRecord], float | None], limits: dict[float, float]
    ) -> None:
        values = [value for record in records if (value := of(record)) is not None]
        found.extend(
            Figure(f"{name}, {QUANTILE[q]}", float(np.quantile(values, q)), most, runs=len(values))
            for q, most in limits.items()
            if values
        )

    add("tip error, largest [mm]", lambda r: r.tip_error_max_mm, {WORST: 20.0})
    add("tip error, RMS [mm]", lambda r: r.tip_error_rms_mm, {MEDIAN: np.inf, HIGH: 2, WORST: 5})
    add("largest error over largest speed [s]", lambda r: r.rho_s, {MEDIAN: 0.01, HIGH: 0.03})
    add("supply overshoot [MPa]", lambda r: r.supply_overshoot_mpa, {HIGH: 0.3, WORST: 1.0})
    relief = sum(bool(record.relief_opened) for record in records)
    found.append(Figure("relief valve opened [draws]", relief, 0, runs=len(records)))
    add(
        "arrival later, where flow suffices [%]",
        lambda r: r.later_percent if r.flow_suffices else None,
        {MEDIAN: 2.0, HIGH: 15.0},
    )
    add("arrival later, all [%]", lambda r: r.later_percent, {HIGH: np.inf, WORST: np.inf})
    add("spool at rest [% of stroke]", lambda r: r.spool_deviation_percent, {HIGH: 1, WORST: 1})
    add("tip from its goal at rest [mm]", lambda r: r.rest_error_mm, {HIGH: 1.0})
    add(
        "payload after 5 s both ways [% off]",
        lambda r: r.payload_error_percent,
        {MEDIAN: 5.0, HIGH: 10.0},
    )
    holds = [record.payload_holds for record in records if record.payload_holds is not None]
    if holds:
        share = float(100.0 * np.mean(holds))
        found.append(Figure("95 % interval holds it [% of draws]", share, 98.0, 92.0, len(holds)))
    held = sum(bool(record.held) for record in records)
    found.append(Figure("plan held until stopped [draws]", held, np.inf, runs=len(records)))
    guarded = sum(bool(record.interventions) for record in records)
    found.append(Figure("guard acted [draws]", guarded, np.inf, runs=len(records)))
    return found


def as_text(records: Sequence[DrawRecord]) -> list[str]:
    """The draws for a person: every controller's figures beside their limits, and what failed."""
    lines = []
    ran = {record.controller for record in records}
    for name in (name for name in CONTROLLERS if name in ran):
        own = [record for record in records if record.controller == name]
        lines.append(f"{name:44s}{'runs':>6s}{'value':>10s}  limit")
        for figure in figures_of(own):
            limit = "" if figure.most == np.inf else f"<= {figure.most:g}"
            if figure.least > 0.0:
                limit = f"{figure.least:g} ... {figure.most:g}"
            verdict = "" if figure.holds else "  not held"
            lines.append(
                f"  {figure.name:42s}{figure.runs:6d}{figure.value:10.3g}  {limit}{verdict}"
            )
    told = [(r.draw, r.failure or r.held) for r in records]
    return lines + [f"draw {draw}: {reason}" for draw, reason in sorted(set(told)) if reason]
