"""The house: folders are floors, imports go down only, names and docstrings follow one guide."""

import ast
import re
import subprocess
import sys
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MOST_MODULES = 25
MOST_TRIED_AGAIN = 10
FOLDERS = sorted({file.parent for file in ROOT.glob("ros2_ws/src/*/mhsb_*/**/*.py")}, key=str)


def test_imports_go_down_only():
    linter = Path(sys.executable).with_name("lint-imports")
    run = subprocess.run([linter, "--no-logo"], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_no_folder_holds_more_than_25_modules(folder):
    modules = [file.name for file in folder.glob("*.py") if file.name != "__init__.py"]
    assert len(modules) <= MOST_MODULES, sorted(modules)


def test_at_most_ten_tests_are_tried_again():
    """Each of them is marked with a reason."""
    sources = [*ROOT.glob("tests/**/*.py"), *ROOT.glob("ros2_ws/src/*/test/**/*.py")]
    marks = [
        match
        for file in sources
        for match in re.findall(r"mark\.tried_again(\(.*)", file.read_text(encoding="utf-8"))
    ]
    assert len(marks) <= MOST_TRIED_AGAIN
    assert all(mark.startswith('("') for mark in marks), marks


@cache
def modules():
    """All modules of the installed packages with their syntax trees."""
    files = sorted(ROOT.glob("ros2_ws/src/*/mhsb_*/**/*.py"))
    return [(file, ast.parse(file.read_text(encoding="utf-8"))) for file in files]


def test_no_public_class_name_means_two_things():
    places = defaultdict(list)
    for file, tree in modules():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(str(file.relative_to(ROOT)))
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


PREFIXED = {
    "figure_style": "names of colours",
    "names": "names of nodes and services, read as names.STOP_SERVICE",
    "qos": "profiles, read as qos.LATCHED",
    "topics": "topics, read as topics.REFERENCE",
    "executor": "P is how typing's ParamSpec is written",
    "s4_mode_schedule": "N, DB and SB are the paper's names of the modes",
}
"""Modules whose constants may be one word, with the reason."""


def test_a_constants_name_has_a_quantity_and_a_role():
    """Names of one word, such as NEAR or KEPT, say neither; private ones are codes of kernels."""
    single = [
        f"{file.stem}.{name.id}"
        for file, tree in modules()
        if file.stem not in PREFIXED
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        for name in ast.walk(target)
        if isinstance(name, ast.Name) and name.id.isupper() and "_" not in name.id
    ]
    assert single == []


FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)
LONG = 6
"""Lines from which on a function's name alone does not say everything."""
REFERS_BACK = re.compile(r"^(?:Likewise|The same|Those of|As above|So is)\b|\b[Ll]ikewise\b")
ARGUMENT = re.compile(r"^    \*{0,2}(\w+): ", re.MULTILINE)


@cache
def functions():
    """All functions of the installed packages, nested ones included, with places to name."""
    return [
        (f"{file.relative_to(ROOT)}:{node.lineno} {node.name}", node)
        for file, tree in modules()
        for node in ast.walk(tree)
        if isinstance(node, FUNCTION)
    ]


def test_every_function_of_six_lines_and_more_has_a_docstring():
    lengths = {place: node.end_lineno - node.lineno + 1 for place, node in functions()}
    bare = [place for place, node in functions() if ast.get_docstring(node) is None]
    assert len(lengths) > 2000
    assert [place for place in bare if lengths[place] >= LONG] == []


def test_a_docstring_stands_alone_and_names_arguments_as_they_are():
    for place, node in functions():
        text = ast.get_docstring(node) or ""
        assert not REFERS_BACK.search(text), place
        section = re.split(r"\n\w+:\n", text.partition("\nArgs:\n")[2])[0]
        arguments = {each.arg for each in ast.walk(node.args) if isinstance(each, ast.arg)}
        assert set(ARGUMENT.findall(section)) <= arguments, place
