"""File that keeps what a servo has learnt about its machine until the next start.

The file is readable YAML in SI units; commands are shares of the full command. A file belongs to
one machine, with the same name and hash (`Machine.planning_hash`).
"""

import itertools
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, ValidationError, model_validator

from mhsb_control.errors import EstimatesFileError
from mhsb_model.files.schema_problems import describe_validation_errors
from mhsb_model.files.yaml_files import YamlFileError, read_yaml
from mhsb_model.machine import Machine
from mhsb_model.schema import Section

Speed = Annotated[float, Field(ge=0.0, le=10.0)]
Command = Annotated[float, Field(ge=0.0, le=100.0)]
Deviation = Annotated[float, Field(gt=0.0, le=100.0)]


class DirectionResponse(Section):
    """Inverse valve curve of one direction: the command for each speed."""

    speeds: tuple[Speed, ...] = Field(min_length=2, max_length=100, description="of knots [m/s]")
    commands: tuple[Command, ...] = Field(description="at the knots, shares of the full one [-]")
    deviations: tuple[Deviation, ...] = Field(description="standard, of the commands [-]")
    known_speed: Speed = Field(description="up to which the curve has been known [m/s]")

    @model_validator(mode="after")
    def _check_knots(self) -> Self:
        """Check that all lists are equally long, and that speeds and commands increase.

        Raises:
            ValueError: A list has another length, or speeds or commands do not increase.
        """
        if not len(self.speeds) == len(self.commands) == len(self.deviations):
            raise ValueError("speeds, commands and deviations must have equal lengths")
        for values in (self.speeds, self.commands):
            if not all(a < b for a, b in itertools.pairwise(values)):
                raise ValueError("speeds and commands must increase")
        return self


class ActuatorResponse(Section):
    """Response of one actuator to its valve command."""

    delay: float = Field(ge=0.0, le=1.0, description="between command and motion [s]")
    delay_known: bool = Field(description="whether the motion was enough to estimate the delay")
    extending: DirectionResponse
    retracting: DirectionResponse


class LearntEstimates(Section):
    """Content of an estimates file."""

    machine: str = Field(max_length=200)
    machine_hash: str = Field(max_length=200)
    date: str = Field(max_length=100, description="of writing")
    actuators: dict[str, ActuatorResponse] = Field(max_length=64)


def read_estimates_file(path: Path, machine: Machine) -> dict[str, ActuatorResponse] | None:
    """Read the learnt responses of a machine's actuators from an estimates file.

    Args:
        path: The file. It need not exist, but its folder must exist.
        machine: The machine that the servo knows.

    Returns:
        Response of each actuator by its name; None if the file does not exist yet.

    Raises:
        EstimatesFileError: The folder does not exist, the file is damaged, or its actuators are not
            those of the machine. Or the file belongs to a machine with another name or planning
            hash.
    """
    if not path.exists():
        if path.parent.is_dir():
            return None
        raise EstimatesFileError(path, "its folder does not exist; create it or name another file")
    advice = "name another file, or delete this one so that the servo learns anew"
    try:
        found = LearntEstimates.model_validate(read_yaml(path))
    except YamlFileError as error:
        raise EstimatesFileError(path, f"{error.reason}; {advice}") from None
    except ValidationError as error:
        problems = describe_validation_errors(error, LearntEstimates)
        raise EstimatesFileError(path, f"{problems[0]}; {advice}") from None
    own = machine.planning_hash
    if (found.machine, found.machine_hash) != (machine.name, own):
        other = f"{found.machine[:64]} ({found.machine_hash[:8]})"
        raise EstimatesFileError(
            path, f"it belongs to the machine {other}, not to {machine.name} ({own[:8]}); {advice}"
        )
    if set(found.actuators) != set(machine.actuator_names):
        names = ", ".join(machine.actuator_names)
        raise EstimatesFileError(path, f"it must have the actuators {names}; {advice}")
    return found.actuators


def write_estimates_file(
    path: Path, machine: Machine, actuators: dict[str, ActuatorResponse]
) -> None:
    """Write the responses that a servo has learnt, completely or not at all.

    Args:
        path: The file; an earlier file is replaced.
        machine: The machine that the servo knows.
        actuators: Response of each actuator by its name.

    Raises:
        EstimatesFileError: The file cannot be written. An earlier file is kept.
    """
    part = _get_part_file(path)
    with _translate_write_errors(path):
        part.write_text(_format_estimates(machine, actuators), encoding="utf-8")
        part.replace(path)


def check_estimates_file_is_writable(path: Path) -> None:
    """Check that an estimates file can be written.

    An empty file with a temporary name is written beside it and removed.

    Args:
        path: The file; it is not changed, and not created.

    Raises:
        EstimatesFileError: The file cannot be written.
    """
    part = _get_part_file(path)
    with _translate_write_errors(path):
        part.write_text("", encoding="utf-8")
        part.unlink()


def _get_part_file(path: Path) -> Path:
    """Return the temporary path that is written first, and then renamed to `path`."""
    return path.with_name(f"{path.name}.part")


@contextmanager
def _translate_write_errors(path: Path) -> Iterator[None]:
    """Turn an OSError of the block into EstimatesFileError (context manager).

    The temporary file is then removed. Without an OSError it stays.

    Args:
        path: The estimates file.

    Raises:
        EstimatesFileError: The block has raised OSError.
    """
    try:
        yield
    except OSError as error:
        with suppress(OSError):
            _get_part_file(path).unlink(missing_ok=True)
        raise EstimatesFileError(
            path,
            f"it cannot be written: {error.strerror or error}; make room and its folder writable, "
            "or name another file",
        ) from error


def _format_estimates(machine: Machine, actuators: dict[str, ActuatorResponse]) -> str:
    """Return the text of an estimates file, with the present date.

    Args:
        machine: The machine that the servo knows.
        actuators: Response of each actuator by its name.
    """
    lines = [
        f"# What the servo of {machine.name} has learnt: the command for each piston speed.",
        "# Speeds in m/s, delays in s; commands and their standard deviations are shares of the",
        "# full command. Delete the file and the servo learns anew.",
        f'machine: "{machine.name}"',
        f"machine_hash: {machine.planning_hash}",
        f'date: "{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"',
        "actuators:",
    ]
    for name, found in actuators.items():
        lines += [f"  {name}:", f"    delay: {found.delay:.4f}"]
        lines.append(f"    delay_known: {str(found.delay_known).lower()}")
        for side in ("extending", "retracting"):
            curve: DirectionResponse = getattr(found, side)
            lines.append(f"    {side}:")
            for key in ("speeds", "commands", "deviations"):
                values = ", ".join(f"{value:.9g}" for value in getattr(curve, key))
                lines.append(f"      {key}: [{values}]")
            lines.append(f"      known_speed: {curve.known_speed:.9g}")
    return "\n".join([*lines, ""])
