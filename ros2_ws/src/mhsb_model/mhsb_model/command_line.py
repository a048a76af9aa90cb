"""The frame in which every command of the suite runs: arguments, errors, exit codes.

A command is a function, or a dataclass with a method `run`; its parameters, their types and
their documentation are the command line. Whatever goes wrong by the user's doing is told in one
sentence on standard error:

    exit code  0    done (or what the command itself returns)
               1    the command failed, or a file that it was given cannot be used
               2    the arguments cannot be used
               130  interrupted, with a sentence that tells what was kept, and where
               141  the reader of the output went away: silent
"""

from __future__ import annotations

import errno
import functools
import inspect
import math
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Protocol, cast, get_type_hints

import tyro

# The events of a failed parse are not yet public in tyro; its version is pinned for that reason.
from tyro import _errors as parse_errors

from mhsb_model.errors import ArgumentError, MhsbError
from mhsb_model.types import Position

FAILED = 1
USAGE = 2
INTERRUPTED = 130
READER_GONE = 141

NOTHING_KEPT = "no result was kept"

LONGEST_WORD = 120
"""Characters of a word of the command line that a message repeats; paths are long."""

LONGEST_NUMBER = 30
"""Characters of a number that a message repeats."""


_kept: list[str] = []
"""What an interrupt of the running command leaves, in words; the last one holds."""


def keep(words: str) -> None:
    """From now on an interrupt of this command tells these words: what is kept then, and where."""
    _kept[:] = [words]


class UsageError(ArgumentError):
    """The arguments of a command cannot be used."""


@dataclass(frozen=True)
class Within:
    """The range of an argument's numbers, as metadata: `Annotated[float, Within(0.0, 5.0)]`.

    Help shows it, and a number outside of it is refused before the command begins.

    Attributes:
        least: The smallest number that is taken.
        greatest: The greatest one.
    """

    least: float
    greatest: float

    def __str__(self) -> str:
        """Return the range in words."""
        return f"from {self.least:g} to {self.greatest:g}"


Seed = Annotated[int, Within(0, 2**63 - 1)]
"""Of random numbers."""

Count = Annotated[int, Within(0, 1_000_000)]
"""How many of something."""

JobCount = Annotated[int | None, Within(0, 4096)]
"""Processes that work; None takes one for each processor."""

Coordinates = Annotated[Position, Within(-1e4, 1e4)]
"""A position [m]."""


class Command(Protocol):
    """A dataclass whose fields are the arguments of a command."""

    def run(self) -> int | None:
        """Do it; the exit code, or None for 0."""


def run(
    command: Callable[..., int | None] | type[Command],
    arguments: Sequence[str] | None = None,
    *,
    name: str | None = None,
    node: bool = False,
) -> int:
    """Run a command on its arguments (default: the process's own) and return its exit code.

    `name` is what usage and errors call it (default: how it was started). With `node`,
    `--ros-args ...` are left to rclpy, which reads them from the process's arguments.
    `--help` prints the help and ends the process with code 0.
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    name = name or Path(sys.argv[0]).stem
    _kept.clear()
    try:
        if node:
            arguments = without_ros_arguments(arguments)
        code = _parse(command, arguments, name)() or 0
        sys.stdout.flush()  # so that a reader who went away is noticed here
        return code
    except ArgumentError as error:
        return _fail(name, error, USAGE)
    except MhsbError as error:
        return _fail(name, error, FAILED)
    except KeyboardInterrupt:
        return _fail(name, f"interrupted; {_kept[0] if _kept else NOTHING_KEPT}", INTERRUPTED)
    except BrokenPipeError:
        _drop_output()
        return READER_GONE
    except OSError as error:
        if error.errno == errno.ENOSPC:  # of standard output, or of a file, which it may not name
            _drop_output()
            place = error.filename or "the output"
            return _fail(name, f"{place} cannot be written: {error.strerror}", FAILED)
        if error.filename is None:  # not about a file that somebody named
            raise
        return _fail(name, f"{error.filename}: {error.strerror}", FAILED)


def _drop_output() -> None:
    """Nothing is left to flush when the process ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def without_ros_arguments(arguments: Sequence[str]) -> list[str]:
    """The arguments less what stands between `--ros-args` and `--` (or the end)."""
    own = []
    inside = False
    for argument in arguments:
        if argument == "--ros-args":
            inside = True
        elif inside:
            inside = argument != "--"
        else:
            own.append(argument)
    return own


