"""Doing things to running nodes, and keeping account of it."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.client import Client
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.types import Position
from mhsb_msgs_py import goal_pose, names
from mhsb_msgs_py.node_process import spin_until
from mhsb_planner.ros.zone_parameters import ZONES
from mhsb_sim.live.child_process import ChildProcess
from mhsb_sim.live.nodes import (
    PLANNER_EXECUTABLE,
    SIM_EXECUTABLE,
    START_TIMEOUT,
    ros_arguments,
    shake_hands,
)
from mhsb_sim.live.soak.events import PLANNER, SIM, Deed, DeedKind, Life
from mhsb_sim.live.watcher import Watcher

NODES = {PLANNER: (PLANNER_EXECUTABLE, names.PLANNER_NODE), SIM: (SIM_EXECUTABLE, names.SIM_NODE)}
SERVICES = ((PLANNER, "stop"), (SIM, "stop"), (SIM, "reset"), (SIM, "clear_faults"))
ANSWER_TIMEOUT = 5.0  # s
MEMORY_PERIOD = 1.0  # s


class Running:
    """A node's process while it lives."""

    def __init__(self, node: str, number: int, folder: Path, settings: tuple[str, ...]) -> None:
        """Start it, with settings NAME:=VALUE; its output goes to the folder."""
        self.node, self.number = node, number
        self.log = folder / f"{node}-{number}.log"
        self.process = ChildProcess(*NODES[node][0], *ros_arguments(settings), log=self.log)
        self.ready_ns = 0
        self.memory: list[tuple[int, int]] = []

    def look(self) -> None:
        """Look how much memory it has."""
        if size := self.process.resident_bytes:
            self.memory.append((time.time_ns(), size))

    def over(self, signal_number: int | None) -> Life:
        """End it by a signal, unless it has ended by itself; its life."""
        by_itself = self.process.exit_code is not None
        if signal_number == signal.SIGKILL:
            self.look()
        began = time.monotonic()
        code = self.process.end(signal_number or signal.SIGINT)
        lines = self.log.read_text(encoding="utf-8").splitlines()
        return Life(
            self.node,
            self.number,
            self.ready_ns,
            time.time_ns(),
            None if by_itself else signal_number,
            None if signal_number == signal.SIGKILL else code,
            time.monotonic() - began,
            traceback_in(lines),
            tuple(self.memory),
        )


def traceback_in(lines: list[str]) -> str | None:
    """The line that says what happened in the first traceback, None where there is none."""
    for index, line in enumerate(lines):
        if line.startswith("Traceback"):
            ends = (after for after in lines[index + 1 :] if not after.startswith(" "))
            return next(ends, line)
    return None


