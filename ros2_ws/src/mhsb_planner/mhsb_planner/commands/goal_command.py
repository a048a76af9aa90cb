"""`goal`: sends one goal to a running planner and tells what became of it."""

from __future__ import annotations

import json as json_format
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Annotated, Any

import tyro
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from mhsb_model import command_line
from mhsb_model.command_line import Within
from mhsb_model.types import Position
from mhsb_model.verdict import ExecutionReport, GoalVerdict, Outcome
from mhsb_msgs_py.node_process import ros_running, serving, spin_until
from mhsb_planner.ros.goal_sender import GoalSender

ACCEPTED, REFUSED, NO_ANSWER = 0, 1, 3


def goal(
    place: Annotated[
        Position, tyro.conf.Positional, tyro.conf.arg(metavar="X [Y] Z"), Within(-1e4, 1e4)
    ],
    tolerance: Annotated[float | None, tyro.conf.arg(metavar="M"), Within(0.0, 2.0)] = None,
    psi_range: Annotated[
        tuple[float, float] | None, tyro.conf.arg(metavar="LOW HIGH"), Within(-100.0, 100.0)
    ] = None,
    wait: bool = False,
    timeout: Annotated[float, tyro.conf.arg(metavar="S"), Within(0.0, 1e6)] = 10.0,
    json: bool = False,
) -> int:
    """Send the tip to (X, Z), or where the arm slews to (X, Y, Z), and print what the planner says.

    Exit code 0: accepted (with --wait: reached), 1: refused, superseded or not reached, 3: nobody
    answered in time. What else will do at the goal is set as parameters of the planner and stays
    until it is changed (goal_tolerance, goal_psi_min, goal_psi_max; goal_segment, goal_box).

    Args:
        place: Forward, to the left and up from the base [m]; without Y that is 0.
        tolerance: Distance from the goal at which the tip may end as well [m]; 0 takes it back.
        psi_range: Least and greatest angle of the end link that will do [rad]; a whole turn, such
            as 0 6.3, takes it back.
        wait: Also wait until the motion has ended.
        timeout: How long to wait for a planner, and again for its answer [s].
        json: Print the verdict, and with --wait how it ended, as one JSON object.
    """
    if len(place) not in (2, 3):
        given = " ".join(f"{value:g}" for value in place)
        raise command_line.UsageError(f"give X Z or X Y Z [m], not {given or 'nothing'}")
    if timeout <= 0:
        raise command_line.UsageError(f"--timeout takes a positive time in s, not {timeout:g}")
    if psi_range is not None and not psi_range[0] <= psi_range[1]:
        low, high = psi_range
        raise command_line.UsageError(
            f"--psi-range takes the least and the greatest angle, not {low:g} and {high:g}"
        )
    command_line.keep("no goal was sent")
    say = _nothing if json else partial(print, flush=True)
    try:
        with ros_running(), serving(GoalSender) as (executor, sender):
            changes = _changes(tolerance, psi_range)
            told = _send_and_wait(sender, executor, place, changes, wait, timeout, say)
    except ExternalShutdownException:
        raise KeyboardInterrupt from None
    if told.trouble:
        say(told.trouble)
    if json:
        print(json_format.dumps(told.content()))
    return told.exit_code


def _nothing(_: str) -> None:
    """Said to nobody."""


@dataclass(frozen=True)
class Told:
    """What there is to tell: why nobody was heard, or the verdict and how its execution ended."""

    exit_code: int
    trouble: str = ""
    verdict: GoalVerdict | None = None
    execution: ExecutionReport | None = None

    def content(self) -> dict[str, Any]:
        """In plain types; SI units."""
        return {
            "exit_code": self.exit_code,
            "trouble": self.trouble or None,
            "verdict": asdict(self.verdict) if self.verdict else None,
            "execution": asdict(self.execution) if self.execution else None,
        }


def _changes(
    tolerance: float | None, psi_range: tuple[float, float] | None
) -> dict[str, float]:
    """The planner's parameters that say what will do at the goal."""
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
) -> Told:
    """Ask, and wait for what is asked for; verdict and end are said as they come."""
    if not spin_until(executor, lambda: sender.matched, timeout):
        return Told(
            NO_ANSWER,
            f"no planner was found within {timeout:g} s; start one in this ROS domain: "
            "ros2 run mhsb_planner planner_node",
        )
    if changes:
        try:
            refused = sender.set_at_planner(executor, changes, timeout)
        except TimeoutError:
            return Told(NO_ANSWER, f"the planner did not take its parameters within {timeout:g} s")
        if refused:
            return Told(REFUSED, f"the planner refused its parameters: {refused}")
    command_line.keep("the goal was sent, and what the planner says was not waited for")
    verdict = sender.ask(executor, place, timeout)
    if verdict is None:
        return Told(NO_ANSWER, f"the planner gave no answer within {timeout:g} s")
    if verdict.code.accepted:
        command_line.keep("the goal stays, and the arm goes there; the planner's ~/stop ends that")
    say("\n".join(_verdict_lines(verdict)))
    if not verdict.code.accepted:
        return Told(REFUSED, verdict=verdict)
    if not wait or verdict.plan is None or verdict.plan.plan_stamp_ns == 0:
        return Told(ACCEPTED, verdict=verdict)
    stamp_ns = verdict.goal_stamp_ns
    longest = verdict.plan.duration_s + timeout
    if not spin_until(executor, lambda: stamp_ns in sender.executions, longest):
        trouble = f"the planner did not report an end within {timeout:g} s of the planned one"
        return Told(NO_ANSWER, trouble, verdict)
    report = sender.executions[stamp_ns]
    say(f"{report.outcome.value}: {report.sentence}")
    reached = report.outcome is Outcome.REACHED
    return Told(ACCEPTED if reached else REFUSED, "", verdict, report)


def _verdict_lines(verdict: GoalVerdict) -> list[str]:
    lines = [f"{verdict.code.value}: {verdict.sentence}"]
    plan = verdict.plan
    if plan is not None and plan.plan_stamp_ns != 0:
        lines.append(
            f"  {plan.duration_s:.2f} s, {plan.energy_j:.0f} J ({plan.energy_series_j:.0f} J in "
            f"series reading, at least {plan.lower_bound_j:.0f} J), {plan.switches} mode switches, "
            f"planned in {plan.plan_ms:.1f} ms"
        )
    return lines


def main() -> int:
    """Entry point of `ros2 run mhsb_planner goal`."""
    return command_line.run(goal, name="goal", node=True)


if __name__ == "__main__":
    sys.exit(main())
