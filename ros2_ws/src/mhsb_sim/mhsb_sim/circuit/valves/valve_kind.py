"""Declaration of a kind of valve: its numbers, its places in the circuit and its equation.

A valve is between two nodes (`ValveKind`), or at a chamber in series with the servo valve
(`PortValveKind`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from mhsb_model.circuit.quantities import CircuitConstants
from mhsb_model.machine import Machine
from mhsb_model.records import Records
from mhsb_model.schema import Section
from mhsb_model.types import FloatArray


class CircuitSite(NamedTuple):
    """Circuit of a machine, to place valves between its nodes."""

    machine: Machine
    """Machine with n actuators."""
    constants: Records[CircuitConstants]
    """Constants of the circuit, a single record."""

    def cap_side(self, j: int) -> int:
        """Return the node of actuator j's cap-side chamber."""
        return 3 * j

    def rod_side(self, j: int) -> int:
        """Return the node of actuator j's rod-side chamber."""
        return 3 * j + 1

    def line(self, j: int) -> int:
        """Return the node of actuator j's supply line."""
        return 3 * j + 2

    @property
    def rail(self) -> int:
        """Node of the shared rail."""
        return 3 * self.machine.joint_count

    @property
    def manifold(self) -> int:
        """Node of the main pump's manifold."""
        return 3 * self.machine.joint_count + 1

    @property
    def tank(self) -> int:
        """Node of the tank, whose pressure is constant."""
        return 3 * self.machine.joint_count + 2


class ValvePlace(NamedTuple):
    """One valve of a kind in the circuit."""

    start: int
    """Node from which its flow is counted."""
    end: int
    """Node to which its flow is counted."""
    numbers: Sequence[float]
    """Numbers of its flow equation, as its kernel takes them."""


class PortValvePlace(NamedTuple):
    """One valve between a cylinder's chamber and the servo valve."""

    chamber: int
    """Node of the chamber."""
    pilot: int
    """Node whose pressure pilots the valve."""
    coefficient: float
    """Flow coefficient of the fully open valve [m³/(s √Pa)]."""
    lag: float
    """Time constant of its opening [s]."""
    numbers: Sequence[float]
    """Numbers of its equation, as its kernel takes them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ValveKind:
    """Kind of valve whose flow depends on its pressure drop alone.

    Attributes:
        name: Name of its energy counter, and of its section in `circuit.valves` of a machine file.
        section: Schema of that section, with unit, range and default of each key. None if every
            circuit has the valve.
        list_places: Function that returns all valves of this kind. It takes the circuit, and the
            section of the machine file (None for a kind without section).
        compute_flow: Kernel (numbers, pressure drop [Pa]) that returns the flow from start to end
            [m³/s] and its slope dQ/dΔp ≥ 0 [m³/(s Pa)].
    """

    name: str
    section: type[Section] | None = None
    list_places: Callable[[CircuitSite, Any], list[ValvePlace]]
    compute_flow: Callable[[FloatArray, float], tuple[float, float]]


@dataclass(frozen=True, kw_only=True, eq=False)
class PortValveKind:
    """Kind of valve that oil passes on its way from a chamber to the servo valve.

    Oil flows into the chamber past it, through a check valve without loss. Its own loss counts as
    that of the servo valve.

    Attributes:
        name: Name of its section in `circuit.valves` of a machine file.
        section: Schema of that section, with unit and range of each key.
        list_places: Function that returns all valves of this kind. It takes the circuit, and the
            section of the machine file.
        compute_opening: Kernel (numbers, chamber pressure, pilot pressure) that returns the opening
            to which the valve moves, 0 … 1. Pressures are those above tank pressure [Pa].
    """

    name: str
    section: type[Section]
    list_places: Callable[[CircuitSite, Any], list[PortValvePlace]]
    compute_opening: Callable[[FloatArray, float, float], float]
