"""Counterbalance valves, by themselves and in series with the servo valve."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import brentq

from mhsb_control.registry import load_machine
from mhsb_model.errors import MachineFileError
from mhsb_sim.circuit.audit import compute_energy_gap, compute_volume_gap
from mhsb_sim.circuit.network import build_circuit, set_rest_pressures
from mhsb_sim.circuit.valves import registry
from mhsb_sim.circuit.valves.counterbalance import (
    COUNTERBALANCE_VALVE,
    compute_counterbalance_opening,
)

START = np.array([0.3, -1.4, -1.5])
SPEED = 0.006
"""Speed at which the piston of actuator 1 retracts [m/s]."""
COMMAND = -0.07
"""Command of the servo valve of actuator 1."""
STEP = 1e-4
SETTING, RATIO, RANGE, SIZE = 1.1e7, 3.0, 4e6, 0.3
VALVE = {
    "setting": SETTING,
    "pilot_ratio": RATIO,
    "opening_range": RANGE,
    "size": SIZE,
    "lag": 0.005,
}


def make_circuit(section, **values):
    """Return a machine with counterbalance valves, its circuit at rest and its cylinder lengths."""
    machine = load_machine().with_values(
        {
            "circuit.laminar_pressure": 1e3,  # all orifices are turbulent
            "circuit.valves": {} if section is None else {"counterbalance": section},
            **{name.replace("__", "."): value for name, value in values.items()},
        }
    )
    circuit = build_circuit(machine, STEP)
    set_rest_pressures(circuit, machine, START, np.zeros(3, np.uint8))
    return machine, circuit, machine.cylinder_lengths(START)


@pytest.mark.parametrize(
    ("chamber", "pilot", "opening"),
    [(4e6, 0.0, 0.0), (5e6, 0.0, 0.5), (9e6, 0.0, 1.0), (1e6, 1.5e6, 0.75), (0.0, -1e6, 0.0)],
)
def test_it_opens_by_chamber_pressure_and_pilot_pressure_times_the_ratio(chamber, pilot, opening):
    assert compute_counterbalance_opening(np.array([4e6, 3.0, 2e6]), chamber, pilot) == opening


def test_the_pressures_of_a_load_that_is_let_down_are_those_of_two_orifices_in_series():
    machine, circuit, length = make_circuit(VALVE)
    speed = np.array([-SPEED, 0.0, 0.0])
    circuit.actuators["valve_command"][0] = COMMAND
    for _ in range(200):
        circuit.advance(length, speed, 20)
    m, line = machine.arrays, circuit.pressure[2]
    edge = abs(circuit.actuators["spool"][0]) * m.valve_coefficient[0]
    rod = line - (m.rod_area[0] * SPEED / edge) ** 2

    def find_excess(cap):
        """Return the flow that the two orifices let out beyond that of the piston [m³/s]."""
        opening = np.clip(
            (cap - m.tank_pressure + RATIO * (rod - m.tank_pressure) - SETTING) / RANGE, 0.0, 1.0
        )
        port = SIZE * opening * m.valve_coefficient[0]
        series = edge * port / np.hypot(edge, port)
        return series * np.sqrt(cap - m.tank_pressure) - m.cap_area[0] * SPEED

    cap = brentq(find_excess, m.tank_pressure + 1.0, 5e7)
    np.testing.assert_allclose(circuit.pressure[:2], (cap, rod), rtol=1e-3)
    assert 0.1 < circuit.valves.records["opening"][-6] < 0.9
    _, without, _ = make_circuit(None)
    without.actuators["valve_command"][0] = COMMAND
    for _ in range(200):
        without.advance(length, speed, 20)
    assert circuit.pressure[0] > 1.2 * without.pressure[0]
    energies = {name: float(circuit.energy[name][0]) for name in circuit.energy.dtype.names}
    volumes = {name: float(circuit.volume[name][0]) for name in circuit.volume.dtype.names}
    assert abs(compute_energy_gap(energies)) < 1e-6
    assert abs(compute_volume_gap(volumes)) < 1e-12


def test_a_load_that_it_holds_does_not_sink_through_the_lands_of_the_servo_valve():
    """The piston stands still; without the valve its chamber loses oil over the lands."""
    lands = {"hydraulics__valve__land_leakage": 0.5}
    kept = []
    for section in (None, {**VALVE, "setting": 3e7, "pilot_ratio": 0.0}):
        _, circuit, length = make_circuit(section, **lands)
        circuit.pressure[0] = 1e7  # above the line's pressure
        for _ in range(50):
            circuit.advance(length, np.zeros(3), 20)
        kept.append(circuit.pressure[0])
    assert kept[0] < 9.9e6
    assert kept[1] == pytest.approx(1e7, rel=1e-9)


def test_a_section_without_a_setting_is_refused_by_its_path():
    with pytest.raises(MachineFileError, match=r"circuit\.valves\.counterbalance\.setting"):
        make_circuit({"pilot_ratio": 3.0})


def test_two_kinds_at_one_chamber_are_refused(monkeypatch):
    other = dataclasses.replace(COUNTERBALANCE_VALVE, name="other")
    monkeypatch.setattr(registry, "PORT_VALVE_KINDS", (COUNTERBALANCE_VALVE, other))
    machine = load_machine().with_values(
        {"circuit.valves": {"counterbalance": VALVE, "other": VALVE}}
    )
    with pytest.raises(MachineFileError, match="other: a chamber has a port valve of another kind"):
        build_circuit(machine, STEP)
