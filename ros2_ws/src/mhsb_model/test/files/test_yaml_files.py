"""YAML files: what is read, and that what is refused is not repeated."""

import os

import pytest

from mhsb_model.files.yaml_files import LARGEST_FILE, YamlFileError, read_yaml

BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join(['*' + before] * 10)}]\n"
    for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.fixture
def refused(tmp_path):
    """Function (content) that returns what is said of a file with it."""

    def read(content):
        file = tmp_path / "file.yaml"
        file.write_bytes(content.encode() if isinstance(content, str) else content)
        with pytest.raises(YamlFileError) as caught:
            read_yaml(file)
        assert str(caught.value) == f"{file}: {caught.value.reason}"
        return caught.value.reason

    return read


def test_plain_values_and_anchors_are_read(tmp_path):
    file = tmp_path / "file.yaml"
    file.write_text("link: &link {length: 0.5}\nlinks: [*link, *link]\nname: Käfer\n")
    assert read_yaml(file) == {
        "link": {"length": 0.5}, "links": [{"length": 0.5}] * 2, "name": "Käfer"
    }  # fmt: skip


def test_numbers_as_long_as_any_machine_needs_are_read(tmp_path):
    file = tmp_path / "file.yaml"
    file.write_text(f"a: {'9' * 64}\nb: 0x{'f' * 62}\nc: 1:30\nd: 0.{'1' * 62}\n")
    assert read_yaml(file) == {"a": 10**64 - 1, "b": 16**62 - 1, "c": 90, "d": 1 / 9}


def test_an_empty_file_has_no_content(tmp_path):
    (tmp_path / "empty.yaml").touch()
    assert read_yaml(tmp_path / "empty.yaml") is None


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("a: [1, 2", "is not YAML: line 1, column 9: "),
        ("- 1\na: secret", "line 2, column 1: expected <block end>, but found '?'"),
        ("a: secret: secret", "line 1, column 10: mapping values are not allowed here"),
        ("a: 'secret", "found unexpected end of stream"),
        ("a: *secret", "found undefined alias …"),
        ("a: !!python/object/apply:os.system [secret]", "could not determine a constructor"),
        ("a: !secret 1", "could not determine a constructor for the tag …"),
        ("a: 2024-13-45", "something cannot be read"),
        ("? [secret]\n: 1", "found unhashable key"),
        ("a: 0x" + "f" * 60_000, "line 1, column 4: a number has 60002 characters, at most 64"),
        ("a: 1" + ":59" * 30_000, "line 1, column 4: a number has 90001 characters, at most 64"),
        ("a: 1" + ":59" * 30_000 + ".5", "a number has 90003 characters, at most 64 are read"),
        ("a: " + "9" * 65, "a number has 65 characters, at most 64 are read"),
        ("a: !!int ''", "is not YAML: something cannot be read"),
        ("a: !!float ''", "is not YAML: something cannot be read"),
        ("a: !!bool secret", "is not YAML: something cannot be read"),
        ("a: !!timestamp secret", "is not YAML: something cannot be read"),
        ("a: 2001-12-14 21:59:43.10 +99:99", "is not YAML: something cannot be read"),
        (b"secret\xff", "is not text in UTF-8; is it the right file?"),
        (b"secret\x00", "is not YAML"),
        (BOMB, "has more than 100000 values, with anchors written out; shorten it"),
        ("a: &a [*a]", "is nested too deeply, or in itself; make it flatter"),
        ("[" * 50_000, "is nested too deeply, or in itself; make it flatter"),
        ("a" * (LARGEST_FILE + 1), f"it has more than {LARGEST_FILE} bytes"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_by_its_place_and_not_by_its_words(refused, content, sentence):
    reason = refused(content)
    assert sentence in reason
    assert "secret" not in reason
    assert "\n" not in reason


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (
            "a: 1\nlink:\n  mass: 2\n  length: 1\n  mass: 3\n",
            "link.mass: is there in line 3 and in line 5; keep one of each",
        ),
        ("joints:\n- {q: 1}\n- {q: 1, q: 2}\n", "joints.1.q: is there in line 3 and in line 3; "),
        (
            "a: 1\na: {b: 1, b: 2}\n",
            "a: is there in line 1 and in line 2; a.b: is there in line 2 and in line 2; keep one",
        ),
        ("'secret word': 1\n'secret word': 2\n", "…: is there in line 1 and in line 2; "),
    ],
)
def test_a_key_that_is_there_twice_is_refused_by_its_path(refused, content, sentence):
    reason = refused(content)
    assert reason.startswith(sentence)
    assert "secret" not in reason


def test_a_section_of_an_anchor_is_merged_and_its_values_replaced(tmp_path):
    file = tmp_path / "file.yaml"
    file.write_text("a: &a {mass: 1, length: 2}\nb: {<<: *a, mass: 3}\n")
    assert read_yaml(file)["b"] == {"mass": 3, "length": 2}


def test_a_missing_file_a_folder_and_a_file_that_must_not_be_read_are_told(tmp_path):
    locked = tmp_path / "locked.yaml"
    locked.touch(mode=0o000)
    cases = {tmp_path / "none.yaml": "No such file or directory", tmp_path: "it is a folder"}
    if not os.access(locked, os.R_OK):  # who is root may read everything
        cases[locked] = "Permission denied"
    for path, reason in cases.items():
        with pytest.raises(YamlFileError, match=f"{path}: cannot be read: {reason}"):
            read_yaml(path)


def test_neither_a_pipe_nor_an_endless_device_is_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", type(tmp_path)("/dev/zero")):
        with pytest.raises(YamlFileError, match="it is no regular file"):
            read_yaml(path)
