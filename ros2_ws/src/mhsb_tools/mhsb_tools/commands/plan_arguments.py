"""Options of `plan` and similar commands, and the requests that they ask for."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import tyro

from mhsb_model.command_line import NumberRange, OptionalFile, UsageError
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray, Position
from mhsb_planner.cases.paper_cases import PaperCase, get_paper_case
from mhsb_planner.errors import RequestError
from mhsb_planner.goal_region import MAX_REGION_SIZE, WIDEST_ANGLE, Angle, Region, create_region
from mhsb_planner.motion.s3_trajectory import TrajectoryKind
from mhsb_planner.planner import PlannerKind
from mhsb_planner.planners.options import (
    DEFAULT_PLANNER,
    ENERGY_OPTIMAL,
    HIGHEST_WEIGHT,
    PlanOptions,
)
from mhsb_planner.planners.registry import (
    get_planner,
    planner_summaries,
    planners_using,
    planners_weighing_area,
)
from mhsb_planner.search.s2_search import SearchMethod, Weights
from mhsb_planner.search.s2_step import EnergyReading
from mhsb_tools.machine_arguments import OptionalPayload, change_machine
from mhsb_tools.moves.operating_point import Point, Range

POSITION_RANGE, DISTANCE_RANGE = NumberRange(-1e4, 1e4, "m"), NumberRange(0.0, MAX_REGION_SIZE, "m")
ANGLE_RANGE = NumberRange(-WIDEST_ANGLE, WIDEST_ANGLE, "rad")
WEIGHT_RANGE = NumberRange(0.0, HIGHEST_WEIGHT)
PRESSURE_RANGE, SPEED_RANGE = NumberRange(1e5, 5e7, "Pa"), NumberRange(1e-4, 1.0, "m/s")
"""Ranges of the options: positions and distances [m], angles [rad], weights, supply pressure
P_S [Pa], piston speed V_max [m/s].
"""


OptionalPosition = Annotated[Position | None, tyro.conf.arg(metavar="X [Y] Z"), POSITION_RANGE]
"""Tip position (x, z), or (x, y, z) if the arm slews [m], or None."""


@dataclass(frozen=True)
class MoveArguments:
    """Options for start and goal of a motion and for points between them.

    Attributes:
        start: Tip position at the start [m].
        goal: Tip position at the goal [m].
        case: One of the paper's cases, such as 1-1; it sets start, goal, weights, planner and
            initial angle of joint 3. A value given beside it replaces the case's, and the output
            says so.
        start_posture: Joint positions at the start [rad], extensions of telescopes [m], in place of
            --start. They may be beyond the joint limits: the motion then leads back into them.
        via: Point that the tip passes on its way [m], with Y if the arm slews; may be given several
            times, in the order of passing.
        via_tolerance: Distance at which the tip may pass these points [m]; 0.01 when left out.
    """

    start: OptionalPosition = None
    goal: OptionalPosition = None
    case: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    start_posture: Annotated[
        tuple[float, ...] | None, tyro.conf.arg(metavar="Q1 Q2 Q3 ..."), ANGLE_RANGE
    ] = None
    via: Annotated[
        tuple[tuple[float, ...], ...],
        tyro.conf.arg(metavar="X [Y] Z"),
        tyro.conf.UseAppendAction,
        POSITION_RANGE,
    ] = ()
    via_tolerance: Annotated[float | None, tyro.conf.arg(metavar="M"), DISTANCE_RANGE] = None

    def find_start(self, machine: Machine) -> tuple[FloatArray | None, Position | None]:
        """Return the start posture and the start position of the tip, as far as they were given.

        Args:
            machine: The arm.

        Returns:
            Start posture, shape (n,) [rad, telescopes m]; None without `--start-posture`. Then the
            tip's position in `base_link`, (x, z) or (x, y, z) [m]. It follows from the start
            posture, or is the value of `--start`; None without both options.

        Raises:
            UsageError: The posture has a wrong number of values, or is given together with
                `--start` or `--case`.
        """
        if self.start_posture is None:
            return None, self.start
        for name in ("start", "case"):
            if getattr(self, name) is not None:
                raise UsageError(f"give --start-posture or --{name}, not both")
        if len(self.start_posture) != machine.joint_count:
            wanted = f"{machine.joint_count} joint positions, {', '.join(machine.joint_names)}"
            given = _format_value(self.start_posture) or "nothing"
            raise UsageError(f"--start-posture takes {wanted}, not {given}")
        q = np.array(self.start_posture, dtype=np.float64)
        return q, tuple(machine.tip_in_base(q).tolist())


@dataclass(frozen=True)
class GoalArguments:
    """Options for the end of a motion: angle of the end link, and where the tip may end.

    Attributes:
        goal_psi: Angle of the end link at the goal, from the horizontal, positive upwards [rad];
            free when left out.
        goal_psi_range: Least and greatest angle of the end link that are accepted [rad].
        goal_tolerance: Distance from the goal at which the tip may end as well [m]; without it, a
            segment or a box, the tip ends at the goal itself.
        goal_segment: Other end of a line that begins at the goal; the tip may end anywhere on it
            [m].
        goal_box: How far to either side of the goal, forward and up, the tip may end [m].
    """

    goal_psi: Annotated[float | None, tyro.conf.arg(metavar="RAD"), ANGLE_RANGE] = None
    goal_psi_range: Annotated[Point | None, tyro.conf.arg(metavar="LOW HIGH"), ANGLE_RANGE] = None
    goal_tolerance: Annotated[float | None, tyro.conf.arg(metavar="M"), DISTANCE_RANGE] = None
    goal_segment: Annotated[Point | None, tyro.conf.arg(metavar="X Z"), POSITION_RANGE] = None
    goal_box: Annotated[Point | None, tyro.conf.arg(metavar="DX DZ"), DISTANCE_RANGE] = None

    def choose_angle(self) -> Angle:
        """Return the end-link angle ψ at the goal that the options set.

        Returns:
            `goal_psi`, or the pair `goal_psi_range` (least, greatest), in rad as the user gave it.
            None if neither option was given: ψ is free.

        Raises:
            UsageError: Both an angle and a range were given.
        """
        if self.goal_psi is not None and self.goal_psi_range is not None:
            raise UsageError("give --goal-psi or --goal-psi-range, not both")
        return self.goal_psi if self.goal_psi_range is None else self.goal_psi_range

    def create_region(self, goal: Position) -> Region | None:
        """Return the goal region (places at which the tip may end) that the options ask for.

        Args:
            goal: Goal position (x, z), or (x, y, z) if the arm slews [m].

        Returns:
            The region, relative to the goal. None if no region was given, so that the tip must end
            at the goal itself.

        Raises:
            UsageError: More than one region was given, a size is invalid, or a segment was given
                for an arm that slews.
        """
        end = self.goal_segment
        if end is not None and len(goal) > len(end):
            raise UsageError("--goal-segment: arms that slew know no such line; give --goal-box")
        segment = None if end is None else (end[0] - goal[0], end[-1] - goal[-1])
        try:
            return create_region(self.goal_tolerance, segment, self.goal_box)
        except RequestError as error:
            raise UsageError(str(error)) from error


@dataclass(frozen=True)
class ArmArguments:
    """Options for the arm that a motion is planned for.

    Attributes:
        machine: Machine file (YAML); the suite's own arm when left out.
        table: Posture table (npz); built and kept in the user's cache when left out.
        payload: Mass at the tip [kg]; the machine file's when left out.
        supply_pressure: Pressure of the main pump [Pa]; the machine file's when left out.
        v_max: Piston speed for which plans are made, V_max [m/s]; the machine file's when left out.
            Actuators whose own limit is lower keep that.
        supply_pressure_range: Choose the constant supply pressure in this range with which the
            motion costs least [Pa]; with --json the examined points are printed, too.
        v_max_range: Choose the piston speed in this range with which the motion costs least [m/s].
    """

    machine: OptionalFile = None
    table: OptionalFile = None
    payload: OptionalPayload = None
    supply_pressure: Annotated[float | None, tyro.conf.arg(metavar="PA"), PRESSURE_RANGE] = None
    v_max: Annotated[float | None, tyro.conf.arg(metavar="M_S"), SPEED_RANGE] = None
    supply_pressure_range: Annotated[
        Point | None, tyro.conf.arg(metavar="LOW HIGH"), PRESSURE_RANGE
    ] = None
    v_max_range: Annotated[Point | None, tyro.conf.arg(metavar="LOW HIGH"), SPEED_RANGE] = None

    def change(self, machine: Machine) -> Machine:
        """Return the machine with the given payload, supply pressure and V_max.

        V_max is the piston speed for which plans are made.

        Options that were not given keep the machine's value.

        Args:
            machine: The arm as its file has it; not changed.

        Raises:
            UsageError: A value is out of its range.
        """
        return change_machine(
            machine,
            payload=self.payload,
            supply_pressure=self.supply_pressure,
            max_piston_speed=self.v_max,
        )

    def collect_ranges(self) -> tuple[Range | None, Range | None]:
        """Return the ranges in which supply pressure and V_max are to be chosen.

        Returns:
            Range of the supply pressure [Pa] and range of V_max, the piston speed for planning
            [m/s]. Each is None if its option was not given.

        Raises:
            UsageError: A single value was given together with its range, or a range is invalid.
        """
        return (
            _range_of("supply-pressure", self.supply_pressure_range, self.supply_pressure),
            _range_of("v-max", self.v_max_range, self.v_max),
        )


def _range_of(name: str, given: Point | None, fixed: float | None) -> Range | None:
    """Return the range that the option `--NAME-range` was given.

    Args:
        name: NAME, such as `v-max`; for error messages.
        given: Lowest and highest value in SI units; None if `--NAME-range` was left out.
        fixed: Value of the option `--NAME`; None if the option was not given.

    Returns:
        The range; None if `--NAME-range` was left out.

    Raises:
        UsageError: Both options were given, or the range is invalid.
    """
    if given is None:
        return None
    if fixed is not None:
        raise UsageError(f"give --{name} or --{name}-range, not both")
    try:
        return Range(*given)
    except RequestError as error:
        raise UsageError(f"--{name}-range: {error}") from error


@dataclass(frozen=True)
class PlannerArguments:
    """Options for the planner: what counts, where postures come from, how it searches.

    Attributes:
        weights: Weights of energy [1/J], time [1/s] and mode switches. When left out, the case's;
            without a case, 0.5 0 2.
        area_weight: Weight of the velocity polytope's area that is lost along the tip's path, for
            the integrated planner [1/m]; the area does not count when left out.
        planner: Method that chooses postures and path; that of the case when left out, else
            integrated.
        initial_j3: Angle of joint 3 that the fixed planner keeps [rad]; that of the posture table
            at the start when left out.
        search: Graph search of the planners table and fixed: exact, or as published with one label
            for each node; exact when left out.
        heuristic_scale: Scale of the published search's heuristic, cost per distance from the goal
            [1/m]; 1 when left out.
        trajectory: How the trajectory is made: a polynomial as published, or the discrete path
            followed. When left out, followed for the integrated planner. For the others a
            polynomial, or followed if V_max makes that cheaper.
        max_speed_excess: Share by which pistons may exceed V_max on a polynomial, which is
            stretched in time until they do not exceed it further; 0.1 when left out.
        energy_reading: Price of boosted oil that the search minimises. paper: load pressure over
            efficiency; series: main pump and servo pump in series, as simulated. paper when left
            out.
    """

    weights: Annotated[
        tuple[float, float, float] | None, tyro.conf.arg(metavar="W1 W2 W3"), WEIGHT_RANGE
    ] = None
    area_weight: Annotated[float | None, tyro.conf.arg(metavar="W4"), WEIGHT_RANGE] = None
    planner: Annotated[
        PlannerKind | None,
        tyro.conf.arg(
            help=f"Where postures come from: {planner_summaries()}. "
            f"When left out, the case's; without a case, {DEFAULT_PLANNER}."
        ),
    ] = None
    initial_j3: Annotated[float | None, tyro.conf.arg(metavar="RAD"), ANGLE_RANGE] = None
    search: SearchMethod | None = None
    heuristic_scale: Annotated[
        float | None, tyro.conf.arg(metavar="PER_M"), NumberRange(0.0, 1e6)
    ] = None
    trajectory: TrajectoryKind | None = None
    max_speed_excess: Annotated[
        float | None, tyro.conf.arg(metavar="SHARE"), NumberRange(0.0, 1.0)
    ] = None
    energy_reading: EnergyReading | None = None


def build_options(
    asked: PaperCase, move: MoveArguments, goal: GoalArguments, planning: PlannerArguments
) -> PlanOptions:
    """Combine all options of a plan; check first that each given option has an effect.

    Args:
        asked: The request: start, goal, weights and planner. Its weights are used, not those of
            `planning`.
        move: Via points (points to pass on the way) and how near the tip must pass them.
        goal: Angle of the end link and goal region (places at which the tip may end).
        planning: Planner and search; a value of None keeps the request's or the default value.

    Returns:
        The options of the plan.

    Raises:
        UsageError: An option has no effect, or options exclude each other.
        RequestError: A value is out of range.
    """
    given = {**vars(planning), "via": move.via, "via_tolerance": move.via_tolerance}
    check_options_have_effect(asked, given)
    del given["weights"]  # those of `asked` are complete
    return replace(
        asked.options,
        goal_psi=goal.choose_angle(),
        goal_region=goal.create_region(asked.goal),
        **{name: value for name, value in given.items() if value is not None},
    )


def build_request(
    start: Position | None,
    goal: Position | None,
    case: str | None,
    weights: tuple[float, float, float] | None = None,
    planner: str | None = None,
    initial_j3: float | None = None,
) -> PaperCase:
    """Combine start, goal and planner settings to a request.

    If a case of the paper is named, the request is based on it. A value that is not None then
    replaces the case's value.

    Args:
        start: Tip position at the start (x, z) or (x, y, z) [m]; None takes the case's.
        goal: Tip position at the goal [m]; None takes the case's.
        case: Name of a case, such as `1-1`; None: no case, and then start and goal are needed.
        weights: Weights of energy [1/J], time [1/s] and mode switches. None takes the case's, or
            without a case those for least energy.
        planner: Name of the planner; None takes the case's, or DEFAULT_PLANNER without a case.
        initial_j3: Angle of joint 3 that the planner `fixed` keeps [rad]. None takes the case's
            angle; without a case, the planner takes the angle from the posture table at the start.

    Returns:
        The request; its name is empty if no case was named.

    Raises:
        UsageError: Start or goal is missing or has a wrong number of coordinates, or a weight is
            invalid.
        RequestError: The paper has no case of this name.
    """
    named = get_paper_case(case) if case is not None else None
    start = start or (named.start if named else None)
    goal = goal or (named.goal if named else None)
    for name, given in (("start", start), ("goal", goal)):
        if given is not None and len(given) not in (2, 3):
            wanted = "X Z, or X Y Z where the arm slews"
            raise UsageError(f"--{name} takes {wanted}, not {_format_value(given)}")
    if start is None or goal is None:
        raise UsageError("give --start X Z and --goal X Z, or --case NAME")
    base = named or PaperCase("", start, goal, ENERGY_OPTIMAL, DEFAULT_PLANNER)
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


def list_replaced_values(asked: PaperCase) -> list[str]:
    """List the values of a request that differ from the values of its case.

    Args:
        asked: The request. Its name is the name of the case on which it is based; empty if there is
            none.

    Returns:
        Phrases such as `--goal 0.6 0.1 in place of its 0.55 0.6`, where `its` refers to the case.
        There is one for each of start, goal, weights, planner and angle of joint 3 that
        differs from the case. Empty if the request is based on no case.

    Raises:
        RequestError: The paper has no case of this name.
    """
    if not asked.name:
        return []
    case, replaced = get_paper_case(asked.name), []
    for name in ("start", "goal", "weights", "planner", "initial_j3"):
        own, given = getattr(case, name), getattr(asked, name)
        if own != given:
            flag = name.replace("_", "-")
            replaced.append(f"--{flag} {_format_value(given)} in place of its {_format_value(own)}")
    return replaced


def format_case_line(asked: PaperCase) -> list[str]:
    """Return a line that says how a request differs from the paper's case on which it is based.

    Args:
        asked: The request. Its name is that of the case on which it is based; empty if there is
            none.

    Returns:
        A list with one line, or an empty list if nothing differs or the request is based on no
        case.
    """
    replaced = list_replaced_values(asked)
    return [f"Case {asked.name}, but with {', '.join(replaced)}"] if replaced else []


def format_case_title(asked: PaperCase) -> str:
    """Return the part of a picture's title that names the case, such as `Case 1-1, changed: `.

    "changed" says that start, goal, weights or angle of joint 3 differ from the case. A different
    planner does not count.

    Args:
        asked: The request. Its name is that of the case on which it is based; empty if there is
            none.

    Returns:
        The text with a colon and a space at its end, or an empty string if the request is based on
        no case.
    """
    changed = any(not each.startswith("--planner") for each in list_replaced_values(asked))
    return f"Case {asked.name}{', changed' if changed else ''}: " if asked.name else ""


def _format_value(value: object) -> str:
    """Format a value as it is written on the command line.

    Args:
        value: Weights, a tuple of numbers, a number, a string, or None.

    Returns:
        Numbers separated by spaces. None gives the word `own`, which stands for the value that the
        planner chooses itself.
    """
    if isinstance(value, Weights):
        value = (value.energy, value.time, value.switches)
    if isinstance(value, tuple):
        return " ".join(f"{each:g}" for each in value)
    return "own" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def check_options_have_effect(asked: PaperCase, given: Mapping[str, Any]) -> None:
    """Raise an error if an option was given that changes nothing in this request.

    Each of these options has a condition:

    - `initial_j3`, `search`, `heuristic_scale`: the planner takes the option
    - `heuristic_scale`: the search is `published`
    - `max_speed_excess`: the option `trajectory` asks for a polynomial; without it, the
      planner's default does
    - `via_tolerance`: there is a via point
    - `energy_reading`: the weight of energy is not 0
    - `area_weight` above 0: the planner weighs the area of the velocity polytope

    Args:
        asked: The request; its planner and its weights are read.
        given: Value of each option, by its name with underscores; None if the option was not given.
            Options without a condition are ignored.

    Raises:
        UsageError: An option has no effect. The message names the first such option, says why, and
            what to give instead.
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


def check_coordinates(machine: Machine, asked: PaperCase) -> None:
    """Raise an error if start or goal has the wrong number of coordinates for an arm.

    Args:
        machine: The arm; positions have x, y, z if it slews, else x, z.
        asked: The request with start and goal [m].

    Raises:
        UsageError: Start or goal has the wrong number of coordinates; the message says which ones
            to give.
    """
    for name, given in (("start", asked.start), ("goal", asked.goal)):
        if len(given) != len(machine.axes):
            wanted = " ".join(machine.axes).upper()
            does = "slews" if machine.slews else "does not slew"
            raise UsageError(
                f"--{name} {_format_value(given)}: {machine.name} {does}; give {wanted}"
            )
