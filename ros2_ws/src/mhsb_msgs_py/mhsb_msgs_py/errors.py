"""What is raised when a message cannot be used."""

from __future__ import annotations

from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.verdict import Verdict

LONGEST_SENTENCE = 400


class MessageError(MhsbError):
    """A message breaks its contract; the text names the value, the limit and what to do.

    What it repeats of a message may be anything: the text is cut off where it gets long, and shows
    what cannot be printed, line breaks included, as a replacement character.
    """

    def __init__(self, sentence: str) -> None:
        shown = "".join(each if each.isprintable() else "\ufffd" for each in sentence)
        cut = shown if len(shown) <= LONGEST_SENTENCE else f"{shown[:LONGEST_SENTENCE]} …"
        super().__init__(cut)


class GoalError(MessageError):
    """A goal pose cannot be used; carries the verdict's code and the goal as it was read, if it
    was."""

    def __init__(self, code: Verdict, sentence: str, goal: Goal | None = None) -> None:
        self.code = code
        self.goal = goal or Goal(0, 0.0, 0.0)
        super().__init__(sentence)
