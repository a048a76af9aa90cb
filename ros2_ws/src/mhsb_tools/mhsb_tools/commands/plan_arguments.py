"""Turn the arguments of `plan` and similar commands into requests; UsageError if they clash."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mhsb_model.command_line import UsageError
from mhsb_model.errors import MachineFileError
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, Position
from mhsb_planner.cases.paper_cases import PaperCase, paper_case
from mhsb_planner.errors import RequestError
from mhsb_planner.goal_region import Angle, Region, create_region
from mhsb_planner.planners.options import ENERGY_OPTIMAL
from mhsb_planner.planners.registry import get_planner, planners_using, planners_weighing_area
from mhsb_planner.search.s2_search import Weights
from mhsb_tools.moves.operating_point import Range

Point = tuple[float, float]


def build_request(
    start: Position | None,
    goal: Position | None,
    case: str | None,
    weights: tuple[float, float, float] | None = None,
    planner: str | None = None,
    initial_j3: float | None = None,
) -> PaperCase:
    """Combine a paper case with arguments that replace parts of it.

    Args:
        start: Tip position at the start (x, z) or (x, y, z) [m]; None takes the case's.
        goal: Tip position at the goal [m]; None takes the case's.
        case: Name of a paper case such as `1-1`; None means none, and then start and goal are
            needed.
        weights: Weights of energy [1/J], time [1/s] and mode switches; None takes the case's, or
            the energy-optimal ones without a case.
        planner: Name of the planner; None takes the case's, `table` without a case.
        initial_j3: Angle of joint 3 that the fixed planner keeps [rad]; None takes the case's.

    Returns:
        The case with everything given put in its place; its name is empty if no case was named.

    Raises:
        UsageError: Start or goal is missing or has a wrong number of coordinates, or a weight is
            invalid.
    """
    named = paper_case(case) if case is not None else None
    start = start or (named.start if named else None)
    goal = goal or (named.goal if named else None)
    for name, given in (("start", start), ("goal", goal)):
        if given is not None and len(given) not in (2, 3):
            wanted = "X Z, or X Y Z where the arm slews"
            raise UsageError(f"--{name} takes {wanted}, not {_format_value(given)}")
    if start is None or goal is None:
        raise UsageError("give --start X Z and --goal X Z, or --case NAME")
    base = named or PaperCase("", start, goal, ENERGY_OPTIMAL)
    try:
        chosen = Weights(*weights) if weights is not None else base.weights
    except RequestError as error:
        raise UsageError(f"--weights: {error}") from error
    return replace(
        base,
        start=start,
        goal=goal,
        weights=chosen,
        planner=planner or base.planner,
        initial_j3=base.initial_j3 if initial_j3 is None else initial_j3,
    )


def start_from_posture(
    machine: Machine, posture: Position, given: Mapping[str, Any]
) -> tuple[FloatArray, Position]:
    """Return a start posture and the tip's position in it.

    Args:
        machine: The arm.
        posture: Position of each joint [rad, telescopes m], within its limits or not.
        given: Other options that say where the motion starts, by name; None if left out.

    Returns:
        Joint positions, shape (n,), and the tip in `base_link` (x, z) or (x, y, z) [m].

    Raises:
        UsageError: The number of values is not the number of joints, or another option is given as
            well.
    """
    for name, value in given.items():
        if value is not None:
            flag = f"--{name.replace('_', '-')}"
            raise UsageError(f"give --start-posture or {flag}, not both")
    if len(posture) != machine.joint_count:
        wanted = f"{machine.joint_count} joint positions, {', '.join(machine.joint_names)}"
        raise UsageError(
            f"--start-posture takes {wanted}, not {_format_value(posture) or 'nothing'}"
        )
    q = np.array(posture, dtype=np.float64)
    return q, tuple(machine.tip_in_base(q).tolist())


def list_replaced_values(asked: PaperCase) -> list[str]:
    """List in words which options replace values of the named case.

    Args:
        asked: The combined request.

    Returns:
        One phrase for each of start, goal, weights, planner and angle of joint 3 that differs, such
        as `--goal 0.6 0.1 in place of its 0.55 0.6`. Empty if no case was named.
    """
    if not asked.name:
        return []
    case, said = paper_case(asked.name), []
    for name in ("start", "goal", "weights", "planner", "initial_j3"):
        own, given = getattr(case, name), getattr(asked, name)
        if own != given:
            flag = name.replace("_", "-")
            said.append(f"--{flag} {_format_value(given)} in place of its {_format_value(own)}")
    return said


def case_line(asked: PaperCase) -> list[str]:
    """Return the output's first line, which says how a request differs from its case.

    Args:
        asked: The combined request.

    Returns:
        A list with one sentence, or an empty list if nothing differs or no case was named.
    """
    said = list_replaced_values(asked)
    return [f"Case {asked.name}, but with {', '.join(said)}"] if said else []


def case_title(asked: PaperCase) -> str:
    """Return the beginning of a picture's title, such as `Case 1-1, changed: `.

    A different planner does not count as a change, since titles name the planner anyway.

    Args:
        asked: The combined request.

    Returns:
        The words with a colon and a space, or an empty string if no case was named.
    """
    changed = any(not each.startswith("--planner") for each in list_replaced_values(asked))
    return f"Case {asked.name}{', changed' if changed else ''}: " if asked.name else ""


def _format_value(value: object) -> str:
    """Return a value as it is written on the command line.

    Args:
        value: Weights, a tuple, a number, a string, or None.

    Returns:
        Numbers separated by spaces; None is written as `own`.
    """
    if isinstance(value, Weights):
        value = (value.energy, value.time, value.switches)
    if isinstance(value, tuple):
        return " ".join(f"{each:g}" for each in value)
    return "own" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def check_options_have_effect(asked: PaperCase, given: Mapping[str, Any]) -> None:
    """Raise an error if an option was given that changes nothing.

    Whether an option has an effect depends on planner, weights and other options. For example, only
    the published search has a heuristic scale, and only a polynomial may exceed V_max.

    Args:
        asked: The combined request, with planner and weights.
        given: Value of each option by its name with underscores; None if it was left out.

    Raises:
        UsageError: The first option without effect; the sentence says why and what to give instead.
    """
    planner = get_planner(asked.planner)
    published = given.get("search") == "published"
    polynomial = (given.get("trajectory") or planner.trajectory) == "polynomial"
    able = {name: planners_using(name) for name in ("initial_j3", "search", "heuristic_scale")}
    other = {name: name not in planner.takes for name in able}
    does = f"the {planner.name} planner {planner.summary}"
    own_way = f"the {planner.name} planner searches in a way of its own"
    for name, idle, why, instead in (
        ("initial_j3", other["initial_j3"], does, f"--planner {able['initial_j3']}"),
        ("search", other["search"], own_way, f"--planner {able['search']}"),
        ("heuristic_scale", other["heuristic_scale"], own_way, f"--planner {able['search']}"),
        (
            "heuristic_scale",
            not published,
            "the exact search has no such scale",
            "--search published",
        ),
        (
            "max_speed_excess",
            not polynomial,
            "a motion that follows its path keeps V_max",
            "--trajectory polynomial",
        ),
        ("via_tolerance", not given.get("via"), "there is no point on the way", "--via X Z"),
        (
            "energy_reading",
            asked.weights.energy == 0.0,
            "energy has no weight",
            "--weights with one",
        ),
        (
            "area_weight",
            not planner.weighs_area and (given.get("area_weight") or 0.0) > 0.0,
            does,
            f"--planner {planners_weighing_area()}".replace("'", ""),
        ),
    ):
        value = given.get(name)
        if value is not None and idle:
            flag = f"--{name.replace('_', '-')} {_format_value(value)}"
            raise UsageError(f"{flag} has no effect: {why}; leave it out, or give {instead}")


def change_machine(machine: Machine, **changes: Any) -> Machine:
    """Return a machine with some values replaced.

    Args:
        machine: The arm as its file has it.
        **changes: Keyword arguments of `Machine.changed`; None keeps a value.

    Returns:
        The changed machine; `machine` stays as it is.

    Raises:
        UsageError: A value is out of its range.
    """
    try:
        return machine.changed(**changes)
    except MachineFileError as error:
        raise UsageError("; ".join(error.problems)) from error


def check_coordinates(machine: Machine, asked: PaperCase) -> None:
    """Raise an error if start or goal has the wrong number of coordinates for an arm.

    Args:
        machine: The arm; positions have x, y, z if it slews, else x, z.
        asked: The request with start and goal [m].

    Raises:
        UsageError: A position does not fit; the sentence names the coordinates to give.
    """
    for name, given in (("start", asked.start), ("goal", asked.goal)):
        if len(given) != len(machine.axes):
            wanted = " ".join(machine.axes).upper()
            does = "slews" if machine.slews else "does not slew"
            raise UsageError(
                f"--{name} {_format_value(given)}: {machine.name} {does}; give {wanted}"
            )


def range_of(name: str, given: Point | None, fixed: float | None) -> Range | None:
    """Return the range that an option asks for.

    Args:
        name: Name of the option without dashes; its range option is called NAME-range.
        given: Lowest and highest value in SI units; None if the range was left out.
        fixed: Value of the option without a range; None if it was left out.

    Returns:
        The range, or None if none was given.

    Raises:
        UsageError: Both were given, or the range is invalid.
    """
    if given is None:
        return None
    if fixed is not None:
        raise UsageError(f"give --{name} or --{name}-range, not both")
    try:
        return Range(*given)
    except RequestError as error:
        raise UsageError(f"--{name}-range: {error}") from error


def choose_goal_angle(exact: float | None, between: Point | None) -> Angle:
    """Return the end-link angle ψ that is asked for at the goal.

    Args:
        exact: One angle [rad], or None.
        between: Least and greatest angle [rad], or None.

    Returns:
        The angle or the pair of angles; None if the angle is free.

    Raises:
        UsageError: Both were given.
    """
    if exact is not None and between is not None:
        raise UsageError("give --goal-psi or --goal-psi-range, not both")
    return exact if between is None else between


def goal_region_of(
    goal: Position, tolerance: float | None, end: Point | None, box: Point | None
) -> Region | None:
    """Return the region around the goal in which the tip may end.

    Args:
        goal: Goal position (x, z) or (x, y, z) [m].
        tolerance: Radius of a disc around the goal [m], or None.
        end: Other end (x, z) of a segment that begins at the goal, in `base_link` [m], or None.
        box: Half widths (x, z) of a rectangle around the goal [m], or None.

    Returns:
        The region; None if the tip must end at the goal itself.

    Raises:
        UsageError: More than one was given, a size is invalid, or a segment was given for an arm
            that slews.
    """
    if end is not None and len(goal) > len(end):
        raise UsageError("--goal-segment: arms that slew know no such line; give --goal-box")
    segment = None if end is None else (end[0] - goal[0], end[-1] - goal[-1])
    try:
        return create_region(tolerance, segment, box)
    except RequestError as error:
        raise UsageError(str(error)) from error
