"""Folder of the compiled kernels; its name depends on the sources of the kernels.

Numba checks only the file that a kernel is in. After a change to a constant or a called kernel in
another file, numba would silently use old machine code. So the folder's name is a fingerprint of
all files of the suite that contain kernels, constants for them, or the decorator.
"""

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
from functools import cache
from importlib.metadata import version
from pathlib import Path

KERNEL_PACKAGES = ("mhsb_model", "mhsb_control", "mhsb_planner", "mhsb_sim", "mhsb_tools")
"""Packages of the suite that are searched for kernels."""

CACHE_VARIABLE = "NUMBA_CACHE_DIR"
"""Environment variable by which numba and child processes find the cache folder."""

LOGGED_VARIABLE = "MHSB_KERNELS_ARE_NOT_KEPT"
"""Environment variable that is set once a process has logged that kernels cannot be kept."""

DECORATOR_MODULES = frozenset(
    f"mhsb_model.kernels.{name}" for name in ("kernel", "compiled", "machine_code", "shared_cache")
)
"""Modules that determine how kernels are compiled."""

KERNEL_PATTERN = re.compile(rb"^@kernel\b", re.MULTILINE)
"""Decorator by which a source file with kernels is recognized."""

IMPORT_PATTERN = re.compile(rb"^from (mhsb_[\w.]+) import (?:\(([^)]*)\)|(.*))", re.MULTILINE)
"""Import of names from a module of the suite: the module, and the names in or without brackets."""

CONSTANT_PATTERN = re.compile(rb"\b[A-Z][A-Z0-9_]*\b")
"""Pattern of names in capitals. An imported name that fits it counts as a constant."""

FOLDER_CAPACITY = 3
"""Number of newest cache folders that are kept; other checkouts or versions may use them."""

IN_USE = 86400.0
"""Time since its last use after which a cache folder may be deleted [s].

A process may still be compiling into a folder that was used more recently."""

MIN_FREE_SPACE = 64 * 2**20
"""Free disk space required for the cache [B]; all kernels of one checkout take 32 MiB."""

PROBE_BYTES = b"\0" * 2**20
"""Content of the file that is written as a test; larger than any compiled kernel."""

_log = logging.getLogger(__name__)


