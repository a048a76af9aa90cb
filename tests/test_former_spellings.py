"""Former spellings start the subcommands of `mhsb`, and name the new spelling."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mhsb_tools import executables
from mhsb_tools.executables import SUBCOMMAND_TABLE

MOVED = [
    (package, name)
    for package in ("mhsb_model", "mhsb_planner", "mhsb_sim")
    for name, entry in vars(importlib.import_module(f"{package}.executables")).items()
    if getattr(entry, "__qualname__", "").startswith("forward_to_tools.")
]
FORMER = list(executables.FORMER_SPELLINGS.items())
"""Former names of `ros2 run mhsb_tools NAME`, with the subcommands that they start."""


def executable(package: str, name: str) -> str:
    """Return the path of what `ros2 run PACKAGE NAME` starts."""
    prefixes = os.environ["AMENT_PREFIX_PATH"].split(os.pathsep)
    [found] = [path for prefix in prefixes if (path := Path(prefix, "lib", package, name)).exists()]
    return str(found)


def test_all_commands_that_have_moved_are_there_by_both_spellings():
    assert len(MOVED) == 12
    for package, name in MOVED:
        assert executable(package, name) != executable("mhsb_tools", name)


@pytest.mark.parametrize(("package", "name"), MOVED)
def test_a_former_spelling_becomes_the_command_with_all_its_arguments(package, name, tmp_path):
    command = tmp_path / "lib" / "mhsb_tools" / name
    command.parent.mkdir(parents=True)
    command.write_text('#!/bin/sh\nprintf "%s|" $$ "$@"; exit 7\n')
    command.chmod(0o755)
    environment = os.environ | {"AMENT_PREFIX_PATH": str(tmp_path)}
    words = ["--goal", "0.5 0.1", ""]
    child = subprocess.Popen(
        [executable(package, name), *words], env=environment, stdout=subprocess.PIPE, text=True
    )
    said, _ = child.communicate(timeout=60)
    assert child.returncode == 7
    assert said == "|".join([str(child.pid), *words, ""])  # the very process, no child of it


@pytest.mark.parametrize(("name", "new"), FORMER)
def test_a_former_spelling_runs_the_subcommand_and_names_it_on_stderr(
    name, new, monkeypatch, capsys
):
    assert executable("mhsb_tools", name)
    started = (lambda: print(*sys.argv) or 7), ""
    monkeypatch.setitem(SUBCOMMAND_TABLE, new, started)
    monkeypatch.setattr(sys, "argv", [name, "--case", "1-1"])
    assert getattr(executables, name)() == 7
    said = capsys.readouterr()
    assert said.out == f"mhsb {new} --case 1-1\n"
    assert said.err == f"from the next release on this command is only: mhsb {new}\n"


def test_every_former_command_is_a_subcommand():
    assert {new for _, new in FORMER} | {"build-table", "goal"} <= set(SUBCOMMAND_TABLE)
    assert len(FORMER) == 12


def test_without_the_package_of_commands_one_sentence_says_what_is_missing(tmp_path):
    environment = os.environ | {"AMENT_PREFIX_PATH": str(tmp_path)}
    done = subprocess.run(
        [executable("mhsb_sim", "simulate")], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 1
    assert done.stderr.startswith("simulate: this command is part of the package mhsb_tools")
    assert "Traceback" not in done.stderr
