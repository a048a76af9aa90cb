"""Reading of YAML files that users name; errors do not repeat the content of a file.

A wrong path may lead to any file, even one with passwords. An error message may be sent over ROS or
end up in a log.
"""

import os
import re
import stat
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from mhsb_model.errors import MhsbError

LARGEST_FILE = 256 * 1024
"""Largest size of a file that is read [B]; the suite's own machine file has 12 kB."""

MOST_VALUES = 100_000
"""Largest number of values in a file, with the contents of its anchors counted at each use."""

LONGEST_NUMBER = 64
"""Largest number of characters of a number.

A float in full precision has 24 characters. Whole numbers of 64 characters are below 1e77 in any
base that YAML knows, so they are compared and printed without delay."""

VALUE_ERRORS = (ValueError, ArithmeticError, LookupError, TypeError, AttributeError)
"""Errors that PyYAML raises for values that do not fit their tag, such as a date with month 13."""

OF_TOKENS = re.compile(r"expected [^']*('<[a-z ]+>')?, but found '<[a-z ]+>'")
"""Messages of PyYAML that quote only its own token names, so they may be repeated in full."""

PLAIN_KEY = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,39}")
"""Keys that messages may repeat: plain names, which are not secret."""

QUOTED_PATTERN = re.compile(r"(['\"]).{3,}\1|!\S+")
"""Parts of PyYAML's messages that repeat content of the file: quoted text and tags."""


class YamlFileError(MhsbError):
    """Error for a file that cannot be read as YAML; `reason` says why, without the path."""

    def __init__(self, path: Path, reason: str) -> None:
        """Make the message from the file and the reason, and keep both as attributes.

        Args:
            path: File that cannot be read.
            reason: Clause that says why, without the path.
        """
        self.path = path
        self.reason = reason
        super().__init__(f"{path}: {reason}")


class YamlTextError(MhsbError):
    """Error for a text that cannot be read as YAML; `reason` does not repeat the text."""

    def __init__(self, reason: str) -> None:
        """Make the message from the reason.

        Args:
            reason: Clause that says why the text cannot be read, without repeating the text.
        """
        self.reason = reason
        super().__init__(f"the text {reason}")


def read_value(text: str) -> Any:
    """Read a short YAML text from a user, such as `[1, 2]`, as a plain value.

    A list or a mapping may contain single values only, no lists or mappings. This is checked before
    the text is loaded. Numbers of more than LONGEST_NUMBER characters are refused. The caller must
    limit the length of the text.

    Args:
        text: The YAML text.

    Returns:
        The value as None, bool, number, text, date, list or dict.

    Raises:
        YamlTextError: The text is not YAML, has a number that is too long, or is nested too deeply
            or in itself.
    """
    try:
        depth = 0
        # Parsing does not recurse, unlike loading, so the depth is checked with it first.
        for event in yaml.parse(text, Loader=BoundedLoader):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > 1:
                raise YamlTextError("is nested more than 1 deep; make it flatter")
        return BoundedLoader(text).get_single_data()
    except RecursionError:  # an anchor in itself
        raise YamlTextError("is nested in itself; write it out") from None
    except (yaml.YAMLError, *VALUE_ERRORS) as error:
        raise YamlTextError(f"is not YAML: {_describe_yaml_error(error)}") from None


def read_yaml(path: Path) -> Any:
    """Read a YAML file as plain values, or refuse it without repeating its content.

    The file is refused if it has more than LARGEST_FILE bytes, or a key twice in a mapping. It is
    also refused if it has more than MOST_VALUES values, with anchors counted at each use. Error
    messages contain no content of the file, except repeated keys that are plain names.

    Args:
        path: File in UTF-8.

    Returns:
        Content as dict, list, text, number, date, bool or None; None if the file is empty.

    Raises:
        YamlFileError: The file cannot be read, is not YAML, or is refused.
    """
    text = _read_text(path)
    try:
        loader = BoundedLoader(text)
        node = loader.get_single_node()
        if node is None:
            return None
        if _count_values(node, {}) > MOST_VALUES:
            reason = f"has more than {MOST_VALUES} values, with anchors written out; shorten it"
            raise YamlFileError(path, reason)
        # Checked before the document is constructed, which adds the keys of merged anchors.
        if twice := list(_find_duplicate_keys(node)):
            raise YamlFileError(path, f"{'; '.join(twice)}; keep one of each")
        return loader.construct_document(node)
    except RecursionError:
        raise YamlFileError(path, "is nested too deeply, or in itself; make it flatter") from None
    except (yaml.YAMLError, *VALUE_ERRORS) as error:
        raise YamlFileError(path, f"is not YAML: {_describe_yaml_error(error)}") from None


