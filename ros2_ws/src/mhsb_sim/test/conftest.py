"""The suite's own arm, for the tests of the simulator."""

from __future__ import annotations

import pytest

from mhsb_control import load_machine
from mhsb_model.machine import Machine
from mhsb_sim.simulation.kernel_parts import compile_simulator


@pytest.fixture(scope="session")
def machine() -> Machine:
    """The machine, with everything compiled, so that no test's time includes it."""
    compile_simulator()
    return load_machine()
