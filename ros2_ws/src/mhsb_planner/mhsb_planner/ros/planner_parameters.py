"""Parameters of the planner node: declaration, ranges, and checks of changes."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_model.command_line import UsageError
from mhsb_model.errors import MhsbError, suggest_unit_of_number
from mhsb_model.machine import Machine
from mhsb_model.types import Position
from mhsb_msgs_py.parameters import NodeParameter
from mhsb_planner.errors import RequestError
from mhsb_planner.goal_region import (
    MAX_REGION_SIZE,
    WIDEST_ANGLE,
    Angle,
    check_angle,
    create_region,
)
from mhsb_planner.online.settings import REACHED_TOLERANCE, Settings
from mhsb_planner.planners.options import (
    DEFAULT_PLANNER,
    DEFAULT_SPEED_EXCESS,
    HIGHEST_SPEED_EXCESS,
    HIGHEST_WEIGHT,
    PlanOptions,
)
from mhsb_planner.planners.registry import (
    REGISTERED_PLANNERS,
    planner_summaries,
    planners_weighing_area,
)
from mhsb_planner.ros.flat_arrays import FARTHEST_POINT, split_rows
from mhsb_planner.ros.zone_parameters import ZONE_PARAMETERS, declare_zones, make_zones
from mhsb_planner.search.s2_search import Weights

ENERGY_READINGS = ("paper", "series")
"""Values of the parameter `energy_reading`."""

PAYLOAD_FROM = ("file", "estimate")
"""Values of the parameter `payload_from`."""

FREE_PSI = math.nan
"""Value of an angle parameter that leaves the end link's angle free."""

FREE_ANGLES = "goal_psi", "goal_psi_min", "goal_psi_max"
"""Parameters of the end link's angle at the goal. NaN means that a parameter is not given."""

FREE_OR = f"[rad], {-WIDEST_ANGLE:g} to {WIDEST_ANGLE:g}; .nan is free"
"""Unit and range of the parameters in FREE_ANGLES, for their descriptions."""

HIGHEST_PRESSURE = 5e7
"""Upper limit of the parameter `supply_pressure` [Pa]."""

HEAVIEST_PAYLOAD = 1e4
"""Upper limit of the parameter `payload` [kg]."""

FASTEST_PISTON = 1.0
"""Upper limit of the parameter `v_max` [m/s]."""

SHORTEST_LEAD, LONGEST_LEAD = 0.01, 5.0
"""Limits of the parameters of the commit horizon [s]."""

LEAD_IS = "time from a plan's stamp to its first new motion [s]"
"""Definition of the commit horizon, for the descriptions of its parameters."""

OWN_RANGES = {
    "weights": (0.0, HIGHEST_WEIGHT),
    **dict.fromkeys(FREE_ANGLES, (-WIDEST_ANGLE, WIDEST_ANGLE)),
    "goal_segment": (-MAX_REGION_SIZE, MAX_REGION_SIZE),
    "goal_box": (-MAX_REGION_SIZE, MAX_REGION_SIZE),
    "goal_via": (-FARTHEST_POINT, FARTHEST_POINT),
    **dict.fromkeys(ZONE_PARAMETERS, (-FARTHEST_POINT, FARTHEST_POINT)),
}
"""Least and greatest number by parameter name, for parameters whose ranges rclpy cannot check.

rclpy does not check arrays, and would refuse NaN, the value of free angles.
"""


HORIZON_PARAMETERS = (
    NodeParameter("lead_min", 0.03, f"least {LEAD_IS}", (SHORTEST_LEAD, LONGEST_LEAD)),
    NodeParameter("lead_max", 1.0, f"longest {LEAD_IS}", (SHORTEST_LEAD, LONGEST_LEAD)),
    NodeParameter(
        "planning_budget",
        0.0,
        f"{LEAD_IS}; 0 lets it adapt between lead_min and lead_max",
        (0.0, LONGEST_LEAD),
    ),
)
"""Parameters of the commit horizon."""

