"""Messages for content that a schema has refused: path, value, limit and remedy."""

import inspect
import math
import re
from collections.abc import Sequence
from typing import Any, get_args, get_type_hints

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from mhsb_model.errors import suggest_name, suggest_unit_of_number

LONGEST_VALUE = 40
"""Largest number of characters of a wrong value that a message repeats."""

LIMIT_ERRORS = {
    "greater_than": ("gt", "above", "raise it"),
    "greater_than_equal": ("ge", "at least", "raise it"),
    "less_than": ("lt", "below", "lower it"),
    "less_than_equal": ("le", "at most", "lower it"),
}
"""Errors of a broken limit by pydantic's error type.

Each value is the key of the limit in the error's context, words for the limit, and the remedy."""

LENGTH_ERRORS = {
    "too_short": ("min_length", "at least"),
    "too_long": ("max_length", "at most"),
    "string_too_short": ("min_length", "at least"),
    "string_too_long": ("max_length", "at most"),
}
"""Errors of a wrong length by pydantic's error type: key of the limit in the error's context, and
words for the limit.
"""

TYPE_NAMES = {
    "float": "a number",
    "int": "a whole number",
    "finite": "a finite number",
    "bool": "true or false",
    "string": "text",
    "list": "a list",
    "tuple": "a list",
}
"""Required type in words, by the first word of pydantic's error type, such as `int_parsing`."""


def describe_validation_errors(
    error: ValidationError, model: type[BaseModel], path_prefix: str = ""
) -> list[str]:
    """Describe each problem of a pydantic validation error in one sentence.

    If a value in a list is wrong, pydantic also reports that the list is too short. This second
    report is left out.

    Args:
        error: Error that pydantic has raised.
        model: Model against which the content was validated.
        path_prefix: Path of the content if it is part of a larger file, else empty.

    Returns:
        One string `path: sentence` for each problem, with the dotted path in the file. The sentence
        says what is wrong and what to do, with limit and value if there are any.
    """
    items = error.errors()
    broken = {item["loc"][:length] for item in items for length in range(len(item["loc"]))}
    return [
        f"{_format_path(item['loc'], model, path_prefix)}: {_describe_problem(item, model)}"
        for item in items
        # A list is counted as too short if its values are broken, though they are present.
        if not (item["type"] == "too_short" and item["loc"] in broken)
    ]


def _format_path(loc: Sequence[str | int], model: type[BaseModel], path_prefix: str) -> str:
    """Return the dotted path of a problem in the file.

    If a section can be of several kinds, pydantic inserts the kind (such as `revolute`) into its
    location. These parts are left out.

    Args:
        loc: Location of the problem as pydantic gives it: keys, list indices and kinds.
        model: Model against which the content was validated.
        path_prefix: Path of the content if it is part of a larger file, else empty.

    Returns:
        Path such as `joints.0.link.mass`; "the file" for an empty location.
    """
    named, at = [path_prefix] if path_prefix else [], [model]
    for part in loc:
        tagged = _select_models_of_kind(at, part)
        if tagged:
            at = tagged
            continue
        named.append(str(part))
        at = _find_models_below(at, part)
    return ".".join(named) or "the file"


def _describe_problem(item: Any, model: type[BaseModel]) -> str:
    """Describe one problem of a validation error: the rule, the value, and what to do.

    For an unknown error type, pydantic's message is returned in lower case, followed by the value.

    Args:
        item: One entry of pydantic's `ValidationError.errors()`.
        model: Model against which the content was validated.

    Returns:
        Sentence without subject, such as "must be above 0 kg (is -1); raise it". The caller puts
        the path before it.
    """
    kind, context = str(item["type"]), item.get("ctx", {})
    section, field = _locate_field(model, item["loc"])
    unit, value = _find_unit(field), _format_value(item.get("input")) if item["loc"] else ""
    if kind in LIMIT_ERRORS:
        return _describe_passed_limit(item, unit, value)
    if kind in LENGTH_ERRORS:
        return _describe_wrong_length(item, value)
    if kind == "missing":
        meaning = (field.description if field else "") or ""
        return f"is missing; add it{f': {meaning}' if meaning else ''}"
    if kind == "extra_forbidden":
        return _describe_unknown_key(str(item["loc"][-1]), _list_keys(section))
    if kind == "literal_error":
        return f"must be {context['expected']}{value}; give one of these"
    if kind == "union_tag_invalid":
        return f"there is no kind '{context['tag']}'; give one of {context['expected_tags']}"
    if kind == "union_tag_not_found":
        return "is missing its kind; add one"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        keys = ", ".join(_list_keys(section))
        return f"must be a section {f'with the keys {keys}' if keys else '{}'}{value}"
    if kind == "string_pattern_mismatch":
        allowed = (field.description if field else "") or f"text like {context['pattern']}"
        return f"must be {allowed}{value}; change it"
    if kind == "value_error":
        return f"{context['error']}"
    of_type = TYPE_NAMES.get(kind.partition("_")[0])
    if of_type:
        return f"must be {of_type}{f', in{unit}' if unit else ''}{value}; give one"
    return f"{str(item['msg']).lower()}{value}"


