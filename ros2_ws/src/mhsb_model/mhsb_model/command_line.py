"""Frame in which every command of the suite runs: arguments, errors and exit codes.

A command is a function. Its parameters, their types and their documentation define the command
line. A parameter that is a dataclass is a group of options with the names of its fields. An error
that the user can cause is printed as one sentence on standard error. The exit codes are:

    exit code  0    success (or the code that the command returns)
               1    the command failed, or a given file cannot be used
               2    the arguments cannot be used
               130  interrupted; the sentence says which results were kept, and where
               141  the reader of the output went away; nothing is printed
"""

import errno
import inspect
import math
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, cast, get_type_hints

import docstring_parser
import tyro

# Events of a failed parse are not public in tyro, so its version is pinned.
from tyro import _errors as parse_errors

from mhsb_model.errors import (
    ArgumentError,
    MachineFileError,
    MhsbError,
    suggest_name,
    suggest_unit_of_number,
)

EXIT_FAILED = 1
EXIT_USAGE = 2
EXIT_INTERRUPTED = 130
EXIT_READER_GONE = 141

DEFAULT_INTERRUPT_NOTE = "no result was kept"
"""Words of an interrupted command that has not called `set_interrupt_note`."""

SECTION_HEADING = re.compile(r"\n(?:Args|Attributes|Returns|Raises|Yields|Examples?|Source):\n")
"""Heading of a section of a docstring, which `--help` does not show."""
MAX_QUOTED_WORD = 120
"""Largest number of characters of a word that a message repeats; paths are long."""

MAX_QUOTED_NUMBER = 30
"""Largest number of characters of a number that a message repeats."""


_interrupt_note: list[str] = []
"""Words of the last call of `set_interrupt_note` in the running command; at most one element."""


def set_interrupt_note(words: str) -> None:
    """Set the words that are printed if the user interrupts the running command from now on.

    Args:
        words: Clause that says which results are kept and where, for instance "out/summary.json has
            3 of 10 draws". It replaces the words of earlier calls.
    """
    _interrupt_note[:] = [words]


class UsageError(ArgumentError):
    """The arguments of a command cannot be used."""


def check_suffix(option: str, file: Path | None, suffix: str) -> None:
    """Raise UsageError if the file that an option names does not end in a suffix, such as .png."""
    if file is not None and file.suffix.lower() != suffix:
        raise UsageError(f"--{option}: '{file}' must end in {suffix}")


@dataclass(frozen=True)
class NumberRange:
    """Range of an argument's numbers, as metadata: `Annotated[float, NumberRange(0.0, 5.0)]`.

    The help shows the range. A number outside the range is refused before the command begins.

    Attributes:
        least: Smallest allowed number.
        greatest: Largest allowed number.
        unit: SI unit, for a hint if a number seems to be in another one; empty: no hint.
    """

    least: float
    greatest: float
    unit: str = ""

    def __str__(self) -> str:
        """Return the range in words."""
        return f"from {self.least:g} to {self.greatest:g}"


Seed = Annotated[int, NumberRange(0, 2**63 - 1)]
"""Seed of random numbers."""

Count = Annotated[int, NumberRange(0, 1_000_000)]
"""Number of things."""

JobCount = Annotated[int | None, NumberRange(1, 4096)]
"""Number of worker processes; None means one for each processor."""

OptionalFile = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
"""File, or None."""

JsonFlag = Annotated[bool, tyro.conf.arg(name="json")]
"""Option `--json` of a parameter with another name, since `json` is the name of a module."""


