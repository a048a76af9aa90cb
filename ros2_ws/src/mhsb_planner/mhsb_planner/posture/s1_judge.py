"""How good a posture table is: random entries of it against the paper's solver from many starts.

Of N entries let k be smaller than what SLSQP finds, by more than ALLOWED. The share of such entries
in the whole table then is, with CONFIDENCE, at most the share p with P(at most k of N) = 1 −
CONFIDENCE: a quantile of the beta distribution, 1 − (1 − CONFIDENCE)^(1/N) for k = 0. Source:
C. J. Clopper, E. S. Pearson, The Use of Confidence or Fiducial Limits, 1934.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import beta

from mhsb_model.machine import Machine
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.posture.s1_slsqp import largest_by_slsqp

STARTS = 30
ALLOWED = 1e-3
"""An entry that lacks more of what SLSQP finds, as a share of its area, is short."""

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Judgement:
    """What came of it.

    entries      that were judged
    short        of these, those that are short
    worst_ratio  least area over SLSQP's
    """

    entries: int
    short: int
    worst_ratio: float

    @property
    def most_short(self) -> float:
        """With CONFIDENCE, no greater share of all entries is short."""
        if self.short == self.entries:
            return 1.0
        return float(beta.ppf(CONFIDENCE, self.short + 1, self.entries - self.short))

    @property
    def sentence(self) -> str:
        """All of it, for people."""
        return (
            f"of {self.entries} random entries {self.short} are short of what SLSQP finds from "
            f"{STARTS} starts by more than {100 * ALLOWED:g} % (the least has "
            f"{self.worst_ratio:.9f} of it): with {100 * CONFIDENCE:g} % confidence at most "
            f"{100 * self.most_short:.2g} % of all entries are"
        )


def judged(
    machine: Machine,
    table: PostureTable,
    entries: int,
    seed: int = 0,
    progress: Callable[[int], object] = lambda done: None,
) -> Judgement:
    """So many random entries of a table judged; the same seed gives the same entries.

    machine   in its plane
    progress  called with the number of entries done
    """
    random, ratios = np.random.default_rng(seed), []
    for done, node in enumerate(random.choice(np.flatnonzero(table.feasible), entries), start=1):
        p = int(random.integers(len(table.patterns)))
        x, z = (table.nodes[node] * table.spacing).tolist()
        found = largest_by_slsqp(machine, x, z, table.patterns[p], seed=p, starts=STARTS)
        ratios.append(1.0 if found is None else float(table.area[node, p]) / found[1])
        progress(done)
    short = sum(ratio < 1.0 - ALLOWED for ratio in ratios)
    return Judgement(entries, short, min(ratios))
