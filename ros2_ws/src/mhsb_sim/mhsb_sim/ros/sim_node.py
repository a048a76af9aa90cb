"""The simulator node: plans in, motion, pressures and what is in force out.

A thin adapter around `SupervisedArm`: a timer brings the simulation up to date, messages are
decoded and handed on, and what comes of it is published.
"""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from mhsb_model import command_line
from mhsb_model.arm_reports import HandOverOutcome
from mhsb_msgs_py import mode_schedule, names, point_arrays, topics, trajectory
from mhsb_msgs_py.duplicates import duplicate_problem
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.node_process import spin_node
from mhsb_sim.ros import sim_parameters
from mhsb_sim.ros.arm_publisher import ArmPublisher
from mhsb_sim.ros.health import Health
from mhsb_sim.ros.pacing import Pacer
from mhsb_sim.simulation.faults import NONE, parse_faults
from mhsb_sim.simulation.kernel_parts import compile_simulator, rehearse
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervised_arm import SupervisedArm

TICK = 0.005
"""Wall-clock time between two looks at what is due [s]."""

LONGEST_TICK_NS = 10_000_000
"""Wall-clock time of one wake after which others have their turn, even if more is due."""

LATE_WAKE_NS = 10_000_000
"""Wall-clock time between two wakes beyond which what came meanwhile is received first."""

DUPLICATES_PERIOD = 1.0  # s

