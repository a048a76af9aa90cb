"""Expectations: statements of the paper on its cases, each judged by numbers in one function.

Each function returns conditions (`BoundCheck`). The expectation is met if all of them hold. The
thresholds below turn the paper's words into numbers and are common to all expectations. "Length
over shortest" is the length of the tip's path over that of the shortest grid path with straight and
diagonal moves. The modes are N (main pump), DB (own booster module) and SB (shared boost line).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_planner.cases.paper_cases import PaperCase
from mhsb_planner.integrated.lower_bound import bound_energy_to_goal
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_tools.reproduction import measures
from mhsb_tools.reproduction.runs import (
    ENERGY_WEIGHTS,
    PISTON_SPEEDS,
    SWITCH_WEIGHTS,
    TIME_WEIGHTS,
    Runs,
    evaluate,
    pressure_run,
    settings,
    speed_run,
    switch_run,
    weight_run,
)

ALMOST_SHARE = 0.9
"""`Almost throughout`, `in almost all regions`: at least this share of the time."""

MOSTLY_SHARE = 0.5
"""`Mostly`, `frequently`: at least this share of the time."""

ONLY_SHARE = 0.99
"""`Only`: at least this share of the time; the rest would be one short step."""

DETOUR_FACTOR = 1.1
"""Path length over that of the shortest grid path from which on a path is a detour; below, it is
`near-straight` or `near-shortest`.
"""

ASIDE_DISTANCE = 0.05
"""Distance from which on the tip counts as having gone aside [m]; one spacing of the grid."""

EARLY_SHARE = 0.25
"""`In the early phase`: the first part of the duration, as a share of it."""

TREND_SHARE = 0.05
"""Least change from one end of a sweep to the other that counts as a trend, as a share."""

ENERGY_BAND = 0.15
"""Largest deviation from a published energy that counts as reproduced, as a share of it."""

LAST_FAST_DIRECT = 0.025
"""V_max up to which the paper's path is near-shortest; above, it is a detour [m/s]."""

FIRST_SPARING = 16.0
"""Weight w₃ from which on the paper's path is a detour."""

PUBLISHED_ENERGY = {
    "4-1": ("4-1", 593.0),
    "4-2": ("4-2", 501.0),
    "4-3": ("4-3", 742.0),
    "c5.ps25": (pressure_run(2.5e6), 1054.0),
    "c5.ps100": (pressure_run(10e6), 1011.0),
}
"""Run name and published energy [J], by the expectation's id without `e.`; all that are left of the
paper.
"""


@dataclass(frozen=True)
class BoundCheck:
    """Condition that a number reaches a bound, or does not exceed it.

    Attributes:
        name: What the number is.
        value: The number; nan misses every bound.
        bound: The bound.
        scale: Distance from the bound at which the condition counts as wholly missed.
        least: True if the bound is a lower bound, False if it is an upper bound.
    """

    name: str
    value: float
    bound: float
    scale: float
    least: bool

    @property
    def met(self) -> bool:
        """True if the condition holds; False for a value that is not a number."""
        return self.value >= self.bound if self.least else self.value <= self.bound

    @property
    def shortfall(self) -> float:
        """Distance of the value from the bound as a share of `scale`, at most 1.

        0 if the condition holds, 1 for nan.
        """
        if self.met:
            return 0.0
        if math.isnan(self.value):
            return 1.0
        return min(1.0, abs(self.value - self.bound) / self.scale)

    def __str__(self) -> str:
        word = "at least" if self.least else "at most"
        return f"{self.name} {self.value:.3g} ({word} {self.bound:.3g})"


def at_least(name: str, value: float, bound: float, scale: float) -> BoundCheck:
    """Return the condition value ≥ bound."""
    return BoundCheck(name, value, bound, scale, least=True)


def at_most(name: str, value: float, bound: float, scale: float) -> BoundCheck:
    """Return the condition value ≤ bound."""
    return BoundCheck(name, value, bound, scale, least=False)


