"""Ten thousand replans in motion in lock-step, five hundred over DDS: no jump, no limit broken.

Limits are worked out here once more, in plain NumPy, every half millisecond of what was executed.
"""

from __future__ import annotations

import random
import time
from itertools import pairwise

import numpy as np
import pytest
from benchmarks.message_watcher import MessageWatcher
from benchmarks.seeded_goals import draw_reachable_goals
from tests.soak import goal_promises, motion_promises
from tests.soak.events import PLANNER, SIM, ActionKind, ActionRecord, Events, ProcessLife

from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.machine import load_machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import ExecutionReport, Outcome
from mhsb_msgs_py.node_process import run_ros, serve_node, spin_until
from mhsb_planner.motion.s3_trajectory import FitRules
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import Planner, PlanOptions, warm_up
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.live.nodes import run_both_nodes, wait_for_planner_answer
from mhsb_tools.report.goal_fates import GoalResult, judge_recorded_goals
from mhsb_tools.study.headless import HeadlessRun, TimedGoal

RUNS, REPLANS_OF_A_RUN, ONLINE = 20, 500, 500
LOOK_NS = SECOND_NS // 2000
BUDGET = 0.04  # s, for each plan in lock-step
JUMP = 1e-6  # rad, rad/s
TOLERANCE = {"joint": 1e-6, "v_max": FitRules.create_following().max_excess + 1e-6, "modules": 0.0}
"""Excess that is rounding; 1e-6 for what is not named."""


class Limits:
    """Excess over each limit, at most 0 where it holds.

    Piston speeds come from tables of the moment arms, since each depends on its own joint alone.
    """

    def __init__(self, machine):
        self.machine = machine
        m = machine.arrays
        self.angles = np.linspace(m.joint_min, m.joint_max, 20_001)
        self.arms = np.array([machine.moment_arms(q) for q in self.angles])

    def excess(self, command, begin_ns, end_ns):
        """Largest excess of a command between two times: rad, shares, modules."""
        m, at = self.machine.arrays, np.arange(begin_ns, end_ns, LOOK_NS)
        q, qd, _ = command.trajectory.sample_many(at)
        modules = m.modules_per_mode[command.schedule.modes_at_many(at)]
        arms = [np.interp(q[:, j], self.angles[:, j], self.arms[:, j]) for j in range(q.shape[1])]
        speed = np.column_stack(arms) * qd
        flow = np.where(speed > 0.0, m.cap_area, m.rod_area) * np.abs(speed)
        pump = m.main_pump_flow - self.machine.joint_count * m.leakage_flow
        boosted = flow / np.where(modules > 0, modules * m.servo_pump_flow, np.inf)
        return {
            "joint": np.maximum(m.joint_min - q, q - m.joint_max).max(),
            "v_max": (np.abs(speed) / m.max_piston_speed).max() - 1.0,
            "main_pump": flow.sum(axis=1).max() / pump - 1.0,
            "servo_pump": boosted.max() - 1.0,
            "modules": modules.sum(axis=1).max() - m.module_count,
        }

    def broken(self, command, begin_ns, end_ns):
        """Those that do not hold."""
        found = self.excess(command, begin_ns, end_ns) if end_ns > begin_ns else {}
        return {name: value for name, value in found.items() if value > TOLERANCE.get(name, 1e-6)}


def jump_between(old, new, at_ns):
    """Largest difference in position and velocity of two commands at some times."""
    before, after = (each.trajectory.sample_many(at_ns) for each in (old, new))
    return max(np.abs(b - a).max() for b, a in zip(before[:2], after[:2], strict=True))


@pytest.fixture(scope="module")
def machine():
    return load_machine()


@pytest.fixture(scope="module")
def goals(machine):
    planner = Planner(machine, load_or_build_table(machine))
    warm_up(planner)
    return draw_reachable_goals(planner, 300, seed=10)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("seed", range(RUNS))
