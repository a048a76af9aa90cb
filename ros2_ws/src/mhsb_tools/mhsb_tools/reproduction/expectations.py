"""Expectations: statements of the paper on its cases, each judged by conditions on numbers.

`PAPER_EXPECTATIONS` is the table. An expectation is met if all its conditions hold. The thresholds
below turn the paper's words into numbers and are common to all expectations. "Length over shortest"
is the length of the tip's path over that of the shortest grid path with straight and diagonal
moves. The modes are N (main pump), DB (own booster module) and SB (shared boost line).
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mhsb_model.modes import Mode
from mhsb_planner.integrated.lower_bound import bound_energy_to_goal
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_tools.reproduction import measures
from mhsb_tools.reproduction.runs import (
    ENERGY_WEIGHTS,
    PISTON_SPEEDS,
    SWITCH_WEIGHTS,
    TIME_WEIGHTS,
    Runs,
    pressure_run,
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

BELOW_ONE = 1.0 - 1e-9
"""Upper bound of a ratio that must be less than 1."""

WITHOUT_WEIGHTS = weight_run(0.0, 0.0)
"""Run with weights w₁ = w₂ = 0, by the published search; all others of Figure 10 are exact."""

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


def require_path(runs: Runs, name: str) -> DiscretePath:
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


# --- Conditions ----------------------------------------------------------------------------------

Measure = Callable[[DiscretePath], float]
"""Function from a discrete path to a number, such as `measures.energy`."""

Condition = Callable[[Runs], BoundCheck]
"""Function from all runs to a judged condition.

It raises `_NoPathOfRunError` if a run that it reads has no path."""


def all_of(*conditions: Condition) -> Callable[[Runs], list[BoundCheck]]:
    """Return the function that judges several conditions, in their order."""
    return lambda runs: [condition(runs) for condition in conditions]


def reaches(name: str, run: str, measure: Measure, bound: float, scale: float) -> Condition:
    """Return the condition that a measure of a run is at least `bound` (`BoundCheck`)."""
    return lambda runs: at_least(name, measure(require_path(runs, run)), bound, scale)


def is_less(name: str, measure: Measure, run: str, other: str) -> Condition:
    """Return the condition that the ratio of a measure of two runs is below 1.

    Args:
        name: Name of the ratio.
        measure: The measure.
        run: Run in the numerator.
        other: Run in the denominator.
    """
    return lambda runs: at_most(
        name, measure(require_path(runs, run)) / measure(require_path(runs, other)), BELOW_ONE, 0.5
    )


def is_normal(run: str, share: float = ALMOST_SHARE) -> Condition:
    """Return the condition that all actuators are in mode N for at least `share` of the time."""
    return reaches("share of time in N", run, measures.normal_share, share, share)


def is_boosted(run: str, share: float) -> Condition:
    """Return the condition that an actuator is boosted for at least `share` of the time."""
    return reaches(
        "share of time boosted", run, lambda path: 1.0 - measures.normal_share(path), share, share
    )


def _ratio(runs: Runs, path: DiscretePath) -> float:
    """Return `measures.path_ratio` of a path on the grid of the runs' posture table."""
    return measures.path_ratio(path, runs.table.spacing)


def is_direct(run: str, name: str = "length over shortest") -> Condition:
    """Return the condition that the length over shortest is at most `DETOUR_FACTOR`."""
    return lambda runs: at_most(name, _ratio(runs, require_path(runs, run)), DETOUR_FACTOR, 0.5)


def is_detour(run: str) -> tuple[Condition, Condition]:
    """Return the two conditions of a detour with the arm folded.

    The length over shortest is at least `DETOUR_FACTOR`. The smallest x of the tip is at least
    `ASIDE_DISTANCE` below the x of both ends.
    """
    return (
        lambda runs: at_least(
            "length over shortest",
            _ratio(runs, require_path(runs, run)),
            DETOUR_FACTOR,
            DETOUR_FACTOR - 1.0,
        ),
        reaches("tip drawn in by [m]", run, measures.folding, ASIDE_DISTANCE, 2 * ASIDE_DISTANCE),
    )


