"""Plant files: what is simulated, where that is not what its servo knows.

A whole machine file is one. Shorter ones name only what differs from the machine file, in the same
sections; joints go by their numbers: `joints: {0: {link: {mass: 5.2}}}`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mhsb_model.errors import MachineFileError, MhsbError
from mhsb_model.files.yaml_files import YamlFileError, read_yaml
from mhsb_model.machine import Machine, load_machine
from mhsb_model.schema import MachineConfig

WHOLE = "schema_version"
"""Key that tells a whole machine file."""


def load_plant(machine: Machine, file: Path) -> Machine:
    """The plant of a file for one who knows `machine`; raises MachineFileError."""
    try:
        content = read_yaml(file)
    except YamlFileError as error:
        raise MachineFileError(str(file), [error.reason]) from None
    sections = MachineConfig.model_fields
    if not isinstance(content, dict) or not content or not set(content) <= set(sections):
        problem = f"is no plant file: it is to name what differs in {', '.join(sections)}"
        raise MachineFileError(str(file), [problem])  # nothing of another file is repeated
    if WHOLE in content:
        return load_machine(file)
    try:
        return machine.with_values(flattened(content))
    except MachineFileError as error:
        raise MachineFileError(str(file), error.problems) from None
    except MhsbError as error:
        raise MachineFileError(str(file), [str(error)]) from None


def flattened(content: dict[Any, Any], above: str = "") -> dict[str, Any]:
    """Values of nested sections by their paths, `circuit.bulk_modulus`."""
    values: dict[str, Any] = {}
    for key, value in content.items():
        path = f"{above}{key}"
        values |= flattened(value, f"{path}.") if isinstance(value, dict) else {path: value}
    return values
