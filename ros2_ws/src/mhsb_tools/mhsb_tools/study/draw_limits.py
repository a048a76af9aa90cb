"""Counts and quantiles over many draws, each compared with the limit that the suite sets itself."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mhsb_tools.study.draws import DrawRecord, group_by_controller

MEDIAN_SUFFIX, HIGH_SUFFIX, WORST_SUFFIX = ", median", ", p95", ", worst"
COUNT_SUFFIX, SHARE_SUFFIX = " [draws]", " [% of draws]"
"""Endings of the names of figures, which name the statistic."""

STATISTIC_FUNCTIONS: Mapping[str, Callable[[Sequence[float]], Any]] = {
    MEDIAN_SUFFIX: np.median,
    HIGH_SUFFIX: lambda values: np.quantile(values, 0.95),
    WORST_SUFFIX: np.max,
    COUNT_SUFFIX: np.sum,
    SHARE_SUFFIX: lambda values: 100.0 * np.mean(values),
}
"""Function that computes each statistic from the values of all draws."""


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
class LimitedQuantity:
    """A quantity of which statistics over the draws have limits.

    Attributes:
        name: Name of the quantity; with its unit if it is no yes or no.
        of: Function from a record to the value, None if the record has none. A yes or no counts as
            1 or 0.
        limits: Upper limit of each statistic, by a key of `STATISTIC_FUNCTIONS`; infinity if there
            is none.
        least: Lower limit of each statistic.
    """

    name: str
    of: Callable[[DrawRecord], float | None]
    limits: Mapping[str, float]
    least: float = 0.0

    def figures(self, records: Sequence[DrawRecord]) -> list[LimitedFigure]:
        """Compute the statistics of the quantity over the draws.

        Args:
            records: Records of one controller, one for each draw. Records without a value are left
                out.

        Returns:
            A number with its limits for each statistic; empty if no record has a value.
        """
        values = [value for record in records if (value := self.of(record)) is not None]
        return [
            LimitedFigure(
                f"{self.name}{statistic}",
                float(STATISTIC_FUNCTIONS[statistic](values)),
                most,
                self.least,
                len(values),
            )
            for statistic, most in self.limits.items()
            if values
        ]


DRAW_LIMITS = (
    LimitedQuantity("failed", lambda r: bool(r.failure), {COUNT_SUFFIX: 0}),
    LimitedQuantity("tip error, largest [mm]", lambda r: r.tip_error_max_mm, {WORST_SUFFIX: 20.0}),
    LimitedQuantity(
        "tip error, RMS [mm]",
        lambda r: r.tip_error_rms_mm,
        {MEDIAN_SUFFIX: np.inf, HIGH_SUFFIX: 2, WORST_SUFFIX: 5},
    ),
    LimitedQuantity(
        "largest error over largest speed [s]",
        lambda r: r.rho_s,
        {MEDIAN_SUFFIX: 0.01, HIGH_SUFFIX: 0.03},
    ),
    LimitedQuantity(
        "supply overshoot [MPa]",
        lambda r: r.supply_overshoot_mpa,
        {HIGH_SUFFIX: 0.3, WORST_SUFFIX: 1.0},
    ),
    LimitedQuantity("relief valve opened", lambda r: bool(r.relief_opened), {COUNT_SUFFIX: 0}),
    LimitedQuantity(
        "arrival later, where flow suffices [%]",
        lambda r: r.later_percent if r.flow_suffices else None,
        {MEDIAN_SUFFIX: 2.0, HIGH_SUFFIX: 15.0},
    ),
    LimitedQuantity(
        "arrival later, all [%]",
        lambda r: r.later_percent,
        {HIGH_SUFFIX: np.inf, WORST_SUFFIX: np.inf},
    ),
    LimitedQuantity(
        "spool at rest [% of stroke]",
        lambda r: r.spool_deviation_percent,
        {HIGH_SUFFIX: 1, WORST_SUFFIX: 1},
    ),
    LimitedQuantity(
        "tip from its goal at rest [mm]", lambda r: r.rest_error_mm, {HIGH_SUFFIX: 1.0}
    ),
    LimitedQuantity(
        "payload after 5 s both ways [% off]",
        lambda r: r.payload_error_percent,
        {MEDIAN_SUFFIX: 5.0, HIGH_SUFFIX: 10.0},
    ),
    LimitedQuantity(
        "95 % interval holds it", lambda r: r.payload_holds, {SHARE_SUFFIX: 98.0}, least=92.0
    ),
    LimitedQuantity("plan held until stopped", lambda r: bool(r.held), {COUNT_SUFFIX: np.inf}),
    LimitedQuantity("guard acted", lambda r: bool(r.interventions), {COUNT_SUFFIX: np.inf}),
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
        count, quantile or share. It has name, number of runs, value and limit, and "not held" if
        the value is beyond its limit. At the end is a line for each draw that failed or had refused
        goals. Draws in which the guard (reference governor) held the plan too long have one, too.
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
