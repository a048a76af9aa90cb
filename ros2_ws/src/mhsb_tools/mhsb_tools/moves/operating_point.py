"""Search for the constant supply pressure P_S and speed limit V_max that serve one move best.

Each of the two is chosen from a range, or kept. An operating point is a pair of P_S and V_max. The
move is planned at evenly sampled points, then around the cheapest of these in smaller and smaller
strides. The cost jumps when modes change, so nothing is fitted or interpolated: the best point is
the cheapest of all at which a plan was made. The cost of a point is w₁ E + w₂ T + w₃ switches
(+ w₄ M) of its motion, with energy E, duration T and lost polytope area M.

    found = find_best_operating_point(planner, goal, start, supply_pressure=Range(2.5e6, 10e6))
    found.best.supply_pressure, found.plan
"""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState
from mhsb_model.types import Position
from mhsb_planner.errors import RequestError
from mhsb_planner.planner import Plan, Planner, PlanOptions

RANGE_SAMPLES = {1: 25, 2: 9}
"""Number of samples along each range, if one or two ranges are given."""

REFINEMENT_STARTS = 3
"""Number of local minima among the samples from which the refinement starts, cheapest first."""

STRIDE_HALVINGS = 5
"""Number of times that the stride is halved; it begins with half the samples' spacing."""

MAX_REFINEMENT_MOVES = 4
"""Largest number of moves of the refinement with one stride."""

Point = tuple[float, float]


