"""Values of nested content by their paths: `circuit.bulk_modulus`, `joints.0.link.mass`."""

from __future__ import annotations

from typing import Any

from mhsb_model.errors import MhsbError


class ValuePathError(MhsbError):
    """There is no value of that path; `valid` are the names where it goes wrong."""

    def __init__(self, path: str, part: str, valid: list[str]) -> None:
        self.path = path
        self.valid = valid
        names = f"valid are {', '.join(valid)}" if valid else "nothing is below a single value"
        super().__init__(f"{path}: there is no {part!r}; {names}")


def value_at(content: Any, path: str) -> Any:
    """The value of a path; raises ValuePathError."""
    for part in path.split("."):
        content = content[_key(content, path, part)]
    return content


def set_value(content: Any, path: str, value: Any) -> None:
    """Put a value where a path leads, into a section that was left out too.

    Whether the last name is one that is known is the schema's question. Raises ValuePathError.
    """
    *way, last = path.split(".")
    for part in way:
        key = _key(content, path, part)
        if content[key] is None:
            content[key] = {}
        content = content[key]
    if isinstance(content, dict):
        content[last] = value
    else:
        content[_key(content, path, last)] = value


def _key(content: Any, path: str, part: str) -> Any:
    """The key of a part of a path: a name of a section, a number of a list."""
    if isinstance(content, dict) and part in content:
        return part
    if isinstance(content, list | tuple) and part.isdecimal() and int(part) < len(content):
        return int(part)
    if isinstance(content, dict):
        valid = list(map(str, content))
    else:
        valid = [str(k) for k in range(len(content))] if isinstance(content, list | tuple) else []
    raise ValuePathError(path, part, valid)
