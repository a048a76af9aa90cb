"""The suite's own arm with its posture table, for the tests of the benchmarks."""

from __future__ import annotations

import pytest

from mhsb_model.machine import Machine
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.s2_graph import StepGraph


@pytest.fixture(scope="session")
def table(machine: Machine) -> PostureTable:
    return build_posture_table(machine)


@pytest.fixture(scope="session")
def graph(machine: Machine, table: PostureTable) -> StepGraph:
    return StepGraph(machine, table)
