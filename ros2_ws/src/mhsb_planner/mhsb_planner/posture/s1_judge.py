"""Quality of a posture table, from a comparison of random entries with SLSQP, the paper's solver.

SLSQP runs from many random starts. An entry is short if its polytope area is smaller than the area
that SLSQP finds, by more than MAX_AREA_SHORTFALL. If k of N random entries are short, p is an upper
bound on the share of short entries in the whole table, with CONFIDENCE_LEVEL. p solves P(at most k
of N are short) = 1 − CONFIDENCE_LEVEL. So p is a quantile of the beta distribution; for k = 0, p =
1 − (1 − CONFIDENCE_LEVEL)^(1/N).

Source: C. J. Clopper, E. S. Pearson, The Use of Confidence or Fiducial Limits, 1934.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import beta

from mhsb_model.machine import Machine
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.posture.s1_slsqp import find_largest_polytope_by_slsqp

SLSQP_STARTS = 30
"""Number of random starts of SLSQP for each entry."""
MAX_AREA_SHORTFALL = 1e-3
"""Largest relative difference by which an entry's area may be smaller than SLSQP's [-].

An entry with a larger difference counts as short."""

CONFIDENCE_LEVEL = 0.95
"""Confidence of the upper bound on the share of short entries."""


@dataclass(frozen=True)
class TableComparison:
    """Comparison of random table entries with SLSQP.

    Attributes:
        entries: Number of entries compared.
        short_entries: Number of entries whose area is smaller than SLSQP's by more than
            MAX_AREA_SHORTFALL.
        worst_ratio: Least ratio of an entry's area to SLSQP's [-].
    """

    entries: int
    short_entries: int
    worst_ratio: float

    @property
    def short_share_bound(self) -> float:
        """Upper bound on the share of short entries in the whole table, with CONFIDENCE_LEVEL.

        An entry is short if its area is smaller than SLSQP's by more than MAX_AREA_SHORTFALL. The
        bound is that of Clopper and Pearson; it is 1 if all compared entries are short.
        """
        if self.short_entries == self.entries:
            return 1.0
        return float(
            beta.ppf(CONFIDENCE_LEVEL, self.short_entries + 1, self.entries - self.short_entries)
        )

    @property
    def sentence(self) -> str:
        """The result as one sentence for people."""
        return (
            f"of {self.entries} random entries {self.short_entries} are short of what SLSQP finds "
            f"from {SLSQP_STARTS} starts by more than {100 * MAX_AREA_SHORTFALL:g} % (the least "
            f"has {self.worst_ratio:.9f} of it): with {100 * CONFIDENCE_LEVEL:g} % confidence at "
            f"most {100 * self.short_share_bound:.2g} % of all entries are"
        )


def compare_with_slsqp(
    machine: Machine,
    table: PostureTable,
    entries: int,
    seed: int = 0,
    progress: Callable[[int], object] = lambda done: None,
) -> TableComparison:
    """Compare random entries of a posture table with an optimisation by SLSQP from many starts.

    Args:
        machine: The arm without a slewing joint.
        table: The table.
        entries: Number of random entries to compare, at least 1. An entry may occur more than once.
            Nodes without a posture are not drawn.
        seed: Seed of the random choice of nodes and mode combinations.
        progress: Called with the number of finished entries.

    Returns:
        Result of the comparison. An entry for which SLSQP finds no posture counts as equal.
    """
    random, ratios = np.random.default_rng(seed), []
    for done, node in enumerate(random.choice(np.flatnonzero(table.feasible), entries), start=1):
        p = int(random.integers(len(table.patterns)))
        x, z = (table.nodes[node] * table.spacing).tolist()
        found = find_largest_polytope_by_slsqp(
            machine, x, z, table.patterns[p], seed=p, starts=SLSQP_STARTS
        )
        ratios.append(1.0 if found is None else float(table.area[node, p]) / found[1])
        progress(done)
    short = sum(ratio < 1.0 - MAX_AREA_SHORTFALL for ratio in ratios)
    return TableComparison(entries, short, min(ratios))
