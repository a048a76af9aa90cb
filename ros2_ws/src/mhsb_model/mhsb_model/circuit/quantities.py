"""Record types of the circuit: constants, states and commands of its components."""

from mhsb_model.records import Record


class CylinderConstants(Record):
    """Constants of a cylinder and its servo valve."""

    cap_area: float
    """Piston area on the cap side [m²]."""
    rod_area: float
    """Piston area on the rod side [m²]."""
    min_length: float
    """Length between the pins, fully retracted within the joint limits [m]."""
    max_length: float
    """Length between the pins, fully extended within the joint limits [m]."""
    dead_volume: float
    """Oil left in a chamber when the piston is at its end [m³]."""
    valve_coefficient: float
    """Coefficient of one edge of the fully open servo valve [m³/(s √Pa)]."""
    friction: float
    """Ratio of the cylinder's friction to that of `CircuitConstants`."""
    swept_volume_factor: float
    """0 for a rotary motor, whose oil volume does not depend on position, else 1."""


class CircuitConstants(Record):
    """Constants of the whole circuit, a single record."""

    tank_pressure: float
    """Pressure of the tank [Pa]."""
    supply_pressure: float
    """Pressure P_S that the main pump keeps [Pa]."""
    main_pump_flow: float
    """Largest flow of the main pump [m³/s]."""
    main_pump_droop: float
    """Pressure drop of the main pump from no flow to its largest flow [Pa]."""
    main_pump_decay: float
    """Decay e^(−substep/τ) of the lag τ of the main pump's swash plate; 0 without a lag."""
    main_pump_memory: float
    """Weight of the main pump's flow before a substep in its mean flow during it; 0 without lag."""
    bulk_modulus: float
    """Bulk modulus β of the oil [Pa]."""
    free_air: float
    """Share of the oil's volume at atmospheric pressure that is free air; 0 without air."""
    line_capacity: float
    """Capacity V/β of an actuator's line [m³/Pa]."""
    rail_capacity: float
    """Capacity V/β of the shared rail [m³/Pa]."""
    manifold_capacity: float
    """Capacity V/β of the main pump's manifold [m³/Pa]."""
    laminar_pressure: float
    """Pressure drop at which an orifice becomes laminar [Pa]."""
    leakage_coefficient: float
    """Coefficient of a servo valve's leakage that does not pass a work port [m³/(s √Pa)]."""
    land_conductance: float
    """Leakage of each land of a servo valve's spool at zero overlap [m³/(s Pa)]; 0 if tight."""
    land_length: float
    """Overlap that halves the leakage of a land, a share of the spool's stroke."""
    lock_valve_opening: float
    """Opening of a servo valve below which its lock valves shut; 0 without lock valves."""
    check_coefficient: float
    """Coefficient of an open check valve [m³/(s √Pa)]."""
    switching_coefficient: float
    """Coefficient of an open join valve [m³/(s √Pa)]."""
    bleed_conductance: float
    """Flow through the rail's bleed valve per pressure drop [m³/(s Pa)]."""
    anti_cavitation_gain: float
    """Flow through an anti-cavitation valve per pressure drop [m³/(s Pa)]."""
    relief_gain: float
    """Flow through a relief valve per pressure above its setting [m³/(s Pa)]."""
    line_relief: float
    """Setting of the relief valves of lines and rail [Pa]."""
    manifold_relief: float
    """Setting of the manifold's relief valve [Pa]."""
    vapour_pressure: float
    """Vapour pressure of the oil [Pa]."""
    pump_filling: float
    """Pressure above vapour pressure at which a servo pump is completely filled [Pa]."""
    main_pump_efficiency: float
    """Efficiency of the main pump: hydraulic power divided by shaft power."""
    main_pump_drag: float
    """Drag power of the main pump [W]."""
    servo_pump_drag: float
    """Drag power of a servo pump at full speed [W]."""
    servo_pump_flow: float
    """Largest theoretical flow of one servo pump, displacement times speed [m³/s]."""
    servo_pump_slip: float
    """Slip of one servo pump per pressure rise [m³/(s Pa)]."""
    servo_pump_decay: float
    """Decay e^(−substep/τ) of a servo pump's lag τ."""
    servo_pump_slew: float
    """Largest rate of change of a servo pump's flow [m³/s²]."""
    servo_pump_power: float
    """Largest power of a servo pump's motor [W]."""
    servo_pump_efficiency: float
    """Efficiency of a servo pump without slip: hydraulic power divided by shaft power."""
    switching_time: float
    """Lag of join valves and diverters behind their commands [s]."""
    switching_decay: float
    """Decay e^(−substep/switching_time)."""
    coulomb_friction: float
    """Coulomb friction of a cylinder [N]."""
    viscous_friction: float
    """Viscous friction of a cylinder [N s/m]."""
    friction_speed: float
    """Piston speed at which 3/4 of the Coulomb friction acts [m/s]."""
    breakaway: float
    """Ratio of static to Coulomb friction."""
    stribeck_speed: float
    """Stribeck speed of the friction [m/s]."""
    bristle_stiffness: float
    """Stiffness of the bristles [N/m]; 0 for friction without memory."""
    bristle_damping: float
    """Damping of the bristles [N s/m]."""
    valve_overlap: float
    """Overlap of the extending side, a share of the spool's stroke."""
    valve_overlap_retracting: float
    """Overlap of the retracting side, a share of the spool's stroke."""
    valve_exponent: float
    """Exponent of the opening over the stroke beyond the overlap."""
    compensated_drop: float
    """Largest pressure drop over a metering edge [Pa]; inf without pressure compensators."""
    valve_hysteresis: float
    """Hysteresis of a servo valve, a share of its spool's stroke."""
    spool_rate: float
    """Largest speed of a spool [1/s]; inf without a limit."""
    accumulator_volume: float
    """Gas volume of the accumulator [m³]; 0 without accumulator."""
    accumulator_precharge: float
    """Precharge pressure of the accumulator [Pa]; inf without accumulator."""
    accumulator_exponent: float
    """Polytropic exponent of the accumulator's gas."""
    substep: float
    """Duration of a substep [s]."""
    spool_00: float
    """Entry of the spool's transition matrix over one substep in row 0, column 0."""
    spool_01: float
    """Entry of the spool's transition matrix in row 0, column 1 [s]."""
    spool_10: float
    """Entry of the spool's transition matrix in row 1, column 0 [1/s]."""
    spool_11: float
    """Entry of the spool's transition matrix in row 1, column 1."""


