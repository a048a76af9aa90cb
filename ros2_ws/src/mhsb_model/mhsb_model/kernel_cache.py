"""Where compiled kernels are kept, so that what is found there was compiled from these sources.

Numba looks only at the file that a kernel is in: after a change to a kernel that it calls in
another file, it would silently go on with the old one. So the folder's name is a fingerprint of
all files with kernels, of all packages of the suite.
"""

from __future__ import annotations

import hashlib
import importlib.util
import math
import os
import shutil
import sys
import time
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("mhsb_model", "mhsb_planner", "mhsb_sim")
MARK = b"jit"
KEPT = 3
"""How many fingerprints' folders are kept; another checkout or version may use them."""

IN_USE = 86400.0
"""Folders used within so many seconds are kept too: whoever compiles into them still runs."""


def use_kernel_cache() -> None:
    """Make numba keep its kernels there; to be called before the first kernel is defined.

    NUMBA_CACHE_DIR, where it is set, is somebody's own decision and left alone.
    """
    if "NUMBA_CACHE_DIR" not in os.environ:
        folder = kernel_cache_folder()
        os.environ["NUMBA_CACHE_DIR"] = str(folder)
        if "numba" in sys.modules:  # it has read its settings already
            sys.modules["numba"].config.CACHE_DIR = str(folder)
        _drop_old(folder)


def kernel_cache_folder() -> Path:
    """$XDG_CACHE_HOME/mhsb/kernels/FINGERPRINT, else below ~/.cache; one for each NumPy."""
    base = os.environ.get("XDG_CACHE_HOME")
    cache = Path(base) if base and Path(base).is_absolute() else Path.home() / ".cache"
    return cache / "mhsb" / "kernels" / f"{fingerprint(kernel_sources())}-{version('numpy')}"


def kernel_sources() -> list[Path]:
    """All source files of the suite that hold kernels, in a fixed order."""
    folders = []
    for package in PACKAGES:
        found = importlib.util.find_spec(package)
        if found is not None and found.origin is not None:
            folders.append(Path(found.origin).parent)
    files = [file for folder in folders for file in sorted(folder.rglob("*.py"))]
    return [file for file in files if MARK in file.read_bytes()]


def fingerprint(files: list[Path]) -> str:
    """Hash of the contents of files."""
    digest = hashlib.sha256()
    for file in files:
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:16]


def _drop_old(current: Path) -> None:
    """Keep the newest folders beside the current one; losing one costs a compilation only."""
    try:
        current.mkdir(parents=True, exist_ok=True)
        os.utime(current)
        folders = sorted(current.parent.iterdir(), key=lambda folder: folder.stat().st_mtime)
    except OSError:
        return  # no place to keep kernels in: numba says so where it matters
    for old in folders[:-KEPT]:
        if time.time() - _last_use(old) > IN_USE:
            shutil.rmtree(old, ignore_errors=True)


def _last_use(folder: Path) -> float:
    """When a process last began to use a folder; infinite where it is gone [s]."""
    try:
        return folder.stat().st_mtime
    except OSError:
        return math.inf
