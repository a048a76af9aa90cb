"""Result files are written whole or not at all."""

import json

import pytest

from mhsb_planner.result_files import write_json, write_rows


def test_rows_have_a_header_and_folders_are_made(tmp_path):
    path = write_rows(tmp_path / "new" / "table.csv", ("a_m", "b"), [(1.5, "x, y"), (2, None)])
    assert path.read_text().splitlines() == ["a_m,b", '1.5,"x, y"', "2,"]


def test_a_file_that_fails_half_way_leaves_the_old_one(tmp_path):
    path = write_json(tmp_path / "result.json", {"old": 1})
    with pytest.raises(TypeError):
        write_json(path, {"new": object()})
    assert json.loads(path.read_text()) == {"old": 1}
