"""What supervision sees of an arm at one look, and what it finds."""

from __future__ import annotations

from dataclasses import dataclass

from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_sim.simulation.actuator_states import ActuatorStates
from mhsb_sim.simulation.sensed import Sensed
from mhsb_sim.simulation.simulator import Simulator

WATCH_PERIOD_NS = SECOND_NS // 100
"""Simulated time from one look to the next."""


@dataclass(frozen=True)
class Sample:
    """The arm at one look."""

    reference: MotionState
    measured: MotionState
    actuators: ActuatorStates
    sensed: Sensed
    held: float
    why_held: str

    @classmethod
    def of(cls, simulator: Simulator) -> Sample:
        """The arm as it is now."""
        guard = simulator.guard
        return cls(
            simulator.reference,
            simulator.joint_state,
            simulator.actuator_states,
            simulator.sensed,
            guard.held,
            guard.sentence if guard.held > 0.0 else "",
        )


@dataclass(frozen=True)
class Finding:
    """How large a symptom is, in the unit of its limits, and where, in words."""

    value: float
    text: str
