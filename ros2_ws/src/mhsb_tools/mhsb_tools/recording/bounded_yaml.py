"""Reading YAML from an untrusted source: plain values of bounded size and depth, no references."""

from typing import Any

import yaml

MAX_TEXT = 1024 * 1024
"""Length of the longest text that is read [characters]; metadata of the suite take 12 thousand."""

MAX_DEPTH = 16
"""Largest depth of nested lists and mappings; metadata of recordings have 7."""

MAX_SCALAR = 64 * 1024
"""Length of the longest single value [characters]; older metadata hold a topic's QoS as one value.
"""

MAX_NUMBER = 64
"""Length of the longest single value if values are converted to numbers [characters]."""


class YamlError(Exception):
    """A text that is no YAML or exceeds a bound; the message says which, without a period."""


def parse(text: str, *, convert_values: bool = False) -> Any:
    """Parse a YAML text of an untrusted source, within bounds of length and depth.

    The bounds are MAX_TEXT for the text, MAX_DEPTH for nested lists and mappings, and the length of
    a single value. Aliases are not allowed.

    Args:
        text: The YAML text.
        convert_values: True converts values to numbers, dates, booleans and so on. Each single
            value, text included, may then have at most MAX_NUMBER characters. False returns every
            value as text; each may have at most MAX_SCALAR characters.

    Returns:
        Nested lists and dictionaries, or a single value. None for an empty text.

    Raises:
        YamlError: The text is not YAML, exceeds a bound, has an alias, or has a value that cannot
            be converted.
    """
    if len(text) > MAX_TEXT:
        raise YamlError(f"it has more than {MAX_TEXT} characters")
    try:
        _check(text, MAX_NUMBER if convert_values else MAX_SCALAR)
        return yaml.load(text, Loader=yaml.CSafeLoader if convert_values else yaml.CBaseLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f" in line {mark.line + 1}" if mark else ""
        raise YamlError(f"it is no YAML{place}") from None
    except (ValueError, TypeError, OverflowError) as error:  # such as a date with a 13th month
        raise YamlError(f"it has a value that cannot be read ({type(error).__name__})") from None


def _check(text: str, max_scalar: int) -> None:
    """Check the bounds of a YAML text before any value is built from it.

    Args:
        text: The YAML text.
        max_scalar: Largest length of a single value [characters].

    Raises:
        YamlError: The text has an alias (reference to another part of itself), lists and mappings
            nested deeper than MAX_DEPTH, or a value longer than `max_scalar`.
        yaml.YAMLError: The text is not YAML.
    """
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
        elif isinstance(event, yaml.ScalarEvent) and len(event.value) > max_scalar:
            raise YamlError(f"a value has more than {max_scalar} characters")
