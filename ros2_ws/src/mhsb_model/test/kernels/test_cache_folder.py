"""Compiled kernels are found again only where no source has changed, and where they can be kept."""

import os
import shutil
import stat

import pytest

from mhsb_model.kernels import cache_folder
from mhsb_model.kernels.cache_folder import (
    CACHE_VARIABLE,
    LOGGED_VARIABLE,
    MIN_FREE_SPACE,
    set_kernel_cache_folder,
)


@pytest.fixture
def caches(monkeypatch, tmp_path):
    """Nobody has chosen a folder; caches are below this one."""
    monkeypatch.delenv(CACHE_VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("numba.config.CACHE_DIR", "")
    return tmp_path / "mhsb" / "kernels"


@pytest.fixture
def read_only(tmp_path):
    """A folder in which nothing can be written, not even by root."""
    (tmp_path / "file").touch()
    return tmp_path / "file" / "kernels"


def test_the_folder_changes_with_any_kernel_source(tmp_path):
    first, second = tmp_path / "a.py", tmp_path / "b.py"
    first.write_text("1")
    second.write_text("2")
    before = cache_folder.fingerprint([first, second])
    assert cache_folder.fingerprint([first, second]) == before
    second.write_text("3")
    assert cache_folder.fingerprint([first, second]) != before


def test_the_suites_kernels_their_constants_and_their_decorator_are_among_the_sources():
    names = {file.name for file in cache_folder.kernel_sources()}
    assert {"linkage.py", "statics.py", "modes.py", "kernel.py", "compiled.py"} <= names
    assert "errors.py" not in names


def test_constants_are_found_in_imports_of_one_or_several_lines():
    source = b"""
from mhsb_model.modes import Mode, INLET
from mhsb_model.types import FloatArray
from mhsb_planner.search.s2_step import (
    Postures,
    ENERGY_COLUMN,
)
from numpy import NAN
"""
    assert cache_folder.find_constant_modules(source) == {
        "mhsb_model.modes", "mhsb_planner.search.s2_step"
    }  # fmt: skip


def test_a_folder_chosen_by_the_user_is_left_alone(monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    monkeypatch.setattr("numba.config.CACHE_DIR", "")
    set_kernel_cache_folder()
    assert os.environ[CACHE_VARIABLE] == str(tmp_path)


def test_old_folders_are_dropped_and_the_newest_kept(caches):
    for age in range(5):
        folder = caches / f"old{age}"
        folder.mkdir(parents=True)
        os.utime(folder, (1000.0 - age, 1000.0 - age))
    set_kernel_cache_folder()
    kept = {folder.name for folder in caches.iterdir()}
    assert kept == {"old0", "old1", cache_folder.kernel_cache_folder().name}


def test_folders_that_somebody_may_be_using_are_kept(caches):
    for number in range(5):
        (caches / f"used{number}").mkdir(parents=True)
    set_kernel_cache_folder()
    assert len(list(caches.iterdir())) == 6


def test_a_folder_that_cannot_be_written_is_told_and_replaced(
    monkeypatch, caplog, tmp_path, read_only
):
    monkeypatch.setenv(CACHE_VARIABLE, str(read_only))
    monkeypatch.setattr("numba.config.CACHE_DIR", "")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    set_kernel_cache_folder()
    spare = tmp_path / f"mhsb-{os.getuid()}" / "kernels"
    assert os.environ[CACHE_VARIABLE] == str(spare)
    assert stat.S_IMODE(spare.parent.stat().st_mode) == 0o700
    assert f"cannot be kept in {read_only} (Not a directory)" in caplog.text
    assert "name another folder" in caplog.text


def test_a_full_disk_is_logged_once_and_a_folder_that_has_kernels_is_kept(
    monkeypatch, caplog, tmp_path
):
    monkeypatch.setattr("numba.config.CACHE_DIR", "")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    usage = shutil.disk_usage(tmp_path)._replace(free=MIN_FREE_SPACE - 1)
    monkeypatch.setattr("shutil.disk_usage", lambda folder: usage)
    monkeypatch.delenv(LOGGED_VARIABLE, raising=False)
    for name in ("empty", "full"):
        folder = tmp_path / name
        folder.mkdir()
        monkeypatch.setenv(CACHE_VARIABLE, str(folder))
        if name == "full":
            (folder / "complete-1").touch()
        set_kernel_cache_folder()
        set_kernel_cache_folder()
    assert os.environ[CACHE_VARIABLE] == str(tmp_path / "full")
    [record] = caplog.records
    assert "(the disk is full) and cannot be kept anywhere else" in record.message


@pytest.mark.parametrize("trap", ["open to all", "a link"])
def test_code_is_not_run_from_a_temporary_folder_of_others(monkeypatch, tmp_path, read_only, trap):
    monkeypatch.setenv(CACHE_VARIABLE, str(read_only))
    monkeypatch.setattr("numba.config.CACHE_DIR", "")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    trapped = tmp_path / f"mhsb-{os.getuid()}"
    if trap == "a link":
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        trapped.symlink_to(tmp_path / "elsewhere")
    else:
        trapped.mkdir()
        trapped.chmod(0o777)
    set_kernel_cache_folder()
    assert not os.environ[CACHE_VARIABLE].startswith(f"{trapped}/")
