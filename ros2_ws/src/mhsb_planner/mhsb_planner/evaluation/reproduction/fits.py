"""Time trajectories (S3, S4) of the runs that are drawn or whose energy is told after fitting."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import POINT_SPACING_NS, SECOND_NS, MotionState
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_planner.evaluation.reproduction.runs import Runs
from mhsb_planner.motion.energy import Energy, motion_energy
from mhsb_planner.motion.motion_profile import MotionProfile, motion_profile
from mhsb_planner.motion.s3_trajectory import FitRules, FittedMotion, fit_trajectory
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planner import fit_rules
from mhsb_planner.search.discrete_path import DiscretePath


@dataclass(frozen=True, eq=False)
class Fit:
    """A run's trajectory with its energy, and where to find it sampled.

    time, position  float64[k] s and float64[k, n] rad
    modes           uint8[k, n]
    profile         piston speeds, cylinder forces and tip at these times
    """

    motion: FittedMotion
    energy: Energy
    time: FloatArray
    position: FloatArray
    modes: ModeArray
    profile: MotionProfile

    @property
    def duration(self) -> float:
        """Duration of the trajectory [s]."""
        return self.motion.trajectory.duration_ns / SECOND_NS


@dataclass(frozen=True, eq=False)
class Fits:
    """Fits by the name of their run; the runs that have none, and why."""

    of: Mapping[str, Fit]
    failures: Mapping[str, str]


def fit_runs(runs: Runs, names: Iterable[str]) -> Fits:
    """Fits of the runs named; one without trajectory is a result."""
    fits, failures = {}, {}
    for name in names:
        run = runs[name]
        if run.path is None:
            failures[name] = run.failure
            continue
        try:
            fits[name] = _fit(run.machine, run.path, fit_rules(run.setting.case.options))
        except MhsbError as error:
            failures[name] = str(error)
    return Fits(fits, failures)


def _fit(machine: Machine, path: DiscretePath, rules: FitRules) -> Fit:
    modes = StartModes.settled(np.full(machine.joint_count, Mode.N))
    start = MotionState.at_rest(path.posture[0])
    motion = fit_trajectory(machine, path, start, modes, None, rules)
    trajectory, schedule = motion.trajectory, motion.schedule
    times_ns = _sample_times(trajectory.duration_ns) + trajectory.stamp_ns
    position, velocity, _ = trajectory.sample_many(times_ns)
    return Fit(
        motion=motion,
        energy=motion_energy(machine, trajectory, schedule),
        time=(times_ns - trajectory.stamp_ns) / SECOND_NS,
        position=position,
        modes=schedule.modes_at_many(times_ns),
        profile=motion_profile(machine, position, velocity),
    )


def _sample_times(duration_ns: int) -> IntArray:
    return np.append(np.arange(0, duration_ns, POINT_SPACING_NS, dtype=np.int64), duration_ns)
