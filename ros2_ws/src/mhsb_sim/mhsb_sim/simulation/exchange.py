"""Exchange between mechanics, circuit and servo in each step of the simulator.

n is the number of joints and cylinders, m the number of booster modules. Node 3 j of the circuit is
the cap side of cylinder j, 3 j + 1 its rod side, 3 j + 2 its line, and 3 n the shared rail. The
manifold behind the main pump and the tank follow.
"""

from typing import NamedTuple

import numpy as np

from mhsb_control.controller import ActuatorReadings
from mhsb_control.spools.assumed_valves import update_assumed_valves
from mhsb_model.circuit.components import Components
from mhsb_model.circuit.quantities import ActuatorState, ModuleState
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import evaluate_linkage
from mhsb_model.records import Records
from mhsb_model.types import FloatArray, IntArray
from mhsb_sim.circuit.network import Circuit, advance
from mhsb_sim.simulation.sensors import SensorChannel


class SensedPlant(NamedTuple):
    """True state of the plant that the sensors measure."""

    pistons: FloatArray  # [4, n] piston motion, see `move_pistons`
    pressure: FloatArray  # [≥ 3 n + 1] Pa, pressures of the nodes up to the rail
    modules: Records[ModuleState]  # [m]


class SensorReadings(NamedTuple):
    """Readings that the sensors give to the servo."""

    actuators: Records[ActuatorReadings]  # [n], length [m] and three pressures [Pa]
    rail_pressure: FloatArray  # [1] Pa
    modules: Records[ModuleState]  # [m], the servo's records; `flow` [m³/s] is the reading


class CommandQueue(NamedTuple):
    """Commands on their way from the servo to the circuit, a ring buffer."""

    rows: FloatArray  # [rows, 2 (n + m)] see `send_commands`
    newest: IntArray  # [1] index of the row with the newest commands


class JointDrive(NamedTuple):
    """Joints of MuJoCo's model and the controls that drive them."""

    position: FloatArray  # [n] rad or m
    velocity: FloatArray  # [n] rad/s or m/s
    control: FloatArray  # [n] N m, or N of sliding joints


LARGEST_STATE = 1e6
"""Joint positions [rad or m] and velocities [rad/s or m/s] beyond this count as not finite."""


LENGTH_ROW, SPEED_ROW, MOMENT_ARM_ROW, ANGLE_ROW = range(4)
"""Rows of `pistons`, float64[4, n]: cylinder length L(q) [m], piston speed r(q) q̇ [m/s], moment
arm r(q) [m], and joint position q [rad or m].
"""


@kernel(borrows=True)
def move_pistons(
    linkage: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    half_step: FloatArray,
    pistons: FloatArray,
) -> None:
    """Compute cylinder lengths, piston speeds and moment arms after a step of the mechanics.

    MuJoCo's integrator is semi-implicit: its positions are half a step ahead of its velocities. So
    the results belong to positions that are moved back by half a step.

    Args:
        linkage: Parameters of the linkages, float64[n, LINKAGE_WIDTH].
        position: Joint positions of MuJoCo, float64[n], [rad or m].
        velocity: Joint velocities of MuJoCo, float64[n], [rad/s or m/s].
        half_step: Half a step of the mechanics, float64[1], [s].
        pistons: Rows LENGTH_ROW [m], SPEED_ROW [m/s], MOMENT_ARM_ROW [m] and ANGLE_ROW (joint
            position) [rad or m], float64[4, n]. Written in place.
    """
    for j in range(len(position)):
        q = position[j] - half_step[0] * velocity[j]
        pistons[LENGTH_ROW, j], pistons[MOMENT_ARM_ROW, j], _ = evaluate_linkage(linkage[j], q)
        pistons[SPEED_ROW, j] = pistons[MOMENT_ARM_ROW, j] * velocity[j]
        pistons[ANGLE_ROW, j] = q


@kernel(inline="always")
def round_to_resolution(value: float, resolution: float) -> float:
    """Round a value to the nearest multiple of a resolution.

    Args:
        value: The value.
        resolution: The resolution, in the unit of the value; 0 does not round.

    Returns:
        The rounded value.
    """
    if resolution == 0.0:
        return value
    return resolution * np.rint(value / resolution)


