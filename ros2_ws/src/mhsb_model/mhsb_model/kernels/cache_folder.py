"""Where compiled kernels are kept, so that what is found there was compiled from these sources.

Numba looks only at the file that a kernel is in: after a change to a kernel that it calls in
another file, or to a constant, it would silently go on with the old one. So the folder's name is
a fingerprint of all files with kernels, of those that their constants come from, in all packages
of the suite, and of how they are compiled.
"""

from __future__ import annotations

import hashlib
import importlib.util
import logging
import math
import os
import re
import shutil
import stat
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("mhsb_model", "mhsb_planner", "mhsb_sim")
VARIABLE = "NUMBA_CACHE_DIR"
DECORATOR = frozenset({"mhsb_model.kernels.kernel", "mhsb_model.kernels.compiled"})
MARK = re.compile(rb"^@kernel\b", re.MULTILINE)
IMPORT = re.compile(rb"^from (mhsb_[\w.]+) import (?:\(([^)]*)\)|(.*))", re.MULTILINE)
CONSTANT = re.compile(rb"\b[A-Z][A-Z0-9_]*\b")
KEPT = 3
"""How many fingerprints' folders are kept; another checkout or version may use them."""

IN_USE = 86400.0
"""Folders used within so many seconds are kept too: whoever compiles into them still runs."""

_log = logging.getLogger(__name__)


def use_kernel_cache() -> None:
    """Make numba keep its kernels there; to be called before the first kernel is defined.

    NUMBA_CACHE_DIR, where it is set, is somebody's own decision. Where nothing can be written,
    kernels are kept in the folder for temporary files, which is said.
    """
    chosen = os.environ.get(VARIABLE)
    folder = Path(chosen) if chosen else kernel_cache_folder()
    if trouble := _trouble_writing(folder):
        spare = _spare_folder(folder.name)
        _log.warning(
            "compiled kernels cannot be kept in %s (%s) and are kept in %s: starts may take a "
            "minute longer; make the folder writable, or name another one in %s",
            folder, trouble, spare, VARIABLE,
        )  # fmt: skip
        folder = spare
    os.environ[VARIABLE] = str(folder)
    if "numba" in sys.modules:  # it has read its settings already
        sys.modules["numba"].config.CACHE_DIR = str(folder)
    if not chosen:
        _drop_old(folder)


def kernel_cache_folder() -> Path:
    """$XDG_CACHE_HOME/mhsb/kernels/FINGERPRINT, else below ~/.cache; one for each NumPy."""
    base = os.environ.get("XDG_CACHE_HOME")
    cache = Path(base) if base and Path(base).is_absolute() else Path.home() / ".cache"
    return cache / "mhsb" / "kernels" / f"{fingerprint(kernel_sources())}-{version('numpy')}"


def kernel_sources() -> list[Path]:
    """All sources of the suite with kernels, constants for them or their decorator, in order."""
    files = {}
    for package in PACKAGES:
        found = importlib.util.find_spec(package)
        if found is not None and found.origin is not None:
            root = Path(found.origin).parent
            for file in root.rglob("*.py"):
                name = ".".join((package, *file.relative_to(root).with_suffix("").parts))
                files[name] = file
    kernels = {name: text for name, file in files.items() if MARK.search(text := file.read_bytes())}
    constants = {name for text in kernels.values() for name in constants_from(text)}
    wanted = kernels.keys() | constants | DECORATOR
    return [files[name] for name in sorted(files.keys() & wanted)]


def constants_from(source: bytes) -> set[str]:
    """Modules of the suite from which a source imports constants."""
    return {
        module.decode()
        for module, several, one in IMPORT.findall(source)
        if CONSTANT.search(several or one)
    }


def fingerprint(files: list[Path]) -> str:
    """Hash of the contents of files."""
    digest = hashlib.sha256()
    for file in files:
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:16]


def _trouble_writing(folder: Path) -> str | None:
    """Why nothing can be written into a folder, which is made where it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return None
    except OSError as error:
        return error.strerror or str(error)


def _spare_folder(name: str) -> Path:
    """Among temporary files, kept for the next start, and nobody else's: code is run from it."""
    folder = Path(tempfile.gettempdir()) / f"mhsb-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        private = stat.S_ISDIR(status.st_mode) and not stat.S_IMODE(status.st_mode) & 0o077
        if private and status.st_uid == os.getuid() and not _trouble_writing(folder / name):
            return folder / name
        return Path(tempfile.mkdtemp(prefix="mhsb-"))
    except OSError:
        return folder / name  # cannot be written either: every process compiles for itself


def _drop_old(current: Path) -> None:
    """Keep the newest folders beside the current one; losing one costs a compilation only."""
    try:
        os.utime(current)
        folders = sorted(current.parent.iterdir(), key=lambda folder: folder.stat().st_mtime)
    except OSError:
        return
    for old in folders[:-KEPT]:
        if time.time() - _last_use(old) > IN_USE:
            shutil.rmtree(old, ignore_errors=True)


def _last_use(folder: Path) -> float:
    """When a process last began to use a folder; infinite where it is gone [s]."""
    try:
        return folder.stat().st_mtime
    except OSError:
        return math.inf
