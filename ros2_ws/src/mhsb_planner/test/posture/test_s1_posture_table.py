"""The posture table's file: what goes in comes out, and nothing else is accepted."""

import json
import os
import shutil

import numpy as np
import pytest

from mhsb_planner.errors import TableError
from mhsb_planner.posture import s1_posture_table
from mhsb_planner.posture.s1_posture_table import ARRAY_NAMES, PostureTable


@pytest.fixture
def file(table, tmp_path):
    path = tmp_path / "table.npz"
    table.save(path)
    return path


def with_header(path, **changes):
    with np.load(path) as content:
        arrays = dict(content)
    header = json.loads(str(arrays["header"])) | changes
    arrays["header"] = np.array(json.dumps(header))
    np.savez(path, **arrays)


def test_a_table_comes_back_bit_for_bit(table, file, machine):
    again = PostureTable.load(file, machine, 0.05)
    for name in ARRAY_NAMES:
        assert getattr(again, name).tobytes() == getattr(table, name).tobytes()
    assert again.machine_hash == table.machine_hash
    assert again.spacing == table.spacing


def test_the_same_table_gives_the_same_file(table, file, tmp_path):
    table.save(tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == file.read_bytes()


def test_arrays_are_read_only(table):
    for name in ARRAY_NAMES:
        with pytest.raises(ValueError, match="read-only"):
            getattr(table, name).flat[0] = 0


def test_a_table_of_another_machine_is_refused_by_name(file, machine):
    other = machine.changed(payload=3.0)
    with pytest.raises(
        TableError, match=f"was made for machine mhsb_arm3 .{machine.table_hash[:12]}"
    ):
        PostureTable.load(file, other)


def test_a_table_of_another_spacing_is_refused(file, machine):
    with pytest.raises(TableError, match=r"has a spacing of 0\.05 m, not 0\.025 m"):
        PostureTable.load(file, machine, 0.025)


def test_a_table_of_another_schema_is_refused(file, machine):
    with_header(file, schema_version=99)
    with pytest.raises(TableError, match="has schema version 99, 1 is needed"):
        PostureTable.load(file, machine)


def test_a_header_without_its_values_is_refused(file, machine):
    with_header(file, spacing=None)
    with pytest.raises(TableError, match="has no usable header"):
        PostureTable.load(file, machine)


def test_arrays_that_do_not_fit_are_refused(file, machine):
    with np.load(file) as content:
        arrays = dict(content)
    arrays["area"] = arrays["area"][:, :5]
    np.savez(file, **arrays)
    with pytest.raises(TableError, match=r"has area of shape \(642, 5\), not \(642, 23\)"):
        PostureTable.load(file, machine)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.99])
def test_a_truncated_file_is_refused(file, machine, share):
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    with pytest.raises(TableError, match="is damaged or not a posture table"):
        PostureTable.load(file, machine)


def test_a_flipped_bit_is_noticed(file, machine):
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    with pytest.raises(TableError, match="is damaged"):
        PostureTable.load(file, machine)


@pytest.mark.parametrize("content", [b"nonsense", b"\x93NUMPY", b"{}"])
def test_another_kind_of_file_is_refused(tmp_path, machine, content):
    path = tmp_path / "other.npz"
    path.write_bytes(content)
    with pytest.raises(TableError, match="is damaged or not a posture table"):
        PostureTable.load(path, machine)


def test_pickled_objects_are_not_unpacked(file, machine):
    with np.load(file) as content:
        arrays = dict(content)
    arrays["nodes"] = np.array([object()], dtype=object)
    np.savez(file, **arrays)
    with pytest.raises(TableError, match="is damaged or not a posture table"):
        PostureTable.load(file, machine)


def test_a_missing_file_and_a_directory_are_refused(tmp_path, machine):
    with pytest.raises(TableError, match="there is no such file"):
        PostureTable.load(tmp_path / "none.npz", machine)
    with pytest.raises(TableError, match="cannot be read"):
        PostureTable.load(tmp_path, machine)


def test_a_pipe_is_not_waited_for(tmp_path, machine):
    os.mkfifo(tmp_path / "pipe.npz")
    with pytest.raises(TableError, match="no regular file"):
        PostureTable.load(tmp_path / "pipe.npz", machine)


def test_what_would_fill_the_memory_is_not_unpacked(file, machine, monkeypatch):
    monkeypatch.setattr(s1_posture_table, "LARGEST_TABLE", 1000)
    with pytest.raises(TableError, match="1000 are the most"):
        PostureTable.load(file, machine)


def test_a_place_that_cannot_be_written_is_an_error(table, tmp_path):
    (tmp_path / "file").write_text("not a directory")
    with pytest.raises(TableError, match="cannot be written"):
        table.save(tmp_path / "file" / "table.npz")


def test_a_disk_that_fills_up_leaves_the_old_table_and_nothing_else(table, file, monkeypatch):
    before = file.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(TableError, match="No space left on device"):
        table.save(file)
    assert file.read_bytes() == before
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_saving_over_a_table_replaces_it(table, file, machine):
    shutil.copy(__file__, file)
    table.save(file)
    assert PostureTable.load(file, machine).entries == 642 * 23
