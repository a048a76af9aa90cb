"""The live view as a node, which uses only published topics, parameters and services."""

from __future__ import annotations

import functools
import queue
import threading
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from std_msgs.msg import UInt8MultiArray
from std_srvs.srv import Trigger
from viser import ViserServer

from mhsb_model.arm_reports import SimulatorReport
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_msgs_py import (
    actuator_states,
    endpoints,
    joint_state,
    modes_in_force,
    names,
    plan_status,
    sim_status,
    topics,
)
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.joint_state import JointSample
from mhsb_msgs_py.topics import Topic
from mhsb_planner.planners.registry import PLANNER_KINDS
from mhsb_planner.ros.goal_sender import GoalSender
from mhsb_tools.moves.operating_regions import OperatingRegions
from mhsb_tools.moves.workspace_points import find_hold_regions
from mhsb_tools.viewer.ability_scene import (
    PolytopeScene,
    RegionScene,
)
from mhsb_tools.viewer.arm_scene import FRAME_PERIOD, ArmScene
from mhsb_tools.viewer.energy_flow import EnergyCounter
from mhsb_tools.viewer.marker_scene import MarkerScene
from mhsb_tools.viewer.panel import Panel, describe_report, make_initial_goal
from mhsb_tools.viewer.plots import PLOT_SPAN, Plots, SnapshotHistory, Snapshots

FRAMES_PER_PLOT = 5
"""Number of frames after which plots, state and polytope are drawn again."""

STREAM_TOPICS = (topics.JOINT_STATES, topics.ACTUATOR_STATES)
"""Topics that are subscribed to only while a browser is open.

A hundred messages a second take a tenth of a processor.
"""

SHOWN_PARAMETERS = ("planner", "weights", "payload")
"""Parameters of the planner that the page shows."""

Arguments = ParamSpec("Arguments")

MOVING_SPEED = 0.01  # rad/s
"""Joint speed above which the arm is said to move [rad/s]."""


def _in_node_thread(
    method: Callable[Concatenate[ViewerNode, Arguments], None],
) -> Callable[Concatenate[ViewerNode, Arguments], None]:
    """Let a method of the node be called from any thread; the node's thread carries it out.

    Args:
        method: The method.

    Returns:
        The method that queues the call and returns at once.
    """

    @functools.wraps(method)
    def queue_call(node: ViewerNode, /, *given: Arguments.args, **named: Arguments.kwargs) -> None:
        """Queue the call behind those before it, and wake the node's thread."""
        node._queued_actions.put(functools.partial(method, node, *given, **named))
        node._wake.trigger()

    return queue_call