def test_replans_in_motion_in_lock_step_neither_jump_nor_break_a_limit(machine, goals, seed):
    source, limits = random.Random(seed), Limits(machine)
    replanner = Replanner(machine, load_or_build_table(machine))
    replanner.warm_up()
    options = PlanOptions(planner="integrated")
    run = HeadlessRun(Simulator(machine), replanner, options, BUDGET)
    moving = executed_from_ns = 0
    before = None
    while moving < REPLANS_OF_A_RUN:
        goal = source.choice(goals)
        timed = TimedGoal(goal.position, source.uniform(0.02, 0.6))
        try:
            [result] = list(run.run([timed]))
        except MhsbError:  # found no way in its budget: the motion goes on
            continue
        if result.replan is None:
            continue
        command, change_ns = result.replan.command, result.replan.change_ns
        assert result.reference_jump <= JUMP
        if before is not None:
            moving += bool(before.trajectory.sample(change_ns).velocity.any())
            shared_ns = np.arange(command.stamp_ns, change_ns, LOOK_NS)
            assert jump_between(before, command, np.append(shared_ns, change_ns)) <= JUMP
            assert limits.broken(before, executed_from_ns, command.stamp_ns) == {}
        before, executed_from_ns = command, command.stamp_ns
    assert limits.broken(before, executed_from_ns, before.trajectory.end_ns) == {}
    assert run.samples().tip_error.max() < 0.02


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_replans_in_motion_over_dds_neither_jump_nor_break_a_limit(machine, goals, ros_domain):
    source, deeds = random.Random(0), []
    with run_ros([]), serve_node(MessageWatcher) as (executor, watcher), run_both_nodes():
        wait_for_planner_answer(watcher, executor)
        watcher.forget()
        begin_ns = time.time_ns()
        for _ in range(ONLINE):
            goal, sent_ns = source.choice(goals), time.time_ns()
            stamp_ns = watcher.send(*goal.position)
            deeds.append(ActionRecord(ActionKind.GOAL, PLANNER, sent_ns, sent_ns, stamp_ns))
            spin_until(executor, lambda: False, source.uniform(0.3, 1.2))
        spin_until(executor, lambda: stamp_ns in watcher.executions, 60.0)
        spin_until(executor, lambda: False, 6.0)
        recording, end_ns = watcher.decode_messages(), time.time_ns()
    lives = tuple(
        ProcessLife(node, 1, begin_ns, end_ns, None, None, 0.0, None, ()) for node in (SIM, PLANNER)
    )
    events = Events(machine, recording, tuple(deeds), lives, begin_ns, end_ns)
    for promise in (
        goal_promises.check_one_verdict,
        goal_promises.check_one_execution_report,
        goal_promises.check_one_hand_over_report,
        goal_promises.check_stamps_increase,
        motion_promises.check_hand_over_jumps,
        motion_promises.check_continuous_reference,
        motion_promises.check_reference_is_plan,
        motion_promises.check_joint_limits,
        motion_promises.check_speed_limits,
    ):
        kept = promise(events)
        assert kept.tested > 0, promise
        assert kept.is_kept, kept.violations
    assert_executed_within_limits(machine, recording)
    fates = judge_recorded_goals(recording, all_feasible=True)
    failed = (GoalResult.LOST, GoalResult.STOPPED)
    assert [each.explanation for each in fates if each.result in failed] == []
    assert sum(each.result is GoalResult.APPLIED for each in fates) > ONLINE / 2
    endings = [e.value for e in recording.reports if isinstance(e.value, ExecutionReport)]
    assert endings[-1].outcome is Outcome.REACHED


def assert_executed_within_limits(machine, recording):
    """Every plan from where it took over to where the next one did."""
    limits = Limits(machine)
    schedules = {each.stamp_ns: each for each in recording.schedules}
    executed = [each for each in recording.plans_in_force if each.value in schedules]
    curves = {each.stamp_ns: each for each in recording.trajectories}
    for now, after in pairwise(executed):
        command = Command(curves[now.value], schedules[now.value])
        assert limits.broken(command, command.stamp_ns, after.time_ns) == {}
