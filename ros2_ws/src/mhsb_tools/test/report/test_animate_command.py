"""The command `animate` on a recording; what it refuses is among the tests of all commands."""

import json
import sys

import pytest
from PIL import Image

from mhsb_tools.commands import animate_command


@pytest.fixture
def call(monkeypatch, capsys):
    """Function (arguments...) that runs the command; exit code, output, errors."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["animate", *(str(each) for each in arguments)])
        code = animate_command.main()
        return code, *capsys.readouterr()

    return run


def test_a_part_of_a_recording_becomes_a_film(story, call, tmp_path):
    file = tmp_path / "new" / "part.gif"
    part = ("--begin", 2, "--end", 4, "--rate", 5, "--width", 300)
    code, output, errors = call(story.folder, "--output", file, *part)
    assert (code, errors) == (0, "")
    assert output == f"11 pictures of 2.0 s in {file}\n"
    with Image.open(file) as film:
        assert (film.n_frames, film.width) == (11, 300)


def test_what_was_drawn_is_printed_as_json(story, call, tmp_path):
    file = tmp_path / "part.gif"
    part = ("--begin", 2, "--end", 3, "--rate", 5, "--width", 300, "--json")
    code, output, _ = call(story.folder, "--output", file, *part)
    assert code == 0
    told = json.loads(output)
    assert (told["output"], told["pictures"]) == (str(file), 6)
    assert told["shown_s"] == pytest.approx(1.0, abs=0.03)


def test_a_part_with_nothing_in_it_is_refused(story, call, tmp_path):
    code, _, errors = call(story.folder, "--output", tmp_path / "x.gif", "--begin", 60)
    assert code == 2
    assert "nothing lies between --begin 60 and the end" in errors
    assert not (tmp_path / "x.gif").exists()
