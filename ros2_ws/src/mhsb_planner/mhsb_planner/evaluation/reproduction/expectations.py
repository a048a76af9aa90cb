"""What a faithful run must show, judged by numbers: one function for each expectation.

Each function returns the conditions that its expectation stands for; the expectation is met where
all of them hold. Words of the paper are read by the thresholds below, the same for all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_planner.evaluation.paper_cases import PaperCase
from mhsb_planner.evaluation.reproduction import measures
from mhsb_planner.evaluation.reproduction.conditions import Condition, at_least, at_most
from mhsb_planner.evaluation.reproduction.runs import (
    ENERGY_WEIGHTS,
    PISTON_SPEEDS,
    SWITCH_WEIGHTS,
    TIME_WEIGHTS,
    Progress,
    Runs,
    evaluate,
    pressure_run,
    settings,
    speed_run,
    switch_run,
    weight_run,
)
from mhsb_planner.search.discrete_path import DiscretePath

ALMOST = 0.9
"""`Almost throughout`, `in almost all regions`: at least this share of the time."""

MOSTLY = 0.5
"""`Mostly`, `frequently`: at least this share of the time."""

ONLY = 0.99
"""`Only`: at least this share of the time; what is less would be one short step."""

DETOUR = 1.1
"""A path this many times as long as the shortest one on the grid, or longer, is a detour; one
that is not is `near-straight` or `near-shortest`."""

ASIDE = 0.05
"""One spacing of the grid: a tip that goes further aside than this has done so at all [m]."""

EARLY = 0.25
"""`In the early phase`: this share of the duration."""

CLEARLY = 0.05
"""A quantity that grows or falls by less than this share from one end of a sweep to the other
shows no trend."""

ENERGY_BAND = 0.15
"""Energies count as reproduced within this share of the published ones."""

LAST_FAST_DIRECT = 0.025
"""V_max up to which the paper's path is near-shortest; above it is a detour [m/s]."""

FIRST_SPARING = 16.0
"""w₃ from which the paper's path is a detour."""

PUBLISHED_ENERGY = {
    "4-1": ("4-1", 593.0),
    "4-2": ("4-2", 501.0),
    "4-3": ("4-3", 742.0),
    "c5.ps25": (pressure_run(2.5e6), 1054.0),
    "c5.ps100": (pressure_run(10e6), 1011.0),
}
"""Run and energy [J] of the published energies that are left of the paper."""


class _NoPathOfRunError(Exception):
    """A run that is to be judged has no path."""


def path_of(runs: Runs, name: str) -> DiscretePath:
    """The path of a run that has one."""
    run = runs[name]
    if run.path is None:
        raise _NoPathOfRunError(f"missed: run {name} has no path ({run.failure})")
    return run.path


# --- Conditions that several expectations share --------------------------------------------------


def normal(path: DiscretePath, share: float = ALMOST) -> Condition:
    """No actuator boosted for at least this share of the time."""
    return at_least("share of time in N", measures.normal_share(path), share, share)


def _ratio(runs: Runs, path: DiscretePath) -> float:
    return measures.path_ratio(path, runs.table.spacing)


def direct(runs: Runs, path: DiscretePath) -> Condition:
    """Near-straight, near-shortest."""
    return at_most("length over shortest", _ratio(runs, path), DETOUR, 0.5)


def detour(runs: Runs, path: DiscretePath) -> list[Condition]:
    """A longer way round, with the arm folded."""
    return [
        at_least("length over shortest", _ratio(runs, path), DETOUR, DETOUR - 1.0),
        at_least("tip drawn in by [m]", measures.folding(path), ASIDE, 2 * ASIDE),
    ]


def is_detour(runs: Runs, path: DiscretePath) -> bool:
    """Whether a path of a sweep counts as a detour like that of Case 1-1."""
    return all(condition.met for condition in detour(runs, path))


def less(name: str, value: float, than: float) -> Condition:
    """value < than, as a ratio below 1."""
    return at_most(name, value / than, 1.0 - 1e-9, 0.5)