@kernel(inline="always")
def compute_reading(channel: SensorChannel, reading: float, before: float, step: float) -> float:
    """Compute the reading of a sensor, with its faults.

    A healthy sensor gives `reading`. A faulty sensor adds `channel.error`. A frozen sensor repeats
    its last reading. A dead sensor gives no reading, and the result is `before`.

    Args:
        channel: State of the sensor. Writes `last_reading` and `silent` (time without a reading) in
            place.
        reading: Reading of a healthy sensor, in the unit of the sensor.
        before: Last result for this sensor.
        step: Time since the previous call [s]. It is added to `silent` if the sensor is dead;
            otherwise `silent` becomes 0.

    Returns:
        The reading, in the unit of the sensor.
    """
    if channel.frozen == 0.0:
        channel.last_reading = reading + channel.error
    if channel.dead > 0.0:
        channel.silent += step
        return before
    channel.silent = 0.0
    return channel.last_reading


@kernel(borrows=True)
def read_sensors(
    noise_rows: FloatArray,
    plant: SensedPlant,
    readings: SensorReadings,
    channels: Records[SensorChannel],
    step: FloatArray,
    row: int,
) -> None:
    """Compute the readings of all sensors in a step, with noise, offsets, rounding and faults.

    Offsets and errors first grow by their drift in one step. The order of sensors is: n lengths;
    cap, rod and line pressure of actuator 1, then of actuator 2 and so on; pressure of the rail;
    speeds of the m servo pumps, as flows. A length sensor measures the joint position, and its
    reading is rounded to the sensor's resolution.

    Args:
        noise_rows: Noise of many steps, one row per step and one column per sensor, float64[rows, 4
            n + 1 + m], [m, Pa or m³/s]. The offsets are added to row `row` in place.
        plant: True state of the plant.
        readings: Readings of the sensors. Written in place.
        channels: State of the sensors, SensorChannel[4 n + 1 + m]. Updated in place.
        step: Time from one reading to the next, float64[1], [s].
        row: Row of `noise_rows` for this step.
    """
    noise, h = noise_rows[row], step[0]
    pistons, pressure, modules = plant
    sensors, rail_pressure, servo_modules = readings
    n = len(sensors)
    for i in range(len(channels)):
        channels[i].offset += channels[i].drift
        channels[i].error += channels[i].error_rate * h
        noise[i] += channels[i].offset
    for j in range(n):
        sensor = sensors[j]
        q = pistons[ANGLE_ROW, j]
        turned = round_to_resolution(q, channels[j].resolution) - q
        length = pistons[LENGTH_ROW, j] + pistons[MOMENT_ARM_ROW, j] * turned + noise[j]
        sensor.length = compute_reading(channels[j], length, sensor.length, h)
        i = n + 3 * j
        cap, rod, line = channels[i], channels[i + 1], channels[i + 2]
        reading = round_to_resolution(pressure[3 * j] + noise[i], cap.resolution)
        sensor.cap_pressure = compute_reading(cap, reading, sensor.cap_pressure, h)
        reading = round_to_resolution(pressure[3 * j + 1] + noise[i + 1], rod.resolution)
        sensor.rod_pressure = compute_reading(rod, reading, sensor.rod_pressure, h)
        reading = round_to_resolution(pressure[3 * j + 2] + noise[i + 2], line.resolution)
        sensor.line_pressure = compute_reading(line, reading, sensor.line_pressure, h)
    rail = channels[4 * n]
    reading = round_to_resolution(pressure[3 * n] + noise[4 * n], rail.resolution)
    rail_pressure[0] = compute_reading(rail, reading, rail_pressure[0], h)
    for k in range(len(modules)):
        i = 4 * n + 1 + k
        reading = round_to_resolution(modules[k].flow + noise[i], channels[i].resolution)
        servo_modules[k].flow = compute_reading(channels[i], reading, servo_modules[k].flow, h)


@kernel(borrows=True)
def apply_forces(
    actuators: Records[ActuatorState], pressure: FloatArray, arm: FloatArray, joints: JointDrive
) -> bool:
    """Apply the cylinders' torques, τ = r (F − F_f), to the joints, and check the state.

    F is the force of the pressures, F_f the friction, r the moment arm.

    Args:
        actuators: Records of the actuators, ActuatorState[n], with force F and friction F_f [N].
        pressure: Pressures of the nodes, float64[3 n + 3], [Pa]; only checked.
        arm: Moment arm r of each cylinder, float64[n], [m].
        joints: Joints of the mechanics. Writes the controls τ in place [N m, or N of sliding
            joints].

    Returns:
        False if a joint position or velocity is LARGEST_STATE or more, or a pressure is not finite.
        True otherwise.
    """
    position, velocity, control = joints
    good = True
    for j in range(len(actuators)):
        force = actuators[j].force - actuators[j].friction
        control[j] = arm[j] * force
        good = good and abs(position[j]) < LARGEST_STATE and abs(velocity[j]) < LARGEST_STATE
    for p in pressure:
        good = good and abs(p) < np.inf
    return good