class _NoPathOfRunError(Exception):
    """A run that is to be judged has no path."""


def path_of(runs: Runs, name: str) -> DiscretePath:
    """Return the path of a run, or raise an error if it has none.

    Args:
        runs: All runs of the machine.
        name: Name of the run.

    Returns:
        The path.

    Raises:
        _NoPathOfRunError: The run has no path. `judge_expectation` turns it into a missed
            expectation.
    """
    run = runs[name]
    if run.path is None:
        raise _NoPathOfRunError(f"missed: run {name} has no path ({run.failure})")
    return run.path


# --- Conditions that several expectations share --------------------------------------------------


def normal(path: DiscretePath, share: float = ALMOST_SHARE) -> BoundCheck:
    """Require that all actuators are in mode N for at least `share` of the path's duration."""
    return at_least("share of time in N", measures.normal_share(path), share, share)


def _ratio(runs: Runs, path: DiscretePath) -> float:
    """Return `measures.path_ratio` of a path on the grid of the runs' posture table."""
    return measures.path_ratio(path, runs.table.spacing)


def direct(runs: Runs, path: DiscretePath) -> BoundCheck:
    """Require a length over shortest of at most `DETOUR_FACTOR`."""
    return at_most("length over shortest", _ratio(runs, path), DETOUR_FACTOR, 0.5)


def detour(runs: Runs, path: DiscretePath) -> list[BoundCheck]:
    """Require that a path is a detour with the arm folded.

    Args:
        runs: All runs of the machine, for the grid spacing.
        path: The path.

    Returns:
        Two conditions. The path's length divided by that of the shortest grid path is at least
        `DETOUR_FACTOR`. The smallest x of the tip is at least `ASIDE_DISTANCE` [m] below the x of
        both ends.
    """
    return [
        at_least("length over shortest", _ratio(runs, path), DETOUR_FACTOR, DETOUR_FACTOR - 1.0),
        at_least("tip drawn in by [m]", measures.folding(path), ASIDE_DISTANCE, 2 * ASIDE_DISTANCE),
    ]


def is_detour(runs: Runs, path: DiscretePath) -> bool:
    """Return whether a path counts as a detour with the arm folded, as in Case 1-1."""
    return all(condition.met for condition in detour(runs, path))


def less(name: str, value: float, than: float) -> BoundCheck:
    """Require value < than, written as a ratio below 1."""
    return at_most(name, value / than, 1.0 - 1e-9, 0.5)


# --- Cases 1 to 4 --------------------------------------------------------------------------------


def case_1_1(runs: Runs) -> list[BoundCheck]:
    """Judge Case 1-1, weights for least energy, by four conditions.

    - Detour: the tip's path is at least 1.1 times as long as the shortest path on the grid.
    - Folded: the tip's smallest x is at least 0.05 m below the x of both ends.
    - All actuators are in mode N (fed by the main pump) for at least 90 % of the time.
    - The energy is less than in Case 1-2.

    Args:
        runs: All runs of the machine.

    Returns:
        The conditions; the expectation is met if all hold.

    Raises:
        _NoPathOfRunError: Run 1-1 or 1-2 has no path.
    """
    own, fast = path_of(runs, "1-1"), path_of(runs, "1-2")
    cheaper = less("energy over that of 1-2", measures.energy(own), measures.energy(fast))
    return [*detour(runs, own), normal(own), cheaper]


def case_1_2(runs: Runs) -> list[BoundCheck]:
    """Judge Case 1-2, weights for least time, by four conditions.

    - Near-straight: the tip's path is at most 1.1 times as long as the shortest path on the grid.
    - In the first quarter of the time, all actuators are in mode N (fed by the main pump) for at
      least half of it.
    - In the other three quarters, at least one actuator is in mode SB (fed by several servo pumps)
      for at least half of them.
    - The duration is less than in Case 1-1.

    Args:
        runs: All runs of the machine.

    Returns:
        The conditions; the expectation is met if all hold.

    Raises:
        _NoPathOfRunError: Run 1-1 or 1-2 has no path.
    """
    own, sparing = path_of(runs, "1-2"), path_of(runs, "1-1")
    shared = measures.mode_share(own, Mode.SB, EARLY_SHARE)
    early = measures.normal_share(own, 0.0, EARLY_SHARE)
    return [
        direct(runs, own),
        at_least("share of the early time in N", early, MOSTLY_SHARE, MOSTLY_SHARE),
        at_least("share of the later time in SB", shared, MOSTLY_SHARE, MOSTLY_SHARE),
        less("duration over that of 1-1", measures.duration(own), measures.duration(sparing)),
    ]


