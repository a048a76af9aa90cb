"""Energy of a recorded run: delivered by the pumps, and predicted by the planner's model."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mhsb_model.arm_reports import SimulatorReport
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.motion.energy import compute_motion_energy
from mhsb_tools.moves.supply_systems import (
    SingleSupply,
    compute_constant_pressure_energy,
    compute_loads,
    compute_needed_supply,
)
from mhsb_tools.recording.recording import Recording
from mhsb_tools.report.recorded_motion import cut_trajectory


@dataclass(frozen=True, eq=False)
class EnergyRecord:
    """Energies at the k reports of the simulator, counted from the first report.

    Attributes:
        time_ns: ROS time of each report, int64 (k,) [ns].
        one_pump_pressure: Lowest constant pressure that suffices for the whole recording without
            boost [Pa].
        main_pump: Energy delivered by the main pump, shape (k,) [J].
        servo_pumps: Shaft work delivered by the servo pumps, shape (k,) [J].
        planned: Energy by the planner's model in the paper's reading of boost, shape (k,) [J].
        planned_series: Energy by the planner's model with main pump and servo pump in series, shape
            (k,) [J].
        one_pump: Energy that one pump at this constant pressure takes for the same motion, shape
            (k,) [J].
    """

    time_ns: IntArray
    one_pump_pressure: float
    main_pump: FloatArray
    servo_pumps: FloatArray
    planned: FloatArray
    planned_series: FloatArray
    one_pump: FloatArray

    @property
    def measured(self) -> FloatArray:
        """Measured energy of all pumps, shape (k,) [J]."""
        return self.main_pump + self.servo_pumps

    def describe_saving(self) -> str:
        """Return measured energy, the model's energy, and the saving against one pump in words.

        There must be a report.
        """
        one_pump = SingleSupply(self.one_pump_pressure, float(self.one_pump[-1]))
        planned = one_pump.describe_saving(float(self.planned_series[-1]))
        return f"{self.measured[-1]:.1f} J measured; by the planner's model {planned}"

    def compute_excess(self, begin_ns: int, end_ns: int) -> float:
        """Compute by how much the measured energy exceeds the model's between two times.

        Reports are a second apart. Between them, this difference is interpolated linearly, because
        it varies less than the energies do.

        Args:
            begin_ns: First time [ns, ROS time].
            end_ns: Last time [ns, ROS time].

        Returns:
            Measured energy of all pumps minus `planned_series` [J]; nan if a time is beyond the
            reports.
        """
        if len(self.time_ns) == 0 or begin_ns < self.time_ns[0] or end_ns > self.time_ns[-1]:
            return math.nan
        at = np.array([begin_ns, end_ns]) - self.time_ns[0]
        excess = self.measured - self.planned_series
        return float(np.diff(np.interp(at, self.time_ns - self.time_ns[0], excess))[0])


def compute_energy_record(
    recording: Recording, machine: Machine, followed: Trajectory, modes: ModeSchedule
) -> EnergyRecord:
    """Compute measured and planned energy at each report of the simulator.

    Both are counted from the first report that is used. The planned energy is the planner's model
    for the reference that the servo followed and the modes that were in force. While the arm rests,
    the model counts the leakage of the modes that hold it. One pump keeps its pressure constant
    over the whole recording. If the simulator was restarted between two reports, this interval adds
    0 to all energies. Reports before the first or after the last reference are ignored.

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
    pressure = compute_needed_supply(machine, compute_loads(machine, followed))
    steps = [_step(machine, followed, modes, pressure, *both) for both in pairwise(reports)]
    total = np.cumsum(np.array([[0.0] * 5, *steps]), axis=0)[: len(reports)]
    time_ns = np.array([each.sim_time_ns for each in reports], dtype=np.int64)
    return EnergyRecord(time_ns, pressure, *total.T)


def _step(
    machine: Machine,
    followed: Trajectory,
    modes: ModeSchedule,
    pressure: float,
    before: SimulatorReport,
    after: SimulatorReport,
) -> list[float]:
    """Compute measured and planned energy between two reports of the simulator.

    Args:
        machine: The machine.
        followed: References of the whole recording, joined into one trajectory.
        modes: Modes in force over the whole recording.
        pressure: Pressure of one pump at constant pressure [Pa].
        before: The earlier report.
        after: The later report.

    Returns:
        Five energies [J]: measured energy of the main pump, measured shaft work of the servo pumps,
        planned energy with boosted oil priced as `paper` and as `series`, and energy of one
        pump at constant pressure. All are 0 if the time does not increase or a
        measured energy falls, as after a restart of the simulator.
    """
    main_pump = after.main_pump_j - before.main_pump_j
    servo_pumps = after.servo_pumps_j - before.servo_pumps_j
    if after.sim_time_ns <= before.sim_time_ns or main_pump < 0.0 or servo_pumps < 0.0:
        return [0.0] * 5
    path = cut_trajectory(followed, before.sim_time_ns, after.sim_time_ns)
    planned = compute_motion_energy(machine, path, modes)
    one_pump = compute_constant_pressure_energy(machine, compute_loads(machine, path), pressure)
    return [main_pump, servo_pumps, planned.paper, planned.series, one_pump.hydraulic_j]
