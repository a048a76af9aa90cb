"""Interface of a servo controller, and the signals that it works on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np

from mhsb_control.estimates_file import ActuatorResponse
from mhsb_model.arm_reports import Estimate
from mhsb_model.circuit.components import Components
from mhsb_model.machine import Machine
from mhsb_model.records import Record, Records, create_records
from mhsb_model.schema import Section
from mhsb_model.types import FloatArray, IntArray, ModeArray


class ActuatorReadings(Record):
    """Readings of one actuator's sensors."""

    length: float
    """Distance between the cylinder's pins [m]."""
    cap_pressure: float
    """Pressure on the cap side [Pa]."""
    rod_pressure: float
    """Pressure on the rod side [Pa]."""
    line_pressure: float
    """Pressure of the actuator's supply line [Pa]."""


REFERENCE_POINTS = 6
"""Number of reference points that a controller sees; the first one is the present."""


@dataclass
class ServoSignals:
    """Arrays that a controller reads and writes in each step.

    There are n actuators and m booster modules.

    Attributes:
        reference: Joint positions q [rad or m], velocities q̇ and accelerations q̈,
            float64[REFERENCE_POINTS, 3, n]. The points are evenly spaced in time. Point 0 is now;
            point `PREVIEW_POINT` of `mhsb_control.reference` is the controller's `preview` later.
        command_reference: q, q̇ and q̈ of the reference at three times, float64[3, 3, n]. Row 0:
            when a valve command sent now acts. Row 1: when the spool that this command moves has
            crossed its overlap. Row 2: when a pump command sent now acts.
        command_times: Times from now to the three states of `command_reference`, float64[3], [s]; 0
            if commands act at once. The controller writes them.
        sensors: Measured cylinder lengths and pressures, ActuatorReadings[n].
        rail_pressure: Measured pressure of the shared rail, float64[1], [Pa].
        modes: Prepared mode of each actuator, uint8[n]: in general the mode in force. A boosted
            mode that begins within `preview` is prepared already, if modules are free for it.
        modes_ahead: Modes that will be in force after the time `preview`, uint8[n].
        serves: Actuator that each module serves, int64[m]; −1 if idle.
        circuit: Circuit as the controller knows it, not the simulated one. The controller writes
            `valve_command` and `join_command` of its actuators, and `flow_command` and
            `to_rail_command` of its modules. The pump flows in `circuit` are measured by the pumps'
            speeds. Its positions of join valves and diverters are computed: they follow their
            commands as the machine file describes.
        valve_overlap: Overlaps of each valve that the controller compensates, extending and
            retracting, as shares of the spool's stroke, float64[n, 2]; 0 if the controller does not
            estimate overlaps. The controller writes them.
    """

    reference: FloatArray
    command_reference: FloatArray
    command_times: FloatArray
    sensors: Records[ActuatorReadings]
    rail_pressure: FloatArray
    modes: ModeArray
    modes_ahead: ModeArray
    serves: IntArray
    circuit: Components
    valve_overlap: FloatArray

    @classmethod
    def at_rest(cls, circuit: Components, modes: ModeArray) -> Self:
        """Build the signals of an arm at rest, before anything has been measured.

        The chambers have the pressures of a cylinder at rest without load. All lines and the rail
        have the main pump's pressure. If the machine has no pressure sensors, these readings never
        change. Lengths and the reference are 0, and all booster modules are idle.

        Args:
            circuit: Circuit as the controller knows it; it is shared, not copied.
            modes: Modes in force, uint8[n].

        Returns:
            Signals with new arrays, except `circuit`.
        """
        actuators, modules = len(circuit.actuators), len(circuit.modules)
        supply, tank = (circuit.constants[f"{each}_pressure"][0] for each in ("supply", "tank"))
        cap, rod = (circuit.cylinders[f"{each}_area"] for each in ("cap", "rod"))
        sensors = create_records(ActuatorReadings, actuators)
        sensors["line_pressure"] = supply
        sensors["cap_pressure"] = rod * (supply + tank) / (cap + rod)
        sensors["rod_pressure"] = cap * (supply + tank) / (cap + rod)
        return cls(
            reference=np.zeros((REFERENCE_POINTS, 3, actuators)),
            command_reference=np.zeros((3, 3, actuators)),
            command_times=np.zeros(3),
            sensors=sensors,
            rail_pressure=np.full(1, supply),
            modes=modes.copy(),
            modes_ahead=modes.copy(),
            serves=np.full(modules, -1, dtype=np.int64),
            circuit=circuit,
            valve_overlap=np.zeros((actuators, 2)),
        )


class Controller(Protocol):
    """Interface of a servo controller, which commands valve openings and servo pump flows.

    A controller follows a position reference. A controller that learns the response of its
    actuators may also be a `LearningController`.

    Attributes:
        reads_pressures: Optional. False admits machines without pressure sensors; studies of other
            machines then leave the controller out.
        supervision_limits: Optional, for a controller that follows less closely than others. Pairs
            (value to warn, value to stop the arm) by the name of the symptom, such as
            `{"following_error": (0.15, 0.5)}`.
    """

    gains_section: type[Section]
    """Schema of the controller's section of the machine file: each gain with range, unit and
    default. Its `search_ranges` are the gains that `tune` searches. `tune` leaves out a controller
    without `search_ranges`."""

    usual_error: float
    """Normal distance of the tip from its reference, for an arm of the paper's size [m]. The
    distance is scaled with the size of the arm. The reference governor slows the plan if the tip is
    farther away."""

    preview: float
    """Time by which modes are prepared in advance [s]; 0 if modes are not prepared. The reference
    reaches further ahead. If a controller has a gain `preview`, plans for all controllers charge
    lines earlier by this gain."""

    def __init__(self, machine: Machine, signals: ServoSignals, gains: Any) -> None:
        """Bind the controller to the signals that `update` will work on.

        Args:
            machine: The machine as declared in its file (the real one may differ).
            signals: Arrays that the controller reads and writes in each step.
            gains: Instance of `gains_section` with the values of the machine file.
        """
        ...

    @property
    def estimates(self) -> list[Estimate]:
        """Estimates of the machine's parameters; empty if the controller estimates none."""
        ...

    def update(self) -> None:
        """Write all commands for the next step, computed from the present signals."""
        ...


@runtime_checkable
class LearningController(Protocol):
    """Interface of a controller that learns delay and inverse valve curves of each actuator.

    The responses that it has learnt survive a restart of the servo, and are kept in an estimates
    file. `isinstance` and `issubclass` check only that the two methods exist.
    """

    def get_learnt(self) -> dict[str, ActuatorResponse]:
        """Return the learnt response of each actuator by its name."""
        ...

    def restore(self, learnt: Mapping[str, ActuatorResponse]) -> None:
        """Replace the learnt responses by responses that were learnt earlier.

        Args:
            learnt: Response of each actuator by its name.
        """
        ...
