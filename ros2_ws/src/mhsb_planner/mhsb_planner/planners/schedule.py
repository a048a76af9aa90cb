"""Order of work among proposers: the only place that decides whose turn it is.

A schedule is a generator of proposers. `take_turns` asks each for one proposal before it asks the
schedule for the next proposer. A schedule sees what the turns have brought: whether there is a
motion by now (`PlanProgress.has_motion`), and what each proposer did at its last turn. A proposer
pauses if it proposes None.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mhsb_model.errors import MhsbError
from mhsb_planner.plan_log import ProposalOutcome
from mhsb_planner.planners.path_planner import PathProposal
from mhsb_planner.progress import PlanProgress


class Proposer:
    """Named source of proposals, one at each turn.

    Attributes:
        name: Name of the proposer in the log.
        last: Proposal of the last turn. None: there was no turn, or the proposer has paused before
            work that takes long, or it has ended.
        has_ended: True if it has no further proposals, or must have none.
        error: Error by which it has ended; None: there was none.
    """

    def __init__(self, name: str, proposals: Iterator[PathProposal | None]) -> None:
        """Store name and source; the source does nothing before the first turn.

        Args:
            name: Name of the proposer in the log.
            proposals: Source of its proposals. It yields None before work that takes long, so that
                other proposers can have their turns first.
        """
        self.name = name
        self.last: PathProposal | None = None
        self.has_ended = False
        self.error: MhsbError | None = None
        self._proposals = proposals

    def propose(self) -> PathProposal | None:
        """Take a turn: get the next proposal of the source and store it in `last`.

        At the end of the source, `has_ended` becomes True.

        Returns:
            The proposal, with the name of this proposer if it names none. None if the proposer
            pauses before long work, or has ended.

        Raises:
            MhsbError: The source has failed. The error is stored in `error`, `last` becomes None,
                and `has_ended` True.
        """
        try:
            proposal = next(self._proposals)
        except StopIteration:
            proposal, self.has_ended = None, True
        except MhsbError as error:
            self.last, self.has_ended, self.error = None, True, error
            raise
        if proposal is not None and not proposal.proposer:
            proposal = proposal._replace(proposer=self.name)
        self.last = proposal
        return proposal


def take_turns(
    schedule: Iterator[Proposer], progress: PlanProgress, main: Proposer | None = None
) -> Iterator[PathProposal]:
    """Give the proposers of a schedule their turns, and yield what they propose.

    Failures are logged. They end the proposals of the proposer that failed.

    Args:
        schedule: Proposers in the order of their turns.
        progress: Progress of the plan, with the log.
        main: Proposer whose failure ends everything; None if no failure does.

    Yields:
        The proposals.

    Raises:
        MhsbError: The main proposer has failed.
    """
    for proposer in schedule:
        try:
            proposal = proposer.propose()
        except MhsbError as error:
            progress.log.add(proposer.name, ProposalOutcome.NO_PATH, reason=str(error))
            if proposer is main:
                raise
            continue
        if proposal is not None:
            yield proposal


@dataclass(frozen=True)
class ProposerSet:
    """Proposers of the integrated planner for one request.

    Attributes:
        own: The search whose paths the planner is for.
        without_leakage: The same search, without leakage in the comparison of paths.
        baselines: Proposers of paths for comparison, the quickest first.
        later: Proposers that follow after all others.
        slew_time: Least time of the slew [s]. `without_leakage` proposes its paths after the first
            own path that takes less: leakage then flows equally long on every path.
    """

    own: Proposer
    without_leakage: Proposer
    baselines: Sequence[Proposer]
    later: Sequence[Proposer]
    slew_time: float

    def turns_without_leakage(self) -> Iterator[Proposer]:
        """Yield the proposer `without_leakage` until it has ended, if its search is worthwhile.

        The search is worthwhile if the last turn of `own` gave a path that takes less time than the
        slew. Otherwise nothing is yielded.
        """
        last = self.own.last
        if last is not None and last.path.duration.sum() < self.slew_time:
            yield from _until_end(self.without_leakage)

    def remaining_turns(self) -> Iterator[Proposer]:
        """Yield baselines and later proposers, each until its end."""
        for proposer in (*self.baselines, *self.later):
            yield from _until_end(proposer)


def schedule_without_deadline(
    proposers: ProposerSet, progress: PlanProgress, *, all_at_once: bool
) -> Iterator[Proposer]:
    """Yield proposers in an order that does not hurry to a first motion.

    It suits a plan without a deadline. It is also used with a deadline if the velocity polytope's
    area has a weight, or if the goal moves.

    The integrated search has turns until it has ended. Two steps follow each of its turns. First,
    the search without leakage runs to its end if the slew takes longer than the path of this turn:
    on every path, leakage then flows as long as the slew takes. Second, the next baseline (planner
    to compare with) proposes all its paths if one of three conditions holds:

    - There is no motion yet.
    - The integrated search pauses before long work.
    - There is a deadline, and half of the time until then is over.

    At the end come the remaining baselines, then the proposers in `proposers.later`.

    Args:
        proposers: The proposers.
        progress: Progress of the plan.
        all_at_once: True: all baselines propose after the first turn of the integrated search,
            without these conditions. This suits a search that takes long because its lower bounds
            are weak.

    Yields:
        The proposer whose turn it is.
    """
    own, left = proposers.own, list(proposers.baselines)
    while not own.has_ended:
        yield own
        yield from proposers.turns_without_leakage()
        is_due = own.last is None or not progress.has_motion or progress.is_half_over
        count = len(left) if all_at_once else int(is_due)
        for proposer in left[:count]:
            yield from _until_end(proposer)
        left = left[count:]
    yield from proposers.remaining_turns()


def schedule_for_deadline(proposers: ProposerSet, progress: PlanProgress) -> Iterator[Proposer]:
    """Yield proposers in the order that suits a deadline.

    1. The integrated search has one turn, then the first baseline (planner to compare with). That
       baseline takes a millisecond or two, and its motion bounds the cost of the plan.
    2. The integrated search has turns until it has ended. If half of the time is over without a
       motion, the baselines have turns until there is a motion.
    3. The remaining turns of the baselines, and the later proposers, come at the end.

    The search without leakage runs to its end as soon as the integrated search has given a path
    that takes less time than the slew. On every path, leakage then flows as long as the slew takes.

    Args:
        proposers: The proposers.
        progress: Progress of the plan.

    Yields:
        The proposer whose turn it is.
    """
    own = proposers.own
    yield own
    yield proposers.baselines[0]
    yield from proposers.turns_without_leakage()
    while not own.has_ended:
        yield own
        if not progress.has_motion and progress.is_half_over:
            for proposer in proposers.baselines:
                while not (proposer.has_ended or progress.has_motion):
                    yield proposer
        yield from proposers.turns_without_leakage()
    yield from proposers.remaining_turns()


def schedule_in_turn(
    first: Proposer, quick: Sequence[Proposer], others: Sequence[Proposer], progress: PlanProgress
) -> Iterator[Proposer]:
    """Yield proposers in turn until all have ended, the quick ones more often than others.

    The proposers form a queue. Its head has a turn and is then put back into the queue:

    - A proposer that is not quick goes to the end.
    - While there is no motion, a quick proposer goes to the head: it has turn after turn until it
      has ended.
    - After the first motion, a quick proposer goes behind the next proposer in the queue.

    After the first motion, a single quick proposer thus has every second turn. Several quick
    proposers share all turns, until only one of them is left; the other proposers wait so long.

    Args:
        first: Proposer at the head of the queue at first. It is not quick.
        quick: Quick proposers, behind `first`.
        others: All other proposers, behind the quick ones.
        progress: Progress of the plan. Its `has_motion` is read before each turn, so a quick
            proposer whose turn gives the first motion has one more turn at once.

    Yields:
        The proposer whose turn it is.
    """
    waiting = deque([first, *quick, *others])
    while waiting:
        proposer = waiting.popleft()
        place = len(waiting)
        if proposer in quick:
            place = 1 if progress.has_motion else 0
        if not proposer.has_ended:
            yield proposer
            waiting.insert(place, proposer)


def _until_end(proposer: Proposer) -> Iterator[Proposer]:
    """Yield the same proposer again and again until it has ended."""
    while not proposer.has_ended:
        yield proposer