def run(
    command: Callable[..., int | None],
    arguments: Sequence[str] | None = None,
    *,
    name: str | None = None,
    node: bool = False,
) -> int:
    """Parse a command's arguments, run it, and turn errors into sentences and exit codes.

    The exit codes are

        0    success, unless the command returns another code
        1    an MhsbError, or an OSError that names a file or says that the disk is full
        2    an ArgumentError: the arguments cannot be used
        130  interrupted (KeyboardInterrupt)
        141  the reader of the output has closed it (BrokenPipeError); nothing is printed

    With the codes 1, 2 and 130, one sentence is printed on standard error. A machine file with
    several problems gets a line for each. Other exceptions are bugs and are raised. `--help` prints
    the help and raises SystemExit with code 0.

    Args:
        command: A function whose parameters are the arguments of the command.
        arguments: Words of the command line; None takes the process's own.
        name: Name of the command in usage and error messages; None takes the name of the started
            file.
        node: Whether `--ros-args …` is removed before parsing, since rclpy reads it from the
            process's own arguments.

    Returns:
        The exit code.
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    name = name or Path(sys.argv[0]).stem
    _interrupt_note.clear()
    try:
        if node:
            arguments = without_ros_arguments(arguments)
        code = _parse(command, arguments, name)() or 0
        sys.stdout.flush()  # raises BrokenPipeError here if the reader went away
        return code
    except ArgumentError as error:
        return _print_failure(name, error, EXIT_USAGE)
    except MhsbError as error:
        return _print_failure(name, error, EXIT_FAILED)
    except KeyboardInterrupt:
        return _print_failure(
            name,
            f"interrupted; {_interrupt_note[0] if _interrupt_note else DEFAULT_INTERRUPT_NOTE}",
            EXIT_INTERRUPTED,
        )
    except BrokenPipeError:
        _drop_output()
        return EXIT_READER_GONE
    except OSError as error:
        if error.errno == errno.ENOSPC:  # a full disk; the error need not name a file
            _drop_output()
            place = error.filename or "the output"
            return _print_failure(name, f"{place} cannot be written: {error.strerror}", EXIT_FAILED)
        if error.filename is None:  # a bug: errors of files that users give have names
            raise
        return _print_failure(name, f"{error.filename}: {error.strerror}", EXIT_FAILED)


def make_main(command: Callable[..., int | None], *, node: bool = False) -> Callable[[], int]:
    """Make the function `main` of a command's module, which `mhsb_model.process` calls.

    Args:
        command: A function whose parameters are the arguments of the command.
        node: Whether `--ros-args …` is removed before parsing.

    Returns:
        Function that runs the command with the arguments of the process and returns the exit code.
    """
    return partial(run, command, node=node)


def _drop_output() -> None:
    """Redirect standard output to the null device, so that flushing at exit cannot fail."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def without_ros_arguments(arguments: Sequence[str]) -> list[str]:
    """Remove the arguments that are meant for ROS.

    These arguments begin with `--ros-args` and end with the next `--`, or at the end of the command
    line. Both markers are removed too. The command line may contain several such parts.

    Args:
        arguments: Words of the command line.

    Returns:
        The remaining words in their order, in a new list.
    """
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


def _print_failure(name: str, error: MhsbError | str, code: int) -> int:
    """Print a command's name and one sentence on standard error.

    If a machine file has several problems, each gets a line.

    Args:
        name: Name of the command.
        error: Error or sentence; line breaks become spaces.
        code: Exit code, which is returned unchanged.
    """
    first, *others = error.format_lines() if isinstance(error, MachineFileError) else [str(error)]
    print(f"{name}: {_one_line(first)}", file=sys.stderr)
    for line in others:
        print(f"  {_one_line(line)}", file=sys.stderr)
    return code


def _one_line(text: str) -> str:
    """Return a text with each run of white space replaced by one space."""
    return " ".join(text.split())