class ViewerNode(GoalSender):
    """Node that shows arm, plan and verdicts in a browser, and sends the user's goals.

    Commands of the page come from the server's threads. They are queued and carried out in the
    node's thread.
    """

    def __init__(self, server: ViserServer, machine: Machine) -> None:
        """Build the page, subscribe to modes, markers and diagnostics, and start the timers.

        Joint states and actuator states are subscribed to only while a browser is open. The timers
        use the steady clock, so simulated time has no influence.

        Args:
            server: Web server of the page.
            machine: The arm.
        """
        super().__init__("mhsb_viewer")
        self._server = server
        self._machine = machine
        self._arm = ArmScene(server.scene, machine)
        self._markers = MarkerScene(server.scene, names.BASE_FRAME)
        self._panel = Panel(
            server, PLANNER_KINDS, self, make_initial_goal(machine), machine.relative_size
        )
        self._plots = Plots(server.gui, machine)
        self._history = SnapshotHistory(PLOT_SPAN)
        self._newest: dict[str, bytes] = {}
        self._streams: list[Any] = []
        self._modes = np.zeros(machine.joint_count, dtype=np.uint8)
        self._flow = EnergyCounter()
        self._polytope = PolytopeScene(server.scene, machine)
        self._regions = RegionScene(server.scene)
        self._shown_abilities = (True, False)
        self._payload = float(machine.arrays.payload)
        self._report: SimulatorReport | None = None
        self._frames = 0
        self._settings = AsyncParameterClient(self, names.PLANNER_NODE)
        self._settings_known = False
        self._stops = [
            self.create_client(Trigger, f"{node}/stop")
            for node in (names.PLANNER_NODE, names.SIM_NODE)
        ]
        self._queued_actions: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._wake = self.create_guard_condition(self._run_queued_actions)
        endpoints.make_subscription(self, topics.MODES, self._on_modes)
        endpoints.make_subscription(self, topics.MARKERS, self._markers.show)
        endpoints.make_subscription(self, topics.DIAGNOSTICS, self._on_diagnostics)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(FRAME_PERIOD, self._on_frame, clock=steady)
        self.create_timer(1.0, self._on_second, clock=steady)

    # --- Asked for in the browser, by its threads; carried out in the node's thread ---------------

    def _run_queued_actions(self) -> None:
        """Call all queued functions, in the node's thread."""
        while not self._queued_actions.empty():
            self._queued_actions.get()()

    @_in_node_thread
    def send_goal(self, *place: float) -> None:
        """Send a goal to the planner, or show on the page that no planner is connected.

        Args:
            place: x and z, or x, y and z if the arm slews, in `base_link` [m].
        """
        if not self.is_matched:
            self._panel.add_sentence(
                "no planner is heard; start one: ros2 run mhsb_planner planner_node"
            )
            return
        self.send(*place)

    @_in_node_thread
    def stop(self) -> None:
        """Call the planner's stop service, or the simulator's if the planner's is not available.

        The answer is shown on the page. If neither service is available, the page says so.
        """
        ready = [client for client in self._stops if client.service_is_ready()]
        if not ready:
            self._panel.add_sentence("nobody is there to stop")
            return
        ready[0].call_async(Trigger.Request()).add_done_callback(
            lambda done: self._panel.add_sentence(f"stop: {done.result().message}")
        )

    @_in_node_thread
    def set_planner(self, changes: dict[str, Any]) -> None:
        """Ask the planner to set parameters; it sets all of them or none.

        The answer comes later and is shown on the page. If there is no planner, the page says so.

        Args:
            changes: Values by name of the parameter.
        """
        if not self._settings.services_are_ready():
            self._panel.add_sentence("no planner is there to take its parameters")
            return
        wanted = [Parameter(name, value=value) for name, value in changes.items()]
        self._settings.set_parameters_atomically(wanted).add_done_callback(self._on_settings_answer)

    def _on_settings_answer(self, done: Any) -> None:
        """Show on the page whether the planner accepted its new parameters.

        The planner's parameters are then read again, within a second.

        Args:
            done: Finished future of the service call. If the call has failed, the exception of the
                future is raised, and nothing is shown.
        """
        result = done.result().result
        self._panel.add_sentence(
            "the planner took its parameters, for the next plan"
            if result.successful
            else f"the planner refused its parameters: {result.reason}"
        )
        self._settings_known = False  # so that they are read and shown again

    @_in_node_thread
    def show_abilities(self, velocities: bool, regions: bool) -> None:
        """Show or hide the velocity polytope and the regions that need boost.

        Neither appears at once. The polytope is drawn with one of the next frames. Regions are
        first computed, in a thread, when they are switched on.

        Args:
            velocities: Whether to show the velocity polytope of the tip.
            regions: Whether to show where boost is needed.
        """
        before, self._shown_abilities = self._shown_abilities, (velocities, regions)
        if not velocities:
            self._polytope.hide()
        if not regions:
            self._regions.hide()
        elif not before[1]:
            self._start_computing_regions()

    def _start_computing_regions(self) -> None:
        """Start a thread that finds where the arm holds its load, as the command `check` does.

        It uses the payload for which the planner plans. It takes seconds, and a sentence on the
        page says that it has begun. The thread of the ROS node then draws the result.
        """
        machine, payload = self._machine, self._payload

        def compute_regions() -> None:
            """Find where the arm holds its load, and let the thread of the ROS node draw it.

            Uses `machine` and `payload` of the enclosing function. Runs in a separate thread.
            """
            self._show_regions(payload, find_hold_regions(machine.changed(payload=payload)))

        self._panel.add_sentence("looking at where boost is needed …")
        threading.Thread(target=compute_regions, daemon=True).start()

    @_in_node_thread
    def _show_regions(self, payload: float, regions: OperatingRegions) -> None:
        """Draw where the arm holds its load, and count these points in a sentence on the page.

        If the user has switched the regions off, nothing happens. If the payload has changed since
        the computation began, a new computation is started instead.

        Args:
            payload: Payload for which the regions were computed [kg].
            regions: Points that the arm reaches, and what holds the load there.
        """
        if not self._shown_abilities[1]:
            return
        if payload != self._payload:
            self._start_computing_regions()
            return
        self._regions.show(regions)
        reached, boosted = len(regions.nodes), int(regions.needs_boost.sum())
        heavy = int(regions.beyond_highest_boost.sum())
        self._panel.add_sentence(
            f"with {payload:g} kg, of {reached} points in reach {reached - boosted - heavy} are "
            f"held in N, {boosted} need boost, {heavy} cannot be held"
        )

    # --- Heard -----------------------------------------------------------------------------------

    def _on_status(self, message: DiagnosticArray) -> None:
        """Show the verdicts and execution reports in a message as sentences on the page.

        Args:
            message: Message of the planner on `plan_status`. If it cannot be decoded, the page says
                so.
        """
        try:
            reports = plan_status.decode(message)
        except MessageError as error:
            self._panel.add_sentence(f"plan_status is not understood: {error}")
            return
        for report in reports:
            self._panel.add_sentence(describe_report(report))

    def _on_modes(self, message: UInt8MultiArray) -> None:
        """Store the modes in force for the next frame.

        Args:
            message: Mode code of each actuator. If it cannot be decoded, it is ignored, with a
                warning in the log.
        """
        try:
            self._modes = modes_in_force.decode(message, self._machine.joint_count)
        except MessageError as error:
            self.get_logger().warning(f"modes are not shown: {error}", throttle_duration_sec=10.0)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """Store the simulator's report, and pass its pumps' energies to the energy counter.

        The energies are totals since the simulator's start.

        Messages that cannot be decoded and reports of other nodes are ignored. Reports of
        simulators in other namespaces are ignored, too.

        Args:
            message: Message on `/diagnostics`.
        """
        try:
            reports = sim_status.decode(message, self.get_namespace())
        except MessageError:
            return  # other nodes publish on this topic, too
        for report in reports:
            if isinstance(report, SimulatorReport):
                self._flow.add_pump_report(report.main_pump_j, report.servo_pumps_j)
                self._report = report

    def _update_stream_subscriptions(self, wanted: bool) -> None:
        """Subscribe to joint states and actuator states, or unsubscribe from them.

        If the wanted state exists already, nothing happens. Unsubscribing also resets the energies,
        because samples are missing from then on.

        Args:
            wanted: True subscribes, False unsubscribes.
        """
        if wanted and not self._streams:
            self._streams = [self._subscribe_newest(topic) for topic in STREAM_TOPICS]
        elif not wanted and self._streams:
            for subscription in self._streams:
                self.destroy_subscription(subscription)
            self._streams = []
            self._newest.clear()
            self._flow = EnergyCounter()

    def _subscribe_newest(self, topic: Topic) -> Any:
        """Subscribe to a topic and keep only its newest message, as bytes.

        The QoS is best effort with depth 1. The message is in `_newest` under the topic's name.

        Args:
            topic: The topic.

        Returns:
            The subscription.
        """

        def received(data: bytes) -> None:
            """Store a message in place of the one before.

            Args:
                data: Serialized message.
            """
            self._newest[topic.name] = data

        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        return endpoints.make_subscription(self, topic, received, newest, raw=True)

    # --- Shown -----------------------------------------------------------------------------------

    def _on_frame(self) -> None:
        """Show the newest joint states on the page; called every FRAME_PERIOD.

        First, joint states and actuator states are subscribed to if a browser is open, or
        unsubscribed from if none is. If no new joint states have come, nothing is shown. If the
        states cannot be decoded, a sentence on the page says so at once, and the arm is not shown.

        Every FRAMES_PER_PLOT-th shown frame also updates the plots, the sentence on the arm's
        state, and the velocity polytope if it is switched on.
        """
        self._update_stream_subscriptions(bool(self._server.get_clients()))
        data = self._newest.pop(topics.JOINT_STATES.name, None)
        if data is None:
            return
        try:
            joints, moment = self._decode_newest(data)
        except MessageError as error:
            self._panel.show_state(f"the arm is not understood: {error}")
            return
        with self._server.atomic():
            self._arm.show(joints.position, self._modes)
        self._frames += 1
        self._history.add(moment)
        if self._frames % FRAMES_PER_PLOT == 0:
            if self._shown_abilities[0]:
                self._polytope.show(joints.position, self._modes)
            self._panel.show_state(self._describe_state(joints))
            self._plots.show(self._history.get_columns())

    def _decode_newest(self, data: bytes) -> tuple[JointSample, Snapshots]:
        """Decode joint states, and combine them with the last known modes, pressures and energies.

        The newest actuator states give the pressures, however old they are. If none have come since
        a browser was opened, the pressures are nan. The energies grow by the mean
        power of the previous and the newest actuator states, times the time between them
        (`EnergyCounter.add_sample`).

        Args:
            data: One serialized message of joint states.

        Returns:
            Motion of the joints, and the state of the arm that the plots show.

        Raises:
            MessageError: The joint states or actuator states cannot be decoded.
        """
        machine = self._machine
        message = deserialize_message(data, topics.JOINT_STATES.message)
        joints = joint_state.decode(message, machine.joint_names)
        pressure = np.full(machine.joint_count, np.nan)
        if data := self._newest.get(topics.ACTUATOR_STATES.name, b""):
            state = deserialize_message(data, topics.ACTUATOR_STATES.message)
            sample = actuator_states.decode(state, machine.actuator_names)
            pressure = sample.supply_pressure
            self._flow.add_sample(sample, sample.stamp_ns / SECOND_NS)
        time = joints.stamp_ns / SECOND_NS
        return joints, Snapshots(time, pressure, self._modes, self._flow.energies)

    def _describe_state(self, joints: JointSample) -> str:
        """Describe the state of the arm in words.

        Args:
            joints: Motion of the joints.

        Returns:
            Text with Markdown: whether a joint is faster than MOVING_SPEED, the position of the tip
            [m], and the simulator's fault or warning if there is one.
        """
        tip = zip(self._machine.axes, self._machine.tip_in_base(joints.position), strict=True)
        where = ", ".join(f"{axis} {value:.3f} m" for axis, value in tip)
        moves = np.abs(joints.velocity).max() > MOVING_SPEED
        words = f"{'moving' if moves else 'at rest'}, tip at {where}"
        if self._report is not None and (self._report.faulty or self._report.warning):
            words += f"\n\n**{self._report.sentence}**"
        return words

    def _on_second(self) -> None:
        """Ask for the planner's parameters if they are not known yet and the planner is available.

        They are known from the first request on. They are asked for again only after this page has
        set some; changes by other programs are not noticed.
        """
        if not self._settings_known and self._settings.services_are_ready():
            self._settings_known = True
            self._settings.get_parameters(list(SHOWN_PARAMETERS)).add_done_callback(
                self._show_settings
            )

    def _show_settings(self, done: Any) -> None:
        """Show the planner's parameters on the page.

        If the payload has changed, and the regions that need boost are shown, they are computed
        again.

        Args:
            done: Finished future of the service call; its result has the values of
                SHOWN_PARAMETERS. A result with another number of values is ignored. If the call has
                failed, the exception of the future is raised.
        """
        values = [parameter_value_to_python(value) for value in done.result().values]
        if len(values) == len(SHOWN_PARAMETERS):
            settings = dict(zip(SHOWN_PARAMETERS, values, strict=True))
            self._panel.show_settings(settings)
            if self._payload != settings["payload"]:
                self._payload = float(settings["payload"])
                if self._shown_abilities[1]:
                    self._start_computing_regions()