@kernel(borrows=True)
def send_commands(servo_circuit: Components, circuit: Circuit, queue: CommandQueue) -> None:
    """Pass the servo's commands to the circuit, delayed by len(queue.rows) − 1 servo steps.

    A row of the queue has, in this order: n valve openings (−1 … 1); n commands of join valves,
    from a line to the rail (0 … 1); m flows of servo pumps [m³/s]; m commands of diverters, from a
    pump to the rail (0 … 1).

    Args:
        servo_circuit: The servo's own copy of the circuit's records; it holds the new commands.
        circuit: The simulated circuit. The commands that are due are written into its actuators and
            modules in place.
        queue: Commands that wait for their time, updated in place.
    """
    n, m, rows = len(circuit.actuators), len(circuit.modules), queue.rows
    row = (queue.newest[0] + 1) % len(rows)
    queue.newest[0] = row
    for j in range(n):
        rows[row, j] = servo_circuit.actuators[j].valve_command
        rows[row, n + j] = servo_circuit.actuators[j].join_command
    for k in range(m):
        rows[row, 2 * n + k] = servo_circuit.modules[k].flow_command
        rows[row, 2 * n + m + k] = servo_circuit.modules[k].to_rail_command
    due = rows[(row + 1) % len(rows)]
    for j in range(n):
        circuit.actuators[j].valve_command = due[j]
        circuit.actuators[j].join_command = due[n + j]
    for k in range(m):
        circuit.modules[k].flow_command = due[2 * n + k]
        circuit.modules[k].to_rail_command = due[2 * n + m + k]


@kernel(borrows=True)
def advance_to_midstep(
    servo_circuit: Components,
    queue: CommandQueue,
    circuit: Circuit,
    pistons: FloatArray,
    joints: JointDrive,
    sends: int,
    substeps: int,
) -> bool:
    """Advance the circuit to the middle of a step, and apply its forces to the mechanics.

    Args:
        servo_circuit: The servo's own copy of the circuit's records, with its commands. If `sends`
            is 1, the valve positions that the servo assumes are updated in it.
        queue: Commands that wait for their time; updated in place if `sends` is 1.
        circuit: The simulated circuit, advanced in place.
        pistons: Cylinder lengths [m], piston speeds [m/s], moment arms [m] and joint positions [rad
            or m], float64[4, n].
        joints: Joints of the mechanics. Writes the controls in place.
        sends: 1 to send the servo's commands first, else 0.
        substeps: Number of substeps of the circuit.

    Returns:
        False if a joint position or velocity is LARGEST_STATE or more, or a pressure is not finite.
        True otherwise.
    """
    if sends:
        send_commands(servo_circuit, circuit, queue)
        update_assumed_valves(servo_circuit)
    advance(circuit, pistons[LENGTH_ROW], pistons[SPEED_ROW], substeps)
    return apply_forces(circuit.actuators, circuit.pressure, pistons[MOMENT_ARM_ROW], joints)


@kernel(borrows=True)
def advance_to_step_end(
    circuit: Circuit,
    linkage: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    half_step: FloatArray,
    pistons: FloatArray,
    substeps: int,
) -> None:
    """Advance the circuit to the end of a step, after the mechanics have moved the joints.

    The piston motion is computed first. MuJoCo's positions are half a step ahead of its velocities
    and are moved back by that time.

    Args:
        circuit: The simulated circuit, advanced in place.
        linkage: Parameters of the linkages, float64[n, LINKAGE_WIDTH].
        position: Joint positions of MuJoCo, float64[n], [rad or m].
        velocity: Joint velocities of MuJoCo, float64[n], [rad/s or m/s].
        half_step: Half a step of the mechanics, float64[1], [s].
        pistons: Cylinder lengths [m], piston speeds [m/s], moment arms [m] and joint positions [rad
            or m], float64[4, n]. Written in place.
        substeps: Number of substeps of the circuit.
    """
    move_pistons(linkage, position, velocity, half_step, pistons)
    advance(circuit, pistons[LENGTH_ROW], pistons[SPEED_ROW], substeps)