def _parse(
    command: Callable[..., int | None], arguments: list[str], name: str
) -> Callable[[], int | None]:
    """Parse a command's arguments and bind them to the command, without running it.

    `--help` prints the help and raises SystemExit with code 0.

    Args:
        command: A function whose parameters are the arguments of the command.
        arguments: Words of the command line.
        name: Name of the command in usage and error messages.

    Returns:
        A function without arguments that runs the command. It returns the exit code; None means 0.

    Raises:
        UsageError: The arguments cannot be parsed, or a number is outside its range.
    """

    def raise_usage_error(event: parse_errors.ParseErrorEvent) -> None:
        """Raise UsageError with one sentence for an error event of tyro's parser.

        The sentence ends with a hint to `--help`. If an option is unknown, it also names a similar
        option, if there is one.
        """
        sentence = _describe_parse_error(event, arguments).rstrip(".")
        if isinstance(event, parse_errors.UnrecognizedArgs) and event.tokens[0].startswith("--"):
            sentence += suggest_name(event.tokens[0].partition("=")[0], _list_options(command))
        raise UsageError(f"{sentence}; see {name} --help")

    with parse_errors.on_parse_error(raise_usage_error):
        parsed = tyro.cli(
            command,
            prog=name,
            description=_description(command),
            args=arguments,
            config=(
                tyro.conf.FlagCreatePairsOff,
                tyro.conf.DisallowNone,
                tyro.conf.OmitArgPrefixes,
            ),
            registry=_REGISTRY,
        )
    return cast(Callable[[], int | None], parsed)


