"""The command: a folder of figures and numbers, or one sentence."""

from __future__ import annotations

import json
import shutil
import sys

import pytest

from mhsb_tools.report import report_command
from mhsb_tools.report.report_command import format_summary, write_report

FILES = [
    "energy.png",
    "joints.png",
    "modes.png",
    "pressures.png",
    "summary.json",
    "tip_error.png",
    "workspace.png",
]


@pytest.fixture
def call(monkeypatch, capsys):
    """Function (arguments...) that runs the command; exit code, output, errors."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["report", *(str(each) for each in arguments)])
        code = report_command.main()
        return code, *capsys.readouterr()

    return run


def test_the_report_is_written_and_told(story, call, tmp_path):
    code, output, errors = call(story.folder, "--output", tmp_path / "new" / "report")
    assert (code, errors) == (0, "")
    assert sorted(path.name for path in (tmp_path / "new" / "report").iterdir()) == FILES
    assert "goals_accepted: 4\n" in output
    assert "energy_measured_j: mp 110, sp 22\n" in output


def test_a_second_report_replaces_the_first(story, tmp_path):
    (tmp_path / "summary.json").write_text("old")
    (tmp_path / "notes.txt").write_text("mine")
    summary = write_report(story.folder, tmp_path, story.machine)
    assert json.loads((tmp_path / "summary.json").read_text()) == summary
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*FILES, "notes.txt"])


def test_what_is_unknown_is_shown_as_a_dash():
    assert format_summary({"a": None, "b": 0.123456, "c": {"d": None}, "goals": [1]}) == [
        "  a: –",
        "  b: 0.1235",
        "  c: d –",
    ]


def refused(call, tmp_path, *arguments: object) -> str:
    """The sentence of a refusal, after which nothing has been written."""
    code, output, errors = call(*arguments)
    assert (code, output) == (1, "")
    assert errors.startswith("report: ")
    assert errors.count("\n") == 1
    assert not (tmp_path / "report").exists()
    return errors


def test_a_recording_that_is_not_there_is_refused(call, tmp_path):
    sentence = refused(call, tmp_path, tmp_path / "bag", "--output", tmp_path / "report")
    assert "bag is not a folder" in sentence


def test_a_recording_that_was_cut_off_is_refused_with_advice(story, call, tmp_path):
    shutil.copytree(story.folder, tmp_path / "bag")
    (tmp_path / "bag" / "metadata.yaml").unlink()
    sentence = refused(call, tmp_path, tmp_path / "bag", "--output", tmp_path / "report")
    assert "record --repair" in sentence


def test_a_torn_recording_is_refused(story, call, tmp_path):
    shutil.copytree(story.folder, tmp_path / "bag")
    data = tmp_path / "bag" / "bag_0.mcap"
    data.write_bytes(data.read_bytes()[:100_000])
    sentence = refused(call, tmp_path, tmp_path / "bag", "--output", tmp_path / "report")
    assert "bag is damaged: in bag_0.mcap" in sentence


def test_an_output_that_is_a_file_is_refused(story, call, tmp_path):
    (tmp_path / "file").write_text("mine")
    sentence = refused(call, tmp_path, story.folder, "--output", tmp_path / "file")
    assert "file is not a folder; name one for the report" in sentence
    assert (tmp_path / "file").read_text() == "mine"


def test_a_table_that_is_not_there_is_refused(story, call, tmp_path):
    sentence = refused(
        call,
        tmp_path,
        *(story.folder, "--output", tmp_path / "report", "--table", tmp_path / "none.npz"),
    )
    assert "there is no such file" in sentence


def test_a_namespace_that_was_not_recorded_is_refused(story, call, tmp_path):
    sentence = refused(
        call, tmp_path, story.folder, "--output", tmp_path / "report", "--namespace", "/left"
    )
    assert "no messages on /left/joint_states" in sentence


def test_missing_arguments_are_named(call, tmp_path):
    code, _, errors = call(tmp_path)
    assert code == 2
    assert errors == "report: missing --output; see report --help\n"
