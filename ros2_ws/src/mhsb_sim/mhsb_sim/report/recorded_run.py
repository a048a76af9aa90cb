"""A recording with everything that is derived from it once, for the summary and the figures."""

from __future__ import annotations

from dataclasses import dataclass

from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory
from mhsb_sim.recording.bag_format import BagError
from mhsb_sim.recording.recording import Recording, check_order
from mhsb_sim.report.goal_fates import GoalFate, goal_fates
from mhsb_sim.report.recorded_energy import EnergyRecord, energy_record
from mhsb_sim.report.recorded_goals import GoalRecord, goal_records
from mhsb_sim.report.recorded_motion import (
    TipMotion,
    followed_trajectory,
    modes_in_force,
    tip_motion,
)


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """A recording, whose it is, and what follows from it; see the modules of the types."""

    recording: Recording
    machine: Machine
    followed: Trajectory
    modes: ModeSchedule
    tip: TipMotion
    goals: tuple[GoalRecord, ...]
    fates: tuple[GoalFate, ...]
    energy: EnergyRecord


def recorded_run(recording: Recording, machine: Machine) -> RecordedRun:
    """Evaluate a recording; raises BagError where it is not of this machine or lacks streams."""
    if recording.joint_count != machine.joint_count:
        raise BagError(
            f"the recording has {recording.joint_count} joints, the machine {machine.name} has "
            f"{machine.joint_count}; give the recording's machine file"
        )
    check_order(recording)
    followed = followed_trajectory(recording)
    modes = modes_in_force(recording)
    tip = tip_motion(recording, machine, followed)
    return RecordedRun(
        recording,
        machine,
        followed,
        modes,
        tip,
        goal_records(recording, followed, tip),
        goal_fates(recording),
        energy_record(recording, machine, followed, modes),
    )
