"""What was done to the suite in a soak, and what was heard of it.

All times are the system's, at which things were sent; simulated time may fall behind it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_sim.recording.recording import Recording

PLANNER, SIM = "planner", "sim"


class DeedKind(StrEnum):
    """What can be done to the suite."""

    GOAL = "goal"
    STOP = "stop"
    ZONES = "zones"
    PARAMETER = "parameter"
    RESET = "reset"
    FREEZE = "freeze"  # SIGSTOP, and later SIGCONT
    END = "end"  # by a signal; with it the process's life ends
    START = "start"
    FAULT = "fault"
    HEAL = "heal"


@dataclass(frozen=True)
class Deed:
    """One thing that was done.

    node       to which it was done
    begin_ns   system time, likewise end_ns: when it was answered, or over
    value      stamp of a goal [ns], `Zones`, the fault or parameter, what else it needs
    done       whether it was answered, and not refused
    """

    kind: DeedKind
    node: str
    begin_ns: int
    end_ns: int
    value: Any = None
    done: bool = True


@dataclass(frozen=True)
class Life:
    """One process from its start to its end.

    ready_ns   system time at which it said so
    end_ns     system time of its end, or of the soak's
    signal     by which the soak ended it; None where it ended by itself
    exit_code  None where it was killed
    end_s      time from the signal to the end [s]
    traceback  last line of the first one that it printed
    memory     (system time, resident bytes), about once a second
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
        """What it is called in sentences and in file names."""
        return f"{self.node}-{self.number}"


@dataclass(frozen=True, eq=False)
class Events:
    """All that a soak's promises are judged by."""

    machine: Machine
    recording: Recording
    deeds: tuple[Deed, ...]
    lives: tuple[Life, ...]
    begin_ns: int
    end_ns: int

    def deeds_of(self, *kinds: DeedKind) -> list[Deed]:
        """Deeds of some kinds, in order."""
        return [deed for deed in self.deeds if deed.kind in kinds]

    def lives_of(self, node: str) -> list[Life]:
        """Lives of a node, in order."""
        return [life for life in self.lives if life.node == node]

    def alive(self, node: str, begin_ns: int, end_ns: int) -> bool:
        """Whether one life of a node spans a time, without a freeze in it."""
        spanned = any(
            life.ready_ns <= begin_ns and end_ns <= life.end_ns for life in self.lives_of(node)
        )
        return spanned and not overlapping(
            (deed for deed in self.deeds_of(DeedKind.FREEZE) if deed.node == node), begin_ns, end_ns
        )

    def system_ns(self, ros_ns: int) -> int:
        """System time [ns] of a simulated time [ns], by the references."""
        table = self.recording.references
        row = min(int(np.searchsorted(table.time_ns, ros_ns)), len(table.time_ns) - 1)
        return int(table.recorded_ns[row])

    def seconds(self, time_ns: int) -> float:
        """Time since the soak's begin [s]."""
        return (time_ns - self.begin_ns) / SECOND_NS


def overlapping(
    deeds: Iterable[Deed], begin_ns: int, end_ns: int, before: float = 0.0, after: float = 0.0
) -> bool:
    """Whether a deed, made longer at both ends [s], meets a span of time."""
    return any(
        deed.begin_ns - before * SECOND_NS < end_ns and begin_ns < deed.end_ns + after * SECOND_NS
        for deed in deeds
    )
