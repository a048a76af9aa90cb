"""Draws on a Dask cluster of real worker processes: the same numbers, though a worker is killed."""

import logging
import os
import signal
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest
from distributed import Client, LocalCluster

from mhsb_planner.cluster import Cluster
from mhsb_planner.kernel_parts import compile_planner
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_sim.simulation.kernel_parts import compile_simulator
from mhsb_tools.study.draws import DrawStudy, as_dicts, run_draws
from mhsb_tools.study.variations import load_variations


@pytest.fixture(scope="module", autouse=True)
def compiled(machine):
    """So that no worker's time includes it."""
    compile_planner()
    compile_simulator()
    load_or_build_table(machine)


@pytest.fixture
def local():
    """Two processes."""
    with LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
    ) as cluster:
        yield cluster


def process_of_a_worker(local) -> int:
    with Client(local) as client:
        return next(iter(client.run(os.getpid).values()))


def of_draws(machine, count, goals, jobs, half_way=lambda: None):
    """Records of all draws in their order; half_way is called when half of them are there."""
    found = []
    make_study = partial(DrawStudy, machine, load_variations(machine), 11, goals=goals)
    for number, records in enumerate(run_draws(make_study, count, jobs), start=1):
        found += records
        if number == count // 2:
            half_way()
    return as_dicts(found)


def test_draws_are_the_same_to_the_bit_though_a_worker_is_killed(machine, local):
    victim = process_of_a_worker(local)
    cluster = Cluster.connect(local.scheduler_address)
    there = of_draws(machine, 2, 1, cluster, lambda: os.kill(victim, signal.SIGKILL))
    assert there == of_draws(machine, 2, 1, 1)
    assert len(there) == 4
    assert not any(record["failure"] for record in there)


@pytest.mark.slow
@pytest.mark.timeout(3000)
def test_a_monte_carlo_of_a_thousand_runs_is_complete_and_equal(machine, local):
    victim = process_of_a_worker(local)
    cluster = Cluster.connect(local.scheduler_address)
    with ThreadPoolExecutor(1) as beside:
        serial = beside.submit(of_draws, machine, 500, 1, 1)
        there = of_draws(machine, 500, 1, cluster, lambda: os.kill(victim, signal.SIGKILL))
        assert process_of_a_worker(local) != victim
        assert len(there) == 1000
        assert there == serial.result()
