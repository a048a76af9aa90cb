"""Programs in forks of one process that has imported what they need.

Numba and the suite take longer to import than a short program takes to run.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

PARENT = """
import importlib, json, multiprocessing, os, sys

import numba

together, modules, programs = json.load(sys.stdin)
for module in modules:
    importlib.import_module(module)
numba.njit(lambda: 0)()  # forks have numba's compiler, and no kernel

def run(number, program, *words):
    for stream, name in ((1, "output"), (2, "errors")):
        os.dup2(os.open(f"{name}{number}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
    sys.argv[1:] = words
    exec(program, {})

context = multiprocessing.get_context("fork")
forks = [context.Process(target=run, args=(k, *each)) for k, each in enumerate(programs)]
for fork in forks:
    fork.start()
    if not together:
        fork.join()
for fork in forks:
    fork.join()
"""
"""Program that starts the forks; each prints into files of its own in the working directory."""


def run_forked(
    programs: Sequence[Sequence[str]],
    folder: Path,
    modules: Sequence[str] = ("mhsb_model.kernels.machine_code", "mhsb_model.kernels.shared_cache"),
    *,
    together: bool = False,
    environment: Mapping[str, str] | None = None,
) -> list[tuple[str, str]]:
    """Run Python programs in forks of one process, one after the other or all at once.

    Args:
        programs: Source text of each program, followed by its arguments.
        folder: Working directory, in which files output0, errors0 and so on are made.
        modules: Modules that are imported before the forks begin. By default, each fork still
            chooses and creates its folder of kernels.
        together: True if all programs run at the same time.
        environment: Further environment variables.

    Returns:
        Output and errors that each program has printed.
    """
    done = subprocess.run(
        [sys.executable, "-c", PARENT],
        input=json.dumps([together, list(modules), [list(each) for each in programs]]),
        cwd=folder,
        env={**os.environ, **(environment or {})},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("", ""), done
    files = [(folder / f"output{k}", folder / f"errors{k}") for k in range(len(programs))]
    return [(output.read_text(), errors.read_text()) for output, errors in files]
