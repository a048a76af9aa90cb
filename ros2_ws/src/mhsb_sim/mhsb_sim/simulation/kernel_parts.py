"""All kernels that the simulated arm compiles, so that a separate process can compile them."""

from collections.abc import Callable

import numpy as np

from mhsb_control import REGISTERED_CONTROLLERS, load_machine
from mhsb_model.kernels.pool import compile_ahead
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.mechanics.linkage_shapes import compute_planar_bars
from mhsb_sim.simulation.fault_detection import SupervisionLimits
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervised_arm import SupervisedArm


def exercise_kernels() -> None:
    """Call all kernels of a simulated arm once, so that they are compiled and loaded.

    For each servo controller, a simulated arm takes a plan, runs steps, stops, closes its valves
    and is reset. The bars for pictures are computed, too.
    """
    machine = load_machine()
    for controller in REGISTERED_CONTROLLERS:
        simulator = Simulator(machine, controller)
        arm = SupervisedArm(simulator, SupervisionLimits())
        start = simulator.reference.position
        rest = np.zeros((2, len(start)))
        way = Trajectory(0, np.array([0, SECOND_NS]), np.array([start, start + 0.01]), rest, rest)
        arm.add_trajectory(way, 0.0)
        arm.add_schedule(ModeSchedule(0, np.array([0]), simulator.modes[None, :]), 0.0)
        arm.step(0.0)
        arm.stop()
        simulator.close_valves()
        arm.step(0.0)
        arm.reset(0)
    compute_planar_bars(machine, start)  # for pictures and the viewer


KERNEL_PARTS = (f"{__name__}:{exercise_kernels.__name__}",)
"""Functions, as "module:name", that compile all kernels of the simulated arm when they run."""


def compile_simulator(say: Callable[[str], None] | None = None) -> None:
    """Compile all kernels of the simulated arm ahead of its use, and keep them in the cache.

    Args:
        say: Function that receives one line of progress at a time; None shows a progress bar.
    """
    compile_ahead(KERNEL_PARTS, say)
