"""Replaying plans: what a servo makes of commands that are known in advance, step by step.

Plans follow from the commands before them and never from how well these are followed, so that
every controller and every gain can be given the very same ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mhsb_model.command import Command
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray, ModeArray
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.symptoms import SupervisionLimits

ESTIMATED_EVERY = 100
"""Steps from one look at what the servo has learnt of its payload to the next."""

HELD_TOO_LONG = SupervisionLimits().held[1]
"""Time [s] for which a plan may be held."""

LONGEST = 3.0
"""Times its duration that a run whose plans are slowed may take."""


@dataclass(frozen=True, eq=False)
class Replay:
    """A run of k steps, n joints.

    step       s, from one row to the next
    reference  float64[k, 3, n], q [rad], q̇ [rad/s], q̈ [rad/s²] that the servo followed
    position   float64[k, n], joint angles [rad]
    pressure   float64[k, 3 n + 3], Pa, in the order of the circuit's nodes
    modes      uint8[k, n], in force
    energies   J, as `Simulator.energies` at the end
    interventions  of the guard, in all
    payload    float64[r, 3], time [s], what the servo takes it for [kg], its standard deviation
               [kg]; no rows where it does not learn
    held       why the guard held the plan until the run was ended, empty where it did not
    """

    step: float
    reference: FloatArray
    position: FloatArray
    pressure: FloatArray
    modes: ModeArray
    energies: dict[str, float]
    interventions: int = 0
    payload: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    held: str = ""

    @property
    def time(self) -> FloatArray:
        """Of each row, after the start, float64[k] s."""
        return self.step * np.arange(1.0, len(self.position) + 1.0, dtype=np.float64)

    @property
    def supply_pressure(self) -> FloatArray:
        """Of each actuator's line, float64[k, n] Pa."""
        return self.pressure[:, 2:-3:3]

    @property
    def chamber_pressure(self) -> FloatArray:
        """The higher one of each cylinder's chambers, float64[k, n] Pa."""
        return np.maximum(self.pressure[:, 0:-3:3], self.pressure[:, 1:-3:3])

    def tip_error(self, machine: Machine) -> FloatArray:
        """Distance of the tip from its reference, float64[k] m."""
        wanted = machine.tip_in_base(self.reference[:, 0])
        return np.linalg.norm(machine.tip_in_base(self.position) - wanted, axis=1)

    def followed(self, every: int = 1) -> tuple[Trajectory, ModeSchedule]:
        """What was followed: the reference of every so many steps, and all changes of mode."""
        step_ns = round(self.step * SECOND_NS)
        path = self.reference[::every]
        offset = every * step_ns * np.arange(len(path))
        changed = np.any(np.diff(self.modes.astype(int), axis=0) != 0, axis=1)
        rows = np.flatnonzero(np.concatenate([[True], changed]))
        trajectory = Trajectory(0, offset, path[:, 0], path[:, 1], path[:, 2])
        return trajectory, ModeSchedule(0, rows * step_ns, self.modes[rows])


def replay(simulator: Simulator, commands: Sequence[Command], duration: float) -> Replay:
    """Run a simulator for `duration` [s] and give it each command at its stamp.

    The commands' stamps increase; each continues what the simulator follows by then. A plan that
    the guard holds for as long as supervision bears ends the run. Raises SimulationDivergedError.
    """
    end_ns = round(duration * SECOND_NS)
    most = round(LONGEST * duration * SECOND_NS / simulator.step_ns)
    n = simulator.machine.joint_count
    reference = np.empty((most, 3, n))
    position = np.empty((most, n))
    pressure = np.empty((most, 3 * n + 3))
    modes = np.empty((most, n), dtype=np.uint8)
    waiting = list(reversed(commands))
    payload: list[tuple[float, float, float]] = []
    k = 0
    while simulator.plan_time_ns < end_ns and k < most and simulator.guard.held < HELD_TOO_LONG:
        if waiting and simulator.plan_time_ns >= waiting[-1].stamp_ns:
            command = waiting.pop()
            simulator.set_plan(command.trajectory, command.schedule)
        simulator.step()
        simulator.copy_state(reference[k], position[k], pressure[k], modes[k])
        k += 1
        if k % ESTIMATED_EVERY == 0:
            time = k * simulator.step_ns / SECOND_NS
            payload += [
                (time, each.value, each.deviation)
                for each in simulator.estimates
                if each.quantity == "payload"
            ]
    step = simulator.step_ns / SECOND_NS
    held = simulator.guard.sentence if simulator.guard.held >= HELD_TOO_LONG else ""
    return Replay(
        step,
        reference[:k],
        position[:k],
        pressure[:k],
        modes[:k],
        simulator.energies,
        simulator.guard.interventions.count,
        np.array(payload).reshape(-1, 3),
        held,
    )