GOAL_PARAMETERS = (
    NodeParameter("goal_psi", FREE_PSI, f"angle of the end link at the goal {FREE_OR}"),
    NodeParameter(
        "goal_psi_min",
        FREE_PSI,
        f"least angle of the end link that will do at the goal {FREE_OR}",
    ),
    NodeParameter(
        "goal_psi_max",
        FREE_PSI,
        f"greatest angle of the end link that will do at the goal {FREE_OR}",
    ),
    NodeParameter(
        "goal_tolerance",
        0.0,
        "distance from the goal at which the tip may end as well [m]",
        (0.0, 2.0),
    ),
    NodeParameter(
        "reached_tolerance",
        REACHED_TOLERANCE,
        "how near the measured tip must come to the goal, or its region, and stay, soon after the "
        "plan's end (docs/contracts.md) [m]",
        (1e-4, 2.0),
    ),
    NodeParameter(
        "goal_segment",
        [0.0, 0.0],
        "x z [m] from the goal to the other end of a line on which the tip may end",
        OWN_RANGES["goal_segment"],
    ),
    NodeParameter(
        "goal_box",
        [0.0, 0.0],
        "x z [m], how far to either side of the goal the tip may end",
        OWN_RANGES["goal_box"],
    ),
    NodeParameter(
        "goal_via",
        [],
        "points that the tip passes on its way, in this order: x z [m] each, where the arm slews "
        "x y z",
        OWN_RANGES["goal_via"],
        may_be_empty=True,
    ),
    NodeParameter(
        "goal_via_tolerance",
        PlanOptions.via_tolerance,
        "distance at which the tip may pass the points of goal_via [m]",
        (1e-3, 2.0),
    ),
)
"""Parameters of the goal and of the path to it."""

MOTION_PARAMETERS = (
    NodeParameter(
        "area_weight",
        0.0,
        "of the velocity polytope's area lost along the tip's path, w4 [1/m]; for planners that "
        "can weigh it",
        (0.0, HIGHEST_WEIGHT),
    ),
    NodeParameter(
        "max_speed_excess",
        DEFAULT_SPEED_EXCESS,
        "how far pistons may pass V_max on the published polynomials, as a share of it [-]",
        (0.0, HIGHEST_SPEED_EXCESS),
    ),
)
"""Parameters of the path and of the motion along it."""


def declare_table_path(node: Node) -> Path | None:
    """Declare the read-only parameter `table`, and return the path of the posture table.

    Args:
        node: Planner node.

    Returns:
        Path of the file; None if the parameter is empty, so that the table in the user's cache is
        used.

    Raises:
        ParameterValueError: The parameter was started with a value that is no text.
    """
    text = "posture table (npz); empty builds one and keeps it"
    value = NodeParameter("table", "", text, read_only=True).declare(node)
    return Path(value) if value else None


def declare_frame_prefix(node: Node) -> str:
    """Declare the read-only parameter `frame_prefix`, and return its value.

    Args:
        node: Planner node.

    Returns:
        Text that is put before the names of frames.
    """
    text = "put before base_link and work_plane"
    return str(NodeParameter("frame_prefix", "", text, read_only=True).declare(node))


def declare_changeable(node: Node, machine: Machine) -> None:
    """Declare all parameters that can be changed between plans, and check their initial values.

    Args:
        node: Planner node.
        machine: Machine of the machine file. It gives the defaults of payload, supply pressure,
            V_max (planned piston speed) and zones.

    Raises:
        ParameterValueError: An initial value has a wrong type or is out of its range.
        UsageError: The initial values, for example from the command line, cannot be used together.
    """
    arrays = machine.arrays
    for parameter in (
        NodeParameter(
            "planner",
            DEFAULT_PLANNER,
            f"one of {', '.join(REGISTERED_PLANNERS)}: {planner_summaries()}",
        ),
        NodeParameter(
            "weights",
            [0.5, 0.0, 2.0],
            "of energy [1/J], time [1/s] and mode switches [-]",
            OWN_RANGES["weights"],
        ),
        NodeParameter("energy_reading", ENERGY_READINGS[0], f"one of {', '.join(ENERGY_READINGS)}"),
        NodeParameter("payload", arrays.payload, "at the tip [kg]", (0.0, HEAVIEST_PAYLOAD)),
        NodeParameter(
            "payload_from",
            PAYLOAD_FROM[0],
            "file: plans are made for the parameter payload; estimate: for what the arm has learnt "
            "on `estimates`, once that is known well, until then for the parameter",
        ),
        NodeParameter(
            "supply_pressure",
            arrays.supply_pressure,
            "of the main pump, P_S [Pa]",
            (1e5, HIGHEST_PRESSURE),
        ),
        NodeParameter(
            "v_max",
            machine.config.motion.max_piston_speed,
            "piston speed of the discrete plan, V_max [m/s]; an actuator whose own is lower keeps "
            "that, none is faster",
            (1e-4, FASTEST_PISTON),
        ),
        *HORIZON_PARAMETERS,
        *GOAL_PARAMETERS,
        *MOTION_PARAMETERS,
    ):
        parameter.declare(node)
    declare_zones(node, machine)
    if reason := find_refusal(node, machine, ()):
        raise UsageError(reason)