def _fail(name: str, error: MhsbError | str, code: int) -> int:
    print(f"{name}: {_one_line(str(error))}", file=sys.stderr)
    return code


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _parse(
    command: Callable[..., int | None] | type[Command], arguments: list[str], name: str
) -> Callable[[], int | None]:
    """The command with its arguments filled in, ready to be called."""

    def refuse(event: parse_errors.ParseErrorEvent) -> None:
        sentence = _sentence(event, arguments).rstrip(".")
        raise UsageError(f"{sentence}; see {name} --help")

    plain = get_type_hints(command, include_extras=True)
    if isinstance(command, type):
        target: Callable[..., Any] = command
    else:
        # Parsing calls its target; binding keeps errors of the command apart from those of parsing.
        def target(*values: Any, **named: Any) -> Callable[[], int | None]:
            _check_ranges(plain, signature.bind(*values, **named).arguments)
            return functools.partial(command, *values, **named)

        hints = {
            name: Annotated[kind, tyro.conf.arg(help_behavior_hint=partial(_hint, _range(kind)))]
            for name, kind in plain.items()
        }
        signature = inspect.signature(command)
        # inspect, and tyro by it, looks for this name; mypy's functions do not have it.
        target.__signature__ = signature.replace(  # type: ignore[attr-defined]
            parameters=[
                each.replace(annotation=hints[name]) for name, each in signature.parameters.items()
            ]
        )
        target.__annotations__ = hints
        target.__doc__ = re.sub(r"\n {5,}", " ", inspect.cleandoc(command.__doc__ or ""))

    with parse_errors.on_parse_error(refuse):
        parsed: Any = tyro.cli(
            target,
            prog=name,
            description=_description(command),
            args=arguments,
            config=(tyro.conf.FlagCreatePairsOff, tyro.conf.DisallowNone),
            registry=_REGISTRY,
        )
    if not isinstance(command, type):
        return cast(Callable[[], int | None], parsed)
    _check_ranges(plain, vars(parsed))
    return cast(Callable[[], int | None], parsed.run)