def set_kernel_cache_folder() -> None:
    """Choose the folder in which numba keeps compiled kernels, and set NUMBA_CACHE_DIR to it.

    If NUMBA_CACHE_DIR is already set, its folder is taken. Otherwise it is `kernel_cache_folder()`,
    and old cache folders beside it are deleted. If the folder cannot be written, a folder among the
    temporary files takes its place. If this cannot be written either, kernels are not kept. In both
    cases a warning is logged, once for a process and its children.

    It must be called before the first kernel is defined.
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    folder = Path(chosen) if chosen else kernel_cache_folder()
    if (trouble := find_write_problem(folder)) and not os.environ.get(LOGGED_VARIABLE):
        spare = _create_spare_folder(folder)
        if find_write_problem(spare):
            spare_is, slower = "cannot be kept anywhere else", "every start compiles them"
        else:
            spare_is, slower = f"are kept in {spare}", "starts may take a minute longer"
        _log.warning(
            "compiled kernels cannot be kept in %s (%s) and %s: %s; make %d MiB of room there, or "
            "name another folder in %s",
            folder, trouble, spare_is, slower, MIN_FREE_SPACE // 2**20, CACHE_VARIABLE,
        )  # fmt: skip
        folder, os.environ[LOGGED_VARIABLE] = spare, "1"
    os.environ[CACHE_VARIABLE] = str(folder)
    if "numba" in sys.modules:  # numba has already read the environment
        sys.modules["numba"].config.CACHE_DIR = str(folder)
    if not chosen:
        _delete_old_folders(folder)


def kernel_cache_folder() -> Path:
    """Return the cache folder that belongs to the present sources and NumPy version.

    It is `mhsb/kernels/FINGERPRINT-NUMPY` in $XDG_CACHE_HOME, or in ~/.cache if that is not set or
    not absolute. FINGERPRINT is the result of `fingerprint_of_kernel_sources`, and NUMPY the
    version of NumPy.

    Returns:
        Path of the folder, which need not exist.
    """
    given = os.environ.get("XDG_CACHE_HOME")
    base = Path(given) if given and Path(given).is_absolute() else Path.home() / ".cache"
    return base / "mhsb" / "kernels" / f"{fingerprint_of_kernel_sources()}-{version('numpy')}"


@cache
def fingerprint_of_kernel_sources() -> str:
    """Return the fingerprint of `kernel_sources()`; each process computes it only once."""
    return fingerprint(kernel_sources())


def kernel_sources() -> list[Path]:
    """List all source files of the suite that compiled kernels depend on.

    These are files that contain kernels, files from which such files import constants, and the
    modules that define how kernels are compiled. Packages that are not installed are skipped.

    Returns:
        Paths in the order of their module names.
    """
    files = {}
    for package in KERNEL_PACKAGES:
        found = importlib.util.find_spec(package)
        if found is not None and found.origin is not None:
            root = Path(found.origin).parent
            for file in root.rglob("*.py"):
                name = ".".join((package, *file.relative_to(root).with_suffix("").parts))
                files[name] = file
    kernels = {
        name: text
        for name, file in files.items()
        if KERNEL_PATTERN.search(text := file.read_bytes())
    }
    constants = {name for text in kernels.values() for name in find_constant_modules(text)}
    wanted = kernels.keys() | constants | DECORATOR_MODULES
    return [files[name] for name in sorted(files.keys() & wanted)]


def find_constant_modules(source: bytes) -> set[str]:
    """Return the names of the suite's modules from which a source file imports constants.

    A name in capitals counts as a constant.

    Args:
        source: Content of a Python file.

    Returns:
        Dotted module names, such as `mhsb_model.modes`.
    """
    return {
        module.decode()
        for module, several, one in IMPORT_PATTERN.findall(source)
        if CONSTANT_PATTERN.search(several or one)
    }


def fingerprint(files: list[Path]) -> str:
    """Return a hash of the contents of files, as 16 hexadecimal digits.

    Args:
        files: Files to read; their order matters, their paths do not.

    Returns:
        The first 16 digits of a SHA-256 hash.
    """
    each = (hashlib.sha256(file.read_bytes()).digest() for file in files)
    return hashlib.sha256(b"".join(each)).hexdigest()[:16]


def find_write_problem(folder: Path) -> str | None:
    """Check whether compiled kernels can be written into a folder; create it if it is missing.

    As a test, a temporary file of the size of PROBE_BYTES is written and removed. The disk must
    have MIN_FREE_SPACE, unless the folder has a marker file `complete-…` of an earlier compilation.

    Args:
        folder: Cache folder.

    Returns:
        Reason why the folder cannot be used, in a few words; None if it can be used.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if shutil.disk_usage(folder).free < MIN_FREE_SPACE and not any(folder.glob("complete-*")):
            return "the disk is full"
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(PROBE_BYTES)
            return None
    except OSError as error:
        return error.strerror or str(error)


def _create_spare_folder(wanted: Path) -> Path:
    """Create a folder for compiled kernels among the temporary files.

    The folder is `mhsb-UID/NAME` if that can be written, belongs to the user and is closed to
    others; the next start then finds it again. Otherwise it is a new folder with a random name.

    Args:
        wanted: Cache folder that cannot be written. Its last part is NAME.

    Returns:
        The spare folder; `wanted` itself if no folder can be created.
    """
    name = wanted.name
    try:
        folder = Path(tempfile.gettempdir()) / f"mhsb-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
        private = stat.S_ISDIR(status.st_mode) and not stat.S_IMODE(status.st_mode) & 0o077
        if private and status.st_uid == os.getuid() and not find_write_problem(folder / name):
            return folder / name
        return Path(tempfile.mkdtemp(prefix="mhsb-"))
    except OSError:
        return wanted


def _delete_old_folders(current: Path) -> None:
    """Mark a cache folder as used now, and delete old folders beside it.

    The FOLDER_CAPACITY newest folders are kept, and all folders that were used within the last
    IN_USE seconds. Deleting a folder that is still needed costs only a compilation. Errors are
    ignored.

    Args:
        current: Cache folder that this process uses.
    """
    try:
        os.utime(current)
        folders = sorted(current.parent.iterdir(), key=lambda folder: folder.stat().st_mtime)
    except OSError:
        return
    for old in folders[:-FOLDER_CAPACITY]:
        if time.time() - _find_last_use(old) > IN_USE:
            shutil.rmtree(old, ignore_errors=True)


def _find_last_use(folder: Path) -> float:
    """Return when a process last began to use a folder.

    Args:
        folder: Cache folder.

    Returns:
        Modification time since the epoch [s]; inf if the folder does not exist.
    """
    try:
        return folder.stat().st_mtime
    except OSError:
        return math.inf
