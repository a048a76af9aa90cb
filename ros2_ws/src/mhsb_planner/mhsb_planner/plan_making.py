"""Plan making: a motion is fitted to each path (S3, S4), and the cheapest motion is kept."""

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
from mhsb_planner.deadline import NO_DEADLINE, Deadline, SearchTime
from mhsb_planner.errors import DeadlineError
from mhsb_planner.motion.cavitation import find_cavitations
from mhsb_planner.motion.energy import motion_energy
from mhsb_planner.motion.s3_state_to_rest import Steering
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
from mhsb_planner.planners.path_planner import PathProposal, PathRequest
from mhsb_planner.planners.registry import get_planner
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.manipulability_loss import area_along_motion

MIN_MOTION_COST_RATIO = 0.85
"""Smallest expected ratio of a motion's cost to its path's cost without switches [-]. A path is
skipped if this ratio times its cost without switches exceeds the incumbent's cost.
"""

FASTER_RAMP_FACTORS = (0.72, 0.85)
"""Factors on the duration of the shortest ramps that are tried in addition. The shortest ramps
leave half of the acceleration and jerk to a simultaneous ramp; without one, ramps may be faster.
"""

LAST_RAMP_FACTOR = 0.72
"""Factor on the duration of the last ramp alone. Braking needs no extra pressure, so the last ramp
may be shorter than the others.
"""

NEAR_BEST_COST_FACTOR = 1.03
"""Largest ratio of a motion's cost to the incumbent's at which other motions along its path are
tried.
"""

SLOWER_RAMP_FACTORS = (1.5, 2.2, 3.4)
"""Factors on the duration of the shortest ramps that are tried if inertia calls for boost."""

VARIED_STRETCH = 1.2
"""Largest stretch in time of a motion with other ramps; a longer one is seldom cheaper."""

COMPARED_SHARE = 1.0 / 3.0
"""Share of the remaining time that fitting a path proposed for comparison may take before there is
a motion. If fitting takes long, the motion is long, and the own search will find a shorter path.
"""

WORTH_LEAVING = 0.02
"""Relative gain in cost from which another motion replaces the rest of the plan in force."""

SHORT_MOTION_TIME_FACTOR = 1.5
"""Shortest duration of a motion that is to be followed by another, as a factor on the period."""

ALLOWED_DELAY_SHARE = 0.1
"""Additional duration that a cheaper motion may have if another is to follow, as a share of the
period.
"""


def fit_rules(options: PlanOptions, of_path: TrajectoryKind | None = None) -> FitRules:
    """Return the rules by which S3 fits a motion to a path.

    The method of S3 (polynomial or following the path) is chosen by the options, else by `of_path`,
    else by the planner. Polynomials may exceed V_max by `max_speed_excess` only if the options or
    the planner ask for polynomials.

    Args:
        options: Options of the plan.
        of_path: Method for this path if the options leave it open; None: the planner's method.

    Returns:
        The rules, with the via points as (coordinates, tolerance) [m] and the shortest duration
        SHORT_MOTION_TIME_FACTOR · period [s].
    """
    own = options.trajectory or get_planner(options.planner).trajectory
    rules = FitRules.create_following()
    if (options.trajectory or of_path or own) == "polynomial":
        asked = own == "polynomial"
        rules = FitRules(max_excess=options.max_speed_excess if asked else rules.max_excess)
    passing = tuple((*point, options.via_tolerance) for point in options.via)
    return replace(
        rules, min_duration=SHORT_MOTION_TIME_FACTOR * options.period, via_points=passing
    )


def _following_rules(rules: FitRules) -> FitRules:
    """Return the rules for following the path, with the same shortest duration and via points."""
    return replace(
        FitRules.create_following(), min_duration=rules.min_duration, via_points=rules.via_points
    )


