"""Kernels that Python calls are stored without bitcode, by what numba does not document.

It is known to hold for numba 0.68. If these tests fail for a later release, kernels still work and
load more slowly: `mhsb_model/kernels/machine_code.py` is to be adapted.
"""

from types import SimpleNamespace

import numba
import pytest

from mhsb_model.kernels.machine_code import store_machine_code_alone


def weighted_sum(values, weight):
    total = 0.0
    for value in values:
        total += weight * value
    return total


@pytest.fixture
def create(monkeypatch, tmp_path):
    """Function (name) that creates a dispatcher whose cache is in this folder."""

    def dispatcher(name):
        monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / name))
        made = numba.njit(weighted_sum)
        made.enable_caching()
        return made

    return dispatcher


def test_files_are_smaller_without_bitcode_and_can_be_loaded(create, tmp_path):
    sizes = []
    for name in ("numba", "suite"):
        dispatcher = create(name)
        if name == "suite":
            store_machine_code_alone(dispatcher)
        assert dispatcher((1.0, 2.0), 3.0) == 9.0
        [file] = (tmp_path / name).rglob("*.nbc")
        sizes.append(file.stat().st_size)
    assert sizes[1] < 0.8 * sizes[0], f"numba {numba.__version__} stores kernels in another way"
    again = create("suite")
    assert again((1.0, 2.0), 3.0) == 9.0
    assert sum(again.stats.cache_hits.values()) == 1


def test_a_numba_of_another_build_is_left_as_it_is():
    dispatcher = SimpleNamespace(py_func=len)
    store_machine_code_alone(dispatcher)
    assert vars(dispatcher) == {"py_func": len}
