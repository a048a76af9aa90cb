"""Compiled kernels are found again only where no source has changed."""

import os
import subprocess
import sys

from mhsb_model import kernel_cache

CALLEE = "from numba import njit\n\n@njit(cache=True)\ndef inner(x):\n    return x + {}\n"
CALLER = (
    "from numba import njit\nfrom callee import inner\n\n"
    "@njit(cache=True)\ndef outer(x):\n    return inner(x)\n"
)


def test_the_folder_changes_with_any_kernel_source(tmp_path):
    first, second = tmp_path / "a.py", tmp_path / "b.py"
    first.write_text("1")
    second.write_text("2")
    before = kernel_cache.fingerprint([first, second])
    assert kernel_cache.fingerprint([first, second]) == before
    second.write_text("3")
    assert kernel_cache.fingerprint([first, second]) != before


def test_the_suites_kernels_are_among_the_sources():
    names = {file.name for file in kernel_cache.kernel_sources()}
    assert {"linkage.py", "statics.py"} <= names
    assert "errors.py" not in names


def test_numba_alone_would_go_on_with_an_old_callee_and_the_fingerprint_prevents_it(tmp_path):
    callee = tmp_path / "callee.py"
    (tmp_path / "caller.py").write_text(CALLER)

    def answer(cache):
        environment = {
            **os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(tmp_path)
        }  # fmt: skip
        code = "from caller import outer; print(outer(1))"
        command = [sys.executable, "-c", code]
        result = subprocess.run(
            command, env=environment, capture_output=True, text=True, check=True
        )
        return int(result.stdout)

    answers = []
    for version in (1, 2):
        callee.write_text(CALLEE.format(version))
        folder = tmp_path / kernel_cache.fingerprint([callee])
        answers.append((answer(tmp_path / "shared"), answer(folder)))
    assert [by_fingerprint for _, by_fingerprint in answers] == [2, 3]
    assert [alone for alone, _ in answers] == [2, 2]


def test_a_folder_chosen_by_the_user_is_left_alone(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    kernel_cache.use_kernel_cache()
    assert os.environ["NUMBA_CACHE_DIR"] == str(tmp_path)


def test_old_folders_are_dropped_and_the_newest_kept(monkeypatch, tmp_path):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kernels = tmp_path / "mhsb" / "kernels"
    for age in range(5):
        folder = kernels / f"old{age}"
        folder.mkdir(parents=True)
        os.utime(folder, (1000.0 - age, 1000.0 - age))
    kernel_cache.use_kernel_cache()
    kept = {folder.name for folder in kernels.iterdir()}
    assert kept == {"old0", "old1", kernel_cache.kernel_cache_folder().name}


def test_folders_that_somebody_may_be_using_are_kept(monkeypatch, tmp_path):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kernels = tmp_path / "mhsb" / "kernels"
    for number in range(5):
        (kernels / f"used{number}").mkdir(parents=True)
    kernel_cache.use_kernel_cache()
    assert len(list(kernels.iterdir())) == 6
