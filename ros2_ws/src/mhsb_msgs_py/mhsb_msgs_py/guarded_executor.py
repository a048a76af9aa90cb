"""Executor of the suite's nodes: a callback that fails does not end its node.

rclpy's executor raises every exception of a callback. If an exception occurs while a message is
taken, rclpy never frees the callback group again. This executor records each fault in the node's
`faults`. A client that waits for an answer gets one, and the node goes on.
"""

import functools
import threading
import warnings
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy._rclpy_pybind11 import RCLError
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor, await_or_execute
from rclpy.guard_condition import GuardCondition
from rclpy.node import Node
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Task

from mhsb_model.errors import suggest_name
from mhsb_msgs_py import stamps
from mhsb_msgs_py.errors import MessageError
from mhsb_msgs_py.faults import Faults, name_callback
from mhsb_msgs_py.parameters import describe_passed_range

MAX_EXECUTOR_FAULTS = 100
"""Number of faults of the executor itself in a row, without a served callback, that end the
process."""

MOST_CHANGES = 100
"""Largest number of parameters that one request may set, twice as many as a node has.

Each is checked together with all others, which takes some milliseconds. Nothing else is served
during that time.
"""

TOO_MANY = f"one request may set {MOST_CHANGES} parameters; send this one in another request"
"""Refusal of further parameters of a request."""

RESPONSE_ATTEMPTS, RESPONSE_PERIOD = 8, 0.2
"""Number of times that a response is sent until its client can receive it, and the time from one
attempt to the next [s].

A client may ask before the node has discovered that it listens for responses. ROS then waits for
0.1 s, and gives the response up. On a busy machine discovery can take longer.
"""

UNSENT_RESPONSE = "failed to send response"
"""Words of rclpy's warning that a client cannot receive a response yet."""

Execution = Callable[[], Coroutine[Any, Any, None]]
"""Coroutine function that executes a callback whose input has been taken."""


def get_faults(node: Node) -> Faults:
    """Return the record of a node's faults; create it if the node has none.

    Args:
        node: The node. A new record is stored as its attribute `faults`.

    Returns:
        The record.
    """
    if not hasattr(node, "faults"):
        node.faults = Faults(node)
    record: Faults = node.faults
    return record


class _QuietGuard:
    """Guard condition of an executor that does not wake it from its own thread.

    rclpy wakes an executor twice after each callback, for other threads that wait to execute
    callbacks of the same group. An executor of one thread would only gather all entities of its
    nodes once more, which takes 0.3 ms.
    """

    def __init__(self, guard: GuardCondition) -> None:
        """Store the executor's guard condition and the present thread, which serves it."""
        self._guard, self._thread = guard, threading.get_ident()

    def trigger(self) -> None:
        """Wake the executor if another thread calls this."""
        if threading.get_ident() != self._thread:
            self._guard.trigger()

    def __getattr__(self, name: str) -> Any:
        """Return everything else of the guard condition, such as `destroy`."""
        return getattr(self._guard, name)


class QuietExecutor(SingleThreadedExecutor):
    """Single-threaded executor that is not woken by the callbacks that it has executed itself."""

    _guard: GuardCondition

    def _make_handler(self, *arguments: Any) -> Task:
        """Make rclpy's task that executes a callback, and give it a guard that does not wake.

        Args:
            *arguments: Arguments of rclpy's method.

        Returns:
            The task.
        """
        guard, self._guard = self._guard, _QuietGuard(self._guard)
        try:
            return super()._make_handler(*arguments)
        finally:
            self._guard = guard


