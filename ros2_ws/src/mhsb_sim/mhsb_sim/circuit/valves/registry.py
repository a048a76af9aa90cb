"""Registry of the kinds of valves, and the valves that a machine has.

A new kind is one module and three lines here: an import, its place in `VALVE_KINDS` or
`PORT_VALVE_KINDS`, and its branch in `compute_valve_flow` or `compute_port_opening` with the index
of that place.
"""

import math
from collections.abc import Sequence
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
    COUNTERBALANCE_VALVE,
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

PORT_VALVE_KINDS: tuple[PortValveKind, ...] = (COUNTERBALANCE_VALVE,)
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
    """A valve between two nodes, or a port valve."""

    kind: int
    """Index in `VALVE_KINDS`; of a port valve, in `PORT_VALVE_KINDS`."""
    start: int
    """Node from which its flow is counted; chamber of a port valve."""
    end: int
    """Node to which its flow is counted; pilot of a port valve."""
    counter: int
    """Index of its energy counter among the fields of `EnergyCounters`; −1 of a port valve."""
    coefficient: float
    """Flow coefficient of a port valve that is fully open [m³/(s √Pa)]."""
    decay: float
    """Decay e^(−substep/τ) of the lag τ of a port valve."""
    opening: float
    """Opening of a port valve, 0 … 1."""


class EnergyCounters(CircuitEnergies):
    """Counters of energy [J], with one for each kind in `VALVE_KINDS`."""


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


def place_valves(site: CircuitSite) -> PlacedValves:
    """Place the valves of all registered kinds in a circuit, in the order of the registries.

    A kind without a section is always placed. A kind with a section is placed only if the machine
    file has it in `circuit.valves`. Port valves are shut at first.

    Args:
        site: Circuit of a machine.

    Returns:
        Records and numbers of the valves.

    Raises:
        MachineFileError: The name of a section is no kind of valve, or a section has an unknown key
            or a wrong value; or two port valves are at the same chamber.
    """
    sections = read_valve_sections(site.machine)
    names = list(EnergyCounters.__annotations__)
    placed: list[tuple[tuple, Sequence[float]]] = [
        ((k, place.start, place.end, names.index(kind.name), 0.0, 0.0, 0.0), place.numbers)
        for k, kind in enumerate(VALVE_KINDS)
        if kind.section is None or kind.name in sections
        for place in kind.list_places(site, sections.get(kind.name))
    ]
    substep, chambers = float(site.constants["substep"][0]), set()
    for k, kind in enumerate(PORT_VALVE_KINDS):
        for port in kind.list_places(site, sections[kind.name]) if kind.name in sections else ():
            if port.chamber in chambers:
                problem = f"circuit.valves.{kind.name}: a chamber has a port valve of another kind"
                raise MachineFileError(site.machine.name, [problem])
            chambers.add(port.chamber)
            state = port.coefficient, math.exp(-substep / port.lag), 0.0
            placed.append(((k, port.chamber, port.pilot, -1, *state), port.numbers))
    records = create_records(PlacedValve, len(placed))
    numbers = np.zeros((len(placed), max(len(own) for _, own in placed)))
    for row, (record, own) in enumerate(placed):
        records[row : row + 1] = record
        numbers[row, : len(own)] = own
    return PlacedValves(records, numbers)


def read_valve_sections(machine: Machine) -> dict[str, Any]:
    """Check the sections of valves in a machine file against the schemas of their kinds.

    Args:
        machine: Machine. Its file may have sections `circuit.valves`.

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
