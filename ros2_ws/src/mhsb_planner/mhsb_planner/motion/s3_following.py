"""S3 that keeps what the discrete path promised: its motion in cylinder lengths, smoothed.

The discrete path at constant piston speeds, smoothed by `s3_piecewise.SmoothedPath`, stays within
V_max, joint limits and the pumps' flows, and lasts half a second longer. From a moving start it
sets out while the arm still brakes:

    L(t) = L_path(t) + L_brake(t) − L_brake(T_brake)

With the windows used here the path gains speed about as fast as braking loses it, so that an arm
that goes on the way it moves keeps its speed. Where the sum passes V_max, by some 3 % as seen on
linkages whose arms vary, the fit stretches it as it does any other curve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import motion
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray
from mhsb_planner.motion.s3_piecewise import SmoothedPath, joint_motion, smoothed_path
from mhsb_planner.search.discrete_path import DiscretePath

SHORTEST_INTERVAL = 1e-3
"""Breaks closer together than this are one [s]."""


@dataclass(frozen=True, eq=False)
class FollowedPath:
    """A smoothed path added to the braking motion that ends where the path begins."""

    path: SmoothedPath
    brake: Trajectory

    @property
    def breaks(self) -> FloatArray:
        """Times between which the curve is smooth [s]."""
        own = self.path.breaks
        braking = self.brake.offset_ns / SECOND_NS
        if braking[-1] >= own[-1]:
            return braking
        return np.concatenate([braking, own[own > braking[-1] + SHORTEST_INTERVAL]])

    @property
    def node_time(self) -> FloatArray:
        """When the discrete path's nodes are due [s]."""
        return self.path.node_time

    def sample(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """q, q̇, q̈ at the times [s], float64[times, n] each."""
        arrays = self.path.machine.arrays
        at_ns = self.brake.stamp_ns + np.rint(time * SECOND_NS).astype(np.int64)
        braking = _pistons(arrays, *self.brake.sample_many(at_ns))
        following = self.path.pistons(np.minimum(time, self.path.breaks[-1]))
        rest = _pistons(arrays, *self.brake.sample_many(np.array([self.brake.end_ns])))[0]
        length, speed, acceleration = (a + b for a, b in zip(braking, following, strict=True))
        return joint_motion(arrays, length - rest, speed, acceleration, self.brake.position[0])


def followed_path(
    machine: Machine, path: DiscretePath, window: float, brake: Trajectory, stretch: float
) -> FollowedPath:
    """Follow a path, smoothed over `window` s, from the beginning of the brake that leads to it.

    stretch: factor on the path's durations; braking takes the time it takes.
    """
    return FollowedPath(smoothed_path(machine, path, window, stretch), brake)


@kernel
def _pistons(
    m: MachineArrays, position: FloatArray, velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Piston motion of a joint motion: L(q), v = r q̇, v̇ = r q̈ + r′ q̇²."""
    length = np.empty(position.shape)
    speed = np.empty(position.shape)
    change = np.empty(position.shape)
    for k in range(len(position)):
        for j in range(position.shape[1]):
            linkage, q, qd = m.linkage[j], position[k, j], velocity[k, j]
            length[k, j], arm, slope = motion(linkage, q)
            speed[k, j] = arm * qd
            change[k, j] = arm * acceleration[k, j] + slope * qd**2
    return length, speed, change
