"""Log of the making of one plan: the proposed paths and the outcome of each."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from time import perf_counter

from mhsb_model.errors import MhsbError


class ProposalOutcome(StrEnum):
    """Outcome of a proposal (a path that a planner has proposed)."""

    TAKEN = "taken"
    """The proposal's motion became the incumbent, the cheapest motion so far."""

    DEARER = "dearer"
    """The proposal's motion is not cheaper than the incumbent."""

    SKIPPED = "skipped"
    """No motion was fitted, because the path costs too much."""

    REFUSED = "refused"
    """No motion along the path keeps the limits."""

    TOO_LATE = "too late"
    """The deadline passed before a motion was fitted."""

    NO_PATH = "no path"
    """The proposer found no path, or no further path."""

    FAILED = "failed"
    """An error ended the planner after it had found a motion, which is kept."""


@dataclass(frozen=True)
class LogEntry:
    """One proposal, or one proposer that failed.

    Attributes:
        time: Time since the request [s].
        proposer: Name of the proposer, such as `table`.
        outcome: Outcome of the proposal.
        path_cost: Cost of the proposed path [-]; NaN if there is none.
        motion: Kind of motion that was to be fitted, such as `polynomial`; empty if there was none.
        motion_cost: Cost of the motion [-]; NaN if there is none.
        reason: Clause that says why there is no path or no motion; empty if there is one.
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
    """Log of the making of one plan. `print(log)` shows it as a table.

    Attributes:
        entries: Entries in time order.
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
        """Append an entry. Its time is the time since the request.

        Args:
            proposer: Name of the proposer, such as `table`.
            outcome: Outcome of the proposal.
            path_cost: Cost of the proposed path [-]; NaN if there is none.
            motion: Kind of motion that was to be fitted; empty if there was none.
            motion_cost: Cost of the motion [-]; NaN if there is none.
            reason: Clause that says why there is no path or no motion; empty if there is one.
        """
        time = perf_counter() - self.began
        entry = LogEntry(time, proposer, outcome, path_cost, motion, motion_cost, reason)
        self.entries.append(entry)

    def add_failure(
        self,
        proposer: str,
        error: Exception,
        outcome: ProposalOutcome = ProposalOutcome.NO_PATH,
    ) -> None:
        """Append an entry about an error, unless the proposer has an entry with the same reason.

        The reason is the error's sentence. The type of the error precedes it if the error is not an
        `MhsbError`.

        Args:
            proposer: Name of the proposer in the log.
            error: The error.
            outcome: NO_PATH or FAILED.
        """
        expected = isinstance(error, MhsbError)
        reason = str(error) if expected else f"{type(error).__name__}: {error}"
        if not any((each.proposer, each.reason) == (proposer, reason) for each in self.entries):
            self.add(proposer, outcome, reason=reason)

    @contextmanager
    def record_failure(self, proposer: str) -> Iterator[None]:
        """Log an `MhsbError` of the `with` block as NO_PATH, and suppress it (context manager).

        Other exceptions are not suppressed.

        Args:
            proposer: Name of the proposer in the log.
        """
        try:
            yield
        except MhsbError as error:
            self.add_failure(proposer, error)

    def __str__(self) -> str:
        """Return the entries as a text table: a header, then one line for each entry."""
        lines = [f"{'ms':>8}  {'path cost':>9}  {'motion cost':>11}  {'outcome':9} proposer"]
        for entry in self.entries:
            kind = f", {entry.motion}" if entry.motion else ""
            why = f": {entry.reason}" if entry.reason else ""
            lines.append(
                f"{1e3 * entry.time:8.2f}  {_format_cost(entry.path_cost)}  "
                f"{_format_cost(entry.motion_cost):>11}  {entry.outcome:9} "
                f"{entry.proposer}{kind}{why}"
            )
        return "\n".join(lines)


def _format_cost(cost: float) -> str:
    """Format a cost as text of nine characters; NaN becomes a dash."""
    return f"{'-':>9}" if math.isnan(cost) else f"{cost:9.5g}"
