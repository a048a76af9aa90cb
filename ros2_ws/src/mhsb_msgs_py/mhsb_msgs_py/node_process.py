"""Process of a node: start, spin, and a clean end on SIGINT or SIGTERM."""

import contextlib
import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node

from mhsb_model import process
from mhsb_model.errors import ArgumentError, MhsbError
from mhsb_msgs_py.guarded_executor import GuardedExecutor, QuietExecutor, suggest_parameter

MAX_WAIT = 0.5
"""Longest time between two wakes of the executor [s].

A signal may come just before the executor begins to wait.
"""

RELEASE_PERIOD = 10.0
"""Time between two returns of a node's free memory to the system [s].

Each takes 0.2 to 2 ms. The next plan takes up to 5 MB anew, so every second would be too often.
"""

LONGEST_DESTRUCTION = 5.0
"""Time in which a node must be destroyed, or its process ends with code 1 [s].

Fast DDS 2.14 may wait for ever for the end of a callback if another participant leaves at the same
moment. Fast DDS keeps Python's lock meanwhile, so that no signal could end the process."""

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Environment variable with the path of Fast DDS's profile."""

SHARED_MEMORY_LOCK = re.compile(r"/dev/shm/fastrtps_[0-9a-f]{16}_el")
"""Pattern of the lock files of Fast DDS's shared memory."""

NodeType = TypeVar("NodeType", bound=Node)


class RosArgumentsError(ArgumentError):
    """Error: the arguments after `--ros-args` cannot be used."""


class RosNameError(ArgumentError):
    """Error: ROS does not take a name of a topic, a service or a node."""


class RosError(MhsbError):
    """Error: ROS cannot make a node in this environment."""


def spin_node(make_node: Callable[[], Node]) -> int:
    """Make a node and serve it until a signal asks the process to end.

    The executor has one thread, and survives exceptions in callbacks (`guarded_executor`). A timer
    wakes the executor every `MAX_WAIT` seconds, so that no signal is missed. Another one returns
    free memory to the system every `RELEASE_PERIOD` seconds.

    Args:
        make_node: Function that makes the node.

    Returns:
        The exit code 0.

    Raises:
        RosArgumentsError: rclpy or the node's parameters refuse the arguments.
        RosError: ROS cannot make the node in this environment.
    """
    try:
        with (
            run_ros(),
            serve_node(make_node, GuardedExecutor) as (executor, node),
            process.grace_period(),
        ):
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            node.create_timer(MAX_WAIT, lambda: None, clock=steady)
            node.create_timer(RELEASE_PERIOD, process.release_free_memory, clock=steady)
            executor.spin()
    except ParameterException as error:
        raise RosArgumentsError(f"after --ros-args: {error}") from error
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    return 0


@contextmanager
def run_ros(arguments: list[str] | None = None) -> Iterator[None]:
    """Initialize rclpy, as a context manager, and shut it down at the end of the block.

    In the block, SIGINT shuts ROS down and does not raise KeyboardInterrupt. After the shutdown,
    calls of rclpy may fail in any way. So every exception except MhsbError is then replaced by
    ExternalShutdownException. If a signal ends the process by force, the shared-memory files of
    Fast DDS are deleted first.

    Args:
        arguments: Words of the command line; rclpy reads only the words after `--ros-args`. None
            takes the process's own.

    Raises:
        RosArgumentsError: rclpy refuses the arguments.
        RosError: The profile of Fast DDS cannot be read, or ROS_DOMAIN_ID cannot be used.
        ExternalShutdownException: A signal has shut ROS down.
    """
    _check_profile()
    interrupt = signal.signal(signal.SIGINT, _ignore_interrupt)
    process.register_final_action(_remove_shared_memory)
    _initialize(arguments)
    try:
        if process.signalled():  # before ROS could handle it
            raise ExternalShutdownException
        yield
    except MhsbError:
        raise
    except Exception:
        if rclpy.ok():
            raise
        # A signal shuts ROS down at any moment, and the next call then fails in its own way.
        raise ExternalShutdownException from None
    finally:
        rclpy.try_shutdown()
        signal.signal(signal.SIGINT, interrupt)


def _remove_shared_memory() -> None:
    """Delete the shared-memory files of Fast DDS that this process has open.

    Otherwise half a megabyte would remain after the end of the process. The files of this process
    are found by their lock files, which the process has open.
    """
    for descriptor in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):
            lock = descriptor.readlink()
            if SHARED_MEMORY_LOCK.fullmatch(str(lock)):
                lock.with_name(lock.name.removesuffix("_el")).unlink()
                lock.unlink()


def _ignore_interrupt(number: int, frame: object) -> None:
    """Do nothing on SIGINT, since ROS shuts itself down.

    Python's KeyboardInterrupt could be raised anywhere inside rclpy.
    """


