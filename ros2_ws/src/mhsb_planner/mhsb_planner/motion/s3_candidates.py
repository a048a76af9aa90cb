"""The curves that S3 tries along a discrete path, in their order (`s3_trajectory`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from typing import Literal, Protocol

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, MotionState, Trajectory, standstill
from mhsb_model.types import FloatArray
from mhsb_planner.motion.passing import Passing
from mhsb_planner.motion.s3_coasting import Coasting
from mhsb_planner.motion.s3_following import followed_path
from mhsb_planner.motion.s3_limits import Limit
from mhsb_planner.motion.s3_polynomial import fit_polynomial, node_times
from mhsb_planner.motion.s3_steered import Steering, steered_path
from mhsb_planner.motion.s3_stepped import stepped_path
from mhsb_planner.motion.s4_mode_schedule import StartModes, SwitchingRules
from mhsb_planner.motion.trajectory_points import SmoothCurve
from mhsb_planner.search.discrete_path import DiscretePath

SHORTEST_MOVE = 0.5
"""Shortest duration of a polynomial [s]."""

USAGE_RESERVE = 1.003
"""Durations are stretched by this much more than the points need, for what lies between them."""

TrajectoryKind = Literal["polynomial", "followed"]
"""How S3 begins: with the published polynomials, or with the discrete path followed."""

TRAJECTORY_KINDS: tuple[TrajectoryKind, ...] = ("polynomial", "followed")


class FitMethod(StrEnum):
    """How the trajectory was made of the discrete path."""

    POLYNOMIAL = "polynomial"
    RAMPED = "ramped"
    STEERED = "steered"
    STEPPED = "stepped"
    BRAKING = "braking"
    CONTINUED = "continued"


class Curve(SmoothCurve, Protocol):
    """A joint motion with the times at which the discrete path's nodes are due."""

    @property
    def node_time(self) -> FloatArray:
        """When the path's nodes are due, float64[k + 1] s."""


@dataclass(frozen=True)
class FitRules:
    """What a fit may do.

    trajectory   whether the published polynomials are tried, or the path is followed at once
    alone        whether nothing else is tried where these do not keep the limits
    stepped      whether the path may be gone step by step
    switching    how modes are switched
    slowness     factors on the duration of the shortest ramps, in the order tried
    last_ramp    a further factor on that of the last one
    max_stretch  largest factor on the discrete path's durations
    max_excess   largest |v|/V_max − 1 of a piston
    overrun      m, by which a piston may run on beyond what braking and the path need
    least_duration  s, that the discrete path takes at least
    passing      points that the tip passes on its way
    """

    trajectory: TrajectoryKind = "polynomial"
    alone: bool = False
    stepped: bool = True
    switching: SwitchingRules = field(default_factory=SwitchingRules)
    slowness: tuple[float, ...] = (1.0, 1.4, 2.0, 2.8, 4.0, 8.0)
    last_ramp: float = 1.0
    max_stretch: float = 3.0
    max_excess: float = 0.1
    overrun: float = 2e-3
    least_duration: float = 0.0
    passing: tuple[Passing, ...] = ()

    @classmethod
    def following(cls) -> FitRules:
        """Rules for a motion that follows its path, within V_max but for rounding."""
        return cls(trajectory="followed", max_excess=1.001 * USAGE_RESERVE - 1.0)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A kind of curve, and how it is tried.

    lead_in      what comes before it
    stretch      the first one
    furthest     how far joints may go, where that is looked at
    coasts       whether it begins with coasting
    stretchable  limits for which it is stretched, rather than refused
    longest      largest factor on the first stretch; None: that of the rules
    for_thrust   whether it is tried only where the one before lacks pressure
    """

    method: FitMethod
    name: str
    curve_at: Callable[[float], Curve]
    start: MotionState
    lead_in: Trajectory | None = None
    stretch: float = 1.0
    furthest: FloatArray | None = None
    coasts: bool = False
    stretchable: tuple[Limit, ...] = (Limit.USAGE, Limit.THRUST)
    longest: float | None = None
    for_thrust: bool = False


def candidates(
    machine: Machine,
    path: DiscretePath,
    start: MotionState,
    brake: Trajectory | None,
    coast: Coasting | Steering | None,
    modes: StartModes,
    rules: FitRules,
) -> Iterator[Candidate]:
    """All curves, from `start`, from where `brake` has brought it to rest, or as it coasts; the
    one from where it steers.

    brake  also where it coasts: the same motion; modes in force at the start
    """
    rest = MotionState.at_rest(path.posture[0])
    if isinstance(coast, Steering):
        steered = partial(steered_path, machine, path, start)
        yield Candidate(FitMethod.STEERED, "steered", steered, start, coasts=True)
        return
    if rules.trajectory == "polynomial":
        yield _polynomial(path, start, brake)
        if rules.alone:
            return
    if coast is not None:
        yield from _ramped(machine, path, start, None, coast, rules)
    youngest = rules.switching.min_dwell - float(modes.age.min())
    lead_ins = [("", brake)]
    if youngest > 0.0:
        waited = (brake or standstill(start.position)).rested(round(youngest * SECOND_NS))
        lead_ins.append(("after a rest, ", waited))
    for words, lead_in in lead_ins:
        yield from _ramped(machine, path, rest, lead_in, None, rules, words)
        if rules.stepped:
            stepped = partial(stepped_path, machine, path)
            yield Candidate(FitMethod.STEPPED, f"{words}stepped", stepped, rest, lead_in)


def _ramped(
    machine: Machine,
    path: DiscretePath,
    start: MotionState,
    lead_in: Trajectory | None,
    coast: Coasting | None,
    rules: FitRules,
    words: str = "",
) -> Iterator[Candidate]:
    """The path followed with ever slower ramps; from rest the slowest are stretched as well."""
    words = words if coast is None else "setting out at once, "
    for slower in rules.slowness:
        last = coast is None and slower == rules.slowness[-1]
        yield Candidate(
            FitMethod.RAMPED,
            f"{words}with ramps {slower:g} times the shortest",
            partial(followed_path, machine, path, slower, coast, last=rules.last_ramp),
            start,
            lead_in,
            coasts=coast is not None,
            for_thrust=slower != rules.slowness[0],
            stretchable=(Limit.USAGE, Limit.THRUST) if last else (Limit.USAGE,),
        )


def _polynomial(path: DiscretePath, start: MotionState, brake: Trajectory | None) -> Candidate:
    """The published curve; from a moving start it is not stretched."""
    shortest = max(1.0, SHORTEST_MOVE / float(node_times(path)[-1]))
    if brake is None:
        rest = MotionState.at_rest(path.posture[0])
        return Candidate(
            FitMethod.POLYNOMIAL,
            "polynomial",
            lambda stretch: fit_polynomial(path, rest, 0.0, stretch),
            rest,
            stretch=shortest,
        )
    delay = brake.duration_ns / SECOND_NS / 2
    return Candidate(
        FitMethod.POLYNOMIAL,
        "polynomial from the moving start",
        lambda stretch: fit_polynomial(path, start, delay, stretch),
        start,
        stretch=shortest,
        furthest=furthest_of(start, np.vstack([brake.position, path.posture])),
        longest=1.0,
    )


def furthest_of(start: MotionState, position: FloatArray) -> FloatArray:
    """How far each joint gets in the direction of its first velocity, float64[n] rad."""
    return np.max(np.sign(start.velocity) * (position - start.position), axis=0)
