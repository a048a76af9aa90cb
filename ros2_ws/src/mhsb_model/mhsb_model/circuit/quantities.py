"""Record types of the circuit: constants, states and commands of its components."""

from __future__ import annotations

import numpy as np

CYLINDER_DTYPE = np.dtype(
    [
        ("cap_area", "f8"),  # m²
        ("rod_area", "f8"),  # m²
        ("min_length", "f8"),  # m, between the pins, fully retracted within the joint limits
        ("max_length", "f8"),  # m, between the pins, fully extended within the joint limits
        ("dead_volume", "f8"),  # m³, oil left in a chamber when the piston is at its end
        ("valve_coefficient", "f8"),  # m³/(s √Pa), of one edge of the fully open servo valve
        ("friction", "f8"),  # ratio of the cylinder's friction to that of CONSTANTS_DTYPE
        ("swept", "f8"),  # 1; 0 of a rotary motor, whose oil volume does not depend on position
    ]
)
"""Constants of a cylinder and its servo valve, one record for each actuator."""

CONSTANTS_DTYPE = np.dtype(
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
            "leakage_coefficient",  # m³/(s √Pa)
            "check_coefficient",  # m³/(s √Pa)
            "switching_coefficient",  # m³/(s √Pa)
            "bleed_conductance",  # m³/(s Pa)
            "anti_cavitation_gain",  # m³/(s Pa)
            "relief_gain",  # m³/(s Pa)
            "line_relief",  # Pa
            "manifold_relief",  # Pa
            "vapour_pressure",  # Pa
            "pump_filling",  # Pa above vapour pressure at which a servo pump is completely filled
            "main_pump_efficiency",
            "main_pump_drag",  # W
            "servo_pump_drag",  # W
            "servo_pump_flow",  # m³/s, largest flow of one pump
            "servo_pump_decay",  # e^(−substep/τ) of a pump's lag τ
            "servo_pump_slew",  # m³/s²
            "servo_pump_power",  # W
            "servo_pump_efficiency",
            "switching_time",  # s
            "switching_decay",  # e^(−substep/switching_time)
            "coulomb_friction",  # N
            "viscous_friction",  # N s/m
            "friction_speed",  # m/s
            "breakaway",  # ratio of static to Coulomb friction
            "stribeck_speed",  # m/s
            "bristle_stiffness",  # N/m, 0 for friction without memory
            "bristle_damping",  # N s/m
            "valve_overlap",  # share of the stroke
            "valve_hysteresis",  # share of the stroke
            "spool_rate",  # 1/s
            "accumulator_volume",  # m³
            "accumulator_precharge",  # Pa
            "accumulator_exponent",
            "substep",  # s
            "spool_00",  # transition matrix of the spool over one substep, `spool_transition`
            "spool_01",
            "spool_10",
            "spool_11",
        )
    ]
)
"""Constants of the whole circuit, a single record."""

ACTUATOR_DTYPE = np.dtype(
    [
        ("valve_command", "f8"),  # −1 … 1, commanded spool position, positive extends
        ("join_command", "f8"),  # 0 … 1, commanded opening of the valve between rail and line
        ("pilot", "f8"),  # −1 … 1, commanded spool position after the valve's hysteresis
        ("spool", "f8"),  # −1 … 1, spool position
        ("spool_speed", "f8"),  # 1/s
        ("join", "f8"),  # 0 … 1, opening of the valve between rail and line
        ("relief", "f8"),  # Pa, setting of the relief valves of its chambers
        ("force", "f8"),  # N, p_A A − p_B a
        ("friction", "f8"),  # N
        ("bend", "f8"),  # m, bristle deflection of the LuGre friction model
        ("supply_flow", "f8"),  # m³/s, line to chambers
        ("return_flow", "f8"),  # m³/s, chambers to tank
        ("isolated", "f8"),  # 0 … 1, closed share of the valve that isolates both chambers
        ("isolating_command", "f8"),  # 0 … 1, command of that valve, 1 closes
        ("obeys", "f8"),  # 1; 0 by a fault: the spool goes to `runaway`, whatever its command
        ("runaway", "f8"),  # −1 … 1, spool position of that fault
        ("seized", "f8"),  # 1 if the spool is stuck, else 0
        ("leakage", "f8"),  # ratio of the line's leakage to that of a healthy one
    ]
)
"""State, commands and faults of an actuator: servo valve, join valve, chambers, friction."""

MODULE_DTYPE = np.dtype(
    [
        ("flow_command", "f8"),  # m³/s, commanded flow
        ("lend", "f8"),  # command of the switching valve: 1 feeds the rail, 0 the own line
        ("flow", "f8"),  # m³/s, displacement times speed
        ("delivered", "f8"),  # m³/s, flow times the share that the inlet fills
        ("to_rail", "f8"),  # 0 … 1, share of the flow that goes to the rail
        ("slowness", "f8"),  # ratio of the pump's lag to that of a healthy one
        ("strength", "f8"),  # ratio of the largest flow to that of a healthy pump
        ("runs_on", "f8"),  # 1 by a fault: the pump gives its largest flow, whatever its command
    ]
)
"""State, commands and faults of a booster module: servo pump and switching valve."""
