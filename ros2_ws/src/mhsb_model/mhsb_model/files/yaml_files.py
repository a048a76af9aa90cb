"""YAML files that users name: read as plain values, or refused without repeating their content.

A wrong path may lead to anything, a password file included, and what an error says may be sent on
over ROS or end up in a log.
"""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path
from typing import Any

import yaml

from mhsb_model.errors import MhsbError

LARGEST_FILE = 256 * 1024
"""Bytes; the suite's own machine file has 12 thousand."""

MOST_VALUES = 100_000
"""In a file whose anchors are written out."""

LONGEST_NUMBER = 64
"""Characters of a number; a float written out in full has 24. Whole numbers of any base, 60
included, then stay below 1e77, so that they can be compared and printed at once."""

UNREADABLE = (ValueError, ArithmeticError, LookupError, TypeError, AttributeError)
"""What PyYAML raises for values that are not of their tag: a date with a month 13, `!!bool x`."""

OF_TOKENS = re.compile(r"expected [^']*('<[a-z ]+>')?, but found '<[a-z ]+>'")
PLAIN_KEY = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,39}")
"""Keys that are repeated in messages: names, nothing that could be a secret."""

QUOTED = re.compile(r"(['\"]).{3,}\1|!\S+")


class YamlFileError(MhsbError):
    """A file cannot be read as YAML; `reason` says why, without the path."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(f"{path}: {reason}")


def read_yaml(path: Path) -> Any:
    """Content of a file as dict, list, text, numbers; raises YamlFileError."""
    text = _text(path)
    try:
        loader = BoundedLoader(text)
        node = loader.get_single_node()
        if node is None:
            return None
        if _size(node, {}) > MOST_VALUES:
            reason = f"has more than {MOST_VALUES} values, with anchors written out; shorten it"
            raise YamlFileError(path, reason)
        if twice := _keys_given_twice(node):  # constructing merges what anchors bring
            raise YamlFileError(path, f"{'; '.join(twice)}; keep one of each")
        return loader.construct_document(node)
    except RecursionError:
        raise YamlFileError(path, "is nested too deeply, or in itself; make it flatter") from None
    except (yaml.YAMLError, *UNREADABLE) as error:
        raise YamlFileError(path, f"is not YAML: {_problem(error)}") from None


class BoundedLoader(yaml.SafeLoader):
    """A loader of plain values that refuses numbers of more than LONGEST_NUMBER characters."""

    def construct_bounded_int(self, node: yaml.ScalarNode) -> int:
        """Return the whole number of a node; raises ConstructorError if it is too long."""
        _check_length(node)
        return self.construct_yaml_int(node)

    def construct_bounded_float(self, node: yaml.ScalarNode) -> float:
        """Return the number of a node; raises ConstructorError if it is too long."""
        _check_length(node)
        return self.construct_yaml_float(node)


BoundedLoader.add_constructor("tag:yaml.org,2002:int", BoundedLoader.construct_bounded_int)
BoundedLoader.add_constructor("tag:yaml.org,2002:float", BoundedLoader.construct_bounded_float)


def _check_length(node: yaml.Node) -> None:
    """Raise ConstructorError if a number has more characters than LONGEST_NUMBER."""
    if isinstance(node, yaml.ScalarNode) and len(node.value) > LONGEST_NUMBER:
        problem = f"a number has {len(node.value)} characters, at most {LONGEST_NUMBER} are read"
        raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)


def _text(path: Path) -> str:
    """Text of a file of reasonable size."""
    try:
        if path.is_dir():
            raise YamlFileError(path, "cannot be read: it is a folder; name a file in it")
        with open(path, "rb", buffering=0, opener=_without_waiting) as file:
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


def _without_waiting(path: str, flags: int) -> int:
    """Opens what may be a pipe that nobody writes to."""
    return os.open(path, flags | os.O_NONBLOCK)


def _size(node: yaml.Node, known: dict[int, int]) -> int:
    """Values below a node, each anchor's as often as it is used."""
    if isinstance(node, yaml.ScalarNode):
        return 1
    if id(node) not in known:
        parts = node.value
        children = [child for pair in parts for child in pair] if _is_mapping(node) else parts
        known[id(node)] = 1 + sum(_size(child, known) for child in children)
    return known[id(node)]


def _keys_given_twice(node: yaml.Node) -> list[str]:
    """Keys that a section has more than once, of which all but the last would be lost."""
    found, seen = [], set()
    waiting: list[tuple[str, yaml.Node]] = [("", node)]
    while waiting:
        path, node = waiting.pop(0)
        if id(node) in seen or isinstance(node, yaml.ScalarNode):
            continue
        seen.add(id(node))
        if not _is_mapping(node):
            waiting += [(f"{path}{number}.", each) for number, each in enumerate(node.value)]
            continue
        lines: dict[str, int] = {}
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else ""
            shown, line = name if PLAIN_KEY.fullmatch(name) else "…", key.start_mark.line + 1
            if name and name in lines:
                found.append(f"{path}{shown}: is there in line {lines[name]} and in line {line}")
            lines.setdefault(name, line)
            waiting.append((f"{path}{shown}.", value))
    return found


def _is_mapping(node: yaml.Node) -> bool:
    return isinstance(node, yaml.MappingNode)


def _problem(error: Exception) -> str:
    """Where something is wrong, and what, less the words that it quotes from the file."""
    mark = getattr(error, "problem_mark", None)
    problem = str(getattr(error, "problem", None) or "something cannot be read")
    if not OF_TOKENS.fullmatch(problem):
        problem = QUOTED.sub("…", problem)
    return f"line {mark.line + 1}, column {mark.column + 1}: {problem}" if mark else problem