# --- Cases 1 to 4 --------------------------------------------------------------------------------


def case_1_1(runs: Runs) -> list[Condition]:
    """Energy weights: a detour with the arm folded, N almost throughout, cheaper than 1-2."""
    own, fast = path_of(runs, "1-1"), path_of(runs, "1-2")
    cheaper = less("energy over that of 1-2", measures.energy(own), measures.energy(fast))
    return [*detour(runs, own), normal(own), cheaper]


def case_1_2(runs: Runs) -> list[Condition]:
    """Time weights: near-straight, N first, then SB, faster than 1-1."""
    own, sparing = path_of(runs, "1-2"), path_of(runs, "1-1")
    shared = measures.mode_share(own, Mode.SB, EARLY)
    early = measures.normal_share(own, 0.0, EARLY)
    return [
        direct(runs, own),
        at_least("share of the early time in N", early, MOSTLY, MOSTLY),
        at_least("share of the later time in SB", shared, MOSTLY, MOSTLY),
        less("duration over that of 1-1", measures.duration(own), measures.duration(sparing)),
    ]


def case_2_1(runs: Runs) -> list[Condition]:
    """Lowering: N almost throughout, by the shortest path."""
    own = path_of(runs, "2-1")
    return [normal(own), direct(runs, own)]


def case_2_2(runs: Runs) -> list[Condition]:
    """Lowering further: N almost throughout, slightly outwards, within the arc round the base."""
    own = path_of(runs, "2-2")
    arc = float(np.hypot(*own.tip[0]) - own.tip[0, 0])
    return [
        normal(own),
        at_least("tip goes outwards by [m]", measures.bulge(own), ASIDE, 2 * ASIDE),
        at_most("tip goes outwards by [m]", measures.bulge(own), arc, 2 * ASIDE),
    ]


def case_3_1(runs: Runs) -> list[Condition]:
    """Full range: a folded detour, mostly in N."""
    own = path_of(runs, "3-1")
    return [*detour(runs, own), normal(own, MOSTLY)]


def case_3_2(runs: Runs) -> list[Condition]:
    """Full range to a goal further out: near-shortest, boosted."""
    own = path_of(runs, "3-2")
    boosted = 1.0 - measures.normal_share(own)
    return [direct(runs, own), at_least("share of time boosted", boosted, MOSTLY, MOSTLY)]


def case_4_1(runs: Runs) -> list[Condition]:
    """Proposed method: a larger polytope than the conventional one's, on average over the path."""
    own, *others = (
        float(np.mean(measures.polytope_profile(runs[name].machine, path_of(runs, name))))
        for name in ("4-1", "4-2", "4-3")
    )
    return [
        at_least(f"polytope over that of {name}", own / other, 1.0 + 1e-9, 0.5)
        for name, other in zip(("4-2", "4-3"), others, strict=True)
    ]


def case_4_2(runs: Runs) -> list[Condition]:
    """Conventional method from a good J3: least energy of the three, as J3 hardly moves."""
    own, proposed = path_of(runs, "4-2"), path_of(runs, "4-1")
    travel = measures.joint_travel(own, 2) / measures.joint_travel(proposed, 2)
    return [
        less("energy over that of 4-1", measures.energy(own), measures.energy(proposed)),
        at_most("J3's travel over that of 4-1", travel, 1.0 - 1e-9, 0.5),
    ]


def case_4_3(runs: Runs) -> list[Condition]:
    """Conventional method from a bad J3: most energy of the three, as J3 has to change a lot."""
    own, proposed, good = (path_of(runs, name) for name in ("4-3", "4-1", "4-2"))
    most = max(measures.energy(proposed), measures.energy(good))
    travel = measures.joint_travel(good, 2) / max(measures.joint_travel(own, 2), 1e-9)
    return [
        less("energy of the others over its own", most, measures.energy(own)),
        at_most("J3's travel in 4-2 over its own", travel, 1.0 - 1e-9, 0.5),
    ]


# --- Case 5 --------------------------------------------------------------------------------------


