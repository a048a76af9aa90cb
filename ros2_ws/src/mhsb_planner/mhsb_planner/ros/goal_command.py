"""Command `goal`: sends one goal to a running planner and prints the verdict and the result."""

import json as json_format
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Annotated

import tyro
from rclpy.executors import SingleThreadedExecutor

from mhsb_model import command_line
from mhsb_model.command_line import NumberRange
from mhsb_model.types import Position
from mhsb_model.verdict import ExecutionReport, GoalVerdict, Outcome, Verdict
from mhsb_msgs_py.node_process import run_command_node, spin_until
from mhsb_planner.goal_region import WIDEST_ANGLE
from mhsb_planner.ros.goal_sender import GoalSender

EXIT_ACCEPTED, EXIT_REFUSED, EXIT_NO_ANSWER = 0, 1, 3
"""Exit codes: goal accepted or reached; refused, superseded or not reached; no answer in time."""

SEND_AGAIN_AFTER_NO_STATE = 1.0
"""Time after a verdict NO_STATE until the goal is sent again [s]."""

POSITION_RANGE, TOLERANCE_RANGE = NumberRange(-1e4, 1e4, "m"), NumberRange(0.0, 2.0, "m")
ANGLE_RANGE = NumberRange(-WIDEST_ANGLE, WIDEST_ANGLE, "rad")
"""Ranges of the options: positions and distances [m], angles [rad]."""


def goal(
    place: Annotated[
        Position, tyro.conf.Positional, tyro.conf.arg(metavar="X [Y] Z"), POSITION_RANGE
    ],
    tolerance: Annotated[float | None, tyro.conf.arg(metavar="M"), TOLERANCE_RANGE] = None,
    psi_range: Annotated[
        tuple[float, float] | None, tyro.conf.arg(metavar="LOW HIGH"), ANGLE_RANGE
    ] = None,
    wait: bool = False,
    timeout: Annotated[float, tyro.conf.arg(metavar="S"), NumberRange(1e-3, 1e6)] = 10.0,
    json: bool = False,
) -> int:
    """Send the tip to (X, Z), or (X, Y, Z) for an arm that slews, and print the verdict.

    Exit code 0: accepted (with --wait: reached), 1: refused, superseded or not reached, 3: no
    answer in time. While the planner does not know where the arm is (NO_STATE), the goal is sent
    again until the timeout. Tolerance and angle range are set as parameters of the planner and stay
    until they are changed (goal_tolerance, goal_psi_min, goal_psi_max). The parameters goal_segment
    and goal_box of the planner admit other goals.

    Args:
        place: X forward, Y to the left and Z up from the base [m]; Y is 0 if it is left out.
        tolerance: Distance from the goal at which the tip may end as well [m]; 0 for the exact
            goal. When left out, the planner's parameter stays.
        psi_range: Least and greatest angle of the end link at the goal, from the horizontal,
            positive upwards [rad]; a whole turn, such as 0 6.3, leaves it free. When left out, the
            planner's parameters stay.
        wait: Also wait until the motion has ended.
        timeout: How long to wait for a planner, and again for its answer [s].
        json: Print the verdict, and with --wait the execution report, as one JSON object.

    Returns:
        The exit code.
    """
    if len(place) not in (2, 3):
        given = " ".join(f"{value:g}" for value in place)
        raise command_line.UsageError(f"give X Z or X Y Z [m], not {given or 'nothing'}")
    if psi_range is not None and not psi_range[0] <= psi_range[1]:
        low, high = psi_range
        raise command_line.UsageError(
            f"--psi-range takes the least and the greatest angle, not {low:g} and {high:g}"
        )
    command_line.set_interrupt_note("no goal was sent")
    say = (lambda line: None) if json else partial(print, flush=True)
    with run_command_node(GoalSender) as (executor, sender):
        changes = _collect_parameter_changes(tolerance, psi_range)
        answer = _send_and_wait(sender, executor, place, changes, wait, timeout, say)
    if answer.trouble:
        say(answer.trouble)
    if json:
        print(json_format.dumps(asdict(answer) | {"trouble": answer.trouble or None}))
    return answer.exit_code


@dataclass(frozen=True)
class CommandResult:
    """Result of the command `goal`.

    Attributes:
        exit_code: Exit code of the process.
        trouble: Sentence on why the verdict or the execution report is missing; empty if neither is
            missing.
        verdict: The planner's verdict on the goal; None if it is missing.
        execution: The execution report; None if it is missing or was not waited for.
    """

    exit_code: int
    trouble: str = ""
    verdict: GoalVerdict | None = None
    execution: ExecutionReport | None = None


def _collect_parameter_changes(
    tolerance: float | None, psi_range: tuple[float, float] | None
) -> dict[str, float]:
    """Collect the parameters of the planner to change for a tolerance and an angle range.

    Args:
        tolerance: Value for `goal_tolerance` [m]; None leaves the parameter as it is.
        psi_range: Values for `goal_psi_min` and `goal_psi_max`, bounds of the end link's angle
            [rad]. None leaves these parameters as they are.

    Returns:
        New values by parameter name; empty if both arguments are None.
    """
    changes = {} if tolerance is None else {"goal_tolerance": tolerance}
    if psi_range is not None:
        changes |= {"goal_psi_min": psi_range[0], "goal_psi_max": psi_range[1]}
    return changes


