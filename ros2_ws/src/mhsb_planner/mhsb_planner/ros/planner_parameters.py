"""Parameters of the planner node: declaration, ranges, and what a change is refused for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_model.command_line import UsageError
from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine, load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.types import Position
from mhsb_planner.errors import RequestError
from mhsb_planner.goal_region import (
    FARTHEST,
    WIDEST_ANGLE,
    Angle,
    Region,
    check_angle,
    region_of,
)
from mhsb_planner.online.settings import Settings
from mhsb_planner.planners.options import (
    DEFAULT_SPEED_EXCESS,
    HIGHEST_SPEED_EXCESS,
    HIGHEST_WEIGHT,
    PlanOptions,
)
from mhsb_planner.planners.registry import ONLINE_PLANNER, PLANNERS, summaries, weighing_area
from mhsb_planner.ros.flat_arrays import FARTHEST_POINT, declare_array, rows_of
from mhsb_planner.ros.zone_parameters import ZONES, declare_zones, zones_of
from mhsb_planner.search.s2_search import Weights
from mhsb_planner.search.s2_step import EnergyReading

READINGS = ("paper", "series")
PAYLOAD_FROM = ("file", "estimate")
FREE_PSI = math.nan
FREE_ANGLES = "goal_psi", "goal_psi_min", "goal_psi_max"
FREE_OR = f"[rad], {-WIDEST_ANGLE:g} to {WIDEST_ANGLE:g}; .nan is free"
HIGHEST_PRESSURE = 5e7  # Pa
HEAVIEST_PAYLOAD = 1e4  # kg
FASTEST_PISTON = 1.0  # m/s
SHORTEST_LEAD, LONGEST_LEAD = 0.01, 5.0  # s
LEAD_IS = "time from a plan's stamp to its first new motion [s]"
HIGHEST_AREA_WEIGHT = HIGHEST_WEIGHT  # 1/m
OWN_RANGES = {
    "weights": (0.0, HIGHEST_WEIGHT),
    **dict.fromkeys(FREE_ANGLES, (-WIDEST_ANGLE, WIDEST_ANGLE)),
    "goal_segment": (-FARTHEST, FARTHEST),
    "goal_box": (-FARTHEST, FARTHEST),
    "goal_via": (-FARTHEST_POINT, FARTHEST_POINT),
    **dict.fromkeys(ZONES, (-FARTHEST_POINT, FARTHEST_POINT)),
}
"""Least and greatest number of parameters whose descriptors cannot have rclpy look at a range: it
does so for single numbers alone, and would refuse the NaN of angles that are free."""


@dataclass(frozen=True)
class PlannerParameters:
    """What the parameters ask for; SI units.

    planner          where postures come from, one of `registry.PLANNERS`
    weights          (w1, w2, w3) of energy, time and mode switches
    energy_reading   price of boosted oil, `paper` or `series`
    payload          kg
    payload_from     whether that is planned with, or what the arm has learnt, one of `PAYLOAD_FROM`
    supply_pressure  Pa
    v_max            m/s, piston speed, of actuators whose own V_max is no lower
    lead_min, lead_max  s, between which the time adapts from a plan's stamp to where it leaves the
                     one before
    planning_budget  s, that time where it shall not adapt; 0 where it shall
    goal_psi         rad, angle of the end link at the goal, or the least and the greatest that
                     will do; None leaves it free
    goal_region      where else than at the goal the tip may end
    goal_via         points that the tip passes on its way to a goal, in this order: (x, z) m, where
                     the arm slews (x, y, z) m
    goal_via_tolerance  m, at what distance at most
    area_weight      1/m, of the velocity polytope's area; 0 leaves it out
    max_speed_excess greatest |v|/V_max − 1 of a piston on a polynomial
    zones            that the arm or its tip keeps out of
    """

    planner: str
    weights: tuple[float, float, float]
    energy_reading: EnergyReading
    payload: float
    payload_from: str
    supply_pressure: float
    v_max: float
    lead_min: float
    lead_max: float
    planning_budget: float
    goal_psi: Angle
    goal_region: Region | None
    goal_via: tuple[Position, ...]
    goal_via_tolerance: float
    area_weight: float
    max_speed_excess: float
    zones: Zones

    @property
    def options(self) -> PlanOptions:
        """What a plan is to be like."""
        return PlanOptions(
            weights=Weights(*self.weights),
            energy_reading=self.energy_reading,
            goal_psi=self.goal_psi,
            goal_region=self.goal_region,
            via=self.goal_via,
            via_tolerance=self.goal_via_tolerance,
            planner=self.planner,
            area_weight=self.area_weight,
            max_speed_excess=self.max_speed_excess,
        )

    def settings(
        self,
        base: Machine,
        lost_servo_pumps: tuple[int, ...] = (),
        learnt_payload: float | None = None,
    ) -> Settings:
        """How plans are made, by the machine of the file, some of whose servo pumps may be lost.

        learnt_payload: kg, planned with where `payload_from` asks for it.
        """
        modules = max(base.arrays.module_count - len(lost_servo_pumps), 0)
        machine = self.machine(base)
        if self.payload_from == "estimate" and learnt_payload is not None:
            machine = machine.changed(payload=learnt_payload)
        return Settings(
            machine.changed(module_count=modules),
            self.options,
            self.lead_min,
            self.lead_max,
            self.planning_budget,
            lost_servo_pumps,
        )

    def machine(self, base: Machine) -> Machine:
        """The machine of the file with payload, supply pressure, V_max and zones as asked for."""
        return base.changed(
            payload=self.payload,
            supply_pressure=self.supply_pressure,
            max_piston_speed=self.v_max,
            zones=self.zones,
        )


def declare_machine(node: Node) -> Machine:
    """Declare `machine` and read the file that it names; raises MachineFileError."""
    node.declare_parameter(
        "machine",
        "",
        _described("machine file (YAML); empty for the suite's own arm", read_only=True),
    )
    return load_machine(node.get_parameter("machine").value or None)


def declare_table_path(node: Node) -> Path | None:
    """Declare `table`: a posture table's file, None for the one in the user's cache."""
    node.declare_parameter(
        "table",
        "",
        _described("posture table (npz); empty builds one and keeps it", read_only=True),
    )
    value = node.get_parameter("table").value
    return Path(value) if value else None


def declare_frame_prefix(node: Node) -> str:
    """Declare `frame_prefix`: what stands before the frames' names."""
    node.declare_parameter(
        "frame_prefix", "", _described("put before base_link and work_plane", read_only=True)
    )
    return str(node.get_parameter("frame_prefix").value)


