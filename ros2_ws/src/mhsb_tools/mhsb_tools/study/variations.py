"""Variations: how a plant may differ from its machine file, read from config/variations.yaml.

Each variation is a name for one or more values of the machine file that vary together. There are
four kinds. A `factor` multiplies the file's values and a `value` replaces them; both are drawn
uniformly from a range. A `choice` is the same text in every draw. A `moment` is a time [s] at which
the arm moves, drawn as a share of all time of motion. All variations are independent and apply at
once. A factor on a value common to all actuators also multiplies the values that single actuators
have in its place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError, model_validator

from mhsb_model.files.config_files import find_config_file
from mhsb_model.files.schema_problems import describe_validation_errors
from mhsb_model.files.value_paths import ValuePathError
from mhsb_model.files.yaml_files import read_yaml
from mhsb_model.machine import Machine
from mhsb_model.schema import Section
from mhsb_tools.errors import VariationError

VARIATIONS_FILE = "variations.yaml"
VARIATION_KINDS = ("factor", "value", "choice", "moment")

Factor = Annotated[float, Field(ge=1e-6, le=1e6)]
FileValue = Annotated[float, Field(ge=-1e15, le=1e15)]
"""Value in the unit of the entry of the machine file; the entry's own range applies as well."""

Share = Annotated[float, Field(ge=0, le=1)]


