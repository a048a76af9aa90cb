"""Posture table: the best posture for every grid node and mode combination.

The table is stored as one npz file with the arrays and a JSON header. The header contains the
schema version, the machine's name and hash, and the grid spacing. A file is written under a
temporary name and then renamed, so that it is always complete.
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
from mhsb_model.workspace import compute_joint_excess
from mhsb_planner.errors import TableError
from mhsb_planner.posture.npz_reader import DAMAGED_FILE_ERRORS, ArchiveTooLargeError, read_arrays

SCHEMA_VERSION = 1
"""Version of the file format."""
ARRAY_DTYPES = {
    "header": r"<U\d{1,4}",
    "nodes": "<i8",
    "patterns": r"\|u1",
    "posture": "<f8",
    "area": "<f8",
}
"""Names of the arrays in a file, with regular expressions of their dtypes.

The header has at most 9999 characters."""

ARRAY_NAMES = ("nodes", "patterns", "posture", "area")
"""Names of the arrays of numbers in a file."""
LARGEST_TABLE = 2**30
"""Largest accepted unpacked size of a file [B]. The table of the paper's machine has 0.5 MB."""

LONGEST_SHOWN = 80
"""Largest number of characters of a header value that are kept and shown in messages.

A hash has 64."""

SMALLEST_SPACING = 1e-4
"""Smallest accepted grid spacing of a file [m]; machine files have at least 5 mm."""

LARGEST_EXCESS = 1e-6
"""Largest distance of a posture beyond a joint limit that counts as rounding [rad or m]."""


@dataclass(frozen=True, eq=False)
class PostureTable:
    """Postures with the largest velocity polytope at the nodes of a grid (paper, step S1).

    The polytope contains all velocities of the tip that the pistons' limits allow.

    Attributes:
        machine_name: Name of the machine for which the table was made.
        machine_hash: Hash of this machine without its slewing joint.
        spacing: Grid spacing [m].
        nodes: Tip positions (x, z) in units of the spacing, int64, shape (nodes, 2).
        patterns: Mode combinations (one mode code for each actuator), uint8, shape (patterns, n).
        posture: Posture by node and mode combination, shape (nodes, patterns, n) [rad or m]; NaN if
            a node has no posture within limits.
        area: Area of the velocity polytope, shape (nodes, patterns) [m²/s²]; NaN if there is no
            posture.
    """

    machine_name: str
    machine_hash: str
    spacing: float
    nodes: IntArray
    patterns: ModeArray
    posture: FloatArray
    area: FloatArray

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ARRAY_NAMES:
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def feasible(self) -> np.ndarray:
        """Whether each node has a posture within limits, bool, shape (nodes,)."""
        return np.isfinite(self.area[:, 0])

    @property
    def entries(self) -> int:
        """Number of nodes times number of mode combinations."""
        return int(self.area.size)

    def with_patterns(self, patterns: ModeArray) -> PostureTable:
        """Return a table that contains only some of the mode combinations.

        Args:
            patterns: Mode combinations to keep, all of which this table has, uint8, shape (k, n).

        Returns:
            The reduced table, with mode combinations in the order of `patterns`.
        """
        rows = [int(np.flatnonzero((self.patterns == each).all(axis=1))[0]) for each in patterns]
        return replace(
            self, patterns=patterns, posture=self.posture[:, rows], area=self.area[:, rows]
        )

    def save(self, path: str | Path) -> None:
        """Write the table to a file, either completely or not at all.

        Missing directories are created. The file is written under a temporary name and renamed.

        Args:
            path: The npz file; an existing file is replaced.

        Raises:
            TableError: The file cannot be written.
        """
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
        """Read a table from a file and check that it fits a machine.

        Args:
            path: The npz file.
            machine: The machine. The table must have been made for this machine without its slewing
                joint.
            spacing: Grid spacing that the table must have [m]; None means any.

        Returns:
            The table.

        Raises:
            TableError: The file is missing, damaged, or made for another schema, machine or
                spacing; the message says which.
        """
        path = Path(path)
        header, arrays = _read_table_file(path)
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
        table._check_against(path, machine.planar_arm, spacing)
        return table

    def _check_against(self, path: Path, machine: Machine, spacing: float | None) -> None:
        """Check that this table is complete and was made for a given machine.

        Args:
            path: File of the table, for the message.
            machine: The arm without a slewing joint.
            spacing: Grid spacing that the table must have [m]; None means any.

        Raises:
            TableError: The table is incomplete, damaged, or made for another machine or spacing;
                the message says which.
        """
        if self.machine_hash != machine.table_hash:
            raise TableError(
                path,
                f"was made for machine {self.machine_name} ({self.machine_hash[:12]}), "
                f"not for {machine.name} ({machine.table_hash[:12]})",
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
        if reason := self._describe_content_problem(machine):
            raise TableError(path, f"is damaged: {reason}")

    def _describe_content_problem(self, machine: Machine) -> str | None:
        """Describe the first problem with the numbers of this table.

        Spacing, range of the nodes, mode combinations and joint limits are checked. The shapes of
        the arrays are not: the caller must have checked them.

        Args:
            machine: The arm without a slewing joint.

        Returns:
            Clause for an error message; None if there is no problem.
        """
        if not SMALLEST_SPACING <= self.spacing <= machine.arrays.max_radius:
            return f"its spacing is {self.spacing:g} m"
        farthest = math.ceil(machine.arrays.max_radius / self.spacing) + 1
        if np.any(self.nodes < -farthest) or np.any(self.nodes > farthest):
            return "nodes lie beyond the arm's reach"
        if not np.array_equal(self.patterns, machine.patterns):
            return "its mode patterns are not those of the machine"
        beyond = compute_joint_excess(machine.arrays, self.posture[np.isfinite(self.area)])
        if not np.all(beyond <= LARGEST_EXCESS):  # NaN, too
            return "postures lie beyond the joint limits"
        return None


def _read_table_file(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read header and arrays of a posture table's npz file.

    Args:
        path: The npz file.

    Returns:
        The header, and the arrays by name; their contents are not checked.

    Raises:
        TableError: The file is missing, damaged or too large; the message says which.
    """
    try:
        if path.exists() and not path.is_file():
            raise TableError(path, "cannot be read: it is no regular file")
        arrays = read_arrays(path, ARRAY_DTYPES, LARGEST_TABLE)
        header = json.loads(str(arrays.pop("header")))
        if not isinstance(header, dict):
            raise ValueError("a header that is no object")
    except FileNotFoundError as error:
        raise TableError(path, "there is no such file") from error
    except ArchiveTooLargeError as error:
        size = f"{error.size} bytes, {LARGEST_TABLE} are the most"
        raise TableError(path, f"cannot be read: {size}") from error
    except DAMAGED_FILE_ERRORS as error:  # RecursionError, of a deep header, is a RuntimeError
        raise TableError(path, "is damaged or not a posture table") from error
    except OSError as error:
        raise TableError(path, f"cannot be read: {error.strerror or error}") from error
    return header, arrays
