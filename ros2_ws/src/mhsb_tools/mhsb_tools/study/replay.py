"""Replay of plans: a servo follows commands that are known in advance, step by step.

Plans depend on the commands before them, but not on how well these are followed. Therefore every
controller and every set of gains can be given identical plans.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mhsb_model.command import Command
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray, ModeArray
from mhsb_sim.simulation.fault_detection import SupervisionLimits
from mhsb_sim.simulation.simulator import Simulator

ESTIMATED_EVERY = 100
"""Number of steps from one reading of the servo's payload estimate to the next."""

MAX_DURATION_FACTOR = 3.0
"""Largest duration of a run whose plans are slowed, as a factor on the asked duration."""


@dataclass(frozen=True, eq=False)
class Replay:
    """Record of a run of k steps with n joints.

    Attributes:
        step: Time from one row to the next [s].
        reference: q [rad or m], q̇ [rad/s or m/s] and q̈ [rad/s² or m/s²] that the servo followed,
            shape (k, 3, n).
        position: Joint positions, shape (k, n) [rad or m].
        pressure: Pressures in the order of the circuit's nodes, shape (k, 3 n + 3) [Pa]: cap side,
            rod side and supply line of each actuator, then three common nodes.
        modes: Modes in force, shape (k, n), uint8.
        energies: Energy by circuit element at the end, as `Simulator.energies` [J].
        interventions: Number of times that the guard boosted or slowed beyond the plan.
        payload: Payload estimates, shape (r, 3): time [s], estimate [kg], standard deviation [kg].
            No rows if the servo does not estimate the payload.
        hold_reason: Why the guard held the plan until the run was ended; empty if it did not.
    """

    step: float
    reference: FloatArray
    position: FloatArray
    pressure: FloatArray
    modes: ModeArray
    energies: dict[str, float]
    interventions: int = 0
    payload: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    hold_reason: str = ""

    @property
    def time(self) -> FloatArray:
        """Time of each row after the start, shape (k,) [s]."""
        return self.step * np.arange(1.0, len(self.position) + 1.0, dtype=np.float64)

    @property
    def supply_pressure(self) -> FloatArray:
        """Pressure in each actuator's supply line, shape (k, n) [Pa]."""
        return self.pressure[:, 2:-3:3]

    @property
    def chamber_pressure(self) -> FloatArray:
        """Higher pressure of each cylinder's two chambers, shape (k, n) [Pa]."""
        return np.maximum(self.pressure[:, 0:-3:3], self.pressure[:, 1:-3:3])

    def tip_error(self, machine: Machine) -> FloatArray:
        """Compute the distance of the tip from its reference at each step.

        Args:
            machine: The arm that was simulated.

        Returns:
            Distances [m], shape (k,).
        """
        wanted = machine.tip_in_base(self.reference[:, 0])
        return np.linalg.norm(machine.tip_in_base(self.position) - wanted, axis=1)

    def followed_motion(self, every: int = 1) -> tuple[Trajectory, ModeSchedule]:
        """Return the reference that the servo followed as a trajectory, with its mode schedule.

        Args:
            every: Number of steps from one point of the trajectory to the next. The schedule has
                all mode changes, whatever this number is.

        Returns:
            The trajectory and the schedule of the modes in force. Both have stamp 0.
        """
        step_ns = round(self.step * SECOND_NS)
        path = self.reference[::every]
        offset = every * step_ns * np.arange(len(path))
        changed = np.any(np.diff(self.modes.astype(int), axis=0) != 0, axis=1)
        rows = np.flatnonzero(np.concatenate([[True], changed]))
        trajectory = Trajectory(0, offset, path[:, 0], path[:, 1], path[:, 2])
        return trajectory, ModeSchedule(0, rows * step_ns, self.modes[rows])


def replay(simulator: Simulator, commands: Sequence[Command], duration: float) -> Replay:
    """Simulate an arm to which plans are given that are known in advance.

    Each plan is given at its stamp. The servo's payload estimate is read every `ESTIMATED_EVERY`
    steps. Stamps and `duration` count in plan time: simulated time minus
    all delays by the guard (reference governor), which may slow a plan. The run ends when plan time
    reaches `duration`. It ends earlier if simulated time reaches `MAX_DURATION_FACTOR` times
    `duration`, or if the guard has held a plan for longer than supervision allows.

    Args:
        simulator: The simulated arm, at rest at its start; advanced in place.
        commands: Plans by increasing stamp, each of which continues the one before.
        duration: Duration of the run in plan time [s].

    Returns:
        The record of all steps.

    Raises:
        SimulationDivergedError: The simulation diverged.
    """
    end_ns = round(duration * SECOND_NS)
    most = round(MAX_DURATION_FACTOR * duration * SECOND_NS / simulator.step_ns)
    n = simulator.machine.joint_count
    reference = np.empty((most, 3, n))
    position = np.empty((most, n))
    pressure = np.empty((most, 3 * n + 3))
    modes = np.empty((most, n), dtype=np.uint8)
    waiting = list(reversed(commands))
    payload: list[tuple[float, float, float]] = []
    k = 0
    longest = SupervisionLimits.for_controller(simulator.controller_name).held[1]
    while simulator.plan_time_ns < end_ns and k < most and simulator.guard.held < longest:
        if waiting and simulator.plan_time_ns >= waiting[-1].stamp_ns:
            command = waiting.pop()
            simulator.set_plan(command.trajectory, command.schedule)
        simulator.step()
        simulator.write_state(reference[k], position[k], pressure[k], modes[k])
        k += 1
        if k % ESTIMATED_EVERY == 0:
            time = k * simulator.step_ns / SECOND_NS
            payload += [
                (time, each.value, each.deviation)
                for each in simulator.estimates
                if each.quantity == "payload"
            ]
    step = simulator.step_ns / SECOND_NS
    held = simulator.guard.sentence if simulator.guard.held >= longest else ""
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
