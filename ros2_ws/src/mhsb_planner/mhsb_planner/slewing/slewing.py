"""Paths of an arm that slews, by any planner of its plane: one after the other, ever cheaper.

Without zones in space each path of the plane is one, the plane turning meanwhile. Among zones there
are three ways, and paths are taken from each in turn:

1. as if there were none, turned when that is clear (`among_zones`);
2. among the shadows of all that the plane turns past;
3. over a point on the way where it may turn all the way (`carrying`), among the shadows of what
   stands at the start before it, and of what stands at the goal after it.

Where the first way loses no time to zones there is no need for the others. The second and third are
also those of the planners that the plan is compared with; the first of these is the quickest, and
its paths are taken one after the other until there is a motion, then every second one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.trajectory import MotionState
from mhsb_model.types import FloatArray
from mhsb_planner.errors import DeadlineError, NoPathError
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planners.legs import PlanePaths, joined, path_of_leg
from mhsb_planner.planners.path_planner import (
    NOTHING_ELSE,
    Candidate,
    Meanwhile,
    PathPlanner,
    Task,
    in_both_ways,
)
from mhsb_planner.planners.resting import with_rests
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.goal_clearance import check_tip
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_search import SEARCHING
from mhsb_planner.search.search_time import SearchTime
from mhsb_planner.slewing.among_zones import turning_among_zones
from mhsb_planner.slewing.carrying import carrying_postures
from mhsb_planner.slewing.sharing_out import slewing_meanwhile
from mhsb_planner.slewing.turned_path import RESTS, corners, turned, turning_evenly

CARRIED_OVER = 4
"""Points on the way that are tried, at most."""

FREE = 1.005
"""A path whose cost zones raise by no more than this factor is worth no other way."""

NEAR_CARRYING = 0.15
"""How far from the posture that may turn the one that is planned may turn its end link [rad]."""


class InPlane(NamedTuple):
    """A path of the plane, and the number of the step that follows its corner, if it has one."""

    candidate: Candidate
    corner: int | None = None


@dataclass(frozen=True, eq=False)
class SlewingPaths:
    """Paths of the whole arm.

    machine  that slews
    planner  of paths in its plane
    graph    of the plane
    """

    machine: Machine
    planner: PathPlanner
    graph: StepGraph

    def bound(self, task: Task) -> float:
        """No plan takes less energy [J]."""
        return self._in_plane(task)[0].bound(self.graph)

    def paths(self, task: Task, time: SearchTime) -> Iterator[Candidate]:
        """Paths from the task's departure to its goal in `base_link`; raises as `PathPlanner`."""
        in_plane, slew = self._in_plane(task)
        if not self.machine.obstacles.in_space.any():
            for candidate in self.planner.paths(self.graph, in_plane, time):
                yield candidate._replace(path=self._evenly(task, candidate.path, slew))
            return
        check_tip(self.machine, task.goal)
        yield from self._among_zones(task, in_plane, slew, time)

    def _evenly(self, task: Task, path: DiscretePath, slew: float) -> DiscretePath:
        """A path of the plane that turns to this angle [rad], as if nothing were in its way."""
        began = float(task.departure[0])
        return turned(self.machine, task, path, turning_evenly(self.machine, path, began, slew))

    def _among_zones(
        self, task: Task, in_plane: Task, slew: float, time: SearchTime
    ) -> Iterator[Candidate]:
        began, bound = float(task.departure[0]), in_plane.bound(self.graph)
        direct: Iterator[InPlane] = map(
            InPlane, self.planner.paths(self.graph, in_plane, time)
        )
        rivals, turn = self.planner.rivals, (began, slew)
        others = [
            way(planner, in_plane, turn, time)
            for planner in (*rivals[:1], self.planner, *rivals[1:])
            for way in (self._past_shadows, self._carried)
        ]
        ways, quick = deque([direct, *others]), others[:2]
        found, refused = False, None
        while ways and not (found and time.until.passed):
            way = ways.popleft()
            try:
                candidate, corner = next(way)
            except StopIteration:
                continue
            except MhsbError as error:
                refused = refused or (error if way is direct else None)
                continue
            if way in quick:
                ways.insert(1 if time.found else 0, way)
            else:
                ways.append(way)
            path = replace(candidate.path, lower_bound=bound)
            turning = turning_among_zones(self.machine, path, began, slew)
            if turning is None:
                continue
            found, whole = True, turned(self.machine, task, path, turning)
            if way is direct and whole.cost <= FREE * self._evenly(task, path, slew).cost:
                ways = deque([direct])
            yield candidate._replace(path=whole)
            if corner is not None or RESTS in turning.step:
                before, weights = corners(turning, corner), task.options.weights
                rested = with_rests(self.machine, whole, before, weights)
                yield candidate._replace(path=rested)
        if not found:
            raise self._nothing_found(task, refused, time)

    def _nothing_found(
        self, task: Task, refused: MhsbError | None, time: SearchTime
    ) -> MhsbError:
        if time.until.passed:
            return DeadlineError(SEARCHING)
        start = tuple(self.machine.tip_in_base(task.departure).tolist())
        return refused or NoPathError(start, task.goal, self.machine.obstacles.names)

    def _past_shadows(
        self,
        planner: PathPlanner,
        in_plane: Task,
        turn: tuple[float, float],
        time: SearchTime,
    ) -> Iterator[InPlane]:
        """Paths of the plane on which it may turn at any time, from one angle to the other."""
        for path in self._among(planner, *turn).paths(in_plane, time):
            for candidate in self._as_ways(planner, path, in_plane):
                yield InPlane(candidate)

    def _carried(
        self,
        planner: PathPlanner,
        in_plane: Task,
        turn: tuple[float, float],
        time: SearchTime,
    ) -> Iterator[InPlane]:
        """Paths of the plane over a point where it may turn all the way: quick ones over each of
        several, then cheaper ones over these."""
        turning = self.machine.plane_among(*turn)
        postures = list(islice(carrying_postures(turning, self.graph, in_plane), CARRIED_OVER))
        ends = self._among(planner, turn[0], turn[0]), self._among(planner, turn[1], turn[1])
        for thorough in (False, True):
            for posture in postures:
                with suppress(MhsbError):
                    legs = self._over(posture, ends, in_plane, time, thorough)
                    for candidate in self._as_ways(planner, Candidate(joined(legs)), in_plane):
                        yield InPlane(candidate, legs[0].steps)

    def _as_ways(
        self, planner: PathPlanner, path: Candidate, in_plane: Task
    ) -> Iterator[Candidate]:
        """An own path as it is, a rival's as one that is compared."""
        if planner is self.planner:
            yield path
        else:
            yield from in_both_ways(path._replace(compared=True), planner, in_plane)

    def _over(
        self,
        posture: FloatArray,
        ends: tuple[PlanePaths, PlanePaths],
        in_plane: Task,
        time: SearchTime,
        thorough: bool,
    ) -> tuple[DiscretePath, DiscretePath]:
        """Paths to a posture's tip, in about that posture there, and on from it."""
        plane = self.machine.plane
        x, z = plane.tip_position(posture).tolist()
        psi = plane.end_link_angle(posture)
        alike = (psi - NEAR_CARRYING, psi + NEAR_CARRYING)
        options = replace(in_plane.options.on_the_way, goal_psi=alike)
        leg = replace(in_plane, goal=(x, z), options=options, meanwhile=NOTHING_ELSE)
        first = path_of_leg(ends[0], leg, time, thorough)
        onward = replace(leg.from_rest(first), goal=in_plane.goal, options=in_plane.options)
        return first, path_of_leg(ends[1], onward, time, thorough)

    def _among(self, planner: PathPlanner, began: float, ended: float) -> PlanePaths:
        """A planner's paths among what stands where the plane gets to between two angles."""
        among = self.machine.plane_among(began, ended)
        return PlanePaths(planner, self.graph.changed(among))

    def _in_plane(self, task: Task) -> tuple[Task, float]:
        """What is asked of the plane alone, and the slew's angle at the goal [rad]; how a moving
        start comes to rest is for the whole arm."""
        start, modes = task.start, task.modes
        tip, slew = self.machine.in_plane(task.goal, float(task.departure[0]))
        assert slew is not None
        meanwhile = Meanwhile(*slewing_meanwhile(self.machine, start.position[0], slew))
        alone = MotionState(start.position[1:], start.velocity[1:], start.acceleration[1:])
        in_plane = replace(
            task,
            goal=tip,
            start=alone,
            modes=StartModes(modes.modes[1:], modes.age[1:]),
            brake=None,
            departure=task.departure[1:],
            meanwhile=meanwhile,
        )
        return in_plane, slew
