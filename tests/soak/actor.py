"""Actor: acts on running nodes and keeps a record of each action."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.message_watcher import MessageWatcher
from benchmarks.processor_load import read_resident_bytes
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.client import Client
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from tests.soak.events import PLANNER, SIM, ActionKind, ActionRecord, ProcessLife

from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.machine import Machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.types import Position
from mhsb_msgs_py import goal_pose, names
from mhsb_msgs_py.node_process import spin_until
from mhsb_planner.ros.zone_parameters import ZONE_PARAMETERS
from mhsb_tools.live.child_process import ChildEndedError, ChildProcess
from mhsb_tools.live.nodes import (
    PLANNER_EXECUTABLE,
    SIM_EXECUTABLE,
    START_TIMEOUT,
    ros_arguments,
    wait_for_planner_answer,
)

NODES = {PLANNER: (PLANNER_EXECUTABLE, names.PLANNER_NODE), SIM: (SIM_EXECUTABLE, names.SIM_NODE)}
"""Executable and ROS name of each node."""
SERVICES = ((PLANNER, "stop"), (SIM, "stop"), (SIM, "reset"), (SIM, "clear_faults"))
"""Services that are called, by node and name."""
ANSWER_TIMEOUT = 5.0
"""Time in which a service must be there, and must answer [s]."""
MEMORY_PERIOD = 1.0
"""Time between readings of memory [s]."""


class LoggedProcess(ChildProcess):
    """Child process whose whole output is written to a file, which is replaced if it exists."""

    def __init__(self, log: Path, package: str, executable: str, *arguments: str) -> None:
        """Start an executable.

        Args:
            log: File for the output.
            package: Python package of the executable.
            executable: Name of the executable.
            arguments: Command-line arguments.
        """
        self._log = log
        log.write_text("", encoding="utf-8")
        super().__init__(package, executable, *arguments)

    def keep_line(self, line: str) -> None:
        """Write a line to the file, and keep it."""
        with self._log.open("a", encoding="utf-8") as file:
            file.write(line)
        super().keep_line(line)


class NodeProcess:
    """Process of a node while it runs."""

    def __init__(self, node: str, number: int, folder: Path, settings: tuple[str, ...]) -> None:
        """Start the process.

        Args:
            node: `PLANNER` or `SIM`.
            number: Number of the node's process, from 1.
            folder: Folder for the file with its output.
            settings: Parameters `NAME:=VALUE`.
        """
        self.node, self.number = node, number
        self.log = folder / f"{node}-{number}.log"
        self.process = LoggedProcess(self.log, *NODES[node][0], *ros_arguments(settings))
        self.ready_ns = 0
        self.memory: list[tuple[int, int]] = []

    def read_memory(self) -> None:
        """Append the process's present memory to `memory`, if it can be read."""
        if size := read_resident_bytes(self.process.pid):
            self.memory.append((time.time_ns(), size))

    def end(self, signal_number: int | None) -> ProcessLife:
        """End the process by a signal, unless it has ended by itself.

        Args:
            signal_number: Signal to send; None sends SIGINT if it still runs.

        Returns:
            Record of the process's life.
        """
        by_itself = self.process.exit_code is not None
        if signal_number == signal.SIGKILL:
            self.read_memory()
        began = time.monotonic()
        code = self.process.end(signal_number or signal.SIGINT)
        lines = self.log.read_text(encoding="utf-8").splitlines()
        return ProcessLife(
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
    """Return the line that names the error of the first traceback.

    Args:
        lines: Output of a process.

    Returns:
        The first line after `Traceback` that is not indented; None if there is no traceback.
    """
    for index, line in enumerate(lines):
        if line.startswith("Traceback"):
            ends = (after for after in lines[index + 1 :] if not after.startswith(" "))
            return next(ends, line)
    return None


class Actor:
    """Acts on both nodes and records each action.

    Attributes:
        actions: Actions so far.
        lives: Processes that have ended.
    """

    def __init__(
        self,
        watcher: MessageWatcher,
        executor: SingleThreadedExecutor,
        folder: Path,
        settings: tuple[str, ...] = (),
    ) -> None:
        """Create clients of all services that are called.

        Args:
            watcher: Node that sends goals and records reports.
            executor: Executor of that node.
            folder: Folder for the output of the processes.
            settings: Parameters `NAME:=VALUE` of both nodes at each start.
        """
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
        self._running: dict[str, NodeProcess] = {}
        self._numbers = dict.fromkeys(NODES, 0)
        self._looked = 0.0
        self.actions: list[ActionRecord] = []
        self.lives: list[ProcessLife] = []

    # --- Time ------------------------------------------------------------------------------------

    def wait(self, duration: float) -> None:
        """Receive messages for some time [s]."""
        self._until(lambda: False, duration)

    def _until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Receive messages until a condition holds.

        During the wait the memory of the processes is read, and processes that ended are noted.

        Args:
            condition: Function to test.
            timeout: Largest time [s].

        Returns:
            False if the condition did not hold in time.
        """
        end = time.monotonic() + timeout
        while True:
            left = end - time.monotonic()
            if spin_until(self._executor, condition, min(left, 0.2)):
                return True
            self._read_processes()
            if left <= 0.2:
                return False

    def _read_processes(self) -> None:
        """Read the memory of all processes, and note those that ended; at most once a second."""
        if time.monotonic() - self._looked < MEMORY_PERIOD:
            return
        self._looked = time.monotonic()
        for node, running in list(self._running.items()):
            running.read_memory()
            if running.process.exit_code is not None:
                self.end(node, None)

    # --- Processes -------------------------------------------------------------------------------

    def start(self, node: str) -> None:
        """Start a node and wait until it is ready.

        A planner is also sent a goal. The action counts as done unless the goal gets no answer.

        Args:
            node: `PLANNER` or `SIM`.

        Raises:
            MhsbError: The node is not ready in time.
        """
        begin_ns = time.time_ns()
        self._numbers[node] += 1
        running = NodeProcess(node, self._numbers[node], self._folder, self._settings)
        self._running[node] = running

        def ended() -> bool:
            return running.process.exit_code is not None

        def is_ready() -> bool:
            return running.log.exists() and "ready" in running.log.read_text(encoding="utf-8")

        if not self._until(lambda: is_ready() or ended(), START_TIMEOUT):
            running.process.end(signal.SIGKILL)
            raise MhsbError(f"{running.log} did not become ready within {START_TIMEOUT:g} s")
        is_reached = True
        if node == PLANNER and not ended():
            try:
                wait_for_planner_answer(self._watcher, self._executor)
            except ChildEndedError:
                is_reached = False
        running.ready_ns = time.time_ns()
        self._record_action(ActionKind.START, node, begin_ns, done=is_reached)

    def end(self, node: str, signal_number: int | None) -> None:
        """End a node's process and record its life; does nothing if the node does not run.

        Args:
            node: `PLANNER` or `SIM`.
            signal_number: Signal to send; None if it has ended by itself.
        """
        if node not in self._running:
            return
        begin_ns = time.time_ns()
        self.lives.append(self._running.pop(node).end(signal_number))
        self._record_action(ActionKind.END, node, begin_ns, signal_number)

    def end_all(self) -> None:
        """End all running processes by SIGINT."""
        for node in list(self._running):
            self.end(node, signal.SIGINT)

    def list_missing(self) -> list[str]:
        """Return the nodes that do not run."""
        return [node for node in NODES if node not in self._running]

    def freeze(self, node: str, duration: float, while_frozen: Callable[[], None]) -> None:
        """Stop a process by SIGSTOP for some time, then let it continue.

        Args:
            node: `PLANNER` or `SIM`.
            duration: Time for which it is stopped [s].
            while_frozen: Called once while it is stopped.
        """
        begin_ns, process = time.time_ns(), self._running[node].process
        process.send(signal.SIGSTOP)
        try:
            while_frozen()
            self.wait(duration - (time.time_ns() - begin_ns) / 1e9)
        finally:
            process.send(signal.SIGCONT)
        self._record_action(ActionKind.FREEZE, node, begin_ns)

    # --- Messages, services, parameters ----------------------------------------------------------

    def send_goal(self, position: Position) -> None:
        """Send a goal stamped with the present system time."""
        self.send_message(goal_pose.encode(Goal.at(time.time_ns(), position)))

    def send_message(self, message: PoseStamped) -> None:
        """Send a goal message unchanged."""
        begin_ns = time.time_ns()
        self._record_action(ActionKind.GOAL, PLANNER, begin_ns, self._watcher.send_message(message))

    def call_trigger(self, kind: ActionKind, node: str, service: str, value: Any = None) -> None:
        """Call a service without arguments and record the action.

        Args:
            kind: Kind of the action.
            node: Node that has the service.
            service: Name of the service.
            value: Value to record with the action.
        """
        begin_ns = time.time_ns()
        answer = self._call(self._triggers[node, service], Trigger.Request())
        self._record_action(kind, node, begin_ns, value, answer is not None and answer.success)

    def set_zones(self, zones: Zones) -> None:
        """Replace the planner's zones through its parameters.

        Args:
            zones: The new zones.
        """
        arrays = {
            name: [number for zone in getattr(zones, field) for number in zone]
            for name, field in ZONE_PARAMETERS.items()
        }
        parameters = [
            Parameter(name, Parameter.Type.DOUBLE_ARRAY, value) for name, value in arrays.items()
        ]
        self._set(ActionKind.ZONES, PLANNER, parameters, zones)

    def set_parameter(self, kind: ActionKind, node: str, name: str, value: Any) -> None:
        """Set one parameter and record the action.

        Args:
            kind: Kind of the action.
            node: Node that has the parameter.
            name: Name of the parameter.
            value: New value.
        """
        self._set(kind, node, [Parameter(name, value=value)], value)

    def set_invalid_parameter(self, node: str, kind: int) -> None:
        """Ask a node to set its payload to a value of unknown type, or to delete it.

        The action counts as done if the node refuses.

        Args:
            node: `PLANNER` or `SIM`.
            kind: Number of the type; 0 deletes.
        """
        begin_ns = time.time_ns()
        strange = ParameterMessage(name="payload", value=ParameterValue(type=kind))
        request = SetParametersAtomically.Request(parameters=[strange])
        # ROS may still list the service of a killed process and send the request there. The second
        # request reaches the new process.
        setter = self._setters[node]
        answer = self._call(setter, request) or self._call(setter, request)
        refused = answer is not None and not answer.result.successful
        self._record_action(ActionKind.STRANGE, node, begin_ns, kind, refused)

    def _set(
        self, kind: ActionKind, node: str, parameters: Iterable[Parameter], value: Any
    ) -> None:
        """Set parameters in one call and record the action.

        Args:
            kind: Kind of the action.
            node: Node that has the parameters.
            parameters: The parameters.
            value: Value to record with the action.
        """
        begin_ns = time.time_ns()
        messages: list[ParameterMessage] = [each.to_parameter_msg() for each in parameters]
        request = SetParametersAtomically.Request(parameters=messages)
        answer = self._call(self._setters[node], request)
        taken = answer is not None and answer.result.successful
        self._record_action(kind, node, begin_ns, value, taken)

    def _call(self, client: Client, request: Any) -> Any:
        """Call a service.

        Args:
            client: Client of the service.
            request: Request message.

        Returns:
            The answer; None if there is none within `ANSWER_TIMEOUT`, or no such service.
        """
        if not self._until(client.service_is_ready, ANSWER_TIMEOUT):
            return None
        future = client.call_async(request)
        if not self._until(future.done, ANSWER_TIMEOUT):
            client.remove_pending_request(future)
            return None
        return future.result()

    def _record_action(
        self, kind: ActionKind, node: str, begin_ns: int, value: Any = None, done: bool = True
    ) -> None:
        """Record an action that ends at the present time.

        Args:
            kind: Kind of the action.
            node: Node on which it acted.
            begin_ns: System time of its beginning [ns].
            value: Value to record with the action.
            done: Whether it was answered and not refused.
        """
        self.actions.append(ActionRecord(kind, node, begin_ns, time.time_ns(), value, done))


def make_invalid_goal(random: np.random.Generator, machine: Machine) -> PoseStamped:
    """Return a goal message that the planner must refuse.

    It is not finite, in an unknown frame, out of reach, or beside the plane of an arm that does not
    slew.

    Args:
        random: Generator of random numbers; advanced.
        machine: The arm.

    Returns:
        The message.
    """
    size = machine.relative_size
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
