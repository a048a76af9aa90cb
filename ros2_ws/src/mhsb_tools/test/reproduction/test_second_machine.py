"""What the machine file that was fitted to the published search says of itself."""

import pytest

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_tools.reproduction import measures
from mhsb_tools.reproduction.expectations import PAPER_EXPECTATIONS, judge_expectation
from mhsb_tools.reproduction.runs import evaluate, published_settings, settings

WAYS = {"1-1", "1-2", "2-1", "2-2", "3-1", "3-2"}


@pytest.fixture(scope="module")
def found():
    machine = load_machine(find_config_file("mhsb_arm3_published.yaml"))
    asked = settings() | published_settings()
    wanted = {name for case in (*WAYS, "4-1") for name in (case, f"{case} published 1")}
    return evaluate(machine, {name: asked[name] for name in wanted})


def test_of_cases_1_to_3_it_shows_all_but_the_folding_by_the_published_search(found):
    published = found.by_published_search()
    judgements = [
        judge_expectation(each, published) for each in PAPER_EXPECTATIONS if each.id in WAYS
    ]
    assert {each.id for each in judgements if not each.met} == {"1-1"}
    [detour] = (each for each in judgements if each.id == "1-1")
    assert detour.sentence.count("missed") == 1
    assert "missed: tip drawn in by" in detour.sentence


def test_w3_turns_at_5_8_by_both_searches(found):
    for runs in (found, found.by_published_search()):
        sparing, fast = runs["1-1"].path, runs["1-2"].path
        slower = measures.duration(sparing) - measures.duration(fast)
        turn = 15.0 * slower / (fast.switches - sparing.switches)
        assert turn == pytest.approx(5.78, abs=0.01)


def test_case_4_1_is_boosted_half_of_its_time_by_the_exact_search_alone(found):
    assert measures.normal_share(found["4-1"].path) == pytest.approx(0.52, abs=0.01)
    assert measures.normal_share(found.by_published_search()["4-1"].path) == 1.0
