"""An evaluated recording: everything that the summary and the figures both need."""

import logging
from dataclasses import dataclass

from mhsb_model.circuit.dead_time import compute_dead_time, compute_settling_time
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory
from mhsb_tools.recording.bag_format import BagError
from mhsb_tools.recording.recording import Recording, check_order
from mhsb_tools.report.goal_fates import (
    LEAD_MAX,
    JudgedGoal,
    find_unrecorded_goals,
    judge_recorded_goals,
)
from mhsb_tools.report.recorded_energy import EnergyRecord, compute_energy_record
from mhsb_tools.report.recorded_goals import RecordedGoal, evaluate_goals
from mhsb_tools.report.recorded_motion import (
    TipMotion,
    compute_tip_motion,
    join_modes,
    join_references,
)

_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class EvaluatedRecording:
    """A recording with its machine and the results of its evaluation.

    Attributes:
        recording: The decoded recording.
        machine: The recorded arm.
        reference: All joint references that the arm published, as one trajectory.
        modes: All modes that were in force, as one schedule.
        tip: Positions of the measured tip and of its reference.
        goals: Goals that got a verdict.
        judged_goals: All goals, judged.
        energy: Measured and planned energy.
    """

    recording: Recording
    machine: Machine
    reference: Trajectory
    modes: ModeSchedule
    tip: TipMotion
    goals: tuple[RecordedGoal, ...]
    judged_goals: tuple[JudgedGoal, ...]
    energy: EnergyRecord


def check_machine(recording: Recording, machine: Machine) -> None:
    """Check that a recording is of the given machine.

    The simulator's reports have the name and the planning hash (hash of all values that planner and
    arm must share) of the recorded machine. If no report has them, only a warning is logged.

    Args:
        recording: The recording. Only `simulator_reports` is read.
        machine: The machine with which the recording is to be evaluated.

    Raises:
        BagError: The recorded machine has another planning hash.
    """
    reported = {
        (each.value.machine, each.value.machine_hash) for each in recording.simulator_reports
    } - {("", "")}
    if not reported:
        _log.warning(
            "the recording does not say which machine it is of: it is read as one of %s",
            machine.name,
        )
    for name, planning_hash in reported:
        if difference := machine.describe_difference(name, planning_hash):
            raise BagError(f"{difference} (--machine)")


def evaluate_recording(recording: Recording, machine: Machine) -> EvaluatedRecording:
    """Evaluate references, modes, tip, goals and energy of a recording.

    A warning is logged if goals have verdicts but no recorded message, or if the recording does not
    say which machine it is of.

    Args:
        recording: The recording.
        machine: Its machine.

    Returns:
        The recording with all results.

    Raises:
        BagError: The recording is of another machine, or its ROS time decreases. Or it has no
            references, no modes, or no joint state within the time of the references.
    """
    if recording.joint_count != machine.joint_count:
        raise BagError(
            f"the recording has {recording.joint_count} joints, the machine {machine.name} has "
            f"{machine.joint_count}; give the recording's machine file"
        )
    check_machine(recording, machine)
    check_order(recording)
    if unrecorded := len(find_unrecorded_goals(recording)):
        _log.warning(
            "messages of goals that are not in the recording: %d; these goals are judged by their "
            "verdicts and execution reports (the sender did not know the recorder yet, or used the "
            "action)",
            unrecorded,
        )
    followed = join_references(recording)
    modes = join_modes(recording)
    tip = compute_tip_motion(recording, machine, followed)
    return EvaluatedRecording(
        recording,
        machine,
        followed,
        modes,
        tip,
        evaluate_goals(recording, followed, tip),
        judge_recorded_goals(
            recording,
            settling_time=compute_settling_time(machine),
            lead_max=LEAD_MAX + compute_dead_time(machine),
        ),
        compute_energy_record(recording, machine, followed, modes),
    )