def case_2_1(runs: Runs) -> list[BoundCheck]:
    """Judge Case 2-1, in which the tip is lowered, by two conditions.

    - All actuators are in mode N (fed by the main pump) for at least 90 % of the time.
    - The tip's path is at most 1.1 times as long as the shortest path on the grid.

    Args:
        runs: All runs of the machine.

    Returns:
        The conditions; the expectation is met if both hold.

    Raises:
        _NoPathOfRunError: Run 2-1 has no path.
    """
    own = path_of(runs, "2-1")
    return [normal(own), direct(runs, own)]


def case_2_2(runs: Runs) -> list[BoundCheck]:
    """Judge Case 2-2, in which the tip is lowered farther than in 2-1, by three conditions.

    - All actuators are in mode N (fed by the main pump) for at least 90 % of the time.
    - Outwards: the tip's largest x is at least 0.05 m above the x of both ends.
    - Only slightly: it is at most r − x₀ above them, where x₀ is the tip's x at the start and r its
      distance from the base there.

    Args:
        runs: All runs of the machine.

    Returns:
        The conditions; the expectation is met if all hold.

    Raises:
        _NoPathOfRunError: Run 2-2 has no path.
    """
    own = path_of(runs, "2-2")
    arc = float(np.hypot(*own.tip[0]) - own.tip[0, 0])
    return [
        normal(own),
        at_least(
            "tip goes outwards by [m]", measures.bulge(own), ASIDE_DISTANCE, 2 * ASIDE_DISTANCE
        ),
        at_most("tip goes outwards by [m]", measures.bulge(own), arc, 2 * ASIDE_DISTANCE),
    ]


def case_3_1(runs: Runs) -> list[BoundCheck]:
    """Judge Case 3-1, a motion through the full range, by three conditions.

    - Detour: the tip's path is at least 1.1 times as long as the shortest path on the grid.
    - Folded: the tip's smallest x is at least 0.05 m below the x of both ends.
    - All actuators are in mode N (fed by the main pump) for at least half of the time.

    Args:
        runs: All runs of the machine.

    Returns:
        The conditions; the expectation is met if all hold.

    Raises:
        _NoPathOfRunError: Run 3-1 has no path.
    """
    own = path_of(runs, "3-1")
    return [*detour(runs, own), normal(own, MOSTLY_SHARE)]


def case_3_2(runs: Runs) -> list[BoundCheck]:
    """Judge Case 3-2, whose goal is at larger x than that of 3-1, by two conditions.

    - Direct: the tip's path is at most 1.1 times as long as the shortest path on the grid.
    - At least one actuator is boosted for at least half of the time.

    Args:
        runs: All runs of the machine.

    Returns:
        The conditions; the expectation is met if both hold.

    Raises:
        _NoPathOfRunError: Run 3-2 has no path.
    """
    own = path_of(runs, "3-2")
    boosted = 1.0 - measures.normal_share(own)
    return [
        direct(runs, own),
        at_least("share of time boosted", boosted, MOSTLY_SHARE, MOSTLY_SHARE),
    ]


