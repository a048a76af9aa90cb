"""Actions on the suite during a soak, and what was recorded of it.

All times are system times at which things were sent; simulated time may fall behind it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_tools.recording.recording import Recording

PLANNER, SIM = "planner", "sim"
"""Names of the two nodes in the soak."""


class ActionKind(StrEnum):
    """Kind of an action on the suite."""

    GOAL = "goal"
    STOP = "stop"
    ZONES = "zones"
    PARAMETER = "parameter"
    RESET = "reset"
    FREEZE = "freeze"  # SIGSTOP, and later SIGCONT
    END = "end"  # by a signal, or by itself
    START = "start"
    FAULT = "fault"
    HEAL = "heal"
    STRANGE = "strange"  # a setting that must be refused


@dataclass(frozen=True)
class ActionRecord:
    """One action on the suite.

    Attributes:
        kind: Kind of the action.
        node: Node on which it acted, `PLANNER` or `SIM`.
        begin_ns: System time of its beginning [ns].
        end_ns: System time at which it was answered, or over [ns].
        value: Stamp of a goal [ns], `Zones`, the fault, the parameter's value, or what else the
            kind needs.
        done: Whether it was answered and not refused.
    """

    kind: ActionKind
    node: str
    begin_ns: int
    end_ns: int
    value: Any = None
    done: bool = True


@dataclass(frozen=True)
class ProcessLife:
    """One process from its start to its end.

    Attributes:
        node: Node that it ran, `PLANNER` or `SIM`.
        number: Number of the node's process, from 1.
        ready_ns: System time at which it said that it was ready [ns].
        end_ns: System time of its end, or of the soak's [ns].
        signal: Signal by which the soak ended it; None if it ended by itself.
        exit_code: Exit code; None if it was killed.
        end_s: Time from the signal to the end [s].
        traceback: Last line of the first traceback that it printed; None if it printed none.
        memory: Pairs of system time [ns] and resident bytes, about one a second.
    """

    node: str
    number: int
    ready_ns: int
    end_ns: int
    signal: int | None
    exit_code: int | None
    end_s: float
    traceback: str | None
    memory: tuple[tuple[int, int], ...]

    @property
    def name(self) -> str:
        """Name of the process in sentences and file names, such as `planner-1`."""
        return f"{self.node}-{self.number}"


@dataclass(frozen=True, eq=False)
class Events:
    """Everything by which a soak's promises are judged.

    Attributes:
        machine: The arm.
        recording: Messages that were recorded.
        actions: Actions in order of time.
        lives: Processes in the order of their ends.
        begin_ns: System time of the soak's beginning [ns].
        end_ns: System time of the soak's end [ns].
    """

    machine: Machine
    recording: Recording
    actions: tuple[ActionRecord, ...]
    lives: tuple[ProcessLife, ...]
    begin_ns: int
    end_ns: int

    def actions_of(self, *kinds: ActionKind) -> list[ActionRecord]:
        """Return the actions of some kinds, in order of time."""
        return [deed for deed in self.actions if deed.kind in kinds]

    def lives_of(self, node: str) -> list[ProcessLife]:
        """Return the processes of a node, in order."""
        return [life for life in self.lives if life.node == node]

    def alive(self, node: str, begin_ns: int, end_ns: int) -> bool:
        """Return whether one process of a node ran for a whole span of time without being frozen.

        Args:
            node: The node.
            begin_ns: Beginning of the span, system time [ns].
            end_ns: End of the span [ns].
        """
        spanned = any(
            life.ready_ns <= begin_ns and end_ns <= life.end_ns for life in self.lives_of(node)
        )
        return spanned and not overlaps_any(
            (deed for deed in self.actions_of(ActionKind.FREEZE) if deed.node == node),
            begin_ns,
            end_ns,
        )

    def system_ns(self, ros_ns: int) -> int:
        """Return the system time at which a simulated time was reached.

        Args:
            ros_ns: Simulated time [ns].

        Returns:
            System time at which the first reference not earlier than this was recorded, or the last
            reference [ns].
        """
        table = self.recording.references
        row = min(int(np.searchsorted(table.time_ns, ros_ns)), len(table.time_ns) - 1)
        return int(table.recorded_ns[row])

    def seconds(self, time_ns: int) -> float:
        """Return the time since the soak's beginning [s]."""
        return (time_ns - self.begin_ns) / SECOND_NS


def overlaps_any(
    deeds: Iterable[ActionRecord],
    begin_ns: int,
    end_ns: int,
    before: float = 0.0,
    after: float = 0.0,
) -> bool:
    """Return whether any action overlaps a span of time.

    Args:
        deeds: The actions.
        begin_ns: Beginning of the span [ns].
        end_ns: End of the span [ns].
        before: Time by which each action is extended at its beginning [s].
        after: Time by which each action is extended at its end [s].
    """
    return any(
        deed.begin_ns - before * SECOND_NS < end_ns and begin_ns < deed.end_ns + after * SECOND_NS
        for deed in deeds
    )
