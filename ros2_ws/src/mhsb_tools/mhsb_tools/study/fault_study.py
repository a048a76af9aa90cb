"""Fault study: when a failing part is detected during a lift in boost, and what happens.

There is one run for each fault. The arm lifts its payload, the fault comes at 40 % of the motion's
time, and the run goes on for a while after the motion. The tip's error counts until the valves are
closed, since the reference is not followed after that.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mhsb_model.command import Command
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray
from mhsb_planner.executor import Jobs, create_executor, yield_results
from mhsb_planner.online.commit_horizon import compute_offline_horizon
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import DEFAULT_PLANNER, PlanOptions
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_sim.simulation.faults import parse_faults
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervised_arm import SupervisedArm
from mhsb_tools.errors import ScenarioError
from mhsb_tools.study.servo_study import make_hold_command

GOAL_POSITION = 0.95, 0.30
"""Goal (x, z) [m] with the arm stretched out, so that joint 1 lifts in boost."""

FAULT_TIME_SHARE = 0.4
TAIL_TIME = 3.0
"""Share of the motion's time at which the fault comes, and time for which the run goes on after the
motion's end [s].
"""

STUDIED_FAULTS = (
    "none",
    "main_pump",
    "supply_sag",
    "servo_pumps",
    "servo_pump_dead:1",
    "servo_pump_slow:1",
    "servo_pump_stuck_on:2",
    "valve_stuck:actuator_1",
    "valve_stuck:actuator_2",
    "valve_hard_over:actuator_1",
    "valve_hard_over:actuator_2:-1",
    "valve_hard_over:actuator_3",
    "leakage:actuator_1",
    "leakage:actuator_3",
    "sensor_dead:actuator_1.line_pressure",
    "sensor_dead:actuator_2.length",
    "sensor_frozen:actuator_1.length",
    "sensor_frozen:actuator_2.cap_pressure",
    "sensor_frozen:actuator_3.line_pressure",
    "length_offset:actuator_1.length",
    "length_drift:actuator_2.length",
    "pressure_offset:actuator_1.cap_pressure",
    "pressure_offset:actuator_3.line_pressure",
    "pressure_drift:actuator_1.cap_pressure",
    "pressure_drift:actuator_3.line_pressure",
)


@dataclass(frozen=True)
class FaultRecord:
    """Measured numbers of one fault during a lift.

    Attributes:
        fault: The fault, as in the simulator's parameter `fault`.
        found_after_s: Time from the fault to the first fault or warning of the arm's supervision
            [s]; None if there was none.
        sentence: First fault or warning of the supervision; without one, the intervention of the
            guard, or an empty text.
        stopped: Whether the arm was stopped.
        tip_error_max_mm: Largest distance of the tip from its reference until the valves closed
            [mm].
        joint_speed_max: Largest joint speed after the fault [rad/s, or m/s of a telescope].
        pressure_max_mpa: Highest chamber pressure after the fault [MPa].
        relief_opened: Whether a relief valve let oil through after the fault.
        at_goal_mm: Distance of the tip from the goal at the end [mm].
    """

    fault: str
    found_after_s: float | None
    sentence: str
    stopped: bool
    tip_error_max_mm: float
    joint_speed_max: float
    pressure_max_mpa: float
    relief_opened: bool
    at_goal_mm: float


@dataclass(frozen=True, eq=False)
class FaultResult:
    """Measured numbers and signals of one fault.

    Attributes:
        record: The measured numbers.
        trace: Signals after the fault, shape (k, 2 + 2 n): time since the fault [s], tip error [m],
            speed of each joint [rad/s], higher chamber pressure of each actuator [Pa].
        closed: Time from the fault to the closing of the valves [s]; NaN if they stayed open.
    """

    record: FaultRecord
    trace: FloatArray
    closed: float


def plan_lift(machine: Machine) -> Command:
    """Plan the motion during which all faults are simulated.

    It goes from rest in the start posture to GOAL_POSITION, by the default planner. The posture
    table is built if it is not cached.

    Args:
        machine: The arm; it must not slew.

    Returns:
        Trajectory and mode schedule.

    Raises:
        ScenarioError: The start posture is at the goal already.
        MhsbError: There is no plan.
    """
    replanner = Replanner(machine, load_or_build_table(machine))
    options = PlanOptions(planner=DEFAULT_PLANNER)
    horizon = compute_offline_horizon(machine)
    replan = replanner.replan(
        make_hold_command(machine), SECOND_NS // 2, GOAL_POSITION, horizon, options
    )
    if replan is None:
        raise ScenarioError(f"the arm is at {GOAL_POSITION} m from the start; faults need a motion")
    return replan.command


def run_fault(machine: Machine, motion: Command, fault: str, controller: str) -> FaultResult:
    """Simulate a motion during which a part fails, with supervision.

    The fault comes when the share FAULT_TIME_SHARE of the motion's duration has passed. The
    simulation ends TAIL_TIME after the planned end of the motion.

    Args:
        machine: The arm; it must not slew.
        motion: The motion that is followed.
        fault: The fault, as in the simulator's parameter `fault`, such as `valve_stuck:actuator_1`.
        controller: Name of the controller.

    Returns:
        Measured numbers, and signals after the fault.

    Raises:
        FaultError: There is no such fault.
    """
    arm = SupervisedArm(Simulator(machine, controller))
    simulator, n = arm.simulator, machine.joint_count
    faults = parse_faults(fault, machine)
    arm.add_trajectory(motion.trajectory, 0.0)
    arm.add_schedule(motion.schedule, 0.0)
    fails_ns = round(motion.stamp_ns + FAULT_TIME_SHARE * motion.trajectory.duration_ns)
    end_ns = motion.trajectory.end_ns + round(TAIL_TIME * SECOND_NS)
    rows, found, sentence, closed, relief = [], None, "", np.nan, 0.0
    while simulator.time_ns < end_ns:
        if simulator.time_ns == fails_ns // simulator.step_ns * simulator.step_ns:
            simulator.inject_faults(faults)
            relief = simulator.energies["relief_valves"]
        arm.step(0.0)
        since = (simulator.time_ns - fails_ns) / SECOND_NS
        message = arm.fault or arm.warning
        if found is None and message and since >= 0.0:
            found, sentence = since, message
        if simulator.valves_closed and np.isnan(closed):
            closed = since
        if since > 0.0:
            pressure = simulator.actuator_states
            highest = np.maximum(pressure.cap_pressure, pressure.rod_pressure)
            state = simulator.joint_state
            wanted = simulator.reference.position
            tips = machine.tip_in_base(np.array([state.position, wanted]))
            off = float(np.linalg.norm(tips[0] - tips[1]))
            rows.append([since, off, *np.abs(state.velocity), *highest])
    trace = np.array(rows)
    open_still = trace[:, 0] <= (np.inf if np.isnan(closed) else closed)
    away = machine.tip_in_base(simulator.joint_state.position) - GOAL_POSITION
    record = FaultRecord(
        fault,
        found,
        sentence or arm.intervention,
        bool(arm.fault),
        1e3 * float(trace[open_still, 1].max()),
        float(trace[:, 2 : 2 + n].max()),
        float(trace[:, 2 + n :].max()) / 1e6,
        simulator.energies["relief_valves"] > relief,
        1e3 * float(np.hypot(*away)),
    )
    return FaultResult(record, trace, closed)


def run_faults(
    machine: Machine, faults: Sequence[str], controller: str, jobs: Jobs = None
) -> Iterator[FaultResult]:
    """Simulate faults in parallel processes, each during the same motion.

    Args:
        machine: The arm; it must not slew.
        faults: Names of the faults, as in the simulator's parameter `fault`. All are checked before
            the first simulation.
        controller: Name of the controller.
        jobs: Number of processes or a cluster; None takes one process for each processor.

    Yields:
        Results in the order of the faults.

    Raises:
        FaultError: One of the faults does not exist.
        ScenarioError: The start posture is at the goal of the motion already.
        MhsbError: There is no plan for the motion.
        RequestError: `jobs` is below 1.
        ClusterError: The cluster does not answer.
    """
    for fault in faults:
        parse_faults(fault, machine)
    motion = plan_lift(machine)
    with create_executor(jobs) as pool:
        tasks = [pool.submit(run_fault, machine, motion, each, controller) for each in faults]
        yield from yield_results(tasks, in_order=True)


def as_text(records: Sequence[FaultRecord]) -> list[str]:
    """Format the records of all faults as a table.

    Args:
        records: Record of each fault.

    Returns:
        A line of column titles, then a line for each fault. Its columns are:

        - name of the fault
        - time from the fault to the first message of the supervision [s], or 'not found'
        - largest tip error [mm], joint speed [rad/s] and chamber pressure [MPa]
        - distance of the tip from the goal at the end [mm]
        - sentence of the record, after 'stopped: ' if the arm was stopped
    """
    lines = [
        f"{'fault':42s}{'found after':>12s}{'tip':>9s}{'joint':>11s}{'chamber':>10s}{'to goal':>9s}"
    ]
    for record in records:
        found = "not found" if record.found_after_s is None else f"{record.found_after_s:.3f} s"
        ending = "stopped: " if record.stopped else ""
        lines.append(
            f"{record.fault:42s}{found:>12s}{record.tip_error_max_mm:6.1f} mm"
            f"{record.joint_speed_max:6.2f} rad/s{record.pressure_max_mpa:6.1f} MPa"
            f"{record.at_goal_mm:6.0f} mm  {ending}{record.sentence}"
        )
    return lines
