"""What the arguments of `plan`, and of commands like it, ask for; UsageError where they clash."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mhsb_model.command_line import UsageError
from mhsb_model.errors import MachineFileError
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, Position
from mhsb_planner.errors import RequestError
from mhsb_planner.evaluation.operating_point import Range
from mhsb_planner.evaluation.paper_cases import PaperCase, paper_case
from mhsb_planner.goal_region import Angle, Region, region_of
from mhsb_planner.planners.options import ENERGY_OPTIMAL
from mhsb_planner.planners.registry import planner_named, taking, weighing_area
from mhsb_planner.search.s2_search import Weights

Point = tuple[float, float]


def request(
    start: Position | None,
    goal: Position | None,
    case: str | None,
    weights: tuple[float, float, float] | None = None,
    planner: str | None = None,
    initial_j3: float | None = None,
) -> PaperCase:
    """What is asked for: the case where one is named, with what is given itself in its place."""
    named = paper_case(case) if case is not None else None
    start = start or (named.start if named else None)
    goal = goal or (named.goal if named else None)
    for name, given in (("start", start), ("goal", goal)):
        if given is not None and len(given) not in (2, 3):
            wanted = "X Z, or X Y Z where the arm slews"
            raise UsageError(f"--{name} takes {wanted}, not {_words(given)}")
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


def start_in_posture(
    machine: Machine, posture: Position, given: Mapping[str, Any]
) -> tuple[FloatArray, Position]:
    """Return a start posture [rad or m] and where the tip is in it [m].

    Args:
        machine: The arm.
        posture: Position of each joint, within its limits or not.
        given: Other options that say where the motion starts, by name; None where left out.

    Raises:
        UsageError: The numbers are not as many as the joints, or another option is given as well.
    """
    for name, value in given.items():
        if value is not None:
            flag = f"--{name.replace('_', '-')}"
            raise UsageError(f"give --start-posture or {flag}, not both")
    if len(posture) != machine.joint_count:
        wanted = f"{machine.joint_count} joint positions, {', '.join(machine.joint_names)}"
        raise UsageError(f"--start-posture takes {wanted}, not {_words(posture) or 'nothing'}")
    q = np.array(posture, dtype=np.float64)
    return q, tuple(machine.tip_in_base(q).tolist())


def replaced(asked: PaperCase) -> list[str]:
    """What of the named case something else was given for, in words; nothing without a case."""
    if not asked.name:
        return []
    case, said = paper_case(asked.name), []
    for name in ("start", "goal", "weights", "planner", "initial_j3"):
        own, given = getattr(case, name), getattr(asked, name)
        if own != given:
            flag = name.replace("_", "-")
            said.append(f"--{flag} {_words(given)} in place of its {_words(own)}")
    return said


def case_line(asked: PaperCase) -> list[str]:
    """The same as a sentence, where there is anything to say."""
    said = replaced(asked)
    return [f"Case {asked.name}, but with {', '.join(said)}"] if said else []


def case_title(asked: PaperCase) -> str:
    """How a picture of it begins, which tells the planner anyway; empty without a case."""
    changed = any(not each.startswith("--planner") for each in replaced(asked))
    return f"Case {asked.name}{', changed' if changed else ''}: " if asked.name else ""


def _words(value: object) -> str:
    """A value as it stands on the command line."""
    if isinstance(value, Weights):
        value = (value.energy, value.time, value.switches)
    if isinstance(value, tuple):
        return " ".join(f"{each:g}" for each in value)
    return "own" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def refuse_idle(asked: PaperCase, given: Mapping[str, Any]) -> None:
    """Raise UsageError where an option that was given changes nothing.

    given  options by name; None where they were left out
    """
    planner = planner_named(asked.planner)
    published = given.get("search") == "published"
    polynomial = (given.get("trajectory") or planner.trajectory) == "polynomial"
    able = {name: taking(name) for name in ("initial_j3", "search", "heuristic_scale")}
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
            f"--planner {weighing_area()}".replace("'", ""),
        ),
    ):
        value = given.get(name)
        if value is not None and idle:
            flag = f"--{name.replace('_', '-')} {_words(value)}"
            raise UsageError(f"{flag} has no effect: {why}; leave it out, or give {instead}")


def as_asked(machine: Machine, **changes: Any) -> Machine:
    """`Machine.changed` by values of arguments; UsageError where they are out of range."""
    try:
        return machine.changed(**changes)
    except MachineFileError as error:
        raise UsageError("; ".join(error.problems)) from error


def refuse_elsewhere(machine: Machine, asked: PaperCase) -> None:
    """Raise UsageError where start or goal are not given as the arm's positions are."""
    for name, given in (("start", asked.start), ("goal", asked.goal)):
        if len(given) != len(machine.axes):
            wanted = " ".join(machine.axes).upper()
            does = "slews" if machine.slews else "does not slew"
            raise UsageError(f"--{name} {_words(given)}: {machine.name} {does}; give {wanted}")


def range_of(name: str, given: Point | None, fixed: float | None) -> Range | None:
    """The range of an option, which must not be given with a fixed value."""
    if given is None:
        return None
    if fixed is not None:
        raise UsageError(f"give --{name} or --{name}-range, not both")
    try:
        return Range(*given)
    except RequestError as error:
        raise UsageError(f"--{name}-range: {error}") from error


def angle_of(exact: float | None, between: Point | None) -> Angle:
    """The end link's angle asked for, one or a range of them."""
    if exact is not None and between is not None:
        raise UsageError("give --goal-psi or --goal-psi-range, not both")
    return exact if between is None else between


def goal_region_of(
    goal: Position, tolerance: float | None, end: Point | None, box: Point | None
) -> Region | None:
    """Where else than at the goal the tip may end."""
    if end is not None and len(goal) > len(end):
        raise UsageError("--goal-segment: arms that slew know no such line; give --goal-box")
    segment = None if end is None else (end[0] - goal[0], end[-1] - goal[-1])
    try:
        return region_of(tolerance, segment, box)
    except RequestError as error:
        raise UsageError(str(error)) from error
