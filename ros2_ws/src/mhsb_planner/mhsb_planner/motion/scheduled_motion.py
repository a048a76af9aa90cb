"""A trajectory together with its modes; where it is too short to switch, it rests at its end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.holding import modes_to_stop
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import ModeArray
from mhsb_planner.motion.motion_profile import MotionProfile, motion_profile
from mhsb_planner.motion.s4_mode_schedule import (
    StartModes,
    SwitchingRules,
    interval_modes,
    keeps_dwell,
    schedule_of_intervals,
)


@dataclass(frozen=True, eq=False)
class ScheduledMotion:
    """A trajectory of k points, its profile, and S4's modes.

    intervals    uint8[k - 1, n], modes between the points
    hold         uint8[n], from the last point on
    keeps_dwell  whether no actuator is switched twice within the least dwell
    """

    trajectory: Trajectory
    profile: MotionProfile
    intervals: ModeArray
    hold: ModeArray
    keeps_dwell: bool

    @classmethod
    def of(
        cls,
        machine: Machine,
        trajectory: Trajectory,
        start: StartModes,
        preferred: ModeArray | None = None,
        rules: SwitchingRules | None = None,
    ) -> ScheduledMotion:
        """S4's modes; `start`, `preferred` and `rules` as of `s4_mode_schedule`.

        Where the dwell cannot be kept otherwise, the motion gets a rest at its end, long enough
        for a mode to be left and another one to be left again.
        """
        rules = rules or SwitchingRules()
        once = cls._as_it_is(machine, trajectory, start, preferred, rules)
        if once.keeps_dwell:
            return once
        rested = trajectory.rested(round(2 * rules.min_dwell * SECOND_NS))
        if preferred is not None:
            rest = len(rested.offset_ns) - len(preferred)
            preferred = np.vstack([preferred, np.repeat(preferred[-1:], rest, axis=0)])
        return cls._as_it_is(machine, rested, start, preferred, rules)

    @classmethod
    def _as_it_is(
        cls,
        machine: Machine,
        trajectory: Trajectory,
        start: StartModes,
        preferred: ModeArray | None,
        rules: SwitchingRules,
    ) -> ScheduledMotion:
        profile = motion_profile(
            machine, trajectory.position, trajectory.velocity, trajectory.acceleration
        )
        time = trajectory.offset_ns / SECOND_NS
        hold = modes_to_stop(machine, profile.force[-1], start.modes)
        modes = interval_modes(machine, time, profile, start, hold, preferred, rules)
        kept = keeps_dwell(time, modes, start, hold, rules)
        return cls(trajectory, profile, modes, hold, kept)

    @property
    def schedule(self) -> ModeSchedule:
        """Of the trajectory, with its stamp."""
        offset = self.trajectory.offset_ns
        return schedule_of_intervals(self.trajectory.stamp_ns, offset, self.intervals, self.hold)