def _description(command: Callable[..., Any]) -> str:
    """What its docstring says of a command, paragraphs wrapped to the terminal's width.

    Indented by one column, by which tyro knows that lines are not to be joined again.
    """
    text, *_ = inspect.cleandoc(command.__doc__ or "").partition("\nArgs:\n")
    wrap = textwrap.TextWrapper(
        shutil.get_terminal_size().columns,
        initial_indent=" ",
        subsequent_indent=" ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "\n".join(wrap.fill(_one_line(part)) for part in text.strip().split("\n\n"))


def _hint(limits: Within | None, value: str) -> str:
    """Return what help says behind the meaning of an argument: its range and default value.

    Args:
        limits: The range of its numbers, None if it has none.
        value: The default value; "None" is left out, since the meaning says what happens then.
    """
    default = {"None": "", "": "repeatable"}.get(value, f"default: {value}")
    words = "; ".join(filter(None, (str(limits or ""), default)))
    return f"({words})" if words else ""


def _range(kind: Any) -> Within | None:
    """Return the range in an argument's type, or None."""
    found = (each for each in getattr(kind, "__metadata__", ()) if isinstance(each, Within))
    return next(found, None)


def _check_ranges(kinds: Mapping[str, Any], values: Mapping[str, Any]) -> None:
    """Raise UsageError for the first argument with a number outside its range.

    Args:
        kinds: Type of each argument by its name.
        values: What the arguments are.
    """
    for name, value in values.items():
        limits = _range(kinds.get(name))
        if limits is None:
            continue
        for number in _numbers(value):
            if not limits.least <= number <= limits.greatest:
                flag = f"--{name.strip('_').replace('_', '-')}"
                raise UsageError(f"{flag} must be {limits} (is {str(number)[:LONGEST_NUMBER]})")


def _numbers(value: Any) -> Iterator[float]:
    """Yield all numbers in a value, in tuples and lists as well."""
    if isinstance(value, list | tuple):
        for each in value:
            yield from _numbers(each)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield value


# --- Sentences about arguments -------------------------------------------------------------------


def _sentence(event: parse_errors.ParseErrorEvent, arguments: list[str]) -> str:
    match event:
        case parse_errors.MissingArgs():
            missing = ", ".join(_label(each.arg) for each in event.missing_arguments)
            return f"missing {missing}"
        case parse_errors.UnrecognizedArgs():
            return f"not an argument of this command: {' '.join(event.tokens)}"
        case parse_errors.InvalidChoice():
            choices = ", ".join(choice for choice in event.choices if choice != "None")
            return f"{_label(event.argument)} takes one of {choices}, not '{event.value}'"
        case parse_errors.BadValue():
            return _bad_value(event.argument, "", arguments)
        case parse_errors.InstantiationFailure() if event.argument is not None:
            return _bad_value(event.argument, event.message, arguments)
        case parse_errors.InstantiationFailure():
            return event.message
    return "these arguments do not go together"


def _bad_value(argument: Any, message: str, arguments: list[str]) -> str:
    """What an argument takes, and what it was given."""
    quoted = re.findall(r"'([^']*)'", message)
    given = _tokens_after(argument.lowered.name_or_flags, arguments) or quoted[-1:]
    shown = " ".join(f"{word[:LONGEST_WORD]}…" if word[LONGEST_WORD:] else word for word in given)
    found = f"not '{shown}'" if given else "but nothing was given"
    return f"{_label(argument)} takes {_values(argument)}, {found}"


def _label(argument: Any) -> str:
    """How an argument is called on the command line."""
    if argument.is_positional():
        return str(argument.field.extern_name).upper()
    return str(argument.lowered.name_or_flags[0])


def _values(argument: Any) -> str:
    """What values an argument takes, with the words of its help."""
    metavar = str(argument.lowered.metavar).strip("{}")
    text = argument.field.helptext
    meaning = _one_line((text() if callable(text) else text) or "").rstrip(".")
    return f"{metavar} ({meaning})" if meaning else metavar


def _tokens_after(flags: Sequence[str], arguments: list[str]) -> list[str]:
    """The words that follow the last use of a flag, up to the next flag."""
    places = [index for index, word in enumerate(arguments) if word in flags]
    if not places:
        return []
    words = arguments[places[-1] + 1 :]
    end = next((index for index, word in enumerate(words) if word.startswith("--")), len(words))
    return words[:end]


# --- Numbers -------------------------------------------------------------------------------------

_REGISTRY = tyro.constructors.ConstructorRegistry()


def _finite(words: list[str]) -> float:
    number = float(words[0])
    if not math.isfinite(number):
        raise ValueError(f"'{words[0]}' is not a finite number")
    return number


@_REGISTRY.primitive_rule
def _finite_numbers(
    kind: tyro.constructors.PrimitiveTypeInfo,
) -> tyro.constructors.PrimitiveConstructorSpec[float] | None:
    """Every float on a command line is a finite number."""
    if kind.type is not float:
        return None
    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="NUMBER",
        instance_from_str=_finite,
        is_instance=lambda value: isinstance(value, (int, float)),
        str_from_instance=lambda value: [str(value)],
    )
