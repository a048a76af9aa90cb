"""Locations of the files in the suite's config folder."""

from contextlib import suppress
from pathlib import Path

from mhsb_model.errors import MhsbError

PACKAGE_FOLDER = Path(__file__).resolve().parents[1]
"""Folder of the package mhsb_model."""


def find_config_file(name: str) -> Path:
    """Return the path of a file in the suite's config folder.

    The folder `config` beside this package's modules is searched first; a checkout and a pip
    installation have it. Then the share folder of the installed ROS package is searched.

    Args:
        name: Path relative to the config folder, such as `mhsb_arm3.yaml` or `views/mhsb.rviz`.

    Returns:
        Path of an existing file.

    Raises:
        MhsbError: The file is in neither place.
    """
    own = PACKAGE_FOLDER / "config" / name
    if own.is_file():
        return own.resolve()
    try:
        from ament_index_python.packages import get_package_share_directory

        installed = Path(get_package_share_directory("mhsb_model")) / "config" / name
        if installed.is_file():
            return installed
    except (ImportError, LookupError, OSError):
        pass  # no ROS, or none that is sourced
    raise MhsbError(f"config/{name} is neither in the installation nor beside the source")


def find_machine_config_file(name: str, machine: str | None) -> Path:
    """Return a machine's variant of a config file, or the general file if there is no variant.

    The variant of NAME.yaml for machine M is NAME_M.yaml, such as `demo_goals_excavator.yaml`.

    Args:
        name: Name of the general file, such as `demo_goals.yaml`.
        machine: Name of the machine; None returns the general file.

    Returns:
        Path of an existing file in the suite's config folder.

    Raises:
        MhsbError: Neither the variant nor the general file exists.
    """
    own = Path(name)
    if machine is not None:
        with suppress(MhsbError):
            return find_config_file(f"{own.stem}_{machine}{own.suffix}")
    return find_config_file(name)
