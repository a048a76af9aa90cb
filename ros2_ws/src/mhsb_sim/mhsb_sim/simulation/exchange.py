"""What passes between mechanics, circuit and servo in each step of the simulator."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import motion
from mhsb_model.types import FloatArray, IntArray
from mhsb_sim.circuit.elements import first_order_lag
from mhsb_sim.circuit.network import Circuit, advance
from mhsb_sim.records import Record, Records


class Believed(NamedTuple):
    """Of the circuit as the servo knows it: where its commands stand, and what follows them."""

    actuators: Records  # ACTUATOR[n]
    modules: Records  # MODULE[m]
    constants: Records  # CONSTANTS[1], substeps being the servo's steps
    module_home: IntArray


LARGEST_STATE = 1e6
"""Angles [rad] and rates [rad/s] beyond this count as no longer finite."""


LENGTH, SPEED, ARM, ANGLE = range(4)
"""Rows of `pistons`, float64[4, n]: L(q) [m], r(q) q̇ [m/s], r(q) [m] and q [rad] now."""


@kernel(borrows=True)
def move_pistons(
    linkage: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    half_step: FloatArray,
    pistons: FloatArray,
) -> None:
    """Write where pistons and joints are at the end of a step of the mechanics.

    These leap: their position is half a step ahead of their velocity. half_step: float64[1], s.
    """
    for j in range(len(position)):
        q = position[j] - half_step[0] * velocity[j]
        pistons[LENGTH, j], pistons[ARM, j], _ = motion(linkage[j], q)
        pistons[SPEED, j] = pistons[ARM, j] * velocity[j]
        pistons[ANGLE, j] = q


@kernel(inline="always")
def rounded(value: float, resolution: float) -> float:
    """The nearest multiple of the resolution; the value itself where that is 0."""
    if resolution == 0.0:
        return value
    return resolution * np.rint(value / resolution)


@kernel(inline="always")
def told(channel: Record, reading: float, before: float, step: float) -> float:
    """What a sensor tells where a healthy one would give `reading`.

    One that tells no number is silent, and its last one stays.
    """
    if channel.frozen == 0.0:
        channel.told = reading + channel.error
    if channel.dead > 0.0:
        channel.silent += step
        return before
    channel.silent = 0.0
    return channel.told


@kernel(borrows=True)
def measure(
    noises: FloatArray,
    pistons: FloatArray,
    pressure: FloatArray,
    modules: Records,
    sensors: Records,
    rail_pressure: FloatArray,
    believed: Records,
    channels: Records,
    step: FloatArray,
    row: int,
) -> None:
    """What all sensors tell, with this row of the noise; pistons as `move_pistons` has them.

    noises: float64[NOISE_ROWS, 4 n + 1 + m], in the order of `channels` (`sensors.channels_of`).
    The servo pumps' speeds, MODULE[m], are measured into `believed`. step: float64[1], s.
    """
    noise, h = noises[row], step[0]
    n = len(sensors)
    for i in range(len(channels)):
        channels[i].offset += channels[i].drift
        channels[i].error += channels[i].error_rate * h
        noise[i] += channels[i].offset
    for j in range(n):
        sensor = sensors[j]
        q = pistons[ANGLE, j]
        turned = rounded(q, channels[j].resolution) - q
        length = pistons[LENGTH, j] + pistons[ARM, j] * turned + noise[j]
        sensor.length = told(channels[j], length, sensor.length, h)
        i = n + 3 * j
        cap, rod, line = channels[i], channels[i + 1], channels[i + 2]
        reading = rounded(pressure[3 * j] + noise[i], cap.resolution)
        sensor.cap_pressure = told(cap, reading, sensor.cap_pressure, h)
        reading = rounded(pressure[3 * j + 1] + noise[i + 1], rod.resolution)
        sensor.rod_pressure = told(rod, reading, sensor.rod_pressure, h)
        reading = rounded(pressure[3 * j + 2] + noise[i + 2], line.resolution)
        sensor.line_pressure = told(line, reading, sensor.line_pressure, h)
    rail = channels[4 * n]
    reading = rounded(pressure[3 * n] + noise[4 * n], rail.resolution)
    rail_pressure[0] = told(rail, reading, rail_pressure[0], h)
    for k in range(len(modules)):
        i = 4 * n + 1 + k
        reading = rounded(modules[k].flow + noise[i], channels[i].resolution)
        believed[k].flow = told(channels[i], reading, believed[k].flow, h)


@kernel(borrows=True)
def apply_forces(
    actuators: Records,
    pressure: FloatArray,
    arm: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    control: FloatArray,
) -> bool:
    """Give the torques r F of the cylinders' forces, less friction, to the mechanics.

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


@kernel(borrows=True)
def send(believed: Believed, circuit: Circuit, queue: FloatArray, place: IntArray) -> None:
    """Carry the servo's commands to the circuit, late by the queue's rows less one.

    queue: float64[rows, 2 (n + m)], commands on their way; place: int64[1], row of the newest.
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


@kernel(borrows=True)
def believe(believed: Believed) -> None:
    """Move join valves and diverters as the servo takes them to follow its commands in a step."""
    decay = believed.constants[0].switching_decay
    for j in range(len(believed.actuators)):
        actuator = believed.actuators[j]
        actuator.join = first_order_lag(actuator.join, actuator.join_command, decay)
    for k in range(len(believed.modules)):
        module = believed.modules[k]
        if believed.module_home[k] >= 0:
            module.to_rail = first_order_lag(module.to_rail, module.lend, decay)


@kernel(borrows=True)
def push(
    believed: Believed,
    queue: FloatArray,
    place: IntArray,
    circuit: Circuit,
    pistons: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    control: FloatArray,
    sends: int,
    substeps: int,
) -> bool:
    """Advance the circuit to the middle of a step, and apply the forces that it has there.

    sends: whether the servo's commands are sent first. False where anything is not finite.
    """
    if sends:
        send(believed, circuit, queue, place)
        believe(believed)
    advance(circuit, pistons[LENGTH], pistons[SPEED], substeps)
    return apply_forces(
        circuit.actuators, circuit.pressure, pistons[ARM], position, velocity, control
    )


@kernel(borrows=True)
def follow(
    circuit: Circuit,
    linkage: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    half_step: FloatArray,
    pistons: FloatArray,
    substeps: int,
) -> None:
    """Advance the circuit to the end of a step, after the mechanics have moved."""
    move_pistons(linkage, position, velocity, half_step, pistons)
    advance(circuit, pistons[LENGTH], pistons[SPEED], substeps)