def _over_weights(
    runs: Runs, measure: Callable[[DiscretePath], float]
) -> np.ndarray:
    """A measure of all runs of Figure 10, float64[w₁, w₂]."""
    return np.array(
        [
            [measure(path_of(runs, weight_run(w1, w2))) for w2 in TIME_WEIGHTS]
            for w1 in ENERGY_WEIGHTS
        ]
    )


def _trend(name: str, first: np.ndarray, last: np.ndarray, sign: float) -> Condition:
    """How much a mean grows (sign 1) or falls (−1) from one end of a sweep to the other."""
    change = sign * (float(np.mean(last)) / float(np.mean(first)) - 1.0)
    return at_least(name, change, CLEARLY, 2 * CLEARLY)


def energy_weight(runs: Runs) -> list[Condition]:
    """w₁ up: energy down, path longer. The run with both weights at 0 is another expectation's."""
    energy = _over_weights(runs, measures.energy)[:, 1:]
    length = _over_weights(runs, lambda path: path.length)[:, 1:]
    rise = float(np.max(np.diff(energy, axis=0) / energy[:-1], initial=0.0))
    return [
        at_most("largest rise of energy with w1", rise, 1e-9, CLEARLY),
        _trend("fall of energy with w1", energy[0], energy[-1], -1.0),
        _trend("rise of length with w1", length[0], length[-1], 1.0),
    ]


def time_weight(runs: Runs) -> list[Condition]:
    """w₂ up: time down."""
    time = _over_weights(runs, measures.duration)[1:]
    rise = float(np.max(np.diff(time, axis=1) / time[:, :-1], initial=0.0))
    return [
        at_most("largest rise of time with w2", rise, 1e-9, CLEARLY),
        _trend("fall of time with w2", time[:, 0], time[:, -1], -1.0),
    ]


def weights_of_zero(runs: Runs) -> list[Condition]:
    """Both weights 0, published search: almost a straight line, most energy and most time."""
    own = path_of(runs, weight_run(0.0, 0.0))
    conditions = [at_most("distance from a straight line [m]", measures.sideways(own), ASIDE, 0.2)]
    for name, measure in (("energy", measures.energy), ("time", measures.duration)):
        largest = float(_over_weights(runs, measure).max())
        conditions.append(at_least(f"{name} over the largest", measure(own) / largest, 1.0, 0.5))
    return conditions


def _kept(runs: Runs, names_with_detour: Mapping[str, bool]) -> Condition:
    """Share of a sweep's runs that take the way, direct or detour, which the paper says."""
    right = [
        is_detour(runs, path_of(runs, name)) == expected
        for name, expected in names_with_detour.items()
    ]
    return at_least("share of runs as published", float(np.mean(right)), 1.0, 1.0)


def piston_speed(runs: Runs) -> list[Condition]:
    """V_max 6 … 30 mm/s with the weights of 1-2: direct up to 25 mm/s, a detour above."""
    expected = {speed_run(v): v > LAST_FAST_DIRECT for v in PISTON_SPEEDS}
    return [_kept(runs, expected)]


def switch_weight(runs: Runs) -> list[Condition]:
    """w₃ 0 … 20 with the other weights of 1-2: direct below 16, a detour from there."""
    expected = {switch_run(w3): w3 >= FIRST_SPARING for w3 in SWITCH_WEIGHTS}
    return [_kept(runs, expected)]


def low_pressure(runs: Runs) -> list[Condition]:
    """P_S 2.5 MPa: boost only."""
    boosted = 1.0 - measures.normal_share(path_of(runs, pressure_run(2.5e6)))
    return [at_least("share of time boosted", boosted, ONLY, ONLY)]


def high_pressure(runs: Runs) -> list[Condition]:
    """P_S 10 MPa: N only."""
    return [normal(path_of(runs, pressure_run(10e6)), ONLY)]


