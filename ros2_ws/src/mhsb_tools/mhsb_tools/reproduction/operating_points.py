"""Best supply pressure and V_max for Case 5, found by search; beyond the paper."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from mhsb_model.figure_style import BLACK, BLUE, ORANGE, Axes, legend_above, open_figure
from mhsb_model.trajectory import MotionState
from mhsb_planner.cases.paper_cases import get_paper_case
from mhsb_planner.planner import Planner
from mhsb_planner.result_files import write_rows
from mhsb_tools.moves.operating_point import (
    OperatingPoint,
    OperatingPointResult,
    Range,
    find_best_operating_point,
)
from mhsb_tools.reproduction.expectations import PUBLISHED_ENERGY
from mhsb_tools.reproduction.fits import FittedRuns
from mhsb_tools.reproduction.runs import (
    PISTON_SPEEDS,
    SUPPLY_PRESSURES,
    Runs,
    pressure_run,
)

COMPARED_PLANNERS = ("table", "integrated")
PLANNER_COLORS = {"table": ORANGE, "integrated": BLUE}
PER_MEGA, PER_MILLI = 1e6, 1e-3


@dataclass(frozen=True, eq=False)
class BestPoint:
    """Best operating point of a case's move for one of the planners.

    Attributes:
        case: Name of the case.
        varied: Quantity that was chosen, `ps` (P_S) or `vmax` (V_max).
        planner: Name of the planner.
        point: The best point and all examined points.
    """

    case: str
    varied: str
    planner: str
    point: OperatingPoint


def find_points(runs: Runs) -> dict[str, BestPoint]:
    """Search the best supply pressure for Case 1-1 and the best V_max for Case 1-2.

    The cases are moves of the paper. V_max is the piston speed for planning. The best value is the
    one with which the motion costs least, by the weights of the case. Each search is made with the
    planners `table` and `integrated`. Its range goes from the first to the last value of the
    paper's sweep.

    Args:
        runs: All runs of the machine; only its machine and posture table are used.

    Returns:
        Four best points by name. A name such as `c5.ps best table` consists of `c5`, the quantity
        (`ps` for supply pressure or `vmax`) and the planner. `c5` stands for Case 5, in which the
        paper varies one quantity of the cases above.

    Raises:
        NoOperatingPointError: No point of a range has a plan.
    """
    found = {}
    for case_name, varied, pressures, speeds in (
        ("1-1", "ps", Range(SUPPLY_PRESSURES[0], SUPPLY_PRESSURES[-1]), None),
        ("1-2", "vmax", None, Range(PISTON_SPEEDS[0], PISTON_SPEEDS[-1])),
    ):
        case = get_paper_case(case_name)
        start = MotionState.at_rest(case.start_posture(runs.machine))
        for kind in COMPARED_PLANNERS:
            planner = Planner(runs.machine, runs.table)
            options = replace(case.options, planner=kind)
            point = find_best_operating_point(planner, case.goal, start, options, pressures, speeds)
            found[f"c5.{varied} best {kind}"] = BestPoint(case_name, varied, kind, point)
    return found


def as_text(points: Mapping[str, BestPoint]) -> list[str]:
    """Return a line for each best point.

    It states P_S [MPa], V_max [mm/s], energy [J], duration [s] and number of mode switches.
    """
    return [
        f"{name}: {found.point.best.supply_pressure / PER_MEGA:.3f} MPa, "
        f"{found.point.best.v_max / PER_MILLI:.2f} mm/s: {found.point.best.energy:.0f} J, "
        f"{found.point.best.duration:.2f} s, {found.point.best.switches} switches"
        for name, found in points.items()
    ]


def draw_points(fits: FittedRuns, points: Mapping[str, BestPoint], place: Path) -> None:
    """Draw energy over supply pressure (Case 1-1) and cost over V_max (Case 1-2).

    V_max is the piston speed for planning. All examined points are drawn. The left panel also has
    the published energies and this suite's energies of the same runs. Writes a PNG, and a CSV file
    with a row for each examined point.

    Args:
        fits: Trajectories that were made for some of the runs. The energies of the sweep over
            supply pressure are drawn.
        points: Best operating points by name.
        place: Path of the files without suffix; its folder must exist.
    """
    with open_figure(place.with_suffix(".png"), 4.6) as figure:
        pressure, speed = figure.subplots(1, 2)
        for found in points.values():
            _draw_curve(found, pressure if found.varied == "ps" else speed)
        _draw_published(fits, pressure)
        pressure.set(
            xlabel="supply pressure [MPa]", ylabel="energy of the motion [J]", title="Case 1-1"
        )
        speed.set(
            xlabel="V_max [mm/s]", ylabel="15 T + 2 switches of the motion [-]", title="Case 1-2"
        )
        legend_above(figure, pressure, speed)
    header = (
        *("run", "supply_pressure_pa", "v_max_m_s", "energy_j", "energy_series_j", "duration_s"),
        *("switches", "cost", "failure"),
    )
    rows = [
        (name, *asdict(sample).values())
        for name, found in points.items()
        for sample in found.point.curve
    ]
    write_rows(place.with_suffix(".csv"), header, rows)


def _draw_curve(found: BestPoint, axes: Axes) -> None:
    """Draw all points that one search for an operating point has examined.

    Points without a plan are left out. A star marks the best point.

    Args:
        found: Result of the search. If `found.varied` is `ps`, x is the supply pressure [MPa] and y
            the energy [J]. If it is `vmax`, x is V_max (piston speed for planning) [mm/s] and y the
            cost.
        axes: Axes to draw on. Their labels are not set.
    """

    def coordinates(sample: OperatingPointResult) -> tuple[float, float]:
        """Return the place of an examined point in the diagram.

        Uses `found`, the result of the search, from the enclosing function.

        Args:
            sample: The examined point.

        Returns:
            Supply pressure [MPa] and energy [J] if `found.varied` is `ps`, else V_max (piston speed
            for planning) [mm/s] and cost.
        """
        if found.varied == "ps":
            return sample.supply_pressure / PER_MEGA, sample.energy
        return sample.v_max / PER_MILLI, sample.cost

    color = PLANNER_COLORS[found.planner]
    planned = [coordinates(sample) for sample in found.point.curve if not sample.failure]
    axes.plot(*zip(*planned, strict=True), color=color, marker=".", label=found.planner)
    axes.plot(*coordinates(found.point.best), color=color, marker="*", markersize=14, linestyle="")


def _draw_published(fits: FittedRuns, axes: Axes) -> None:
    """Draw published and own energies over supply pressure P_S.

    Args:
        fits: Trajectories that the suite has made for runs of the paper. Drawn are the runs with a
            P_S of `SUPPLY_PRESSURES`, each with the posture table built for this P_S. A run without
            a trajectory has a published point only.
        axes: Axes to draw on: P_S [MPa] as x, energy [J] as y. Labels of the axes are not set.
    """
    joules = dict(PUBLISHED_ENERGY.values())
    published = [
        (pressure / PER_MEGA, joules[pressure_run(pressure)]) for pressure in SUPPLY_PRESSURES
    ]
    axes.scatter(*zip(*published, strict=True), color=BLACK, marker="x", label="published")
    own = [
        (pressure / PER_MEGA, fits.by_run[pressure_run(pressure)].energy.paper)
        for pressure in SUPPLY_PRESSURES
        if pressure_run(pressure) in fits.by_run
    ]
    if own:
        label = "table built for that pressure"
        axes.scatter(*zip(*own, strict=True), color=ORANGE, facecolor="none", label=label)
