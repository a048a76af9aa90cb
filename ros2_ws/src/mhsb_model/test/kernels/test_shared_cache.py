"""Kernels kept on disk: shared by processes that need them at once, and not trusted blindly."""

import os
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.support.forked_programs import run_forked

from mhsb_model.kernels.cache_folder import LOGGED_VARIABLE

MODULE = """
import time

from numba.core import event

from mhsb_model.kernels.kernel import kernel

compiled = []

class Listener(event.Listener):
    def on_start(self, happening):
        compiled.append(happening.data["dispatcher"].py_func.__name__)

    def on_end(self, happening):
        pass

event.register("numba:compile", Listener())

@kernel
def square(x):
    return x * x

@kernel
def twice(x, times):
    return square(x) * times

@kernel
def sum_of_both(x):
    return twice(x, 2) + twice(x, 3)
"""
CALL = "import kernels; print(kernels.sum_of_both(2.0), sorted(kernels.compiled))"
ALL = "20.0 ['square', 'sum_of_both', 'twice']\n"
NOTHING = "20.0 []\n"

VERSIONS = """
import numpy as np

import kernels

kinds = float, int, complex, np.float32, np.int32, np.int8, np.uint8, np.uint16
numbers = [kind(2) for kind in kinds]
for number in numbers[{first}:] + numbers[:{first}]:
    assert kernels.square(number) == 4
print(len(kernels.compiled))
"""


LINK = """
from kernels import kernel, sum_of_both, twice

print(sum_of_both(2.0))

@kernel
def four_times(x):
    return twice(x, 1) * twice(2.0, 1)

print(four_times(3.0))
"""


def make_environment(source: Path, cache: Path) -> dict[str, str]:
    """The environment in which a process finds the module and its cache."""
    path = f"{source}{os.pathsep}{os.environ['PYTHONPATH']}"
    return {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": path}


def started(
    source: Path, cache: Path, program: str = CALL, **options: object
) -> subprocess.Popen[str]:
    """A process that calls a kernel and tells what it compiled."""
    return subprocess.Popen(
        [sys.executable, "-c", program],
        env=make_environment(source, cache),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


@pytest.fixture
def run_forks(source, tmp_path):
    """Function (programs..., together=False) that runs processes whose cache is this test's own."""

    def run(*programs, together=False):
        environment = make_environment(source, tmp_path / "cache")
        return run_forked(
            [[each] for each in programs], tmp_path, together=together, environment=environment
        )

    return run


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """Folder of the module that is called."""
    folder = tmp_path_factory.mktemp("source")
    (folder / "kernels.py").write_text(MODULE)
    return folder


@pytest.fixture(scope="module")
def kept(source, tmp_path_factory):
    """A cache in which everything is."""
    folder = tmp_path_factory.mktemp("kept")
    assert started(source, folder).communicate() == (ALL, "")
    return folder


@pytest.fixture
def start(source, tmp_path):
    """Function () that starts a process whose cache is this test's own."""
    return lambda: started(source, tmp_path / "cache")


def files(folder: Path, ending: str) -> list[Path]:
    """Files of the cache."""
    found = sorted((folder / "cache").rglob(f"*{ending}"))
    assert found
    return found


def test_a_kernel_is_compiled_once_for_all_constants_and_found_by_the_next_process(source, kept):
    assert started(source, kept).communicate() == (NOTHING, "")


def test_a_kernel_that_was_found_can_be_linked_into_a_new_one(source, kept, tmp_path):
    cache = tmp_path / "cache"
    shutil.copytree(kept, cache)
    assert started(source, cache, LINK).communicate() == ("20.0\n36.0\n", "")


def test_processes_that_need_a_kernel_at_once_compile_it_once(run_forks):
    printed = run_forks(*4 * [CALL], together=True)
    assert all(errors == "" for _, errors in printed)
    compiled = [name for output, _ in printed for name in output.split(" ", 1)[1].split("'")[1::2]]
    assert sorted(compiled) == ["square", "sum_of_both", "twice"]


def test_processes_that_need_several_versions_of_a_kernel_at_once_compile_each_once(run_forks):
    programs = [VERSIONS.format(first=first) for first in (0, 2, 4, 6)]
    printed = run_forks(*programs, together=True)
    assert all(errors == "" for _, errors in printed)
    assert sum(int(output) for output, _ in printed) == 8
    assert run_forks(*programs) == 4 * [("0\n", "")]


@pytest.mark.parametrize(
    ("ending", "damage"),
    [(".nbc", "cut"), (".nbc", "changed"), (".nbi", "changed"), (".nbi", "empty")],
)
def test_what_is_damaged_is_told_and_compiled_anew(run_forks, kept, tmp_path, ending, damage):
    shutil.copytree(kept, tmp_path / "cache")
    for file in files(tmp_path, ending):
        content = bytearray(file.read_bytes())
        if damage == "changed":
            for at in range(0, len(content), 97):
                content[at] ^= 0x55
        file.write_bytes({"cut": content[: len(content) // 2], "empty": b""}.get(damage, content))
    (output, errors), again = run_forks(CALL, CALL)
    assert output.startswith("20.0 ['")
    assert "is damaged" in errors
    assert "Traceback" not in errors
    assert again == (NOTHING, "")


def test_files_that_are_gone_are_made_again(start, kept, tmp_path):
    shutil.copytree(kept, tmp_path / "cache")
    for file in files(tmp_path, ".nbc"):
        file.unlink()
    output, errors = start().communicate()
    assert (output, errors) == (ALL, "")


def test_a_process_that_dies_while_it_compiles_keeps_nobody_waiting(start, tmp_path):
    first = start()
    while not list((tmp_path / "cache").rglob("*.lock")):
        assert first.poll() is None
        time.sleep(0.002)
    first.kill()
    first.communicate()
    output, errors = start().communicate()
    assert output.startswith("20.0")
    assert errors == ""


@pytest.mark.parametrize("limit", [0, 64], ids=["nothing", "no kernel"])
def test_where_kernels_cannot_be_kept_one_line_says_so_and_each_is_compiled(
    source, tmp_path, monkeypatch, limit
):
    """Files of a process may have so many KiB, as on a disk that is nearly full."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.delenv(LOGGED_VARIABLE, raising=False)

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1024 * limit, 1024 * limit))

    process = started(source, tmp_path / "cache", preexec_fn=limited)
    output, log = process.communicate()
    assert output == ALL
    assert len(log.splitlines()) == 1
    assert "cannot be kept" in log
