"""A motion that was fitted to a discrete path: trajectory, modes, energy and deviations."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray
from mhsb_planner.motion.energy import Energy, compute_energy_of_profiles, compute_motion_energy
from mhsb_planner.motion.motion_profile import MotionProfile
from mhsb_planner.motion.overloads import Overload, find_overloads
from mhsb_planner.motion.s3_candidates import FitMethod
from mhsb_planner.motion.s3_polynomial import MIN_STEP_DURATION
from mhsb_planner.motion.s4_mode_schedule import ScheduledMotion
from mhsb_planner.motion.trajectory_points import Curve
from mhsb_planner.search.discrete_path import DiscretePath


@dataclass(frozen=True, eq=False)
class FittedMotion:
    """A trajectory and its mode schedule, both with stamp 0, and the record of the fit.

    Energy, overloads and deviations are computed when they are first read.

    Attributes:
        machine: Machine that moves.
        scheduled: Trajectory with its modes and its profile (piston speeds and forces).
        method: Kind of curve after the braking.
        braked: True if the motion begins with braking.
        followed: Discrete path and the curve that follows it; None if the motion has no path.
        scale: Factor on the durations of all steps of the path, or of each step, shape (k,) [-].
        refused: Reasons why earlier curves were refused, one sentence each.
        middles: Profile at the middles between the trajectory's points; None if it was not
            computed.
    """

    machine: Machine
    scheduled: ScheduledMotion
    method: FitMethod
    braked: bool
    followed: tuple[DiscretePath, Curve] | None = None
    scale: FloatArray | float = 1.0
    refused: tuple[str, ...] = ()
    middles: MotionProfile | None = None

    @property
    def trajectory(self) -> Trajectory:
        """Joint trajectory."""
        return self.scheduled.trajectory

    @property
    def schedule(self) -> ModeSchedule:
        """Modes over time."""
        return self.scheduled.schedule

    @cached_property
    def stretch(self) -> float:
        """Factor on the path's whole duration [-]; above 1 if the path had to be slowed.

        Inserted rests are part of the path. Without a path it is 1.
        """
        return 1.0 if self.followed is None else compute_stretch(self.followed[0], self.scale)

    @cached_property
    def energy(self) -> Energy:
        """Energy of the motion, leakage included [J]."""
        if self.middles is None:
            return compute_motion_energy(self.machine, self.trajectory, self.schedule)
        made = self.scheduled
        return compute_energy_of_profiles(
            self.machine, self.trajectory.offset_ns, made.profile, self.middles, made.intervals
        )

    @cached_property
    def speed_excess(self) -> float:
        """Greatest |v|/V_max − 1 of a piston [-]; negative if V_max is kept."""
        speed = self.scheduled.profile.speed
        fastest = np.maximum(speed.max(axis=0), -speed.min(axis=0))
        return float((fastest / self.machine.arrays.max_piston_speed).max()) - 1.0

    @cached_property
    def overloads(self) -> tuple[Overload, ...]:
        """Rests under loads that the highest boost pressure cannot hold."""
        time = self.trajectory.offset_ns / SECOND_NS
        return find_overloads(self.machine, time, self.scheduled.profile)

    @cached_property
    def _nodes_passed(self) -> FloatArray:
        """Joint positions of the motion at the planned time of each path node, shape (nodes, n)."""
        assert self.followed is not None
        curve = self.followed[1]
        return curve.sample(curve.node_time)[0]

    @property
    def tip_deviation(self) -> float:
        """Greatest distance of the tip from a path node at the node's planned time [m].

        It is 0 if the motion has no path.
        """
        if self.followed is None:
            return 0.0
        tips = self.machine.tip_in_base(self._nodes_passed)
        return float(np.linalg.norm(tips - self.followed[0].tip, axis=1).max())

    @property
    def joint_deviation(self) -> float:
        """Greatest distance of a joint from a node's posture at the node's time [rad or m].

        It is 0 if the motion has no path.
        """
        if self.followed is None:
            return 0.0
        return float(np.max(np.abs(self._nodes_passed - self.followed[0].posture)))


def compute_stretch(path: DiscretePath, scale: FloatArray | float) -> float:
    """Compute the factor on a path's whole duration from the factors on its steps.

    Args:
        path: Discrete path. Only `duration` is read.
        scale: Factor on the durations of all steps, or of each step, shape (k,) [-].

    Returns:
        Mean of the factors, weighted by the durations [-].
    """
    weight = np.maximum(path.duration, MIN_STEP_DURATION)
    return float((scale * weight).sum() / weight.sum())