def _description(command: Callable[..., Any]) -> str:
    """Return the description of a command from its docstring, wrapped to the terminal's width.

    Sections such as `Args:` and all text after them are left out. Each line begins with a space,
    which keeps tyro from joining the lines again.

    Args:
        command: A command.

    Returns:
        The wrapped paragraphs, one below the other without empty lines between them.
    """
    text = SECTION_HEADING.split(inspect.cleandoc(command.__doc__ or ""), maxsplit=1)[0]
    wrap = textwrap.TextWrapper(
        shutil.get_terminal_size().columns,
        initial_indent=" ",
        subsequent_indent=" ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "\n".join(wrap.fill(_one_line(part)) for part in text.strip().split("\n\n"))


def _describe_range_and_default(limits: NumberRange | None, value: str) -> str:
    """Return the text that the help adds to an argument: its range and its default value.

    Args:
        limits: Range of the argument's numbers; None if it has none.
        value: The default value as text. "None" and an empty string in quotes add
            nothing, since the argument's own description says what they do. An empty text adds the
            word "repeatable".

    Returns:
        Text in parentheses, such as `(from 0 to 5; default: 1)`. Empty if there is nothing to add.
    """
    default = {"None": "", "''": "", "": "repeatable"}.get(value, f"default: {value}")
    words = "; ".join(filter(None, (str(limits or ""), default)))
    return f"({words})" if words else ""


def _get_range(kind: Any) -> NumberRange | None:
    """Return the range of an argument's numbers from the metadata of its type.

    Args:
        kind: Type, such as `Annotated[float, NumberRange(0.0, 5.0)]`.

    Returns:
        The first `NumberRange`; None if there is none.
    """
    found = (each for each in getattr(kind, "__metadata__", ()) if isinstance(each, NumberRange))
    return next(found, None)


def _check_ranges(kinds: Mapping[str, Any], values: Mapping[str, Any]) -> None:
    """Check that all numbers of all arguments are within their ranges.

    The range is the `NumberRange` in the metadata of an argument's type. Arguments without one are
    not checked. Numbers in nested lists and tuples are checked, too.

    Args:
        kinds: Type of each argument by its name.
        values: Value of each argument by its name.

    Raises:
        UsageError: A number is outside its range. The error's sentence names the first such
            argument, its range and the number. It suggests another unit if the number, converted
            from that unit, is within the range.
    """
    for name, value in values.items():
        limits = _get_range(kinds.get(name))
        if limits is None:
            continue
        for number in _iterate_numbers(value):
            if not limits.least <= number <= limits.greatest:
                is_positional = tyro.conf.Positional in kinds[name].__metadata__
                flag = name.upper() if is_positional else f"--{name.strip('_').replace('_', '-')}"
                hint = suggest_unit_of_number(number, limits.unit, limits.least, limits.greatest)
                given = str(number)[:MAX_QUOTED_NUMBER]
                raise UsageError(f"{flag} must be {limits} (is {given}){hint}")


def _iterate_numbers(value: Any) -> Iterator[float]:
    """Yield all numbers in a value, in their order.

    Numbers in nested tuples and lists are yielded too. Booleans and all other types are skipped.

    Args:
        value: Value of an argument.

    Yields:
        Numbers, int or float.
    """
    if isinstance(value, list | tuple):
        for each in value:
            yield from _iterate_numbers(each)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield value


# --- Sentences about arguments -------------------------------------------------------------------


def _describe_parse_error(event: parse_errors.ParseErrorEvent, arguments: list[str]) -> str:
    """Return a sentence that says what is wrong with the arguments.

    Args:
        event: Error event of tyro's parser.
        arguments: Words of the command line.

    Returns:
        The sentence, without the name of the command.
    """
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
            return _describe_bad_value(event.argument, "", arguments)
        case parse_errors.InstantiationFailure() if event.argument is not None:
            return _describe_bad_value(event.argument, event.message, arguments)
        case parse_errors.InstantiationFailure():
            return event.message
    return "these arguments do not go together"


def _list_options(target: Callable[..., Any]) -> Iterator[str]:
    """Yield the options of a command and of its groups, such as `--goal`.

    Args:
        target: Command, or dataclass of a group of options.

    Yields:
        `--help`, then the options in their order; positional arguments are left out.
    """
    yield "--help"
    for name, kind in _read_parameters(target)[0].items():
        if name not in inspect.signature(target).parameters:
            continue
        marks = getattr(kind, "__metadata__", ())
        group = getattr(kind, "__origin__", kind)
        if is_dataclass(group):
            yield from _list_options(cast(Callable[..., Any], group))
        elif tyro.conf.Positional not in marks:
            yield f"--{name.strip('_').replace('_', '-')}"


def _describe_bad_value(argument: Any, message: str, arguments: list[str]) -> str:
    """Return a sentence that says which values an argument takes and what was given instead.

    The words after the argument's flag on the command line are the given value. If there are none,
    it is the first list of words in tyro's message, or else the last quoted word of the message. If
    there is no such word either, the sentence says that nothing was given.

    Args:
        argument: The argument, as tyro describes it.
        message: tyro's message, which may quote the value; it may be empty.
        arguments: Words of the command line.

    Returns:
        The sentence. Each word is cut after MAX_QUOTED_WORD characters.
    """
    listed = re.search(r"\['[^]]*\]", message)
    quoted = re.findall(r"'([^']*)'", listed.group() if listed else message)
    given = _tokens_after(argument.lowered.name_or_flags, arguments)
    given = given or (quoted if listed else quoted[-1:])
    shown = " ".join(
        f"{word[:MAX_QUOTED_WORD]}…" if word[MAX_QUOTED_WORD:] else word for word in given
    )
    found = f"not '{shown}'" if given else "but nothing was given"
    return f"{_label(argument)} takes {_describe_values(argument)}, {found}"


def _label(argument: Any) -> str:
    """Return the name of an argument on the command line.

    Args:
        argument: The argument, as tyro describes it.

    Returns:
        The first spelling of its flag, or its name in capitals if it is positional.
    """
    if argument.is_positional():
        return str(argument.field.extern_name).upper()
    return str(argument.lowered.name_or_flags[0])


def _describe_values(argument: Any) -> str:
    """Return the kind of value that an argument takes, and its description in parentheses.

    Args:
        argument: The argument, as tyro describes it.

    Returns:
        For instance "NUMBER (duration [s])"; only "NUMBER" if the argument has no description.
    """
    metavar = str(argument.lowered.metavar).strip("{}")
    text = argument.field.helptext
    meaning = _one_line((text() if callable(text) else text) or "").rstrip(".")
    return f"{metavar} ({meaning})" if meaning else metavar


def _tokens_after(flags: Sequence[str], arguments: list[str]) -> list[str]:
    """Return the words between the last use of a flag and the next flag.

    Each word that begins with `--` counts as a flag.

    Args:
        flags: All spellings of the flag.
        arguments: Words of the command line.

    Returns:
        The words; empty if the flag was not used or nothing follows it.
    """
    places = [index for index, word in enumerate(arguments) if word in flags]
    if not places:
        return []
    words = arguments[places[-1] + 1 :]
    end = next((index for index, word in enumerate(words) if word.startswith("--")), len(words))
    return words[:end]


# --- Rules by which tyro makes arguments of functions, groups of options and numbers -------------

_REGISTRY = tyro.constructors.ConstructorRegistry()


@_REGISTRY.struct_rule
def _make_arguments_rule(
    kind: tyro.constructors.StructTypeInfo,
) -> tyro.constructors.StructConstructorSpec | None:
    """Tell tyro how to make arguments from a function's parameters or a dataclass's fields.

    The help shows the range of each argument's numbers; numbers outside the range are refused. A
    function is only bound to its arguments here, and called later. So its errors cannot be mistaken
    for parsing errors.

    Args:
        kind: A command, or the type of an argument. A dataclass becomes a group of options.

    Returns:
        Arguments with their descriptions, and the function that checks and binds their values. None
        if the type is neither a function nor a dataclass.
    """
    target = kind.type
    if not (inspect.isfunction(target) or is_dataclass(target)):
        return None
    hints, words = _read_parameters(target)

    def bind(**values: Any) -> Any:
        """Check the ranges of parsed arguments, and bind them.

        Args:
            **values: Value of each argument by its name.

        Returns:
            The created dataclass, or the function bound to its arguments without a call.

        Raises:
            UsageError: A number is outside its range.
        """
        _check_ranges(hints, values)
        return target(**values) if isinstance(target, type) else partial(target, **values)

    return tyro.constructors.StructConstructorSpec(
        bind,
        tuple(
            tyro.constructors.StructFieldSpec(
                name=name,
                type=_with_range_in_help(hints[name]),
                default=tyro.MISSING if each.default is each.empty else each.default,
                helptext=words.get(name),
            )
            for name, each in inspect.signature(target).parameters.items()
        ),
    )


@cache  # tyro asks several times for each group of options, and the source is parsed each time
def _read_parameters(target: Callable[..., Any]) -> tuple[dict[str, Any], dict[str, str]]:
    """Read the parameters of a function or the fields of a dataclass.

    Args:
        target: Function or dataclass.

    Returns:
        Type with its metadata, and description in one line, of each parameter by its name.
        Parameters that the docstring does not describe have no description.
    """
    words = {
        each.arg_name: _one_line(each.description or "")
        for each in docstring_parser.parse_from_object(target).params
    }
    return get_type_hints(target, include_extras=True), words


def _with_range_in_help(kind: Any) -> Any:
    """Make the help show the range and the default value of an argument.

    Args:
        kind: Type of the argument.

    Returns:
        The type with a further annotation for tyro.
    """
    hint = partial(_describe_range_and_default, _get_range(kind))
    return Annotated[kind, tyro.conf.arg(help_behavior_hint=hint)]


def _parse_finite(words: list[str]) -> float:
    """Convert a word of the command line to a finite number.

    Args:
        words: List that tyro passes; only the first word is read.

    Returns:
        The number.

    Raises:
        ValueError: The word is not a number, or the number is infinite or nan.
    """
    number = float(words[0])
    if not math.isfinite(number):
        raise ValueError(f"'{words[0]}' is not a finite number")
    return number


@_REGISTRY.primitive_rule
def _make_float_rule(
    kind: tyro.constructors.PrimitiveTypeInfo,
) -> tyro.constructors.PrimitiveConstructorSpec[float] | None:
    """Make tyro accept only finite numbers for arguments of type float.

    Args:
        kind: Type of an argument.

    Returns:
        Rule for conversion from and to text; None if the type is not float.
    """
    if kind.type is not float:
        return None
    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="NUMBER",
        instance_from_str=_parse_finite,
        is_instance=lambda value: isinstance(value, (int, float)),
        str_from_instance=lambda value: [str(value)],
    )