def case_4_1(runs: Runs) -> list[BoundCheck]:
    """Judge Case 4-1: its velocity polytope must be larger than in Cases 4-2 and 4-3.

    Case 4-1 uses the paper's method, 4-2 and 4-3 the conventional one (joint 3 keeps its angle).
    The mean of the polytope's area over the steps of the path is compared.

    Args:
        runs: All runs of the machine.

    Returns:
        Two conditions, one for each comparison; the expectation is met if both hold.

    Raises:
        _NoPathOfRunError: Run 4-1, 4-2 or 4-3 has no path.
    """
    own, *others = (
        float(np.mean(measures.polytope_profile(runs[name].machine, path_of(runs, name))))
        for name in ("4-1", "4-2", "4-3")
    )
    return [
        at_least(f"polytope over that of {name}", own / other, 1.0 + 1e-9, 0.5)
        for name, other in zip(("4-2", "4-3"), others, strict=True)
    ]


def case_4_2(runs: Runs) -> list[BoundCheck]:
    """Judge Case 4-2, the conventional method (joint 3 keeps its angle) from a good angle.

    Both the energy and the travel of joint 3 (sum of its absolute changes) must be less than in
    Case 4-1, the paper's method.

    Args:
        runs: All runs of the machine.

    Returns:
        Two conditions; the expectation is met if both hold.

    Raises:
        _NoPathOfRunError: Run 4-1 or 4-2 has no path.
    """
    own, proposed = path_of(runs, "4-2"), path_of(runs, "4-1")
    travel = measures.joint_travel(own, 2) / measures.joint_travel(proposed, 2)
    return [
        less("energy over that of 4-1", measures.energy(own), measures.energy(proposed)),
        at_most("J3's travel over that of 4-1", travel, 1.0 - 1e-9, 0.5),
    ]


def case_4_3(runs: Runs) -> list[BoundCheck]:
    """Judge Case 4-3, the conventional method (joint 3 keeps its angle) from a bad angle.

    The energy must be more than in Cases 4-1 and 4-2. The travel of joint 3 (sum of its absolute
    changes) must be more than in Case 4-2.

    Args:
        runs: All runs of the machine.

    Returns:
        Two conditions; the expectation is met if both hold.

    Raises:
        _NoPathOfRunError: Run 4-1, 4-2 or 4-3 has no path.
    """
    own, proposed, good = (path_of(runs, name) for name in ("4-3", "4-1", "4-2"))
    most = max(measures.energy(proposed), measures.energy(good))
    travel = measures.joint_travel(good, 2) / max(measures.joint_travel(own, 2), 1e-9)
    return [
        less("energy of the others over its own", most, measures.energy(own)),
        at_most("J3's travel in 4-2 over its own", travel, 1.0 - 1e-9, 0.5),
    ]


# --- Case 5 --------------------------------------------------------------------------------------


def _over_weights(runs: Runs, measure: Callable[[DiscretePath], float]) -> np.ndarray:
    """Evaluate a function of the path for all runs of Figure 10.

    These runs combine each weight w₁ of energy with each weight w₂ of time.

    Args:
        runs: All runs of the machine.
        measure: Function from a discrete path to a number, such as `measures.energy`.

    Returns:
        Values, shape (len(ENERGY_WEIGHTS), len(TIME_WEIGHTS)); rows are w₁, columns are w₂.

    Raises:
        _NoPathOfRunError: One of these runs has no path.
    """
    return np.array(
        [
            [measure(path_of(runs, weight_run(w1, w2))) for w2 in TIME_WEIGHTS]
            for w1 in ENERGY_WEIGHTS
        ]
    )


def _trend(name: str, first: np.ndarray, last: np.ndarray, sign: float) -> BoundCheck:
    """Require that a mean grows, or falls, by at least `TREND_SHARE` over a sweep of a parameter.

    Args:
        name: Name of the condition.
        first: Values at the first value of the parameter.
        last: Values at its last value.
        sign: 1 requires that the mean grows, −1 that it falls.

    Returns:
        The condition. Its value is `sign` · (mean of `last` / mean of `first` − 1).
    """
    change = sign * (float(np.mean(last)) / float(np.mean(first)) - 1.0)
    return at_least(name, change, TREND_SHARE, 2 * TREND_SHARE)