def declare(node: Node, machine: Machine) -> None:
    """Declare all parameters that can be changed between plans; UsageError where they clash."""
    arrays = machine.arrays
    node.declare_parameter(
        "planner",
        ONLINE_PLANNER,
        _described(f"one of {', '.join(PLANNERS)}: {summaries()}"),
    )
    node.declare_parameter(
        "weights",
        [0.5, 0.0, 2.0],
        _described(
            "of energy [1/J], time [1/s] and mode switches [-]", OWN_RANGES["weights"]
        ),
    )
    node.declare_parameter(
        "energy_reading", READINGS[0], _described(f"one of {', '.join(READINGS)}")
    )
    node.declare_parameter(
        "payload", arrays.payload, _described("at the tip [kg]", (0.0, HEAVIEST_PAYLOAD))
    )
    node.declare_parameter(
        "payload_from",
        PAYLOAD_FROM[0],
        _described(
            "file: plans are made for the parameter payload; estimate: for what the arm has learnt "
            "on `estimates`, once that is known well, until then for the parameter"
        ),
    )
    node.declare_parameter(
        "supply_pressure",
        arrays.supply_pressure,
        _described("of the main pump, P_S [Pa]", (1e5, HIGHEST_PRESSURE)),
    )
    node.declare_parameter(
        "v_max",
        machine.config.motion.max_piston_speed,
        _described(
            "piston speed of the discrete plan, V_max [m/s]; an actuator whose own is lower keeps "
            "that, none is faster",
            (1e-4, FASTEST_PISTON),
        ),
    )
    node.declare_parameter(
        "lead_min",
        0.03,
        _described(f"least {LEAD_IS}", (SHORTEST_LEAD, LONGEST_LEAD)),
    )
    node.declare_parameter(
        "lead_max",
        1.0,
        _described(f"longest {LEAD_IS}", (SHORTEST_LEAD, LONGEST_LEAD)),
    )
    node.declare_parameter(
        "planning_budget",
        0.0,
        _described(
            f"{LEAD_IS}; 0 lets it adapt between lead_min and lead_max",
            (0.0, LONGEST_LEAD),
        ),
    )
    node.declare_parameter(
        "goal_psi", FREE_PSI, _described(f"angle of the end link at the goal {FREE_OR}")
    )
    for name, which in (("goal_psi_min", "least"), ("goal_psi_max", "greatest")):
        text = f"{which} angle of the end link that will do at the goal {FREE_OR}"
        node.declare_parameter(name, FREE_PSI, _described(text))
    node.declare_parameter(
        "goal_tolerance",
        0.0,
        _described("distance from the goal at which the tip may end as well [m]", (0.0, 2.0)),
    )
    node.declare_parameter(
        "goal_segment",
        [0.0, 0.0],
        _described(
            "x z [m] from the goal to the other end of a line on which the tip may end",
            OWN_RANGES["goal_segment"],
        ),
    )
    node.declare_parameter(
        "goal_box",
        [0.0, 0.0],
        _described(
            "x z [m], how far to either side of the goal the tip may end",
            OWN_RANGES["goal_box"],
        ),
    )
    declare_array(
        node,
        "goal_via",
        (),
        "points that the tip passes on its way, in this order: x z [m] each, where the arm slews "
        "x y z",
    )
    node.declare_parameter(
        "goal_via_tolerance",
        PlanOptions.via_tolerance,
        _described("distance at which the tip may pass the points of goal_via [m]", (1e-3, 2.0)),
    )
    node.declare_parameter(
        "area_weight",
        0.0,
        _described(
            "of the velocity polytope's area lost along the tip's path, w4 [1/m]; for planners "
            "that can weigh it",
            (0.0, HIGHEST_AREA_WEIGHT),
        ),
    )
    node.declare_parameter(
        "max_speed_excess",
        DEFAULT_SPEED_EXCESS,
        _described(
            "how far pistons may pass V_max on the published polynomials, as a share of it [-]",
            (0.0, HIGHEST_SPEED_EXCESS),
        ),
    )
    declare_zones(node, machine)
    if reason := refusal(node, machine, ()):
        raise UsageError(reason)


