"""Posture tables that have been built before, in the user's cache directory."""

from __future__ import annotations

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
    """Where the table of a machine is kept: $XDG_CACHE_HOME/mhsb, else ~/.cache/mhsb.

    spacing  m; the machine's own where it is left out

    Tables of another solver than the global search are kept apart; nothing looks for them.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    cache = Path(base) if base and Path(base).is_absolute() else Path.home() / ".cache"
    kind = "" if solver == "global" else f"-{solver}"
    plane, apart = machine.plane, 1e3 * (spacing or machine.spacing)
    return cache / "mhsb" / f"{plane.name}-{plane.hash[:16]}-{apart:g}mm{kind}.npz"


def table_for(
    machine: Machine,
    path: str | Path | None = None,
    spacing: float | None = None,
    progress: Progress | None = None,
) -> PostureTable:
    """Posture table of a machine, in its plane: the one of the file `path`, else from the cache,
    else built.

    A table that is built is kept in the cache; a damaged one there is replaced, and a cache that
    cannot be written does no harm: both are logged. A progress bar tells how far it is, on a
    terminal, unless `progress` does. Raises TableError where `path` is given and cannot be used.
    """
    machine, spacing = machine.plane, spacing or machine.spacing
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
            bar.total = total
            bar.update(done - bar.n)

        table = build_posture_table(machine, spacing, progress=progress or show)
    try:
        table.save(cached)
    except TableError as error:
        _log.warning("%s; it will have to be built again next time", error)
    return table
