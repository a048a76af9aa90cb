"""Process that compiles kernels for another process: `python -m mhsb_model.kernels.worker`.

It reads one function per line from its input, as `MODULE:FUNCTION`, and calls it. The answer is one
line: empty for success, else an error message. The process ends as soon as its input ends.

Numba creates millions of objects that live as long as the process. Python's garbage collector would
visit them again and again, for an eighth of the processor time, so it is switched off. The garbage
of all parts of the planner takes less memory than one part.
"""

import gc
import importlib
import os
import queue
import sys
import threading


def main() -> None:
    """Call the functions that the standard input names, and print an answer for each.

    The input has one `MODULE:FUNCTION` per line. An answer is one line: empty for success, else an
    error message. Output that the functions print goes to stderr instead. At the end of the input,
    or if nobody reads the answers any more, the process exits with code 0.
    """
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # prints of the functions go to stderr
    gc.disable()
    names: queue.Queue[str] = queue.Queue()
    threading.Thread(target=_read_input, args=(names,), daemon=True).start()
    while True:
        answer = _call_function(names.get())
        try:
            print(answer, file=answers, flush=True)
        except BrokenPipeError:  # the parent process has ended
            os._exit(0)


def _read_input(names: queue.Queue[str]) -> None:
    """Pass lines of the input to a queue, and exit the process at its end.

    It runs in its own thread, because the main thread may be compiling when the input ends.

    Args:
        names: Receives each line without its line end.
    """
    for line in sys.stdin:
        names.put(line.strip())
    os._exit(0)


def _call_function(name: str) -> str:
    """Import and call a function without arguments.

    Args:
        name: Function as `MODULE:FUNCTION`.

    Returns:
        Error type and message in one line; empty if it succeeded.
    """
    module, function = name.split(":")
    try:
        getattr(importlib.import_module(module), function)()
    except Exception as error:  # reported to the parent; a later caller sees it again
        return f"{type(error).__name__}: {' '.join(str(error).split())}"
    return ""


if __name__ == "__main__":
    main()
