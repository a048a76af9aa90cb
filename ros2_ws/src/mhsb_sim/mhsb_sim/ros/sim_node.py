"""The simulator node: receives plans, publishes motion, pressures and what is in force.

It is a thin adapter around `SupervisedArm`. A timer brings the simulation up to date. Messages are
decoded and passed on, and the results are published.
"""

import gc
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from mhsb_control.errors import EstimatesFileError
from mhsb_model import command_line
from mhsb_model.arm_reports import HandOverOutcome
from mhsb_msgs_py import mode_schedule, names, parameters, point_arrays, qos, topics, trajectory
from mhsb_msgs_py.endpoints import describe_duplicates
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.faults import Faults
from mhsb_msgs_py.node_process import spin_node
from mhsb_sim.ros import sim_parameters
from mhsb_sim.ros.arm_publisher import ArmPublisher
from mhsb_sim.ros.health import Health
from mhsb_sim.ros.pacing import Pacer
from mhsb_sim.simulation.faults import NO_FAULT, parse_faults
from mhsb_sim.simulation.kernel_parts import compile_simulator, exercise_kernels
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervised_arm import SupervisedArm

TIMER_PERIOD = 0.01
"""Period, in real time, of the timer that advances the simulation [s].

States are published equally often. Each wake of the node costs 0.3 ms, as long as 15 steps."""

LONGEST_TICK_NS = 10_000_000
"""Real time after which a timer callback returns, even if more is due [ns].

Other callbacks can then run."""

LATE_WAKE_NS = 20_000_000
"""Real time between two wakes [ns] above which waiting messages are received first."""

DUPLICATES_PERIOD = 1.0
"""Period of the search for duplicate publishers [s]."""


SAVING_PERIOD = 30.0
"""Period at which what the servo has learnt is kept, and written to its file [s]."""


