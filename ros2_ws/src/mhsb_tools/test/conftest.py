"""The suite's own arm with its posture table, for the tests of the commands."""

from __future__ import annotations

import pytest

from mhsb_control import load_machine
from mhsb_model.machine import Machine
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_sim.simulation.kernel_parts import compile_simulator


@pytest.fixture(scope="session")
def machine() -> Machine:
    """The machine, with everything compiled, so that no test's time includes it."""
    compile_simulator()
    return load_machine()


@pytest.fixture(scope="session")
def table(machine: Machine) -> PostureTable:
    """The machine's posture table."""
    return build_posture_table(machine)


@pytest.fixture(scope="session")
def graph(machine: Machine, table: PostureTable) -> StepGraph:
    """The steps between the postures of the table."""
    return StepGraph(machine, table)