def read(node: Node, machine: Machine, own: Sequence[Parameter] = ()) -> PlannerParameters:
    """The parameters as they are now for a machine, some of them replaced by a goal's own."""
    return _from_values(machine, _values(node, own))


def refusal(node: Node, machine: Machine, changes: Sequence[Parameter]) -> str | None:
    """Why a set of changes cannot be made, in one sentence, or None where it can."""
    values = _values(node, changes)
    for name, allowed in (
        ("planner", tuple(PLANNERS)),
        ("energy_reading", READINGS),
        ("payload_from", PAYLOAD_FROM),
    ):
        if values[name] not in allowed:
            return f"{name} '{values[name]}' is not there; give one of: {', '.join(allowed)}"
    if reason := _beyond_range(values):
        return reason
    weights = list(values["weights"])
    if len(weights) != 3 or not all(math.isfinite(w) and w >= 0 for w in weights):
        return f"weights {weights} must be three finite numbers that are not negative"
    for name in FREE_ANGLES:
        if math.isinf(values[name]):
            return f"{name} must be an angle in rad, or .nan to leave it free"
    for name, value in values.items():
        if name not in FREE_ANGLES and isinstance(value, float) and math.isnan(value):
            return f"{name} is nan; it must be a number"
    if values["lead_min"] > values["lead_max"]:
        return (
            f"lead_min {values['lead_min']:g} s must not be above lead_max "
            f"{values['lead_max']:g} s; change both in one go"
        )
    if 0.0 < values["planning_budget"] < SHORTEST_LEAD:
        return (
            f"planning_budget {values['planning_budget']:g} s is too short for a hand-over; give "
            f"at least {SHORTEST_LEAD:g} s, or 0 to let the lead adapt"
        )
    if values["area_weight"] > 0.0 and not PLANNERS[values["planner"]].weighs_area:
        return (
            f"area_weight {values['area_weight']:g} needs planner {weighing_area()} (is "
            f"'{values['planner']}'); set it to 0 or choose that planner"
        )
    try:
        asked = _from_values(machine, values)
        for point in asked.goal_via:
            _check_via(machine, point)
        asked.machine(machine)
        _ = asked.options  # raises where they cannot be planned with
    except MhsbError as error:
        return str(error)
    return None


