"""Measures of a draw's run beside its errors: payload estimate, rest, flow, planned time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mhsb_model.command import Command
from mhsb_model.hydraulics import scale_leakage
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray
from mhsb_planner.online.settings import CONFIDENCE_SIGMAS
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.moves.needed_pressure import compute_needed_pressure
from mhsb_tools.study.replay import Replay

LIFTING_JOINT_COUNT = 2
"""Number k: the servo estimates the payload from the motion of the first k joints."""

LEARNING_TIME, EACH_WAY_TIME = 5.0, 0.5
"""Time of motion of these joints before the estimate is read [s]. Least time that one of the joints
must then have moved in each direction [s].
"""

SETTLING_TIME, RESTING_TIME = 1.0, 1.0
"""Time without sensor noise before spools are observed, and for which they are observed [s]."""

FINAL_REST_TIME = 1.0
"""Time at a run's end in which the arm is at rest [s]."""

SAMPLING_STEP = 0.01
"""Time between samples of a plan [s]."""


@dataclass(frozen=True)
class PayloadEstimate:
    """The servo's estimate of the payload.

    Attributes:
        value: Estimate [kg].
        half_interval: Half width of the 95 % interval around it [kg].
        error_percent: Absolute deviation from the true payload, as a share of it [%].
        holds: Whether the interval contains the true payload.
    """

    value: float
    half_interval: float
    error_percent: float
    holds: bool


def read_payload_estimate(plant: Machine, run: Replay) -> PayloadEstimate | None:
    """Return the servo's payload estimate after a certain amount of motion.

    Only the motion of the reference of the first `LIFTING_JOINT_COUNT` joints counts. At least one
    of them must have been moving for `LEARNING_TIME` in all. A single one must have moved for
    `EACH_WAY_TIME` in each direction. The first estimate after that moment is returned.

    Args:
        plant: The simulated machine; it has the true payload, which must not be 0.
        run: The record of the run.

    Returns:
        The estimate, its 95 % interval, its deviation from the true payload, and whether the
        interval contains that payload. None if the arm did not move enough, no estimate was
        recorded afterwards, or the servo does not estimate the payload.
    """
    row = find_row_moved_both_ways(run.reference[:, 1, :LIFTING_JOINT_COUNT], run.step)
    if row is None or not len(run.payload):
        return None
    after = np.flatnonzero(run.payload[:, 0] >= run.time[row])
    if not len(after):
        return None
    _, value, deviation = run.payload[after[0]]
    half, off = CONFIDENCE_SIGMAS * deviation, abs(value - plant.arrays.payload)
    return PayloadEstimate(value, half, 100.0 * off / plant.arrays.payload, bool(off <= half))


def find_row_moved_both_ways(velocity: FloatArray, step: float) -> int | None:
    """Find the first row at which joints have moved long enough, in both directions.

    The time up to and including the row counts. At least one joint must have been moving for
    `LEARNING_TIME` in all. A single joint must have moved for `EACH_WAY_TIME` in each direction.

    Args:
        velocity: Joint velocities [rad/s or m/s], shape (k, joints).
        step: Time from one row to the next [s].

    Returns:
        Index of the row; None if there is none.
    """
    moving = step * np.cumsum(np.any(velocity != 0.0, axis=1))
    up, down = (step * np.cumsum(sign * velocity > 0.0, axis=0) for sign in (1.0, -1.0))
    both = np.any((up >= EACH_WAY_TIME) & (down >= EACH_WAY_TIME), axis=1)
    rows = np.flatnonzero((moving >= LEARNING_TIME) & both)
    return int(rows[0]) if len(rows) else None


def measure_spool_deviation(simulator: Simulator) -> float:
    """Measure how much the valve spools still move at rest, without sensor noise.

    The sensors keep their resolution and offset. Motion of the spools that remains is a
    self-sustained oscillation. The simulation goes on for `SETTLING_TIME`, which is not measured,
    and then for `RESTING_TIME`, which is.

    Args:
        simulator: The simulator at the end of a run, with the arm at rest. It is advanced in place,
            and its sensor noise stays switched off.

    Returns:
        Largest standard deviation of the position of any spool [% of the stroke from the middle to
        an end].
    """
    simulator.disable_noise()
    simulator.advance(SETTLING_TIME)
    rows = round(RESTING_TIME * SECOND_NS / simulator.step_ns)
    spools = np.empty((rows, simulator.machine.joint_count))
    for row in spools:
        simulator.step()
        row[:] = simulator.spools
    return float(100.0 * spools.std(axis=0).max())


def compute_rest_error(error: FloatArray, step: float) -> float:
    """Return the 95 % quantile of the tip error in the last second of a run.

    Args:
        error: Tip error at each step, shape (k,).
        step: Time from one step to the next [s].

    Returns:
        The quantile, in the unit of `error`.
    """
    return float(np.quantile(error[-round(FINAL_REST_TIME / step) :], 0.95))


def flow_suffices(machine: Machine, plant: Machine, commands: Sequence[Command]) -> bool:
    """Return whether the main pump of a plant can deliver the flow of the plans at every moment.

        Σ_j (A_dir |v| + q f(p/P_S)) ≤ Q_MP

    The sum is over the actuators j. A_dir is the inlet area of the cylinder [m²], v its piston
    speed [m/s], q the leakage of a valve at P_S [m³/s], f the factor of `scale_leakage` on q, and
    Q_MP the flow of the main pump [m³/s]. p is the supply pressure that the planned motion needs,
    at least P_S [Pa].

    Each plan is checked until the next one begins, at samples every `SAMPLING_STEP`.

    Args:
        machine: The machine that the planner knows; its moment arms give the piston speeds.
        plant: The simulated machine; gives all other quantities.
        commands: Plans with their mode schedules, by increasing stamp.

    Returns:
        False if a sample needs more flow than Q_MP. True otherwise, also without commands.
    """
    ends = [command.stamp_ns for command in commands[1:]] + [2**62]
    m, most = plant.arrays, plant.arrays.main_pump_flow
    for command, end in zip(commands, ends, strict=True):
        last = min(end, command.trajectory.end_ns)
        times = np.arange(command.stamp_ns, last, round(SAMPLING_STEP * SECOND_NS))
        if not len(times):
            continue
        path = np.stack(command.trajectory.sample_many(times), axis=1)
        rows = np.searchsorted(command.schedule.offset_ns, times - command.stamp_ns, "right") - 1
        pressure = compute_needed_pressure(plant, path, command.schedule.modes[np.maximum(rows, 0)])
        arms = np.array([machine.moment_arms(q) for q in path[:, 0]])
        speed = arms * path[:, 1]
        strokes = np.where(speed > 0.0, m.cap_area, m.rod_area) * np.abs(speed)
        leakage = m.leakage_flow * scale_leakage(m.land_leakage, pressure / m.supply_pressure)
        if np.any((strokes + leakage).sum(axis=1) > most):
            return False
    return True


def compute_planned_time(commands: Sequence[Command]) -> float:
    """Return the time from the beginning of the first plan to the end of the last plan.

    Args:
        commands: Plans by increasing stamp.

    Returns:
        The time [s]; 0 without commands.
    """
    if not commands:
        return 0.0
    return (commands[-1].trajectory.end_ns - commands[0].stamp_ns) / SECOND_NS