def energy_weight(runs: Runs) -> list[BoundCheck]:
    """Judge the weight w₁ of energy: a larger one must give less energy and a longer path.

    The runs are those of Figure 10, which combine each w₁ with each weight w₂ of time. Runs with w₂
    = 0 are left out, because the run with w₁ = w₂ = 0 belongs to another expectation. The
    conditions are:

    - For each w₂, the energy does not rise from one w₁ to the next.
    - From the smallest to the largest w₁, the mean energy over all w₂ falls by at least 5 %.
    - From the smallest to the largest w₁, the mean path length over all w₂ rises by at least 5 %.

    Args:
        runs: All runs of the machine.

    Returns:
        The conditions; the expectation is met if all hold.

    Raises:
        _NoPathOfRunError: A run of Figure 10 has no path.
    """
    energy = _over_weights(runs, measures.energy)[:, 1:]
    length = _over_weights(runs, lambda path: path.length)[:, 1:]
    rise = float(np.max(np.diff(energy, axis=0) / energy[:-1], initial=0.0))
    return [
        at_most("largest rise of energy with w1", rise, 1e-9, TREND_SHARE),
        _trend("fall of energy with w1", energy[0], energy[-1], -1.0),
        _trend("rise of length with w1", length[0], length[-1], 1.0),
    ]


def time_weight(runs: Runs) -> list[BoundCheck]:
    """Judge the weight w₂ of time: a larger one must give a shorter duration.

    The runs are those of Figure 10, which combine each weight w₁ of energy with each w₂. Runs with
    w₁ = 0 are left out, because the run with w₁ = w₂ = 0 belongs to another expectation. The
    conditions are:

    - For each w₁, the duration does not rise from one w₂ to the next.
    - From the smallest to the largest w₂, the mean duration over all w₁ falls by at least 5 %.

    Args:
        runs: All runs of the machine.

    Returns:
        The conditions; the expectation is met if both hold.

    Raises:
        _NoPathOfRunError: A run of Figure 10 has no path.
    """
    time = _over_weights(runs, measures.duration)[1:]
    rise = float(np.max(np.diff(time, axis=1) / time[:, :-1], initial=0.0))
    return [
        at_most("largest rise of time with w2", rise, 1e-9, TREND_SHARE),
        _trend("fall of time with w2", time[:, 0], time[:, -1], -1.0),
    ]


def weights_of_zero(runs: Runs) -> list[BoundCheck]:
    """Judge the run with weights w₁ = w₂ = 0 of energy and time, by three conditions.

    - The tip is at most 0.05 m away from the straight line through start and goal.
    - The energy is the largest of all runs of Figure 10.
    - The duration is the largest of all runs of Figure 10.

    This run uses the published search; all other runs of Figure 10 use the exact one.

    Args:
        runs: All runs of the machine.

    Returns:
        The conditions; the expectation is met if all hold.

    Raises:
        _NoPathOfRunError: A run of Figure 10 has no path.
    """
    own = path_of(runs, weight_run(0.0, 0.0))
    conditions = [
        at_most("distance from a straight line [m]", measures.sideways(own), ASIDE_DISTANCE, 0.2)
    ]
    for name, measure in (("energy", measures.energy), ("time", measures.duration)):
        largest = float(_over_weights(runs, measure).max())
        conditions.append(at_least(f"{name} over the largest", measure(own) / largest, 1.0, 0.5))
    return conditions


def _kept(runs: Runs, names_with_detour: Mapping[str, bool]) -> BoundCheck:
    """Require that the runs of a sweep have the same kind of path as in the paper.

    The kind is either a detour with the arm folded, or not.

    Args:
        runs: All runs of the machine.
        names_with_detour: By name of each run, whether the paper's path is a detour.

    Returns:
        The condition. Its value is the share of runs whose kind is that of the paper; it must be 1.

    Raises:
        _NoPathOfRunError: One of the runs has no path.
    """
    right = [
        is_detour(runs, path_of(runs, name)) == expected
        for name, expected in names_with_detour.items()
    ]
    return at_least("share of runs as published", float(np.mean(right)), 1.0, 1.0)


