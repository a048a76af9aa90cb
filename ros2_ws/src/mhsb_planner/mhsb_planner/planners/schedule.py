"""Order of the turns of proposers (sources of paths).

A schedule is a generator of proposers. `take_turns` gets one path from each proposer before it gets
the next proposer from the schedule. Between turns, a schedule reads whether a motion has been found
(`PlanProgress.has_motion`), and what each proposer did at its last turn.
"""

from collections import deque
from collections.abc import Iterator, Sequence

from mhsb_model.errors import MhsbError
from mhsb_planner.planners.path_planner import PathProposal
from mhsb_planner.progress import PlanProgress

EARLY_OWN_TURNS = 2
"""Number of turns of the integrated search before the first turn of a baseline.

The first turn gives a straight line, the second its refinement. On `mhsb_arm3`, the refinement
takes one to three milliseconds and brings most of the saving of longer searches.
"""


class Proposer:
    """Named source that gives one proposal at each turn.

    Attributes:
        name: Name of the proposer in the log.
        last: Proposal of the last turn. None before the first turn, after the end, and in a pause
            before work that takes long.
        has_ended: True if it has no further proposals.
        error: Error that ended the proposer; None if there was none.
    """

    def __init__(self, name: str, proposals: Iterator[PathProposal | None]) -> None:
        """Store name and source; the source does no work before the first turn.

        Args:
            name: Name of the proposer in the log.
            proposals: Generator of its proposals. It yields None before long work, so that other
                proposers can have their turns first.
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
            The proposal; its empty field `proposer` becomes this proposer's name. None if the
            source pauses before long work, or has ended.

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
    """Let the proposers of a schedule take one turn each, and yield the paths that they propose.

    An MhsbError of a proposer is logged and ends that proposer.

    Args:
        schedule: Proposers in the order of their turns.
        progress: State of the planning loop, with the log.
        main: Proposer whose error is also raised; None means that no error is raised.

    Yields:
        The proposals. A turn without a proposal yields nothing.

    Raises:
        MhsbError: The main proposer has failed.
    """
    for proposer in schedule:
        try:
            proposal = proposer.propose()
        except MhsbError as error:
            progress.log.add_failure(proposer.name, error)
            if proposer is main:
                raise
            continue
        if proposal is not None:
            yield proposal


def schedule_proposers(
    own: Proposer,
    without_leakage: Proposer,
    baselines: Sequence[Proposer],
    progress: PlanProgress,
    *,
    slew_time: float,
    early_count: int,
) -> Iterator[Proposer]:
    """Yield the proposers of the integrated planner in the order of their turns.

    1. The integrated search has EARLY_OWN_TURNS turns.
    2. Each of the first `early_count` baselines (sources to compare with) has one turn.
    3. The integrated search has one turn after the other until it has ended. If half of the time is
       over without a motion, the baselines have turns until there is a motion.
    4. The baselines have turns until each has ended.

    The search without leakage has all its turns as soon as the integrated search has given a path
    that takes less time than the slew. Every motion then lasts as long as the slew, so leakage
    costs the same on each path.

    Args:
        own: The integrated search.
        without_leakage: The same search, which ignores leakage when it compares paths.
        baselines: Other sources of paths to compare with, the quickest first.
        progress: State of the planning loop; read between the turns.
        slew_time: Least time that the slew needs [s]. `without_leakage` has its turns as soon as
            `own` has proposed a path that takes less time.
        early_count: Number of baselines that have a turn right after the first turns of `own`.

    Yields:
        The proposer whose turn it is.
    """
    turns = 0
    while not own.has_ended:
        yield own
        turns += 1
        if own.last is not None and own.last.path.duration.sum() < slew_time:
            yield from _until_end(without_leakage)
        if turns == EARLY_OWN_TURNS:
            yield from baselines[:early_count]
        if not progress.has_motion and progress.is_half_over:
            for proposer in baselines:
                while not (proposer.has_ended or progress.has_motion):
                    yield proposer
    for proposer in baselines:
        yield from _until_end(proposer)


def schedule_in_turn(
    first: Proposer, quick: Sequence[Proposer], others: Sequence[Proposer], progress: PlanProgress
) -> Iterator[Proposer]:
    """Yield proposers from a queue until all have ended, with more turns for quick proposers.

    The first proposer of the queue has a turn and is then put back:

    - A proposer that is not quick goes to the end of the queue.
    - Before the first motion, a quick proposer goes to the head, so it has turn after turn.
    - After the first motion, a quick proposer goes behind the next proposer.

    So after the first motion, a single quick proposer has every second turn. As long as there are
    several quick proposers, each goes behind another quick one, and the rest of the queue waits.

    Args:
        first: Proposer at the head of the queue at first. It is not quick.
        quick: Quick proposers, behind `first`.
        others: All other proposers, behind the quick ones.
        progress: State of the planning loop. `has_motion` is read before each turn, so the quick
            proposer that gives the first motion has one more turn.

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
