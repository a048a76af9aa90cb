"""A field of a record that a kernel misspells is an error of mypy, wherever that is."""

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
CACHE = ROOT / ".mypy_cache"
SOURCES = ROOT / "ros2_ws" / "src"
PLACES = (
    "mhsb_control/mhsb_control/*.py",
    "mhsb_control/mhsb_control/spools/*.py",
    "mhsb_model/mhsb_model/circuit/*.py",
    "mhsb_sim/mhsb_sim/*/*.py",
    "mhsb_planner/mhsb_planner/search/open_list.py",
    "mhsb_planner/mhsb_planner/search/s2_astar.py",
    "mhsb_planner/mhsb_planner/integrated/deferred_steps.py",
    "mhsb_planner/mhsb_planner/integrated/lattice_points.py",
    "mhsb_planner/mhsb_planner/integrated/lattice_search.py",
)


def fields(tree: ast.Module) -> set[str]:
    """Names of the fields of all records that a file declares, without fields that are records.

    If one of those were misspelt, mypy would not look at the fields behind it.
    """
    return {
        line.target.id
        for node in tree.body
        if isinstance(node, ast.ClassDef) and "Record" in map(ast.unparse, node.bases)
        for line in node.body
        if isinstance(line, ast.AnnAssign)
        and ast.unparse(line.annotation) in ("float", "int", "Int32")
    }


def accesses(tree: ast.Module, names: set[str]) -> set[tuple[int, int, str]]:
    """Where the kernels of a file read or write fields: line, column of the end, name."""
    return {
        (node.end_lineno, node.end_col_offset, node.attr)
        for function in tree.body
        if isinstance(function, ast.FunctionDef)
        and any("kernel" in ast.unparse(decorator) for decorator in function.decorator_list)
        for node in ast.walk(function)
        if isinstance(node, ast.Attribute) and node.attr in names
    }


def test_every_misspelt_field_of_a_record_in_a_kernel_is_an_error_of_mypy(tmp_path):
    pytest.importorskip("mypy")
    files = [file for place in PLACES for file in sorted(SOURCES.glob(place))]
    trees = {file: ast.parse(file.read_text(encoding="utf-8")) for file in files}
    names = set().union(*map(fields, trees.values()))
    options, misspelt = [f"--cache-dir={tmp_path / 'cache'}"], set()
    if CACHE.exists():  # of an earlier run of mypy, for all files that are the same
        shutil.copytree(CACHE, tmp_path / "cache")
    for file, tree in trees.items():
        lines = file.read_bytes().split(b"\n")
        for line, end, name in sorted(accesses(tree, names), reverse=True):
            lines[line - 1] = lines[line - 1][:end] + b"_x" + lines[line - 1][end:]
            misspelt.add((str(file.relative_to(ROOT)), line, f"{name}_x"))
        copy = tmp_path / f"{len(options)}.py"
        copy.write_bytes(b"\n".join(lines))
        options += ["--shadow-file", str(file), str(copy)]
    command = [sys.executable, "-m", "mypy", *options, *map(str, files)]
    checked = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    error = re.compile(r'^([^:]+):(\d+): error: "\w+" has no attribute "(\w+)"', re.MULTILINE)
    reported = {(file, int(line), name) for file, line, name in error.findall(checked.stdout)}
    assert len(misspelt) > 700
    assert misspelt - reported == set(), checked.stdout + checked.stderr
