"""What becomes of a lift in boost during which a part fails: when it is found, and what it costs.

One run for each fault: the arm lifts its payload, the fault comes at 40 % of the motion's time,
and is watched until the arm has stood for a while. The tip's error counts up to where the valves
are closed, since nobody follows a reference after that.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mhsb_model.command import Command
from mhsb_model.holding import holding_modes
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray
from mhsb_planner.online.lead import OFFLINE_LEAD
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import ONLINE_PLANNER, PlanOptions
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_planner.workers import Jobs, processes, results_of
from mhsb_sim.errors import ScenarioError
from mhsb_sim.simulation.faults import parse_faults
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervised_arm import SupervisedArm
from mhsb_sim.simulation.symptoms import SupervisionLimits

GOAL = 0.95, 0.30
"""Stretched out [m], so that joint 1 lifts in boost."""

MOMENT = 0.4
TAIL = 3.0
"""Share of the motion's time at which the fault comes; how long is watched after its end [s]."""

FAULTS = (
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
    """One fault in one lift.

    found_after_s         from the fault to the first sentence about it; None where there was none
    sentence              that sentence, or what the guard did
    stopped               whether the arm was stopped
    tip_error_max_mm      largest distance from tip to reference until the valves closed
    joint_speed_max       fastest joint after the fault [rad/s]
    pressure_max_mpa      highest pressure of a chamber after the fault
    relief_opened         whether a relief valve let oil through after the fault
    at_goal_mm            from tip to goal at the end
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
    """A record and its traces: columns time from the fault [s], tip error [m], then of each
    actuator the speed of its joint [rad/s] and the higher pressure of its chambers [Pa]; and when
    the valves closed [s], NaN where they did not."""

    record: FaultRecord
    trace: FloatArray
    closed: float


def lift(machine: Machine) -> Command:
    """The motion, planned by the integrated planner."""
    replanner = Replanner(machine, table_for(machine))
    start = np.array(machine.config.simulation.start_posture)
    rest = Command.hold(0, start, holding_modes(machine, machine.piston_forces(start)))
    options = PlanOptions(planner=ONLINE_PLANNER)
    replan = replanner.replan(rest, SECOND_NS // 2, GOAL, OFFLINE_LEAD, options)
    if replan is None:
        raise ScenarioError(f"the arm is at {GOAL} m from the start; faults need a motion")
    return replan.command


def run_fault(machine: Machine, motion: Command, fault: str, controller: str) -> FaultResult:
    """One fault during a motion; raises FaultError."""
    arm = SupervisedArm(Simulator(machine, controller), SupervisionLimits())
    simulator, n = arm.simulator, machine.joint_count
    faults = parse_faults(fault, machine)
    arm.add_trajectory(motion.trajectory, 0.0)
    arm.add_schedule(motion.schedule, 0.0)
    fails_ns = round(motion.stamp_ns + MOMENT * motion.trajectory.duration_ns)
    end_ns = motion.trajectory.end_ns + round(TAIL * SECOND_NS)
    rows, found, sentence, closed, relief = [], None, "", np.nan, 0.0
    while simulator.time_ns < end_ns:
        if simulator.time_ns == fails_ns // simulator.step_ns * simulator.step_ns:
            simulator.inject(faults)
            relief = simulator.energies["relief_valves"]
        arm.step(0.0)
        since = (simulator.time_ns - fails_ns) / SECOND_NS
        said = arm.fault or arm.warning
        if found is None and said:
            found, sentence = since, said
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
    away = machine.tip_in_base(simulator.joint_state.position) - GOAL
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
    """One result for each fault, in order, each done by one of `jobs`; raises FaultError."""
    for fault in faults:
        parse_faults(fault, machine)
    motion = lift(machine)
    with processes(jobs) as pool:
        tasks = [pool.submit(run_fault, machine, motion, each, controller) for each in faults]
        yield from results_of(tasks, in_order=True)


def as_text(records: Sequence[FaultRecord]) -> list[str]:
    """The records for a person."""
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
