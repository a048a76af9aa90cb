"""The constant supply pressure P_S and speed limit V_max that serve one move best.

Both are decisions here, each within a range: the move is planned at points sampled evenly, then
around the cheapest of these in ever smaller strides. Where modes change the cost jumps, so nothing
is fitted or interpolated: the best point is the cheapest of all at which a plan was made. What a
point costs is w₁ E + w₂ T + w₃ switches (+ w₄ M) of its motion.

    found = best_operating_point(planner, goal, start, supply_pressure=Range(2.5e6, 10e6))
    found.best.supply_pressure, found.plan
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState
from mhsb_model.types import Position
from mhsb_planner.errors import RequestError
from mhsb_planner.planner import Plan, Planner, PlanOptions

SAMPLES = {1: 25, 2: 9}
"""Points along each range, where one or two are given."""

STARTS = 3
"""From so many of the cheapest points that no neighbour undercuts, the refinement sets out."""

HALVINGS = 5
"""Of the stride; the last is this many halvings of half the samples' spacing."""

MOVES = 4
"""Of the refinement with one stride, at most."""

Point = tuple[float, float]


@dataclass(frozen=True)
class Range:
    """From the lowest to the highest value that may be chosen, in SI units; finite, above 0."""

    low: float
    high: float

    def __post_init__(self) -> None:
        if not 0.0 < self.low <= self.high < math.inf:
            rule = "must be two finite numbers above 0, the lower one first"
            raise RequestError("range", f"{self.low:g} … {self.high:g}", rule)

    def sampled(self, count: int) -> list[float]:
        """Values at equal distances, both ends among them."""
        if self.low == self.high:
            return [self.low]
        step = (self.high - self.low) / (count - 1)
        return [*(self.low + k * step for k in range(count - 1)), self.high]

    def within(self, value: float) -> float:
        """The value in the range that is nearest to this one."""
        return min(self.high, max(self.low, value))


