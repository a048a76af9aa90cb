"""The judgement: conditions, records, and the misfit that identification makes small."""

import json
import math
from dataclasses import asdict, replace

import pytest

from mhsb_tools.reproduction.expectations import (
    PAPER_EXPECTATIONS,
    PUBLISHED_ENERGY,
    at_least,
    at_most,
    judge_expectation,
    judge_expectations,
)
from mhsb_tools.reproduction.runs import Run, Runs

IDS = (
    *("1-1", "1-2", "2-1", "2-2", "3-1", "3-2", "4-1", "4-2", "4-3"),
    *("c5.w1", "c5.w2", "c5.zero", "c5.vmax", "c5.w3", "c5.ps25", "c5.ps100", "c5.order"),
    *("e.4-1", "e.4-2", "e.4-3", "e.c5.ps25", "e.c5.ps100"),
)


def swapped(runs, **paths):
    """The runs with other paths under some names."""
    other = {
        name: Run(runs[name].setting, runs[name].machine, path, "" if path else "no path")
        for name, path in paths.items()
    }
    return Runs(runs.machine, runs.tables, {**runs.runs, **other})


def record(runs, name):
    return judge_expectation(next(each for each in PAPER_EXPECTATIONS if each.id == name), runs)


def scaled(path, **factors):
    return replace(path, **{name: factor * getattr(path, name) for name, factor in factors.items()})


def test_every_expectation_is_judged_once(runs):
    found = judge_expectations(runs)
    assert tuple(each.id for each in found) == IDS
    json.dumps([asdict(each) for each in found], allow_nan=False)
    for each in found:
        assert each.met == (each.shortfall == 0.0)
        assert ("missed" in each.sentence) == (not each.met)
        assert all(own["energy_discrete_j"] > 0 for own in each.own.values() if own)


def test_conditions_know_how_far_they_are_from_being_met():
    assert at_least("share", 0.9, 0.9, 0.9).met
    assert at_least("share", 0.45, 0.9, 0.9).shortfall == pytest.approx(0.5)
    assert at_most("ratio", 3.0, 1.0, 0.5).shortfall == 1.0
    assert str(at_most("ratio", 3.0, 1.0, 0.5)) == "ratio 3 (at most 1)"
    nothing = at_most("ratio", math.nan, 1.0, 0.5)
    assert (nothing.met, nothing.shortfall) == (False, 1.0)


def test_published_energies_are_met_within_their_band(runs):
    for name, (run, joules) in PUBLISHED_ENERGY.items():
        path = runs[run].path
        for off, met in ((0.86, True), (1.14, True), (0.84, False), (1.16, False)):
            own = scaled(path, energy=off * joules / path.energy.sum())
            assert record(swapped(runs, **{run: own}), f"e.{name}").met is met


def test_an_energy_order_that_turns_round_is_missed(runs):
    cheap, dear = (scaled(runs["1-1"].path, energy=factor) for factor in (1e-3, 1e3))
    for path, missed in ((dear, True), (cheap, False)):
        found = record(swapped(runs, **{"1-1": path}), "1-1")
        assert ("missed: energy over that of 1-2" in found.sentence) == missed


def test_a_run_without_path_leaves_its_expectations_unmet_and_says_why(runs):
    found = {each.id: each for each in judge_expectations(swapped(runs, **{"1-2": None}))}
    assert not found["1-1"].met
    assert found["1-1"].sentence == "missed: run 1-2 has no path (no path)"
    assert found["1-1"].shortfall == 1.0
    assert found["2-1"] == record(runs, "2-1")
