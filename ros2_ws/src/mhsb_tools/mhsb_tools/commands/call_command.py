"""`call`: call a service without arguments, such as `~/stop`, as `ros2 service call` does."""

import json as json_format
from typing import Annotated

import tyro
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from mhsb_model import command_line
from mhsb_model.command_line import NumberRange
from mhsb_model.errors import MhsbError
from mhsb_msgs_py import qos
from mhsb_msgs_py.node_process import run_command_node, spin_until

TRIGGER_TYPE = "std_srvs/srv/Trigger"
"""Type of the services that can be called."""


class ServiceError(MhsbError):
    """A service does not exist, gives no answer, or has refused."""


def call(
    service: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SERVICE")],
    timeout: Annotated[float, tyro.conf.arg(metavar="S"), NumberRange(0.0, 1e6)] = 10.0,
    json: bool = False,
) -> None:
    """Call a service without arguments and print its answer; exit code 1 if it refuses.

    `mhsb_planner/stop` stops the arm along its plan. `mhsb_sim/stop` stops any motion of the arm.
    `mhsb_sim/clear_faults` resets faults, `mhsb_sim/reset` puts the arm back to its start.

    Args:
        service: Name of the service, such as mhsb_planner/stop.
        timeout: How long to wait for the service, and again for its answer [s].
        json: Print the answer as a JSON object with success and message.

    Raises:
        ServiceError: There is no such service, it gives no answer in time, or it refuses.
        RosNameError: ROS does not take the name of the service.
        RosError: ROS cannot make a node in this environment.
    """
    with run_command_node(lambda: Node("mhsb_call")) as (executor, node):
        answer = _call_trigger(node, executor, service, timeout)
    if json:
        print(json_format.dumps({"success": answer.success, "message": answer.message}))
    elif answer.success:
        print(answer.message)
    if not answer.success:
        raise ServiceError(f"{service} has refused: {answer.message}")


def _call_trigger(
    node: Node, executor: SingleThreadedExecutor, service: str, timeout: float
) -> Trigger.Response:
    """Call a service of type std_srvs/srv/Trigger and wait for the answer.

    Args:
        node: Node of this process.
        executor: Executor that serves `node`; it spins during the wait.
        service: Name of the service.
        timeout: Longest wait for the service, and then for its answer, each [s].

    Returns:
        The answer, also if the service refuses (`success` is False).

    Raises:
        ServiceError: There is no such service, or no answer in time.
    """
    client = node.create_client(Trigger, service, qos_profile=qos.SERVICE)
    if not spin_until(executor, client.service_is_ready, timeout):
        asked = node.resolve_service_name(service)  # listed, because this client waits for it
        known = [
            name
            for name, types in node.get_service_names_and_types()
            if TRIGGER_TYPE in types and name != asked
        ]
        there = f"there are {', '.join(sorted(known))}" if known else "no node runs"
        raise ServiceError(f"no service {service} within {timeout:g} s; {there} in this ROS domain")
    answer = client.call_async(Trigger.Request())
    if not spin_until(executor, answer.done, timeout):
        raise ServiceError(f"{service} gave no answer within {timeout:g} s")
    return answer.result()


main = command_line.make_main(call, node=True)
