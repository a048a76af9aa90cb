"""Folders for results, made before the work whose results they are for."""

from __future__ import annotations

from pathlib import Path

from mhsb_model.errors import MhsbError


def make_output_folder(path: Path, purpose: str) -> Path:
    """The folder, made where it is missing; MhsbError where something else has its name.

    purpose: what it is for, as in "name one for the report".
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise MhsbError(f"{path} is not a folder; name one for {purpose}") from None
    return path


def make_room_for(file: Path, purpose: str) -> Path:
    """The file, its folder made where it is missing; MhsbError where it cannot be a file.

    purpose: as in "name a file for the picture".
    """
    if file.is_dir():
        raise MhsbError(f"{file} is a folder; name a file for {purpose}")
    make_output_folder(file.parent, purpose)
    return file