def _describe_passed_limit(item: Any, unit: str, value: str) -> str:
    """Describe a number beyond its limit, and suggest another unit if the user may have meant it.

    A unit is suggested if the number, read in this unit, is within the limit. A number without unit
    counts as a share, possibly given in percent, if it is above an upper limit of at most 1.

    Args:
        item: One entry of pydantic's `ValidationError.errors()`, of a type in LIMIT_ERRORS.
        unit: Unit of the number, with a space before it; empty if it has none.
        value: Text that shows the number, such as ` (is 17.0)`.

    Returns:
        Sentence without subject, such as "must be at most 3 rad (is 17.0); lower it".
    """
    key, words, what_to_do = LIMIT_ERRORS[item["type"]]
    limit = item["ctx"][key]
    low, high = (limit, math.inf) if key in ("gt", "ge") else (-math.inf, limit)
    si_unit = unit.strip() or ("-" if high <= 1.0 else "")
    hint = suggest_unit_of_number(float(item["input"]), si_unit, low, high)
    return f"must be {words} {limit:g}{unit}{value}{hint or f'; {what_to_do}'}"


def _describe_wrong_length(item: Any, value: str) -> str:
    """Describe a list or a text of a wrong length.

    Args:
        item: One entry of pydantic's `ValidationError.errors()`, of a type in LENGTH_ERRORS.
        value: Formatted wrong text, such as ` (is 'abc')`; not used for a list.

    Returns:
        Sentence without subject, such as "has 2 values, must have at least 3".
    """
    key, words = LENGTH_ERRORS[item["type"]]
    limit = f"{words} {item['ctx'][key]}"
    if item["type"].startswith("string"):
        return f"has {len(item['input'])} characters, must have {limit}{value}"
    return f"has {item['ctx']['actual_length']} values, must have {limit}"


def _describe_unknown_key(key: str, keys: Sequence[str]) -> str:
    """Describe a key that the schema does not have, and suggest valid keys.

    The result is a sentence without the key. The caller puts the path, which ends with the key,
    before this sentence.

    Args:
        key: Unknown key.
        keys: Valid keys of the section.

    Returns:
        Sentence that suggests the most similar valid key, or lists all of them if none is similar.
    """
    other = f"; leave it out, or give one of {', '.join(keys)}"
    return f"there is no such key{suggest_name(key, keys) or other}"


def _format_value(value: Any) -> str:
    """Format a wrong value for a message, such as ` (is 'abc')`.

    Args:
        value: Value of any type.

    Returns:
        Text with a leading space, cut after LONGEST_VALUE characters of the value. Empty if the
        value is neither text nor a number nor a bool.
    """
    if isinstance(value, str):
        return f" (is {value[:LONGEST_VALUE]!r})"
    if not isinstance(value, int | float | bool):
        return ""
    return f" (is {repr(value)[:LONGEST_VALUE]})"


def _find_unit(field: FieldInfo | None) -> str:
    """Return the unit of a field from its description, such as ` kg` from "mass [kg]".

    Args:
        field: Field of a model, or None.

    Returns:
        The last expression in square brackets, with a leading space. Empty if there is none, or if
        it is a dash, which stands for no unit.
    """
    units = re.findall(r"\[([^\[\]]+)\]", (field.description or "") if field else "")
    return f" {units[-1]}" if units and units[-1] not in "–-" else ""


def _locate_field(
    model: type[BaseModel], loc: Sequence[str | int]
) -> tuple[list[type[BaseModel]], FieldInfo | None]:
    """Find the field at a location in the content, and the models of its value.

    Args:
        model: Model against which the content was validated.
        loc: Location as pydantic gives it: keys, list indices, and kinds of sections such as
            `revolute`.

    Returns:
        The models of which the value at this location can be an instance, and the field that
        declares the value. A plain value has no models. For an unknown key: the models of the
        section around it, and None. For an empty location: `model` alone, and None.
    """
    at, field = [model], None
    for part in loc:
        if isinstance(part, int):
            continue
        if tagged := _select_models_of_kind(at, part):
            at = tagged
            continue
        owners = [each for each in at if part in each.model_fields]
        below = _find_models_below(at, part)
        if not owners and not below:
            return at, None
        field, at = owners[0].model_fields[part] if owners else None, below
    return at, field


def _find_models_below(models: Sequence[type[BaseModel]], part: str | int) -> list[type[BaseModel]]:
    """Return the pydantic models that may validate the value of a key.

    Args:
        models: Models that may validate the section with the key.
        part: Key, or a list index. For an index, `models` is returned.

    Returns:
        Models; empty for a plain value. If no model declares the key, the models for undeclared
        keys; empty if undeclared keys are not allowed.
    """
    if isinstance(part, int):
        return list(models)
    owners = [each for each in models if part in each.model_fields]
    if owners:
        return [
            one for each in owners for one in _collect_models(each.model_fields[part].annotation)
        ]
    opened = [each for each in models if each.model_config.get("extra") == "allow"]
    hints = [get_type_hints(each) for each in opened]
    return [one for each in hints for one in _collect_models(each["__pydantic_extra__"])]


def _select_models_of_kind(
    models: Sequence[type[BaseModel]], tag: str | int
) -> list[type[BaseModel]]:
    """Return the models among `models` whose field `kind` allows a tag.

    Args:
        models: Models that a section can be an instance of.
        tag: Part of a location, possibly a kind such as `revolute`.

    Returns:
        Models of that kind; empty if the tag is not a kind.
    """
    kinds = [(each, each.model_fields.get("kind")) for each in models]
    return [each for each, kind in kinds if kind and tag in get_args(kind.annotation)]


def _collect_models(annotation: Any) -> list[type[BaseModel]]:
    """Collect all pydantic models in a type annotation such as `tuple[A | B, ...] | None`.

    Args:
        annotation: Type annotation of a field.

    Returns:
        Models in the order of the annotation, here A and B. Models of their fields are not
        included.
    """
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _collect_models(part)]


def _list_keys(section: Sequence[type[BaseModel]]) -> list[str]:
    """Return the keys of all given models, without repetition, in the order of their fields."""
    return list(dict.fromkeys(key for model in section for key in model.model_fields))
