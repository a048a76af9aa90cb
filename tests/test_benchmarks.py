"""The scripts in `benchmarks` judge records and sources rightly."""

from __future__ import annotations

import ast
import json
import runpy
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"
RECORDS = {
    "arm/table/energy/0": {"cost": 100.0, "trajectory": "aa"},
    "online/arm": {"reports": ["OK"]},
}


@pytest.mark.parametrize(
    ("change", "code", "said"),
    [
        ({}, 0, "2 records equal, 0 different"),
        ({"arm/table/energy/0": {"cost": 101.0, "trajectory": "bb"}}, 1, "1.010000 mean"),
        ({"arm/table/energy/0": {"refused": "NoPathError"}}, 1, "1 lost"),
        ({"more": {"reports": []}}, 1, "more: only in the second record"),
    ],
)
def test_two_records_of_behaviour_are_compared(tmp_path, capsys, change, code, said):
    before, after = tmp_path / "before.json", tmp_path / "after.json"
    before.write_text(json.dumps(RECORDS))
    after.write_text(json.dumps(RECORDS | change))
    compare = runpy.run_path(str(BENCHMARKS / "behaviour.py"))["compare"]
    assert compare(before, after) == code
    assert said in capsys.readouterr().out


def test_statements_branches_and_parameters_are_counted_without_docstrings():
    figures = runpy.run_path(str(BENCHMARKS / "code_figures.py"))
    source = '''
def choose(a, *b, c=None):
    """Choose."""
    if a and b or c:
        return [x for x in b if x]
    return c
'''
    tree = ast.parse(source)
    function = tree.body[0]
    assert figures["count_statements"](tree) == 4  # def, if, two returns
    assert figures["complexity_of"](function) == 5  # 1, if, and, or, comprehension
    assert figures["parameter_count"](function) == 3


def test_fields_of_settings_that_give_an_origin_are_counted_as_tuned():
    figures = runpy.run_path(str(BENCHMARKS / "code_figures.py"))
    source = '''
class LoopSettings:
    """Settings. Origin: none."""
    gain: float = 1.0
    """Gain. Origin: chosen."""
    step: float = 0.1
    """Period."""
class Loop:
    gain: float = 1.0
    """Gain. Origin: chosen."""
'''
    assert list(figures["tuned_numbers_of"](ast.parse(source))) == ["Gain. Origin: chosen."]
