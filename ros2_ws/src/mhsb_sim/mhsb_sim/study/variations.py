"""What a machine may be like that is not as its file says, read from config/variations.yaml.

Each variation is a name for one or more values of the machine file, which vary together: by a
`factor`, to a `value`, both drawn evenly from a range, or to a `choice`, the same in every draw; a
`moment` is a time [s] in which the arm moves, drawn as a share of all of these. All are
independent of each other, and all at once. A factor on what is common to all actuators is one on
what some have of their own in its place, too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError, model_validator

from mhsb_model.files.config_files import config_file
from mhsb_model.files.schema_problems import problems_of
from mhsb_model.files.value_paths import ValuePathError
from mhsb_model.files.yaml_files import YamlFileError, read_yaml
from mhsb_model.machine import Machine
from mhsb_model.schema import Section
from mhsb_sim.errors import VariationError

VARIATIONS_FILE = "variations.yaml"
KINDS = ("factor", "value", "choice", "moment")

Factor = Annotated[float, Field(ge=1e-6, le=1e6)]
FileValue = Annotated[float, Field(ge=-1e15, le=1e15)]
"""In the unit of whatever value of the machine file; its own range holds as well."""

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
        given = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            raise ValueError(f"needs exactly one of {', '.join(KINDS)}, has {given or 'none'}")
        if isinstance(limits := getattr(self, given[0]), tuple) and limits[0] > limits[1]:
            raise ValueError(f"the range {limits} has its higher end first")
        return self


Variations = Mapping[str, Variation]


def load_variations(machine: Machine, file: Path | None = None) -> Variations:
    """Variations of a file, the suite's own when left out, for a machine; raises VariationError."""
    file = file or config_file(VARIATIONS_FILE)
    try:
        content = read_yaml(file)
    except YamlFileError as error:
        raise VariationError(str(error)) from None
    return variations_of(machine, content, str(file))


def variations_of(machine: Machine, content: Any, source: str) -> Variations:
    """Variations as a file has them, for a machine; raises VariationError, which names source."""
    if not isinstance(content, dict) or not content:
        raise VariationError(f"{source}: names no variation; see config/{VARIATIONS_FILE}")
    variations, problems = {}, []
    for name, given in content.items():
        try:
            variations[str(name)] = Variation.model_validate(given)
        except ValidationError as error:
            problems += problems_of(error, Variation, str(name))
    if problems:
        raise VariationError(f"{source}: {'; '.join(problems)}")
    varied(machine, variations, np.random.default_rng(0), float)  # whether all keys are known
    return variations


def varied(
    machine: Machine,
    variations: Variations,
    random: np.random.Generator,
    moment: Callable[[float], float],
) -> tuple[Machine, dict[str, float | str]]:
    """One draw: the machine, and what was drawn, by name.

    moment: the time [s] at a share of all time of motion. Raises MhsbError where the variations
    are none of this machine.
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
                for path in machine.paths_with_own(key)
            }
        else:
            limits = variation.value or variation.moment
            assert limits is not None  # of one kind
            value = random.uniform(*limits)
            drawn[name] = value if variation.moment is None else moment(value)
            values |= dict.fromkeys(variation.keys, drawn[name])
    return machine.with_values(values), drawn


def scaled(machine: Machine, factors: Mapping[str, float], variations: Variations) -> Machine:
    """The machine with some of its values times a factor.

    factors: by the name of a variation, or by the path of a value in the machine file. Raises
    MhsbError.
    """
    values = {}
    for name, factor in factors.items():
        keys = variations[name].keys if name in variations else (name,)
        for key in (path for each in keys for path in machine.paths_with_own(each)):
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
    number = machine.value(key)
    if isinstance(number, bool) or not isinstance(number, int | float):
        raise VariationError(f"{key} is no number, so it cannot be multiplied by a factor")
    return float(number)
