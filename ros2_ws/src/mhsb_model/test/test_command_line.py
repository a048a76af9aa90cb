"""The frame of commands: arguments, one sentence for each problem, exit codes."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Annotated, Literal

import pytest
import tyro

from mhsb_model.command_line import (
    EXIT_USAGE,
    NumberRange,
    run,
    set_interrupt_note,
    without_ros_arguments,
)
from mhsb_model.errors import MachineFileError, MhsbError


def move(
    goal: Annotated[tuple[float, float], tyro.conf.arg(metavar="X Z")],
    search: Literal["exact", "published"] = "exact",
    jobs: int = 1,
    json: bool = False,
) -> None:
    """Move somewhere.

    Args:
        goal: tip position [m]
        search: which search
        jobs: processes to use
        json: print JSON
    """
    print(goal, search, jobs, json)


def send(x: tyro.conf.Positional[float], z: tyro.conf.Positional[float]) -> int:
    """Send a goal.

    Args:
        x: horizontal [m]
        z: vertical [m]
    """
    print(x, z)
    return 7


def point(
    place: Annotated[tuple[float, ...], tyro.conf.Positional, tyro.conf.arg(metavar="X Z [Y]")],
) -> None:
    """Point somewhere.

    Args:
        place: where [m]
    """


@dataclass(frozen=True)
class Group:
    """Options of a group.

    Attributes:
        search: Which search.
    """

    search: int = 0


def grouped(group: Group) -> None:
    """Take a group of options.

    Args:
        group: The group.
    """


def test_several_problems_of_a_machine_file_have_a_line_each(capsys):
    problems = ["joints.0: wrong"]

    def fail() -> None:
        """Fail."""
        raise MachineFileError("arm.yaml", problems)

    assert run(fail, [], name="check") == 1
    assert capsys.readouterr().err == "check: machine file arm.yaml: joints.0: wrong\n"
    problems = [f"joints.{k}: wrong" for k in range(32)]
    assert run(fail, [], name="check") == 1
    first, *others = capsys.readouterr().err.splitlines()
    assert first == "check: machine file arm.yaml:"
    assert [line.strip() for line in others] == [
        *(f"joints.{k}: wrong" for k in range(30)),
        "and 2 more",
    ]


def test_a_command_gets_typed_arguments(capsys):
    assert run(move, ["--goal", "0.5", "0.25", "--jobs", "3", "--json"]) == 0
    assert capsys.readouterr().out == "(0.5, 0.25) exact 3 True\n"


def test_negative_numbers_are_values_of_options(capsys):
    assert run(move, ["--goal", "-0.5", "-1e-3"]) == 0
    assert capsys.readouterr().out.startswith("(-0.5, -0.001)")


def test_negative_numbers_are_positional_values_and_the_exit_code_is_the_commands(capsys):
    assert run(send, ["-0.55", "-.6"]) == 7
    assert capsys.readouterr().out == "-0.55 -0.6\n"


@pytest.mark.parametrize(
    ("command", "arguments", "sentence"),
    [
        (move, ["--goal", "1"], "--goal takes X Z (tip position [m]), not '1'"),
        (move, ["--goal", "1", "x"], "--goal takes X Z (tip position [m]), not '1 x'"),
        (move, ["--goal", "1", "nan"], "--goal takes X Z (tip position [m]), not '1 nan'"),
        (move, [], "missing --goal"),
        (
            move,
            ["--goal", "1", "2", "--jobs"],
            "--jobs takes INT (processes to use), but nothing was given",
        ),
        (
            move,
            ["--goal", "1", "2", "--jobs", "1.5"],
            "--jobs takes INT (processes to use), not '1.5'",
        ),
        (
            move,
            ["--goal", "1", "2", "--search", "quick"],
            "--search takes one of exact, published, not 'quick'",
        ),
        (
            move,
            ["--goal", "1", "2", "--gaol"],
            "not an argument of this command: --gaol; did you mean --goal?",
        ),
        (move, ["--goal", "1", "2", "--qqq", "3"], "not an argument of this command: --qqq 3"),
        (
            grouped,
            ["--serach=1"],
            "not an argument of this command: --serach=1; did you mean --search?",
        ),
        (send, ["1"], "missing Z"),
        (send, ["a", "2"], "X takes NUMBER (horizontal [m]), not 'a'"),
        (send, ["inf", "2"], "X takes NUMBER (horizontal [m]), not 'inf'"),
        (point, ["nan", "0.5"], "PLACE takes X Z [Y] (where [m]), not 'nan 0.5'"),
        (point, ["0.5", "inf"], "PLACE takes X Z [Y] (where [m]), not '0.5 inf'"),
        (send, ["1", "2", "3"], "not an argument of this command: 3"),
    ],
)
def test_a_bad_argument_is_told_in_one_sentence(capsys, command, arguments, sentence):
    assert run(command, arguments, name="move") == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == f"move: {sentence}; see move --help\n"


def test_help_shows_meaning_and_unit_of_every_argument(capsys):
    with pytest.raises(SystemExit) as end:
        run(move, ["--help"])
    assert end.value.code == 0
    printed = capsys.readouterr().out
    assert "--goal X Z" in printed
    assert "tip position [m]" in printed


def look(
    at: tuple[float, float] | None = None,
    search: Literal["exact", "published"] | None = None,
) -> None:
    """Look around.

    Nothing is moved by it, which is told here in a sentence that is longer than a line of eighty
    columns.

    Args:
        at: Where to look, and this is told at such a length that it takes more than one line of the
            source.
        search: Which search.
    """


def stand() -> None:
    """Stand still.

    Raises:
        ValueError: For those who read the code.
    """


def test_help_leaves_out_the_sections_of_a_docstring(capsys):
    with pytest.raises(SystemExit):
        run(stand, ["--help"])
    printed = capsys.readouterr().out
    assert "Stand still." in printed
    assert "ValueError" not in printed


def test_help_is_wrapped_once_and_offers_nothing_that_cannot_be_chosen(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        run(look, ["--help"])
    printed = capsys.readouterr().out
    words = " ".join(printed.replace("│", "").split())
    assert max(map(len, printed.splitlines())) == 80
    assert "in a sentence that is longer than a line of eighty columns." in words
    assert "takes more than one line of the source." in words
    assert "None" not in printed
    assert "--search {exact,published}" in printed


def test_an_error_of_the_suite_is_told_in_one_line_and_fails(capsys):
    def fall() -> None:
        raise MhsbError("the pressure 12 MPa is above\n  10 MPa; lower it")

    assert run(fall, [], name="fall") == 1
    assert capsys.readouterr().err == "fall: the pressure 12 MPa is above 10 MPa; lower it\n"


def test_a_file_that_cannot_be_opened_is_named(capsys, tmp_path):
    def read() -> None:
        (tmp_path / "missing.yaml").read_text()

    assert run(read, [], name="read") == 1
    assert capsys.readouterr().err == f"read: {tmp_path}/missing.yaml: No such file or directory\n"


def test_a_mistake_in_the_program_is_not_hidden_as_bad_usage():
    def slip() -> None:
        raise ValueError("shapes differ")

    with pytest.raises(ValueError, match="shapes differ"):
        run(slip, [])


def test_ros_arguments_are_left_to_ros():
    words = ["1", "--ros-args", "-r", "__ns:=/left", "-p", "seed:=-3", "--", "2"]
    assert without_ros_arguments(words) == ["1", "2"]
    assert run(send, words, node=True) == 7


def test_a_command_without_a_node_refuses_ros_arguments(capsys):
    assert run(send, ["1", "2", "--ros-args"], name="send") == 2
    assert "not an argument of this command: --ros-args" in capsys.readouterr().err


def run_script(
    tmp_path: Path, body: str, output: int | IO[str] = subprocess.PIPE
) -> subprocess.Popen[str]:
    script = tmp_path / "count.py"
    script.write_text(
        "import sys\nfrom mhsb_model.command_line import run\n\n"
        f"def count() -> None:\n{body}\n\nsys.exit(run(count))\n"
    )
    return subprocess.Popen(
        [sys.executable, str(script)], stdout=output, stderr=subprocess.PIPE, text=True
    )


def test_an_interrupt_ends_with_130_and_a_sentence(tmp_path):
    child = run_script(tmp_path, "    raise KeyboardInterrupt")
    assert child.communicate(timeout=30) == ("", "count: interrupted; no result was kept\n")
    assert child.returncode == 130


def test_an_interrupt_tells_what_was_kept_last_by_this_command(capsys):
    def save() -> None:
        set_interrupt_note("a.json has 3 of 5 runs")
        set_interrupt_note("a.json has 4 of 5 runs")
        raise KeyboardInterrupt

    def wait() -> None:
        raise KeyboardInterrupt

    assert (run(save, [], name="save"), run(wait, [], name="wait")) == (130, 130)
    assert capsys.readouterr().err.splitlines() == [
        "save: interrupted; a.json has 4 of 5 runs",
        "wait: interrupted; no result was kept",
    ]


def test_a_reader_who_goes_away_ends_the_command_quietly(tmp_path):
    body = "    for number in range(10**6):\n        print(number)"
    child = run_script(tmp_path, body)
    assert child.stdout is not None
    assert child.stderr is not None
    child.stdout.readline()
    child.stdout.close()
    assert child.stderr.read() == ""
    assert child.wait(timeout=30) == 141


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_what_finds_no_room_to_be_printed_is_told_in_a_sentence(tmp_path):
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        child = run_script(tmp_path, "    print('result')", full)
        _, errors = child.communicate(timeout=30)
    assert errors.strip() == "count: the output cannot be written: No space left on device"
    assert child.returncode == 1


def test_a_positional_number_out_of_range_is_named_as_in_the_usage(capsys):
    def go(
        place: Annotated[float, tyro.conf.Positional, NumberRange(-1.0, 1.0)],
        speed: Annotated[float, NumberRange(0.0, 1.0)] = 1.0,
    ) -> None:
        """Go to a place."""

    assert run(go, ["7"], name="go") == EXIT_USAGE
    assert capsys.readouterr().err == "go: PLACE must be from -1 to 1 (is 7.0)\n"
    assert run(go, ["0", "--speed", "7"], name="go") == EXIT_USAGE
    assert capsys.readouterr().err == "go: --speed must be from 0 to 1 (is 7.0)\n"