def read_settings(
    node: Node,
    machine: Machine,
    goal_parameters: Sequence[Parameter] = (),
    lost_servo_pumps: tuple[int, ...] = (),
    estimated_payload: float | None = None,
) -> Settings:
    """Make the settings of plans from the present values of the parameters.

    Args:
        node: Planner node.
        machine: Machine of the machine file.
        goal_parameters: Parameters of one goal, which replace the node's values in the result. The
            node's parameters are not changed.
        lost_servo_pumps: Numbers of failed servo pumps, from 1. Each failed pump reduces the number
            of booster modules by one.
        estimated_payload: Payload that the arm has estimated [kg]; None if there is no estimate.
            The estimate replaces the parameter `payload` if `payload_from` is `estimate`.

    Returns:
        Settings with the options, the limits of the commit horizon and the planning budget. Their
        machine is that of the file with payload, supply pressure, V_max and zones of the
        parameters, and with the remaining booster modules, at least 0.

    Raises:
        MhsbError: Angles, region, via points, zones or other values cannot be used.
    """
    values = _collect_values(node, goal_parameters)
    return _make_settings(machine, values, lost_servo_pumps, estimated_payload)


def find_refusal(node: Node, machine: Machine, changes: Sequence[Parameter]) -> str | None:
    """Check a set of parameter changes, and return the reason for a refusal.

    The changes are checked together with the present values of all other parameters. The checks
    cover allowed names, ranges, finite numbers, contradicting bounds, and whether planning accepts
    the options. No parameter is changed.

    Args:
        node: Planner node.
        machine: Machine of the machine file.
        changes: Parameters with their new values. Parameters that are not in
            `CHANGEABLE_PARAMETERS` are ignored.

    Returns:
        One sentence on the first problem; None if the changes can be made.
    """
    values = _collect_values(node, changes)
    for name, allowed in (
        ("planner", tuple(REGISTERED_PLANNERS)),
        ("energy_reading", ENERGY_READINGS),
        ("payload_from", PAYLOAD_FROM),
    ):
        if values[name] not in allowed:
            return f"{name} '{values[name]}' is not there; give one of: {', '.join(allowed)}"
    if reason := _find_number_out_of_range(values):
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
            f"at least {SHORTEST_LEAD:g} s, or 0 to let it adapt"
        )
    if values["area_weight"] > 0.0 and not REGISTERED_PLANNERS[values["planner"]].weighs_area:
        return (
            f"area_weight {values['area_weight']:g} needs planner {planners_weighing_area()} (is "
            f"'{values['planner']}'); set it to 0 or choose that planner"
        )
    try:
        _make_settings(machine, values)
    except MhsbError as error:
        return str(error)
    return None


def _find_number_out_of_range(values: Mapping[str, Any]) -> str | None:
    """Find a number that is out of the range of its parameter in `OWN_RANGES`.

    rclpy does not check these ranges. NaN, infinity and values that are not numbers are ignored.

    Args:
        values: Values of all changeable parameters by name.

    Returns:
        One sentence on the first number out of its range; None if there is none.
    """
    for name, (least, greatest) in OWN_RANGES.items():
        value = values[name]
        for number in value if isinstance(value, Sequence) else (value,):
            beyond = isinstance(number, int | float) and math.isfinite(number)
            if beyond and not least <= number <= greatest:
                unit = "rad" if name in FREE_ANGLES else ""
                hint = suggest_unit_of_number(number, unit, least, greatest)
                return f"{name} must be from {least:g} to {greatest:g} (is {number:g}){hint}"
    return None


def _collect_values(node: Node, changes: Sequence[Parameter]) -> dict[str, Any]:
    """Collect the values of all changeable parameters.

    Args:
        node: Planner node, which gives the present values.
        changes: Parameters whose values replace the present values. Parameters that are not in
            `CHANGEABLE_PARAMETERS` are ignored.

    Returns:
        Values by parameter name.
    """
    values = {name: node.get_parameter(name).value for name in CHANGEABLE_PARAMETERS}
    return values | {change.name: change.value for change in changes if change.name in values}


CHANGEABLE_PARAMETERS = (
    "planner",
    "weights",
    "energy_reading",
    "payload",
    "payload_from",
    "supply_pressure",
    "v_max",
    *(each.name for each in (*HORIZON_PARAMETERS, *GOAL_PARAMETERS, *MOTION_PARAMETERS)),
    *ZONE_PARAMETERS,
)
"""Names of the parameters that can be changed between plans."""