def _send_and_wait(
    sender: GoalSender,
    executor: SingleThreadedExecutor,
    place: Position,
    changes: dict[str, float],
    wait: bool,
    timeout: float,
    say: Callable[[str], None],
) -> CommandResult:
    """Set the planner's parameters, send the goal, and wait for its verdict and its report.

    The steps are: find a planner, set the parameters, get the verdict, and wait for the end of the
    motion. If the planner refuses parameters, the goal is not sent. Each step may take `timeout`;
    the last step may also take the planned duration.

    Args:
        sender: Node that sends the goal.
        executor: Executor that serves the node.
        place: Goal in `base_link`, (x, z) or (x, y, z) [m].
        changes: Values by name of parameters to set before the goal is sent; may be empty.
        wait: True to wait for the end of the motion, if the goal is accepted and there is a motion.
        timeout: Longest time for each step [s].
        say: Function that prints verdict and execution report as soon as they come.

    Returns:
        Exit code, verdict and execution report. If an awaited verdict or report is missing,
        `trouble` states the reason.
    """
    if not sender.wait_for_planner(executor, timeout):
        return CommandResult(
            EXIT_NO_ANSWER,
            f"no planner was found within {timeout:g} s; start one in this ROS domain: "
            "ros2 run mhsb_planner planner_node",
        )
    if changes:
        try:
            refused = sender.set_planner_parameters(executor, changes, timeout)
        except TimeoutError:
            return CommandResult(
                EXIT_NO_ANSWER, f"the planner did not take its parameters within {timeout:g} s"
            )
        if refused:
            return CommandResult(EXIT_REFUSED, f"the planner refused its parameters: {refused}")
    command_line.set_interrupt_note(
        "the goal was sent, and what the planner says was not waited for"
    )
    verdict = _request_verdict(sender, executor, place, timeout)
    if verdict is None:
        return CommandResult(EXIT_NO_ANSWER, f"the planner gave no answer within {timeout:g} s")
    if verdict.code.accepted:
        command_line.set_interrupt_note(
            "the goal stays, and the arm goes there; the planner's ~/stop ends that"
        )
    say("\n".join(_format_verdict(verdict)))
    if not verdict.code.accepted:
        return CommandResult(EXIT_REFUSED, verdict=verdict)
    if not wait or verdict.plan is None or verdict.plan.plan_stamp_ns == 0:
        return CommandResult(EXIT_ACCEPTED, verdict=verdict)
    stamp_ns = verdict.goal_stamp_ns
    longest = verdict.plan.duration_s + timeout
    if not spin_until(executor, lambda: stamp_ns in sender.executions, longest):
        trouble = f"the planner did not report an end within {timeout:g} s of the planned one"
        return CommandResult(EXIT_NO_ANSWER, trouble, verdict)
    report = sender.executions[stamp_ns]
    say(f"{report.outcome.value}: {report.sentence}")
    reached = report.outcome is Outcome.REACHED
    return CommandResult(EXIT_ACCEPTED if reached else EXIT_REFUSED, "", verdict, report)


def _request_verdict(
    sender: GoalSender, executor: SingleThreadedExecutor, place: Position, timeout: float
) -> GoalVerdict | None:
    """Send a goal and wait for its verdict; send the goal again as long as the verdict is NO_STATE.

    NO_STATE means that the planner does not know where the arm is. The arm may start later than the
    planner. One line on standard error announces the repetition.

    Args:
        sender: Node that sends the goal.
        executor: Executor that serves the node.
        place: Goal in `base_link`, (x, z) or (x, y, z) [m].
        timeout: Longest time to wait in total [s].

    Returns:
        The last verdict. It is NO_STATE only if no other verdict came within `timeout`. None if
        there was no verdict.
    """
    end = time.monotonic() + timeout
    verdict = sender.request_verdict(executor, place, timeout)
    is_first = True
    while (
        verdict is not None
        and verdict.code is Verdict.NO_STATE
        and end - time.monotonic() > SEND_AGAIN_AFTER_NO_STATE
    ):
        if is_first:
            print(
                f"{verdict.code.value}: {verdict.sentence}; the goal is sent again until the "
                f"planner knows, for at most {end - time.monotonic():.0f} s",
                file=sys.stderr,
                flush=True,
            )
            is_first = False
        spin_until(executor, lambda: False, SEND_AGAIN_AFTER_NO_STATE)
        verdict = sender.request_verdict(executor, place, end - time.monotonic()) or verdict
    return verdict


def _format_verdict(verdict: GoalVerdict) -> list[str]:
    """Format a verdict as lines of text.

    Args:
        verdict: The verdict.

    Returns:
        One line with code and sentence. If a plan was published, a second line has duration [s],
        energy by the paper's formula and with the pumps in series, its lower bound [J], number of
        mode switches, and planning time [ms].
    """
    lines = [f"{verdict.code.value}: {verdict.sentence}"]
    plan = verdict.plan
    if plan is not None and plan.plan_stamp_ns != 0:
        lines.append(
            f"  {plan.duration_s:.2f} s, {plan.energy_j:.0f} J ({plan.energy_series_j:.0f} J with "
            f"the pumps in series; zones aside, no motion takes less than "
            f"{plan.lower_bound_j:.0f} J), "
            f"{plan.switches} mode {'switch' if plan.switches == 1 else 'switches'}, planned in "
            f"{plan.plan_ms:.1f} ms"
        )
    return lines


main = command_line.make_main(goal, node=True)
