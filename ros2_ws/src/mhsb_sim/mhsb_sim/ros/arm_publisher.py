"""Publisher of the simulator node: states, changes and reports of its arm."""

import time
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from mhsb_model.arm_reports import HandOverReport, SimulatorReport
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, ModeArray
from mhsb_model.verdict import Level
from mhsb_msgs_py import (
    actuator_states,
    endpoints,
    estimates,
    joint_state,
    modes_in_force,
    reference,
    sim_status,
    stamps,
    topics,
)
from mhsb_msgs_py.actuator_states import ActuatorSample
from mhsb_msgs_py.faults import Faults
from mhsb_msgs_py.joint_state import JointSample
from mhsb_msgs_py.reference import Reference
from mhsb_sim.mechanics.robot_description import build_robot_description
from mhsb_sim.simulation.sensors import ActuatorStates
from mhsb_sim.simulation.supervised_arm import SupervisedArm

STATE_PERIOD_NS = SECOND_NS // 100
"""Period of states in simulated time [ns]."""
MODES_PERIOD_NS = SECOND_NS // 10
"""Longest period of modes and estimates in simulated time [ns]."""
REPORT_PERIOD, DELAY_PERIOD = 1.0, 0.1
"""Periods of the simulator's report [s]: normally, and while the delay of plans changes.

Simulated or real time counts, whichever passes first."""