def _make_settings(
    base: Machine,
    values: Mapping[str, Any],
    lost_servo_pumps: tuple[int, ...] = (),
    estimated_payload: float | None = None,
) -> Settings:
    """Make the settings of plans from the values of parameters.

    Args:
        base: Machine of the machine file. If it slews, points have three coordinates instead of
            two.
        values: Values of all changeable parameters by name.
        lost_servo_pumps: Numbers of failed servo pumps, from 1.
        estimated_payload: Payload that the arm has estimated [kg]; None if there is no estimate.

    Returns:
        The settings; `read_settings` describes them.

    Raises:
        MhsbError: Angles, region, via points, zones or other values cannot be used.
    """
    is_estimated = values["payload_from"] == "estimate" and estimated_payload is not None
    meaning = f"{' '.join(base.axes)} [m] of a point"
    via = split_rows("goal_via", values["goal_via"], len(base.axes), meaning)
    options = PlanOptions(
        weights=Weights(*values["weights"]),
        energy_reading=values["energy_reading"],
        goal_psi=_combine_angles(*(values[name] for name in FREE_ANGLES)),
        goal_region=create_region(
            values["goal_tolerance"] or None,
            _convert_pair("goal_segment", values["goal_segment"]),
            _convert_pair("goal_box", values["goal_box"]),
        ),
        via=via,
        via_tolerance=values["goal_via_tolerance"],
        planner=values["planner"],
        area_weight=values["area_weight"],
        max_speed_excess=values["max_speed_excess"],
    )
    for point in via:
        _check_via(base, point)
    machine = base.changed(
        payload=estimated_payload if is_estimated else values["payload"],
        supply_pressure=values["supply_pressure"],
        max_piston_speed=values["v_max"],
        zones=make_zones(values, base.slews),
        module_count=max(base.arrays.module_count - len(lost_servo_pumps), 0),
    )
    return Settings(
        machine,
        options,
        values["lead_min"],
        values["lead_max"],
        values["planning_budget"],
        values["reached_tolerance"],
        lost_servo_pumps,
    )


def _combine_angles(exact: float, least: float, greatest: float) -> Angle:
    """Combine the three parameters of the end link's angle at the goal into one value.

    A parameter with the value NaN counts as not given.

    Args:
        exact: Parameter `goal_psi` [rad].
        least: Parameter `goal_psi_min` [rad].
        greatest: Parameter `goal_psi_max` [rad].

    Returns:
        The exact angle, or a pair of least and greatest angle [rad]. None if no parameter is given;
        the angle is then free.

    Raises:
        RequestError: Only one bound is given, bounds and an exact angle are given, or the angles
            are out of range.
    """
    free = [math.isnan(value) for value in (exact, least, greatest)]
    if free[1] != free[2] or not (free[0] or free[1]):
        rule = "must be given both or not at all, and not with goal_psi"
        raise RequestError("goal_psi_min and goal_psi_max", (least, greatest), rule)
    psi = None if all(free) else (least, greatest) if free[0] else exact
    check_angle(psi)
    return psi


def _convert_pair(name: str, value: Any) -> tuple[float, float] | None:
    """Convert a parameter value of two numbers to a pair of floats.

    Args:
        name: Name of the parameter, for the error, such as `goal_segment` or `goal_box`.
        value: Value of the parameter.

    Returns:
        (x, z) [m]; None if both numbers are 0, which means that the parameter is not used.

    Raises:
        RequestError: The value is not a sequence of two numbers.
    """
    numbers = [] if isinstance(value, str) or not isinstance(value, Sequence) else list(value)
    if len(numbers) != 2 or not all(isinstance(each, (int, float)) for each in numbers):
        raise RequestError(name, repr(value), "must be two numbers, x z [m]")
    return (float(numbers[0]), float(numbers[1])) if any(numbers) else None


def _check_via(machine: Machine, point: Position) -> None:
    """Check that a via point is finite and lies in the workspace.

    Args:
        machine: Machine with its workspace.
        point: Via point in `base_link`, (x, z) or (x, y, z) [m].

    Raises:
        RequestError: The point is not finite, or lies outside the workspace.
    """
    if not all(map(math.isfinite, point)):
        raise RequestError("goal_via", point, "must be finite numbers [m]")
    try:
        machine.check_in_workspace(point)
    except MhsbError as error:
        raise RequestError("goal_via", point, f"cannot be passed: {error}") from error
