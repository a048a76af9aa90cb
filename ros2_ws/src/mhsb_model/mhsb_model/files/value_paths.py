"""Access to nested content by dotted paths such as `circuit.bulk_modulus` or `joints.0.kind`."""

from typing import Any

from mhsb_model.errors import MhsbError


class ValuePathError(MhsbError):
    """Error for a path that does not exist; `valid` lists the valid names at the missing part."""

    def __init__(self, path: str, part: str, valid: list[str]) -> None:
        """Make the message from the path, the part that does not exist, and the valid names.

        `path` and `valid` become attributes of the error.

        Args:
            path: Whole path, such as `joints.0.link.mass`.
            part: The part of `path` that does not exist.
            valid: Keys or indices that exist in place of `part`; empty below a plain value.
        """
        self.path = path
        self.valid = valid
        names = f"valid are {', '.join(valid)}" if valid else "nothing is below a single value"
        super().__init__(f"{path}: there is no {part!r}; {names}")


def get_value(content: Any, path: str) -> Any:
    """Return the value at a dotted path in nested content.

    Args:
        content: Nested dicts and lists.
        path: Keys and list indices, such as `joints.0.link.mass`.

    Returns:
        The value itself, not a copy; it may be a dict or a list.

    Raises:
        ValuePathError: A part of the path does not exist.
    """
    for part in path.split("."):
        content = content[_resolve_key(content, path, part)]
    return content


def set_value(content: Any, path: str, value: Any) -> None:
    """Set the value at a dotted path in nested content.

    Sections on the way that are missing or None are created. Whether a new key is allowed is not
    checked here.

    Args:
        content: Nested dicts and lists, changed in place.
        path: Keys and list indices, such as `joints.0.link.mass`.
        value: New value.

    Raises:
        ValuePathError: A part of the path is not an index of its list, or stands below a plain
            value.
    """
    *way, last = path.split(".")
    for part in way:
        if isinstance(content, dict):
            content.setdefault(part, None)
        key = _resolve_key(content, path, part)
        if content[key] is None:
            content[key] = {}
        content = content[key]
    if isinstance(content, dict):
        content[last] = value
    else:
        content[_resolve_key(content, path, last)] = value


def _resolve_key(content: Any, path: str, part: str) -> Any:
    """Convert one part of a dotted path into a key of a dict or an index of a list.

    Args:
        content: Dict, list or plain value in which the part is looked up.
        path: Whole path, for the error message.
        part: The part of the path, such as `link` or `0`.

    Returns:
        `part` itself for a dict, an int for a list.

    Raises:
        ValuePathError: `content` has no such key or index.
    """
    if isinstance(content, dict) and part in content:
        return part
    if isinstance(content, list | tuple) and part.isdecimal() and int(part) < len(content):
        return int(part)
    if isinstance(content, dict):
        valid = list(map(str, content))
    else:
        valid = [str(k) for k in range(len(content))] if isinstance(content, list | tuple) else []
    raise ValuePathError(path, part, valid)
