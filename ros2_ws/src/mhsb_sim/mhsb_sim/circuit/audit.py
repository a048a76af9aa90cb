"""Where the circuit's energy and oil go, substep by substep."""

from __future__ import annotations

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray
from mhsb_sim.circuit.elements import shaft_power
from mhsb_sim.circuit.quantities import (
    ANTI_CAVITATION,
    CHECK,
    JOIN,
    LEAKAGE,
    RELIEF,
    SERVO_PUMP,
    SERVO_VALVE,
)
from mhsb_sim.records import Record, Records

BESIDE = ("friction", "main_pump_shaft")
"""Energies that are no item of the balance: within `piston_work`, and before `main_pump`."""

@kernel(borrows=True)
def audit(
    net: Records,
    count: int,
    pressure: FloatArray,
    change: FloatArray,
    tank: int,
    efficiency: float,
    dt: float,
    e: Record,
    volume: Record,
) -> None:
    """Add the energy that each element has turned over in a substep to its counter [J].

    With the mean flow and the mean pressures of the step, as the implicit scheme has it, so that
    power in = power out holds node by node (Tellegen's theorem). Oil to and from the tank is
    counted too [m³]. change: Δp [Pa] of the step.
    """
    for k in range(count):
        element = net[k]
        i, j = element.start, element.end
        flow = element.flow + element.slope * (change[i] - change[j])
        drop = pressure[i] - pressure[j] + 0.5 * (change[i] - change[j])
        work = flow * drop * dt
        if element.kind == SERVO_VALVE:
            e.servo_valves += work
        elif element.kind == LEAKAGE:
            e.leakage += work
        elif element.kind == CHECK:
            e.check_valves += work
        elif element.kind == JOIN:
            e.join_valves += work
        elif element.kind == SERVO_PUMP:
            shaft = max(0.0, -work) / efficiency
            e.servo_pumps += shaft
            e.servo_pump_losses += shaft + work
        elif element.kind == RELIEF:
            e.relief_valves += work
        elif element.kind == ANTI_CAVITATION:
            e.anti_cavitation += work
        else:
            e.bleed += work
        if j == tank or i == tank:
            returned = flow * dt if j == tank else -flow * dt
            e.return_oil += returned * pressure[tank]
            volume.returned += returned


@kernel
def audit_main_pump(flow: float, pressure: float, c: Record, e: Record, volume: Record) -> None:
    """Add what the main pump has delivered in a substep, and the work at its shaft.

    flow [m³/s], pressure [Pa] behind it, c: CONSTANTS.
    """
    work = flow * pressure
    e.main_pump += work * c.substep
    e.main_pump_shaft += c.substep * shaft_power(
        work, 1.0, c.main_pump_efficiency, c.main_pump_drag
    )
    volume.main_pump += flow * c.substep


@kernel(borrows=True)
def audit_drag(modules: Records, c: Record, e: Record) -> None:
    """Add what turning the servo pumps takes beside the pressure, in a substep; c: CONSTANTS."""
    for k in range(len(modules)):
        speed = modules[k].flow / c.servo_pump_flow
        drag = c.substep * shaft_power(0.0, speed, c.servo_pump_efficiency, c.servo_pump_drag)
        e.servo_pumps += drag
        e.servo_pump_losses += drag


@kernel
def audit_node(
    capacity: float,
    inflow: float,
    change: float,
    before: float,
    after: float,
    e: Record,
    volume: Record,
) -> None:
    """Add what a node has stored in a substep: oil by its compression, the rest in its cavity.

    inflow [m³] that the step let in at the mean of `before` and `before + change` [Pa], its own
    forecast of the pressure; after: the pressure that it came to be.
    """
    stored = capacity * (after - before)
    work = stored * 0.5 * (before + after)
    e.compression += work
    e.cavities += inflow * (before + 0.5 * change) - work
    volume.compression += stored
    volume.cavities += inflow - stored


def energy_gap(energies: dict[str, float]) -> float:
    """Energy delivered by the pumps less all that is accounted for [J]."""
    delivered = energies["main_pump"] + energies["servo_pumps"]
    return 2.0 * delivered - sum(energies[name] for name in energies if name not in BESIDE)


def volume_gap(volumes: dict[str, float]) -> float:
    """Oil delivered by the main pump less all that is accounted for [m³]."""
    return 2.0 * volumes["main_pump"] - sum(volumes.values())


def energy_by_source(energies: dict[str, float]) -> dict[str, dict[str, float]]:
    """What each kind of pump has given to the oil, and what its shafts took [J].

    The one is no part of the other's boundary: they are not to be added up across.
    """
    return {
        "main_pump": {"hydraulic": energies["main_pump"], "shaft": energies["main_pump_shaft"]},
        "servo_pumps": {
            "hydraulic": energies["servo_pumps"] - energies["servo_pump_losses"],
            "shaft": energies["servo_pumps"],
        },
    }