class GuardedExecutor(QuietExecutor):
    """Single-threaded executor that survives exceptions in the callbacks of its nodes."""

    def __init__(self) -> None:
        """Create the executor without nodes, and without failures in a row."""
        super().__init__()
        self._in_a_row = 0

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Serve one callback, and record an exception of a task or of the wait itself as a fault.

        In these cases the exception is raised again, which ends the process:

        - ROS has been shut down, or the executor has no node.
        - The type of the exception is in `Faults.ending_errors`.
        - It is exception number `MAX_EXECUTOR_FAULTS` in a row.

        Args:
            timeout_sec: Longest time to wait for work [s]; None waits without limit.
        """
        try:
            super().spin_once(timeout_sec)
        except Exception as error:
            self._in_a_row += 1
            nodes = self.get_nodes()
            if not nodes or self._in_a_row >= MAX_EXECUTOR_FAULTS:
                raise
            get_faults(nodes[0]).record_fault("a task of the node", error)
        else:
            self._in_a_row = 0

    def _make_handler(self, entity: Any, node: Node, take_from_wait_list: Any) -> Task:
        """Make the task that takes an entity's input and executes its callback.

        An exception while the input is taken, or in the callback, is recorded as a fault. A success
        ends the entity's count of faults in a row. Errors that are meant to end the node are
        raised, and after the end of ROS all errors are. Requests of services are taken by
        `_take_request`, and messages for the node's clock by `_take_clock`.
        All other input is taken by rclpy.

        Args:
            entity: Subscription, timer, service or other object that is ready.
            node: Node of the entity.
            take_from_wait_list: rclpy's function that takes the input of the entity.

        Returns:
            The task.
        """
        faults = get_faults(node)
        take = take_from_wait_list
        if isinstance(entity, Service):
            take = functools.partial(self._take_request, node)
        elif getattr(entity, "callback", None) == node._time_source.clock_callback:
            take = _take_clock

        def guarded_take(entity: Any) -> Execution | None:
            """Take the entity's input, and record an exception as a fault.

            Errors that are meant to end the node are raised.

            Args:
                entity: Object that the executor serves.

            Returns:
                Coroutine function that executes the callback. None if there is no input, or if
                taking it failed.
            """
            try:
                execute: Execution | None = take(entity)
            except Exception as error:
                faults.record_fault(name_callback(entity), error)
                return None
            return None if execute is None else functools.partial(guarded, execute)

        async def guarded(execute: Execution) -> None:
            """Execute the callback, and record its success or its exception.

            Errors that are meant to end the node are raised.

            Args:
                execute: Coroutine function that executes the callback.
            """
            try:
                await execute()
            except Exception as error:
                faults.record_fault(name_callback(entity), error)
            else:
                faults.record_success(entity)

        return super()._make_handler(entity, node, guarded_take)

    def _take_request(self, node: Node, service: Service) -> Execution | None:
        """Take a request from a service's queue, to be answered later.

        The request is answered even if the callback fails. An answer that cannot be sent is logged.

        Args:
            node: Node of the service.
            service: The service.

        Returns:
            Coroutine function that answers the request, or does nothing if the queue was empty.
            None if the service has been destroyed.
        """
        try:
            with service.handle:
                request, header = service.handle.service_take_request(service.srv_type.Request)
        except InvalidHandle:  # the service was destroyed
            return None

        async def execute() -> None:
            """Compute and send the response to the request that was taken.

            Nothing happens if the queue was empty.
            """
            if header is None:
                return
            response = await self._compute_response(node, service, request)
            _send_response(node, service, response, header, RESPONSE_ATTEMPTS)

        return execute

    async def _compute_response(self, node: Node, service: Service, request: Any) -> Any:
        """Compute the response of a service; if its callback fails, the response gives the reason.

        Services that set parameters are treated differently from others, and set at most
        `MOST_CHANGES` parameters. SetParameters sets its parameters one by one, and refuses all
        after the first `MOST_CHANGES`. SetParametersAtomically sets all at once, and refuses a
        longer request as a whole.

        Args:
            node: Node of the service.
            service: The service.
            request: The request.

        Returns:
            Response of the service. After a fault the response is empty. If it has the fields
            `success` and `message`, they are False and a sentence that names the fault.
        """
        response = service.srv_type.Response()
        if service.srv_type is SetParameters:
            for parameter in request.parameters[:MOST_CHANGES]:
                alone = SetParameters.Request(parameters=[parameter])
                given = await self._set_parameters(node, service, [parameter], alone)
                response.results.append(given)
            beyond = len(request.parameters) - len(response.results)
            response.results.extend([SetParametersResult(reason=TOO_MANY)] * beyond)
        elif service.srv_type is SetParametersAtomically:
            response.result = await self._set_parameters(node, service, request.parameters, request)
        else:
            try:
                return await await_or_execute(service.callback, request, response)
            except Exception as error:
                sentence = get_faults(node).record_fault(name_callback(service), error)
                response = service.srv_type.Response()
                if hasattr(response, "success") and hasattr(response, "message"):
                    response.success, response.message = False, sentence
        return response

    async def _set_parameters(
        self, node: Node, service: Service, parameters: Sequence[Parameter], request: Any
    ) -> SetParametersResult:
        """Set all parameters of a request, or none of them.

        The parameters are refused if there are more than `MOST_CHANGES`, or if the node refuses
        them. They are also refused if a parameter is unknown, has an unknown type, or would be
        deleted although it must not be. If a callback raises an exception, a fault is recorded and
        the node's parameters are restored.

        Args:
            node: Node of the parameters.
            service: The service that sets parameters.
            parameters: Parameters of the request.
            request: The same parameters as a request of the service's type. The service's callback
                gets this request, so it must not contain other parameters.

        Returns:
            The result. If the parameters are refused, its reason is one printable sentence.
        """
        reason = (
            _find_unusable_parameter(node, parameters)
            if len(parameters) <= MOST_CHANGES
            else TOO_MANY
        )
        if reason:
            return SetParametersResult(successful=False, reason=reason)
        before = dict(node._parameters)
        try:
            response = await await_or_execute(
                service.callback, request, service.srv_type.Response()
            )
        except Exception as error:
            node._parameters = before
            reason = get_faults(node).record_fault(name_callback(service), error)
            return SetParametersResult(successful=False, reason=reason)
        several = service.srv_type is SetParameters
        result = response.results[0] if several else response.result
        result.reason = str(MessageError(result.reason))
        return result


def _send_response(node: Node, service: Service, response: Any, header: Any, attempts: int) -> None:
    """Send a response, and repeat this every `RESPONSE_PERIOD` while its client cannot receive it.

    rclpy warns if the client cannot receive the response; there is no other sign. A failure of all
    attempts is logged. If sending raises an error, that is logged, and no further attempt follows.

    Args:
        node: Node of the service. A timer of the node makes the next attempt, so its callbacks are
            served meanwhile.
        service: The service.
        response: The response.
        header: Header of the request, which identifies the client.
        attempts: Number of attempts that are left, at least 1.
    """
    try:
        with warnings.catch_warnings(record=True) as told:  # other threads may warn meanwhile
            warnings.simplefilter("always")
            service.send_response(response, header)
        sentences = [str(each.message) for each in told]
        reason = next((each for each in sentences if UNSENT_RESPONSE in each), "")
    except (RCLError, InvalidHandle) as error:  # such as: the service was destroyed
        attempts, reason = 1, str(error)
    if not reason:
        return
    if attempts == 1:
        node.get_logger().warning(
            f"an answer of {name_callback(service)} could not be sent: {reason}",
            throttle_duration_sec=1.0,
        )
        return

    def send_again() -> None:
        """Make the next attempt, and remove the timer that has called this function."""
        node.destroy_timer(timer)
        _send_response(node, service, response, header, attempts - 1)

    steady = Clock(clock_type=ClockType.STEADY_TIME)  # time of the node may stand still
    timer = node.create_timer(RESPONSE_PERIOD, send_again, clock=steady)


def _take_clock(subscription: Subscription) -> Execution | None:
    """Take a message of /clock from its subscription, to be applied later.

    Args:
        subscription: Subscription of /clock.

    Returns:
        Coroutine function that sets the clock; None if there is no message.

    Raises:
        MessageError: The time is before 1970 or too late for later stamps to fit into a message.
    """
    with subscription.handle:
        taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    if taken is None:
        return None
    stamps.from_clock(taken[0].clock)

    async def execute() -> None:
        """Set the node's clock by the message."""
        subscription.callback(taken[0])

    return execute


