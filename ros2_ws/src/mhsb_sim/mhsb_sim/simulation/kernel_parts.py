"""Everything that the simulated arm compiles, for a process of its own to call."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mhsb_model.kernels.pool import compile_ahead
from mhsb_model.machine import load_machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.mechanics.linkage_shapes import linkage_bars
from mhsb_sim.servo import CONTROLLERS
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervised_arm import SupervisedArm
from mhsb_sim.simulation.symptoms import SupervisionLimits


def rehearse() -> None:
    """All that can happen to an arm: steps, a plan, a stop, closed valves, a reset."""
    for controller in CONTROLLERS:
        simulator = Simulator(load_machine(), controller)
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
    linkage_bars(load_machine(), start)  # for pictures and the viewer


PARTS = (f"{__name__}:{rehearse.__name__}",)


def compile_simulator(say: Callable[[str], None] | None = None) -> None:
    """See to it that the arm compiles nothing later; `say` and the rest as `compile_ahead`."""
    compile_ahead(PARTS, say)
