"""All runs of the suite's own arm, made once, and what was told of their progress."""

import pytest

from mhsb_model.machine import Machine
from mhsb_tools.reproduction.runs import Runs, evaluate


@pytest.fixture(scope="session")
def told_runs(machine: Machine) -> tuple[Runs, list[int]]:
    told: list[int] = []
    return evaluate(machine, progress=told.append), told


@pytest.fixture(scope="session")
def runs(told_runs: tuple[Runs, list[int]]) -> Runs:
    return told_runs[0]
