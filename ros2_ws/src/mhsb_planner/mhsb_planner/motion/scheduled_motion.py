"""A trajectory together with its modes.

If the trajectory is too short to switch the modes, it gets a rest at its end.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mhsb_model.holding import choose_stop_modes
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import ModeArray
from mhsb_planner.motion.motion_profile import MotionProfile, compute_motion_profile
from mhsb_planner.motion.s4_mode_schedule import (
    DEFAULT_SWITCHING_RULES,
    StartModes,
    SwitchingRules,
    compute_interval_modes,
    create_schedule_of_intervals,
    keeps_dwell,
)


@dataclass(frozen=True, eq=False)
class ScheduledMotion:
    """A trajectory of k points, its profile, and its modes from `s4_mode_schedule`.

    Attributes:
        trajectory: Joint trajectory.
        profile: Profile (piston speeds and forces) at the points.
        intervals: Mode codes between the points, shape (k - 1, n).
        hold: Mode codes from the last point on, shape (n,).
        keeps_dwell: True if every actuator keeps the least time between two switches.
    """

    trajectory: Trajectory
    profile: MotionProfile
    intervals: ModeArray
    hold: ModeArray
    keeps_dwell: bool

    @classmethod
    def create(
        cls,
        machine: Machine,
        trajectory: Trajectory,
        start: StartModes,
        preferred: ModeArray | None = None,
        rules: SwitchingRules = DEFAULT_SWITCHING_RULES,
    ) -> ScheduledMotion:
        """Compute the modes of a trajectory, with a standstill at its end if switches need time.

        If an actuator would be switched twice within `rules.min_dwell`, a standstill is added at
        the trajectory's end. It lasts 2 `rules.min_dwell`, long enough for two switches.

        Args:
            machine: Machine with its hydraulics and modules.
            trajectory: Joint trajectory.
            start: Modes in force at the beginning, and time since each actuator's last switch.
            preferred: Modes that the graph search (S2) chose around each point, shape (points, n).
                Only SB has an effect: an actuator that needs boost then gets SB. None means no
                preference.
            rules: Rules for switching.

        Returns:
            Trajectory with its profile and its modes, and with the standstill if it was needed. Its
            `keeps_dwell` may be False in spite of the standstill.
        """
        once = cls._create_without_rest(machine, trajectory, start, preferred, rules)
        if once.keeps_dwell:
            return once
        rested = trajectory.with_rest(round(2 * rules.min_dwell * SECOND_NS))
        if preferred is not None:
            rest = len(rested.offset_ns) - len(preferred)
            preferred = np.vstack([preferred, np.repeat(preferred[-1:], rest, axis=0)])
        return cls._create_without_rest(machine, rested, start, preferred, rules)

    @classmethod
    def _create_without_rest(
        cls,
        machine: Machine,
        trajectory: Trajectory,
        start: StartModes,
        preferred: ModeArray | None,
        rules: SwitchingRules,
    ) -> ScheduledMotion:
        """Compute the modes of a trajectory that stays as it is.

        Args:
            machine: Machine with its hydraulics and modules.
            trajectory: Joint trajectory.
            start: Modes in force at the beginning, and time since each actuator's last switch.
            preferred: Modes that the graph search (S2) chose around each point, shape (points, n).
                Only SB has an effect: an actuator that needs boost then gets SB. None means no
                preference.
            rules: Rules for switching.

        Returns:
            Trajectory with its profile and its modes. Its `keeps_dwell` is False if an actuator is
            switched twice within `rules.min_dwell`.
        """
        profile = compute_motion_profile(
            machine, trajectory.position, trajectory.velocity, trajectory.acceleration
        )
        time = trajectory.offset_ns / SECOND_NS
        hold = choose_stop_modes(machine, profile.force[-1], start.modes)
        modes = compute_interval_modes(machine, time, profile, start, hold, preferred, rules)
        kept = keeps_dwell(time, modes, start, hold, rules)
        return cls(trajectory, profile, modes, hold, kept)

    @cached_property
    def schedule(self) -> ModeSchedule:
        """Mode schedule of the trajectory, with its stamp."""
        offset = self.trajectory.offset_ns
        return create_schedule_of_intervals(
            self.trajectory.stamp_ns, offset, self.intervals, self.hold
        )
