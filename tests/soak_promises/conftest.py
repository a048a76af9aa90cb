"""A quiet minute in which every promise is kept, written by hand, to be spoilt by the tests.

s    10           11 … 15     20      30           40 … 43    50
     goal, plan   moves       stop    zone set     fault      heal
"""

from __future__ import annotations

import signal
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.soak.events import PLANNER, SIM, ActionKind, ActionRecord, Events, ProcessLife

from mhsb_model.arm_reports import HandOverOutcome, HandOverReport, SimulatorReport
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import SECOND_NS, Trajectory, quintic_hermite
from mhsb_model.verdict import ExecutionReport, GoalVerdict, Outcome, PlanSummary, Verdict
from mhsb_tools.recording.recording import ActuatorTable, JointTable, Recording, TimedValue

BEGIN_NS = 1_700_000_000 * SECOND_NS
END = 60.0  # s
FOLDED, RAISED = np.array([0.3, -1.4, -1.5]), np.array([0.5, -1.4, -1.5])
REST = np.zeros(3)


def ns(time: float) -> int:
    """System and ROS time [ns] of a time since the begin [s]."""
    return BEGIN_NS + round(time * SECOND_NS)


def heard(time: float, value: object) -> TimedValue:
    return TimedValue(ns(time), value, ns(time))


def deed(
    kind: ActionKind, node: str, begin: float, end: float, value=None, done=True
) -> ActionRecord:
    return ActionRecord(kind, node, ns(begin), ns(end), value, done)


def motion(machine: Machine) -> Trajectory:
    """From 11 to 15 s, stamped at 10.5 s."""
    offset = np.arange(0, 451) * 10_000_000
    time = np.clip(offset[:, None] / SECOND_NS - 0.5, 0.0, 4.0)
    states = quintic_hermite(time, np.array([[4.0]]), (FOLDED, REST, REST), (RAISED, REST, REST))
    return Trajectory(ns(10.5), offset, *states)


def sampled(path: Trajectory) -> JointTable:
    """All references of the minute."""
    time_ns = ns(0.0) + np.arange(0, round(100 * END)) * 10_000_000
    return JointTable(time_ns, *path.sample_many(time_ns), recorded_ns=time_ns)


def life(node: str, number: int, begin: float, end: float, **more) -> ProcessLife:
    times = np.arange(begin, end)
    memory = tuple((ns(time), 200_000_000) for time in times)
    settings = {"signal": signal.SIGINT, "exit_code": 0, "end_s": 0.5, "traceback": None}
    return ProcessLife(node, number, ns(begin), ns(end), memory=memory, **(settings | more))


@pytest.fixture
def events(machine: Machine) -> Events:
    path = motion(machine)
    references = sampled(path)
    plan = PlanSummary(path.stamp_ns, 100.0, 90.0, 4.0, 2, 40.0, 50.0, 60.0)
    report = SimulatorReport("running", False, 0, 1.0, 0.0, 0.0)
    faulty = replace(report, sentence="the pump fails", faulty=True)
    recording = Recording(
        joint_count=3,
        joint_states=replace(references, acceleration=np.full_like(references.velocity, np.nan)),
        references=references,
        actuators=ActuatorTable(np.array([], dtype=np.int64), {}),
        mode_time_ns=np.array([], dtype=np.int64),
        modes=np.zeros((0, 3), np.uint8),
        plans_in_force=(heard(0.0, 0), heard(10.55, path.stamp_ns), heard(15.1, 0)),
        trajectories=(path,),
        schedules=(),
        goals=(heard(10.4, Goal(1, 0.5, 0.1)), heard(42.0, Goal(2, 0.5, 0.1))),
        reports=(
            heard(10.5, GoalVerdict(Verdict.OK, "it goes", Goal(1, 0.5, 0.1), plan)),
            heard(15.2, ExecutionReport(Outcome.REACHED, "there", 1, path.stamp_ns)),
            heard(42.1, GoalVerdict(Verdict.FAULT, "the pump fails", Goal(2, 0.5, 0.1))),
        ),
        hand_overs=(
            heard(10.5, HandOverReport(HandOverOutcome.APPLIED, "well", path.stamp_ns, 0.0, 0.0)),
        ),
        simulator_reports=(heard(39.0, report), heard(40.5, faulty), heard(50.5, report)),
    )
    deeds = (
        deed(ActionKind.START, PLANNER, 0.4, 0.5),
        deed(ActionKind.GOAL, PLANNER, 10.4, 10.4, 1),
        deed(ActionKind.STOP, SIM, 20.0, 20.01),
        deed(ActionKind.ZONES, PLANNER, 30.0, 30.01, Zones(tip_circles=((0.6, -0.6, 0.1),))),
        deed(ActionKind.STRANGE, SIM, 35.0, 35.1, 99),
        deed(ActionKind.FAULT, SIM, 40.0, 40.01, "main_pump"),
        deed(ActionKind.GOAL, PLANNER, 42.0, 42.0, 2),
        deed(ActionKind.HEAL, SIM, 50.0, 50.01, "main_pump"),
    )
    lives = (life(SIM, 1, 0.0, END + 0.5), life(PLANNER, 1, 0.5, END + 0.5))
    return Events(machine, recording, deeds, lives, ns(0.0), ns(END))


@pytest.fixture
def make() -> SimpleNamespace:
    """Makers of what events consist of, by times since the begin [s]."""
    return SimpleNamespace(ns=ns, heard=heard, deed=deed, life=life)


@pytest.fixture
def spoilt(events: Events):
    """Function (recording=…, **changes of events) that makes other events."""

    def change(recording: dict | None = None, **changes) -> Events:
        changed = replace(events.recording, **(recording or {}))
        return replace(events, recording=changed, **changes)

    return change
