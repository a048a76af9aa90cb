"""Counts and quantiles over many draws, each compared with the limit that the suite sets itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mhsb_tools.study.draws import DrawRecord, group_by_controller

MEDIAN_LEVEL, HIGH_LEVEL, WORST_LEVEL = 0.5, 0.95, 1.0
LEVEL_NAMES = {MEDIAN_LEVEL: "median", HIGH_LEVEL: "p95", WORST_LEVEL: "worst"}
"""Name of each quantile."""


@dataclass(frozen=True)
class LimitedFigure:
    """A number over a controller's draws, with its limits.

    Attributes:
        name: Name with the unit.
        value: The number.
        most: Upper limit; infinity if there is none.
        least: Lower limit.
        runs: Number of runs from which the number comes.
    """

    name: str
    value: float
    most: float
    least: float = 0.0
    runs: int = 0

    @property
    def is_within_limits(self) -> bool:
        """True if the number is within its limits."""
        return self.least <= self.value <= self.most


@dataclass(frozen=True)
class CountedDraws:
    """A number of draws that has a limit.

    Attributes:
        name: What is counted.
        holds: Function from a record to a value that is true if the draw counts.
        most: Upper limit; infinity if there is none.
    """

    name: str
    holds: Callable[[DrawRecord], object]
    most: float

    def figures(self, records: Sequence[DrawRecord]) -> list[LimitedFigure]:
        """Count the draws for which the condition holds.

        Args:
            records: Records of one controller, one for each draw.

        Returns:
            A list with one number and its upper limit.
        """
        count = sum(bool(self.holds(record)) for record in records)
        return [LimitedFigure(f"{self.name} [draws]", count, self.most, runs=len(records))]


@dataclass(frozen=True)
class LimitedQuantity:
    """A quantity of which quantiles over the draws have limits.

    Attributes:
        name: Name of the quantity with its unit.
        of: Function from a record to the value, None if the record has none.
        limits: Upper limit of each quantile, by quantile 0 … 1; infinity if there is none.
    """

    name: str
    of: Callable[[DrawRecord], float | None]
    limits: Mapping[float, float]

    def figures(self, records: Sequence[DrawRecord]) -> list[LimitedFigure]:
        """Compute the quantiles of the quantity over the draws.

        Args:
            records: Records of one controller, one for each draw. Records without a value are left
                out.

        Returns:
            A number with its upper limit for each quantile; empty if no record has a value.
        """
        values = [value for record in records if (value := self.of(record)) is not None]
        return [
            LimitedFigure(
                f"{self.name}, {LEVEL_NAMES[q]}",
                float(np.quantile(values, q)),
                most,
                runs=len(values),
            )
            for q, most in self.limits.items()
            if values
        ]


@dataclass(frozen=True)
class PayloadShare:
    """The share of draws whose 95 % interval contains the true payload."""

    def figures(self, records: Sequence[DrawRecord]) -> list[LimitedFigure]:
        """Compute the share of draws whose 95 % interval contains the true payload.

        Args:
            records: Records of one controller, one for each draw. Records without an interval do
                not count.

        Returns:
            A list with one figure: the share [%] with the limits that the study allows (92 … 98).
            Empty if no record has an interval.
        """
        holds = [record.payload_holds for record in records if record.payload_holds is not None]
        if not holds:
            return []
        share = float(100.0 * np.mean(holds))
        return [LimitedFigure("95 % interval holds it [% of draws]", share, 98.0, 92.0, len(holds))]


DRAW_LIMITS = (
    CountedDraws("failed", lambda r: r.failure, 0),
    LimitedQuantity("tip error, largest [mm]", lambda r: r.tip_error_max_mm, {WORST_LEVEL: 20.0}),
    LimitedQuantity(
        "tip error, RMS [mm]",
        lambda r: r.tip_error_rms_mm,
        {MEDIAN_LEVEL: np.inf, HIGH_LEVEL: 2, WORST_LEVEL: 5},
    ),
    LimitedQuantity(
        "largest error over largest speed [s]",
        lambda r: r.rho_s,
        {MEDIAN_LEVEL: 0.01, HIGH_LEVEL: 0.03},
    ),
    LimitedQuantity(
        "supply overshoot [MPa]",
        lambda r: r.supply_overshoot_mpa,
        {HIGH_LEVEL: 0.3, WORST_LEVEL: 1.0},
    ),
    CountedDraws("relief valve opened", lambda r: r.relief_opened, 0),
    LimitedQuantity(
        "arrival later, where flow suffices [%]",
        lambda r: r.later_percent if r.flow_suffices else None,
        {MEDIAN_LEVEL: 2.0, HIGH_LEVEL: 15.0},
    ),
    LimitedQuantity(
        "arrival later, all [%]",
        lambda r: r.later_percent,
        {HIGH_LEVEL: np.inf, WORST_LEVEL: np.inf},
    ),
    LimitedQuantity(
        "spool at rest [% of stroke]",
        lambda r: r.spool_deviation_percent,
        {HIGH_LEVEL: 1, WORST_LEVEL: 1},
    ),
    LimitedQuantity("tip from its goal at rest [mm]", lambda r: r.rest_error_mm, {HIGH_LEVEL: 1.0}),
    LimitedQuantity(
        "payload after 5 s both ways [% off]",
        lambda r: r.payload_error_percent,
        {MEDIAN_LEVEL: 5.0, HIGH_LEVEL: 10.0},
    ),
    PayloadShare(),
    CountedDraws("plan held until stopped", lambda r: r.held, np.inf),
    CountedDraws("guard acted", lambda r: r.interventions, np.inf),
)
"""The limits that the suite sets itself, in the order in which they are printed."""


def compute_figures(records: Sequence[DrawRecord]) -> list[LimitedFigure]:
    """Compute all numbers over the draws of one controller that have limits.

    Args:
        records: The controller's records, one for each draw.

    Returns:
        Counts of draws, quantiles and shares, each with its limits, in the order of `DRAW_LIMITS`.
        A quantile or share is left out if no draw has a value.
    """
    return [figure for limit in DRAW_LIMITS for figure in limit.figures(records)]


def as_text(records: Sequence[DrawRecord]) -> list[str]:
    """Format the numbers of every controller with their limits, and the draws that failed.

    Args:
        records: Records of all draws and controllers.

    Returns:
        Lines without line breaks. Each controller has a line of column titles, then a line for each
        count, quantile or share: name, number of runs, value and limit, with "not held" if the
        value is beyond its limit. At the end is a line for each draw that failed, had refused
        goals, or was ended because the guard (reference governor) held the plan too long.
    """
    lines = []
    for name, own in group_by_controller(records).items():
        lines.append(f"{name:44s}{'runs':>6s}{'value':>10s}  limit")
        for figure in compute_figures(own):
            limit = "" if figure.most == np.inf else f"<= {figure.most:g}"
            if figure.least > 0.0:
                limit = f"{figure.least:g} ... {figure.most:g}"
            verdict = "" if figure.is_within_limits else "  not held"
            lines.append(
                f"  {figure.name:42s}{figure.runs:6d}{figure.value:10.3g}  {limit}{verdict}"
            )
    failures = [(r.draw, r.failure or r.held) for r in records]
    return lines + [f"draw {draw}: {reason}" for draw, reason in sorted(set(failures)) if reason]