class SimNode(Node):
    """Simulates the arm with its hydraulics and servo, and executes plans."""

    def __init__(self) -> None:
        super().__init__(names.SIM_NODE)
        self._machine = sim_parameters.declare_machine(self)
        plant = sim_parameters.declare_plant(self, self._machine)
        self._settings = sim_parameters.declare(self, plant)
        compile_simulator(self.get_logger().info)
        simulator = Simulator(
            self._machine,
            self._settings.controller,
            self._settings.seed,
            payload=self._settings.payload,
            plant=plant,
        )
        self._arm = SupervisedArm(simulator, self._settings.limits)
        rehearse()  # loads everything before anybody waits for it
        self._publisher = ArmPublisher(self, self._arm, self._settings.publish_clock)
        self._pacer = Pacer(self._settings.real_time_factor, 0, 0)
        self._left_ns = 0
        self._messages_first = False
        self._health = Health(self._arm, self._pacer, self._settings.publish_clock)
        self._make_interfaces()
        self.add_on_set_parameters_callback(
            lambda changes: sim_parameters.check(self, plant, changes)
        )
        self.add_post_set_parameters_callback(self._apply_parameters)
        gc.collect()
        gc.freeze()  # what has been loaded stays: later collections need not look at it
        self._start_anew()
        self.get_logger().info(f"ready: {self._machine.name} holds its position")

    def _make_interfaces(self) -> None:
        for topic, callback in (
            (topics.JOINT_TRAJECTORY, self._on_trajectory),
            (topics.MODE_COMMANDS, self._on_schedule),
        ):
            self.create_subscription(topic.message, topic.name, callback, topic.qos, raw=True)
        self.create_service(Trigger, names.STOP_SERVICE, self._on_stop)
        self.create_service(Trigger, names.RESET_SERVICE, self._on_reset)
        self.create_service(Trigger, names.CLEAR_FAULTS_SERVICE, self._on_clear_faults)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(TICK, self._tick, clock=steady)
        self.create_timer(DUPLICATES_PERIOD, self._look_for_duplicates, clock=steady)

    # --- Time ------------------------------------------------------------------------------------

    def _tick(self) -> None:
        """Bring the simulation up to date, publishing on the way."""
        now_ns = time.monotonic_ns()
        if not self._left_ns:
            self._start_anew()  # time begins when the node is served
        elif now_ns - self._left_ns > LATE_WAKE_NS and not self._messages_first:
            self._messages_first = True
            return
        self._messages_first = False
        due_ns = self._pacer.due_ns(now_ns, self._arm.simulator.time_ns)
        self._arm.hand_over(time.monotonic())
        self._simulate(due_ns, now_ns + LONGEST_TICK_NS)
        self._tell()
        self._left_ns = time.monotonic_ns()

    def _simulate(self, due_ns: int, until_ns: int) -> None:
        """Step up to `due_ns`, or until the steady clock has come to `until_ns`."""
        arm, simulator = self._arm, self._arm.simulator
        wall = time.monotonic()
        while not arm.halted and simulator.time_ns + simulator.step_ns <= due_ns:
            arm.step(wall)
            if self._publisher.publish_due() and time.monotonic_ns() > until_ns:
                return

    def _start_anew(self) -> None:
        """Rest in the start posture from now on; forget plans and faults."""
        time_ns = 0 if self._settings.publish_clock else time.time_ns()
        self._arm.reset(time_ns)
        self._inject_faults()
        self._go_on_from_here()

    def _go_on_from_here(self) -> None:
        self._pacer.restart(time.monotonic_ns(), self._arm.simulator.time_ns)
        self._publisher.restart()
        self._tell()

    # --- Plans -----------------------------------------------------------------------------------

    def _on_trajectory(self, raw: bytes) -> None:
        wall = time.monotonic()
        with self._refusing(raw, "joint_trajectory", wall):
            received = trajectory.decode(raw, self._machine.joint_names)
            self._arm.add_trajectory(received, wall)

    def _on_schedule(self, raw: bytes) -> None:
        wall = time.monotonic()
        with self._refusing(raw, "mode_commands", wall):
            received = mode_schedule.decode(raw, self._machine.actuator_names)
            self._arm.add_schedule(received, wall)

    @contextmanager
    def _refusing(self, raw: bytes, half: str, wall: float) -> Iterator[None]:
        """What comes of half a plan is told; one that cannot be decoded is refused."""
        try:
            yield
        except MessageError as error:
            problem = f"its {half} cannot be used: {error}"
            self._arm.add_unusable(point_arrays.stamp_of(raw), problem, wall)
        self._tell()

    # --- Services and parameters -----------------------------------------------------------------

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Decelerate along the path of the plan in force and hold there."""
        moving = self._arm.stop()
        self._tell()
        response.success = not self._arm.halted
        response.message = "the arm decelerates along its path" if moving else "the arm holds"
        if self._arm.halted:
            response.message = self._arm.fault
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
        """Heal what fails, and let an arm that was stopped because of it go on."""
        healed = self._heal()
        diverged = self._arm.halted
        time_ns = self._arm.simulator.time_ns
        if not self._settings.publish_clock:
            time_ns = max(time_ns, time.time_ns())
        response.message = healed + self._arm.clear_fault(time_ns)
        if diverged:
            self._go_on_from_here()
        self._tell()
        response.success = True
        return response

    def _heal(self) -> str:
        """Take back an injected fault; tells of it, if there was one."""
        failing = self._settings.fault
        if failing == NONE:
            return ""
        self.set_parameters([Parameter("fault", value=NONE)])
        return f"the fault {failing} is healed; "

    def _inject_faults(self) -> None:
        simulator = self._arm.simulator
        simulator.inject(parse_faults(self._settings.fault, simulator.plant))

    def _apply_parameters(self, changes: list[Parameter]) -> None:
        before = self._settings
        self._settings = sim_parameters.read(self)
        arm = self._arm
        arm.supervision.limits = self._settings.limits
        if self._settings.payload != before.payload:
            arm.set_payload(self._settings.payload)
        if self._settings.fault != before.fault and not arm.halted:
            self._inject_faults()
        if self._settings.real_time_factor != before.real_time_factor:
            self._pacer.factor = self._settings.real_time_factor
            self._pacer.restart(time.monotonic_ns(), arm.simulator.time_ns)

    # --- What is told ----------------------------------------------------------------------------

    def _look_for_duplicates(self) -> None:
        self._health.duplicates = duplicate_problem(self, self._publisher.own)

    def _tell(self) -> None:
        """Publish what has become of plans, and how the simulation is where that is new."""
        for report in self._arm.take_reports():
            if report.outcome is not HandOverOutcome.APPLIED:
                self.get_logger().warning(report.sentence, throttle_duration_sec=0.1)
            self._publisher.publish_hand_over(report)
        self._publisher.publish_changes()
        health = self._health
        changed = health.changed()
        if changed:
            health.log(self.get_logger())
        if changed or self._publisher.report_due():
            self._publisher.publish_report(health.sentence, health.level)


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
