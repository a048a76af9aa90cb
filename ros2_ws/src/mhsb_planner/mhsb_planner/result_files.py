"""CSV and JSON files, written whole or not at all."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TextIO


def write_rows(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
    """A CSV file with a header line; units belong into the header's names."""

    def write(file: TextIO) -> None:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)

    return _written(path, write)


def write_json(path: Path, content: Mapping[str, Any] | Sequence[Any]) -> Path:
    """A JSON file."""
    return _written(path, lambda file: json.dump(content, file, indent=2))


def _written(path: Path, write: Callable[[TextIO], None]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.part")
    try:
        with part.open("w", encoding="utf-8", newline="") as file:
            write(file)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return path
