"""Arms that brake as hard as they may for a zone: the simulated one follows, without relief."""

from dataclasses import replace

import numpy as np
import pytest

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_planner.motion.s3_hard_braking import iterate_harder_brakings
from mhsb_planner.motion.s3_trajectory import fit_braking
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_sim.simulation.fault_detection import FollowingError, Overpressure, SupervisionLimits
from mhsb_sim.simulation.sample import ArmSample
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervised_arm import SupervisedArm

GOALS = {
    "mhsb_arm3": (0.55, 0.60),
    "excavator": (-1.5, 1.5, 0.3),
}
"""One for each machine file, far from its start posture [m]."""

SETTLED_NS = SECOND_NS
"""Time after which an arm that has braked stands still [ns]."""


@pytest.fixture(scope="module", params=GOALS)
def planned(request):
    """A machine, and its plan to the goal, from its start posture."""
    machine = load_machine(find_config_file(f"{request.param}.yaml"))
    table = build_posture_table(machine.planar_arm, spacing=3 * machine.spacing)
    start = MotionState.at_rest(np.array(machine.config.simulation.start_posture))
    options = PlanOptions(planner="table")
    return machine, Planner(machine, table).plan(GOALS[request.param], start, options=options)


@pytest.mark.parametrize("share", [0.3, 0.8])
def test_the_arm_follows_the_hardest_braking_without_warning_and_far_from_relief(planned, share):
    machine, plan = planned
    motion, schedule = plan.motion.trajectory, plan.motion.schedule
    arm = SupervisedArm(Simulator(machine), SupervisionLimits())
    arm.step(0.0)
    simulator = arm.simulator
    began_ns = simulator.time_ns
    simulator.set_plan(motion.shifted(began_ns), replace(schedule, stamp_ns=began_ns))
    following, overpressure = FollowingError(machine), Overpressure(machine)
    worst = {"following": 0.0, "pressure": 0.0}

    def advance(until_ns):
        while simulator.time_ns < until_ns:
            arm.step(simulator.time_ns / SECOND_NS)
            assert not arm.fault
            assert not arm.warning
            sample = ArmSample.from_simulator(simulator)
            worst["following"] = max(worst["following"], following.evaluate(sample).value)
            worst["pressure"] = max(worst["pressure"], overpressure.evaluate(sample).value)

    advance(began_ns + round(share * motion.duration_ns))
    at_ns = simulator.plan_time_ns - began_ns
    *_, hardest = iterate_harder_brakings(machine, motion, at_ns)
    braked = fit_braking(machine, hardest, StartModes.read_from(schedule, at_ns))
    now_ns = simulator.plan_time_ns
    simulator.set_plan(braked.trajectory.shifted(now_ns), replace(braked.schedule, stamp_ns=now_ns))
    advance(simulator.time_ns + hardest.duration_ns + SETTLED_NS)
    assert worst["following"] < 0.1 * SupervisionLimits().following_error[1]
    assert worst["pressure"] < 0.7
    assert simulator.joint_state.position == pytest.approx(hardest.position[-1], abs=2e-3)