class BoundedLoader(yaml.SafeLoader):
    """YAML loader for plain values that refuses numbers of more than LONGEST_NUMBER characters."""


def _construct_number(kind: str, loader: BoundedLoader, node: yaml.Node) -> float:
    """Convert a node into a number.

    Args:
        kind: `int` or `float`.
        loader: Loader of the document.
        node: YAML node of the number.

    Raises:
        ConstructorError: The number has more than LONGEST_NUMBER characters.
    """
    if isinstance(node, yaml.ScalarNode) and len(node.value) > LONGEST_NUMBER:
        problem = f"a number has {len(node.value)} characters, at most {LONGEST_NUMBER} are read"
        raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
    number: float = getattr(loader, f"construct_yaml_{kind}")(node)
    return number


for _kind in ("int", "float"):
    BoundedLoader.add_constructor(f"tag:yaml.org,2002:{_kind}", partial(_construct_number, _kind))


def _read_text(path: Path) -> str:
    """Read a regular file of at most LARGEST_FILE bytes as text, without ever blocking.

    Args:
        path: File in UTF-8.

    Returns:
        Its text.

    Raises:
        YamlFileError: The path is a folder, a pipe or a device. Or the file is too large, not
            UTF-8, or cannot be opened.
    """
    try:
        if path.is_dir():
            raise YamlFileError(path, "cannot be read: it is a folder; name a file in it")
        # Without O_NONBLOCK, opening a named pipe would wait for its writer.
        with open(
            path, "rb", buffering=0, opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)
        ) as file:
            content = file.read(LARGEST_FILE + 1)
        if content is None or not stat.S_ISREG(path.stat().st_mode):
            raise YamlFileError(path, "cannot be read: it is no regular file; name one")
        if len(content) > LARGEST_FILE:
            reason = f"cannot be read: it has more than {LARGEST_FILE} bytes; is it the right file?"
            raise YamlFileError(path, reason)
        return content.decode("utf-8")
    except UnicodeDecodeError:
        raise YamlFileError(path, "is not text in UTF-8; is it the right file?") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise YamlFileError(path, f"cannot be read: {reason}; check the path") from None


def _count_values(node: yaml.Node, counted: dict[int, int]) -> int:
    """Count the values in a YAML node; the content of an anchor counts at each use.

    Each scalar, list, mapping and key counts as one value.

    Args:
        node: YAML node, such as the root of a document.
        counted: Sizes already counted, by the node's `id`; filled in place.

    Returns:
        Number of values, the node itself included.

    Raises:
        RecursionError: An anchor contains itself, or the content is nested too deeply.
    """
    if isinstance(node, yaml.ScalarNode):
        return 1
    if id(node) not in counted:
        parts = node.value
        children = (
            [child for pair in parts for child in pair]
            if isinstance(node, yaml.MappingNode)
            else parts
        )
        counted[id(node)] = 1 + sum(_count_values(child, counted) for child in children)
    return counted[id(node)]


def _find_duplicate_keys(node: yaml.Node) -> Iterator[str]:
    """Find keys that occur more than once in a mapping, at any depth of a document.

    YAML would silently keep only the last value of such a key.

    Args:
        node: Root of a YAML document.

    Yields:
        One string `path: sentence` for each repetition of a key. The sentence has the line numbers
        of the first occurrence and of the repetition. Keys that are not plain names are shown as
        `…`.
    """
    seen = set()
    waiting: list[tuple[str, yaml.Node]] = [("", node)]
    while waiting:
        path, node = waiting.pop(0)
        if id(node) in seen or isinstance(node, yaml.ScalarNode):
            continue
        seen.add(id(node))
        if not isinstance(node, yaml.MappingNode):
            waiting += [(f"{path}{number}.", each) for number, each in enumerate(node.value)]
            continue
        lines: dict[str, int] = {}
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else ""
            shown, line = name if PLAIN_KEY.fullmatch(name) else "…", key.start_mark.line + 1
            if name and name in lines:
                yield f"{path}{shown}: is there in line {lines[name]} and in line {line}"
            lines.setdefault(name, line)
            waiting.append((f"{path}{shown}.", value))


def _describe_yaml_error(error: Exception) -> str:
    """Describe a PyYAML error by its position and message, without words from the file.

    Parts of the message that quote the file are replaced by `…`.

    Args:
        error: Error that PyYAML has raised.

    Returns:
        Text such as `line 3, column 5: mapping values are not allowed here`; without position if
        the error has none.
    """
    mark = getattr(error, "problem_mark", None)
    problem = str(getattr(error, "problem", None) or "something cannot be read")
    if not OF_TOKENS.fullmatch(problem):
        problem = QUOTED_PATTERN.sub("…", problem)
    return f"line {mark.line + 1}, column {mark.column + 1}: {problem}" if mark else problem