class SimNode(Node):
    """Node that simulates the arm with its hydraulics and servo, and executes plans."""

    def __init__(self) -> None:
        """Declare the parameters, compile the kernels, build the arm, and create all interfaces.

        The arm stands at rest in its start posture. Faults of the parameter `fault` are injected.

        Raises:
            MhsbError: A parameter or a file is wrong, or the arm cannot be held in its start
                posture.
        """
        super().__init__(names.SIM_NODE)
        self.faults = Faults(self, stop=lambda: self._arm.stop())
        self._machine = parameters.declare_machine(self)
        plant = sim_parameters.declare_plant(self, self._machine)
        self._settings = sim_parameters.declare_parameters(self, self._machine, plant)
        compile_simulator(self.get_logger().info)
        simulator = Simulator(
            self._machine,
            self._settings.controller,
            self._settings.seed,
            payload=self._settings.payload,
            plant=plant,
            estimates_file=Path(file) if (file := self._settings.estimates_file) else None,
        )
        self._arm = SupervisedArm(simulator, self._settings.limits)
        exercise_kernels()  # loads all kernels before the node serves
        self._publisher = ArmPublisher(self, self._arm, self._settings.publish_clock, self.faults)
        self._pacer = Pacer(self._settings.real_time_factor)
        self._last_callback_end_ns = 0
        self._messages_first = False
        self._health = Health(self._arm, self._pacer, self._settings.publish_clock, self.faults)
        self._make_interfaces()
        self.add_on_set_parameters_callback(
            lambda changes: sim_parameters.check_changes(self, plant, changes)
        )
        self.add_post_set_parameters_callback(self._apply_parameters)
        gc.collect()
        gc.freeze()  # loaded modules stay, so that later collections need not examine them
        self._restart_arm()
        self.get_logger().info(f"ready: {self._machine.name} holds its position")

    def _make_interfaces(self) -> None:
        """Create the subscriptions of plans, the services, and the timers.

        Plans come as two messages, trajectory and mode schedule, which the callbacks decode. The
        services are ~/stop, ~/reset and ~/clear_faults. The timers advance the simulation, look for
        duplicate publishers, and save the estimates.
        """
        arm, machine = self._arm, self._machine
        for topic, decode, parts, add in (
            (topics.JOINT_TRAJECTORY, trajectory.decode, machine.joint_names, arm.add_trajectory),
            (topics.MODE_COMMANDS, mode_schedule.decode, machine.actuator_names, arm.add_schedule),
        ):
            callback = partial(self._on_half, topic.name, decode, parts, add)
            self.create_subscription(topic.message, topic.name, callback, topic.qos, raw=True)
        for name, answer in (
            (names.STOP_SERVICE, self._on_stop),
            (names.RESET_SERVICE, self._on_reset),
            (names.CLEAR_FAULTS_SERVICE, self._on_clear_faults),
        ):
            self.create_service(Trigger, name, answer, qos_profile=qos.SERVICE)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.faults.watch(self.create_timer(TIMER_PERIOD, self._tick, clock=steady))
        self.create_timer(DUPLICATES_PERIOD, self._look_for_duplicates, clock=steady)
        self.create_timer(SAVING_PERIOD, self._save_estimates, clock=steady)

    # --- Time ------------------------------------------------------------------------------------

    def _tick(self) -> None:
        """Advance the simulation up to the present, and publish states and reports.

        A timer calls this method. One call takes about LONGEST_TICK_NS at most. If the previous
        call ended more than LATE_WAKE_NS ago, or if only one message of a plan has come, this call
        does nothing, so that waiting messages are received first. The next call then advances. The
        very first call resets the arm, so that simulated time begins at that instant.
        """
        now_ns = time.monotonic_ns()
        if not self._last_callback_end_ns:
            self._restart_arm()  # simulated time starts when the node is first served
        elif not self._messages_first and (
            now_ns - self._last_callback_end_ns > LATE_WAKE_NS or self._arm.awaits_message
        ):
            self._messages_first = True
            return
        self._messages_first = False
        due_ns = self._pacer.compute_due_ns(now_ns, self._arm.simulator.time_ns)
        self._arm.hand_over(time.monotonic())
        self._simulate(due_ns, now_ns + LONGEST_TICK_NS)
        self._publish_reports()
        self._last_callback_end_ns = time.monotonic_ns()

    def _simulate(self, due_ns: int, until_ns: int) -> None:
        """Step the simulation and publish states, up to a simulated time or to a time limit.

        The time limit is checked only after states have been published. Nothing happens if the
        simulation has diverged (`halted`).

        Args:
            due_ns: Simulated time to be reached and not exceeded [ns].
            until_ns: Time of the steady clock at which stepping ends [ns].
        """
        arm, simulator = self._arm, self._arm.simulator
        wall = time.monotonic()
        while not arm.halted and simulator.time_ns + simulator.step_ns <= due_ns:
            arm.step(wall)
            if self._publisher.publish_due() and time.monotonic_ns() > until_ns:
                return

    def _restart_arm(self) -> None:
        """Put the arm at rest into its start posture, and forget plans and faults.

        Simulated time starts at 0 if the node publishes /clock, else at the system's time. The
        faults that the parameter `fault` names are then injected again.

        Raises:
            HoldingError: The arm cannot be held in the start posture with its payload.
        """
        time_ns = 0 if self._settings.publish_clock else time.time_ns()
        self._arm.reset(time_ns)
        self._inject_faults()
        self._restart_pacing()

    def _restart_pacing(self) -> None:
        """Make the present the new reference of simulated and real time, and publish all reports.

        Any lag is forgotten, and all publishing periods start at the present.
        """
        self._pacer.restart(time.monotonic_ns(), self._arm.simulator.time_ns)
        self._publisher.restart()
        self._publish_reports()

    # --- Plans -----------------------------------------------------------------------------------

    def _on_half(
        self,
        topic: str,
        decode: Callable[[bytes, Sequence[str]], Any],
        parts: Sequence[str],
        add: Callable[[Any, float], None],
        raw: bytes,
    ) -> None:
        """Receive one of the two messages of a plan; if it cannot be decoded, refuse the plan.

        Args:
            topic: Name of the message's topic, for the report.
            decode: Function that decodes the message.
            parts: Names of the joints or actuators of the machine.
            add: Method of the arm that takes the decoded half and the time of receipt [s].
            raw: Serialised message.
        """
        wall = time.monotonic()
        try:
            add(decode(raw, parts), wall)
        except MessageError as error:
            problem = f"its {topic} cannot be used: {error}"
            self._arm.add_unusable(point_arrays.read_stamp(raw), problem, wall)
        self._publish_reports()

    # --- Services and parameters -----------------------------------------------------------------

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Stop the arm: decelerate along the path of the plan in force, then hold.

        Plans whose stamp is not later than now are refused, and a waiting plan is dropped. Reports
        on this are published before the answer. If the simulation has diverged, the arm is not
        stopped.

        Args:
            request: Empty request.
            response: Response to be filled in.

        Returns:
            The response. Normally `success` is True and the message says whether the arm
            decelerates or holds. If the simulation has diverged, `success` is False and the message
            is the fault.
        """
        moving = self._arm.stop()
        self._publish_reports()
        response.success = not self._arm.halted
        response.message = "the arm decelerates along its path" if moving else "the arm holds"
        if self._arm.halted:
            response.message = self._arm.fault
        return response

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Reset the arm: start posture at rest, all faults ended, plans forgotten.

        The parameter `fault` is set to none, and simulated time starts anew (`_restart_arm`).

        Args:
            request: Empty request.
            response: Response to be filled in.

        Returns:
            The response, always with success.
        """
        self._end_fault()
        self._restart_arm()
        response.success = True
        response.message = "the simulation starts anew"
        return response

    def _on_clear_faults(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """End the injected faults, and let an arm that was stopped go on.

        The parameter `fault` is set to none; `SupervisedArm.clear_fault` does the rest. A
        simulation that has diverged starts again. Its time goes on, or becomes the system's time if
        that is later and the node does not publish /clock.

        Args:
            request: Empty request.
            response: Response to be filled in.

        Returns:
            The response, always with success, and with a sentence on what happens to the faults.
        """
        healed = self._end_fault()
        diverged = self._arm.halted
        time_ns = self._arm.simulator.time_ns
        if not self._settings.publish_clock:
            time_ns = max(time_ns, time.time_ns())
        response.message = healed + self._arm.clear_fault(time_ns)
        if diverged:
            self._restart_pacing()
        self._publish_reports()
        response.success = True
        return response

    def _end_fault(self) -> str:
        """End the injected faults, by setting the parameter `fault` to none.

        Returns:
            Clause that says which faults have ended, such as `the fault KIND is healed; `. The
            caller puts it before another sentence. Empty if there were no faults.
        """
        failing = self._settings.fault
        if failing == NO_FAULT:
            return ""
        self.set_parameters([Parameter("fault", value=NO_FAULT)])
        return f"the fault {failing} is healed; "

    def _inject_faults(self) -> None:
        """Inject the faults of the parameter `fault`."""
        simulator = self._arm.simulator
        simulator.inject_faults(parse_faults(self._settings.fault, simulator.plant))

    def _apply_parameters(self, changes: list[Parameter]) -> None:
        """Apply changed parameters: limits of supervision, payload, faults and real-time factor.

        A changed factor restarts the pacing. New faults are not injected into a simulation that has
        diverged.

        Args:
            changes: Changed parameters; not used, since all are read again.
        """
        before = self._settings
        self._settings = sim_parameters.read_parameters(self)
        arm = self._arm
        arm.supervision.limits = self._settings.limits
        if self._settings.payload != before.payload:
            arm.set_payload(self._settings.payload)
        if self._settings.fault != before.fault and not arm.halted:
            self._inject_faults()
        if self._settings.real_time_factor != before.real_time_factor:
            self._pacer.factor = self._settings.real_time_factor
            self._pacer.restart(time.monotonic_ns(), arm.simulator.time_ns)

    # --- Reports ---------------------------------------------------------------------------------

    def _save_estimates(self) -> None:
        """Store the servo's estimates for later resets, and write them to the estimates file.

        Nothing is stored while the arm has a fault, since the fault may have spoilt the estimates.
        If the file cannot be written, a warning is logged.
        """
        if self._arm.fault:
            return
        try:
            self._arm.simulator.save_estimates()
        except EstimatesFileError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=300.0)

    def destroy_node(self) -> None:
        """Write the estimates file for the last time (if the arm exists), and destroy the node."""
        if hasattr(self, "_arm"):
            self._save_estimates()
        super().destroy_node()

    def _look_for_duplicates(self) -> None:
        """Search the ROS graph for other publishers of this node's topics."""
        self._health.duplicates = describe_duplicates(self, self._publisher.exclusive_publishers)

    def _publish_reports(self) -> None:
        """Publish hand-over reports, changes of plan and modes, and the simulator's report.

        A new plan in force and new modes are published at once. The simulator's report is published
        if it is due. It is also published, and logged, if a fault or a warning has begun or ended,
        or if ~/stop was called (`Health.has_changed`). Plans that were refused or dropped are
        logged as warnings.
        """
        for report in self._arm.take_reports():
            if report.outcome is not HandOverOutcome.APPLIED:
                self.get_logger().warning(report.sentence, throttle_duration_sec=0.1)
            self._publisher.publish_hand_over(report)
        self._publisher.publish_changes()
        health = self._health
        changed = health.has_changed()
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


main = command_line.make_main(sim_node, node=True)
