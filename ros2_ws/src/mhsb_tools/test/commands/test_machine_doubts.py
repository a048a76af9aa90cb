"""Doubts about machine files that the schema allows."""

import pytest

from mhsb_control import load_machine
from mhsb_tools.commands.machine_doubts import list_doubts

SHIPPED = ["mhsb_arm3", "mhsb_arm4", "excavator", "excavator_1to14", "forestry_crane"]


@pytest.mark.parametrize("name", SHIPPED)
def test_the_shipped_machines_raise_no_doubt(name):
    assert list_doubts(load_machine(name), 100) == []


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        (
            {"circuit.line_relief_pressure": 1.25e6},
            "circuit.line_relief_pressure 1.25 MPa is below the main pump's 2.5 MPa, whose oil its "
            "valves let go; raise it above that pressure",
        ),
        (
            {"imperfections.computing_delay": 0.0805},
            "imperfections.computing_delay 80.5 ms is no whole number of steps of 1 ms; 80 ms are "
            "simulated, so give that",
        ),
        (
            {"imperfections.computing_delay": 0.08, "simulation.step": 3e-3},
            "imperfections.computing_delay 80 ms is no whole number of steps of 3 ms; 81 ms are "
            "simulated, so give that",
        ),
    ],
)
def test_a_doubt_names_value_limit_and_remedy(values, sentence):
    assert list_doubts(load_machine("excavator_1to14").with_values(values), 100) == [sentence]


def test_a_main_pump_that_is_far_too_large_is_asked_about_in_another_unit():
    arm = load_machine("excavator_1to14").with_values({"hydraulics.main_pump.max_flow": 0.0667})
    [doubt] = list_doubts(arm, 100)
    assert "hydraulics.main_pump.max_flow 0.0667 m³/s is " in doubt
    assert "; in L/min? 0.0667 L/min are 1.112e-06 m³/s" in doubt


def test_a_payload_that_is_held_nowhere_is_a_doubt():
    [doubt] = list_doubts(load_machine("excavator_1to14"), 0)
    assert doubt.endswith("lower payload.mass, or raise pressures or bores")
