"""From paths to a plan: each is made a motion (S3, S4), and the cheapest so far stays."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from time import perf_counter
from types import MappingProxyType

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.trajectory import Trajectory, standstill
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.errors import DeadlineError
from mhsb_planner.motion.cavitation import cavitations_of
from mhsb_planner.motion.energy import motion_energy
from mhsb_planner.motion.s3_steered import Steering
from mhsb_planner.motion.s3_trajectory import (
    FitError,
    FitMethod,
    FitRules,
    FittedMotion,
    TrajectoryKind,
    fit_braking,
    fit_rest,
    fit_trajectory,
)
from mhsb_planner.plan import Plan
from mhsb_planner.planners.options import PlanOptions
from mhsb_planner.planners.path_planner import Candidate, Task
from mhsb_planner.planners.registry import planner_named
from mhsb_planner.search.area_shortfall import area_along_motion
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.search_time import SearchTime

PROMISE_KEPT = 0.85
"""A motion costs at least this share of what its path promises, or it is not looked at."""

FASTER = (0.72, 0.85)
"""Factors on the duration of the shortest ramps that are tried as well: these leave half of the
acceleration and of the jerk to another ramp, which may not be going on."""

BRISK_END = 0.72
"""Likewise on that of the last ramp alone, by which inertia asks for no pressure."""

NEARLY = 1.03
"""Cost of a motion over the best one's up to which other ways along its path may be cheaper."""

SLOWER = (1.5, 2.2, 3.4)
"""Factors on the duration of ramps that are compared with the shortest."""

VARIED_STRETCH = 1.2
"""By so much such a motion may be stretched at most: one that takes longer is seldom cheaper."""

COMPARED_SHARE = 1.0 / 3.0
"""Of the time that is left a motion along a path to compare with may take so much, while there is
none: one that takes long is long, and the own search finds a shorter way meanwhile."""

WORTH_LEAVING = 0.02
"""By this share another motion has to be cheaper than the rest of the plan in force."""

LASTING = 1.5
"""A motion that is soon to be followed by another takes so many times the time until then."""

BEHIND = 0.1
"""By so much of that time a cheaper one may take longer."""


def fit_rules(options: PlanOptions, of_path: TrajectoryKind | None = None) -> FitRules:
    """What S3 may do; `of_path` is how it begins on a path, unless it is told.

    Only where polynomials are what is asked for may they pass V_max.
    """
    own = options.trajectory or planner_named(options.planner).trajectory
    rules = FitRules.following()
    if (options.trajectory or of_path or own) == "polynomial":
        asked = own == "polynomial"
        rules = FitRules(max_excess=options.max_speed_excess if asked else rules.max_excess)
    passing = tuple((*point, options.via_tolerance) for point in options.via)
    return replace(rules, least_duration=LASTING * options.period, passing=passing)


def _followed(rules: FitRules) -> FitRules:
    """The same for a path that is followed."""
    return replace(
        FitRules.following(), least_duration=rules.least_duration, passing=rules.passing
    )


