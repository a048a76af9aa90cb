"""Interface that the goal lifecycle needs: clocks, and an outbox for its decisions."""

from collections.abc import Callable
from typing import Protocol

from mhsb_model.command import Command
from mhsb_model.verdict import Report
from mhsb_planner.online.plan_request import PlanRequest


class PlannerIO(Protocol):
    """Clocks and outbox of the goal lifecycle: planning worker, arm, user and log."""

    def steady_time(self) -> float:
        """Return the present time by the steady clock of `deadline.now` [s]."""

    def ros_ns(self) -> int:
        """Return the present time by the ROS clock [ns]."""

    def start_planning(self, request: PlanRequest) -> None:
        """Start to make a plan in the background.

        The answer is passed to `GoalLifecycle.handle_plan_answer` later.
        """

    def send(self, command: Command) -> None:
        """Send a command to the arm."""

    def report(self, report: Report) -> None:
        """Send a verdict or an execution report to the user."""

    def warn(self, sentence: str) -> None:
        """Write a warning to the log."""

    def stop_arm(self, on_answer: Callable[[bool, str], None]) -> bool:
        """Call the arm's own ~/stop.

        Args:
            on_answer: Called with success and sentence when the arm answers.

        Returns:
            True if the service was called, False if it is not available.
        """

    def must_call_arm_stop(self) -> bool:
        """Return whether only the arm's own ~/stop can bring the arm to rest for certain.

        Returns:
            True if another node also sends plans, and the arm provides ~/stop. The other node could
            replace a braking command, or make the arm brake differently.
        """

    def is_arm_connected(self) -> bool:
        """Return whether the arm is connected so that it would receive a plan."""

    def describe_publisher_conflict(self) -> str:
        """Return a sentence that names the publishers of `reference` if there are several.

        Publishers are read from the ROS graph, where a killed process still appears for a while.

        Returns:
            The sentence; empty if there is one publisher or none.
        """
