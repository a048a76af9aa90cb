"""The live view as a node: it hears what everybody can hear, and asks for what everybody can."""

from __future__ import annotations

import functools
import queue
import threading
from collections.abc import Callable
from typing import Any

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
from visualization_msgs.msg import MarkerArray

from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, IntArray
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
from mhsb_msgs_py.sim_status import SimulatorReport
from mhsb_msgs_py.topics import Topic
from mhsb_planner.planners.registry import PLANNER_KINDS
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_planner.ros.goal_sender import GoalSender
from mhsb_sim.viewer.ability_scene import PolytopeScene, RegionScene
from mhsb_sim.viewer.arm_scene import ArmScene
from mhsb_sim.viewer.boost_regions import BEYOND, boost_regions
from mhsb_sim.viewer.energy_flow import EnergyFlow
from mhsb_sim.viewer.marker_scene import MarkerScene
from mhsb_sim.viewer.moment import History, Moment
from mhsb_sim.viewer.panel import Panel, first_goal
from mhsb_sim.viewer.plots import Plots
from mhsb_sim.viewer.words import words_of

FRAME_PERIOD = 0.05  # s
FRAMES_PER_PLOT = 5
SPAN = 30.0
"""Time that plots look back [s]."""

STREAMS = (topics.JOINT_STATES, topics.ACTUATOR_STATES)
"""Heard only while a browser is open: a hundred messages a second cost a tenth of a processor."""

SETTINGS = ("planner", "weights", "payload")
MOVING = 0.01  # rad/s


