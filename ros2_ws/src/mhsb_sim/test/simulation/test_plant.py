"""A plant that is not what its servo knows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mhsb_control import REGISTERED_CONTROLLERS
from mhsb_model.machine import Machine
from mhsb_model.schema import SupplySag
from mhsb_sim.circuit.audit import compute_energy_gap
from mhsb_sim.errors import PlantError
from mhsb_sim.simulation.faults import Fault, compute_sag_pressure
from mhsb_sim.simulation.simulator import Simulator

LIFTED = np.array([0.5, -1.1, -1.2])


def run(
    machine: Machine, motion: Any, values: dict[str, Any], controller: str = "coordinated"
) -> tuple[Simulator, np.ndarray]:
    """A motion of a plant with other values; tip errors [m] every 10 ms."""
    simulator = Simulator(machine, controller, plant=machine.with_values(values))
    simulator.set_plan(*motion(simulator.reference, LIFTED))
    errors = []
    for _ in range(200):
        simulator.advance(0.01)
        off = machine.tip_position(simulator.joint_state.position) - machine.tip_position(
            simulator.reference.position
        )
        errors.append(np.hypot(*off))
    return simulator, np.array(errors)


@pytest.mark.parametrize("controller", sorted(REGISTERED_CONTROLLERS))
def test_a_plant_like_the_file_is_what_the_servo_has_without_one(
    machine: Machine, motion: Any, controller: str
) -> None:
    plain = Simulator(machine, controller)
    plain.set_plan(*motion(plain.reference, LIFTED))
    plain.advance(2.0)
    same, _ = run(machine, motion, {}, controller)
    np.testing.assert_array_equal(plain.joint_state.position, same.joint_state.position)
    assert plain.energies == same.energies


@pytest.mark.parametrize("controller", sorted(REGISTERED_CONTROLLERS))
def test_the_controller_sees_nothing_of_the_plant_but_its_sensors(
    machine: Machine, controller: str
) -> None:
    """The same readings, the same commands: whatever the plant's constants and states are."""
    simulators = [
        Simulator(machine, controller),
        Simulator(
            machine,
            controller,
            plant=machine.with_values(
                {
                    "payload.mass": 14.0,
                    "circuit.bulk_modulus": 6e8,
                    "hydraulics.valve.rated_flow": 8e-5,
                    "circuit.coulomb_friction": 80.0,
                    "circuit.servo_pump_lag": 0.05,
                }
            ),
        ),
    ]
    first, second = (simulator._signals for simulator in simulators)
    random = np.random.default_rng(0)
    for _ in range(50):
        for name in first.sensors.dtype.names:
            first.sensors[name] *= 1.0 + 1e-3 * random.standard_normal(3)
            second.sensors[name] = first.sensors[name]
        second.rail_pressure[:] = first.rail_pressure
        second.circuit.modules["flow"] = first.circuit.modules["flow"]
        for simulator in simulators:
            simulator._servo.controller.update()
        for name in ("valve_command", "join_command"):
            np.testing.assert_array_equal(
                first.circuit.actuators[name], second.circuit.actuators[name]
            )
        np.testing.assert_array_equal(
            first.circuit.modules["flow_command"], second.circuit.modules["flow_command"]
        )


@pytest.mark.parametrize(
    "values",
    [
        {"payload.mass": 11.0},
        {"circuit.coulomb_friction": 80.0},
        {"circuit.bulk_modulus": 7e8},
        {"hydraulics.valve.rated_flow": 8e-5},
        {"circuit.servo_pump_lag": 0.04},
        {"imperfections.valve_overlap": 0.02},
        {"imperfections.valve_hysteresis": 0.01},
        {"imperfections.spool_rate": 0.2},
        {"imperfections.computing_delay": 0.002},
        {"imperfections.oil_temperature": 20.0},
        {
            "imperfections.stiction.breakaway": 1.5,
            "imperfections.stiction.speed": 2e-3,
            "imperfections.stiction.stiffness": 2e6,
            "imperfections.stiction.damping": 2e3,
        },
        {"imperfections.accumulator.volume": 1e-5, "imperfections.accumulator.precharge": 2e6},
        {"imperfections.sensors.length": "encoder_16_bit"},
        {"imperfections.sensors.pressure": "industrial"},
    ],
    ids=lambda values: next(iter(values)).rpartition(".")[2],
)
def test_what_is_not_as_the_file_says_shows_and_does_not_throw_the_arm(
    machine: Machine, motion: Any, values: dict[str, Any]
) -> None:
    nominal, _ = run(machine, motion, {})
    simulator, errors = run(machine, motion, values)
    assert np.any(simulator.joint_state.position != nominal.joint_state.position)
    assert errors.max() < 0.05
    assert abs(compute_energy_gap(simulator.energies)) < 1e-9 * simulator.energies["main_pump"]


def test_commands_are_late_by_the_computing_delay(machine: Machine, motion: Any) -> None:
    plant = machine.with_values({"imperfections.computing_delay": 0.003})
    simulator = Simulator(machine, plant=plant)
    simulator.set_plan(*motion(simulator.reference, LIFTED))
    asked, done = [], []
    for _ in range(300):
        simulator.step()
        asked.append(simulator._signals.circuit.actuators["valve_command"].copy())
        done.append(simulator._circuit.actuators["valve_command"].copy())
    np.testing.assert_array_equal(done[3:], asked[:-3])
    assert np.ptp(asked, axis=0).min() > 0.0


def test_the_supply_sags_there_and_back(machine: Machine) -> None:
    sag = SupplySag(start=0.1, fall=0.05, duration=0.2, pressure=3.4e6)
    at = {0.1: 4.0e6, 0.125: 3.7e6, 0.15: 3.4e6, 0.35: 3.4e6, 0.375: 3.7e6, 0.4: 4.0e6, 9.0: 4.0e6}
    for time, pressure in at.items():
        assert compute_sag_pressure(4.0e6, sag, time) == pytest.approx(pressure)
    values = {f"imperfections.supply_sag.{k}": v for k, v in sag.model_dump().items()}
    simulator = Simulator(machine, plant=machine.with_values(values))
    lowest = np.inf
    for _ in range(50):
        simulator.advance(0.01)
        lowest = min(lowest, simulator.actuator_states.manifold_pressure)
    assert lowest == pytest.approx(3.4e6, abs=machine.config.circuit.main_pump_droop)
    assert simulator.actuator_states.manifold_pressure > 3.95e6


def test_a_fault_of_the_supply_counts_beside_a_sag(machine: Machine) -> None:
    sag = SupplySag(start=0.1, fall=0.05, duration=0.2, pressure=3.7e6)
    values = {f"imperfections.supply_sag.{k}": v for k, v in sag.model_dump().items()}
    simulator = Simulator(machine, plant=machine.with_values(values))
    simulator.inject_faults([Fault("supply_sag", value=3.3e6)])
    simulator.advance(0.3)
    droop = machine.config.circuit.main_pump_droop
    assert simulator.actuator_states.manifold_pressure == pytest.approx(3.3e6, abs=droop)
    simulator.inject_faults([])
    simulator.advance(0.04)
    assert simulator.actuator_states.manifold_pressure == pytest.approx(3.7e6, abs=droop)


def test_a_plant_of_another_build_is_refused(machine: Machine) -> None:
    plant = machine.with_values({"hydraulics.modules.count": 3})
    with pytest.raises(PlantError, match="the plant has 3 booster modules, the machine that its"):
        Simulator(machine, plant=plant)