def pressure_order(runs: Runs) -> list[Condition]:
    """2.5 and 10 MPa both take more energy than 1-1, on near-shortest paths."""
    base = measures.energy(path_of(runs, "1-1"))
    conditions = []
    for supply in (2.5e6, 10e6):
        path, at = path_of(runs, pressure_run(supply)), f"at {supply / 1e6:g} MPa"
        order = less(f"energy of 1-1 over that {at}", base, measures.energy(path))
        conditions += [
            order,
            at_most(f"length over shortest {at}", _ratio(runs, path), DETOUR, 0.5),
        ]
    return conditions


def published_energy(runs: Runs, name: str) -> list[Condition]:
    """The discrete path's energy lies near the published one."""
    run, published = PUBLISHED_ENERGY[name]
    error = abs(measures.energy(path_of(runs, run)) / published - 1.0)
    return [at_most("energy off by a share of", error, ENERGY_BAND, 1.0 - ENERGY_BAND)]


# --- Records -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Expectation:
    """Something the paper says, and the function that judges it.

    runs  the runs whose numbers are told beside it
    """

    id: str
    published: str
    judge: Callable[[Runs], list[Condition]]
    runs: tuple[str, ...]


def _energy_expectation(name: str) -> Expectation:
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

EXPECTATIONS: tuple[Expectation, ...] = (
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
class Record:
    """Judgement of one expectation.

    published   what the paper says
    own         numbers of the runs that it speaks of, by run
    met         whether all conditions hold
    sentence    the conditions with their values, or why there is nothing to judge
    shortfall   0 where met, up to 1 where a condition is wholly missed
    """

    id: str
    published: str
    own: Mapping[str, Mapping[str, float]]
    met: bool
    sentence: str
    shortfall: float


def numbers(runs: Runs, name: str) -> dict[str, float]:
    """A run's own values, for tables; empty where it has no path."""
    path = runs[name].path
    if path is None:
        return {}
    return {
        "energy_discrete_j": measures.energy(path),
        "energy_series_discrete_j": float(path.energy_series.sum()),
        "duration_discrete_s": measures.duration(path),
        "length_m": path.length,
        "lower_bound_j": path.lower_bound,
        "length_over_shortest": _ratio(runs, path),
        "normal_share": measures.normal_share(path),
        "switches": float(path.switches),
    }


def judged(expectation: Expectation, runs: Runs) -> Record:
    """The record of one expectation."""
    own = {name: numbers(runs, name) for name in expectation.runs}
    try:
        conditions = expectation.judge(runs)
    except _NoPathOfRunError as error:
        return Record(expectation.id, expectation.published, own, False, str(error), 1.0)
    missed = [condition for condition in conditions if not condition.met]
    return Record(
        id=expectation.id,
        published=expectation.published,
        own=own,
        met=not missed,
        sentence="; ".join(
            f"{'missed: ' if condition in missed else ''}{condition}" for condition in conditions
        ),
        shortfall=max((condition.shortfall for condition in missed), default=0.0),
    )


def records(runs: Runs) -> list[Record]:
    """Records of all expectations."""
    return [judged(expectation, runs) for expectation in EXPECTATIONS]


def expectations(
    machine: Machine,
    jobs: int | None = None,
    cases: Mapping[str, PaperCase] | None = None,
    progress: Progress | None = None,
) -> list[Record]:
    """Run everything for a machine and judge it; `cases` replaces the paper's."""
    return records(evaluate(machine, settings(cases), jobs, progress))


MISSED = 0.5
"""What an expectation that is just missed adds to the misfit; one wholly missed adds 1."""


def misfit_of(found: list[Record]) -> float:
    """Σ over expectations of 0 where met, else MISSED + (1 − MISSED) · shortfall."""
    return sum(0.0 if r.met else MISSED + (1.0 - MISSED) * r.shortfall for r in found)


def misfit(
    machine: Machine, jobs: int | None = 1, cases: Mapping[str, PaperCase] | None = None
) -> float:
    """How far a machine is from showing what the paper shows; 0 where everything is met.

    For the identification of what the paper does not tell; takes some seconds.
    """
    return misfit_of(expectations(machine, jobs, cases))
