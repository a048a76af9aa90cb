"""All runs of the suite's own arm, made once."""

import pytest

from mhsb_model.machine import Machine
from mhsb_planner.evaluation.reproduction.runs import Runs, evaluate


@pytest.fixture(scope="session")
def runs(machine: Machine) -> Runs:
    return evaluate(machine)
