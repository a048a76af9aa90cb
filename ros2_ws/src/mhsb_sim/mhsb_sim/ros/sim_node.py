"""The simulator node: plans in, motion, pressures and what is in force out.

A thin adapter around `Simulator` and `PlanReceiver`: a timer brings the simulation up to date,
received plans are handed over between two steps, and states are published at fixed rates of
simulated time.
"""

from __future__ import annotations

import gc
import sys
import time
from typing import Any

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from mhsb_model import command_line
from mhsb_model.arm_reports import HandOverOutcome
from mhsb_model.trajectory import SECOND_NS
from mhsb_msgs_py import (
    actuator_states,
    joint_state,
    mode_schedule,
    modes_in_force,
    names,
    reference,
    sim_status,
    stamps,
    topics,
    trajectory,
)
from mhsb_msgs_py.actuator_states import ActuatorSample
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.joint_state import JointSample
from mhsb_msgs_py.node_process import spin_node
from mhsb_msgs_py.reference import Reference
from mhsb_msgs_py.sim_status import HandOverReport, SimulatorReport
from mhsb_sim.errors import SimulationDivergedError
from mhsb_sim.ros import sim_parameters
from mhsb_sim.ros.pacing import LARGEST_LAG_NS, Pacer
from mhsb_sim.simulation.faults import Fault
from mhsb_sim.simulation.plan_receiver import Outcome, OutcomeKind, PlanReceiver
from mhsb_sim.simulation.simulator import Simulator

TICK = 0.002
"""Wall-clock time between two looks at what is due [s]; simulated time per tick is factor times
this."""

STATE_PERIOD_NS = SECOND_NS // 100
MODES_PERIOD_NS = SECOND_NS // 10
REPORT_PERIOD_NS = SECOND_NS

NO_PLAN = 0
"""What `plan_in_force` says while no plan is."""


