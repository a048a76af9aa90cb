"""YAML from a stranger: plain values of bounded size and depth, without references."""

from __future__ import annotations

from typing import Any

import yaml

MAX_TEXT = 1024 * 1024
"""Longest text [characters]; the metadata of a recording of the suite take 12 thousand."""

MAX_DEPTH = 16
"""Sections within each other; metadata of recordings have 7."""

MAX_SCALAR = 64 * 1024
"""Longest single value [characters]; older metadata have a topic's QoS as one."""

MAX_NUMBER = 64
"""Longest single value that may be a number [characters]."""


class YamlError(Exception):
    """A text is no YAML, or exceeds a bound; the text says which, without a period."""


def parse(text: str, *, values: bool = False) -> Any:
    """Return the content of a text.

    Args:
        text: The YAML.
        values: Read numbers, dates and so on, each at most MAX_NUMBER long; otherwise every value
            is a text.

    Raises:
        YamlError: It is no YAML, or exceeds a bound of this module.
    """
    if len(text) > MAX_TEXT:
        raise YamlError(f"it has more than {MAX_TEXT} characters")
    try:
        _check(text, MAX_NUMBER if values else MAX_SCALAR)
        return yaml.load(text, Loader=yaml.CSafeLoader if values else yaml.CBaseLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f" in line {mark.line + 1}" if mark else ""
        raise YamlError(f"it is no YAML{place}") from None
    except (ValueError, TypeError, OverflowError) as error:  # such as a date with a month 13
        raise YamlError(f"it has a value that cannot be read ({type(error).__name__})") from None


def _check(text: str, longest: int) -> None:
    """Raise YamlError where a text exceeds a bound, before anything is built from it."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.CBaseLoader):
        if isinstance(event, yaml.AliasEvent):
            raise YamlError("it refers to a part of itself")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                raise YamlError(f"it has more than {MAX_DEPTH} sections within each other")
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        elif isinstance(event, yaml.ScalarEvent) and len(event.value) > longest:
            raise YamlError(f"a value has more than {longest} characters")
