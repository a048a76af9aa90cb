"""After the arm's kernels have been compiled ahead, nothing that happens to it compiles more."""

import subprocess
import sys

from tests.support.compiled_kernels import COUNT_COMPILED

SCRIPT = (
    """
import numpy as np
from mhsb_model.machine import load_machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import Trajectory
from mhsb_control import REGISTERED_CONTROLLERS
from mhsb_sim.simulation.faults import Fault
from mhsb_sim.simulation.kernel_parts import exercise_kernels
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervised_arm import SupervisedArm
from mhsb_sim.simulation.fault_detection import SupervisionLimits
"""
    + COUNT_COMPILED
    + """
def steps(arm, seconds):
    for _ in range(round(seconds * 1e9 / arm.simulator.step_ns)):
        arm.step(0.0)

exercise_kernels()
before = compiled()
assert before
for controller in REGISTERED_CONTROLLERS:
    machine = load_machine().changed(payload=12.0)
    arm = SupervisedArm(Simulator(machine, controller, payload=2.0), SupervisionLimits())
    steps(arm, 0.1)
    start = arm.simulator.reference.position
    offset = np.array([0, 1_000_000_000, 2_000_000_000])
    position = start + np.array([0.0, 0.05, 0.1])[:, None]
    rest = np.zeros((3, 3))
    now = arm.simulator.time_ns
    arm.add_trajectory(Trajectory(now, offset, position, rest, rest), 0.0)
    modes = np.array([[0, 0, 0], [2, 0, 0]], dtype=np.uint8)
    arm.add_schedule(ModeSchedule(now, np.array([0, 500_000_000]), modes), 0.0)
    steps(arm, 1.0)
    arm.set_payload(12.0)
    arm.stop()
    steps(arm, 1.0)
    arm.simulator.inject_faults([Fault("main_pump")])
    steps(arm, 2.0)
    arm.clear_fault(arm.simulator.time_ns)
    steps(arm, 1.0)
    arm.reset(0)
    steps(arm, 0.1)
print({name: count for name, count in compiled().items() if count != before.get(name)})
"""
)


def test_no_kernel_is_compiled_by_plans_stops_faults_and_resets():
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False
    )
    assert done.stdout.strip() == "{}", done.stderr