class Actor:
    """Starts and ends both nodes, sends and calls; every deed is written down."""

    def __init__(
        self,
        watcher: Watcher,
        executor: SingleThreadedExecutor,
        folder: Path,
        settings: tuple[str, ...] = (),
    ) -> None:
        """settings: NAME:=VALUE, of both nodes whenever they are started."""
        self._watcher, self._executor, self._folder = watcher, executor, folder
        self._settings = settings
        self._triggers = {
            (node, name): watcher.create_client(Trigger, f"{NODES[node][1]}/{name}")
            for node, name in SERVICES
        }
        self._setters = {
            node: watcher.create_client(
                SetParametersAtomically, f"{ros_name}/set_parameters_atomically"
            )
            for node, (_, ros_name) in NODES.items()
        }
        self._running: dict[str, Running] = {}
        self._numbers = dict.fromkeys(NODES, 0)
        self._looked = 0.0
        self.deeds: list[Deed] = []
        self.lives: list[Life] = []

    # --- Time ------------------------------------------------------------------------------------

    def wait(self, duration: float) -> None:
        """Listen for some time [s]."""
        self._until(lambda: False, duration)

    def _until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Listen until the condition holds; looks at memory and life on the way."""
        end = time.monotonic() + timeout
        while True:
            left = end - time.monotonic()
            if spin_until(self._executor, condition, min(left, 0.2)):
                return True
            self._look()
            if left <= 0.2:
                return False

    def _look(self) -> None:
        if time.monotonic() - self._looked < MEMORY_PERIOD:
            return
        self._looked = time.monotonic()
        for node, running in list(self._running.items()):
            running.look()
            if running.process.exit_code is not None:
                self.end(node, None)

    # --- Processes -------------------------------------------------------------------------------

    def start(self, node: str) -> None:
        """Start a node and wait until it is ready; MhsbError where it is not in time."""
        begin_ns = time.time_ns()
        self._numbers[node] += 1
        running = Running(node, self._numbers[node], self._folder, self._settings)
        self._running[node] = running

        def ended() -> bool:
            return running.process.exit_code is not None

        if not self._until(lambda: running.process.said("ready") or ended(), START_TIMEOUT):
            running.process.end(signal.SIGKILL)
            raise MhsbError(f"{running.log} did not become ready within {START_TIMEOUT:g} s")
        if node == PLANNER and not ended():
            shake_hands(self._watcher, self._executor)
        running.ready_ns = time.time_ns()
        self._note(DeedKind.START, node, begin_ns)

    def end(self, node: str, signal_number: int | None) -> None:
        """End a node by a signal; None where it has ended by itself."""
        if node not in self._running:
            return
        begin_ns = time.time_ns()
        self.lives.append(self._running.pop(node).over(signal_number))
        self._note(DeedKind.END, node, begin_ns, signal_number)

    def end_all(self) -> None:
        """End what still runs, cleanly."""
        for node in list(self._running):
            self.end(node, signal.SIGINT)

    def missing(self) -> list[str]:
        """Nodes that do not run."""
        return [node for node in NODES if node not in self._running]

    def freeze(self, node: str, duration: float, meanwhile: Callable[[], None]) -> None:
        """Stop a process for a time [s], and let it go on."""
        begin_ns, process = time.time_ns(), self._running[node].process
        process.send(signal.SIGSTOP)
        try:
            meanwhile()
            self.wait(duration - (time.time_ns() - begin_ns) / 1e9)
        finally:
            process.send(signal.SIGCONT)
        self._note(DeedKind.FREEZE, node, begin_ns)

    # --- Messages, services, parameters ----------------------------------------------------------

    def goal(self, position: Position) -> None:
        """Send a goal."""
        self.message(goal_pose.encode(Goal.at(time.time_ns(), position)))

    def message(self, message: PoseStamped) -> None:
        """Send a goal as it is."""
        begin_ns = time.time_ns()
        self._note(DeedKind.GOAL, PLANNER, begin_ns, self._watcher.send_message(message))

    def trigger(self, kind: DeedKind, node: str, service: str, value: Any = None) -> None:
        """Call a service without arguments."""
        begin_ns = time.time_ns()
        answer = self._call(self._triggers[node, service], Trigger.Request())
        self._note(kind, node, begin_ns, value, answer is not None and answer.success)

    def zones(self, zones: Zones) -> None:
        """Replace the planner's zones."""
        arrays = {
            name: [number for zone in getattr(zones, each.field) for number in zone]
            for name, each in ZONES.items()
        }
        parameters = [
            Parameter(name, Parameter.Type.DOUBLE_ARRAY, value) for name, value in arrays.items()
        ]
        self._set(DeedKind.ZONES, PLANNER, parameters, zones)

    def parameter(self, kind: DeedKind, node: str, name: str, value: Any) -> None:
        """Set one parameter."""
        self._set(kind, node, [Parameter(name, value=value)], value)

    def _set(
        self, kind: DeedKind, node: str, parameters: Iterable[Parameter], value: Any
    ) -> None:
        begin_ns = time.time_ns()
        messages: list[ParameterMessage] = [each.to_parameter_msg() for each in parameters]
        request = SetParametersAtomically.Request(parameters=messages)
        answer = self._call(self._setters[node], request)
        taken = answer is not None and answer.result.successful
        self._note(kind, node, begin_ns, value, taken)

    def _call(self, client: Client, request: Any) -> Any:
        """The answer, None where there is none in time."""
        if not self._until(client.service_is_ready, ANSWER_TIMEOUT):
            return None
        future = client.call_async(request)
        if not self._until(future.done, ANSWER_TIMEOUT):
            client.remove_pending_request(future)
            return None
        return future.result()

    def _note(
        self, kind: DeedKind, node: str, begin_ns: int, value: Any = None, done: bool = True
    ) -> None:
        self.deeds.append(Deed(kind, node, begin_ns, time.time_ns(), value, done))


def spoilt_goal(random: np.random.Generator, machine: Machine) -> PoseStamped:
    """A goal that cannot be accepted: not finite, in a strange frame, out of reach, or beside the
    plane of an arm that has but one."""
    size = machine.scale
    x, z = size * random.uniform(0.3, 0.9), size * random.uniform(-0.5, 0.5)
    message = goal_pose.encode(Goal.at(time.time_ns(), (x, 0.0, z) if machine.slews else (x, z)))
    match random.integers(4):
        case 0:
            message.pose.position.x = math.nan
        case 1:
            message.header.frame_id = "map"
        case 2:
            message.pose.position.x = 3.0 * size
        case _:
            message.pose.position.y = 3.0 * size if machine.slews else 0.5
    return message
