"""Faults: how they are written, and that healing takes back all of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mhsb_model.machine import Machine
from mhsb_sim.errors import FaultError
from mhsb_sim.simulation.faults import FAULT_KINDS, Fault, list_places, parse_faults
from mhsb_sim.simulation.simulator import Simulator


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("none", ()),
        ("", ()),
        ("main_pump", (Fault("main_pump"),)),
        ("supply_sag", (Fault("supply_sag", 0, 3.3e6),)),
        ("supply_sag::2e6", (Fault("supply_sag", 0, 2e6),)),
        ("servo_pump_dead:2, valve_stuck:actuator_3", None),
        ("sensor_dead:actuator_1.line_pressure", (Fault("sensor_dead", 5),)),
        ("pressure_offset:actuator_2.rod_pressure:-1e5", (Fault("pressure_offset", 4, -1e5),)),
        ("length_offset:actuator_3.length", (Fault("length_offset", 2, 5e-3),)),
    ],
)
def test_faults_are_written_by_kind_place_and_value(
    machine: Machine, text: str, faults: tuple[Fault, ...] | None
) -> None:
    wanted = faults
    if wanted is None:
        wanted = Fault("servo_pump_dead", 1), Fault("valve_stuck", 2)
    for found, each in zip(parse_faults(text, machine), wanted, strict=True):
        assert found[:2] == each[:2]
        assert found.value == each.value or (math.isnan(found.value) and math.isnan(each.value))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("gremlins", "there is no fault 'gremlins'; valid are none, main_pump, "),
        ("servo_pump_dead:9", "is at 9; servo_pump_dead takes one of 1, 2, 3, 4"),
        ("valve_stuck", "is at no place; valve_stuck takes one of actuator_1, actuator_2, "),
        ("main_pump:1", "is at 1; main_pump takes no place"),
        ("main_pump::3", "has the value '3'; main_pump takes none"),
        ("supply_sag::low", "has the value 'low'; supply_sag takes a number in Pa"),
        ("supply_sag::inf", "has the value 'inf'; supply_sag takes a number in Pa"),
        ("supply_sag::1e308", "has the value '1e308'; supply_sag takes 1000 to 5e+07 Pa"),
        ("length_offset:actuator_1.length:-1e308", "length_offset takes -10 to 10 m"),
    ],
)
def test_what_cannot_fail_is_refused_with_what_can(
    machine: Machine, text: str, sentence: str
) -> None:
    with pytest.raises(FaultError) as error:
        parse_faults(text, machine)
    assert sentence in str(error.value)


@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_every_fault_changes_the_run_and_its_healing_leaves_nothing_of_it(
    machine: Machine, kind: str
) -> None:
    """An arm at rest, a copy of it that fails, and one that was healed before it began."""
    place = next(iter(list_places(machine)[FAULT_KINDS[kind].places]), "")
    fault = parse_faults(f"{kind}:{place}" if place else kind, machine)

    def pressures(first: str, then: str) -> np.ndarray:
        simulator = Simulator(machine)
        for text in (first, then):
            simulator.inject_faults(parse_faults(text, machine))
        simulator._signals.modes[:] = simulator._signals.serves[:] = 1
        rows = []
        for _ in range(150):
            simulator.step()
            rows.append([*simulator._circuit.pressure, *simulator.sensed.silent])
        return np.array(rows)

    assert fault[0].kind == kind
    words = f"{kind}:{place}" if place else kind
    healthy = pressures("none", "none")
    np.testing.assert_array_equal(pressures(words, "none"), healthy)
    if kind not in STILL:
        assert not np.array_equal(pressures(words, words), healthy)


STILL = {"servo_pumps", "servo_pump_dead", "servo_pump_slow", "valve_stuck"}
"""Nothing shows of these while the arm rests in N."""


def test_every_value_of_a_fault_has_a_finite_range_and_the_usual_one_is_within():
    for kind in FAULT_KINDS.values():
        if kind.default_value is not None:
            least, greatest = kind.limits
            assert np.isfinite(kind.limits).all()
            assert least <= kind.default_value <= greatest
