"""The command that builds the posture table."""

import json
import re

import numpy as np
import pytest

from mhsb_model import command_line
from mhsb_model.machine import load_machine
from mhsb_planner.build_table import build_table
from mhsb_planner.errors import TableError
from mhsb_planner.posture.posture_table_cache import cached_table_path
from mhsb_planner.posture.s1_posture_table import PostureTable


def run(*arguments):
    return command_line.run(build_table, [str(word) for word in arguments], name="build_table")


def test_it_writes_a_table_and_prints_what_it_did(machine, tmp_path, capsys):
    path = tmp_path / "table.npz"
    assert run("--output", path, "--spacing", 0.1, "--jobs", 1) == 0
    text = capsys.readouterr().out
    table = PostureTable.load(path, machine, 0.1)
    missing = table.nodes[~table.feasible]
    assert f"{len(table.nodes)} nodes, 23 mode patterns, {table.entries} entries in" in text
    assert f"{len(missing)} nodes have no posture within the joint limits" in text
    assert f"written to {path}" in text


def test_of_many_nodes_without_a_posture_it_names_a_few(machine, tmp_path, capsys):
    bent = machine.with_values({"joints.1.limits.lower": -1.9})
    file, path = tmp_path / "bent.yaml", tmp_path / "table.npz"
    file.write_text(json.dumps(bent.config.model_dump(mode="json")))  # which is YAML, too
    assert run("--machine", file, "--output", path, "--spacing", 0.1, "--jobs", 1) == 0
    [line] = (each for each in capsys.readouterr().out.splitlines() if "no posture" in each)
    table = PostureTable.load(path, bent, 0.1)
    missing = {tuple(node) for node in table.nodes[~table.feasible].tolist()}
    named = re.findall(r"\((\S+), (\S+)\) m", line)
    assert len(missing) > len(named) == 3
    assert line.startswith(f"{len(missing)} nodes have no posture within the joint limits, such as")
    assert {(round(10 * float(x)), round(10 * float(z))) for x, z in named} < missing


def test_it_prints_json(machine, tmp_path, capsys):
    path = tmp_path / "table.npz"
    assert run("--output", path, "--spacing", 0.1, "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    table = PostureTable.load(path, machine)
    assert facts["machine_hash"] == machine.table_hash
    assert facts["entries"] == table.entries
    assert facts["solver"] == "global"
    assert np.allclose(facts["infeasible_nodes_m"], table.nodes[~table.feasible] * 0.1)
    assert facts["seconds"] > 0


def test_it_knows_the_papers_solver_and_keeps_its_table_apart(
    machine, tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert run("--spacing", 0.5, "--solver", "slsqp", "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["solver"] == "slsqp"
    assert facts["output"] == str(cached_table_path(machine, 0.5, "slsqp"))
    assert not cached_table_path(machine, 0.5).exists()


def test_it_tells_what_share_of_its_entries_may_be_short(tmp_path, capsys):
    path = tmp_path / "table.npz"
    assert run("--output", path, "--spacing", 0.5, "--judge", 5) == 0
    assert "of 5 random entries 0 are short of what SLSQP finds from 30" in capsys.readouterr().out
    assert run("--output", path, "--spacing", 0.5, "--judge", 5, "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["judgement"]["most_short"] == pytest.approx(1.0 - 0.05**0.2)
    assert run("--judge", -1) == 2
    assert "--judge must be from 0 to 1e+06 (is -1)" in capsys.readouterr().err


def test_by_default_it_writes_where_the_planner_looks(machine, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert run("--spacing", 0.1) == 0
    assert PostureTable.load(cached_table_path(machine, 0.1), machine, 0.1)


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (("--spacing", "-0.05"), 2, "spacing must be above 0 and at most 1.029 m"),
        (("--jobs", "0"), 2, "--jobs must be from 1 to 4096 (is 0)"),
        (("--solver", "guess"), 2, "global"),
        (("--machine", "none.yaml"), 1, "none.yaml"),
        (("--output", "/dev/null/table.npz"), 1, "cannot be written"),
    ],
)
def test_bad_arguments_give_one_sentence(arguments, code, sentence, capsys):
    assert run("--spacing", 0.2, *arguments) == code
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert sentence in last
    assert last.startswith("build_table: ")


def test_a_machine_that_reaches_no_node_is_refused_and_nothing_is_written(
    machine, tmp_path, capsys
):
    content = machine.config.model_dump(mode="json")
    content["workspace"]["min_radius"] = 1.0
    content["joints"][1]["limits"] = {"lower": -2.5, "upper": -1.3}
    folded = tmp_path / "folded.yaml"
    folded.write_text(json.dumps(content))  # which is YAML, too
    path = tmp_path / "table.npz"
    assert run("--machine", folded, "--output", path) == 1
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert "none of its 39 nodes has a posture within the joint limits" in last
    assert not path.exists()

    arm = load_machine(folded)
    shape = (1, *arm.patterns.shape)
    empty = PostureTable(
        arm.name, arm.table_hash, 0.05, [[20, 0]], arm.patterns, np.full(shape, np.nan),
        np.full(shape[:2], np.nan),
    )  # fmt: skip
    empty.save(path)
    with pytest.raises(TableError, match="holds no posture at all"):
        PostureTable.load(path, arm)
