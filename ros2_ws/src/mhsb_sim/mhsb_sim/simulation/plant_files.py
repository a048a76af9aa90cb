"""Plant files: descriptions of the simulated machine that differ from the machine its servo knows.

A complete machine file is a plant file. A shorter one names only what differs from the machine
file, in the same sections. Joints are named by their numbers: `joints: {0: {link: {mass: 5.2}}}`.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mhsb_control import load_machine
from mhsb_model.errors import MachineFileError, MhsbError, suggest_name
from mhsb_model.files.yaml_files import YamlFileError, read_yaml
from mhsb_model.machine import Machine
from mhsb_model.schema import MachineConfig
from mhsb_sim.errors import PlantError, PlantFileError

COMPARED_COUNTS: tuple[tuple[str, Callable[[Machine], object]], ...] = (
    ("joints", lambda machine: machine.joint_count),
    ("booster modules", lambda machine: machine.arrays.module_count),
)
"""Numbers that must be equal in the plant and in the machine that its servo knows."""


def check_plant(machine: Machine, plant: Machine) -> None:
    """Check that two machines have equal numbers of joints and of booster modules.

    Args:
        machine: The machine that the servo knows.
        plant: The machine that is simulated.

    Raises:
        PlantError: The numbers differ.
    """
    for text, of in COMPARED_COUNTS:
        known, real = of(machine), of(plant)
        if known != real:
            raise PlantError(
                f"the plant has {real} {text}, the machine that its servo knows has {known}; "
                "both files must describe arms of the same build"
            )


MACHINE_FILE_KEY = "schema_version"
"""Key by which a complete machine file is recognised."""


def load_plant(machine: Machine, file: Path) -> Machine:
    """Load the plant, which is the machine to simulate, from a file.

    A complete machine file is recognised by its key `schema_version`. A shorter file lists only
    values that differ from `machine`, in the sections of a machine file.

    Args:
        machine: The machine that the servo knows; it stays unchanged.
        file: Plant file (YAML).

    Returns:
        The machine to simulate.

    Raises:
        PlantFileError: The file cannot be read, has other sections than a machine file, or gives no
            valid machine.
    """
    try:
        content = read_yaml(file)
        sections = MachineConfig.model_fields
        if not isinstance(content, dict) or not _has_sections(content):
            # The content of another kind of file is not repeated, not even its keys.
            problem = f"is no plant file: it is to name what differs in {', '.join(sections)}"
            raise PlantFileError(str(file), [problem])
        if MACHINE_FILE_KEY in content:
            return load_machine(file)
        return machine.with_values(flatten_sections(content))
    except YamlFileError as error:
        raise PlantFileError(str(file), [error.reason]) from None
    except MachineFileError as error:
        raise PlantFileError(str(file), error.problems) from None
    except MhsbError as error:
        raise PlantFileError(str(file), [str(error)]) from None


def _has_sections(content: dict[Any, Any]) -> bool:
    """Return whether more than half of the keys are sections of a machine file, or misspelt ones.

    Args:
        content: Content of a file.
    """
    sections = MachineConfig.model_fields
    found = sum(bool(suggest_name(str(key), sections)) for key in content)
    return 2 * found > len(content)


def flatten_sections(content: dict[Any, Any], above: str = "") -> dict[str, Any]:
    """Flatten nested dictionaries into one dictionary with dotted keys.

    Args:
        content: Nested dictionary.
        above: Text before all keys, for instance "circuit.".

    Returns:
        Values by their paths, for instance "circuit.bulk_modulus".
    """
    values: dict[str, Any] = {}
    for key, value in content.items():
        path = f"{above}{key}"
        values |= flatten_sections(value, f"{path}.") if isinstance(value, dict) else {path: value}
    return values
