"""Which data files a recording's folder holds, by its metadata and by what is there."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from mhsb_sim.recording import bounded_yaml
from mhsb_sim.recording.bag_format import METADATA_FILE, METADATA_KEY, STORAGE, BagError
from mhsb_sim.recording.data_file import DataFile

DATA_NAME = re.compile(r"(.+?)(?:_(\d{1,9}))?\.mcap", re.DOTALL)
"""Name of a data file: that of the recording and its number, which starts at 0."""

COUNT = re.compile(r"\d{1,18}")


class MetadataError(BagError):
    """Metadata are missing, damaged, or do not agree with the files; repair writes them anew."""


@dataclass(frozen=True)
class BagFolder:
    """A recording's folder.

    files     data files that are there, in time order
    missing   messages of files that the metadata list and that are not there, by name
    listed    messages that the metadata count; None if there are no metadata that can be used
    problem   what is wrong with metadata and files, without a period; None if nothing is
    """

    path: Path
    files: tuple[Path, ...]
    missing: dict[str, int]
    listed: int | None
    problem: str | None

    @property
    def advice(self) -> str:
        """What to do if the recording is damaged."""
        return f"complete it by record --repair {self.path}"


def examine(path: Path) -> BagFolder:
    """Find the data files of a recording.

    Raises BagError where the folder holds no recording, or one of a kind that is not read.
    """
    if not path.is_dir():
        raise BagError(f"{path} is not a folder; name the folder of a recording")
    try:
        there = {each.name for each in path.iterdir() if DATA_NAME.fullmatch(each.name)}
    except OSError as error:
        raise BagError(f"{path} cannot be read: {error.strerror}; check it") from error
    problem: str | None = None
    counts: dict[str, int] = {}
    listed: int | None = None
    try:
        counts, listed = _read_metadata(path / METADATA_FILE)
    except MetadataError as error:
        problem = str(error)
    missing = {name: count for name, count in counts.items() if name not in there}
    names = [name for name in counts if name in there]
    unlisted = _of_one_recording(path, there, names)
    if not names and not unlisted:
        raise BagError(
            f"{path} holds no file {path.resolve().name}_0.mcap; name the folder of a recording"
        )
    if missing:
        problem = f"{', '.join(missing)} is missing"
    elif unlisted and not problem:
        problem = f"{unlisted[0]} is not in its {METADATA_FILE}"
    files = tuple(path / name for name in [*names, *unlisted])
    return BagFolder(path, files, missing, None if problem else listed, problem)


def _of_one_recording(path: Path, there: set[str], names: list[str]) -> list[str]:
    """Return data files beside those of these names that belong to the same recording."""
    found: dict[str, list[tuple[int, str]]] = {}
    for name in there:
        stem, number = _stem_and_number(name)
        found.setdefault(stem, []).append((number, name))
    stems = {_stem_and_number(name)[0] for name in names}
    if not stems:
        own = path.resolve().name
        stems = {own} if own in found else set(found)
    if len(stems) > 1 and not names:
        raise BagError(
            f"{path} holds data files of several recordings ({', '.join(sorted(stems)[:3])}); "
            "give each a folder of its own"
        )
    beside = sorted(each for stem in stems for each in found.get(stem, []))
    return [name for _, name in beside if name not in names]


def _stem_and_number(name: str) -> tuple[str, int]:
    match = DATA_NAME.fullmatch(name)
    assert match is not None
    return match[1], int(match[2] or 0)


def _read_metadata(path: Path) -> tuple[dict[str, int], int]:
    """Read the metadata of a recording.

    Returns:
        Messages of each data file by its name, in time order, 0 if that is not said; and messages
        in all.

    Raises:
        MetadataError: They are missing or cannot be used.
        BagError: They are of a recording that is not read here.
    """
    if not path.exists() and not path.is_symlink():
        raise MetadataError(f"it has no {METADATA_FILE}")
    with DataFile(path) as file:
        content = file.read(0, bounded_yaml.MAX_TEXT + 1)
    try:
        whole = bounded_yaml.parse(content.decode("utf-8"))
    except UnicodeDecodeError:
        raise MetadataError(f"its {METADATA_FILE} is no text in UTF-8") from None
    except bounded_yaml.YamlError as error:
        raise MetadataError(f"its {METADATA_FILE} cannot be used: {error}") from None
    metadata = _part(whole, METADATA_KEY, dict)
    _check_kind(path.parent, metadata)
    names = [PurePath(str(each)).name for each in _part(metadata, "relative_file_paths", list)]
    wrong = [name for name in names if not DATA_NAME.fullmatch(name)]
    if wrong or not names or len(set(names)) < len(names):
        raise MetadataError(f"its {METADATA_FILE} lists no data files that can be used")
    counts = dict.fromkeys(names, 0)
    files = metadata.get("files")
    for each in files if isinstance(files, list) else []:
        if isinstance(each, dict) and (name := PurePath(str(each.get("path"))).name) in counts:
            counts[name] = _count(each)
    return counts, _count(metadata)


def _check_kind(folder: Path, metadata: dict[str, Any]) -> None:
    """Raise BagError unless a recording is of the kind that is read."""
    storage = str(metadata.get("storage_identifier"))[:20]
    if storage != STORAGE:
        raise BagError(
            f"the recording {folder} is stored as '{storage}', which is not read; "
            f"convert it to {STORAGE} by ros2 bag convert"
        )
    mode = str(metadata.get("compression_mode") or "none")[:20]
    if mode.lower() != "none":
        raise BagError(
            f"the recording {folder} is compressed by rosbag2 (mode '{mode}'), which is not read; "
            "convert it by ros2 bag convert; compressed chunks of an MCAP file are read"
        )


def _part(whole: Any, key: str, kind: type) -> Any:
    part = whole.get(key) if isinstance(whole, dict) else None
    if not isinstance(part, kind):
        raise MetadataError(f"its {METADATA_FILE} has no {key}")
    return part


def _count(metadata: dict[str, Any]) -> int:
    text = str(metadata.get("message_count"))
    if not COUNT.fullmatch(text):
        raise MetadataError(f"its {METADATA_FILE} has no message_count")
    return int(text)
