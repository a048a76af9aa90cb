"""CSV and JSON files that are written completely or not at all."""

import csv
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO

from mhsb_model.files.output_folders import replace_file


def write_rows(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
    """Write a CSV file with a header line, completely or not at all.

    Args:
        path: The file; missing directories are created.
        header: Names of the columns, units included.
        rows: Values of each line.

    Returns:
        The path.

    Raises:
        OSError: The file or a directory cannot be written.
    """

    def write(file: TextIO) -> None:
        """Write header and rows to an open text file."""
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)

    return _write_atomically(path, write)


def write_json(path: Path, content: Mapping[str, Any] | Sequence[Any]) -> Path:
    """Write a JSON file, completely or not at all.

    Args:
        path: The file; missing directories are created.
        content: Content. It is indented by 2 spaces and followed by a line break.

    Returns:
        The path.

    Raises:
        OSError: The file or a directory cannot be written.
    """
    return _write_atomically(path, lambda file: file.write(json.dumps(content, indent=2) + "\n"))


def replace_non_finite(content: Any) -> Any:
    """Replace infinite numbers and NaN by None, since JSON has no such numbers.

    Args:
        content: Nested dictionaries and lists; not changed.

    Returns:
        A copy with the replacements.
    """
    if isinstance(content, dict):
        return {key: replace_non_finite(value) for key, value in content.items()}
    if isinstance(content, list):
        return [replace_non_finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def _write_atomically(path: Path, write: Callable[[TextIO], object]) -> Path:
    """Write a file under a temporary name, then rename it.

    If writing fails, the temporary file is removed, and an existing file is not changed.

    Args:
        path: The file; missing directories are created.
        write: Function that writes the content to an open text file.

    Returns:
        The path.

    Raises:
        OSError: The file or a directory cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with replace_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        write(file)
    return path
