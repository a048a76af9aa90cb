from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mhsb_control import load_machine, select_controllers
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import FloatArray
from mhsb_sim.simulation.fault_detection import SupervisionLimits
from mhsb_sim.simulation.faults import Fault
from mhsb_sim.simulation.sample import WATCH_PERIOD_NS
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervision import Phase, Supervision

SUITABLE_CONTROLLERS = sorted(select_controllers(load_machine()))
Motion = Callable[..., tuple[Trajectory, ModeSchedule]]

LOWERED = np.array([-0.1, -1.9, -0.7])  # the main pump holds it
LIFTED = np.array([0.55, -1.1, 0.2])  # boost in J1
STRETCHED = np.array([0.4, -0.8, -0.1])  # more of it


class Run:
    """A simulator under supervision; `speed` is the highest of each joint since last asked."""

    def __init__(self, machine: Machine, controller: str = "coordinated", **start: object) -> None:
        self.simulator = Simulator(machine, controller, **start)
        self.supervision = Supervision(self.simulator, SupervisionLimits())
        self.speed = np.zeros(machine.joint_count)
        self.warned: list[str] = []

    def go(self, motion: Motion, goal: FloatArray) -> float:
        """Set out for a posture; how long it takes [s]."""
        plan = motion(self.simulator.reference, goal, self.simulator.time_ns)
        self.simulator.set_plan(*plan)
        return plan[0].duration_ns / SECOND_NS

    def advance(self, duration: float, until: Phase | None = None) -> None:
        """Run for a time [s], or until supervision is in a phase."""
        end_ns = self.simulator.time_ns + round(duration * SECOND_NS)
        while self.simulator.time_ns < end_ns and self.supervision.phase is not until:
            self.simulator.step()
            if self.simulator.time_ns % WATCH_PERIOD_NS == 0:
                self.supervision.watch()
                if self.supervision.warning:
                    self.warned.append(self.supervision.warning)
            np.maximum(self.speed, np.abs(self.simulator.joint_state.velocity), out=self.speed)
        assert until in (None, self.supervision.phase), self.supervision.phase

    def following_error(self) -> float:
        reference, measured = self.simulator.reference, self.simulator.joint_state
        return float(np.abs(reference.position - measured.position).max())


def heal_and_release(run: Run) -> None:
    """What the arm does after all is well again, without a new goal: nothing."""
    run.simulator.inject_faults([])
    run.speed[:] = 0.0
    run.advance(1.0)
    run.supervision.release()
    run.advance(10.0, Phase.WATCHING)
    run.advance(2.0)
    assert run.supervision.phase is Phase.WATCHING
    assert run.following_error() < 2e-3
    assert run.speed.max() < 0.05
    assert run.simulator.valves_closed


def go_on(run: Run, motion: Motion, goal: FloatArray) -> None:
    """The next plan is followed as if nothing had been."""
    duration = run.go(motion, goal)
    run.advance(duration + 1.0)
    assert not run.simulator.valves_closed
    assert run.supervision.phase is Phase.WATCHING
    assert run.following_error() < 2e-3


@pytest.mark.parametrize("controller", SUITABLE_CONTROLLERS)
def test_a_healthy_arm_is_far_from_every_limit(
    machine: Machine, motion: Motion, controller: str
) -> None:
    """Replans in motion, boosted."""
    run = Run(machine, controller, posture=LOWERED)
    following = {"coordinated": 0.002, "independent": 0.03}[controller]  # rad
    run.supervision.limits = SupervisionLimits((following, 1.0), (0.6, 1.0), (0.3, 1.0), (0.2, 1.0))
    for goal in (LIFTED, STRETCHED, LOWERED, LIFTED, STRETCHED):
        run.go(motion, goal)
        run.advance(2.0)
    run.advance(8.0)
    assert run.warned == []
    assert run.supervision.phase is Phase.WATCHING


@pytest.mark.parametrize("controller", SUITABLE_CONTROLLERS)
@pytest.mark.parametrize("fault", ["main_pump", "servo_pumps"])
def test_pumps_that_fail_in_motion_stop_the_arm_and_healing_them_moves_nothing(
    machine: Machine, motion: Motion, controller: str, fault: str
) -> None:
    run = Run(machine, controller, posture=LOWERED)
    duration = run.go(motion, LIFTED)
    run.advance(0.4 * duration)
    run.simulator.inject_faults([Fault(fault)])
    run.advance(6.0, Phase.STOPPING)  # with dead servo pumps the guard holds the plan before
    assert run.supervision.fault
    assert run.warned or fault == "main_pump"  # which empties the manifold within two looks
    run.advance(6.0, Phase.HELD)
    reference = run.simulator.reference
    np.testing.assert_array_equal(reference.velocity, 0.0)
    assert run.following_error() < 1e-6
    run.advance(2.0)
    np.testing.assert_array_equal(run.simulator.reference.position, reference.position)
    heal_and_release(run)
    go_on(run, motion, LIFTED)