class ArmPublisher:
    """Publisher of an arm's states at fixed rates of simulated time, and of changes at once."""

    def __init__(self, node: Node, arm: SupervisedArm, with_clock: bool, faults: Faults) -> None:
        """Create all publishers of the node, and publish the robot description.

        Args:
            node: The simulator node.
            arm: Its arm.
            with_clock: Whether to publish /clock.
            faults: Record of the node's failed callbacks, for the report.
        """
        self._arm = arm
        self._simulator = arm.simulator
        self._with_clock = with_clock
        self._faults = faults
        self._namespace = node.get_namespace()
        self._publishers = {
            topic.name: endpoints.make_publisher(node, topic)
            for topic in (
                topics.JOINT_STATES,
                topics.REFERENCE,
                topics.PLAN_IN_FORCE,
                topics.MODES,
                topics.ACTUATOR_STATES,
                topics.ESTIMATES,
                topics.DIAGNOSTICS,
                topics.ROBOT_DESCRIPTION,
                *([topics.CLOCK] if with_clock else []),
            )
        }
        described = String(data=build_robot_description(self._simulator.machine))
        self._publishers[topics.ROBOT_DESCRIPTION.name].publish(described)
        self._reported_to = 0
        self.restart()

    @property
    def exclusive_publishers(self) -> list[Publisher]:
        """Publishers on topics on which no other node should publish."""
        return [self._publishers[topic.name] for topic in (topics.REFERENCE, topics.JOINT_STATES)]

    def restart(self) -> None:
        """Start all publishing periods at the present time, and forget what was published.

        The node calls this method after simulated time has been set. The plan in force and the
        modes are then published again, even if they have not changed.
        """
        now_ns = self._simulator.time_ns
        self._next_state_ns = self._next_modes_ns = now_ns + STATE_PERIOD_NS
        self._in_force_ns: int | None = None
        self._modes: ModeArray | None = None
        self._last_report = (time.monotonic(), now_ns)
        self._delay_ns = 0

    def publish_due(self) -> bool:
        """Publish what is due after a step of the simulation.

        Every STATE_PERIOD_NS of simulated time, these are published: joint states, reference,
        actuator states, and /clock if the node is its source. Modes and the plan in force are then
        published if they have changed. Every MODES_PERIOD_NS, the modes are published in any case,
        and estimates if the servo has any.

        Returns:
            True if joint states, reference and actuator states were published.
        """
        now_ns = self._simulator.time_ns
        if now_ns < self._next_state_ns:
            return False
        self._next_state_ns += STATE_PERIOD_NS
        self._publish_states(now_ns)
        if now_ns >= self._next_modes_ns:
            self._next_modes_ns += MODES_PERIOD_NS
            self._modes = None  # modes are published at this rate even if they do not change
            if learnt := self._simulator.estimates:
                self._publish(topics.ESTIMATES, estimates.encode(learnt, now_ns))
        self.publish_changes()
        return True

    def publish_changes(self) -> None:
        """Publish the plan in force and the modes in force, each if it has changed.

        The node calls this method after each of its callbacks. After `restart` both are published.
        `publish_due` has the modes published every MODES_PERIOD_NS even if they have not changed.
        """
        in_force_ns = self._arm.plan_stamp_ns
        if in_force_ns != self._in_force_ns:
            self._in_force_ns = in_force_ns
            self._publish(topics.PLAN_IN_FORCE, stamps.to_time(in_force_ns))
        modes = self._simulator.modes
        if self._modes is None or not np.array_equal(modes, self._modes):
            self._modes = modes
            self._publish(topics.MODES, modes_in_force.encode(modes))

    def publish_hand_over(self, report: HandOverReport) -> None:
        """Publish the hand-over report of a plan.

        Args:
            report: The report.
        """
        now_ns = self._simulator.time_ns
        self._publish(topics.DIAGNOSTICS, sim_status.encode(report, now_ns, self._namespace))

    def report_due(self) -> bool:
        """Return whether the simulator's report is due.

        The period of the report is normally REPORT_PERIOD. It is DELAY_PERIOD if the plan delay has
        changed since the previous report. The plan delay is the time that the reference lags behind
        the plan because of speed scaling. A new subscriber gets a report at once: a planner does
        not plan before it knows the arm's machine.

        Returns:
            True if the period is over in simulated time or in real time, or if there are more
            subscribers than at the previous report.
        """
        if self._count_report_subscribers() > self._reported_to:
            return True
        wall, sim_ns = self._last_report
        passed_ns = self._simulator.time_ns - sim_ns
        same = self._simulator.plan_delay_ns == self._delay_ns
        period = REPORT_PERIOD if same else DELAY_PERIOD
        return max(time.monotonic() - wall, passed_ns / SECOND_NS) >= period

    def publish_report(self, sentence: str, level: Level) -> None:
        """Publish the simulator's report on /diagnostics, and start its publishing period again.

        Besides sentence and level, the report has these values:

        - simulated time, and its speed relative to real time since the previous report;
        - energies of the pumps [J];
        - time of the last stop, and plan delay [s];
        - number of interventions of the mode guard, which changes the plan's modes;
        - lost servo pumps, machine, and failed callbacks.

        Args:
            sentence: Health of the simulator as text.
            level: Level of the health: OK, WARN or ERROR.
        """
        now_ns = self._simulator.time_ns
        wall, sim_ns = self._last_report
        self._last_report = (time.monotonic(), now_ns)
        self._reported_to = self._count_report_subscribers()
        elapsed = max(1e-9, self._last_report[0] - wall)
        energies = self._simulator.energies
        self._delay_ns = self._simulator.plan_delay_ns
        report = SimulatorReport(
            sentence,
            level is Level.ERROR,
            now_ns,
            (now_ns - sim_ns) / SECOND_NS / elapsed,
            energies["main_pump"],
            energies["servo_pumps"],
            level is Level.WARN,
            self._arm.last_stop_ns,
            self._delay_ns / SECOND_NS,
            self._simulator.guard.interventions.count,
            tuple(k + 1 for k in self._simulator.lost_modules),
            self._simulator.machine.name,
            self._simulator.machine.planning_hash,
            self._faults.count,
            self._faults.last,
        )
        self._publish(topics.DIAGNOSTICS, sim_status.encode(report, now_ns, self._namespace))

    def _count_report_subscribers(self) -> int:
        """Count the subscribers of /diagnostics to which this node is connected."""
        return int(self._publishers[topics.DIAGNOSTICS.name].get_subscription_count())

    def _publish_states(self, now_ns: int) -> None:
        """Publish joint states, reference and, if someone subscribes to them, actuator states.

        The effort of a joint is its cylinder's force times its moment arm. /clock is also published
        if the node is its source.

        Args:
            now_ns: Simulated time, as the stamp [ns].
        """
        simulator, machine = self._simulator, self._simulator.machine
        if self._with_clock:
            self._publish(topics.CLOCK, Clock(clock=stamps.to_time(now_ns)))
        measured, hydraulics = simulator.joint_state, simulator.actuator_states
        torque = hydraulics.force * machine.moment_arms(measured.position)
        self._publish(
            topics.JOINT_STATES,
            joint_state.encode(
                JointSample(now_ns, measured.position, measured.velocity, torque),
                machine.joint_names,
            ),
        )
        self._publish(
            topics.REFERENCE,
            reference.encode(Reference(now_ns, simulator.reference), machine.joint_names),
        )
        if self._publishers[topics.ACTUATOR_STATES.name].get_subscription_count():
            self._publish_actuator_states(now_ns, hydraulics)

    def _publish_actuator_states(self, now_ns: int, hydraulics: ActuatorStates) -> None:
        """Publish the states of all actuators; this takes as long as all other states together.

        Args:
            now_ns: Simulated time, as the stamp [ns].
            hydraulics: Pressures, flows, forces and openings.
        """
        machine, n = self._simulator.machine, self._simulator.machine.joint_count
        sample = ActuatorSample(
            now_ns,
            cap_pressure=hydraulics.cap_pressure,
            rod_pressure=hydraulics.rod_pressure,
            supply_pressure=hydraulics.supply_pressure,
            force=hydraulics.force,
            piston_speed=hydraulics.piston_speed,
            supply_flow=hydraulics.supply_flow,
            valve_opening=hydraulics.valve_opening,
            servo_pump_flow=_select_actuator_values(hydraulics.servo_pump_flow, n),
            servo_pump_speed=_select_actuator_values(hydraulics.servo_pump_speed, n),
        )
        self._publish(
            topics.ACTUATOR_STATES, actuator_states.encode(sample, machine.actuator_names)
        )

    def _publish(self, topic: topics.Topic, message: Any) -> None:
        """Publish a message on a topic of this node."""
        self._publishers[topic.name].publish(message)


def _select_actuator_values(of_modules: FloatArray, count: int) -> FloatArray:
    """Return the value of each actuator's own booster module.

    Module i belongs to actuator i. Values of modules beyond the last actuator are ignored.

    Args:
        of_modules: One value per module, float64[m].
        count: Number n of actuators.

    Returns:
        One value per actuator, float64[n]; 0 for an actuator without a module.
    """
    own = np.zeros(count)
    own[: len(of_modules)] = of_modules[:count]
    return own
