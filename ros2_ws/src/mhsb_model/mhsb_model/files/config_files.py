"""Locations of the files in the suite's config folder: installed, or in the source tree."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from mhsb_model.errors import MhsbError


def find_config_file(name: str) -> Path:
    """Return the path of a file in the suite's config folder.

    The installed package's folder is searched first. If the file is not there, or ROS is missing,
    the `config` folders above this source file are searched, the nearest one first.

    Args:
        name: Path relative to the config folder, such as `mhsb_arm3.yaml` or `views/mhsb.rviz`.

    Returns:
        Path of an existing file.

    Raises:
        MhsbError: The file is in neither place.
    """
    try:
        from ament_index_python.packages import get_package_share_directory

        installed = Path(get_package_share_directory("mhsb_model")) / "config" / name
        if installed.is_file():
            return installed
    except (ImportError, LookupError):
        pass  # not installed, or without ROS: search the source tree
    for folder in Path(__file__).resolve().parents:
        candidate = folder / "config" / name
        if candidate.is_file():
            return candidate
    raise MhsbError(f"config/{name} is neither in the installation nor beside the source")


def find_machine_config_file(name: str, machine: str | None) -> Path:
    """Return the variant of a config file for a machine, or the general file if it has none.

    The variant of NAME.yaml for machine M is NAME_M.yaml, such as `demo_goals_excavator.yaml`.

    Args:
        name: Name of the general file, such as `demo_goals.yaml`.
        machine: Name of the machine; None if none is given, which finds the general file.

    Returns:
        Path of an existing file.

    Raises:
        MhsbError: The general file is needed and does not exist.
    """
    own = Path(name)
    with suppress(MhsbError):
        return find_config_file(f"{own.stem}_{machine}{own.suffix}")
    return find_config_file(name)