def _find_unusable_parameter(node: Node, parameters: Sequence[Parameter]) -> str:
    """Return why parameters of a request cannot be set.

    A value is checked here only if it is a floating-point number with a range, because rclpy's own
    sentence would name no numbers. All other values are checked by rclpy.

    Args:
        node: Node of the parameters. Its attribute `deletable_parameters`, if it has one, lists
            those that may be deleted.
        parameters: Parameters of the request.

    Returns:
        One sentence about the first unusable parameter; empty if there is none. A parameter is
        unusable if it does not exist, has an unknown type or is out of range. It is also unusable
        if the request would delete it and it is not in `deletable_parameters`.
    """
    deletable = getattr(node, "deletable_parameters", ())
    for parameter in parameters:
        name, kind = parameter.name, parameter.value.type
        if not node.has_parameter(name):
            near = suggest_parameter(node, name)
            return str(MessageError(f"there is no parameter '{name}'{near}"))
        if kind > ParameterType.PARAMETER_STRING_ARRAY:
            return (
                f"{name} has a value of type {kind}; types are 1 (bool) to "
                f"{ParameterType.PARAMETER_STRING_ARRAY} (array of texts)"
            )
        if kind == ParameterType.PARAMETER_NOT_SET and name not in deletable:
            return f"{name} cannot be deleted; set it to another value"
        described = node.describe_parameter(name)
        if kind == ParameterType.PARAMETER_DOUBLE and described.floating_point_range:
            value, [limits] = parameter.value.double_value, described.floating_point_range
            least, greatest = limits.from_value, limits.to_value
            if not least <= value <= greatest:
                return describe_passed_range(name, value, described.description, least, greatest)
    return ""


def suggest_parameter(node: Node, name: str) -> str:
    """Return "; did you mean NAME?" for the most similar parameter; empty if none is similar.

    Args:
        node: Node of the parameters.
        name: Name that does not exist.
    """
    return suggest_name(name[:100], node._parameters)
