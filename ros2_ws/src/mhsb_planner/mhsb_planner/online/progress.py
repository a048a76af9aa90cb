"""How far the motion to a goal has got, and what it has taken, by the plan in force."""

from __future__ import annotations

import numpy as np

from mhsb_model.command import Command
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.motion.energy import Energy, energy_of_states
from mhsb_planner.online.execution import Execution

SPACING_NS = 10_000_000
"""Energy is summed over spans of this length at most."""


class Progress:
    """Of one goal, over all plans that are made for it.

    share      of the time of the plan in force, 0 to 1
    left       of it [s], by the arm's clock
    energy_j, energy_series_j  from where the first plan left what was before, in both readings
    """

    def __init__(self) -> None:
        self.share = self.left = self.energy_j = self.energy_series_j = 0.0
        self._summed_ns: int | None = None

    def look(self, execution: Execution, now_ns: int) -> None:
        """Take in what has been done until now [ns], by the arm's clock."""
        command, change_ns = execution.command, execution.change_ns
        end_ns = command.trajectory.end_ns
        now_ns = min(max(now_ns, change_ns), end_ns)
        since_ns = change_ns if self._summed_ns is None else self._summed_ns
        if now_ns > since_ns:
            energy = energy_between(execution.settings.machine, command, since_ns, now_ns)
            self.energy_j += energy.paper
            self.energy_series_j += energy.series
            self._summed_ns = now_ns
        self.left = (end_ns - now_ns) / SECOND_NS
        self.share = (now_ns - change_ns) / (end_ns - change_ns) if end_ns > change_ns else 1.0


def energy_between(machine: Machine, command: Command, first_ns: int, last_ns: int) -> Energy:
    """Energy of a command between two absolute times, by the midpoint rule."""
    parts = -(-(last_ns - first_ns) // SPACING_NS)
    edges = np.linspace(first_ns, last_ns, parts + 1).astype(np.int64)
    middles = (edges[1:] + edges[:-1]) // 2
    position, velocity, acceleration = command.trajectory.sample_many(middles)
    modes = command.schedule.modes_at_many(middles)
    span = np.diff(edges) / SECOND_NS
    return energy_of_states(machine, span, position, velocity, modes, acceleration)
