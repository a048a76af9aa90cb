"""Trajectories with mode schedules of the runs that are drawn or whose energy is reported."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import MAX_POINT_SPACING_NS, SECOND_NS, MotionState
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.motion.energy import Energy, compute_motion_energy
from mhsb_planner.motion.fitted_motion import FittedMotion
from mhsb_planner.motion.motion_profile import MotionProfile, compute_motion_profile
from mhsb_planner.motion.s3_trajectory import FitRules, fit_trajectory
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planner import fit_rules
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_tools.reproduction.runs import Runs


@dataclass(frozen=True, eq=False)
class FittedRun:
    """A run's trajectory, sampled at k instants, with its energy.

    Attributes:
        motion: Trajectory and mode schedule.
        energy: Energy of the motion [J].
        time: Instants after the start, shape (k,) [s].
        position: Joint positions, shape (k, n) [rad].
        modes: Modes in force, shape (k, n), uint8.
        profile: Piston speeds, piston forces and tip positions at these instants.
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
class FittedRuns:
    """Trajectories of several runs.

    Attributes:
        by_run: Trajectory by name of the run.
        failures: Why a run has no trajectory, by name of the run.
    """

    by_run: Mapping[str, FittedRun]
    failures: Mapping[str, str]


def fit_runs(runs: Runs, names: Iterable[str]) -> FittedRuns:
    """Make trajectories from the discrete paths of some runs.

    Args:
        runs: All runs of the machine.
        names: Names of the runs to fit.

    Returns:
        The trajectories by name of the run. For a run without a path, or whose path gives no
        trajectory, `failures` has the reason.
    """
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
    return FittedRuns(fits, failures)


def _fit(machine: Machine, path: DiscretePath, rules: FitRules) -> FittedRun:
    """Make a trajectory from a discrete path and sample it.

    The motion starts at rest, with all actuators in mode N (fed by the main pump).

    Args:
        machine: The arm.
        path: The discrete path.
        rules: Kind of trajectory and limits that it must keep.

    Returns:
        The trajectory with its energy. It is sampled every `MAX_POINT_SPACING_NS` from the start,
        and at its end.

    Raises:
        MhsbError: No trajectory keeps the limits.
    """
    modes = StartModes.create_settled(np.full(machine.joint_count, Mode.N))
    start = MotionState.at_rest(path.posture[0])
    motion = fit_trajectory(machine, path, start, modes, None, rules)
    trajectory, schedule = motion.trajectory, motion.schedule
    offset_ns = np.arange(0, trajectory.duration_ns, MAX_POINT_SPACING_NS, dtype=np.int64)
    times_ns = trajectory.stamp_ns + np.append(offset_ns, trajectory.duration_ns)
    position, velocity, _ = trajectory.sample_many(times_ns)
    return FittedRun(
        motion=motion,
        energy=compute_motion_energy(machine, trajectory, schedule),
        time=(times_ns - trajectory.stamp_ns) / SECOND_NS,
        position=position,
        modes=schedule.modes_at_many(times_ns),
        profile=compute_motion_profile(machine, position, velocity),
    )
