"""Cache of posture tables in the user's cache directory."""

import logging
import os
from pathlib import Path

from tqdm import tqdm

from mhsb_model.machine import Machine
from mhsb_planner.errors import TableError
from mhsb_planner.posture.s1_global_search import Progress, build_posture_table
from mhsb_planner.posture.s1_posture_table import PostureTable

_log = logging.getLogger(__name__)


def cached_table_path(
    machine: Machine, spacing: float | None = None, solver: str = "global"
) -> Path:
    """Return the path of a machine's posture table in the user's cache directory.

    The directory is $XDG_CACHE_HOME/mhsb, or ~/.cache/mhsb if the former is not an absolute path.
    The file name contains a hash of the machine without its slewing joint. `load_or_build_table`
    looks for tables of the solver `global` only.

    Args:
        machine: Machine of the table; it may have a slewing joint.
        spacing: Grid spacing [m]; None means the machine's own.
        solver: Name of the solver that made the table. It is part of the file name unless it is
            `global`.

    Returns:
        Path of the file, which need not exist.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    cache = Path(base) if base and Path(base).is_absolute() else Path.home() / ".cache"
    kind = "" if solver == "global" else f"-{solver}"
    plane, apart = machine.planar_arm, 1e3 * (spacing or machine.spacing)
    return cache / "mhsb" / f"{plane.name}-{plane.table_hash[:16]}-{apart:g}mm{kind}.npz"


def load_or_build_table(
    machine: Machine,
    path: str | Path | None = None,
    spacing: float | None = None,
    progress: Progress | None = None,
) -> PostureTable:
    """Load the posture table of a machine, or build it.

    If `path` is given, the table is read from this file. Otherwise it is read from the user's
    cache. If the cache has no valid table, the table is built and written to the cache. A damaged
    table in the cache and a cache that cannot be written are only logged.

    Args:
        machine: The machine. The table belongs to the arm without a slewing joint.
        path: File to read; None means the cache.
        spacing: Grid spacing [m]; None means the machine's own. Not used if `path` is given.
        progress: Called during building with the number of finished nodes and the number of all
            nodes. None shows a progress bar if the output is a terminal.

    Returns:
        The table.

    Raises:
        TableError: `path` is given and cannot be used.
        EmptyTableError: No node of a newly built table has a posture.
    """
    machine, spacing = machine.planar_arm, spacing or machine.spacing
    if path is not None:
        return PostureTable.load(path, machine)
    cached = cached_table_path(machine, spacing)
    if cached.exists():
        try:
            return PostureTable.load(cached, machine, spacing)
        except TableError as error:
            _log.warning("%s; it is built anew", error)
    with tqdm(desc="posture table, once", unit="node", leave=False, disable=None) as bar:

        def show(done: int, total: int) -> None:
            """Set the progress bar to `done` of `total` nodes."""
            bar.total = total
            bar.update(done - bar.n)

        table = build_posture_table(machine, spacing, progress=progress or show)
    try:
        table.save(cached)
    except TableError as error:
        _log.warning("%s; it will have to be built again next time", error)
    return table
