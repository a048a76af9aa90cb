"""A Dask cluster of real worker processes on this machine."""

import logging
import os
import signal
import threading
import time

import numpy as np
import pytest
from distributed import Client, LocalCluster

from mhsb_model import command_line
from mhsb_planner.build_table import build_table
from mhsb_planner.cluster import Cluster
from mhsb_planner.errors import RequestError, WorkersLostError
from mhsb_planner.executor import SharedStateExecutor, create_executor
from mhsb_planner.posture.grid import list_grid_nodes
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_tools.reproduction.runs import Runs, evaluate, settings


@pytest.fixture(scope="module")
def local():
    """Two processes of four threads: eight that work."""
    with LocalCluster(
        n_workers=2,
        threads_per_worker=4,
        host="127.0.0.1",
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
    ) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def cluster(local):
    return Cluster.connect(local.scheduler_address)


def test_a_table_is_the_same_to_the_bit(machine, cluster):
    here = build_posture_table(machine, 0.2, jobs=1)
    there = build_posture_table(machine, 0.2, jobs=cluster)
    assert np.array_equal(here.posture, there.posture, equal_nan=True)
    assert np.array_equal(here.area, there.area, equal_nan=True)


def test_the_commands_table_is_the_same_too(machine, local, tmp_path, capsys):
    path = tmp_path / "table.npz"
    words = ["--output", path, "--spacing", 0.2, "--scheduler", local.scheduler_address, "--json"]
    assert command_line.run(build_table, list(map(str, words)), name="build_table") == 0
    here = build_posture_table(machine, 0.2)
    assert np.array_equal(PostureTable.load(path, machine, 0.2).area, here.area, equal_nan=True)


def test_a_killed_worker_loses_nothing_and_the_next_one_is_prepared_too(cluster):
    def work(state, number):
        time.sleep(0.1)
        return state["shared"] + number, os.getpid()

    with SharedStateExecutor(cluster, dict, {"shared": 100}) as pool:
        tasks = [pool.submit(work, number) for number in range(80)]
        _, killed = tasks[0].result()
        os.kill(killed, signal.SIGKILL)
        results = [task.result() for task in tasks]
    assert [number for number, _ in results] == list(range(100, 180))
    assert len({process for _, process in results}) >= 2


def test_a_result_that_has_come_is_not_made_again_for_a_worker_that_is_killed(
    local, cluster, eventually
):
    def kept(dask_scheduler):
        return len(dask_scheduler.tasks)

    with create_executor(cluster) as pool, Client(local) as client:
        tasks = [pool.submit(divmod, number, 3) for number in range(20)]
        assert [task.result() for task in tasks] == [divmod(n, 3) for n in range(20)]
        eventually(lambda: client.run_on_scheduler(kept) == 0)


def test_each_thread_has_a_state_of_its_own_that_is_made_once(cluster):
    def work(state):
        time.sleep(0.02)
        state.append(threading.get_ident())
        return os.getpid(), id(state), len(set(state))

    with SharedStateExecutor(cluster, list) as pool:
        results = [task.result() for task in [pool.submit(work) for _ in range(40)]]
    assert all(threads == 1 for _, _, threads in results)
    assert 1 < len({(process, state) for process, state, _ in results}) <= 8


def test_errors_keep_their_sentence_and_their_data(machine, cluster):
    with create_executor(cluster) as pool:
        task = pool.submit(list_grid_nodes, machine, 99.0)
        with pytest.raises(RequestError, match="spacing must be above 0") as caught:
            task.result()
    assert (caught.value.name, caught.value.value) == ("spacing", 99.0)


def test_a_task_that_ends_every_worker_is_told_in_one_sentence(cluster):
    with (
        create_executor(cluster) as pool,
        pytest.raises(WorkersLostError, match="ended by themselves"),
    ):
        pool.submit(os._exit, 1).result()


def test_runs_of_the_paper_are_the_same(machine, table, cluster):
    asked = {name: settings()[name] for name in ("1-1", "1-2")}
    known = Runs(machine, {None: table}, {})
    here, there = (evaluate(machine, asked, jobs, known=known) for jobs in (None, cluster))
    for name in asked:
        assert np.array_equal(here[name].path.energy, there[name].path.energy)
        assert np.array_equal(here[name].path.posture, there[name].path.posture)
        assert np.array_equal(here[name].path.modes, there[name].path.modes)


@pytest.mark.parametrize(
    ("address", "code", "sentence"),
    [
        ("nonsense", 2, "cluster at nonsense: not an address like tcp://10.0.0.2:8786"),
        ("http://127.0.0.1:1", 2, "cluster at http://127.0.0.1:1: not an address like"),
        ("127.0.0.1:1", 1, "no scheduler answers within 0.5 s"),
    ],
)
def test_an_address_without_a_scheduler_is_refused(address, code, sentence, capsys, monkeypatch):
    monkeypatch.setattr("mhsb_planner.cluster.CONNECTED_WITHIN", 0.5)
    words = ["--scheduler", address]
    assert command_line.run(build_table, words, name="build_table") == code
    told = capsys.readouterr().err
    assert sentence in told
    assert told.count("\n") == 1
