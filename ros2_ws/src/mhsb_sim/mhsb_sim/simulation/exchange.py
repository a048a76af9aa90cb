"""What passes between mechanics, circuit and servo in each step of the simulator."""

from __future__ import annotations

import math

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import motion
from mhsb_model.types import FloatArray, IntArray
from mhsb_sim.circuit.elements import first_order_lag
from mhsb_sim.circuit.network import Circuit, advance
from mhsb_sim.records import Records

LARGEST_STATE = 1e6
"""Angles [rad] and rates [rad/s] beyond this count as no longer finite."""


@kernel
def move_pistons(
    linkage: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    length: FloatArray,
    speed: FloatArray,
    arm: FloatArray,
) -> None:
    """L(q) [m], r(q) q̇ [m/s] and r(q) [m] of all cylinders, to length[n], speed[n] and arm[n]."""
    for j in range(len(length)):
        length[j], arm[j], _ = motion(linkage[j], position[j])
        speed[j] = arm[j] * velocity[j]


@kernel
def measure(
    noises: FloatArray,
    linkage: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    length: FloatArray,
    speed: FloatArray,
    arm: FloatArray,
    pressure: FloatArray,
    modules: Records,
    sensors: Records,
    rail_pressure: FloatArray,
    believed: Records,
    row: int,
) -> bool:
    """Pistons moved as by `move_pistons`; sensors: the true values plus this row of the noise.

    noises: float64[NOISE_ROWS, 4 n + 1], lengths first. The speeds of the servo pumps, MODULE[m],
    are measured in their motors, into `believed`. False where a sensor gives what is not finite.
    """
    noise = noises[row]
    move_pistons(linkage, position, velocity, length, speed, arm)
    n = len(sensors)
    total = 0.0
    for j in range(n):
        sensor = sensors[j]
        sensor.length = length[j] + noise[j]
        sensor.cap_pressure = pressure[3 * j] + noise[n + 3 * j]
        sensor.rod_pressure = pressure[3 * j + 1] + noise[n + 3 * j + 1]
        sensor.line_pressure = pressure[3 * j + 2] + noise[n + 3 * j + 2]
        total += sensor.length + sensor.cap_pressure + sensor.rod_pressure + sensor.line_pressure
    rail_pressure[0] = pressure[3 * n] + noise[4 * n]
    for k in range(len(modules)):
        believed[k].flow = modules[k].flow
    return abs(total + rail_pressure[0]) < np.inf


@kernel
def apply_forces(
    actuators: Records,
    pressure: FloatArray,
    arm: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    control: FloatArray,
) -> bool:
    """Hand the torques r F of the cylinders' forces, less friction, to the mechanics.

    False where not finite.
    """
    good = True
    for j in range(len(actuators)):
        force = actuators[j].force - actuators[j].friction
        control[j] = arm[j] * force
        good = good and abs(position[j]) < LARGEST_STATE and abs(velocity[j]) < LARGEST_STATE
    for p in pressure:
        good = good and abs(p) < np.inf
    return good


@kernel
def act(
    believed: Circuit,
    circuit: Circuit,
    queue: FloatArray,
    place: IntArray,
    length: FloatArray,
    speed: FloatArray,
    substeps: int,
) -> None:
    """Carry the servo's commands to the circuit, late by the queue's rows less one, and advance it.

    believed: the circuit as the servo knows it, where its commands stand; its join valves and
    diverters go by them, as nobody measures these. queue: float64[rows, 2 (n + m)], commands on
    their way; place: int64[1], row of the newest. Pistons as in `Circuit.advance`.
    """
    n, m = len(circuit.actuators), len(circuit.modules)
    row = (place[0] + 1) % len(queue)
    place[0] = row
    for j in range(n):
        queue[row, j] = believed.actuators[j].valve_command
        queue[row, n + j] = believed.actuators[j].join_command
    for k in range(m):
        queue[row, 2 * n + k] = believed.modules[k].flow_command
        queue[row, 2 * n + m + k] = believed.modules[k].lend
    due = queue[(row + 1) % len(queue)]
    for j in range(n):
        circuit.actuators[j].valve_command = due[j]
        circuit.actuators[j].join_command = due[n + j]
    for k in range(m):
        circuit.modules[k].flow_command = due[2 * n + k]
        circuit.modules[k].lend = due[2 * n + m + k]
    advance(circuit, length, speed, substeps)
    c = believed.constants[0]
    decay = math.exp(-substeps * c.substep / c.switching_time)
    for j in range(n):
        actuator = believed.actuators[j]
        actuator.join = first_order_lag(actuator.join, actuator.join_command, decay)
    for k in range(m):
        module = believed.modules[k]
        if believed.module_home[k] >= 0:
            module.to_rail = first_order_lag(module.to_rail, module.lend, decay)
