"""A sample of the arm for supervision, and the interface of a symptom."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self

from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_sim.simulation.sensors import ActuatorStates, Sensed
from mhsb_sim.simulation.simulator import Simulator

WATCH_PERIOD_NS = SECOND_NS // 100
"""Simulated time between two samples [ns]."""


@dataclass(frozen=True)
class ArmSample:
    """State of the arm at one instant, as supervision sees it.

    Attributes:
        reference: Position, velocity and acceleration that the servo follows.
        measured: True position, velocity and acceleration of the joints, without sensor errors.
        actuators: True pressures, flows and openings of the actuators.
        sensed: Readings of the sensors, and commands of the servo.
        held: Time for which the mode guard has held the plan nearly still [s]; 0 if it does not
            hold the plan.
        hold_reason: Sentence that says why the plan is held; empty if it is not held.
    """

    reference: MotionState
    measured: MotionState
    actuators: ActuatorStates
    sensed: Sensed
    held: float
    hold_reason: str

    @classmethod
    def from_simulator(cls, simulator: Simulator) -> Self:
        """Take a sample of a simulator's present state.

        Joint state and actuator states are the true ones; only `sensed` has sensor errors.

        Args:
            simulator: The simulator.

        Returns:
            Sample of reference, joints, actuators, sensors and mode guard.
        """
        guard = simulator.guard
        return cls(
            simulator.reference,
            simulator.joint_state,
            simulator.actuator_states,
            simulator.sensed,
            guard.held,
            guard.sentence if guard.held > 0.0 else "",
        )


class Finding(NamedTuple):
    """Size of a symptom, and a clause that names the part.

    Attributes:
        value: Size in the unit of the symptom's limits.
        describe: Function that returns the clause, for a person; call it before the symptom is
            evaluated again.
    """

    value: float
    describe: Callable[[], str]


class Symptom(Protocol):
    """A symptom that supervision evaluates every `WATCH_PERIOD_NS`.

    Attributes:
        name: Name of the field of `SupervisionLimits`.
        unit: Unit of the value; empty for a ratio.
        closes_valves: Whether the valves close at once if this symptom stops the arm, since the
            servo could not brake the arm.
    """

    name: str
    unit: str
    closes_valves: bool = False

    def __init__(self, machine: Machine) -> None:
        """Prepare the symptom for a machine, without any history."""

    def evaluate(self, sample: ArmSample) -> Finding:
        """Evaluate the symptom for a new sample.

        Args:
            sample: State of the arm.

        Returns:
            Present size of the symptom in its unit, and a clause that names the affected part.
        """