def piston_speed(runs: Runs) -> list[BoundCheck]:
    """Judge the sweep over V_max (piston speed for planning) from 6 to 30 mm/s.

    The runs have the weights of Case 1-2. The path must be direct up to 25 mm/s, and a detour
    above.

    Raises:
        _NoPathOfRunError: A run of the sweep has no path.
    """
    expected = {speed_run(v): v > LAST_FAST_DIRECT for v in PISTON_SPEEDS}
    return [_kept(runs, expected)]


def switch_weight(runs: Runs) -> list[BoundCheck]:
    """Judge the sweep over the weight w₃ of mode switches from 0 to 20.

    The other weights are those of Case 1-2. The path must be direct for w₃ below 16, and a detour
    from 16 on.

    Raises:
        _NoPathOfRunError: A run of the sweep has no path.
    """
    expected = {switch_run(w3): w3 >= FIRST_SPARING for w3 in SWITCH_WEIGHTS}
    return [_kept(runs, expected)]


def low_pressure(runs: Runs) -> list[BoundCheck]:
    """Judge the run at the supply pressure P_S = 2.5 MPa.

    For 99 % of the time or more, at least one actuator must be boosted.

    Raises:
        _NoPathOfRunError: A run that is compared has no path.
    """
    boosted = 1.0 - measures.normal_share(path_of(runs, pressure_run(2.5e6)))
    return [at_least("share of time boosted", boosted, ONLY_SHARE, ONLY_SHARE)]


def high_pressure(runs: Runs) -> list[BoundCheck]:
    """Judge P_S = 10 MPa: all actuators are in mode N for at least 99 % of the time.

    Raises:
        _NoPathOfRunError: A run that is compared has no path.
    """
    return [normal(path_of(runs, pressure_run(10e6)), ONLY_SHARE)]


def pressure_order(runs: Runs) -> list[BoundCheck]:
    """Judge the supply pressures P_S = 2.5 and 10 MPa against Case 1-1, by four conditions.

    At each of the two pressures, the energy must be more than in Case 1-1 (same move, the machine's
    own P_S). At each of them, the tip's path must be at most 1.1 times as long as the shortest path
    on the grid.

    Args:
        runs: All runs of the machine.

    Returns:
        The conditions; the expectation is met if all hold.

    Raises:
        _NoPathOfRunError: One of the three runs has no path.
    """
    base = measures.energy(path_of(runs, "1-1"))
    conditions = []
    for supply in (2.5e6, 10e6):
        path, at = path_of(runs, pressure_run(supply)), f"at {supply / 1e6:g} MPa"
        order = less(f"energy of 1-1 over that {at}", base, measures.energy(path))
        conditions += [
            order,
            at_most(f"length over shortest {at}", _ratio(runs, path), DETOUR_FACTOR, 0.5),
        ]
    return conditions


def published_energy(runs: Runs, name: str) -> list[BoundCheck]:
    """Judge whether the energy of a run's discrete path is within 15 % of the published one.

    Args:
        runs: All runs of the machine.
        name: Key of `PUBLISHED_ENERGY`.

    Returns:
        A list with one condition on the relative deviation.

    Raises:
        _NoPathOfRunError: The run has no path.
    """
    run, published = PUBLISHED_ENERGY[name]
    error = abs(measures.energy(path_of(runs, run)) / published - 1.0)
    return [at_most("energy off by a share of", error, ENERGY_BAND, 1.0 - ENERGY_BAND)]


# --- Records -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Expectation:
    """A statement of the paper and the function that judges it.

    Attributes:
        id: Name of the expectation, such as `1-1` or `c5.w1`.
        published: What the paper says, in words.
        judge: Function from all runs to conditions; the expectation is met if all hold.
        runs: Names of the runs whose values are listed beside the judgement.
    """

    id: str
    published: str
    judge: Callable[[Runs], list[BoundCheck]]
    runs: tuple[str, ...]


