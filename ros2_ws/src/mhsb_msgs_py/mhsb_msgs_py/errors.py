"""Errors for messages that cannot be used."""

from mhsb_model.errors import MhsbError
from mhsb_model.goal import Goal
from mhsb_model.verdict import Verdict

LONGEST_SENTENCE = 400
"""Largest number of characters of an error's sentence."""


class MessageError(MhsbError):
    """Error: a message breaks its contract; the text names the value, the limit and what to do.

    The text may repeat parts of the message, which can contain anything. So the text is cut off
    after `LONGEST_SENTENCE` characters. Characters that cannot be printed, line breaks included,
    are replaced.
    """

    def __init__(self, sentence: str) -> None:
        """Make the error from a sentence, which is cut after LONGEST_SENTENCE characters.

        Characters that cannot be printed are replaced.

        Args:
            sentence: What is wrong, the limit, and what to do.
        """
        shown = "".join(each if each.isprintable() else "\ufffd" for each in sentence)
        cut = shown if len(shown) <= LONGEST_SENTENCE else f"{shown[:LONGEST_SENTENCE]} …"
        super().__init__(cut)


class GoalError(MessageError):
    """Error: a goal pose cannot be used.

    Attributes:
        code: Code of the goal's verdict.
        goal: The goal as it was read; if it was not read, a goal at the origin with stamp 0.
    """

    def __init__(self, code: Verdict, sentence: str, goal: Goal | None = None) -> None:
        """Make the error.

        Args:
            code: Code of the goal's verdict.
            sentence: What is wrong, the limit, and what to do.
            goal: The goal as it was read. None if it was not read; the error then has a goal at the
                origin with stamp 0.
        """
        self.code = code
        self.goal = goal or Goal(0, 0.0, 0.0)
        super().__init__(sentence)