def test_a_main_pump_that_fails_at_rest_is_noticed(machine: Machine, motion: Motion) -> None:
    run = Run(machine)
    run.advance(0.5)
    run.simulator.inject_faults([Fault("main_pump")])
    run.advance(1.0, Phase.STOPPING)
    assert "of the main pump's pressure, at most 0.8 is allowed" in run.supervision.fault
    run.advance(2.0, Phase.HELD)
    heal_and_release(run)
    go_on(run, motion, LIFTED)


def test_the_reference_of_a_stopped_arm_decelerates_along_its_path_and_steps_only_at_rest(
    machine: Machine, motion: Motion
) -> None:
    run = Run(machine, posture=LOWERED)
    trajectory, schedule = motion(run.simulator.reference, LIFTED, 0)
    run.simulator.set_plan(trajectory, schedule)
    run.advance(2.0)
    run.simulator.inject_faults([Fault("main_pump")])
    before, largest = run.simulator.reference, 0.0
    while run.supervision.phase is not Phase.CLOSED:
        run.advance(WATCH_PERIOD_NS / SECOND_NS)
        now = run.simulator.reference
        mean = (before.velocity + now.velocity) / 2 * WATCH_PERIOD_NS / SECOND_NS
        largest = max(largest, float(np.abs(now.position - before.position - mean).max()))
        before = now
    assert largest < 1e-4
    nearest = np.abs(trajectory.position - before.position).max(axis=1).min()
    assert nearest < np.abs(np.diff(trajectory.position, axis=0)).max()
    assert not before.velocity.any()
    run.advance(3.0, Phase.HELD)
    np.testing.assert_array_equal(
        run.simulator.reference.position, run.simulator.joint_state.position
    )


def test_a_load_beyond_all_means_closes_the_valves_and_taken_off_gently_moves_nothing(
    machine: Machine, motion: Motion
) -> None:
    run = Run(machine)
    run.advance(0.5)
    run.simulator.set_payload(2000.0)
    run.advance(0.3, Phase.CLOSED)
    assert "joint_1 is 0.07" in run.supervision.fault
    assert not run.simulator.actuator_states.valve_command.any()
    assert not run.simulator.actuator_states.servo_pump_command.any()
    run.advance(60.0, Phase.HELD)
    run.speed[:] = 0.0
    for mass in np.geomspace(2000.0, machine.arrays.payload, 1000):
        run.simulator.set_payload(float(mass))
        run.advance(0.01)
    heal_and_release(run)
    limits = machine.arrays
    position = run.simulator.reference.position
    assert np.all((position >= limits.joint_min) & (position <= limits.joint_max))
    go_on(run, motion, np.array([-0.5, -0.9, -0.5]))


def test_an_arm_that_does_not_come_to_rest_has_its_valves_closed(machine: Machine) -> None:
    run = Run(machine)
    run.advance(0.5)
    run.supervision.limits = SupervisionLimits(saturation=(0.0, -1.0))
    run.advance(0.1, Phase.STOPPING)
    for _ in range(40):  # somebody swings on it
        run.simulator.set_payload(20.0)
        run.advance(0.05)
        run.simulator.set_payload(10.0)
        run.advance(0.05)
    assert run.supervision.phase is Phase.CLOSED


def test_warnings_come_first_and_go_with_what_they_warn_of(machine: Machine) -> None:
    run = Run(machine)
    run.advance(0.5)
    run.supervision.limits = SupervisionLimits(following_error=(0.02, 0.5))
    run.simulator.set_payload(60.0)
    run.advance(0.2)
    assert "off its reference, beyond 0.5 rad the arm is stopped" in run.warned[-1]
    assert run.supervision.phase is Phase.WATCHING
    run.simulator.set_payload(10.0)
    run.advance(5.0)
    assert run.supervision.warning == ""


def test_each_limit_stops_the_arm_with_its_own_sentence(machine: Machine) -> None:
    trip = (-2.0, -1.0)
    for limits, text in (
        (SupervisionLimits(following_error=trip), "rad off its reference, at most -1 rad is"),
        (SupervisionLimits(overpressure=trip), "of its relief valve's setting, at most -1 is"),
        (SupervisionLimits(supply_loss=trip), "of the main pump's pressure, at most -1 is"),
        (SupervisionLimits(saturation=trip), "for 0.00 s, at most -1 s is allowed"),
    ):
        run = Run(machine)
        run.supervision.limits = limits
        run.advance(0.1, Phase.STOPPING)
        assert text in run.supervision.fault
