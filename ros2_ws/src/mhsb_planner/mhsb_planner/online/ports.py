"""What the lifecycle of goals needs of the world around it: a clock and an outbox."""

from __future__ import annotations

from typing import Protocol

from mhsb_model.command import Command
from mhsb_model.verdict import Report
from mhsb_planner.online.plan_request import PlanRequest


class Clock(Protocol):
    """What time it is."""

    def wall(self) -> float:
        """By the steady clock of `deadline.now` [s]."""
        ...

    def ros_ns(self) -> int:
        """By the clock of ROS [ns]."""
        ...


class Outbox(Protocol):
    """What a lifecycle asks of the world."""

    def plan(self, request: PlanRequest) -> None:
        """Make a plan; `GoalLifecycle.planned` gets the answer later."""
        ...

    def send(self, command: Command) -> None:
        """Send a command to the arm."""
        ...

    def report(self, report: Report) -> None:
        """Tell the user."""
        ...

    def warn(self, sentence: str) -> None:
        """Tell whoever reads the log."""
        ...

    def stop_arm(self) -> None:
        """Ask the arm itself to stop."""
        ...

    def connected(self) -> bool:
        """Whether the arm would receive a plan."""
        ...
