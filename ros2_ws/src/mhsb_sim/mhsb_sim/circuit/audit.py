"""Audit of the circuit: energy and oil that its elements have turned over, substep by substep."""

from mhsb_model.circuit.elements import compute_shaft_power
from mhsb_model.circuit.quantities import CircuitConstants, ModuleState
from mhsb_model.kernels.kernel import kernel
from mhsb_model.records import Records
from mhsb_model.types import FloatArray
from mhsb_sim.circuit.quantities import (
    ANTI_CAVITATION,
    CHECK_VALVE,
    FIRST_VALVE,
    JOIN_VALVE,
    LEAKAGE_PATH,
    RELIEF_VALVE,
    SERVO_PUMP,
    SERVO_PUMP_SLIP,
    SERVO_VALVE,
    CircuitElement,
    CircuitEnergies,
    CircuitVolumes,
)

UNBALANCED_ENERGIES = ("friction", "main_pump_shaft")
"""Energies that are no terms of the balance.

`friction` is part of `piston_work`; `main_pump_shaft` includes `main_pump`."""


@kernel(borrows=True)
def audit_elements(
    net: Records[CircuitElement],
    count: int,
    pressure: FloatArray,
    change: FloatArray,
    c: CircuitConstants,
    e: CircuitEnergies,
    counters: FloatArray,
    volume: CircuitVolumes,
) -> None:
    """Add to each element's counter the energy that flows into the element in a substep.

    The energy is flow times pressure drop times duration, with the mean values of the substep. So
    the energies into and out of every node are equal (Tellegen's theorem). For a servo pump, the
    energy at its shaft and its losses are added instead. The net oil that returns to the tank is
    counted, too, with its energy at tank pressure.

    Args:
        net: Elements of this substep, CircuitElement, each with its two nodes, its flow [m³/s] and
            its slope dQ/dΔp [m³/(s Pa)].
        count: Number of elements in `net`.
        pressure: Pressure of each node before the substep, the tank's last [Pa].
        change: Change of each pressure in the substep [Pa].
        c: Constants of the circuit. Reads the duration `substep` [s] and the efficiency of the
            servo pumps.
        e: Energy counters [J], updated in place: the counters of the elements, and `return_oil`.
        counters: The same counters as a flat array, float64[energies], updated in place. Registered
            kinds of valves (`valves.registry`) have counters with an index but no name.
        volume: Oil counters [m³]. Only `returned` is updated, in place.
    """
    tank, dt = len(pressure) - 1, c.substep
    for k in range(count):
        element = net[k]
        i, j = element.start, element.end
        flow = element.flow + element.slope * (change[i] - change[j])
        drop = pressure[i] - pressure[j] + 0.5 * (change[i] - change[j])
        work = flow * drop * dt
        if element.kind == SERVO_VALVE:
            e.servo_valves += work
        elif element.kind == LEAKAGE_PATH:
            e.leakage += work
        elif element.kind == CHECK_VALVE:
            e.check_valves += work
        elif element.kind == JOIN_VALVE:
            e.join_valves += work
        elif element.kind == SERVO_PUMP:
            shaft = max(0.0, -work) / c.servo_pump_efficiency
            e.servo_pumps += shaft
            e.servo_pump_losses += shaft + work
        elif element.kind == SERVO_PUMP_SLIP:
            e.servo_pump_losses += work
        elif element.kind == RELIEF_VALVE:
            e.relief_valves += work
        elif element.kind == ANTI_CAVITATION:
            e.anti_cavitation += work
        else:
            counters[element.kind - FIRST_VALVE] += work
        if j == tank or i == tank:
            returned = flow * dt if j == tank else -flow * dt
            e.return_oil += returned * pressure[tank]
            volume.returned += returned


@kernel
def audit_main_pump(
    flow: float, pressure: float, c: CircuitConstants, e: CircuitEnergies, volume: CircuitVolumes
) -> None:
    """Add the main pump's oil, hydraulic energy and shaft work of a substep to the counters.

    Args:
        flow: Mean flow of the pump in the substep [m³/s].
        pressure: Mean pressure behind the pump [Pa].
        c: Constants of the circuit. Uses the duration `substep` [s], and the pump's efficiency and
            drag power [W].
        e: Energy counters [J]. Adds to `main_pump` and `main_pump_shaft` in place.
        volume: Oil counters [m³]. Adds to `main_pump` in place.
    """
    work = flow * pressure
    e.main_pump += work * c.substep
    e.main_pump_shaft += c.substep * compute_shaft_power(
        work, 1.0, c.main_pump_efficiency, c.main_pump_drag
    )
    volume.main_pump += flow * c.substep


