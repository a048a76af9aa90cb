"""Find what the paper does not tell of its machine.

    python docs/identification.py MACHINE COUNT [--search exact] [--seed 0] [--out out/identified]

An evolution strategy over the open parameters, from a machine file that is near enough: pins and
bars of the linkages, the joints' limits, flows of valve and main pump, leakage, boost margin, and
the two initial angles of J3 in Case 4. It keeps the ELITE best; each new one is a change of one of
them, or between two of them.

The objective is the misfit of `mhsb_tools.reproduction` by the exact or the published
search, in which Cases 1 to 3 count twice, and UNREACHED for the share of the grid that the arm does
not reach; with --targets also how far w3's turn is from the paper's and Case 4 from being boosted,
and leakage at most LEAKED.
It is found in three stages, Cases 1 to 4, the two supply pressures, the sweeps; what cannot become
one of the best any more is given up. Of the best so far machine.yaml and numbers.yaml are written,
as soon as found. Same arguments, same result.
"""

from __future__ import annotations

import argparse
import copy
import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.schema import MachineConfig
from mhsb_model.types import FloatArray
from mhsb_planner.cases.paper_cases import PaperCase, load_paper_cases
from mhsb_planner.search.s2_search import SEARCH_METHODS, SearchMethod
from mhsb_tools.reproduction import measures, runs
from mhsb_tools.reproduction.expectations import (
    FIRST_SPARING,
    PAPER_EXPECTATIONS,
    ExpectationResult,
    judge_expectation,
)

UNREACHED = 3.0
"""Misfit of a machine that reaches no point of the grid, in expectations."""

TWICE = ("1-1", "1-2", "2-1", "2-2", "3-1", "3-2")

ELITE = 12
CROSSED = 0.3
LARGEST_CHANGE = 1.5
"""How many machines are kept; the share of numbers that may come from another of them; standard
deviation of the largest changes, in units."""

LENGTH, ANGLE, FLOW, SHARE = 0.06, 0.08, 0.15, 0.1
"""Units of change: of lengths and flows in their logarithm, of angles in rad, of shares of J3's
range."""

HIGHEST = {"boost_margin": 1.2e6, "leakage_flow": 4e-6, "rated_flow": 1e-4, "max_flow": 1e-4}
"""Bounds [Pa, m³/s]: a margin of 30 % of the supply pressure, small valves and pumps."""

LEAKED = 2.6e-6
"""Bound of the leakage that goes with the targets: of valves of that size (docs) [m³/s]."""

BOOSTED = 0.25
"""Case 4 counts as boosted from this share of its time on, on average over its three runs."""

FAR = 2.0
"""Factor e² on w₃'s turn, to either side, that is as far off as can be."""

LENGTHS = ("radius", "rocker_length", "coupler_length")
JOINTS = (0, 1, 2)


def rounded(value: float, digits: int = 4) -> float:
    """Round to the digits that a machine file would have."""
    return float(f"{value:.{digits}g}")


def wrapped(angle: float) -> float:
    """Into −π … π."""
    return rounded((angle + math.pi) % (2.0 * math.pi) - math.pi)


def pins_and_bars(linkage: dict[str, Any]) -> list[tuple[dict[str, Any], str]]:
    """Every number of a linkage, as the mapping that holds it and its key there."""
    found: list[tuple[dict[str, Any], str]] = []
    for key, value in linkage.items():
        if isinstance(value, dict):
            found += [(value, inner) for inner in value]
        elif isinstance(value, float):
            found.append((linkage, key))
    return found


