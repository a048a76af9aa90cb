"""Log of the making of one plan: which paths were proposed, and what became of each."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from time import perf_counter

from mhsb_model.errors import MhsbError


class ProposalOutcome(StrEnum):
    """Outcome of a proposal."""

    TAKEN = "taken"
    """Its motion became the incumbent."""

    DEARER = "dearer"
    """Its motion is not better than the incumbent."""

    SKIPPED = "skipped"
    """No motion was fitted, because its path costs too much."""

    REFUSED = "refused"
    """S3 found no motion that keeps the limits."""

    TOO_LATE = "too late"
    """The time was up before its motion was fitted."""

    NO_PATH = "no path"
    """The proposer found no path, or no further one."""


@dataclass(frozen=True)
class LogEntry:
    """One proposal, or one proposer that failed.

    Attributes:
        time: Time since the request [s].
        proposer: Name of the proposer, such as `table`.
        outcome: Outcome of the proposal.
        path_cost: Cost of the proposed path [-]; NaN if there is none.
        motion: Kind of motion that was asked for, such as `polynomial`; empty if none was.
        motion_cost: Cost of the motion [-]; NaN if there is none.
        reason: Reason why there is no path or motion, as a clause; empty if there is one.
    """

    time: float
    proposer: str
    outcome: ProposalOutcome
    path_cost: float = math.nan
    motion: str = ""
    motion_cost: float = math.nan
    reason: str = ""


@dataclass
class PlanLog:
    """Entries in the order of time, from the request on; `print(log)` shows them as a table.

    Attributes:
        entries: The entries; `add` appends one.
        began: Time of the request by `time.perf_counter` [s].
    """

    entries: list[LogEntry] = field(default_factory=list)
    began: float = field(default_factory=perf_counter)

    def add(
        self,
        proposer: str,
        outcome: ProposalOutcome,
        path_cost: float = math.nan,
        motion: str = "",
        motion_cost: float = math.nan,
        reason: str = "",
    ) -> None:
        """Append an entry with the present time.

        Args:
            proposer: Name of the proposer, such as `table`.
            outcome: Outcome of the proposal.
            path_cost: Cost of the proposed path [-]; NaN if there is none.
            motion: Kind of motion that was asked for; empty if none was.
            motion_cost: Cost of the motion [-]; NaN if there is none.
            reason: Clause on why there is no path or motion; empty if there is one.
        """
        time = perf_counter() - self.began
        entry = LogEntry(time, proposer, outcome, path_cost, motion, motion_cost, reason)
        self.entries.append(entry)

    @contextmanager
    def record_failure(self, proposer: str) -> Iterator[None]:
        """Context manager that suppresses an `MhsbError` of a proposer and logs it as NO_PATH.

        Other exceptions pass.

        Args:
            proposer: Name of the proposer in the log.
        """
        try:
            yield
        except MhsbError as error:
            self.add(proposer, ProposalOutcome.NO_PATH, reason=str(error))

    def __str__(self) -> str:
        """Return the entries as a text table: a header, then one line for each entry."""
        lines = [f"{'ms':>8}  {'path':>9}  {'motion':>9}  {'outcome':9} proposer"]
        for entry in self.entries:
            kind = f", {entry.motion}" if entry.motion else ""
            why = f": {entry.reason}" if entry.reason else ""
            lines.append(
                f"{1e3 * entry.time:8.2f}  {_format_cost(entry.path_cost)}  "
                f"{_format_cost(entry.motion_cost)}  {entry.outcome:9} "
                f"{entry.proposer}{kind}{why}"
            )
        return "\n".join(lines)


def _format_cost(cost: float) -> str:
    """Return a cost in nine characters, with a dash for NaN."""
    return f"{'-':>9}" if math.isnan(cost) else f"{cost:9.5g}"