@kernel(borrows=True)
def audit_drag(modules: Records[ModuleState], c: CircuitConstants, e: CircuitEnergies) -> None:
    """Add the work W that the drag of all servo pumps takes in a substep to the energy counters.

        W = Σ_k P_d (Q_k/Q_full) Δt

    k counts the servo pumps. The drag does not depend on the pressure.

    Args:
        modules: Records of the booster modules, ModuleState[m], with their flows Q_k [m³/s].
        c: Constants of the circuit. Uses `substep` Δt [s], `servo_pump_flow` Q_full [m³/s] and
            `servo_pump_drag` P_d [W].
        e: Energy counters [J]. Adds to `servo_pumps` and `servo_pump_losses` in place.
    """
    for k in range(len(modules)):
        speed = modules[k].flow / c.servo_pump_flow
        drag = c.substep * compute_shaft_power(
            0.0, speed, c.servo_pump_efficiency, c.servo_pump_drag
        )
        e.servo_pumps += drag
        e.servo_pump_losses += drag


@kernel
def audit_node(
    capacity: float,
    inflow: float,
    change: float,
    before: float,
    after: float,
    e: CircuitEnergies,
    volume: CircuitVolumes,
) -> None:
    """Add the energy and oil that a node has stored in a substep to the counters.

    The part C (after − before) of the inflow counts as compression. The rest counts as oil that
    fills the node's vapour cavity. The rest is negative if the cavity grows.

    Args:
        capacity: Capacity C of the node, oil volume per pressure [m³/Pa].
        inflow: Oil that flowed into the node in the substep [m³].
        change: Pressure change that the step's linear system gave [Pa]; `inflow` belongs to it.
        before: Pressure before the step [Pa].
        after: Pressure after the step [Pa]. It differs from before + change if the node is at
            vapour pressure.
        e: Energy counters [J]. Adds to `compression` and `cavities` in place.
        volume: Oil counters [m³]. Adds to `compression` and `cavities` in place.
    """
    stored = capacity * (after - before)
    work = stored * 0.5 * (before + after)
    e.compression += work
    e.cavities += inflow * (before + 0.5 * change) - work
    volume.compression += stored
    volume.cavities += inflow - stored


def compute_energy_gap(energies: dict[str, float]) -> float:
    """Return the error of the energy balance: energy from the pumps minus energy accounted for.

    `main_pump` and `servo_pumps` are the energy from the pumps. The other counters, except
    UNBALANCED_ENERGIES, say where this energy has gone.

    Args:
        energies: Energies by the field names of CircuitEnergies [J].

    Returns:
        The difference [J]; zero apart from rounding.
    """
    delivered = energies["main_pump"] + energies["servo_pumps"]
    return 2.0 * delivered - sum(
        energies[name] for name in energies if name not in UNBALANCED_ENERGIES
    )


def compute_volume_gap(volumes: dict[str, float]) -> float:
    """Return the error of the oil balance: oil from the main pump minus oil accounted for.

    `main_pump` is the oil from the pump. All other counters say where this oil has gone.

    Args:
        volumes: Volumes by the field names of CircuitVolumes [m³].

    Returns:
        The difference [m³]; zero apart from rounding.
    """
    return 2.0 * volumes["main_pump"] - sum(volumes.values())


def sum_energy_by_source(energies: dict[str, float]) -> dict[str, dict[str, float]]:
    """Return the hydraulic energy and the shaft energy of each kind of pump.

    Do not add hydraulic and shaft energies: the shaft energy includes the hydraulic one.

    Args:
        energies: Energies by the field names of CircuitEnergies [J].

    Returns:
        Two energies [J] for each of "main_pump" and "servo_pumps": "hydraulic" is given to the oil,
        and "shaft" is taken from the motor at the shaft.
    """
    return {
        "main_pump": {"hydraulic": energies["main_pump"], "shaft": energies["main_pump_shaft"]},
        "servo_pumps": {
            "hydraulic": energies["servo_pumps"] - energies["servo_pump_losses"],
            "shaft": energies["servo_pumps"],
        },
    }
