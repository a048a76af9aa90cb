"""Counters of energy and oil in the simulated circuit, and records of its elements."""

from __future__ import annotations

import numpy as np

ENERGY_DTYPE = np.dtype(
    [
        (name, "f8")
        for name in (  # all in J since the start
            "main_pump",  # hydraulic energy delivered by the main pump
            "main_pump_shaft",  # work at its shaft, no term of the balance
            "servo_pumps",  # work at the shafts of the servo pumps
            "servo_pump_losses",  # part of that which does not reach the oil
            "piston_work",
            "compression",
            "servo_valves",
            "leakage",
            "check_valves",
            "join_valves",
            "relief_valves",
            "anti_cavitation",
            "bleed",
            "cavities",  # in vapour cavities
            "return_oil",
            "friction",  # part of piston_work, no term of the balance
        )
    ]
)
"""Counters of energy [J] since the start."""

VOLUME_DTYPE = np.dtype(
    [
        (name, "f8")
        for name in (  # all in m³ since the start
            "main_pump",  # delivered by the main pump
            "returned",  # returned to the tank, less what was drawn from it
            "pistons",  # swept by the pistons, (A − a) times their stroke
            "compression",  # ∫ C dp of all nodes
            "cavities",  # oil missing in vapour cavities, negative
        )
    ]
)
"""Counters of oil volume [m³] since the start."""

(
    SERVO_VALVE,
    LEAKAGE_PATH,
    CHECK_VALVE,
    JOIN_VALVE,
    SERVO_PUMP,
    RELIEF_VALVE,
    ANTI_CAVITATION,
    BLEED_VALVE,
) = range(8)

ELEMENT_DTYPE = np.dtype(
    [
        ("kind", "i8"),  # one of the kinds above, SERVO_VALVE …
        ("start", "i8"),  # node from which the flow is counted
        ("end", "i8"),  # node to which the flow is counted
        ("flow", "f8"),  # [m³/s] from start to end
        ("slope", "f8"),  # [m³/(s Pa)] dQ/dΔp by the pressure drop
    ]
)
"""One element of the circuit between two nodes, in the present substep."""
