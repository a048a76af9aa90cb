"""Tables that have been built before."""

import logging

import pytest

from mhsb_planner.errors import TableError
from mhsb_planner.posture import posture_table_cache
from mhsb_planner.posture.posture_table_cache import cached_table_path, load_or_build_table
from mhsb_planner.posture.s1_posture_table import PostureTable

SPACING = 0.2


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "mhsb"


@pytest.fixture
def built(monkeypatch):
    """Calls of the table builder."""
    calls = []
    build = posture_table_cache.build_posture_table

    def counted(*arguments, **options):
        calls.append(arguments)
        return build(*arguments, **options)

    monkeypatch.setattr(posture_table_cache, "build_posture_table", counted)
    return calls


def test_a_table_is_built_once(machine, built):
    first = load_or_build_table(machine, spacing=SPACING)
    again = load_or_build_table(machine, spacing=SPACING)
    assert len(built) == 1
    assert again.area.tobytes() == first.area.tobytes()


def test_another_machine_has_a_table_of_its_own(machine, built):
    load_or_build_table(machine, spacing=SPACING)
    other = load_or_build_table(machine.changed(payload=5.0), spacing=SPACING)
    assert len(built) == 2
    assert other.machine_hash == machine.changed(payload=5.0).table_hash


def test_a_damaged_table_in_the_cache_is_replaced_and_this_is_logged(machine, built, caplog):
    path = cached_table_path(machine, SPACING)
    path.parent.mkdir(parents=True)
    path.write_bytes(b"half a table")
    with caplog.at_level(logging.WARNING):
        load_or_build_table(machine, spacing=SPACING)
    assert "is damaged" in caplog.text
    assert PostureTable.load(path, machine, SPACING).spacing == SPACING


def test_a_cache_that_cannot_be_written_does_no_harm_and_is_logged(machine, cache, caplog):
    cache.write_text("a file where the directory should be")
    with caplog.at_level(logging.WARNING):
        assert load_or_build_table(machine, spacing=SPACING).spacing == SPACING
    assert "cannot be written" in caplog.text


def test_a_file_that_is_named_is_taken_and_nothing_is_built(machine, built, tmp_path):
    load_or_build_table(machine, spacing=SPACING).save(tmp_path / "mine.npz")
    built.clear()
    assert load_or_build_table(machine, tmp_path / "mine.npz").spacing == SPACING
    assert built == []


def test_a_file_that_is_named_must_be_there(machine, tmp_path):
    with pytest.raises(TableError, match="there is no such file"):
        load_or_build_table(machine, tmp_path / "none.npz")


def test_progress_is_passed_on(machine):
    told = []
    load_or_build_table(
        machine, spacing=SPACING, progress=lambda done, total: told.append((done, total))
    )
    assert told[-1][0] == told[-1][1]


def test_without_a_usable_setting_the_cache_is_in_the_home_directory(
    machine, monkeypatch, tmp_path
):
    monkeypatch.setenv("XDG_CACHE_HOME", "relative/path")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cached_table_path(machine).parent == tmp_path / ".cache" / "mhsb"