def _beyond_range(values: Mapping[str, Any]) -> str | None:
    """Return which number of a parameter is out of a range that rclpy does not look at, or None."""
    for name, (least, greatest) in OWN_RANGES.items():
        value = values[name]
        for number in value if isinstance(value, Sequence) else (value,):
            beyond = isinstance(number, int | float) and math.isfinite(number)
            if beyond and not least <= number <= greatest:
                return f"{name} must be from {least:g} to {greatest:g} (is {number:g})"
    return None


def _values(node: Node, changes: Sequence[Parameter]) -> dict[str, Any]:
    values = {name: node.get_parameter(name).value for name in CHANGEABLE}
    return values | {change.name: change.value for change in changes if change.name in values}


CHANGEABLE = (
    "planner",
    "weights",
    "energy_reading",
    "payload",
    "payload_from",
    "supply_pressure",
    "v_max",
    "lead_min",
    "lead_max",
    "planning_budget",
    *FREE_ANGLES,
    "goal_tolerance",
    "goal_segment",
    "goal_box",
    "goal_via",
    "goal_via_tolerance",
    "area_weight",
    "max_speed_excess",
    *ZONES,
)


def _from_values(machine: Machine, values: Mapping[str, Any]) -> PlannerParameters:
    first, second, third = values["weights"]
    return PlannerParameters(
        planner=values["planner"],
        weights=(first, second, third),
        energy_reading=values["energy_reading"],
        payload=values["payload"],
        payload_from=values["payload_from"],
        supply_pressure=values["supply_pressure"],
        v_max=values["v_max"],
        lead_min=values["lead_min"],
        lead_max=values["lead_max"],
        planning_budget=values["planning_budget"],
        goal_psi=_angle(*(values[name] for name in FREE_ANGLES)),
        goal_region=region_of(
            values["goal_tolerance"] or None,
            _pair("goal_segment", values["goal_segment"]),
            _pair("goal_box", values["goal_box"]),
        ),
        goal_via=rows_of("goal_via", values["goal_via"], *_point_numbers(machine)),
        goal_via_tolerance=values["goal_via_tolerance"],
        area_weight=values["area_weight"],
        max_speed_excess=values["max_speed_excess"],
        zones=zones_of(values, machine.slews),
    )


def _angle(exact: float, least: float, greatest: float) -> Angle:
    """The end link's angle asked for; NaN is free. Raises RequestError where they clash."""
    free = [math.isnan(value) for value in (exact, least, greatest)]
    if free[1] != free[2] or not (free[0] or free[1]):
        rule = "must be given both or not at all, and not with goal_psi"
        raise RequestError("goal_psi_min and goal_psi_max", (least, greatest), rule)
    psi = None if all(free) else (least, greatest) if free[0] else exact
    check_angle(psi)
    return psi


def _pair(name: str, value: Any) -> tuple[float, float] | None:
    """Two numbers, None where both are 0; raises RequestError where it is something else."""
    numbers = [] if isinstance(value, str) or not isinstance(value, Sequence) else list(value)
    if len(numbers) != 2 or not all(isinstance(each, (int, float)) for each in numbers):
        raise RequestError(name, repr(value), "must be two numbers, x z [m]")
    return (float(numbers[0]), float(numbers[1])) if any(numbers) else None


def _check_via(machine: Machine, point: Position) -> None:
    """Raise RequestError where the tip can never be at a point on its way."""
    if not all(map(math.isfinite, point)):
        raise RequestError("goal_via", point, "must be finite numbers [m]")
    try:
        machine.check_in_workspace(point)
    except MhsbError as error:
        raise RequestError("goal_via", point, f"cannot be passed: {error}") from error


def _point_numbers(machine: Machine) -> tuple[int, str]:
    """How many numbers a point has, and what they are."""
    return len(machine.axes), f"{' '.join(machine.axes)} [m] of a point"



def _described(
    text: str, limits: tuple[float, float] | None = None, *, read_only: bool = False
) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=text, read_only=read_only)
    if limits is not None:
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=limits[0], to_value=limits[1], step=0.0)
        ]
    return descriptor
