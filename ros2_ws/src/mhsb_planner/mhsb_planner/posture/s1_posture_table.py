"""The posture table: for every node of the grid and every mode pattern, the posture to take.

Stored as one npz file: the arrays and a JSON header with the schema version, the machine's name
and hash, and the spacing. A file is written beside its place and renamed, so that a table is
there whole or not at all.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, IntArray, ModeArray, frozen
from mhsb_planner.errors import TableError
from mhsb_planner.posture.npz_reader import UNREADABLE, ArchiveTooLargeError, read_arrays

SCHEMA_VERSION = 1
KINDS = {
    "header": r"<U\d{1,4}",
    "nodes": "<i8",
    "patterns": r"\|u1",
    "posture": "<f8",
    "area": "<f8",
}
"""Arrays of a file and their dtypes; the header has at most 9999 characters, NumPy's own 300."""

ARRAY_NAMES = ("nodes", "patterns", "posture", "area")
LARGEST_TABLE = 2**30
"""Bytes, unpacked; that of the suite's own machine has half a million."""

LONGEST_SHOWN = 80
"""Characters of a header's value that are kept and repeated: a hash has 64."""

SMALLEST_SPACING = 1e-4
"""Of a grid [m]; machine files have 5 mm at least."""

LARGEST_EXCESS = 1e-6
"""By how much a table's posture may be beyond a joint limit, by rounding [rad, m]."""


@dataclass(frozen=True, eq=False)
class PostureTable:
    """Postures of largest velocity polytope (paper, step S1) for n joints.

    machine_name, machine_hash  whom the table was made for
    spacing   grid spacing [m]
    nodes     int64[nodes, 2], tip positions (x, z) in units of the spacing
    patterns  uint8[patterns, n], mode codes
    posture   float64[nodes, patterns, n], rad; NaN where a node has no posture within limits
    area      float64[nodes, patterns], of the velocity polytope [m²/s²]; NaN likewise
    """

    machine_name: str
    machine_hash: str
    spacing: float
    nodes: IntArray
    patterns: ModeArray
    posture: FloatArray
    area: FloatArray

    def __post_init__(self) -> None:
        for name in ARRAY_NAMES:
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def feasible(self) -> np.ndarray:
        """Whether a node has a posture within limits, bool[nodes]."""
        return np.isfinite(self.area[:, 0])

    @property
    def entries(self) -> int:
        """Number of nodes times number of patterns."""
        return int(self.area.size)

    def with_patterns(self, patterns: ModeArray) -> PostureTable:
        """The same for some of its mode patterns, uint8[fewer, n]."""
        rows = [int(np.flatnonzero((self.patterns == each).all(axis=1))[0]) for each in patterns]
        return replace(
            self, patterns=patterns, posture=self.posture[:, rows], area=self.area[:, rows]
        )

    def save(self, path: str | Path) -> None:
        """Write the table to a file, replacing it at once; raises TableError where it cannot."""
        path = Path(path)
        header = {"schema_version": SCHEMA_VERSION} | {
            field.name: getattr(self, field.name)
            for field in fields(self)
            if field.name not in ARRAY_NAMES
        }
        arrays = {name: getattr(self, name) for name in ARRAY_NAMES}
        temporary = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(
                dir=path.parent, prefix=path.name, suffix=".part", delete=False
            ) as file:
                temporary = Path(file.name)
                np.savez(file, header=np.array(json.dumps(header)), **arrays)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(path)
        except OSError as error:
            raise TableError(path, f"cannot be written: {error.strerror}") from error
        finally:
            if temporary is not None:
                temporary.unlink(missing_ok=True)

    @classmethod
    def load(cls, path: str | Path, machine: Machine, spacing: float | None = None) -> PostureTable:
        """Table of a file, which must be for this machine and, if given, this spacing [m].

        Of one that slews it is that of its plane. Raises TableError where the file is missing,
        damaged, of another schema, machine or spacing; the sentence names which.
        """
        path = Path(path)
        header, arrays = _read(path)
        if header.get("schema_version") != SCHEMA_VERSION:
            found = str(header.get("schema_version"))[:LONGEST_SHOWN]
            raise TableError(path, f"has schema version {found}, {SCHEMA_VERSION} is needed")
        try:
            table = cls(
                machine_name=str(header["machine_name"])[:LONGEST_SHOWN],
                machine_hash=str(header["machine_hash"])[:LONGEST_SHOWN],
                spacing=float(header["spacing"]),
                **arrays,
            )
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise TableError(path, f"has no usable header ({error})") from error
        table._check_for(path, machine.plane, spacing)
        return table

    def _check_for(self, path: Path, machine: Machine, spacing: float | None) -> None:
        if self.machine_hash != machine.hash:
            raise TableError(
                path,
                f"was made for machine {self.machine_name} ({self.machine_hash[:12]}), "
                f"not for {machine.name} ({machine.hash[:12]})",
            )
        if spacing is not None and self.spacing != spacing:
            raise TableError(path, f"has a spacing of {self.spacing:g} m, not {spacing:g} m")
        shapes = {
            "nodes": (len(self.nodes), 2),
            "patterns": machine.patterns.shape,
            "posture": (len(self.nodes), *machine.patterns.shape),
            "area": (len(self.nodes), len(machine.patterns)),
        }
        for name, shape in shapes.items():
            found = getattr(self, name)
            if found.shape != shape:
                raise TableError(path, f"has {name} of shape {found.shape}, not {shape}")
        if not self.feasible.any():
            raise TableError(path, "holds no posture at all")
        if reason := self._content_problem(machine):
            raise TableError(path, f"is damaged: {reason}")

    def _content_problem(self, machine: Machine) -> str | None:
        """Return what is wrong with the numbers of a table that has the right shape, or None."""
        if not SMALLEST_SPACING <= self.spacing <= machine.arrays.max_radius:
            return f"its spacing is {self.spacing:g} m"
        farthest = math.ceil(machine.arrays.max_radius / self.spacing) + 1
        if np.any(self.nodes < -farthest) or np.any(self.nodes > farthest):
            return "nodes lie beyond the arm's reach"
        if not np.array_equal(self.patterns, machine.patterns):
            return "its mode patterns are not those of the machine"
        beyond = joint_excess_of(machine, self.posture[np.isfinite(self.area)])
        if not np.all(beyond <= LARGEST_EXCESS):  # NaN, too
            return "postures lie beyond the joint limits"
        return None


def joint_excess_of(machine: Machine, postures: FloatArray) -> FloatArray:
    """Return how far the worst joint of postures[k, n] is beyond its limits, float64[k] [rad]."""
    a = machine.arrays
    return np.maximum(a.joint_min - postures, postures - a.joint_max).max(axis=-1, initial=-np.inf)


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return header and arrays of a file; raises TableError."""
    try:
        if path.exists() and not path.is_file():
            raise TableError(path, "cannot be read: it is no regular file")
        arrays = read_arrays(path, KINDS, LARGEST_TABLE)
        header = json.loads(str(arrays.pop("header")))
        if not isinstance(header, dict):
            raise ValueError("a header that is no object")
    except FileNotFoundError as error:
        raise TableError(path, "there is no such file") from error
    except ArchiveTooLargeError as error:
        size = f"{error.size} bytes, {LARGEST_TABLE} are the most"
        raise TableError(path, f"cannot be read: {size}") from error
    except UNREADABLE as error:  # RecursionError, of a deep header, is a RuntimeError
        raise TableError(path, "is damaged or not a posture table") from error
    except OSError as error:
        raise TableError(path, f"cannot be read: {error.strerror or error}") from error
    return header, arrays
