"""Doubts about a machine file: values that are allowed, but with which the machine cannot work."""

import numpy as np

from mhsb_model import hydraulics
from mhsb_model.errors import suggest_unit_of_number
from mhsb_model.machine import Machine
from mhsb_model.schema import MachineConfig, Pin

LARGEST_FLOW_RATIO = 50.0
"""Main pump flow over the flow of all cylinders at V_max that is plausible [-].

The suite's machines have at most a few times that flow; a wrong unit is off by a thousand."""

LARGEST_PIN_RATIO = 2.0
"""Distance of a pin from its joint over the length of the longer link there that is plausible [-].

It is at most 0.92 on the suite's machines; a length in cm is a hundred times too large."""

FLOW_TOLERANCE = 1e-3
"""Share by which a flow may be below the flow that V_max needs [-].

Sentences have four digits, so that a flow that was copied from one is not doubted again."""

STEP_TOLERANCE = 1e-6
"""Deviation of a delay from whole steps that counts as rounding, as a share of a step [-]."""


def list_doubts(machine: Machine, held_points: int, reached_points: int) -> list[str]:
    """List what is allowed in a machine file, but cannot work or is not simulated as given.

    These are doubtful:

    - a relief pressure below the main pump's pressure;
    - with booster modules: a relief pressure of lines below the highest boost, or a servo pump
      power that is too low for full flow at the highest boost;
    - a workspace without a posture, or without a point at which the payload is held;
    - a main pump's flow above LARGEST_FLOW_RATIO times what all cylinders take at V_max;
    - a pin that is far from its joint, and a V_max that an actuator cannot reach;
    - a computing delay that is no whole number of simulation steps.

    Args:
        machine: The machine.
        held_points: Number of workspace points at which the arm can be held, boosted or not.
        reached_points: Number of workspace points at which the arm has a posture.

    Returns:
        One sentence for each doubt: the value, the limit, and what to do. Empty if all is well.
    """
    config, arrays = machine.config, machine.arrays
    supply, circuit = float(arrays.supply_pressure), config.circuit
    reliefs = {
        "circuit.line_relief_pressure": circuit.line_relief_pressure,
        "circuit.chamber_relief_pressure": circuit.chamber_relief_pressure,
    }
    doubts = [
        f"{key} {relief / 1e6:g} MPa is below the main pump's {supply / 1e6:g} MPa, whose oil its "
        "valves let go; raise it above that pressure"
        for key, relief in reliefs.items()
        if relief < supply
    ]
    boost, relief = float(arrays.max_boost_pressure), circuit.line_relief_pressure
    if arrays.module_count > 0 and supply <= relief < boost:
        doubts.append(
            f"circuit.line_relief_pressure {relief / 1e6:g} MPa is below "
            f"hydraulics.servo_pump.max_boost_pressure {boost / 1e6:g} MPa, which lines then never "
            "reach; raise it above that pressure"
        )
    pump = config.hydraulics.servo_pump
    taken = (boost - supply) * pump.max_flow / pump.efficiency
    if arrays.module_count > 0 and circuit.servo_pump_power < taken:
        doubts.append(
            f"circuit.servo_pump_power {circuit.servo_pump_power:g} W is below the {taken:.3g} W "
            "that hydraulics.servo_pump.max_flow takes at the highest boost pressure; raise it"
        )
    if reached_points == 0:
        doubts.append(
            "the arm has a posture within the joint limits nowhere in the workspace; compare link "
            "lengths and joint limits with workspace.min_radius and max_radius"
        )
    elif held_points == 0:
        doubts.append(
            f"the arm holds its payload of {arrays.payload:g} kg nowhere in the workspace; lower "
            "payload.mass, or raise pressures, bores or moment arms"
        )
    flow = float(arrays.main_pump_flow)
    needed = float(np.sum(arrays.cap_area * arrays.max_piston_speed))
    if flow > LARGEST_FLOW_RATIO * needed:
        hint = suggest_unit_of_number(flow, "m³/s", 0.0, LARGEST_FLOW_RATIO * needed)
        doubts.append(
            f"hydraulics.main_pump.max_flow {flow:g} m³/s is {flow / needed:.0f} times what all "
            f"cylinders take at V_max ({needed:.3g} m³/s){hint}"
        )
    doubts += _list_distant_pins(config)
    doubts += _list_unreachable_speeds(machine)
    step, delay = config.simulation.step, config.imperfections.computing_delay
    steps = delay / step
    if abs(steps - round(steps)) > STEP_TOLERANCE:
        doubts.append(
            f"imperfections.computing_delay {1e3 * delay:g} ms is no whole number of steps of "
            f"{1e3 * step:g} ms; {1e3 * round(steps) * step:g} ms are simulated, so give that"
        )
    return doubts


def _list_distant_pins(config: MachineConfig) -> list[str]:
    """List the pins that are too far from their joint to be plausible.

    The limit is LARGEST_PIN_RATIO times the length of the longer of two links: the joint's own and
    the previous one. The base has no length.

    Args:
        config: Machine file.

    Returns:
        One sentence with path, distance and length for each such pin.
    """
    doubts, previous = [], 0.0
    for j, joint in enumerate(config.joints):
        length = max(previous, joint.link.length)
        limit, previous = LARGEST_PIN_RATIO * length, joint.link.length
        for name, pin in joint.linkage:
            if isinstance(pin, Pin) and pin.radius > limit:
                doubts.append(
                    f"joints.{j}.linkage.{name}.radius {pin.radius:g} m is "
                    f"{pin.radius / length:.3g} times the length of the longer link at that joint "
                    f"({length:g} m){suggest_unit_of_number(pin.radius, 'm', 0.0, limit)}"
                )
    return doubts


def _list_unreachable_speeds(machine: Machine) -> list[str]:
    """List the actuators that cannot reach their V_max in mode N, even without a load.

    The flow of the main pump less the leakage of all valves limits extension. The fully open valve
    at the supply pressure limits both directions.

    Args:
        machine: The machine.

    Returns:
        At most one sentence. It has, for each of these actuators, its V_max, the flow of pump or
        valve that this speed needs, and the flow that the file gives. Empty if all reach their
        V_max.
    """
    m, slow = machine.arrays, []
    leakage = machine.joint_count * m.leakage_flow
    valve = machine.config.hydraulics.valve
    for j, (cap, rod) in enumerate(zip(m.cap_area, m.rod_area, strict=True)):
        own = machine.config.joints[j].actuator.rated_flow
        by_valve = min(
            hydraulics.compute_speed_from_drop(
                m.valve_coefficient[j],
                cap,
                rod,
                m.supply_pressure - hydraulics.load_pressure(cap, rod, m.tank_pressure, 0.0, side),
                side,
            )
            for side in (1.0, -1.0)
        )
        speed = m.max_piston_speed[j]
        flow = valve.rated_flow if own is None else own
        path = "hydraulics.valve" if own is None else f"joints.{j}.actuator"
        for key, given, needed in (
            ("hydraulics.main_pump.max_flow", m.main_pump_flow, cap * speed + leakage),
            (f"{path}.rated_flow", flow, flow * speed / by_valve if by_valve else np.inf),
        ):
            if given < (1.0 - FLOW_TOLERANCE) * needed:
                slow.append(
                    f"actuator {j + 1} needs {key} {needed:.4g} m³/s for {1e3 * speed:.4g} mm/s, "
                    f"not {given:.4g}"
                )
    if not slow:
        return []
    return [
        f"V_max is beyond what main pump and valves give without a load: {'; '.join(slow)}; raise "
        "these flows, or lower motion.max_piston_speed"
    ]
