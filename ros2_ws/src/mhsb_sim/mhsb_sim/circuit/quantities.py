"""Counters of energy and oil in the simulated circuit, and records of its elements."""

from mhsb_model.records import Record


class CircuitEnergies(Record):
    """Counters of energy [J] since the start."""

    main_pump: float
    """Hydraulic energy delivered by the main pump."""
    main_pump_shaft: float
    """Work at the main pump's shaft; no term of the balance."""
    servo_pumps: float
    """Work at the shafts of the servo pumps."""
    servo_pump_losses: float
    """Part of that work which does not reach the oil."""
    piston_work: float
    """Work of the oil on the pistons."""
    compression: float
    """Energy stored in compressed oil."""
    servo_valves: float
    """Loss in the servo valves."""
    leakage: float
    """Loss in the leakage of the servo valves."""
    check_valves: float
    """Loss in the check valves."""
    join_valves: float
    """Loss in the join valves."""
    relief_valves: float
    """Loss in the relief valves."""
    anti_cavitation: float
    """Loss in the anti-cavitation valves."""
    bleed: float
    """Loss in the bleed valve of the rail."""
    cavities: float
    """Energy in vapour cavities."""
    return_oil: float
    """Energy of the oil that returned to the tank at its pressure."""
    friction: float
    """Work against friction, part of `piston_work`; no term of the balance."""


class CircuitVolumes(Record):
    """Counters of oil volume [m³] since the start."""

    main_pump: float
    """Oil delivered by the main pump."""
    returned: float
    """Oil returned to the tank, less what was drawn from it."""
    pistons: float
    """Oil swept by the pistons, (A − a) times their stroke."""
    compression: float
    """Oil stored by compression, ∫ C dp of all nodes."""
    cavities: float
    """Oil missing in vapour cavities, negative."""


(
    SERVO_VALVE,
    LEAKAGE_PATH,
    CHECK_VALVE,
    JOIN_VALVE,
    SERVO_PUMP,
    SERVO_PUMP_SLIP,
    RELIEF_VALVE,
    ANTI_CAVITATION,
    FIRST_VALVE,
) = range(9)
"""Kinds of elements. FIRST_VALVE + i is a valve of the registry with the energy counter i."""


class CircuitElement(Record):
    """One element of the circuit between two nodes, in the present substep."""

    kind: int
    """One of the kinds above, SERVO_VALVE …, or FIRST_VALVE and more."""
    start: int
    """Node from which the flow is counted."""
    end: int
    """Node to which the flow is counted."""
    flow: float
    """Flow Q from start to end [m³/s]."""
    slope: float
    """Derivative dQ/dΔp of the flow by the pressure drop [m³/(s Pa)]."""
