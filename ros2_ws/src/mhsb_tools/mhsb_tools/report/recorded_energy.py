"""Energy of a recorded run: delivered by the pumps, and predicted by the planner's model."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mhsb_model.arm_reports import SimulatorReport
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.motion.energy import compute_motion_energy
from mhsb_tools.recording.recording import Recording
from mhsb_tools.report.recorded_motion import cut_trajectory


@dataclass(frozen=True, eq=False)
class EnergyRecord:
    """Energies at the k reports of the simulator, counted from the first report.

    Attributes:
        time_ns: ROS time of each report, int64 (k,) [ns].
        main_pump: Energy delivered by the main pump, shape (k,) [J].
        servo_pumps: Shaft work delivered by the servo pumps, shape (k,) [J].
        planned: Energy by the planner's model in the paper's reading of boost, shape (k,) [J].
        planned_series: Energy by the planner's model with main pump and servo pump in series, shape
            (k,) [J].
    """

    time_ns: IntArray
    main_pump: FloatArray
    servo_pumps: FloatArray
    planned: FloatArray
    planned_series: FloatArray


def compute_energy_record(
    recording: Recording, machine: Machine, followed: Trajectory, modes: ModeSchedule
) -> EnergyRecord:
    """Compute measured and planned energy at each report of the simulator.

    Both are counted from the first report that is used. The planned energy is the planner's model
    for the reference that the servo followed and the modes that were in force. While the arm rests,
    the model counts the leakage of the modes that hold it. If the simulator was restarted between
    two reports, this interval adds 0 to all energies. Reports before the first or after the last
    reference are ignored.

    Args:
        recording: The recording. Only `simulator_reports` is read.
        machine: Its machine.
        followed: References of the whole recording, joined into one trajectory.
        modes: Modes in force over the whole recording.

    Returns:
        Energies at each report that is used; empty arrays if there is none.
    """
    reports: list[SimulatorReport] = [
        each.value
        for each in recording.simulator_reports
        if followed.stamp_ns <= each.value.sim_time_ns <= followed.end_ns
    ]
    steps = [_step(machine, followed, modes, *both) for both in pairwise(reports)]
    total = np.cumsum(np.array([[0.0] * 4, *steps]), axis=0)[: len(reports)]
    time_ns = np.array([each.sim_time_ns for each in reports], dtype=np.int64)
    return EnergyRecord(time_ns, *total.T)


def _step(
    machine: Machine,
    followed: Trajectory,
    modes: ModeSchedule,
    before: SimulatorReport,
    after: SimulatorReport,
) -> list[float]:
    """Compute measured and planned energy between two reports of the simulator.

    Args:
        machine: The machine.
        followed: References of the whole recording, joined into one trajectory.
        modes: Modes in force over the whole recording.
        before: The earlier report.
        after: The later report.

    Returns:
        Four energies [J]: measured energy of the main pump, measured shaft work of the servo pumps,
        and planned energy with boosted oil priced as `paper` and as `series`. All
        are 0 if the time does not increase or a measured energy falls, as after a restart of the
        simulator.
    """
    main_pump = after.main_pump_j - before.main_pump_j
    servo_pumps = after.servo_pumps_j - before.servo_pumps_j
    if after.sim_time_ns <= before.sim_time_ns or main_pump < 0.0 or servo_pumps < 0.0:
        return [0.0] * 4
    path = cut_trajectory(followed, before.sim_time_ns, after.sim_time_ns)
    planned = compute_motion_energy(machine, path, modes)
    return [main_pump, servo_pumps, planned.paper, planned.series]
