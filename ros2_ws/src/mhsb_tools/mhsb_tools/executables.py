"""Entry points: the command `mhsb` with its subcommands, and their former spellings.

`mhsb NAME`, `ros2 run mhsb_tools mhsb NAME` and `python -m mhsb_tools.executables mhsb NAME` start
the same command. A subcommand's module is imported only if it is started.
"""

import sys
from collections.abc import Callable
from pathlib import Path

from mhsb_model import __version__
from mhsb_model.errors import suggest_name
from mhsb_model.process import make_command_entry, make_node_entry, run_named

EXIT_USAGE = 2
"""Exit code if the subcommand cannot be understood."""

COMPLETION_FILE = Path(__file__).with_name("completion.bash")
"""Completion of the commands in bash, which `mhsb --completion` prints."""


SUBCOMMAND_TABLE = {
    "check": (make_command_entry("mhsb_tools.commands.check_command"), "what a machine file means"),
    "plan": (make_command_entry("mhsb_tools.commands.plan_command"), "plan one motion offline"),
    "build-table": (
        make_command_entry("mhsb_planner.build_table"),
        "compute a machine's posture table",
    ),
    "simulate": (
        make_command_entry("mhsb_tools.commands.simulate_command"),
        "simulate goals without ROS",
    ),
    "demo": (
        make_command_entry("mhsb_tools.commands.demo_command"),
        "both nodes, goals, recording, report",
    ),
    "record": (
        make_node_entry("mhsb_tools.recording.record_command"),
        "record all topics; repair recordings",
    ),
    "report": (
        make_command_entry("mhsb_tools.report.report_command"),
        "pictures and numbers of a recording",
    ),
    "animate": (
        make_command_entry("mhsb_tools.commands.animate_command"),
        "a plan or recording as animation",
    ),
    "view": (
        make_node_entry("mhsb_tools.viewer.viewer_command"),
        "the arm or a recording in a browser",
    ),
    "study": (
        make_command_entry("mhsb_tools.study.study_command"),
        "controllers on many simulated runs",
    ),
    "compare": (
        make_command_entry("mhsb_tools.comparison.compare_command"),
        "planners and supplies compared",
    ),
    "tune": (make_command_entry("mhsb_tools.study.tune_command"), "tune the gains of controllers"),
    "reproduce": (
        make_command_entry("mhsb_tools.commands.reproduce_command"),
        "the paper's cases and figures",
    ),
    "goal": (
        make_command_entry("mhsb_planner.ros.goal_command"),
        "send a goal and print the verdict",
    ),
    "param": (
        make_command_entry("mhsb_tools.commands.param_command"),
        "list, read and set parameters",
    ),
    "call": (
        make_command_entry("mhsb_tools.commands.call_command"),
        "call a service, such as ~/stop",
    ),
    "echo": (make_node_entry("mhsb_tools.commands.echo_command"), "print the messages of a topic"),
}
"""Entry point and summary of each subcommand, in the order of the list of `mhsb --help`.

An entry point imports the subcommand's module when it starts, and returns the exit code. An
interrupt (SIGINT) ends a command with exit code 130. SIGINT, SIGTERM or SIGHUP end those that run
until then (`make_node_entry`) with exit code 0."""


def mhsb() -> int:
    """Run the subcommand that the first argument of the process names.

    `sys.argv` is read: its first argument is the subcommand, the others are passed on to it.
    Without an argument, and with `-h` or `--help`, the list of all subcommands is printed.
    `--version` prints the version, and `--completion` prints the completion script for bash. For an
    unknown name, an error with the nearest name is printed to standard error.

    Returns:
        The exit code of the subcommand or of printing the text; EXIT_USAGE for an unknown name.
    """
    name, *arguments = sys.argv[1:] or ["--help"]
    if name in SUBCOMMAND_TABLE:
        return _start(name, arguments)
    if name in ("-h", "--help"):
        return _print_text(_describe_subcommands())
    if name == "--version":
        return _print_text(f"mhsb {__version__}")
    if name == "--completion":
        return _print_text(COMPLETION_FILE.read_text(encoding="utf-8").rstrip())
    hint = suggest_name(name, SUBCOMMAND_TABLE) or f"; it has {', '.join(SUBCOMMAND_TABLE)}"
    print(f"mhsb: no subcommand '{name}'{hint}", file=sys.stderr)
    return EXIT_USAGE


def _print_text(text: str) -> int:
    """Print a text as the output of a command, with a command's errors and exit codes.

    Returns:
        The exit code, for example 141 if the reader of the output has closed it.
    """
    from mhsb_model.command_line import run  # takes longer to load than all else here

    def show() -> None:
        """Print the text."""
        print(text)

    return run(show, [], name="mhsb")


def _describe_subcommands() -> str:
    """Return the help of `mhsb`: usage and a line for each subcommand."""
    width = max(map(len, SUBCOMMAND_TABLE))
    return "\n".join(
        [
            "usage: mhsb SUBCOMMAND [ARGUMENTS]",
            "",
            "Motion planning, simulation and control of hydraulic arms.",
            "",
            *(f"  {name:{width}}  {summary}" for name, (_, summary) in SUBCOMMAND_TABLE.items()),
            "",
            "mhsb SUBCOMMAND --help explains its arguments; mhsb --version prints the version.",
            'eval "$(mhsb --completion)" completes subcommands and options in bash.',
        ]
    )


def _start(name: str, arguments: list[str]) -> int:
    """Run a subcommand of SUBCOMMAND_TABLE with `sys.argv` set to its name and arguments.

    Returns:
        The exit code.
    """
    sys.argv = [f"mhsb {name}", *arguments]
    return SUBCOMMAND_TABLE[name][0]()


def _former_spelling(name: str) -> Callable[[], int]:
    """Make an entry point for the old way to start a subcommand, `ros2 run mhsb_tools NAME`.

    The entry point prints the new way, `mhsb NAME`, to standard error, and then runs the
    subcommand.

    Args:
        name: Name of the subcommand in SUBCOMMAND_TABLE.

    Returns:
        The entry point, a function without arguments that returns the exit code.
    """

    def enter() -> int:
        """Print the new spelling and run the subcommand with the process's arguments."""
        print(f"from the next release on this command is only: mhsb {name}", file=sys.stderr)
        return _start(name, sys.argv[1:])

    return enter


FORMER_SPELLINGS = {
    "check": "check",
    "plan": "plan",
    "reproduce": "reproduce",
    "simulate": "simulate",
    "compare": "compare",
    "study": "study",
    "tune": "tune",
    "report": "report",
    "animate": "animate",
    "demo": "demo",
    "record": "record",
    "viewer": "view",
}
"""Subcommand by NAME of `ros2 run mhsb_tools NAME`; to be removed in the next release."""
globals().update({former: _former_spelling(name) for former, name in FORMER_SPELLINGS.items()})

if __name__ == "__main__":
    run_named(globals())
