"""Components of a machine's hydraulic circuit, as its machine file describes them."""

from typing import NamedTuple

import numpy as np

from mhsb_model.circuit.constants import (
    build_actuators,
    build_cylinders,
    build_modules,
    compute_constants,
)
from mhsb_model.circuit.quantities import (
    ActuatorState,
    CircuitConstants,
    CylinderConstants,
    ModuleState,
)
from mhsb_model.machine import Machine
from mhsb_model.records import Records
from mhsb_model.types import IntArray


class Components(NamedTuple):
    """Constants of the circuit, and the state and commands of its components.

    There are n actuators and m booster modules. A controller writes `valve_command` and
    `join_command` of the actuators, and `flow_command` and `to_rail_command` of the modules.
    `circuit.quantities` lists the fields of all records.
    """

    cylinders: Records[CylinderConstants]
    """Cylinders and their valves, one record of CylinderConstants for each of the n actuators."""

    constants: Records[CircuitConstants]
    """Constants of the whole circuit, a single record of CircuitConstants."""

    module_home: IntArray
    """Index of the actuator whose line each module feeds, int64[m]; −1 for a spare module."""

    actuators: Records[ActuatorState]
    """State and commands of the actuators, ActuatorState[n]."""

    modules: Records[ModuleState]
    """State and commands of the booster modules, ModuleState[m]."""


def describe_components(machine: Machine, substep: float) -> Components:
    """Build the components of a machine's circuit at rest, without faults and with closed valves.

    Module j belongs to actuator j. If there are more modules than actuators, the additional modules
    are spare and have no line.

    Args:
        machine: Machine whose file describes the circuit.
        substep: Duration of one integration step of the circuit [s]. The constants contain the
            decay of each first-order lag and the transition matrix of the spool over this time.

    Returns:
        Components with new arrays, which the simulator and the controller write in place.
    """
    actuator_count = machine.joint_count
    home = np.arange(machine.arrays.module_count, dtype=np.int64)
    home[home >= actuator_count] = -1
    return Components(
        cylinders=build_cylinders(machine),
        constants=compute_constants(machine, substep),
        module_home=home,
        actuators=build_actuators(machine),
        modules=build_modules(home),
    )