class PlanMaking:
    """A plan being made: paths come in, the cheapest motion so far stays.

    time   what the search may take of the time until the deadline
    began  when the plan was asked for
    """

    def __init__(self, machine: Machine, task: Task, deadline: Deadline, began: float) -> None:
        self._machine, self._task = machine, task
        self.time = SearchTime(deadline)
        self._best: Plan | None = None
        self._refused: FitError | None = None
        self._cut_short: DeadlineError | None = None
        self._put_off: tuple[Candidate, FittedMotion, FitRules] | None = None
        self._first_cost = math.inf
        self._seconds = {"search": 0.0, "fit": 0.0, "energy": 0.0}
        self._began = self._since = began

    def go_on(self, rest: Trajectory, bound: float) -> None:
        """Begin with the rest of the plan in force, where it keeps all limits.

        bound: no plan takes less energy [J]
        """
        task = self._task
        rules = fit_rules(task.options)
        with suppress(FitError, DeadlineError):
            motion = fit_rest(self._machine, rest, task.modes, rules, self.time.deadline)
            tip, end = self._machine.tip_position(rest.position[-1]), rest.position[-1]
            path = DiscretePath.standing(tip, end, task.modes.modes, 0.0)
            self._best = self._priced(replace(path, lower_bound=bound), motion, NEVER)
            self.time.found = True
        self._spend("fit")
        self._seconds["first_motion"] = self._since - self._began

    def best_along(self, candidates: Iterable[Candidate]) -> Plan:
        """The plan along the best of these paths; raises what they raise where there is none."""
        in_time = True
        try:
            for candidate in candidates:
                self._spend("comparison" if candidate.compared else "search")
                self._consider(candidate)
            self._go_on_with_the_first()
        except DeadlineError:
            if self._best is None:
                raise
            in_time = False
        except MhsbError as error:
            if self._best is None:
                raise self._cut_short or error from None
        self._spend("search")
        if self._best is None:
            raise self._without_motion()
        path = self._best.path
        out_of_time = not in_time or self.time.until.passed
        statistics = replace(path.statistics, out_of_time=out_of_time)
        return replace(
            self._best,
            path=replace(path, statistics=statistics),
            cavitations=cavitations_of(self._machine, self._best.motion.trajectory),
            seconds=MappingProxyType(self._seconds),
        )

    def _without_motion(self) -> Exception:
        """Why no path has a motion: for lack of time, where there might be others."""
        if self._cut_short is None and self.time.until.passed:
            return DeadlineError("making motions of paths")
        unsaid = ValueError("a planner that gives no path must say why")
        return self._cut_short or self._refused or unsaid

    def _consider(self, candidate: Candidate) -> None:
        """Make the path a motion, where it may be cheaper, and keep it if it is.

        With a deadline other motions along the first path wait for the second path: they take
        several times as long as that path's motion, and gain less.
        """
        path, options, best = candidate.path, self._task.options, self._best
        promised = path.cost - options.weights.switches * path.switches
        if best is not None and PROMISE_KEPT * promised > best.cost(options):
            return
        rules, followed = fit_rules(options, candidate.trajectory), None
        if best is None and self._may_follow(path, rules):  # sooner there than a polynomial
            followed = self._made(candidate, _followed(rules))
            rules = replace(rules, alone=followed is not None)
        motion = self._made(candidate, rules) or followed
        if best is None and self.time.ends and motion is not None and self._best is not None:
            self._put_off, self._first_cost = (candidate, motion, rules), self._best.cost(options)
            return
        self._go_on_with_the_first()
        if motion is not None:
            self._vary(candidate, motion, rules)

    def _go_on_with_the_first(self) -> None:
        """Look at the other motions along the first path, if these were put off.

        Only where its own motion is still nearly the best.
        """
        if self._put_off is None or self._best is None:
            return
        (candidate, motion, rules), self._put_off = self._put_off, None
        options, best = self._task.options, self._best
        if self._first_cost <= NEARLY * best.cost(options):
            self._vary(candidate, motion, rules)

    def _vary(self, candidate: Candidate, motion: FittedMotion, rules: FitRules) -> None:
        """Make the path of a motion other motions, and keep what is cheaper."""
        for other in self._others(candidate.path, motion, rules):
            before = self._best
            if self._made(candidate, other) is not None and self._best is not before:
                self._refused_before(motion)

    def _refused_before(self, motion: FittedMotion) -> None:
        """The best is another motion along the path of this one: what was refused before stays."""
        best = self._best
        if best is not None:
            refused = motion.refused + best.motion.refused
            self._best = replace(best, motion=replace(best.motion, refused=refused))

    def _may_follow(self, path: DiscretePath, rules: FitRules) -> bool:
        """Whether a path's motion may be a polynomial, and following it instead."""
        free = self._task.options.trajectory is None and path.steps > 0
        return free and rules.trajectory == "polynomial" and not self._steers

    @property
    def _steers(self) -> bool:
        return isinstance(self._task.brake, Steering)

    def _made(self, candidate: Candidate, rules: FitRules) -> FittedMotion | None:
        """Make the path a motion; it, if it is the best so far or NEARLY, or None.

        A polynomial that V_max lets last as long as the path is taken for any other motion along
        it, as published; where none keeps the limits, what is taken says why.
        """
        began, best, path = self._since, self._best, candidate.path
        deadline = self.time.deadline
        if best is None and candidate.compared and self.time.ends:
            deadline = deadline.less((1.0 - COMPARED_SHARE) * deadline.left)
        try:
            motion = self._motion(path, rules, deadline)
        except DeadlineError as error:
            if deadline == self.time.deadline:
                raise
            self._cut_short = error
            return None
        except FitError as error:
            self._refused = self._refused or error
            if best is None and self._steers:
                raise  # another way of setting out will do better than another path
            if best is None or not rules.alone:
                return None
            refused = error.refused + best.motion.refused
            self._best = replace(best, motion=replace(best.motion, refused=refused))
            return self._best.motion
        finally:
            self._spend("comparison" if candidate.compared else "fit")
        plan = self._priced(path, motion, NEVER if best is None else self.time.deadline)
        self._spend("comparison" if candidate.compared else "energy")
        if best is None:
            self._seconds["first_motion"] = self._since - self._began
            self.time.found = True
            took = (self._since - began) / (1 + len(motion.refused))
            self.time.reserve = max(self.time.reserve, took)
        published = rules.alone and motion.stretch <= 1.0
        if best is None or published or self._takes_over(plan, best):
            self._best = plan
            return motion
        options = self._task.options
        return motion if plan.cost(options) <= NEARLY * best.cost(options) else None

    def _takes_over(self, plan: Plan, best: Plan) -> bool:
        """Whether a plan is better than the best so far, and by enough."""
        options = self._task.options
        if not plan.is_cheaper_than(best, options):
            return False
        if options.period > 0.0 and plan.duration > best.duration + BEHIND * options.period:
            return False
        share = WORTH_LEAVING if best.motion.method == FitMethod.CONTINUED else 0.0
        return plan.cost(options) <= (1.0 - share) * best.cost(options)

    def _others(
        self, path: DiscretePath, motion: FittedMotion, rules: FitRules
    ) -> Iterator[FitRules]:
        """Other ways along a path that may be cheaper than this motion by some rules.

        A polynomial that V_max makes slow against following the path; where that is followed,
        faster ramps, or, where time counts, the last one alone, and where inertia calls for boost,
        as more switches than the path's tell, slower ones.
        """
        followed = _followed(rules)
        varied = replace(followed, stepped=False, max_stretch=VARIED_STRETCH)
        stays = self._task.options.period == 0.0  # a goal that moves does not wait for more
        if stays and motion.method == FitMethod.RAMPED and not motion.braked:
            for faster in FASTER:
                yield replace(varied, slowness=(faster,))
            if self._task.options.weights.time > 0.0:
                yield replace(varied, last_ramp=BRISK_END)
        if motion.method == FitMethod.POLYNOMIAL:
            if motion.stretch > 1.0 and not rules.alone and self._may_follow(path, rules):
                yield followed
        elif stays and motion.schedule.switches > path.switches:
            for slower in SLOWER:
                yield replace(varied, slowness=(slower,))

    def _motion(self, path: DiscretePath, rules: FitRules, deadline: Deadline) -> FittedMotion:
        task = self._task
        if path.steps == 0:
            brake = task.brake or standstill(task.start.position)
            brake = brake if isinstance(brake, Trajectory) else brake.trajectory
            return fit_braking(self._machine, brake, task.modes)
        return fit_trajectory(
            self._machine,
            path,
            task.start,
            task.modes,
            task.brake,
            rules,
            deadline,
        )

    def _priced(self, path: DiscretePath, motion: FittedMotion, deadline: Deadline) -> Plan:
        machine, area, shortfall = self._machine, self._task.area, 0.0
        deadline.check("the comparison of motions")
        energy = motion_energy(machine, motion.trajectory, motion.schedule, motion.profiles)
        if area.weight > 0.0:
            along = area_along_motion(machine, motion.trajectory, motion.schedule, deadline)
            shortfall = along.shortfall(area.reference)
        return Plan(path, motion, energy, area_shortfall=shortfall)

    def _spend(self, stage: str) -> None:
        """Put down the time since the last look to a stage."""
        now = perf_counter()
        self._seconds[stage] = self._seconds.get(stage, 0.0) + now - self._since
        self._since = now
