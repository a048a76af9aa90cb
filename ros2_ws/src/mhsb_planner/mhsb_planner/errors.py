"""Errors of planning. Each has a message of one sentence."""

import math
from collections.abc import Sequence
from pathlib import Path

from mhsb_model.errors import ArgumentError, MhsbError, suggest_unit
from mhsb_model.types import FloatArray, Position


def place_text(position: Position | FloatArray) -> str:
    """Return a position as text for a sentence, such as "(0.55, 0.6) m"."""
    return f"({', '.join(f'{value:.4g}' for value in position)}) m"


def _suggest_degrees(angles: Sequence[float]) -> str:
    """Return a clause that asks whether end-link angles were meant in degrees.

    Args:
        angles: The angles [rad].

    Returns:
        The clause. It is empty if no angle exceeds a whole turn, or if an angle exceeds a whole
        turn even when read in degrees.
    """
    whole_turn = 2.0 * math.pi
    if all(abs(angle) <= whole_turn for angle in angles):
        return ""
    return suggest_unit(angles, "rad", lambda given: all(abs(each) <= whole_turn for each in given))


class InfeasibleGoalError(MhsbError):
    """No posture within the joint limits puts the tip at the goal."""

    def __init__(self, x: float, z: float, psi: float | tuple[float, float] | None = None) -> None:
        """Compose the message. It asks about degrees if an angle of `psi` exceeds a whole turn.

        Args:
            x: Forward coordinate of the goal in the arm's plane [m].
            z: Upward coordinate of the goal [m].
            psi: Requested end-link angle, or least and greatest angle [rad]. None means any angle.
        """
        asked = () if psi is None else sorted(set(psi if isinstance(psi, tuple) else (psi,)))
        angle = " to ".join(f"{each:.4g}" for each in asked)
        with_psi = f" with the end link at {angle} rad" if angle else ""
        super().__init__(
            f"no posture within the joint limits puts the tip at ({x:.4g}, {z:.4g}) m{with_psi}"
            f"{_suggest_degrees(asked)}"
        )


class ZoneError(MhsbError):
    """At the goal, the arm would be in an obstacle or too near to one."""


class NoPathError(MhsbError):
    """Start and goal have feasible postures, but no sequence of admissible steps connects them."""

    def __init__(
        self, start: Position | FloatArray, goal: Position, among: tuple[str, ...] = ()
    ) -> None:
        """Compose the message.

        Args:
            start: Tip position at the start [m].
            goal: Tip position at the goal [m].
            among: Names of the obstacles that the steps had to avoid.
        """
        clear = f" clear of {', '.join(among)}" if among else ""
        super().__init__(
            f"no sequence of admissible steps leads from {place_text(start)} to {place_text(goal)}"
            f"{clear}"
        )


class StartError(MhsbError):
    """The arm is beyond joint limits at the start, and no motion leads back inside."""

    def __init__(self, remarks: str) -> None:
        """Compose the message.

        Args:
            remarks: Clause that names the joints beyond their limits, and by how much.
        """
        super().__init__(
            f"{remarks}; no motion was found that only lessens this: bring the joint back into its "
            "limits by hand or with the machine's own controls"
        )


class DeadlineError(MhsbError):
    """The deadline passed before there was a result."""

    def __init__(self, work: str) -> None:
        """Compose the message; `work` is the subject of its sentence, such as "the search"."""
        super().__init__(f"{work} did not end before the deadline")


class RequestError(ArgumentError):
    """A value in a planning request is out of its range.

    Attributes:
        name: Name of the value.
        value: The value.
    """

    def __init__(self, name: str, value: object, rule: str) -> None:
        """Store name and value, and compose the message from them and the rule.

        Args:
            name: Name of the value.
            value: The value.
            rule: Condition that the value breaks, such as "must be above 0".
        """
        self.name = name
        self.value = value
        super().__init__(f"{name} {rule} (is {value})")


class ClusterError(MhsbError):
    """A cluster cannot be used."""

    def __init__(self, address: str, trouble: str) -> None:
        """Compose the message.

        Args:
            address: Address of the cluster's scheduler.
            trouble: Clause that says why the cluster cannot be used.
        """
        super().__init__(f"cluster at {address}: {trouble}")


class ClusterAddressError(ClusterError, ArgumentError):
    """A text that was given as the address of a cluster is not an address."""


class WorkersLostError(MhsbError):
    """Processes or workers ended again and again before their work was done."""

    def __init__(self, who: str) -> None:
        """Compose the message; `who` is its subject and names the processes or workers."""
        super().__init__(
            f"{who} ended by themselves, killed or for want of memory; fewer at a time need less"
        )


class TableError(MhsbError):
    """A posture table cannot be read, written or used for a machine."""

    def __init__(self, path: Path, reason: str) -> None:
        """Compose the message.

        Args:
            path: File of the table.
            reason: Why the table cannot be used, as a clause without a subject.
        """
        super().__init__(f"posture table {path}: {reason}")


class EmptyTableError(MhsbError):
    """No node of a machine's grid has a posture within the joint limits."""

    def __init__(self, machine: str, nodes: int) -> None:
        """Compose the message.

        Args:
            machine: Name of the machine.
            nodes: Number of nodes of its grid.
        """
        super().__init__(
            f"posture table of {machine}: none of its {nodes} nodes has a posture within the joint "
            "limits; widen joints.*.limits or workspace in the machine file, `check` shows both"
        )
