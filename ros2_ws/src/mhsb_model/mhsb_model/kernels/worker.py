"""A process that has kernels compiled for another one: `python -m mhsb_model.kernels.worker`.

It reads names of functions, `MODULE:FUNCTION` a line, calls each, and answers each with a line:
empty, or what went wrong. It ends with whoever started it, at once.
"""

from __future__ import annotations

import importlib
import os
import queue
import sys
import threading


def main() -> None:
    """Serve until the input ends."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # whatever a function prints is no answer
    names: queue.Queue[str] = queue.Queue()
    threading.Thread(target=_read, args=(names,), daemon=True).start()
    while True:
        answer = _called(names.get())
        try:
            print(answer, file=answers, flush=True)
        except BrokenPipeError:  # nobody listens any more
            os._exit(0)


def _read(names: queue.Queue[str]) -> None:
    """In a thread of its own: the main one may be compiling when the input ends."""
    for line in sys.stdin:
        names.put(line.strip())
    os._exit(0)


def _called(name: str) -> str:
    module, function = name.split(":")
    try:
        getattr(importlib.import_module(module), function)()
    except Exception as error:  # told to whoever waits, and raised again where it is needed
        return f"{type(error).__name__}: {' '.join(str(error).split())}"
    return ""


if __name__ == "__main__":
    main()
