"""What can go wrong in planning; each error is one sentence and carries its data."""

from __future__ import annotations

from pathlib import Path

from mhsb_model.errors import ArgumentError, MhsbError
from mhsb_model.types import Position


def place_text(position: Position) -> str:
    """A position as it stands in a sentence."""
    return f"({', '.join(f'{value:.4g}' for value in position)}) m"


class InfeasibleGoalError(MhsbError):
    """No posture within the joint limits puts the tip at the goal."""

    def __init__(
        self, x: float, z: float, psi: float | tuple[float, float] | None = None
    ) -> None:
        self.x = x
        self.z = z
        self.psi = psi
        asked = () if psi is None else sorted(set(psi if isinstance(psi, tuple) else (psi,)))
        angle = " to ".join(f"{each:.4g}" for each in asked)
        with_psi = f" with the end link at {angle} rad" if angle else ""
        super().__init__(
            f"no posture within the joint limits puts the tip at ({x:.4g}, {z:.4g}) m{with_psi}"
        )


class ZoneError(MhsbError):
    """At the goal the arm would be in an obstacle, or too near to one."""

    def __init__(self, goal: Position, sentence: str) -> None:
        self.goal = goal
        super().__init__(sentence)


class NoPathError(MhsbError):
    """Goal and start are each feasible, but no sequence of steps joins them.

    among   the obstacles that steps had to keep clear of
    inside  which of them the arm is in at the start, as a clause; else empty
    """

    def __init__(
        self,
        start: Position,
        goal: Position,
        among: tuple[str, ...] = (),
        inside: str = "",
    ) -> None:
        self.start = start
        self.goal = goal
        self.among = among
        clear = f" clear of {', '.join(among)}" if among else ""
        super().__init__(
            f"no sequence of admissible steps leads from {place_text(start)} to {place_text(goal)}"
            f"{clear}{f'; {inside}' if inside else ''}"
        )


class StartError(MhsbError):
    """The arm is beyond joint limits at the start, and no motion leads back into them.

    Args:
        remarks: Which joints by how much, as a clause.
    """

    def __init__(self, remarks: str) -> None:
        self.remarks = remarks
        super().__init__(
            f"{remarks}; no motion was found that only lessens this: bring the joint back into its "
            "limits by hand or with the machine's own controls"
        )


class DeadlineError(MhsbError):
    """The deadline passed before there was anything to answer with; `work` is what it cut off."""

    def __init__(self, work: str) -> None:
        self.work = work
        super().__init__(f"{work} did not end before the deadline")


class ExpansionLimitError(MhsbError):
    """A search did not end within the number of states it may expand."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        super().__init__(f"the search did not end within {limit} expanded states")


class PlanningCancelledError(MhsbError):
    """Whoever asked for the work no longer wants it."""

    def __init__(self, work: str) -> None:
        self.work = work
        super().__init__(f"{work} was cancelled")


class RequestError(ArgumentError):
    """A value in a planning request is out of its range."""

    def __init__(self, name: str, value: object, rule: str) -> None:
        self.name = name
        self.value = value
        super().__init__(f"{name} {rule} (is {value})")


class ClusterError(MhsbError):
    """A cluster cannot be used."""

    def __init__(self, address: str, trouble: str) -> None:
        self.address = address
        super().__init__(f"cluster at {address}: {trouble}")


class ClusterAddressError(ClusterError, ArgumentError):
    """What was given is not an address."""


class WorkersLostError(MhsbError):
    """Those who work end before their work is done, again and again."""

    def __init__(self, who: str) -> None:
        super().__init__(
            f"{who} ended by themselves, killed or for want of memory; fewer at a time need less"
        )


class TableError(MhsbError):
    """A posture table cannot be read, written or used for this machine."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"posture table {path}: {reason}")


class EmptyTableError(MhsbError):
    """No node of a machine's grid has a posture within the joint limits: nothing can be planned."""

    def __init__(self, machine: str, nodes: int) -> None:
        self.machine = machine
        self.nodes = nodes
        super().__init__(
            f"posture table of {machine}: none of its {nodes} nodes has a posture within the joint "
            "limits; widen joints.*.limits or workspace in the machine file, `check` shows both"
        )
