"""What is wrong with a file's content by its schema: path, value, limit and what to do."""

from __future__ import annotations

import difflib
import inspect
import re
from collections.abc import Sequence
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

LONGEST_VALUE = 40
"""Characters of a wrong value that a message repeats."""

LIMITS = {
    "greater_than": ("gt", "above", "raise it"),
    "greater_than_equal": ("ge", "at least", "raise it"),
    "less_than": ("lt", "below", "lower it"),
    "less_than_equal": ("le", "at most", "lower it"),
}
"""Of pydantic's kinds of error: where the limit stands, what it is, what to do."""

TYPES = {
    "float": "a number",
    "int": "a whole number",
    "finite": "a finite number",
    "bool": "true or false",
    "string": "text",
    "list": "a list",
    "tuple": "a list",
}
"""What a value must be, by how pydantic's kind of error begins."""


def problems_of(error: ValidationError, model: type[BaseModel], above: str = "") -> list[str]:
    """One sentence for each problem with content that a model refused, by its path.

    above  path of the content itself, where it stands in a larger file
    """
    items = error.errors()
    broken = {item["loc"][:length] for item in items for length in range(len(item["loc"]))}
    return [
        f"{_path(item['loc'], model, above)}: {_sentence(item, model)}"
        for item in items
        if not (item["type"] == "too_short" and item["loc"] in broken)  # what is broken is there
    ]


def _path(loc: Sequence[str | int], model: type[BaseModel], above: str) -> str:
    """Where in the file, without the kinds that pydantic puts in between."""
    named, at = [above] if above else [], [model]
    for part in loc:
        tagged = _of_kind(at, part)
        if tagged:
            at = tagged
            continue
        named.append(str(part))
        at = _below(at, part)
    return ".".join(named) or "the file"


def _sentence(item: Any, model: type[BaseModel]) -> str:
    kind, context = str(item["type"]), item.get("ctx", {})
    section, field = _place(model, item["loc"])
    unit, value = _unit(field), _shown(item.get("input")) if item["loc"] else ""
    if kind in LIMITS:
        key, words, what_to_do = LIMITS[kind]
        return f"must be {words} {context[key]:g}{unit}{value}; {what_to_do}"
    if kind == "missing":
        meaning = (field.description if field else "") or ""
        return f"is missing; add it{f': {meaning}' if meaning else ''}"
    if kind == "extra_forbidden":
        return _unknown(str(item["loc"][-1]), _keys(section))
    if kind == "literal_error":
        return f"must be {context['expected']}{value}; give one of these"
    if kind == "union_tag_invalid":
        return f"there is no kind '{context['tag']}'; give one of {context['expected_tags']}"
    if kind == "union_tag_not_found":
        return "is missing its kind; add one"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return f"must be a section with the keys {', '.join(_keys(section))}{value}"
    if kind in ("too_short", "too_long"):
        least, most = context.get("min_length"), context.get("max_length")
        limit = f"at least {least}" if kind == "too_short" else f"at most {most}"
        return f"has {context['actual_length']} values, must have {limit}"
    if kind == "string_pattern_mismatch":
        allowed = (field.description if field else "") or f"text like {context['pattern']}"
        return f"must be {allowed}{value}; change it"
    if kind in ("string_too_long", "string_too_short"):
        least, most = context.get("min_length"), context.get("max_length")
        limit = f"at most {most}" if kind == "string_too_long" else f"at least {least}"
        return f"has {len(item['input'])} characters, must have {limit}{value}"
    if kind == "value_error":
        return f"{context['error']}"
    of_type = TYPES.get(kind.partition("_")[0])
    if of_type:
        return f"must be {of_type}{f', in{unit}' if unit else ''}{value}; give one"
    return f"{str(item['msg']).lower()}{value}"


def _unknown(key: str, keys: Sequence[str]) -> str:
    """What is told of a key that is not there; never its value, which may be anything."""
    close = difflib.get_close_matches(key, keys, 1)
    if close:
        return f"there is no such key; did you mean {close[0]}?"
    return f"there is no such key; leave it out, or give one of {', '.join(keys)}"


def _shown(value: Any) -> str:
    """Return a value in brackets, cut to what can be repeated; nothing for lists and sections."""
    if isinstance(value, str):
        return f" (is {value[:LONGEST_VALUE]!r})"
    if not isinstance(value, int | float | bool):
        return ""
    return f" (is {repr(value)[:LONGEST_VALUE]})"


def _unit(field: FieldInfo | None) -> str:
    """The unit in a value's description, after a space; nothing where there is none."""
    units = re.findall(r"\[([^\[\]]+)\]", (field.description or "") if field else "")
    return f" {units[-1]}" if units and units[-1] not in "–-" else ""


def _place(
    model: type[BaseModel], loc: Sequence[str | int]
) -> tuple[list[type[BaseModel]], FieldInfo | None]:
    """What a place can hold, and its field; of a key that is not there the section around it."""
    at, field = [model], None
    for part in loc:
        if isinstance(part, int):
            continue
        if tagged := _of_kind(at, part):
            at = tagged
            continue
        owners = [each for each in at if part in each.model_fields]
        if not owners:
            return at, None
        field, at = owners[0].model_fields[part], _below(at, part)
    return at, field


def _below(at: Sequence[type[BaseModel]], part: str | int) -> list[type[BaseModel]]:
    if isinstance(part, int):
        return list(at)
    owners = [each for each in at if part in each.model_fields]
    return [one for each in owners for one in _models(each.model_fields[part].annotation)]


def _of_kind(at: Sequence[type[BaseModel]], tag: str | int) -> list[type[BaseModel]]:
    """Of several sections that a place can hold those of that kind."""
    kinds = [(each, each.model_fields.get("kind")) for each in at]
    return [each for each, kind in kinds if kind and tag in get_args(kind.annotation)]


def _models(annotation: Any) -> list[type[BaseModel]]:
    """All sections in a type such as tuple[A | B, ...] | None."""
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]


def _keys(section: Sequence[type[BaseModel]]) -> list[str]:
    return list(dict.fromkeys(key for model in section for key in model.model_fields))