def _energy_expectation(name: str) -> Expectation:
    """Return the expectation that the energy of a run lies near the published one.

    Args:
        name: Key of `PUBLISHED_ENERGY`.

    Returns:
        The expectation, named `e.` and the key.
    """
    run, joules = PUBLISHED_ENERGY[name]
    return Expectation(
        f"e.{name}", f"{joules:g} J", lambda runs: published_energy(runs, name), (run,)
    )


_CORNERS = tuple(
    weight_run(w1, w2)
    for w1 in (ENERGY_WEIGHTS[0], ENERGY_WEIGHTS[-1])
    for w2 in (TIME_WEIGHTS[0], TIME_WEIGHTS[-1])
)
_LOW, _HIGH = (
    (pressure_run(supply), pressure_run(supply, keep_table=True)) for supply in (2.5e6, 10e6)
)

PAPER_EXPECTATIONS: tuple[Expectation, ...] = (
    Expectation(
        "1-1",
        "a detour with the arm folded, N almost throughout, less energy than 1-2",
        case_1_1,
        ("1-1", "1-2"),
    ),
    Expectation(
        "1-2", "near-straight, N first, then SB; faster than 1-1", case_1_2, ("1-2", "1-1")
    ),
    Expectation("2-1", "N almost throughout, shortest path", case_2_1, ("2-1",)),
    Expectation("2-2", "N almost throughout, path slightly outwards", case_2_2, ("2-2",)),
    Expectation("3-1", "folded detour, mostly N", case_3_1, ("3-1",)),
    Expectation("3-2", "near-shortest path, boosted", case_3_2, ("3-2",)),
    Expectation("4-1", "larger polytope than 4-2 and 4-3", case_4_1, ("4-1", "4-2", "4-3")),
    Expectation("4-2", "less energy than 4-1, J3 moves less", case_4_2, ("4-2", "4-1")),
    Expectation(
        "4-3", "most energy of Case 4, J3 moves more than in 4-2", case_4_3, ("4-3", "4-1", "4-2")
    ),
    Expectation("c5.w1", "w1 up: energy down, path longer", energy_weight, _CORNERS),
    Expectation("c5.w2", "w2 up: time down", time_weight, _CORNERS),
    Expectation(
        "c5.zero", "almost a straight line, most energy and time", weights_of_zero, _CORNERS
    ),
    Expectation(
        "c5.vmax",
        "near-shortest up to 25 mm/s, a detour above",
        piston_speed,
        tuple(speed_run(v) for v in PISTON_SPEEDS),
    ),
    Expectation(
        "c5.w3",
        "a detour from w3 = 16 on, near-shortest below",
        switch_weight,
        tuple(switch_run(w3) for w3 in SWITCH_WEIGHTS),
    ),
    Expectation("c5.ps25", "2.5 MPa: boost only", low_pressure, _LOW),
    Expectation("c5.ps100", "10 MPa: N only", high_pressure, _HIGH),
    Expectation(
        "c5.order",
        "2.5 and 10 MPa both above 1-1, on near-shortest paths",
        pressure_order,
        ("1-1", *_LOW, *_HIGH),
    ),
    *(_energy_expectation(name) for name in PUBLISHED_ENERGY),
)


@dataclass(frozen=True)
class ExpectationResult:
    """Judgement of one expectation.

    Attributes:
        id: Name of the expectation.
        published: What the paper says, in words.
        own: Values of each run that the expectation lists, by run name and value name.
        met: Whether all conditions hold.
        sentence: The conditions with their values, or why nothing can be judged.
        shortfall: Largest `BoundCheck.shortfall` of the conditions, 0 … 1; 0 if all hold.
    """

    id: str
    published: str
    own: Mapping[str, Mapping[str, float]]
    met: bool
    sentence: str
    shortfall: float