class ViewerNode(GoalSender):
    """Shows the arm, the plan and the verdicts in a browser, and sends what is asked for there."""

    def __init__(self, server: ViserServer, machine: Machine) -> None:
        super().__init__("mhsb_viewer")
        self._server = server
        self._machine = machine
        self._arm = ArmScene(server.scene, machine)
        self._markers = MarkerScene(server.scene, names.BASE_FRAME)
        self._panel = Panel(server, PLANNER_KINDS, self, first_goal(machine), machine.scale)
        self._plots = Plots(server.gui, machine)
        self._history = History(SPAN)
        self._newest: dict[str, bytes] = {}
        self._streams: list[Any] = []
        self._modes = np.zeros(machine.joint_count, dtype=np.uint8)
        self._flow = EnergyFlow()
        self._polytope = PolytopeScene(server.scene, machine)
        self._regions = RegionScene(server.scene)
        self._wanted = (True, False)
        self._payload = float(machine.arrays.payload)
        self._report: SimulatorReport | None = None
        self._frames = 0
        self._settings = AsyncParameterClient(self, names.PLANNER_NODE)
        self._settings_known = False
        self._stops = [
            self.create_client(Trigger, f"{node}/stop")
            for node in (names.PLANNER_NODE, names.SIM_NODE)
        ]
        self._asked: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._wake = self.create_guard_condition(self._do_asked)
        endpoints.subscription(self, topics.MODES, self._on_modes)
        endpoints.subscription(self, topics.MARKERS, self._on_markers)
        endpoints.subscription(self, topics.DIAGNOSTICS, self._on_diagnostics)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(FRAME_PERIOD, self._on_frame, clock=steady)
        self.create_timer(1.0, self._on_second, clock=steady)

    # --- Asked for in the browser, by its threads ------------------------------------------------

    def go(self, *place: float) -> None:
        """Send a goal [m]."""
        self._ask(functools.partial(self._go, *place))

    def stop(self) -> None:
        """Have the arm stop: the planner does that, and the arm itself where there is none."""
        self._ask(self._stop)

    def set_planner(self, changes: dict[str, Any]) -> None:
        """Set parameters of the planner."""
        self._ask(functools.partial(self._set, changes))

    def show_abilities(self, velocities: bool, regions: bool) -> None:
        """Show or hide what the arm is able to do."""
        self._ask(functools.partial(self._show_abilities, velocities, regions))

    def _ask(self, deed: Callable[[], None]) -> None:
        self._asked.put(deed)
        self._wake.trigger()

    def _do_asked(self) -> None:
        """In the node's thread."""
        while not self._asked.empty():
            self._asked.get()()

    def _go(self, *place: float) -> None:
        if not self.matched:
            self._panel.say("no planner is heard; start one: ros2 run mhsb_planner planner_node")
            return
        self.send(*place)

    def _stop(self) -> None:
        ready = [client for client in self._stops if client.service_is_ready()]
        if not ready:
            self._panel.say("nobody is there to stop")
            return
        ready[0].call_async(Trigger.Request()).add_done_callback(
            lambda done: self._panel.say(f"stop: {done.result().message}")
        )

    def _set(self, changes: dict[str, Any]) -> None:
        if not self._settings.services_are_ready():
            self._panel.say("no planner is there to take its parameters")
            return
        wanted = [Parameter(name, value=value) for name, value in changes.items()]
        self._settings.set_parameters_atomically(wanted).add_done_callback(self._set_done)

    def _set_done(self, done: Any) -> None:
        result = done.result().result
        self._panel.say(
            "the planner took its parameters, for the next plan"
            if result.successful
            else f"the planner refused its parameters: {result.reason}"
        )
        self._settings_known = False  # shown again as they are

    def _show_abilities(self, velocities: bool, regions: bool) -> None:
        before, self._wanted = self._wanted, (velocities, regions)
        if not velocities:
            self._polytope.hide()
        if not regions:
            self._regions.hide()
        elif not before[1]:
            self._look_for_regions()

    def _look_for_regions(self) -> None:
        """In a thread of its own, since it takes seconds: what the planner's payload needs."""
        machine, payload = self._machine, self._payload

        def look() -> None:
            table = table_for(machine)
            needed = boost_regions(machine.changed(payload=payload).plane, table)
            places = (table.nodes * table.spacing).astype(np.float64)
            self._ask(functools.partial(self._show_regions, payload, places, needed))

        self._panel.say("looking at where boost is needed …")
        threading.Thread(target=look, daemon=True).start()

    def _show_regions(self, payload: float, places: FloatArray, needed: IntArray) -> None:
        if not self._wanted[1]:
            return
        if payload != self._payload:
            self._look_for_regions()
            return
        self._regions.show(places, needed)
        count = [int((needed == code).sum()) for code in range(BEYOND + 1)]
        self._panel.say(
            f"with {payload:g} kg, of {len(needed)} points {count[0]} need N alone, {count[1]} DB, "
            f"{count[2]} SB, for {count[3]} nothing will do"
        )

    # --- Heard -----------------------------------------------------------------------------------

    def _on_status(self, message: DiagnosticArray) -> None:
        try:
            reports = plan_status.decode(message)
        except MessageError as error:
            self._panel.say(f"plan_status is not understood: {error}")
            return
        for report in reports:
            self._panel.say(words_of(report))

    def _on_modes(self, message: UInt8MultiArray) -> None:
        try:
            self._modes = modes_in_force.decode(message, self._machine.joint_count)
        except MessageError as error:
            self.get_logger().warning(f"modes are not shown: {error}", throttle_duration_sec=10.0)

    def _on_markers(self, message: MarkerArray) -> None:
        self._markers.show(message)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        try:
            reports = sim_status.decode(message, self.get_namespace())
        except MessageError:
            return  # others speak on this topic, too
        for report in reports:
            if isinstance(report, SimulatorReport):
                self._flow.deliver(report.main_pump_j, report.servo_pumps_j)
                self._report = report

    def _hear_streams(self, wanted: bool) -> None:
        if wanted and not self._streams:
            self._streams = [self._kept(topic) for topic in STREAMS]
        elif not wanted and self._streams:
            for subscription in self._streams:
                self.destroy_subscription(subscription)
            self._streams = []
            self._newest.clear()
            self._flow = EnergyFlow()

    def _kept(self, topic: Topic) -> Any:
        """A subscription of which only the newest message is kept, as bytes, until it is shown."""

        def received(data: bytes) -> None:
            self._newest[topic.name] = data

        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        return endpoints.subscription(self, topic, received, newest, raw=True)

    # --- Shown -----------------------------------------------------------------------------------

    def _on_frame(self) -> None:
        self._hear_streams(bool(self._server.get_clients()))
        data = self._newest.pop(topics.JOINT_STATES.name, None)
        if data is None:
            return
        try:
            moment, speed = self._moment(data)
        except MessageError as error:
            self._panel.show_state(f"the arm is not understood: {error}")
            return
        with self._server.atomic():
            self._arm.show(moment.posture, moment.modes)
        self._frames += 1
        self._history.add(moment)
        if self._frames % FRAMES_PER_PLOT == 0:
            if self._wanted[0]:
                self._polytope.show(moment.posture, moment.modes)
            self._panel.show_state(self._state_words(moment, speed))
            self._plots.show(self._history.lines())

    def _moment(self, data: bytes) -> tuple[Moment, float]:
        """What the newest messages say, and the fastest joint's speed [rad/s]."""
        machine = self._machine
        message = deserialize_message(data, topics.JOINT_STATES.message)
        joints = joint_state.decode(message, machine.joint_names)
        pressure = np.full(machine.joint_count, np.nan)
        if data := self._newest.get(topics.ACTUATOR_STATES.name, b""):
            state = deserialize_message(data, topics.ACTUATOR_STATES.message)
            sample = actuator_states.decode(state, machine.actuator_names)
            pressure = sample.supply_pressure
            self._flow.use(sample, sample.stamp_ns / SECOND_NS)
        energy = self._flow.energies
        moment = Moment(
            joints.stamp_ns / SECOND_NS, joints.position, self._modes, pressure, energy
        )
        return moment, float(np.abs(joints.velocity).max())

    def _state_words(self, moment: Moment, speed: float) -> str:
        tip = zip(self._machine.axes, self._machine.tip_in_base(moment.posture), strict=True)
        where = ", ".join(f"{axis} {value:.3f} m" for axis, value in tip)
        words = f"{'moving' if speed > MOVING else 'at rest'}, tip at {where}"
        if self._report is not None and (self._report.faulty or self._report.warning):
            words += f"\n\n**{self._report.sentence}**"
        return words

    def _on_second(self) -> None:
        if not self._settings_known and self._settings.services_are_ready():
            self._settings_known = True
            self._settings.get_parameters(list(SETTINGS)).add_done_callback(self._show_settings)

    def _show_settings(self, done: Any) -> None:
        values = [parameter_value_to_python(value) for value in done.result().values]
        if len(values) == len(SETTINGS):
            settings = dict(zip(SETTINGS, values, strict=True))
            self._panel.show_settings(settings)
            if self._payload != settings["payload"]:
                self._payload = float(settings["payload"])
                if self._wanted[1]:
                    self._look_for_regions()