class ActuatorState(Record):
    """State, commands and faults of an actuator: servo valve, join valve, chambers, friction."""

    valve_command: float
    """Commanded spool position, −1 … 1; positive extends."""
    join_command: float
    """Commanded opening of the valve between rail and line, 0 … 1."""
    spool_target: float
    """Commanded spool position after the valve's hysteresis, −1 … 1."""
    spool: float
    """Spool position, −1 … 1."""
    spool_speed: float
    """Speed of the spool [1/s]."""
    join: float
    """Opening of the valve between rail and line, 0 … 1."""
    relief: float
    """Setting of the relief valves of the cylinder's chambers [Pa]."""
    force: float
    """Cylinder force p_A A − p_B a [N]."""
    friction: float
    """Friction of the cylinder [N]."""
    bristle_deflection: float
    """Bristle deflection of the LuGre friction model [m]."""
    supply_flow: float
    """Flow from the line to the chambers, over metering edges and lands [m³/s]."""
    isolated: float
    """Closed share of the valve that isolates both chambers, 0 … 1."""
    isolating_command: float
    """Command of the isolating valve, 0 … 1; 1 closes."""
    follows_command: float
    """0 if a fault drives the spool to `runaway` whatever its command, else 1."""
    runaway: float
    """Spool position to which a fault drives the spool, −1 … 1."""
    seized: float
    """1 if the spool is stuck, else 0."""
    leakage: float
    """Ratio of the line's leakage to that of a healthy line."""


class ModuleState(Record):
    """State, commands and faults of a booster module: servo pump and switching valve."""

    flow_command: float
    """Commanded flow [m³/s]."""
    to_rail_command: float
    """Command of the diverter: 1 feeds the rail, 0 the module's own line."""
    flow: float
    """Displacement times speed [m³/s]."""
    delivered: float
    """`flow` times the share of the displacement that fills at the inlet, minus the slip [m³/s]."""
    to_rail: float
    """Share of the flow that goes to the rail, 0 … 1."""
    lag_ratio: float
    """Ratio of the pump's lag to that of a healthy pump."""
    flow_ratio: float
    """Ratio of the largest flow to that of a healthy pump."""
    runs_on: float
    """1 if a fault makes the pump give its largest flow whatever its command, else 0."""
