"""S3's last resort: from node to node of the discrete path, at rest at every one.

It moves along exactly the postures that the search has admitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.motion.piston_motion import lengths_of
from mhsb_planner.search.discrete_path import DiscretePath

SHORTEST_STEP = 0.1
"""Shortest duration of a step from rest to rest [s]."""

PEAKS = (15 / 8, 10 / 3**0.5, 60.0)
"""Largest speed, acceleration and jerk of 10u³ − 15u⁴ + 6u⁵, u from 0 to 1 in unit time."""


@dataclass(frozen=True, eq=False)
class SteppedPath:
    """q(t) from node to node, along straight lines in joint space, from rest to rest.

    q = q_i + Δq (10u³ − 15u⁴ + 6u⁵), u running from 0 to 1 over each step.
    """

    posture: FloatArray  # float64[k + 1, n] rad
    node_time: FloatArray  # float64[k + 1] s

    @property
    def breaks(self) -> FloatArray:
        """Times between which the curve is smooth [s]."""
        return self.node_time

    def sample(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q, q̇, q̈ at the times [s], float64[times, n] each."""
        last = len(self.node_time) - 2
        step = np.clip(np.searchsorted(self.node_time, time, "right") - 1, 0, last)
        span = np.diff(self.node_time)[step]
        u = np.clip((time - self.node_time[step]) / span, 0.0, 1.0)[:, None]
        span = span[:, None]
        dq = np.diff(self.posture, axis=0)[step]
        q = self.posture[step] + dq * (10 * u**3 - 15 * u**4 + 6 * u**5)
        qd = dq * (30 * u**2 - 60 * u**3 + 30 * u**4) / span
        qdd = dq * (60 * u - 180 * u**2 + 120 * u**3) / span**2
        return q, qd, qdd


def stepped_path(machine: Machine, path: DiscretePath, stretch: float) -> SteppedPath:
    """Steps from rest to rest; at stretch 1 each is as fast as the path at most.

    Acceleration and jerk of the pistons hold too, but for what their moment arms change by.
    """
    m = machine.arrays
    stroke = np.abs(np.diff(lengths_of(m, path.posture), axis=0)).max(axis=1)
    speed, acceleration, jerk = PEAKS
    duration = np.maximum(speed * path.duration, SHORTEST_STEP)
    duration = np.maximum(duration, np.sqrt(acceleration * stroke / m.max_piston_acceleration))
    duration = np.maximum(duration, np.cbrt(jerk * stroke / m.max_piston_jerk))
    return SteppedPath(path.posture, np.concatenate([[0.0], np.cumsum(stretch * duration)]))