def numbers(runs: Runs, name: str) -> dict[str, float]:
    """Collect the values of one run's discrete path, for tables.

    Args:
        runs: All runs of the machine.
        name: Name of the run.

    Returns:
        Values by name, with units at the ends of the names; empty if the run has no path:

        - energy_discrete_j, energy_series_discrete_j: energy in the readings `paper` and `series`,
            two ways to price boosted oil
        - duration_discrete_s, length_m: duration, and length of the tip's path
        - lower_bound_j: lower bound on the energy
        - length_over_shortest: length divided by that of the shortest path on the grid
        - normal_share: share of time with all actuators in mode N (fed by the main pump)
        - switches: number of mode switches
    """
    path = runs[name].path
    if path is None:
        return {}
    return {
        "energy_discrete_j": measures.energy(path),
        "energy_series_discrete_j": float(path.energy_series.sum()),
        "duration_discrete_s": measures.duration(path),
        "length_m": path.length,
        "lower_bound_j": bound_energy_to_goal(
            runs[name].machine, path.posture[0], tuple(path.tip[-1].tolist())
        ),
        "length_over_shortest": _ratio(runs, path),
        "normal_share": measures.normal_share(path),
        "switches": float(path.switches),
    }


def judge_expectation(expectation: Expectation, runs: Runs) -> ExpectationResult:
    """Judge one expectation (statement of the paper).

    Args:
        expectation: The expectation.
        runs: All runs of the machine.

    Returns:
        The judgement. Its shortfall is the largest relative distance of a value from its bound: 0
        if the expectation is met, at most 1. The expectation counts as not met, with shortfall 1,
        if one of its runs has no path.
    """
    own = {name: numbers(runs, name) for name in expectation.runs}
    try:
        conditions = expectation.judge(runs)
    except _NoPathOfRunError as error:
        return ExpectationResult(expectation.id, expectation.published, own, False, str(error), 1.0)
    missed = [condition for condition in conditions if not condition.met]
    return ExpectationResult(
        id=expectation.id,
        published=expectation.published,
        own=own,
        met=not missed,
        sentence="; ".join(
            f"{'missed: ' if condition in missed else ''}{condition}" for condition in conditions
        ),
        shortfall=max((condition.shortfall for condition in missed), default=0.0),
    )


def records(runs: Runs) -> list[ExpectationResult]:
    """Return the judgements of all expectations, in the order of `PAPER_EXPECTATIONS`."""
    return [judge_expectation(expectation, runs) for expectation in PAPER_EXPECTATIONS]


def expectations(
    machine: Machine,
    jobs: int | None = None,
    cases: Mapping[str, PaperCase] | None = None,
) -> list[ExpectationResult]:
    """Run all cases and sweeps of the paper for a machine and judge all expectations.

    Args:
        machine: The arm.
        jobs: Number of threads; None takes one for each processor.
        cases: Cases by name in place of the paper's; None takes the paper's.

    Returns:
        The judgements, in the order of `PAPER_EXPECTATIONS`.
    """
    return records(evaluate(machine, settings(cases), jobs))


MISSED_PENALTY = 0.5
"""Misfit of an expectation that is just missed; one wholly missed has a misfit of 1."""


def misfit_of(found: list[ExpectationResult]) -> float:
    """Return the misfit of judgements, a sum over all expectations.

    An expectation adds 0 if it is met, else MISSED_PENALTY + (1 − MISSED_PENALTY) · shortfall.
    """
    return sum(
        0.0 if r.met else MISSED_PENALTY + (1.0 - MISSED_PENALTY) * r.shortfall for r in found
    )


def misfit(
    machine: Machine, jobs: int | None = 1, cases: Mapping[str, PaperCase] | None = None
) -> float:
    """Compute how far a machine is from meeting all expectations; takes some seconds.

    It is used to identify machine parameters that the paper does not state.

    Args:
        machine: The arm.
        jobs: Number of threads; None takes one for each processor.
        cases: Cases by name in place of the paper's; None takes the paper's.

    Returns:
        0 if all expectations are met. Each missed one adds between MISSED_PENALTY (just missed) and
        1 (wholly missed).
    """
    return misfit_of(expectations(machine, jobs, cases))
