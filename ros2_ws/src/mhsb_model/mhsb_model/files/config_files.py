"""Where the files of the suite's config folder are: installed, or in the source tree."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from mhsb_model.errors import MhsbError


def config_file(name: str) -> Path:
    """The file of that name: of the installation, else of the source tree; MhsbError if nowhere."""
    try:
        from ament_index_python.packages import get_package_share_directory

        installed = Path(get_package_share_directory("mhsb_model")) / "config" / name
        if installed.is_file():
            return installed
    except (ImportError, LookupError):
        pass  # not installed, or without ROS: the source tree is as good
    for folder in Path(__file__).resolve().parents:
        candidate = folder / "config" / name
        if candidate.is_file():
            return candidate
    raise MhsbError(f"config/{name} is neither in the installation nor beside the source")


def of_machine(name: str, machine: str | None) -> Path:
    """The machine's own file beside that of the suite's own arm, NAME_MACHINE.yaml beside
    NAME.yaml, or that one where it has none."""
    own = Path(name)
    with suppress(MhsbError):
        return config_file(f"{own.stem}_{machine}{own.suffix}")
    return config_file(name)
