"""What the circuit is described by: its constants, its state, and what it has turned over."""

from __future__ import annotations

import numpy as np

CYLINDER = np.dtype(
    [
        ("cap_area", "f8"),  # m²
        ("rod_area", "f8"),  # m²
        ("min_length", "f8"),  # m, at one joint limit
        ("max_length", "f8"),  # m, at the other
        ("dead_volume", "f8"),  # m³ of oil on each side at its end
        ("valve_coefficient", "f8"),  # m³/(s √Pa), one edge of its valve fully open
        ("friction", "f8"),  # its friction over what the circuit has of all
        ("swept", "f8"),  # 1, or 0 of a motor, in which there is as much oil wherever it stands
    ]
)

CONSTANTS = np.dtype(
    [
        (name, "f8")
        for name in (
            "tank_pressure",  # Pa
            "supply_pressure",  # Pa
            "main_pump_flow",  # m³/s
            "main_pump_droop",  # Pa
            "bulk_modulus",  # Pa
            "line_capacity",  # m³/Pa
            "rail_capacity",  # m³/Pa
            "manifold_capacity",  # m³/Pa
            "laminar_pressure",  # Pa
            "leakage_coefficient",  # m³/(s √Pa), likewise below
            "check_coefficient",
            "switching_coefficient",
            "bleed_conductance",  # m³/(s Pa), likewise both below
            "anti_cavitation_gain",
            "relief_gain",
            "line_relief",  # Pa
            "manifold_relief",  # Pa
            "vapour_pressure",  # Pa
            "pump_filling",  # Pa, above vapour pressure at which a servo pump is filled wholly
            "main_pump_efficiency",
            "main_pump_drag",  # W, likewise the next
            "servo_pump_drag",
            "servo_pump_flow",  # m³/s, the most one pump gives
            "servo_pump_decay",  # of a pump's lag in a substep
            "servo_pump_slew",  # m³/s²
            "servo_pump_power",  # W
            "servo_pump_efficiency",
            "switching_time",  # s
            "switching_decay",  # of that lag in a substep
            "coulomb_friction",  # N
            "viscous_friction",  # N s/m
            "friction_speed",  # m/s
            "breakaway",  # static over Coulomb friction
            "stribeck_speed",  # m/s
            "bristle_stiffness",  # N/m, 0 for friction without memory
            "bristle_damping",  # N s/m
            "valve_overlap",  # share of the stroke, likewise the next
            "valve_hysteresis",
            "spool_rate",  # 1/s
            "accumulator_volume",  # m³
            "accumulator_precharge",  # Pa
            "accumulator_exponent",
            "substep",  # s
            "spool_00",  # transition of the spool over one substep
            "spool_01",
            "spool_10",
            "spool_11",
        )
    ]
)

ACTUATOR = np.dtype(
    [
        ("valve_command", "f8"),  # −1 … 1, positive extends
        ("join_command", "f8"),  # 0 … 1, opening of the join valve
        ("pilot", "f8"),  # the command beyond the valve's hysteresis
        ("spool", "f8"),
        ("spool_speed", "f8"),  # 1/s
        ("join", "f8"),
        ("relief", "f8"),  # Pa, setting of the relief valves of its chambers
        ("force", "f8"),  # N, p_A A − p_B a
        ("friction", "f8"),  # N
        ("bend", "f8"),  # m, of the bristles that stick and slip
        ("supply_flow", "f8"),  # m³/s, line to chambers
        ("return_flow", "f8"),  # m³/s, chambers to tank
        ("isolated", "f8"),  # 0 … 1, how far its isolating valve has shut both chambers off
        ("isolating_command", "f8"),
        ("obeys", "f8"),  # 1, or 0 where the spool goes to `runaway` whatever it is told
        ("runaway", "f8"),  # −1 … 1
        ("seized", "f8"),  # 1 where the spool does not move
        ("leakage", "f8"),  # of its line, over that of a healthy one
    ]
)

MODULE = np.dtype(
    [
        ("flow_command", "f8"),  # m³/s
        ("lend", "f8"),  # 1 where the module is to feed the rail
        ("flow", "f8"),  # m³/s, displacement times speed
        ("delivered", "f8"),  # m³/s, less where its inlet does not fill it
        ("to_rail", "f8"),  # share of the flow that the diverter sends to the rail
        ("slowness", "f8"),  # the pump's lag over that of a healthy one
        ("strength", "f8"),  # share of the flow of a healthy pump that it can give
        ("runs_on", "f8"),  # 1 where it gives all it can, whatever it is told
    ]
)

ENERGY = np.dtype(
    [
        (name, "f8")
        for name in (  # all in J since the start
            "main_pump",  # hydraulic
            "main_pump_shaft",  # beside all others
            "servo_pumps",  # at their shafts
            "servo_pump_losses",  # of that, what does not reach the oil
            "piston_work",
            "compression",
            "servo_valves",
            "leakage",
            "check_valves",
            "join_valves",
            "relief_valves",
            "anti_cavitation",
            "bleed",
            "cavities",  # where oil has parted
            "return_oil",
            "friction",  # within piston_work, not beside it
        )
    ]
)

VOLUME = np.dtype(
    [
        (name, "f8")
        for name in (  # all in m³ since the start
            "main_pump",  # delivered
            "returned",  # to the tank, less what was drawn from it
            "pistons",  # room that the pistons have made
            "compression",  # ∫ C dp of all nodes
            "cavities",  # oil that vapour stands in for, negative
        )
    ]
)

(SERVO_VALVE, LEAKAGE, CHECK, JOIN, SERVO_PUMP, RELIEF, ANTI_CAVITATION, BLEED) = range(8)

ELEMENT = np.dtype(
    [
        ("kind", "i8"),  # one of those above
        ("start", "i8"),  # node
        ("end", "i8"),  # node
        ("flow", "f8"),  # m³/s, from start to end
        ("slope", "f8"),  # m³/(s Pa), by the pressure drop
    ]
)
