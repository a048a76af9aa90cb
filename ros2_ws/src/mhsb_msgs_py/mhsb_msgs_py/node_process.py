"""How every node of the suite lives: start, spin, and a clean end on SIGINT or SIGTERM."""

from __future__ import annotations

import contextlib
import difflib
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
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node

from mhsb_model import process
from mhsb_model.errors import ArgumentError, MhsbError

HEARTBEAT = 0.5
"""The executor wakes at least this often [s]: a signal may come just before it begins to wait."""

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"

SHARED_MEMORY_LOCK = re.compile(r"/dev/shm/fastrtps_[0-9a-f]{16}_el")

NodeType = TypeVar("NodeType", bound=Node)


class RosArgumentsError(ArgumentError):
    """What follows `--ros-args` cannot be used."""


class RosError(MhsbError):
    """ROS cannot make a node in this environment."""


def spin_node(make_node: Callable[[], Node], arguments: list[str] | None = None) -> int:
    """Make a node and serve it until it is asked to end; returns the exit code 0.

    `arguments` are the process's own by default; rclpy takes what stands after `--ros-args`.
    The executor is the single-threaded one: the others starve timers or lose messages.
    Raises RosArgumentsError for arguments that rclpy or the node's parameters refuse.
    """
    try:
        with ros_running(arguments), serving(make_node) as (executor, node), process.orderly():
            node.create_timer(HEARTBEAT, _nothing, clock=Clock(clock_type=ClockType.STEADY_TIME))
            executor.spin()
    except ParameterException as error:
        raise RosArgumentsError(f"after --ros-args: {error}") from error
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    return 0


def _nothing() -> None:
    """What a timer does that only wakes."""


@contextmanager
def ros_running(arguments: list[str] | None = None) -> Iterator[None]:
    """rclpy for the length of a block.

    Raises RosArgumentsError as `spin_node` does, RosError where its environment is not as it
    should be, and ExternalShutdownException where a signal has shut ROS down meanwhile.
    """
    _check_profile()
    interrupt = signal.signal(signal.SIGINT, _leave_it_to_ros)
    process.before_an_end_at_once(_remove_shared_memory)
    _initialize(arguments)
    try:
        if process.signalled():  # before ROS was there to hear it
            raise ExternalShutdownException
        yield
    except MhsbError:
        raise
    except Exception:
        if rclpy.ok():
            raise
        # A signal shuts ROS down at any moment; whichever call comes next fails in its own way.
        raise ExternalShutdownException from None
    finally:
        rclpy.try_shutdown()
        signal.signal(signal.SIGINT, interrupt)


def _remove_shared_memory() -> None:
    """Of Fast DDS: what this process has shared with others, half a megabyte, would stay for good.

    Whose it is tells the lock that its owner holds.
    """
    for descriptor in Path("/proc/self/fd").iterdir():
        with contextlib.suppress(OSError):
            lock = descriptor.readlink()
            if SHARED_MEMORY_LOCK.fullmatch(str(lock)):
                lock.with_name(lock.name.removesuffix("_el")).unlink()
                lock.unlink()


def _leave_it_to_ros(number: int, frame: object) -> None:
    """In place of KeyboardInterrupt, which could hit rclpy anywhere: ROS itself shuts down."""


@contextmanager
def serving(make_node: Callable[[], NodeType]) -> Iterator[tuple[SingleThreadedExecutor, NodeType]]:
    """An executor and the node that it serves, for the length of a block.

    The executor comes first: rclpy cannot make one, nor drop it silently, after a shutdown.
    Raises RosError where ROS refuses to make the node.
    """
    executor = SingleThreadedExecutor()
    try:
        try:
            node = make_node()
        except RCLError as error:
            if not rclpy.ok():
                raise
            raise RosError(f"ROS cannot make the node: {_without_places(error)}") from error
        try:
            _warn_of_unknown_parameters(node)
            executor.add_node(node)
            yield executor, node
        finally:
            node.destroy_node()
    finally:
        executor.shutdown()


def _warn_of_unknown_parameters(node: Node) -> None:
    """rclpy drops what is set from outside and not declared without a word.

    It tells neither what was set nor what is declared but by these two attributes.
    """
    for name in sorted(node._parameter_overrides):
        if node.has_parameter(name) or name.startswith("qos_overrides."):
            continue
        declared = sorted(node._parameters)
        near = difflib.get_close_matches(name, declared, 1)
        advice = f"; did you mean {near[0]}?" if near else ""
        node.get_logger().warning(f"there is no parameter {name}: it is ignored{advice}")


def spin_until(
    executor: SingleThreadedExecutor, condition: Callable[[], bool], timeout: float
) -> bool:
    """Serve until the condition holds; False where it does not within `timeout` s."""
    end = time.monotonic() + timeout
    while not condition():
        left = end - time.monotonic()
        if left <= 0:
            return False
        executor.spin_once(timeout_sec=min(left, 0.05))
    return True


def _check_profile() -> None:
    """Fast DDS would go on without its profile, and so be open to the network."""
    profile = os.environ.get(PROFILE_VARIABLE)
    if profile and not os.access(profile, os.R_OK):
        raise RosError(
            f"{PROFILE_VARIABLE} names {profile}, which cannot be read; unset it, "
            "or source scripts/env.sh anew"
        )


def _without_places(error: Exception) -> str:
    """What ROS says, without where in its sources."""
    return re.sub(r", at \S+:\d+", "", str(error))


def _initialize(arguments: list[str] | None) -> None:
    """`rclpy.init`, which otherwise tells of bad arguments in a log line and a traceback."""
    set_logger_level("rcl", LoggingSeverity.FATAL)
    try:
        rclpy.init(args=arguments)
    except RuntimeError as error:
        reason = _without_places(error).removeprefix("failed to initialize rcl: ")
        if reason.startswith("["):  # nothing but a list of what is not known
            reason = f"unknown arguments {reason}"
        if "ROS_DOMAIN_ID" in reason:
            raise RosError(f"{reason}; give a number from 0 to 101, or unset it") from error
        raise RosArgumentsError(f"after --ros-args: {reason}") from error
    finally:
        set_logger_level("rcl", LoggingSeverity.UNSET)