def has_larger_polytope(run: str, other: str) -> Condition:
    """Return the condition that a run's mean polytope area over its steps exceeds another run's."""

    def mean_area(runs: Runs, name: str) -> float:
        """Return the mean area of the velocity polytope over the steps of a run [m²/s²]."""
        return float(
            np.mean(measures.compute_polytope_profile(runs[name].machine, require_path(runs, name)))
        )

    return lambda runs: at_least(
        f"polytope over that of {other}",
        mean_area(runs, run) / mean_area(runs, other),
        1.0 + 1e-9,
        0.5,
    )


def repeats_shapes(detours: Mapping[str, bool]) -> Condition:
    """Return the condition that the same runs as in the paper are detours with the arm folded.

    Args:
        detours: Whether the paper's path is such a detour, by the name of the run.

    Returns:
        The condition. Its value is the share of runs that agree with the paper; it must be 1.
    """
    return lambda runs: at_least(
        "share of runs as published",
        float(
            np.mean(
                [
                    all(condition(runs).met for condition in is_detour(name)) == expected
                    for name, expected in detours.items()
                ]
            )
        ),
        1.0,
        1.0,
    )


# --- Conditions of one expectation ---------------------------------------------------------------


def slightly_outwards(runs: Runs) -> BoundCheck:
    """Judge how far the tip of Case 2-2 goes beyond the x of both ends.

    The upper bound is r − x₀, where x₀ is the tip's x at the start and r its distance from the base
    there [m].
    """
    own = require_path(runs, "2-2")
    arc = float(np.hypot(*own.tip[0]) - own.tip[0, 0])
    return at_most("tip goes outwards by [m]", measures.bulge(own), arc, 2 * ASIDE_DISTANCE)


def dearest_of_case_4(runs: Runs) -> BoundCheck:
    """Judge whether Case 4-3 takes more energy than Cases 4-1 and 4-2."""
    own, *others = (measures.energy(require_path(runs, name)) for name in ("4-3", "4-1", "4-2"))
    return at_most("energy of the others over its own", max(others) / own, BELOW_ONE, 0.5)


def _travel_of_joint_3(path: DiscretePath) -> float:
    """Return the sum of the absolute changes of joint 3 [rad]."""
    return measures.joint_travel(path, 2)


def more_travel_than_case_4_2(runs: Runs) -> BoundCheck:
    """Judge whether joint 3 moves more in Case 4-3 than in Case 4-2."""
    own, good = (_travel_of_joint_3(require_path(runs, name)) for name in ("4-3", "4-2"))
    return at_most("J3's travel in 4-2 over its own", good / max(own, 1e-9), BELOW_ONE, 0.5)


