"""Registry of the kinds of valves, and the valves that a machine has.

A new kind is one module and three lines here: an import, its place in `VALVE_KINDS` or
`PORT_VALVE_KINDS`, and its branch in `compute_valve_flow` or `compute_port_opening` with the index
of that place.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError

from mhsb_model.errors import MachineFileError
from mhsb_model.files.schema_problems import describe_validation_errors
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.records import Record, Records, create_records
from mhsb_model.types import FloatArray
from mhsb_sim.circuit.quantities import CircuitEnergies
from mhsb_sim.circuit.valves.counterbalance import (
    COUNTERBALANCE,
    compute_counterbalance_opening,
)
from mhsb_sim.circuit.valves.piston_seal import PISTON_SEAL, compute_seal_flow
from mhsb_sim.circuit.valves.rail_bleed import RAIL_BLEED, compute_bleed_flow
from mhsb_sim.circuit.valves.valve_kind import CircuitSite, PortValveKind, ValveKind

VALVE_KINDS: tuple[ValveKind, ...] = (
    RAIL_BLEED,
    PISTON_SEAL,
)
"""Kinds of valves between two nodes, in the order in which their flows are added."""

PORT_VALVE_KINDS: tuple[PortValveKind, ...] = (COUNTERBALANCE,)
"""Kinds of valves between a chamber and the servo valve."""


@kernel(inline="always")
def compute_valve_flow(kind: int, numbers: FloatArray, drop: float) -> tuple[float, float]:
    """Compute the flow of a valve of a registered kind, and its slope dQ/dΔp.

    Args:
        kind: Index in `VALVE_KINDS`.
        numbers: Numbers of the valve's flow equation.
        drop: Pressure drop Δp from its start node to its end node [Pa].

    Returns:
        Flow from start to end [m³/s] and slope [m³/(s Pa)]; both are 0 for an unknown index.
    """
    if kind == 0:
        return compute_bleed_flow(numbers, drop)
    if kind == 1:
        return compute_seal_flow(numbers, drop)
    return 0.0, 0.0


@kernel(inline="always")
def compute_port_opening(kind: int, numbers: FloatArray, chamber: float, pilot: float) -> float:
    """Compute the opening to which a port valve of a registered kind moves.

    Args:
        kind: Index in `PORT_VALVE_KINDS`.
        numbers: Numbers of the valve's equation.
        chamber: Pressure of its chamber above tank pressure [Pa].
        pilot: Pressure of its pilot above tank pressure [Pa].

    Returns:
        Opening, 0 … 1; 1 for an unknown index.
    """
    if kind == 0:
        return compute_counterbalance_opening(numbers, chamber, pilot)
    return 1.0


class PlacedValve(Record):
    """A valve between two nodes."""

    kind: int
    """Index in `VALVE_KINDS`."""
    start: int
    """Node from which its flow is counted."""
    end: int
    """Node to which its flow is counted."""
    counter: int
    """Index of its energy counter among the fields of `EnergyCounters`."""


class EnergyCounters(CircuitEnergies):
    """Counters of energy [J], with one for each kind of valve."""


EnergyCounters.__annotations__ = CircuitEnergies.__annotations__ | {
    kind.name: "float" for kind in VALVE_KINDS
}


class PlacedValves(NamedTuple):
    """All valves of a circuit.

    Attributes:
        records: Kind, nodes and energy counter of each of k valves.
        numbers: Numbers of each valve's flow equation, float64[k, w]. w is the largest count of
            numbers of any valve; shorter rows are filled up with zeros.
    """

    records: Records[PlacedValve]
    numbers: FloatArray


class PlacedPortValve(Record):
    """A valve between a chamber and the servo valve."""

    kind: int
    """Index in `PORT_VALVE_KINDS`."""
    chamber: int
    """Node of its chamber."""
    pilot: int
    """Node of its pilot."""
    coefficient: float
    """Flow coefficient of the fully open valve [m³/(s √Pa)]."""
    decay: float
    """Decay e^(−substep/τ) of the lag τ of its opening."""
    opening: float
    """Opening, 0 … 1."""


class PortValves(NamedTuple):
    """All port valves of a circuit, at most one for each chamber.

    Attributes:
        records: Kind, nodes, coefficient and opening of each of k valves.
        numbers: Numbers of each valve's equation, float64[k, w].
        coefficient: Present flow coefficient between each node and the servo valve, float64[nodes],
            [m³/(s √Pa)]; inf without a port valve.
    """

    records: Records[PlacedPortValve]
    numbers: FloatArray
    coefficient: FloatArray


def place_port_valves(site: CircuitSite) -> PortValves:
    """Place the port valves whose sections the machine file has; all are shut.

    Args:
        site: Circuit of a machine.

    Returns:
        Records, numbers and coefficients of the valves.

    Raises:
        MachineFileError: The name of a section is no kind of valve, or a section has an unknown key
            or a wrong value; or two kinds are at the same chamber.
    """
    sections = read_valve_sections(site.machine)
    placed = [
        (k, place)
        for k, kind in enumerate(PORT_VALVE_KINDS)
        if kind.name in sections
        for place in kind.list_places(site, sections[kind.name])
    ]
    if len({place.chamber for _, place in placed}) < len(placed):
        names = ", ".join(kind.name for kind in PORT_VALVE_KINDS if kind.name in sections)
        problem = f"circuit.valves: one chamber has room for only one of {names}"
        raise MachineFileError(site.machine.name, [problem])
    records = create_records(PlacedPortValve, len(placed))
    width = max((len(place.numbers) for _, place in placed), default=0)
    numbers, coefficient = np.zeros((len(placed), width)), np.full(site.tank + 1, np.inf)
    substep = float(site.constants["substep"][0])
    for row, (k, place) in enumerate(placed):
        decay = np.exp(-substep / place.lag)
        records[row : row + 1] = (k, place.chamber, place.pilot, place.coefficient, decay, 0.0)
        numbers[row, : len(place.numbers)] = place.numbers
        coefficient[place.chamber] = 0.0
    return PortValves(records, numbers, coefficient)


def place_valves(site: CircuitSite) -> PlacedValves:
    """Place the valves of all registered kinds in a circuit, in the order of `VALVE_KINDS`.

    A kind without a section is always placed. A kind with a section is placed only if the machine
    file has it in `circuit.valves`.

    Args:
        site: Circuit of a machine.

    Returns:
        Records and numbers of the valves.

    Raises:
        MachineFileError: The name of a section is no kind of valve, or a section has an unknown key
            or a wrong value.
    """
    sections = read_valve_sections(site.machine)
    names = list(EnergyCounters.__annotations__)
    placed = [
        (k, names.index(kind.name), place)
        for k, kind in enumerate(VALVE_KINDS)
        if kind.section is None or kind.name in sections
        for place in kind.list_places(site, sections.get(kind.name))
    ]
    records = create_records(PlacedValve, len(placed))
    numbers = np.zeros((len(placed), max(len(place.numbers) for _, _, place in placed)))
    for row, (k, counter, place) in enumerate(placed):
        records[row : row + 1] = (k, place.start, place.end, counter)
        numbers[row, : len(place.numbers)] = place.numbers
    return PlacedValves(records, numbers)


def read_valve_sections(machine: Machine) -> dict[str, Any]:
    """Check the sections of valves in a machine file against the schemas of their kinds.

    Args:
        machine: Machine, whose file may have the sections `circuit.valves`.

    Returns:
        Checked section by name of its kind, for each section in the file. Keys that a section
        leaves out have their defaults.

    Raises:
        MachineFileError: The name of a section is no kind of valve, or a section has an unknown key
            or a wrong value.
    """
    kinds: tuple[ValveKind | PortValveKind, ...] = (*VALVE_KINDS, *PORT_VALVE_KINDS)
    schemas = {kind.name: kind.section for kind in kinds if kind.section is not None}
    sections, problems = {}, []
    for name, content in machine.config.circuit.valves.items():
        schema = schemas.get(name)
        if schema is None:
            known = ", ".join(sorted(schemas)) or "none"
            problems.append(f"circuit.valves.{name}: no such kind of valve, there are: {known}")
            continue
        try:
            sections[name] = schema.model_validate(content)
        except ValidationError as error:
            problems += describe_validation_errors(error, schema, f"circuit.valves.{name}")
    if problems:
        raise MachineFileError(machine.name, problems)
    return sections