@dataclass(frozen=True)
class Sample:
    """A point and what the move takes there.

    supply_pressure, v_max  Pa, m/s
    energy, energy_series   of the motion in both readings [J]; infinite without plan, as are
    duration, cost          s, and w₁ E + w₂ T + w₃ switches + w₄ M of the motion
    switches                of the motion
    failure                 why there is no plan, in one sentence; empty where there is one
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
    """The best point, its plan and machine, and the curve: all samples by P_S and V_max."""

    best: Sample
    plan: Plan
    machine: Machine
    curve: tuple[Sample, ...]


class NoOperatingPointError(MhsbError):
    """At none of the points sampled there is a plan."""

    def __init__(self, pressure: Range, v_max: Range, failure: str) -> None:
        self.pressure = pressure
        self.v_max = v_max
        super().__init__(
            f"no plan at any supply pressure in {pressure.low:g} … {pressure.high:g} Pa with V_max "
            f"in {v_max.low:g} … {v_max.high:g} m/s; at the first: {failure}"
        )


def best_operating_point(
    planner: Planner,
    goal: Position,
    start: MotionState,
    options: PlanOptions | None = None,
    supply_pressure: Range | None = None,
    v_max: Range | None = None,
    *,
    told: Callable[[Sample], None] | None = None,
) -> OperatingPoint:
    """Plan a move from rest at the best point of the ranges [Pa], [m/s].

    planner  left at the best point; its posture table is kept throughout
    told     called with each sample as soon as it is known

    What has no range stays as the planner's machine has it; its own point is among the samples
    where it lies within. Raises NoOperatingPointError; MachineFileError where an end of a range is
    beyond what a machine may have; RequestError where no range is given.
    """
    if supply_pressure is None and v_max is None:
        raise RequestError("range", "none", "of supply pressure, V_max or both must be given")
    config = planner.machine.config
    own = config.hydraulics.main_pump.pressure, config.motion.max_piston_speed
    ranges = supply_pressure or Range(own[0], own[0]), v_max or Range(own[1], own[1])
    search = _Search(planner, goal, start, options or PlanOptions(), ranges, told)
    for ends in zip((ranges[0].low, ranges[0].high), (ranges[1].low, ranges[1].high), strict=True):
        search.machine_at(ends)
    search.look_around(own)
    return search.found()


class _Search:
    """The points looked at so far, each once."""

    def __init__(
        self,
        planner: Planner,
        goal: Position,
        start: MotionState,
        options: PlanOptions,
        ranges: tuple[Range, Range],
        told: Callable[[Sample], None] | None,
    ) -> None:
        self._planner, self._own = planner, planner.machine
        self._goal, self._start, self._options = goal, start, options
        self._ranges, self._told = ranges, told
        self._samples: dict[Point, Sample] = {}

    def machine_at(self, point: Point) -> Machine:
        """The machine with P_S [Pa] and V_max [m/s]."""
        return self._own.changed(supply_pressure=point[0], max_piston_speed=point[1])

    def cost(self, point: Point) -> float:
        """What the move costs there, infinite without plan."""
        if point not in self._samples:
            try:
                sample = self._sample(point, self._plan(point))
            except MhsbError as error:
                sample = Sample(*point, failure=str(error))
            self._samples[point] = sample
            if self._told is not None:
                self._told(sample)
        return self._samples[point].cost

    def _plan(self, point: Point) -> Plan:
        self._planner.change(self.machine_at(point))
        return self._planner.plan(self._goal, self._start, options=self._options)

    def _sample(self, point: Point, plan: Plan) -> Sample:
        return Sample(
            *point,
            energy=plan.energy.paper,
            energy_series=plan.energy.series,
            duration=plan.duration,
            switches=plan.motion.schedule.switches,
            cost=plan.cost(self._options),
        )

    def look_around(self, own: Point) -> None:
        """All samples of the ranges, the machine's own point, then closer round the cheapest."""
        free = sum(each.low < each.high for each in self._ranges)
        axes = [each.sampled(SAMPLES[max(1, free)]) for each in self._ranges]
        cost = {
            at: self.cost((axes[0][at[0]], axes[1][at[1]]))
            for at in itertools.product(range(len(axes[0])), range(len(axes[1])))
        }
        minima = [at for at in cost if cost[at] <= min(cost.get(n, math.inf) for n in _around(at))]
        starts = [(axes[0][i], axes[1][k]) for i, k in sorted(minima, key=cost.__getitem__)]
        if all(each.within(value) == value for each, value in zip(self._ranges, own, strict=True)):
            starts = sorted([own, *starts], key=self.cost)
        spacing = tuple(axis[1] - axis[0] if len(axis) > 1 else 0.0 for axis in axes)
        for start in starts[:STARTS]:
            self._refine(start, (0.5 * spacing[0], 0.5 * spacing[1]))

    def _refine(self, point: Point, stride: Point) -> None:
        """Compass search: to the cheapest neighbour, with half the stride where none is cheaper."""
        moves = halvings = 0
        while math.isfinite(self.cost(point)) and halvings <= HALVINGS:
            best = min(self._neighbors(point, stride), key=self.cost, default=point)
            if self.cost(best) < self.cost(point) and moves < MOVES:
                point, moves = best, moves + 1
            else:
                stride, moves, halvings = (0.5 * stride[0], 0.5 * stride[1]), 0, halvings + 1

    def _neighbors(self, point: Point, stride: Point) -> Iterator[Point]:
        pressure, v_max = self._ranges
        for i, k in _around((0, 0)):
            moved = (
                pressure.within(point[0] + i * stride[0]),
                v_max.within(point[1] + k * stride[1]),
            )
            if moved != point:
                yield moved

    def found(self) -> OperatingPoint:
        """The cheapest of all points; of equals that with the lowest P_S, then V_max."""
        curve = tuple(self._samples[point] for point in sorted(self._samples))
        best = min(curve, key=lambda sample: sample.cost)
        if best.failure:
            raise NoOperatingPointError(*self._ranges, curve[0].failure)
        point = best.supply_pressure, best.v_max
        return OperatingPoint(best, self._plan(point), self.machine_at(point), curve)


def _around(at: tuple[int, int]) -> Iterator[tuple[int, int]]:
    """The eight neighbours of a point of a grid."""
    for i, k in itertools.product((-1, 0, 1), repeat=2):
        if (i, k) != (0, 0):
            yield at[0] + i, at[1] + k
