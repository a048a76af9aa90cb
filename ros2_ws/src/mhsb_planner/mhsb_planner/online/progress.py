"""Progress of the motion to a goal, and its energy so far according to the plans.

The time of plans is the arm's clock minus the delay that speed scaling has caused.
"""

import numpy as np

from mhsb_model.command import Command
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.motion.energy import Energy, compute_energy_of_states
from mhsb_planner.online.execution import Execution

SPACING_NS = 10_000_000
"""Longest time step of the energy sum [ns]."""


class Progress:
    """Progress of one goal over all plans that are made for it.

    The change of a plan is the time at which it deviates from the previous plan.

    Attributes:
        time_share: Elapsed share of the time from the change of the plan in force to its end, 0 to
            1 [-].
        time_left: Time until the end of the plan in force, in the time of plans [s].
        energy_j: Energy since the change of the first plan, in the energy reading `paper` [J].
        energy_series_j: Energy since the change of the first plan, in the energy reading `series`
            [J].
    """

    def __init__(self) -> None:
        """Begin with all values at 0."""
        self.time_share = self.time_left = self.energy_j = self.energy_series_j = 0.0
        self._summed_ns: int | None = None

    def update(self, execution: Execution, now_ns: int) -> None:
        """Update the elapsed share (0 … 1), the time left [s] and the energies [J].

        `replan.change_ns` is the time at which the plan deviates from the previous plan. The
        present time is limited to the range from there to the plan's end. The energy since the
        previous update is added.

        Args:
            execution: Execution of the plan in force.
            now_ns: Time of plans [ns]: the arm's clock minus the delay that speed scaling has
                caused.
        """
        command, change_ns = execution.replan.command, execution.replan.change_ns
        end_ns = command.trajectory.end_ns
        now_ns = min(max(now_ns, change_ns), end_ns)
        since_ns = change_ns if self._summed_ns is None else self._summed_ns
        if now_ns > since_ns:
            energy = compute_energy_between(execution.settings.machine, command, since_ns, now_ns)
            self.energy_j += energy.paper
            self.energy_series_j += energy.series
            self._summed_ns = now_ns
        self.time_left = (end_ns - now_ns) / SECOND_NS
        self.time_share = (now_ns - change_ns) / (end_ns - change_ns) if end_ns > change_ns else 1.0


def compute_energy_between(
    machine: Machine, command: Command, first_ns: int, last_ns: int
) -> Energy:
    """Compute the energy that a command takes between two times, by the midpoint rule.

    The steps of the rule are at most `SPACING_NS` long. The cylinder forces include inertia.

    Args:
        machine: Machine with its hydraulics.
        command: Joint trajectory and modes.
        first_ns: Beginning, by the clock of the command's stamp [ns].
        last_ns: End, after `first_ns`, by the same clock [ns].

    Returns:
        Energy of this part of the motion [J]. The field `paper` follows the published model. All
        other fields count main pump and servo pumps in series.
    """
    parts = -(-(last_ns - first_ns) // SPACING_NS)
    edges = np.linspace(first_ns, last_ns, parts + 1).astype(np.int64)
    middles = (edges[1:] + edges[:-1]) // 2
    position, velocity, acceleration = command.trajectory.sample_many(middles)
    modes = command.schedule.modes_at_many(middles)
    span = np.diff(edges) / SECOND_NS
    return compute_energy_of_states(machine, span, position, velocity, modes, acceleration)