def _over_weights(runs: Runs, measure: Measure) -> np.ndarray:
    """Evaluate a measure for all runs of Figure 10.

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
            [measure(require_path(runs, weight_run(w1, w2))) for w2 in TIME_WEIGHTS]
            for w1 in ENERGY_WEIGHTS
        ]
    )


def _never_rises(name: str, values: np.ndarray) -> BoundCheck:
    """Return the condition that no value is larger than the one in the previous row of its column.

    Args:
        name: Name of the condition.
        values: Positive values, shape (rows, columns).

    Returns:
        The condition. Its value is the largest rise from a row to the next, as a share of the
        former; 0 if no value rises.
    """
    rise = float(np.max(np.diff(values, axis=0) / values[:-1], initial=0.0))
    return at_most(name, rise, 1e-9, TREND_SHARE)


def _trend(name: str, values: np.ndarray, sign: float) -> BoundCheck:
    """Return the condition that a mean grows or falls by at least `TREND_SHARE` over a sweep.

    Args:
        name: Name of the condition.
        values: Values with a row for each value of the parameter that is swept.
        sign: 1 requires that the mean grows from the first row to the last, −1 that it falls.

    Returns:
        The condition. Its value is `sign` · (mean of the last row / mean of the first row − 1).
    """
    change = sign * (float(np.mean(values[-1])) / float(np.mean(values[0])) - 1.0)
    return at_least(name, change, TREND_SHARE, 2 * TREND_SHARE)


def energy_weight(runs: Runs) -> list[BoundCheck]:
    """Judge the weight w₁ of energy: a larger one must give less energy and a longer path.

    Runs with weight w₂ = 0 of time are left out, because the run with w₁ = w₂ = 0 belongs to
    another expectation.

    Args:
        runs: All runs of the machine.

    Returns:
        Three conditions. For each w₂, the energy does not rise from one w₁ to the next. From the
        smallest to the largest w₁, the mean energy falls, and the mean path length rises.

    Raises:
        _NoPathOfRunError: A run of Figure 10 has no path.
    """
    energy = _over_weights(runs, measures.energy)[:, 1:]
    return [
        _never_rises("largest rise of energy with w1", energy),
        _trend("fall of energy with w1", energy, -1.0),
        _trend("rise of length with w1", _over_weights(runs, lambda path: path.length)[:, 1:], 1.0),
    ]


def time_weight(runs: Runs) -> list[BoundCheck]:
    """Judge the weight w₂ of time: a larger one must give a shorter duration.

    Runs with weight w₁ = 0 of energy are left out, because the run with w₁ = w₂ = 0 belongs to
    another expectation.

    Args:
        runs: All runs of the machine.

    Returns:
        Two conditions. For each w₁, the duration does not rise from one w₂ to the next. From the
        smallest to the largest w₂, the mean duration falls.

    Raises:
        _NoPathOfRunError: A run of Figure 10 has no path.
    """
    time = _over_weights(runs, measures.duration)[1:].T
    return [
        _never_rises("largest rise of time with w2", time),
        _trend("fall of time with w2", time, -1.0),
    ]


def is_largest(name: str, measure: Measure) -> Condition:
    """Return the condition that the run with w₁ = w₂ = 0 has the largest value of Figure 10.

    Args:
        name: Name of the value.
        measure: Function from a discrete path to the value.
    """
    return lambda runs: at_least(
        f"{name} over the largest",
        measure(require_path(runs, WITHOUT_WEIGHTS)) / float(_over_weights(runs, measure).max()),
        1.0,
        0.5,
    )


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
    """Return the expectation that the energy of a run is within 15 % of the published one.

    Args:
        name: Key of `PUBLISHED_ENERGY`.

    Returns:
        The expectation, named `e.` and the key.
    """
    run, joules = PUBLISHED_ENERGY[name]
    return Expectation(
        f"e.{name}",
        f"{joules:g} J",
        all_of(
            lambda runs: at_most(
                "energy off by a share of",
                abs(measures.energy(require_path(runs, run)) / joules - 1.0),
                ENERGY_BAND,
                1.0 - ENERGY_BAND,
            )
        ),
        (run,),
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
        all_of(
            *is_detour("1-1"),
            is_normal("1-1"),
            is_less("energy over that of 1-2", measures.energy, "1-1", "1-2"),
        ),
        ("1-1", "1-2"),
    ),
    Expectation(
        "1-2",
        "near-straight, N first, then SB; faster than 1-1",
        all_of(
            is_direct("1-2"),
            reaches(
                "share of the early time in N",
                "1-2",
                lambda path: measures.normal_share(path, 0.0, EARLY_SHARE),
                MOSTLY_SHARE,
                MOSTLY_SHARE,
            ),
            reaches(
                "share of the later time in SB",
                "1-2",
                lambda path: measures.mode_share(path, Mode.SB, EARLY_SHARE),
                MOSTLY_SHARE,
                MOSTLY_SHARE,
            ),
            is_less("duration over that of 1-1", measures.duration, "1-2", "1-1"),
        ),
        ("1-2", "1-1"),
    ),
    Expectation(
        "2-1",
        "N almost throughout, shortest path",
        all_of(is_normal("2-1"), is_direct("2-1")),
        ("2-1",),
    ),
    Expectation(
        "2-2",
        "N almost throughout, path slightly outwards",
        all_of(
            is_normal("2-2"),
            reaches(
                "tip goes outwards by [m]",
                "2-2",
                measures.bulge,
                ASIDE_DISTANCE,
                2 * ASIDE_DISTANCE,
            ),
            slightly_outwards,
        ),
        ("2-2",),
    ),
    Expectation(
        "3-1",
        "folded detour, mostly N",
        all_of(*is_detour("3-1"), is_normal("3-1", MOSTLY_SHARE)),
        ("3-1",),
    ),
    Expectation(
        "3-2",
        "near-shortest path, boosted",
        all_of(is_direct("3-2"), is_boosted("3-2", MOSTLY_SHARE)),
        ("3-2",),
    ),
    Expectation(
        "4-1",
        "larger polytope than 4-2 and 4-3",
        all_of(has_larger_polytope("4-1", "4-2"), has_larger_polytope("4-1", "4-3")),
        ("4-1", "4-2", "4-3"),
    ),
    Expectation(
        "4-2",
        "less energy than 4-1, J3 moves less",
        all_of(
            is_less("energy over that of 4-1", measures.energy, "4-2", "4-1"),
            is_less("J3's travel over that of 4-1", _travel_of_joint_3, "4-2", "4-1"),
        ),
        ("4-2", "4-1"),
    ),
    Expectation(
        "4-3",
        "most energy of Case 4, J3 moves more than in 4-2",
        all_of(dearest_of_case_4, more_travel_than_case_4_2),
        ("4-3", "4-1", "4-2"),
    ),
    Expectation("c5.w1", "w1 up: energy down, path longer", energy_weight, _CORNERS),
    Expectation("c5.w2", "w2 up: time down", time_weight, _CORNERS),
    Expectation(
        "c5.zero",
        "almost a straight line, most energy and time",
        all_of(
            lambda runs: at_most(
                "distance from a straight line [m]",
                measures.sideways(require_path(runs, WITHOUT_WEIGHTS)),
                ASIDE_DISTANCE,
                0.2,
            ),
            is_largest("energy", measures.energy),
            is_largest("time", measures.duration),
        ),
        _CORNERS,
    ),
    Expectation(
        "c5.vmax",
        "near-shortest up to 25 mm/s, a detour above",
        all_of(repeats_shapes({speed_run(v): v > LAST_FAST_DIRECT for v in PISTON_SPEEDS})),
        tuple(speed_run(v) for v in PISTON_SPEEDS),
    ),
    Expectation(
        "c5.w3",
        "a detour from w3 = 16 on, near-shortest below",
        all_of(repeats_shapes({switch_run(w3): w3 >= FIRST_SPARING for w3 in SWITCH_WEIGHTS})),
        tuple(switch_run(w3) for w3 in SWITCH_WEIGHTS),
    ),
    Expectation("c5.ps25", "2.5 MPa: boost only", all_of(is_boosted(_LOW[0], ONLY_SHARE)), _LOW),
    Expectation("c5.ps100", "10 MPa: N only", all_of(is_normal(_HIGH[0], ONLY_SHARE)), _HIGH),
    Expectation(
        "c5.order",
        "2.5 and 10 MPa both above 1-1, on near-shortest paths",
        all_of(
            is_less("energy of 1-1 over that at 2.5 MPa", measures.energy, "1-1", _LOW[0]),
            is_direct(_LOW[0], "length over shortest at 2.5 MPa"),
            is_less("energy of 1-1 over that at 10 MPa", measures.energy, "1-1", _HIGH[0]),
            is_direct(_HIGH[0], "length over shortest at 10 MPa"),
        ),
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


def collect_path_values(runs: Runs, name: str) -> dict[str, float]:
    """Collect the values of one run's discrete path, for tables.

    Args:
        runs: All runs of the machine.
        name: Name of the run.

    Returns:
        Values by name, with units at the ends of the names; empty if the run has no path:

        - energy_discrete_j, energy_series_discrete_j: energy, with boosted oil priced as `paper`
            and as `series`
        - duration_discrete_s, length_m: duration, and length of the tip's path
        - lower_bound_j: lower bound on the energy
        - length_over_shortest: length divided by the length of the shortest path on the grid
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
    own = {name: collect_path_values(runs, name) for name in expectation.runs}
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


def judge_expectations(runs: Runs) -> list[ExpectationResult]:
    """Return the judgements of all expectations, in the order of `PAPER_EXPECTATIONS`."""
    return [judge_expectation(expectation, runs) for expectation in PAPER_EXPECTATIONS]
