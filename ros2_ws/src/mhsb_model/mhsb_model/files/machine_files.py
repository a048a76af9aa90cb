"""Machine files: how they are found by path or name, and read."""

from contextlib import suppress
from pathlib import Path
from typing import Any

from mhsb_model.errors import MachineFileError, MhsbError, suggest_name
from mhsb_model.files.config_files import find_config_file
from mhsb_model.files.yaml_files import YamlFileError, read_yaml
from mhsb_model.schema import MachineConfig

MACHINE_FILE = "mhsb_arm3.yaml"
"""Name of the machine file of the suite's own arm, in the folder config."""
FILE_SECTIONS = tuple(
    name for name, part in MachineConfig.model_fields.items() if part.is_required()
)
"""Names of the sections that every machine file must have."""


def find_machine_file(path: str | Path | None = None) -> Path:
    """Find the machine file for a path or for the name of one of the suite's machines.

    Args:
        path: A path, or a name without a suffix such as `excavator`. A name stands for a file of
            the suite, unless a file of that name exists. None or an empty text stands for the
            suite's own arm.

    Returns:
        Path of the file. It need not exist if a path, or an unknown name, was given.

    Raises:
        MhsbError: The suite's own arm is wanted, but its file is not installed.
    """
    if not path:
        return find_config_file(MACHINE_FILE)
    file = Path(path)
    if file.name == str(path) and not file.suffix and not file.exists():
        with suppress(MhsbError):
            return find_config_file(f"{file.name}.yaml")
    return file


def read_machine_file(file: Path) -> Any:
    """Read a machine file, without a check by a schema.

    Args:
        file: Path that `find_machine_file` returned.

    Returns:
        The file's content as nested dicts and lists.

    Raises:
        MachineFileError: The file cannot be read, or lacks more than half of FILE_SECTIONS.
    """
    try:
        content = read_yaml(file)
    except YamlFileError as error:
        raise MachineFileError(str(file), [error.reason + _suggest_machine(file)]) from None
    missing = [
        name for name in FILE_SECTIONS if not (isinstance(content, dict) and name in content)
    ]
    if len(missing) > len(FILE_SECTIONS) / 2:  # another kind of file: do not quote it
        reason = f"is not a machine file: it lacks {', '.join(missing)}; copy config/{MACHINE_FILE}"
        raise MachineFileError(str(file), [reason])
    return content


def _suggest_machine(file: Path) -> str:
    """Return "; did you mean NAME?" for an unknown name of a machine of the suite.

    Args:
        file: Path that `find_machine_file` returned and that cannot be read.

    Returns:
        The clause with the nearest name; empty for a path, or if no name is near.
    """
    if file.suffix or file.name != str(file) or file.exists():
        return ""
    names = [
        each.stem
        for each in find_config_file(MACHINE_FILE).parent.glob("*.yaml")
        if "\njoints:" in each.read_text(encoding="utf-8")
    ]
    return suggest_name(file.name, names)