class SimNode(Node):
    """Simulates the arm with its hydraulics and servo, and executes plans."""

    def __init__(self) -> None:
        super().__init__(names.SIM_NODE)
        self._machine = sim_parameters.declare_machine(self)
        self._settings = sim_parameters.declare(self, self._machine)
        self._steady = rclpy.clock.Clock(clock_type=rclpy.clock.ClockType.STEADY_TIME)
        self._simulator = Simulator(
            self._machine,
            self._settings.controller,
            self._settings.seed,
            payload=self._settings.payload,
        )
        self._simulator.step()  # compiles everything before anybody waits for it
        self._receiver = PlanReceiver(self._machine)
        self._pacer = Pacer(self._settings.real_time_factor, 0, 0)
        self._fault: str | None = None
        self._in_force_ns: int | None = None
        self._modes: np.ndarray | None = None
        self._next_ns = dict.fromkeys(("state", "modes", "report"), 0)
        self._last_report = (0.0, 0)
        self._make_interfaces()
        self.add_on_set_parameters_callback(
            lambda changes: sim_parameters.check(self, self._machine, changes)
        )
        self.add_post_set_parameters_callback(self._apply_parameters)
        gc.collect()
        gc.freeze()  # what has been loaded stays: later collections need not look at it
        self._start_anew()
        self.get_logger().info(f"ready: {self._machine.name} holds its position")

    def _make_interfaces(self) -> None:
        published = [
            topics.JOINT_STATES,
            topics.REFERENCE,
            topics.PLAN_IN_FORCE,
            topics.MODES,
            topics.ACTUATOR_STATES,
            topics.DIAGNOSTICS,
        ]
        if self._settings.publish_clock:
            published.append(topics.CLOCK)
        self._publishers_by_topic = {
            topic.name: self.create_publisher(topic.message, topic.name, topic.qos)
            for topic in published
        }
        for topic, callback in (
            (topics.JOINT_TRAJECTORY, self._on_trajectory),
            (topics.MODE_COMMANDS, self._on_schedule),
        ):
            self.create_subscription(topic.message, topic.name, callback, topic.qos)
        self.create_service(Trigger, names.STOP_SERVICE, self._on_stop)
        self.create_service(Trigger, names.RESET_SERVICE, self._on_reset)
        self.create_service(Trigger, names.CLEAR_FAULTS_SERVICE, self._on_clear_faults)
        self.create_timer(TICK, self._tick, clock=self._steady)

    # --- Time ------------------------------------------------------------------------------------

    def _clock_ns(self) -> int:
        """The clock that paces: the system's, or a steady one where the simulator is /clock."""
        if self._settings.publish_clock:
            return time.monotonic_ns()
        return time.time_ns()

    def _tick(self) -> None:
        """Bring the simulation up to the present, publishing on the way."""
        due_ns = self._pacer.due_ns(self._clock_ns())
        lag_ns = due_ns - self._simulator.time_ns
        if self._fault is None and abs(lag_ns) > LARGEST_LAG_NS:
            self._skip(lag_ns)
            return
        if self._fault is not None:
            self._publish_report_when_due(due_ns)
            return
        self._receive(self._receiver.update(self._simulator, time.monotonic()))
        try:
            while self._simulator.time_ns < due_ns:
                self._simulator.step()
                self._publish_due()
        except SimulationDivergedError as error:
            self._stop_at_fault(str(error))

    def _stop_at_fault(self, sentence: str) -> None:
        """Nothing moves any more, no plan is in force or taken, until the fault is cleared."""
        self._fault = sentence
        self.get_logger().error(sentence)
        self._receiver.clear()
        self._in_force_ns = NO_PLAN
        self._publish(topics.PLAN_IN_FORCE, stamps.to_time(NO_PLAN))
        self._publish_report(self._simulator.time_ns)

    def _skip(self, lag_ns: int) -> None:
        """The clock has jumped or everything was frozen for long: start anew from its time."""
        self.get_logger().warning(
            f"the clock is {lag_ns / SECOND_NS:.1f} s away from simulated time: plans are dropped "
            "and the simulation starts anew"
        )
        self._start_anew()

    def _start_anew(self) -> None:
        """Rest in the start posture from now on; forget plans and faults."""
        clock_ns = self._clock_ns()
        time_ns = 0 if self._settings.publish_clock else clock_ns
        self._simulator.reset(time_ns)
        self._simulator.inject(self._settings.fault)
        self._receiver.clear()
        self._fault = None
        self._in_force_ns = self._modes = None
        self._pacer.restart(clock_ns, time_ns)
        self._next_ns = dict.fromkeys(self._next_ns, time_ns)
        self._last_report = (time.monotonic(), time_ns)

    # --- Plans -----------------------------------------------------------------------------------

    def _on_trajectory(self, message: JointTrajectory) -> None:
        try:
            received = trajectory.decode(message, self._machine.joint_names)
        except MessageError as error:
            self._refuse_message(message, f"joint_trajectory was refused: {error}")
            return
        if self._fault is not None:
            self._refuse_message(message, f"joint_trajectory was refused: {self._fault}")
            return
        self._receive(self._receiver.add_trajectory(received, time.monotonic()))
        self._tick()

    def _on_schedule(self, message: JointTrajectory) -> None:
        try:
            received = mode_schedule.decode(message, self._machine.actuator_names)
        except MessageError as error:
            self._refuse_message(message, f"mode_commands were refused: {error}")
            return
        if self._fault is not None:
            self._refuse_message(message, f"mode_commands were refused: {self._fault}")
            return
        self._receive(self._receiver.add_schedule(received, time.monotonic()))
        self._tick()

    def _refuse_message(self, message: JointTrajectory, sentence: str) -> None:
        try:
            stamp_ns = stamps.from_time(message.header.stamp)
        except MessageError:
            stamp_ns = 0
        self._receive([Outcome(OutcomeKind.REFUSED, stamp_ns, sentence)])

    def _receive(self, outcomes: list[Outcome]) -> None:
        """Tell what became of plans."""
        for outcome in outcomes:
            if outcome.kind is not OutcomeKind.APPLIED:
                self.get_logger().warning(outcome.sentence)
            report = HandOverReport(
                HandOverOutcome(outcome.kind.value),
                outcome.sentence,
                outcome.stamp_ns,
                outcome.position_jump,
                outcome.velocity_jump,
            )
            self._publish(
                topics.DIAGNOSTICS, sim_status.encode(report, self._simulator.time_ns)
            )
        if any(outcome.kind is OutcomeKind.APPLIED for outcome in outcomes):
            self._publish_changes()

    # --- Services and parameters -----------------------------------------------------------------

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Decelerate along the path of the plan in force and hold there."""
        if self._fault is not None:
            response.success, response.message = False, self._fault
            return response
        moving = self._simulator.plan_stamp_ns != NO_PLAN
        self._simulator.stop()
        self._publish_changes()
        response.success = True
        response.message = "the arm decelerates along its path" if moving else "the arm holds"
        return response

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Back to the start posture, at rest; faults are cleared, plans forgotten."""
        self._heal()
        self._start_anew()
        response.success = True
        response.message = "the simulation starts anew"
        return response

    def _on_clear_faults(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Heal what fails; a diverged simulation has no state to go on from and starts anew."""
        failing = self._heal()
        if self._fault is None:
            response.message = f"the fault {failing} is healed" if failing else "there is no fault"
        else:
            self._start_anew()
            response.message = "the fault is cleared and the simulation starts anew"
        response.success = True
        return response

    def _heal(self) -> str:
        """Take back an injected fault; its name, empty where there was none."""
        failing = self._settings.fault
        if failing is Fault.NONE:
            return ""
        self.set_parameters([Parameter("fault", value=Fault.NONE.value)])
        return failing.value

    def _apply_parameters(self, changes: list[Parameter]) -> None:
        before = self._settings
        self._settings = sim_parameters.read(self)
        if self._settings.payload != before.payload:
            self._simulator.set_payload(self._settings.payload)
        if self._settings.fault != before.fault and self._fault is None:
            self._simulator.inject(self._settings.fault)
        if self._settings.real_time_factor != before.real_time_factor:
            self._pacer.factor = self._settings.real_time_factor
            self._pacer.restart(self._clock_ns(), self._simulator.time_ns)

    # --- Publishing ------------------------------------------------------------------------------

    def _publish_due(self) -> None:
        now_ns = self._simulator.time_ns
        if now_ns >= self._next_ns["state"]:
            self._next_ns["state"] += STATE_PERIOD_NS
            self._publish_states(now_ns)
        if now_ns >= self._next_ns["modes"]:
            self._next_ns["modes"] += MODES_PERIOD_NS
            self._modes = None  # at this rate also where nothing changes
        self._publish_changes()
        self._publish_report_when_due(now_ns)

    def _publish_states(self, now_ns: int) -> None:
        simulator, machine = self._simulator, self._machine
        if self._settings.publish_clock:
            self._publish(topics.CLOCK, Clock(clock=stamps.to_time(now_ns)))
        measured = simulator.joint_state
        hydraulics = simulator.actuator_states
        n = machine.joint_count
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
        sample = ActuatorSample(
            now_ns,
            cap_pressure=hydraulics.cap_pressure,
            rod_pressure=hydraulics.rod_pressure,
            supply_pressure=hydraulics.supply_pressure,
            force=hydraulics.force,
            piston_speed=hydraulics.piston_speed,
            supply_flow=hydraulics.supply_flow,
            valve_opening=hydraulics.valve_opening,
            servo_pump_flow=_of_actuators(hydraulics.servo_pump_flow, n),
            servo_pump_speed=_of_actuators(hydraulics.servo_pump_speed, n),
        )
        self._publish(
            topics.ACTUATOR_STATES, actuator_states.encode(sample, machine.actuator_names)
        )

    def _publish_changes(self) -> None:
        """The plan and the modes in force, when they change."""
        in_force_ns = self._simulator.plan_stamp_ns
        if in_force_ns != self._in_force_ns:
            self._in_force_ns = in_force_ns
            self._publish(topics.PLAN_IN_FORCE, stamps.to_time(in_force_ns))
        modes = self._simulator.modes
        if self._modes is None or not np.array_equal(modes, self._modes):
            self._modes = modes
            self._publish(topics.MODES, modes_in_force.encode(modes))

    def _publish_report_when_due(self, now_ns: int) -> None:
        if now_ns >= self._next_ns["report"]:
            self._publish_report(now_ns)

    def _publish_report(self, now_ns: int) -> None:
        self._next_ns["report"] = now_ns + REPORT_PERIOD_NS
        wall, sim_ns = self._last_report
        self._last_report = (time.monotonic(), self._simulator.time_ns)
        elapsed = max(1e-9, self._last_report[0] - wall)
        energies = self._simulator.energies
        report = SimulatorReport(
            self._fault or "running",
            self._fault is not None,
            self._simulator.time_ns,
            (self._simulator.time_ns - sim_ns) / SECOND_NS / elapsed,
            energies["main_pump"],
            energies["servo_pumps"],
        )
        self._publish(topics.DIAGNOSTICS, sim_status.encode(report, now_ns))

    def _publish(self, topic: topics.Topic, message: Any) -> None:
        self._publishers_by_topic[topic.name].publish(message)


def _of_actuators(of_modules: np.ndarray, count: int) -> np.ndarray:
    """The modules that belong to actuators; 0 for an actuator without one."""
    own = np.zeros(count)
    own[: len(of_modules)] = of_modules[:count]
    return own


def sim_node() -> int:
    """Simulate the arm, its hydraulics and its servo, over ROS 2.

    Settings are ROS parameters: `--ros-args -p NAME:=VALUE`; `ros2 param describe mhsb_sim NAME`
    gives meaning and unit of each.
    """
    return spin_node(SimNode)


def main() -> int:
    """Entry point of `ros2 run mhsb_sim sim_node`."""
    return command_line.run(sim_node, name="sim_node", node=True)


if __name__ == "__main__":
    sys.exit(main())