class PlanBuilder:
    """Making of one plan: proposals come in, and the cheapest motion is kept as the incumbent.

    Attributes:
        time: Time limit that the search shares; this class sets its `has_motion` and `reserve`.
    """

    def __init__(
        self, machine: Machine, task: PathRequest, deadline: Deadline, began: float
    ) -> None:
        """Prepare the making of a plan.

        Args:
            machine: The whole arm.
            task: The request.
            deadline: Instant at which the plan is due.
            began: Time of the request by `time.perf_counter` [s].
        """
        self._machine, self._task = machine, task
        self.time = SearchTime(deadline)
        self._best: Plan | None = None
        self._refused: FitError | None = None
        self._cut_short: DeadlineError | None = None
        self._put_off: tuple[PathProposal, FittedMotion, FitRules] | None = None
        self._first_cost = math.inf
        self._seconds = {"search": 0.0, "fit": 0.0, "energy": 0.0}
        self._began = self._since = began

    def start_with_rest(self, rest: Trajectory, lower_bound: float) -> None:
        """Make the rest of the plan in force the first incumbent, if it keeps all limits.

        Otherwise there is no incumbent yet, and no error is raised. The time until then is
        stored as the time of the first motion.

        Args:
            rest: Rest of the plan in force, with stamp 0.
            lower_bound: Lower bound on the energy of every plan [J].
        """
        task = self._task
        rules = fit_rules(task.options)
        with suppress(FitError, DeadlineError):
            motion = fit_rest(self._machine, rest, task.modes, rules, self.time.deadline)
            tip, end = self._machine.tip_position(rest.position[-1]), rest.position[-1]
            path = DiscretePath.create_without_steps(tip, end, task.modes.modes, 0.0)
            self._best = self._assemble_plan(
                replace(path, lower_bound=lower_bound), motion, NO_DEADLINE
            )
            self.time.has_motion = True
        self._charge_time("fit")
        self._seconds["first_motion"] = self._since - self._began

    def choose_best(self, candidates: Iterable[PathProposal]) -> Plan:
        """Fit motions to proposed paths and return the plan with the cheapest one.

        An error of the generator or of S3, or the deadline, ends the work. It is raised only if
        there is no motion. The other motions along the first path are tried at the latest at the
        end.

        Args:
            candidates: Path proposals, requested one after the other; the generator may read
                `time`.

        Returns:
            The plan, with the times of its stages [s], its cavitations, and in its path's
            statistics whether the time ran out.

        Raises:
            FitError: No path has a motion that keeps the limits; the error is the one for the first
                path.
            DeadlineError: The time was up before there was a motion.
            MhsbError: Errors of the generator.
        """
        in_time = True
        try:
            for candidate in candidates:
                self._charge_time("comparison" if candidate.for_comparison else "search")
                self._consider(candidate)
            self._try_postponed_variants()
        except DeadlineError:
            if self._best is None:
                raise
            in_time = False
        except MhsbError as error:
            if self._best is None:
                raise self._cut_short or error from None
        self._charge_time("search")
        if self._best is None:
            raise self._no_motion_error()
        path = self._best.path
        out_of_time = not in_time or self.time.search_deadline.has_passed
        statistics = replace(path.statistics, out_of_time=out_of_time)
        return replace(
            self._best,
            path=replace(path, statistics=statistics),
            cavitations=find_cavitations(self._machine, self._best.motion.trajectory),
            seconds=MappingProxyType(self._seconds),
        )

    def _no_motion_error(self) -> Exception:
        """Create the error that explains why no path has a motion.

        Running out of time has precedence, since there might have been other paths.

        Returns:
            DeadlineError if the time was up, else the first FitError. ValueError if there was no
            path at all, which is a fault of the planner.
        """
        if self._cut_short is None and self.time.search_deadline.has_passed:
            return DeadlineError("making motions of paths")
        unsaid = ValueError("a planner that gives no path must say why")
        return self._cut_short or self._refused or unsaid

    def _consider(self, candidate: PathProposal) -> None:
        """Fit a motion to a path and keep it if it is the cheapest.

        A path is skipped if MIN_MOTION_COST_RATIO times its cost without switches exceeds the
        incumbent's cost. Other motions along a path are tried if its motion costs at most
        NEAR_BEST_COST_FACTOR times as much as the incumbent.

        A motion is a published polynomial, or it consists of ramps that follow the path
        (`TrajectoryKind`). If polynomials are asked for but following is allowed, the first path
        gets ramps first, since they are faster to fit, then a polynomial. That polynomial replaces
        the ramps whatever it costs, unless it has to be stretched.

        With a deadline, other motions along the first path wait until the next path has been
        fitted, or else for the end of `choose_best`. They take several times as long as the motion
        along that path and gain less.

        Args:
            candidate: The proposal.
        """
        path, options, best = candidate.path, self._task.options, self._best
        promised = path.cost - options.weights.switches * path.switches
        if best is not None and MIN_MOTION_COST_RATIO * promised > best.cost(options):
            return
        rules, followed = fit_rules(options, candidate.trajectory), None
        if best is None and self._may_follow_instead(path, rules):  # faster to fit
            followed = self._fit_and_keep(candidate, _following_rules(rules))
            rules = replace(rules, polynomial_only=followed is not None)
        motion = self._fit_and_keep(candidate, rules) or followed
        if (
            best is None
            and self.time.has_deadline
            and motion is not None
            and self._best is not None
        ):
            self._put_off, self._first_cost = (candidate, motion, rules), self._best.cost(options)
            return
        self._try_postponed_variants()
        if motion is not None:
            self._try_variants(candidate, motion, rules)

    def _try_postponed_variants(self) -> None:
        """Try the other motions along the first path, if they were postponed.

        They are dropped if the first motion costs more than NEAR_BEST_COST_FACTOR times as much as
        the incumbent.
        """
        if self._put_off is None or self._best is None:
            return
        (candidate, motion, rules), self._put_off = self._put_off, None
        options, best = self._task.options, self._best
        if self._first_cost <= NEAR_BEST_COST_FACTOR * best.cost(options):
            self._try_variants(candidate, motion, rules)

    def _try_variants(self, candidate: PathProposal, motion: FittedMotion, rules: FitRules) -> None:
        """Fit other motions to the path of a motion, and keep those that are cheaper.

        Args:
            candidate: Proposal with the path.
            motion: Motion along the path.
            rules: Rules by which it was fitted.
        """
        for other in self._variant_rules(candidate.path, motion, rules):
            before = self._best
            if self._fit_and_keep(candidate, other) is not None and self._best is not before:
                self._prepend_refusals(motion)

    def _prepend_refusals(self, motion: FittedMotion) -> None:
        """Prepend an earlier motion's reasons for refused curves to those in the incumbent.

        S3 records why it refused each curve that it tried. The incumbent is another motion along
        the same path.

        Args:
            motion: The earlier motion.
        """
        best = self._best
        if best is not None:
            refused = motion.refused + best.motion.refused
            self._best = replace(best, motion=replace(best.motion, refused=refused))

    def _may_follow_instead(self, path: DiscretePath, rules: FitRules) -> bool:
        """Return whether a path may be followed instead of a polynomial that the rules ask for.

        It may if four things hold. The rules ask for a polynomial, and the options leave S3's
        method open. The path has steps, and the start does not steer straight to the goal.

        Args:
            path: The path.
            rules: Rules for its motion.

        Returns:
            True if all four hold.
        """
        free = self._task.options.trajectory is None and path.steps > 0
        return free and rules.trajectory == "polynomial" and not self._is_steering

    @property
    def _is_steering(self) -> bool:
        """True if the motion starts from a moving state and steers straight to its goal."""
        return isinstance(self._task.brake, Steering)

    def _fit_and_keep(self, candidate: PathProposal, rules: FitRules) -> FittedMotion | None:
        """Fit a motion to a path and make it the incumbent if it is better (`_replaces`).

        Updates the times of the stages, `time.has_motion` and `time.reserve`. One kind of motion
        replaces the incumbent whatever it costs: a polynomial by rules with `polynomial_only` that
        need not be stretched. If S3 refuses such a polynomial, its reasons are added to the
        incumbent. While there is no motion, a path proposed for comparison gets only COMPARED_SHARE
        of the remaining time.

        Args:
            candidate: Proposal with the path.
            rules: Rules for the fit.

        Returns:
            The motion, if it has become the incumbent's or costs at most NEAR_BEST_COST_FACTOR
            times as much as the incumbent. If a polynomial by `polynomial_only` was refused, the
            incumbent's motion. Otherwise None.

        Raises:
            DeadlineError: The deadline of the plan passed.
            FitError: There is no motion yet, and the start steers: another way of coming to rest
                will do better than another path.
        """
        began, best, path = self._since, self._best, candidate.path
        deadline = self.time.deadline
        if best is None and candidate.for_comparison and self.time.has_deadline:
            deadline = deadline.earlier_by((1.0 - COMPARED_SHARE) * deadline.remaining)
        try:
            motion = self._fit(path, rules, deadline)
        except DeadlineError as error:
            if deadline == self.time.deadline:
                raise
            self._cut_short = error
            return None
        except FitError as error:
            self._refused = self._refused or error
            if best is None and self._is_steering:
                raise  # another way of coming to rest will help more than another path
            if best is None or not rules.polynomial_only:
                return None
            refused = error.refused + best.motion.refused
            self._best = replace(best, motion=replace(best.motion, refused=refused))
            return self._best.motion
        finally:
            self._charge_time("comparison" if candidate.for_comparison else "fit")
        plan = self._assemble_plan(
            path, motion, NO_DEADLINE if best is None else self.time.deadline
        )
        self._charge_time("comparison" if candidate.for_comparison else "energy")
        if best is None:
            self._seconds["first_motion"] = self._since - self._began
            self.time.has_motion = True
            took = (self._since - began) / (1 + len(motion.refused))
            self.time.reserve = max(self.time.reserve, took)
        published = rules.polynomial_only and motion.stretch <= 1.0
        if best is None or published or self._replaces(plan, best):
            self._best = plan
            return motion
        options = self._task.options
        return motion if plan.cost(options) <= NEAR_BEST_COST_FACTOR * best.cost(options) else None

    def _replaces(self, plan: Plan, best: Plan) -> bool:
        """Return whether a plan is sufficiently better than the incumbent to replace it.

        It must be cheaper. If another motion is to follow, it may take at most ALLOWED_DELAY_SHARE
        of the period longer. If the incumbent is the rest of the plan in force, the gain in cost
        must be at least the share WORTH_LEAVING.

        Args:
            plan: The plan.
            best: Incumbent.

        Returns:
            True if it replaces the incumbent.
        """
        options = self._task.options
        if not plan.is_cheaper_than(best, options):
            return False
        if (
            options.period > 0.0
            and plan.duration > best.duration + ALLOWED_DELAY_SHARE * options.period
        ):
            return False
        share = WORTH_LEAVING if best.motion.method == FitMethod.CONTINUED else 0.0
        return plan.cost(options) <= (1.0 - share) * best.cost(options)

    def _variant_rules(
        self, path: DiscretePath, motion: FittedMotion, rules: FitRules
    ) -> Iterator[FitRules]:
        """Yield rules for other motions along a path that may be cheaper than a given one.

        - For a ramped motion without braking: faster ramps and, if time has a weight, a faster last
          ramp.
        - For a polynomial that V_max stretches in time: following the path, if that is allowed.
        - For any motion but a polynomial that has more mode switches than its path: slower ramps,
          since inertia then calls for boost.

        If another motion is to follow, ramps are not varied.

        Args:
            path: The path.
            motion: Motion along the path.
            rules: Rules by which it was fitted.

        Yields:
            Rules for further fits.
        """
        followed = _following_rules(rules)
        varied = replace(followed, stepped=False, max_stretch=VARIED_STRETCH)
        stays = self._task.options.period == 0.0  # for a moving goal there is no time
        if stays and motion.method == FitMethod.RAMPED and not motion.braked:
            for faster in FASTER_RAMP_FACTORS:
                yield replace(varied, ramp_factors=(faster,))
            if self._task.options.weights.time > 0.0:
                yield replace(varied, last_ramp_factor=LAST_RAMP_FACTOR)
        if motion.method == FitMethod.POLYNOMIAL:
            if (
                motion.stretch > 1.0
                and not rules.polynomial_only
                and self._may_follow_instead(path, rules)
            ):
                yield followed
        elif stays and motion.schedule.switch_count > path.switches:
            for slower in SLOWER_RAMP_FACTORS:
                yield replace(varied, ramp_factors=(slower,))

    def _fit(self, path: DiscretePath, rules: FitRules, deadline: Deadline) -> FittedMotion:
        """Fit a motion to a path, or to coming to rest alone if the path has no steps.

        Args:
            path: The path.
            rules: Rules for the fit.
            deadline: Instant at which the fit is given up.

        Returns:
            Trajectory and mode schedule, with stamp 0, and the method of the fit.

        Raises:
            FitError: No motion keeps the limits.
            DeadlineError: The deadline passed.
        """
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

    def _assemble_plan(self, path: DiscretePath, motion: FittedMotion, deadline: Deadline) -> Plan:
        """Compute the energy and the area shortfall of a motion, and assemble its plan.

        Args:
            path: The path.
            motion: Motion along the path.
            deadline: Instant at which the computation is given up.

        Returns:
            Plan of path, motion, energy [J] and area shortfall [m]; without stage times,
            cavitations and start problems.

        Raises:
            DeadlineError: The deadline passed.
        """
        machine, area, shortfall = self._machine, self._task.area, 0.0
        deadline.check("the comparison of motions")
        energy = motion_energy(machine, motion.trajectory, motion.schedule, motion.profiles)
        if area.weight > 0.0:
            along = area_along_motion(machine, motion.trajectory, motion.schedule, deadline)
            shortfall = along.compute_area_loss(area.reference)
        return Plan(path, motion, energy, area_shortfall=shortfall)

    def _charge_time(self, stage: str) -> None:
        """Add the time since the last call to the time of a stage.

        Args:
            stage: Key in `Plan.seconds`.
        """
        now = perf_counter()
        self._seconds[stage] = self._seconds.get(stage, 0.0) + now - self._since
        self._since = now