@dataclass(frozen=True)
class Range:
    """Range of values that may be chosen, in SI units; finite and above 0.

    Attributes:
        low: Lowest value.
        high: Highest value, at least the lowest.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        """Raise RequestError if an end is not finite or not above 0, or `low` is above `high`."""
        if not 0.0 < self.low <= self.high < math.inf:
            rule = "must be two finite numbers above 0, the lower one first"
            raise RequestError("range", f"{self.low:g} … {self.high:g}", rule)

    def sample(self, count: int) -> list[float]:
        """Return evenly spaced values over the range, both ends included.

        Args:
            count: Number of values, at least 2. If both ends are equal, `count` has no effect.

        Returns:
            `count` values, or only one if both ends are equal.
        """
        values: list[float] = np.linspace(self.low, self.high, count).tolist()
        return values if self.low < self.high else [self.low]

    def clip(self, value: float) -> float:
        """Return the value in the range that is nearest to the given one."""
        return min(self.high, max(self.low, value))


@dataclass(frozen=True)
class OperatingPointResult:
    """An operating point, with energy, duration, switches and cost of the move planned there.

    Attributes:
        supply_pressure: P_S [Pa].
        v_max: V_max [m/s].
        energy: Energy of the motion, reading `paper` [J]; infinity without a plan.
        energy_series: Energy of the motion, reading `series` [J]; infinity without a plan.
        duration: Duration of the motion [s]; infinity without a plan.
        switches: Number of mode switches of the motion.
        cost: w₁ E + w₂ T + w₃ switches + w₄ M of the motion; infinity without a plan.
        failure: Why there is no plan, in one sentence; empty if there is one.
    """

    supply_pressure: float
    v_max: float
    energy: float = math.inf
    energy_series: float = math.inf
    duration: float = math.inf
    switches: int = 0
    cost: float = math.inf
    failure: str = ""


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """The best operating point of a move.

    Attributes:
        best: The best point, with energy, duration and cost of the move.
        plan: The plan at this point.
        machine: The machine with P_S and V_max of this point.
        curve: All examined points, by increasing P_S, then V_max.
    """

    best: OperatingPointResult
    plan: Plan
    machine: Machine
    curve: tuple[OperatingPointResult, ...]


class NoOperatingPointError(MhsbError):
    """No examined point has a plan."""


def find_best_operating_point(
    planner: Planner,
    goal: Position,
    start: MotionState,
    options: PlanOptions | None = None,
    supply_pressure: Range | None = None,
    v_max: Range | None = None,
    *,
    on_sample: Callable[[OperatingPointResult], None] | None = None,
) -> OperatingPoint:
    """Plan a move from rest at the supply pressure and V_max of least cost.

    P_S is the main pump's constant pressure, V_max the piston speed for which plans are made. One
    or both are chosen from a range; a quantity without a range keeps the value of the planner's
    machine. The move is planned at evenly spaced samples, and then around the cheapest ones. The
    machine's own P_S and V_max are tried as well if they are within the ranges.

    Afterwards the planner has the best point's machine. If an error is raised, it may have the
    machine of any point. It keeps its posture table throughout.

    Args:
        planner: The planner; its machine is changed.
        goal: Goal in `base_link` [m].
        start: Start state, at rest.
        options: Options of the plans; None takes the defaults.
        supply_pressure: Range of P_S [Pa]; None keeps P_S.
        v_max: Range of V_max [m/s]; None keeps V_max.
        on_sample: Function that is called with each point after the move was planned there; None
            calls nothing.

    Returns:
        The best point, its plan, its machine, and all points that were tried.

    Raises:
        NoOperatingPointError: There is no plan at any of the points.
        MachineFileError: An end of a range is beyond what a machine may have.
        RequestError: No range was given.
    """
    if supply_pressure is None and v_max is None:
        raise RequestError("range", "none", "of supply pressure, V_max or both must be given")
    config = planner.machine.config
    own = config.hydraulics.main_pump.pressure, config.motion.max_piston_speed
    ranges = supply_pressure or Range(own[0], own[0]), v_max or Range(own[1], own[1])
    search = _Search(planner, goal, start, options or PlanOptions(), ranges, on_sample)
    for ends in zip((ranges[0].low, ranges[0].high), (ranges[1].low, ranges[1].high), strict=True):
        search.machine_at(ends)
    search.look_around(own)
    return search.found()


class _Search:
    """Search over operating points that plans at each point only once."""

    def __init__(
        self,
        planner: Planner,
        goal: Position,
        start: MotionState,
        options: PlanOptions,
        ranges: tuple[Range, Range],
        on_sample: Callable[[OperatingPointResult], None] | None,
    ) -> None:
        """Store what the search needs; no point is tried yet.

        Args:
            planner: The planner; the search changes its machine at each point.
            goal: Goal in `base_link` [m].
            start: Start state, at rest.
            options: Options of the plans.
            ranges: Range of the supply pressure P_S [Pa], and range of V_max (piston speed for
                planning) [m/s].
            on_sample: Function that is called with each point after the move was planned there, or
                None.
        """
        self._planner, self._own = planner, planner.machine
        self._goal, self._start, self._options = goal, start, options
        self._ranges, self._on_sample = ranges, on_sample
        self._samples: dict[Point, OperatingPointResult] = {}

    def machine_at(self, point: Point) -> Machine:
        """Return the machine with P_S [Pa] and V_max [m/s] of a point.

        Raises:
            MachineFileError: These values are not allowed for the machine.
        """
        return self._own.changed(supply_pressure=point[0], max_piston_speed=point[1])

    def cost(self, point: Point) -> float:
        """Return the cost of the move at a point, and plan there if that was not done before.

        A new point is stored, and `on_sample` is called with it. Planning changes the planner's
        machine.

        Args:
            point: Supply pressure P_S [Pa], and piston speed for planning V_max [m/s].

        Returns:
            The cost; infinity if no plan was found.
        """
        if point not in self._samples:
            try:
                sample = self._sample(point, self._plan(point))
            except MhsbError as error:
                sample = OperatingPointResult(*point, failure=str(error))
            self._samples[point] = sample
            if self._on_sample is not None:
                self._on_sample(sample)
        return self._samples[point].cost

    def _plan(self, point: Point) -> Plan:
        self._planner.change_machine(self.machine_at(point))
        return self._planner.plan(self._goal, self._start, options=self._options)

    def _sample(self, point: Point, plan: Plan) -> OperatingPointResult:
        """Collect energy, duration, switches and cost of the move planned at a point.

        Args:
            point: P_S [Pa] and V_max [m/s].
            plan: The plan made there.

        Returns:
            Energy, duration, switches and cost of the motion.
        """
        return OperatingPointResult(
            *point,
            energy=plan.energy.paper,
            energy_series=plan.energy.series,
            duration=plan.duration,
            switches=plan.motion.schedule.switch_count,
            cost=plan.cost(self._options),
        )

    def look_around(self, own: Point) -> None:
        """Plan at all samples of the ranges, then refine around the cheapest local minima.

        A local minimum is a sample without a cheaper neighbour among up to eight on the grid. The
        machine's own point is added to the local minima if it is within the ranges. The refinement
        starts from each of the `REFINEMENT_STARTS` cheapest of these points.

        Args:
            own: Supply pressure P_S [Pa] and V_max (piston speed for planning) [m/s] of the
                planner's machine.
        """
        free = sum(each.low < each.high for each in self._ranges)
        axes = [each.sample(RANGE_SAMPLES[max(1, free)]) for each in self._ranges]
        cost = {
            at: self.cost((axes[0][at[0]], axes[1][at[1]]))
            for at in itertools.product(range(len(axes[0])), range(len(axes[1])))
        }
        minima = [at for at in cost if cost[at] <= min(cost.get(n, math.inf) for n in _around(at))]
        starts = [(axes[0][i], axes[1][k]) for i, k in sorted(minima, key=cost.__getitem__)]
        if all(each.clip(value) == value for each, value in zip(self._ranges, own, strict=True)):
            starts = sorted([own, *starts], key=self.cost)
        spacing = tuple(axis[1] - axis[0] if len(axis) > 1 else 0.0 for axis in axes)
        for start in starts[:REFINEMENT_STARTS]:
            self._refine(start, (0.5 * spacing[0], 0.5 * spacing[1]))

    def _refine(self, point: Point, stride: Point) -> None:
        """Improve a point by compass search; new points are stored.

        In each step, the cost of the eight neighbours at a distance of one stride is computed. If
        the cheapest of them is cheaper than the point, the search moves there. The stride is halved
        if none is cheaper, or after `MAX_REFINEMENT_MOVES` moves with the same stride. The search
        ends when the stride would have to be halved more than `STRIDE_HALVINGS` times. It ends at
        once if there is no plan at the point.

        Args:
            point: Supply pressure P_S [Pa] and V_max (piston speed for planning) [m/s] to begin
                with.
            stride: First stride in P_S [Pa] and in V_max [m/s].
        """
        moves = halvings = 0
        while math.isfinite(self.cost(point)) and halvings <= STRIDE_HALVINGS:
            best = min(self._neighbors(point, stride), key=self.cost, default=point)
            if self.cost(best) < self.cost(point) and moves < MAX_REFINEMENT_MOVES:
                point, moves = best, moves + 1
            else:
                stride, moves, halvings = (0.5 * stride[0], 0.5 * stride[1]), 0, halvings + 1

    def _neighbors(self, point: Point, stride: Point) -> Iterator[Point]:
        """Yield the points one stride away in each of eight directions, clipped to the ranges.

        Args:
            point: Supply pressure P_S [Pa], and piston speed for planning V_max [m/s].
            stride: Stride in P_S [Pa] and V_max [m/s].

        Yields:
            Points (P_S, V_max) that differ from `point`. Several of them may be equal because they
            are clipped.
        """
        pressure, v_max = self._ranges
        for i, k in _around((0, 0)):
            moved = (
                pressure.clip(point[0] + i * stride[0]),
                v_max.clip(point[1] + k * stride[1]),
            )
            if moved != point:
                yield moved

    def found(self) -> OperatingPoint:
        """Return the cheapest of all points that were tried, and plan there once more.

        Among equally cheap points, the lowest supply pressure decides, then the lowest V_max
        (piston speed for planning). Afterwards the planner has this
        point's machine.

        Returns:
            The best point, its plan, its machine, and all points in increasing order.

        Raises:
            NoOperatingPointError: There is no plan at any of the points.
        """
        curve = tuple(self._samples[point] for point in sorted(self._samples))
        best = min(curve, key=lambda sample: sample.cost)
        if best.failure:
            pressure, v_max = self._ranges
            raise NoOperatingPointError(
                f"no plan at any supply pressure in {pressure.low:g} … {pressure.high:g} Pa with "
                f"V_max in {v_max.low:g} … {v_max.high:g} m/s; at the first: {curve[0].failure}"
            )
        point = best.supply_pressure, best.v_max
        return OperatingPoint(best, self._plan(point), self.machine_at(point), curve)


def _around(at: tuple[int, int]) -> Iterator[tuple[int, int]]:
    """Yield the eight neighbours of a grid point.

    Args:
        at: Indices of the point along both axes.

    Yields:
        Indices of each neighbour, which may be outside the grid.
    """
    for i, k in itertools.product((-1, 0, 1), repeat=2):
        if (i, k) != (0, 0):
            yield at[0] + i, at[1] + k
