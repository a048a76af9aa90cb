from collections.abc import Callable

import numpy as np

from mhsb_model.command import Command
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.study.replay import replay

LIFTED = np.array([1.0, -1.3, -1.7])
STRETCHED = np.array([0.2, -0.15, -0.1])


def test_it_is_the_simulators_run_with_each_command_at_its_stamp(
    machine: Machine, motion: Callable[..., tuple[Trajectory, ModeSchedule]]
) -> None:
    simulator = Simulator(machine)
    plan = motion(simulator.reference, LIFTED, SECOND_NS // 10)
    run = replay(simulator, [Command(*plan)], 0.5)

    other = Simulator(machine)
    other.advance(0.1)
    other.set_plan(*plan)
    other.advance(0.4)
    np.testing.assert_array_equal(run.position[-1], other.joint_state.position)
    np.testing.assert_array_equal(run.supply_pressure[-1], other.actuator_states.supply_pressure)
    np.testing.assert_array_equal(run.reference[-1, 0], other.reference.position)
    assert run.energies == other.energies
    assert run.time[-1] == 0.5
    assert run.tip_error(machine).max() < 1e-3
    learnt = next(each for each in other.estimates if each.quantity == "payload")
    np.testing.assert_allclose(run.payload[-1], (0.5, learnt.value, learnt.deviation))
    assert np.all(run.chamber_pressure >= run.pressure[:, 0:-3:3])


def test_a_plan_that_is_held_for_good_ends_the_run_and_says_why(
    machine: Machine, motion: Callable[..., tuple[Trajectory, ModeSchedule]]
) -> None:
    heavy = machine.with_values({"payload.mass": 40.0})
    simulator = Simulator(machine, plant=heavy)
    plan = motion(simulator.reference, STRETCHED)
    run = replay(simulator, [Command(*plan)], 20.0)
    assert "pace" in run.hold_reason
    assert "MPa beyond its load" in run.hold_reason
    assert run.time[-1] < 30.0  # it goes on slowly until a line cannot move its load


def test_what_was_followed_is_a_trajectory_with_its_modes(
    machine: Machine, motion: Callable[..., tuple[Trajectory, ModeSchedule]]
) -> None:
    simulator = Simulator(machine)
    plan = motion(simulator.reference, LIFTED)
    run = replay(simulator, [Command(*plan)], 1.0)
    trajectory, schedule = run.followed_motion(every=10)
    expected = plan[0].sample_many(trajectory.offset_ns + simulator.step_ns)
    np.testing.assert_allclose(trajectory.position, expected[0], atol=1e-9)
    np.testing.assert_allclose(trajectory.velocity, expected[1], atol=1e-9)
    np.testing.assert_array_equal(schedule.modes[0], plan[1].modes[0])
    np.testing.assert_array_equal(schedule.modes[-1], run.modes[-1])
