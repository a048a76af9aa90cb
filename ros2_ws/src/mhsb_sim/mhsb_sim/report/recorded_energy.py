"""Energy of a recorded run: what the pumps delivered, and what the planner's model says of it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory
from mhsb_model.types import FloatArray, IntArray
from mhsb_msgs_py.sim_status import SimulatorReport
from mhsb_planner.motion.energy import motion_energy
from mhsb_sim.recording.recording import Recording
from mhsb_sim.report.recorded_motion import part


@dataclass(frozen=True, eq=False)
class EnergyRecord:
    """Energies at the simulator's reports, each counted from the first of them, float64[k] J.

    time_ns         int64[k], ROS time
    main_pump       delivered by the main pump
    servo_pumps     delivered by the servo pumps, as shaft work
    planned         the planner's model of the same time, with boost priced as the paper does
    planned_series  likewise, with main pump and servo pump working in series
    """

    time_ns: IntArray
    main_pump: FloatArray
    servo_pumps: FloatArray
    planned: FloatArray
    planned_series: FloatArray


def energy_record(
    recording: Recording, machine: Machine, followed: Trajectory, modes: ModeSchedule
) -> EnergyRecord:
    """Measured and planned energy over one and the same time.

    Both are counted from the first report of the simulator to the last one, second by second.
    Planned is the model by which plans are priced (`mhsb_planner.motion.energy`), over the
    reference that was followed and the modes that were in force: every plan from its take-over
    until the next plan took over, and also all rests, which cost leakage at the price of the
    modes that hold. An interval in which the simulator was started anew (its counters
    fall) is left out of both.

    followed, modes  see `recorded_motion`
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
    """Energies between two reports: main pump, servo pumps, planned, planned in series."""
    main_pump = after.main_pump_j - before.main_pump_j
    servo_pumps = after.servo_pumps_j - before.servo_pumps_j
    if after.sim_time_ns <= before.sim_time_ns or main_pump < 0.0 or servo_pumps < 0.0:
        return [0.0] * 4
    path = part(followed, before.sim_time_ns, after.sim_time_ns)
    planned = motion_energy(machine, path, modes)
    return [main_pump, servo_pumps, planned.paper, planned.series]