class OpenNumbers:
    """The open numbers of a machine file; a vector of zeros is that file itself."""

    def __init__(
        self, base: dict[str, Any], initial_j3: tuple[float, float], highest: dict[str, float]
    ) -> None:
        self._base, self._initial_j3, self._highest = base, initial_j3, highest
        linkages = sum(len(pins_and_bars(base["joints"][j]["linkage"])) for j in JOINTS)
        self.count = linkages + len(JOINTS) * 4 + 4 + 2

    def content(self, x: FloatArray) -> tuple[dict[str, Any], tuple[float, float]]:
        """Return the changed file, and the initial angles of J3 in Cases 4-2 and 4-3 [rad]."""
        content, left = copy.deepcopy(self._base), iter(x.tolist())
        for j in JOINTS:
            self._change_joint(content["joints"][j], left)
        hydraulics = content["hydraulics"]
        for holder, key in (
            (hydraulics, "boost_margin"),
            (hydraulics["main_pump"], "max_flow"),
            (hydraulics["valve"], "rated_flow"),
            (hydraulics["valve"], "leakage_flow"),
        ):
            value = float(holder[key]) * math.exp(FLOW * next(left))
            holder[key] = rounded(min(value, self._highest[key]), 3)
        limits = content["joints"][2]["limits"]
        good, bad = (
            float(
                np.clip(
                    j3 + SHARE * next(left) * (limits["upper"] - limits["lower"]),
                    limits["lower"],
                    limits["upper"],
                )
            )
            for j3 in self._initial_j3
        )
        return content, (rounded(good, 3), rounded(bad, 3))

    @staticmethod
    def _change_joint(joint: dict[str, Any], left: Any) -> None:
        """Limits, all lengths together, the child's pin about its joint, then each number alone."""
        for limit in ("lower", "upper"):
            joint["limits"][limit] = wrapped(joint["limits"][limit] + ANGLE * next(left))
        scale, turn = math.exp(LENGTH * next(left)), ANGLE * next(left)
        for holder, key in pins_and_bars(joint["linkage"]):
            change = next(left)
            if key in LENGTHS:
                holder[key] = rounded(holder[key] * scale * math.exp(LENGTH * change))
            else:
                also = turn if holder is joint["linkage"]["child_pin"] else 0.0
                holder[key] = wrapped(holder[key] + ANGLE * change + also)


class Objective:
    """Misfit of open numbers, and the best that was met so far."""

    def __init__(
        self, numbers: OpenNumbers, out: Path, method: SearchMethod, targets: bool
    ) -> None:
        self._numbers, self._out = numbers, out
        self._method, self._targets = method, targets
        self.best = math.inf
        self.evaluations = 0
        self._begun = time.monotonic()

    def __call__(self, x: FloatArray, limit: float) -> float:
        """Misfit of the numbers x, at least `limit` where it was given up; ∞ for no machine."""
        content, initial_j3 = self._numbers.content(x)
        try:
            machine = Machine.from_config(MachineConfig.model_validate(content))
            value = self._misfit(machine, _cases(initial_j3), limit)
        except (MhsbError, ValueError):  # rules of the file, of the schema
            return math.inf
        self.evaluations += 1
        if value < min(self.best, limit):
            self.best = value
            self._write(x, content, initial_j3)
        return value

    def _misfit(self, machine: Machine, cases: dict[str, PaperCase], limit: float) -> float:
        """Compute the misfit of a machine, run by run, until it reaches `limit`."""
        asked = runs.settings(cases)
        if self._method == "published":
            asked = {name: replace(each, search="published") for name, each in asked.items()}
        pressures = {name for name in asked if name.startswith("c5.ps")}
        found: runs.Runs | None = None
        total = 0.0
        for stage in (set(cases), pressures, set(asked) - set(cases) - pressures):
            new = runs.evaluate(machine, {name: asked[name] for name in stage}, 1, known=found)
            found = new if found is None else replace(new, runs={**found.runs, **new.runs})
            records = [
                judge_expectation(e, found)
                for e in PAPER_EXPECTATIONS
                if set(e.runs) <= set(found.runs)
            ]
            total = weighted(records) + UNREACHED * (1.0 - float(found.table.feasible.mean()))
            total += off_targets(found) if self._targets else 0.0
            if total >= limit:
                break
        return total

    def _write(
        self, x: FloatArray, content: dict[str, Any], initial_j3: tuple[float, float]
    ) -> None:
        """Write the best machine so far and its numbers as YAML files, and print its misfit."""
        numbers = {"initial_j3": list(initial_j3), "changes": x.tolist()}
        self._out.mkdir(parents=True, exist_ok=True)
        for name, kept in (("machine", content), ("numbers", numbers)):
            (self._out / f"{name}.yaml").write_text(yaml.safe_dump(kept, sort_keys=False))
        spent = time.monotonic() - self._begun
        print(f"{spent:6.0f} s {self.evaluations:5d} machines  misfit {self.best:.3f}", flush=True)


MISSED_PENALTY = 0.5
"""Misfit of an expectation that is just missed; one wholly missed has a misfit of 1."""


def misfit_of(found: list[ExpectationResult]) -> float:
    """Sum over expectations: 0 if met, else MISSED_PENALTY + (1 − MISSED_PENALTY) · shortfall."""
    return sum(
        0.0 if r.met else MISSED_PENALTY + (1.0 - MISSED_PENALTY) * r.shortfall for r in found
    )