class Variation(Section):
    """Values of the machine file that vary together."""

    keys: tuple[str, ...] = Field(min_length=1, description="their paths in the machine file")
    factor: tuple[Factor, Factor] | None = Field(default=None, description="on the file's [-]")
    value: tuple[FileValue, FileValue] | None = Field(
        default=None, description="in the file's unit"
    )
    choice: str | None = None
    moment: tuple[Share, Share] | None = Field(
        default=None, description="share of the time of motion [-]"
    )
    source: str = Field(min_length=1, description="why this range")

    @model_validator(mode="after")
    def _of_one_kind(self) -> Variation:
        """Check that exactly one kind (factor, value, choice, moment) is given, with a valid range.

        Returns:
            The variation, unchanged.

        Raises:
            ValueError: None or several kinds are given, or a range has its higher end first.
                Pydantic turns it into a ValidationError.
        """
        given = [kind for kind in VARIATION_KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            raise ValueError(
                f"needs exactly one of {', '.join(VARIATION_KINDS)}, has {given or 'none'}"
            )
        if isinstance(limits := getattr(self, given[0]), tuple) and limits[0] > limits[1]:
            raise ValueError(f"the range {limits} has its higher end first")
        return self


Variations = Mapping[str, Variation]


def load_variations(machine: Machine, file: Path | None = None) -> Variations:
    """Load variations (how a plant may differ from its machine file), and check them.

    Args:
        machine: The machine whose values are varied.
        file: YAML file; None takes the suite's file.

    Returns:
        Variations by name.

    Raises:
        YamlFileError: The file cannot be read.
        VariationError: The file's content is invalid.
        MhsbError: The machine does not have one of the values, or a value is outside its range.
    """
    file = file or find_config_file(VARIATIONS_FILE)
    return validate_variations(machine, read_yaml(file), str(file))


def validate_variations(machine: Machine, content: Any, source: str) -> Variations:
    """Validate variations that were read from a file, and try them on a machine.

    Args:
        machine: The machine whose values are varied.
        content: Content of the file: a mapping for each variation, by its name.
        source: Name of the file, for error messages.

    Returns:
        Variations by name.

    Raises:
        VariationError: The content is invalid; all problems are listed, with `source`. Or a value
            with a factor is no number.
        MhsbError: The machine does not have one of the values, or a value is outside its range.
    """
    if not isinstance(content, dict) or not content:
        raise VariationError(f"{source}: names no variation; see config/{VARIATIONS_FILE}")
    variations, problems = {}, []
    for name, given in content.items():
        try:
            variations[str(name)] = Variation.model_validate(given)
        except ValidationError as error:
            problems += describe_validation_errors(error, Variation, str(name))
    if problems:
        raise VariationError(f"{source}: {'; '.join(problems)}")
    draw_machine(machine, variations, np.random.default_rng(0), float)  # raises if a key is unknown
    return variations


def draw_machine(
    machine: Machine,
    variations: Variations,
    random: np.random.Generator,
    moment_to_time: Callable[[float], float],
) -> tuple[Machine, dict[str, float | str]]:
    """Draw a random machine whose values differ from the file's, as the variations say.

    Args:
        machine: The machine whose values are varied; it is not changed itself.
        variations: Variations by name. One number is drawn for each, in their order; a choice needs
            none.
        random: Generator of random numbers; its state changes.
        moment_to_time: Function from a share of the time of motion, 0 … 1, to the time since the
            start [s]. The function is called for variations of kind `moment`.

    Returns:
        The varied machine, and a dictionary with the drawn factor, value, time [s] or choice by
        name of the variation.

    Raises:
        MhsbError: The machine does not have one of the values, a value is outside its range, or a
            value with a factor is no number.
    """
    drawn: dict[str, float | str] = {}
    values: dict[str, Any] = {}
    for name, variation in variations.items():
        if variation.choice is not None:
            drawn[name] = variation.choice
            values |= dict.fromkeys(variation.keys, variation.choice)
        elif variation.factor is not None:
            factor = random.uniform(*variation.factor)
            drawn[name] = factor
            values |= {
                path: factor * _number(machine, path)
                for key in variation.keys
                for path in machine.list_overriding_paths(key)
            }
        else:
            limits = variation.value or variation.moment
            assert limits is not None  # the validator allows one kind only
            value = random.uniform(*limits)
            drawn[name] = value if variation.moment is None else moment_to_time(value)
            values |= dict.fromkeys(variation.keys, drawn[name])
    return machine.with_values(values), drawn


def scale_values(machine: Machine, factors: Mapping[str, float], variations: Variations) -> Machine:
    """Multiply some values of a machine by factors.

    If a value is common to all actuators, the factor also multiplies the values that single
    actuators have of their own instead.

    Args:
        machine: The machine.
        factors: Factor by name. A name may be a variation, such as `payload`, or the path of a
            value in the machine file, such as `circuit.bulk_modulus`.
        variations: Variations by name. Only their keys (the values that each one stands for) are
            used, not their ranges.

    Returns:
        A changed copy of the machine.

    Raises:
        VariationError: A value does not exist, is no number, or is 0.
        MhsbError: A product is outside the range that the value may have.
    """
    values = {}
    for name, factor in factors.items():
        keys = variations[name].keys if name in variations else (name,)
        for key in (path for each in keys for path in machine.list_overriding_paths(each)):
            try:
                number = _number(machine, key)
            except ValuePathError as error:
                names = ", ".join(variations)
                raise VariationError(f"{error}; or, of variations, {names}") from None
            if number == 0.0:
                raise VariationError(
                    f"{key} is 0, whatever the factor {factor:g}; set it in a machine file of the "
                    "plant's own"
                )
            values[key] = factor * number
    return machine.with_values(values)


def _number(machine: Machine, key: str) -> float:
    """Return a number of the machine by its path in the machine file.

    Args:
        machine: The machine.
        key: Path of the value, such as `circuit.bulk_modulus`.

    Returns:
        The value in the file's unit; the default if the file leaves the key out.

    Raises:
        ValuePathError: There is no such value.
        VariationError: The value is not a number.
    """
    try:
        number = machine.value(key)
    except ValuePathError:
        number = machine.config
        for part in key.split("."):
            if part not in getattr(type(number), "model_fields", ()):
                raise
            number = getattr(number, part)
    if isinstance(number, bool) or not isinstance(number, int | float):
        raise VariationError(f"{key} is no number, so it cannot be multiplied by a factor")
    return float(number)