@contextmanager
def serve_node(
    make_node: Callable[[], NodeType],
    make_executor: Callable[[], SingleThreadedExecutor] = QuietExecutor,
) -> Iterator[tuple[SingleThreadedExecutor, NodeType]]:
    """Make an executor and the node that it serves, as a context manager.

    The caller spins the executor. At the end of the block, the node is destroyed and the executor
    shut down. If destroying takes longer than `LONGEST_DESTRUCTION`, the process ends with code 1.
    A warning is logged for each parameter of the command line that the node does not have. The
    executor is made first, since ROS may be shut down while the node is made, and rclpy cannot make
    an executor after that.

    Args:
        make_node: Function that makes the node.
        make_executor: Function that makes the executor.

    Yields:
        The executor and the node.

    Raises:
        RosError: ROS refuses to make the node.
        RCLError: ROS has been shut down while the node was made.
    """
    executor = make_executor()
    try:
        try:
            node = make_node()
        except RCLError as error:
            if not rclpy.ok():
                raise
            raise RosError(f"ROS cannot make the node: {_remove_source_places(error)}") from error
        try:
            _warn_of_unknown_parameters(node)
            executor.add_node(node)
            yield executor, node
        finally:
            with process.time_limit(LONGEST_DESTRUCTION):
                node.destroy_node()
    finally:
        executor.shutdown()


@contextmanager
def run_command_node(
    make_node: Callable[[], NodeType],
) -> Iterator[tuple[SingleThreadedExecutor, NodeType]]:
    """Initialize rclpy and make the node of a command, as a context manager.

    The caller spins the executor.

    Args:
        make_node: Function that makes the node.

    Yields:
        The executor and the node.

    Raises:
        KeyboardInterrupt: A signal has shut ROS down.
        RosArgumentsError: rclpy refuses the arguments.
        RosNameError: The caller gives a name to the node that ROS does not take.
        RosError: ROS cannot make the node in this environment.
    """
    try:
        with run_ros(), serve_node(make_node) as (executor, node):
            yield executor, node
    except ExternalShutdownException:
        raise KeyboardInterrupt from None
    except NameValidationException as error:
        reason, name, _ = str(error).splitlines()  # the last line points at a character
        raise RosNameError(f"{reason[0].lower()}{reason[1:]} {name.strip()}") from None


def _warn_of_unknown_parameters(node: Node) -> None:
    """Log a warning for each parameter of the command line that the node does not have.

    rclpy ignores such parameters without a message. Names that begin with `qos_overrides.` are
    never reported.

    Args:
        node: The node.
    """
    for name in sorted(node._parameter_overrides):
        if node.has_parameter(name) or name.startswith("qos_overrides."):
            continue
        advice = suggest_parameter(node, name)
        node.get_logger().warning(f"there is no parameter {name}: it is ignored{advice}")


def spin_until(
    executor: SingleThreadedExecutor, condition: Callable[[], bool], timeout: float
) -> bool:
    """Serve the nodes of an executor until a condition holds or a timeout passes.

    Args:
        executor: The executor.
        condition: Function that returns whether the condition holds. It is called before each
            callback, and at least every 0.05 s.
        timeout: Longest time [s].

    Returns:
        True if the condition holds; False if the timeout passed first.
    """
    end = time.monotonic() + timeout
    while not condition():
        left = end - time.monotonic()
        if left <= 0:
            return False
        executor.spin_once(timeout_sec=min(left, 0.05))
    return True


def _check_profile() -> None:
    """Raise RosError if the environment names a profile of Fast DDS that cannot be read.

    Fast DDS would ignore a missing profile, and the node would then be open to the network.
    """
    profile = os.environ.get(PROFILE_VARIABLE)
    if profile and not os.access(profile, os.R_OK):
        raise RosError(
            f"{PROFILE_VARIABLE} names {profile}, which cannot be read; unset it, "
            "or source scripts/env.sh anew"
        )


def _remove_source_places(error: Exception) -> str:
    """Return the text of an error of ROS without the places in its source code."""
    return re.sub(r", at \S+:\d+", "", str(error))


def _initialize(arguments: list[str] | None) -> None:
    """Initialize rclpy, and turn its errors about bad arguments into one sentence.

    rclpy's own log line about such an error is suppressed.

    Args:
        arguments: Command line; None for the process's own.

    Raises:
        RosArgumentsError: rclpy refuses the arguments.
        RosError: ROS_DOMAIN_ID cannot be used.
    """
    set_logger_level("rcl", LoggingSeverity.FATAL)
    try:
        rclpy.init(args=arguments)
    except RuntimeError as error:
        reason = _remove_source_places(error).removeprefix("failed to initialize rcl: ")
        if reason.startswith("["):  # only a list of unknown arguments
            reason = f"unknown arguments {reason}"
        if "ROS_DOMAIN_ID" in reason:
            raise RosError(f"{reason}; give a number from 0 to 101, or unset it") from error
        raise RosArgumentsError(f"after --ros-args: {reason}") from error
    finally:
        set_logger_level("rcl", LoggingSeverity.UNSET)