def weighted(records: list[ExpectationResult]) -> float:
    """Misfit with TWICE counted twice."""
    return misfit_of(records) + misfit_of([r for r in records if r.id in TWICE])


def turning_weight(found: runs.Runs) -> float:
    """w₃ from which the ways of 1-1 and 1-2 cost the same under the other weights of 1-2.

    w₂ (T₁₁ − T₁₂)/(n₁₂ − n₁₁) with n mode switches; 0 where 1-1's way is as fast, or has as many.
    """
    sparing, fast = found["1-1"].path, found["1-2"].path
    if sparing is None or fast is None or fast.switches <= sparing.switches:
        return 0.0
    slower = measures.duration(sparing) - measures.duration(fast)
    weight = found["1-2"].setting.case.weights.time
    return max(0.0, weight * slower / (fast.switches - sparing.switches))


def boosted_share(found: runs.Runs) -> float:
    """Share of Case 4's time that is boosted, mean of its runs; 0 where one has no path."""
    paths = [found[name].path for name in ("4-1", "4-2", "4-3")]
    shares = [1.0 - measures.normal_share(path) for path in paths if path is not None]
    return float(np.mean(shares)) if len(shares) == len(paths) else 0.0


def off_targets(found: runs.Runs) -> float:
    """0 … 2: how far w₃'s turn is from the paper's, and Case 4 from being boosted."""
    turn = turning_weight(found)
    far = min(1.0, abs(math.log(turn / FIRST_SPARING)) / FAR) if turn > 0.0 else 1.0
    return far + max(0.0, 1.0 - boosted_share(found) / BOOSTED)


def _cases(initial_j3: tuple[float, float]) -> dict[str, PaperCase]:
    cases = load_paper_cases()
    for name, j3 in zip(("4-2", "4-3"), initial_j3, strict=True):
        cases[name] = replace(cases[name], initial_j3=j3)
    return cases


def search(objective: Objective, count: int, rng: np.random.Generator, machines: int) -> None:
    """Run an evolution strategy over `count` numbers until `machines` files are judged."""
    elite = [(objective(np.zeros(count), math.inf), np.zeros(count))]
    while objective.evaluations < machines:
        x = elite[min(int(rng.exponential(2.0)), len(elite) - 1)][1].copy()
        other = elite[rng.integers(len(elite))][1]
        taken = rng.random(count) < CROSSED * (rng.random() < 0.5)
        x[taken] = other[taken]
        step = LARGEST_CHANGE * 10.0 ** -rng.uniform(0.0, 1.5)
        changed = rng.random(count) < rng.choice([0.05, 0.15, 0.4])
        x += np.where(changed, step * rng.normal(size=count), 0.0)
        limit = elite[-1][0] if len(elite) == ELITE else math.inf
        value = objective(x, limit)
        if value < limit:
            elite = sorted([*elite, (value, x)], key=lambda each: each[0])[:ELITE]


def main() -> None:
    """Search for the open numbers of a machine file, and write the best file found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("machine", type=Path, help="machine file to begin with")
    parser.add_argument("count", type=int, help="how many machines to judge; some seconds each")
    parser.add_argument("--search", choices=SEARCH_METHODS, default="exact", help="that is judged")
    parser.add_argument(
        "--targets",
        action="store_true",
        help="also where w3 turns, and a boosted Case 4, with small valves' leakage",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--initial-j3",
        type=float,
        nargs=2,
        default=[load_paper_cases()[name].initial_j3 for name in ("4-2", "4-3")],
        help="where J3 begins in Cases 4-2 and 4-3 [rad]; those of the paper's cases if left out",
    )
    parser.add_argument("--out", type=Path, default=Path("out/identified"))
    asked = parser.parse_args()
    base = yaml.safe_load(asked.machine.read_text(encoding="utf-8"))
    highest = HIGHEST | ({"leakage_flow": LEAKED} if asked.targets else {})
    numbers = OpenNumbers(base, tuple(asked.initial_j3), highest)
    objective = Objective(numbers, asked.out, asked.search, asked.targets)
    search(objective, numbers.count, np.random.default_rng(asked.seed), asked.count)
    print(f"best misfit {objective.best:.3f} after {objective.evaluations} machines")


if __name__ == "__main__":
    main()
