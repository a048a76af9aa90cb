"""Data files of a recording's folder, found from its metadata and from the files that exist."""

import re
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from mhsb_tools.recording import bounded_yaml
from mhsb_tools.recording.bag_format import METADATA_FILE, METADATA_KEY, STORAGE_ID, BagError
from mhsb_tools.recording.data_file import DataFile

DATA_NAME = re.compile(r"(.+?)(?:_(\d{1,9}))?\.mcap", re.DOTALL)
"""Pattern of a data file's name: name of the recording, and optionally `_` and a number from 0 on.
"""

COUNT_PATTERN = re.compile(r"\d{1,18}")
"""Pattern of a message count in the metadata: at most 18 digits."""


class MetadataError(BagError):
    """Metadata that are missing, damaged, or contradict the files; a repair writes new ones."""


@dataclass(frozen=True)
class BagFolder:
    """Data files of a recording, and what is wrong with them.

    Attributes:
        path: Folder of the recording.
        files: Data files that exist, in time order.
        missing: Message count of each data file that the metadata list and that does not exist, by
            file name.
        listed_count: Number of messages by the metadata; None if `problem` is not None.
        problem: What is wrong with metadata or files, without a period; None if nothing is wrong.
    """

    path: Path
    files: tuple[Path, ...]
    missing: dict[str, int]
    listed_count: int | None
    problem: str | None

    @property
    def advice(self) -> str:
        """Advice for the user if the recording is damaged, as part of a sentence."""
        return f"complete it by mhsb record --repair {self.path}"


def find_data_files(path: Path) -> BagFolder:
    """Find the data files of a recording and compare their names with its metadata.

    Files that the metadata list come first, in the listed order. Then come unlisted data files of
    the same recording, ordered by the number in their name. The data files are not opened.

    Args:
        path: Folder of the recording.

    Returns:
        The files. Its `problem` says whether listed files are missing, the metadata are missing or
        damaged, or a file is not listed. If several of these are true, it says the first.

    Raises:
        BagError: The folder cannot be read, has no data file, has files of several recordings, or
            has a recording that is not stored as plain MCAP.
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
    unlisted = _find_unlisted_files(path, there, names)
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


def _find_unlisted_files(
    path: Path, existing_names: set[str], listed_names: list[str]
) -> list[str]:
    """Return the data files that belong to a recording although its metadata do not list them.

    The stem of `run_3.mcap` is `run`. A file belongs to the recording if its name has the
    recording's stem. That stem is the first of these that exists:

    1. the stem of the listed files (if they have several stems, each of them);
    2. the name of the folder, if it is the stem of a file;
    3. the stem of all data files, if they have only one.

    Args:
        path: Folder of the recording.
        existing_names: Names of all data files in the folder.
        listed_names: Names of the data files that the metadata list and that exist.

    Returns:
        Names that are not in `listed_names`, ordered by file number and then by name.

    Raises:
        BagError: None of the three exists, so the folder has files of several recordings.
    """
    found: dict[str, list[tuple[int, str]]] = {}
    for name in existing_names:
        stem, number = _stem_and_number(name)
        found.setdefault(stem, []).append((number, name))
    stems = {_stem_and_number(name)[0] for name in listed_names}
    if not stems:
        own = path.resolve().name
        stems = {own} if own in found else set(found)
    if len(stems) > 1 and not listed_names:
        raise BagError(
            f"{path} holds data files of several recordings ({', '.join(sorted(stems)[:3])}); "
            "give each a folder of its own"
        )
    beside = sorted(each for stem in stems for each in found.get(stem, []))
    return [name for _, name in beside if name not in listed_names]


def _stem_and_number(name: str) -> tuple[str, int]:
    """Split the name of a data file.

    Args:
        name: A name that matches DATA_NAME, such as `run_3.mcap`.

    Returns:
        Name of the recording, and number of the file (0 if the name has none).
    """
    match = DATA_NAME.fullmatch(name)
    assert match is not None
    return match[1], int(match[2] or 0)


def _read_metadata(path: Path) -> tuple[dict[str, int], int]:
    """Read the names of the data files and the message counts from a recording's metadata.

    Args:
        path: The file `metadata.yaml`.

    Returns:
        Number of messages by name of the data file, in the listed order; 0 if the metadata do not
        state it. Folders in the listed paths are dropped. Then the number of messages of the whole
        recording.

    Raises:
        MetadataError: The file is missing, or its content is not metadata of a recording.
        BagError: The file cannot be read, or the recording is not stored as plain MCAP.
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
    metadata = _get_checked(whole, METADATA_KEY, dict)
    _check_kind(path.parent, metadata)
    names = [
        PurePath(str(each)).name for each in _get_checked(metadata, "relative_file_paths", list)
    ]
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
    """Check that a recording is stored as MCAP and is not compressed by rosbag2.

    Compression of whole files or messages by rosbag2 is not supported. Compressed chunks inside an
    MCAP file are.

    Args:
        folder: Folder of the recording, for the error message.
        metadata: Content of the metadata.

    Raises:
        BagError: The recording is stored in another way.
    """
    storage = str(metadata.get("storage_identifier"))[:20]
    if storage != STORAGE_ID:
        raise BagError(
            f"the recording {folder} is stored as '{storage}', which is not read; "
            f"convert it to {STORAGE_ID} by ros2 bag convert"
        )
    mode = str(metadata.get("compression_mode") or "none")[:20]
    if mode.lower() != "none":
        raise BagError(
            f"the recording {folder} is compressed by rosbag2 (mode '{mode}'), which is not read; "
            "convert it by ros2 bag convert; compressed chunks of an MCAP file are read"
        )


def _get_checked(mapping: Any, key: str, kind: type) -> Any:
    """Return a value of a dictionary after a check of its type.

    Args:
        mapping: The dictionary; anything else counts as if the key were missing.
        key: Key of the value.
        kind: Type that the value must have.

    Returns:
        The value.

    Raises:
        MetadataError: The key is missing, or its value has another type.
    """
    part = mapping.get(key) if isinstance(mapping, dict) else None
    if not isinstance(part, kind):
        raise MetadataError(f"its {METADATA_FILE} has no {key}")
    return part


def _count(metadata: dict[str, Any]) -> int:
    """Return the message count in metadata of a recording or of one file.

    Args:
        metadata: Dictionary whose key `message_count` is read; its value may be text or a number.

    Returns:
        The number of messages.

    Raises:
        MetadataError: The count is missing, is not a whole number of 0 or more, or has more than 18
            digits.
    """
    text = str(metadata.get("message_count"))
    if not COUNT_PATTERN.fullmatch(text):
        raise MetadataError(f"its {METADATA_FILE} has no message_count")
    return int(text)
