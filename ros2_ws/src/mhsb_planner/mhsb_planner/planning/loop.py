"""The planning loop: fits motions to proposed paths and keeps the cheapest.

A motion is a trajectory (stage S3 of the method) with its mode schedule (S4). It follows a discrete
path (S2) or is a polynomial between the path's ends. The best plan so far is the incumbent.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from time import perf_counter
from types import MappingProxyType
from typing import Any, NamedTuple

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.trajectory import Trajectory, standstill
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.errors import DeadlineError
from mhsb_planner.motion.cavitation import find_cavitations
from mhsb_planner.motion.energy import motion_energy
from mhsb_planner.motion.s3_state_to_rest import Steering
from mhsb_planner.motion.s3_trajectory import (
    FitError,
    FitMethod,
    FitRules,
    FittedMotion,
    fit_braking,
    fit_rest,
    fit_trajectory,
)
from mhsb_planner.plan import Plan
from mhsb_planner.plan_log import PlanLog, ProposalOutcome
from mhsb_planner.planners.path_planner import PathProposal, PathRequest
from mhsb_planner.planning.motion_rules import (
    describe_rules,
    fit_rules,
    following_rules,
    yield_variant_rules,
)
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.manipulability_loss import area_along_motion

MIN_MOTION_COST_RATIO = 0.85
"""Smallest expected ratio of a motion's cost to its path's cost without switches [-]. A path is
skipped if this ratio times its cost without switches exceeds the incumbent's cost.
"""

NEAR_BEST_COST_FACTOR = 1.03
"""Largest ratio of a motion's cost to the incumbent's at which other motions along its path are
tried.
"""

COMPARED_SHARE = 1.0 / 3.0
"""Share of the remaining time that fitting a path proposed for comparison may take before there is
a motion. If fitting takes long, the motion is long, and the own search will find a shorter path.
"""

MIN_REPLACEMENT_GAIN = 0.02
"""Relative gain in cost from which another motion replaces the remaining plan in force."""

MIN_PATH_COST_RATIO = 0.8
"""Ratio of a path's cost to the incumbent's below which motions cannot keep up with paths [-]."""

ALLOWED_DELAY_SHARE = 0.1
"""Additional duration that a cheaper motion may have if another is to follow, as a share of the
period.
"""


class PostponedVariants(NamedTuple):
    """Other motions along the first path, which wait until the next path has its motion.

    Attributes:
        proposal: Proposal of the first path.
        motion: Motion along it.
        rules: Rules by which that was fitted.
        cost: Cost of the incumbent when they were postponed, which is that of `motion` [-].
    """

    proposal: PathProposal
    motion: FittedMotion
    rules: FitRules
    cost: float


class PlanningLoop:
    """Loop over the proposals for one request; the cheapest motion so far is the incumbent.

    Attributes:
        progress: Progress of the plan, which the proposers read. The loop sets its `has_motion` and
            `reserve`.
    """

    def __init__(
        self, machine: Machine, task: PathRequest, deadline: Deadline, log: PlanLog
    ) -> None:
        """Prepare the loop, without an incumbent (best plan so far).

        Args:
            machine: The whole arm.
            task: The request.
            deadline: Instant at which the plan is due.
            log: Log, to which the loop and the proposers of paths add entries.
        """
        self._machine, self._task = machine, task
        self.progress = PlanProgress(deadline, log=log)
        self._best: Plan | None = None
        self._refused: FitError | None = None
        self._cheapest_path_cost = math.inf
        self._cut_short: DeadlineError | None = None
        self._postponed: PostponedVariants | None = None
        self._seconds = {"search": 0.0, "fit": 0.0, "energy": 0.0}
        self._since = log.began

    def start_with_rest(self, rest: Trajectory) -> None:
        """Make the remainder of the plan in force the first incumbent (best plan so far).

        A remainder that breaks a limit is not used: there is no incumbent yet, and the log contains
        the reason. In both cases the time since the request is stored in `first_motion` of the
        plan's times.

        Args:
            rest: Remainder of the plan in force, with stamp 0.
        """
        task, log = self._task, self.progress.log
        rules = fit_rules(task.options)
        try:
            motion = fit_rest(self._machine, rest, task.modes, rules, self.progress.deadline)
            tip, end = self._machine.tip_position(rest.position[-1]), rest.position[-1]
            path = DiscretePath.create_without_steps(tip, end, task.modes.modes, 0.0)
            self._best = self._assemble_plan(path, motion, NO_DEADLINE)
            self.progress.has_motion = True
            cost = self._best.cost(task.options)
            log.add("plan in force", ProposalOutcome.TAKEN, motion_cost=cost)
        except (FitError, DeadlineError) as error:
            log.add("plan in force", ProposalOutcome.REFUSED, reason=str(error))
        self._charge_time("fit")
        self._seconds["first_motion"] = self._since - log.began

    def choose_best(self, proposals: Iterable[PathProposal]) -> Plan:
        """Fit motions to proposed paths, and return the cheapest as a plan.

        An error of the proposers, or the deadline, ends the loop. It is raised only if there is no
        motion. Variants of the first motion that were postponed are tried before the loop ends.

        Args:
            proposals: Path proposals, requested one after the other.

        Returns:
            The plan with its log, its cavitations and the times of its stages [s]. The statistics
            of its path say whether the time ran out.

        Raises:
            FitError: No path has a motion that keeps the limits; the error is the one for the first
                path.
            DeadlineError: The time was up before there was a motion.
            MhsbError: A proposer has failed, and there is no motion.
            ValueError: There was no proposal and no error, which is a fault of the planner.
        """
        in_time = True
        try:
            for proposal in proposals:
                self._charge_time("comparison" if proposal.for_comparison else "search")
                self._consider(proposal)
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
        out_of_time = not in_time or self.progress.search_deadline.has_passed
        statistics = replace(path.statistics, out_of_time=out_of_time)
        return replace(
            self._best,
            path=replace(path, statistics=statistics),
            cavitations=find_cavitations(self._machine, self._best.motion.trajectory),
            seconds=MappingProxyType(self._seconds),
            log=self.progress.log,
        )

    def _no_motion_error(self) -> Exception:
        """Create the error that explains why no path has a motion.

        Running out of time comes first, since other paths might have had one.

        Returns:
            DeadlineError if the time was up, else the FitError of the first path. ValueError if
            there was no path at all, which is a fault of the planner.
        """
        if self._cut_short is None and self.progress.search_deadline.has_passed:
            return DeadlineError("making motions of paths")
        unsaid = ValueError("a planner that gives no path must say why")
        return self._cut_short or self._refused or unsaid

    def _consider(self, proposal: PathProposal) -> None:
        """Fit motions to a path, and keep each that beats the incumbent (best plan so far).

        The path is skipped if MIN_MOTION_COST_RATIO times its cost, counted without mode switches,
        exceeds the incumbent's cost. Otherwise one motion is fitted to it by the rules of
        `fit_rules`. Variants of that motion follow if it costs at most NEAR_BEST_COST_FACTOR times
        as much as the incumbent.

        Two exceptions serve to find a first motion early:

        - If there is no incumbent and the rules ask for a polynomial, the path is first followed by
          ramps, if that is allowed. Ramps are faster to fit. The polynomial then becomes the
          incumbent whatever it costs, unless it has to be stretched in time.
        - With a deadline, the variants of the first motion wait for the next path, or for the end
          of the proposals. They take several times as long as that motion and lower the cost less.

        If the path is not skipped, `progress.is_held_back` is set: True if the cheapest path so far
        costs less than MIN_PATH_COST_RATIO times the incumbent, or there is no incumbent.

        Args:
            proposal: The proposal.

        Raises:
            DeadlineError: The deadline of the plan passed.
            FitError: No motion along the path is possible, and there is no motion yet. It is raised
                only if one curve must lead from a moving start to the goal.
        """
        path, options, best = proposal.path, self._task.options, self._best
        estimate = path.cost - options.weights.switches * path.switches
        if best is not None and MIN_MOTION_COST_RATIO * estimate > best.cost(options):
            self._log(proposal, ProposalOutcome.SKIPPED)
            return
        rules, followed = fit_rules(options, proposal.trajectory), None
        if best is None and self._may_follow_instead(path, rules):  # faster to fit
            followed = self._fit_and_keep(proposal, following_rules(rules))
            rules = replace(rules, polynomial_only=followed is not None)
        motion = self._fit_and_keep(proposal, rules) or followed
        if path.steps > 0:
            self._cheapest_path_cost = min(self._cheapest_path_cost, path.cost)
        incumbent_cost = math.inf if self._best is None else self._best.cost(options)
        self.progress.is_held_back = self._cheapest_path_cost < MIN_PATH_COST_RATIO * incumbent_cost
        if motion is not None and best is None and self.progress.has_deadline and self._best:
            cost = self._best.cost(options)
            self._postponed = PostponedVariants(proposal, motion, rules, cost)
            return
        self._try_postponed_variants()
        if motion is not None:
            self._try_variants(proposal, motion, rules)

    def _try_postponed_variants(self) -> None:
        """Try the postponed variants of the first motion, if there are any, and forget them.

        They are dropped untried if the first motion costs more than NEAR_BEST_COST_FACTOR times as
        much as the present incumbent (best plan so far).

        Raises:
            DeadlineError: The deadline of the plan passed.
        """
        postponed, best = self._postponed, self._best
        if postponed is None or best is None:
            return
        self._postponed = None
        if postponed.cost <= NEAR_BEST_COST_FACTOR * best.cost(self._task.options):
            self._try_variants(postponed.proposal, postponed.motion, postponed.rules)

    def _try_variants(self, proposal: PathProposal, motion: FittedMotion, rules: FitRules) -> None:
        """Fit variants of a motion to its path, and keep each that is better than the incumbent.

        The incumbent is the best plan so far. A motion has a list of reasons why S3 (trajectory
        stage) refused other curves. If a variant becomes the incumbent, the reasons of the first
        motion are put before its own.

        Args:
            proposal: Proposal with the path.
            motion: Motion along the path.
            rules: Rules by which it was fitted.

        Raises:
            DeadlineError: The deadline of the plan passed.
        """
        path, may_follow = proposal.path, self._may_follow_instead(proposal.path, rules)
        for other in yield_variant_rules(
            path, motion, rules, self._task.options, may_follow=may_follow
        ):
            before = self._best
            if self._fit_and_keep(proposal, other) is not None and self._best is not before:
                assert self._best is not None
                self._set_refused(motion.refused + self._best.motion.refused)

    def _may_follow_instead(self, path: DiscretePath, rules: FitRules) -> bool:
        """Return whether a path may be followed instead of a polynomial that the rules ask for.

        Args:
            path: The path. Only `steps` is read.
            rules: Rules for its motion. Only `trajectory` is read.

        Returns:
            True if four conditions hold. The rules ask for a polynomial. The options leave the
            method of S3 (trajectory stage) open. The path has steps. The start does not steer, that
            is, no single curve from a moving start to the goal is asked for.
        """
        free = self._task.options.trajectory is None and path.steps > 0
        return free and rules.trajectory == "polynomial" and not self._is_steering

    @property
    def _is_steering(self) -> bool:
        """True if the start moves and the request asks for one curve from there to the goal.

        `Planner` asks for it if the plan in force ends soon and near the goal.
        """
        return isinstance(self._task.brake, Steering)

    def _fit_and_keep(self, proposal: PathProposal, rules: FitRules) -> FittedMotion | None:
        """Fit a motion to a path, and make it the incumbent (best plan so far) if it is better.

        `_replaces` decides what is better. Times of the stages, log, and `has_motion` and `reserve`
        of the progress are updated.

        Rules with `polynomial_only` ask for the published polynomial along the incumbent's path. It
        becomes the incumbent whatever it costs, unless it has to be stretched in time. If S3
        (trajectory stage) refuses it, the reasons are added to the incumbent.

        Args:
            proposal: Proposal with the path.
            rules: Rules for the fit.

        Returns:
            A motion whose variants are worth a try, or None:

            - The fitted motion, if it is the incumbent now or costs at most NEAR_BEST_COST_FACTOR
              times as much.
            - The incumbent's motion, if a polynomial by `polynomial_only` was refused.

        Raises:
            DeadlineError: The deadline of the plan passed.
            FitError: S3 refuses the path, there is no motion yet, and one curve must lead from a
                moving start to the goal. `Planner` then tries another way of coming to rest.
        """
        began, best, options = self._since, self._best, self._task.options
        motion = self._fit(proposal, rules)
        if motion is None:
            return best.motion if best is not None and rules.polynomial_only else None
        plan = self._assemble_plan(
            proposal.path, motion, NO_DEADLINE if best is None else self.progress.deadline
        )
        self._charge_time("comparison" if proposal.for_comparison else "energy")
        if best is None:
            self._seconds["first_motion"] = self._since - self.progress.log.began
            self.progress.has_motion = True
            took = (self._since - began) / (1 + len(motion.refused))
            self.progress.reserve = max(self.progress.reserve, took)
        published = rules.polynomial_only and motion.stretch <= 1.0
        cost = plan.cost(options)
        if best is None or published or self._replaces(plan, best):
            self._log(proposal, ProposalOutcome.TAKEN, rules, motion_cost=cost)
            self._best = plan
            return motion
        self._log(proposal, ProposalOutcome.DEARER, rules, motion_cost=cost)
        return motion if cost <= NEAR_BEST_COST_FACTOR * best.cost(options) else None

    def _replaces(self, plan: Plan, best: Plan) -> bool:
        """Return whether a plan is sufficiently better than the incumbent (best plan so far).

        It must be cheaper. Two more conditions hold in special cases:

        - If goals follow each other with a period, it may take at most ALLOWED_DELAY_SHARE times
          the period longer than the incumbent.
        - If the incumbent is the remainder of the plan in force, it must be cheaper by at least
          MIN_REPLACEMENT_GAIN times the incumbent's cost.

        Args:
            plan: The plan.
            best: Incumbent.

        Returns:
            True if the plan replaces the incumbent.
        """
        options = self._task.options
        if not plan.is_cheaper_than(best, options):
            return False
        if (
            options.period > 0.0
            and plan.duration > best.duration + ALLOWED_DELAY_SHARE * options.period
        ):
            return False
        share = MIN_REPLACEMENT_GAIN if best.motion.method == FitMethod.CONTINUED else 0.0
        return plan.cost(options) <= (1.0 - share) * best.cost(options)

    def _fit(self, proposal: PathProposal, rules: FitRules) -> FittedMotion | None:
        """Fit a motion to a path, and log the reason if there is none.

        While there is no motion yet, a path of a baseline (planner to compare with) must not delay
        the first one. If the plan has a deadline, the fit of that path may therefore take only
        COMPARED_SHARE of the time that remains.

        Args:
            proposal: Proposal with the path.
            rules: Rules for the fit.

        Returns:
            The motion; None if S3 (trajectory stage) refuses the path, or that share of the time is
            up.

        Raises:
            DeadlineError: The deadline of the plan passed.
            FitError: S3 refuses the path and there is no motion yet. It is raised only if one curve
                must lead from a moving start to the goal; else None is returned.
        """
        best, deadline = self._best, self.progress.deadline
        if best is None and proposal.for_comparison and self.progress.has_deadline:
            deadline = deadline.earlier_by((1.0 - COMPARED_SHARE) * deadline.remaining)
        try:
            return self._fit_by(proposal.path, rules, deadline)
        except DeadlineError as error:
            self._log(proposal, ProposalOutcome.TOO_LATE, rules, reason=str(error))
            if deadline == self.progress.deadline:
                raise
            self._cut_short = error
        except FitError as error:
            self._log(proposal, ProposalOutcome.REFUSED, rules, reason=error.refused[-1])
            self._refused = self._refused or error
            if best is None and self._is_steering:
                raise
            if best is not None and rules.polynomial_only:
                self._set_refused(error.refused + best.motion.refused)
        finally:
            self._charge_time("comparison" if proposal.for_comparison else "fit")
        return None

    def _fit_by(self, path: DiscretePath, rules: FitRules, deadline: Deadline) -> FittedMotion:
        """Fit a motion to a path; for a path without steps, only bring the start to rest.

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
        task, machine = self._task, self._machine
        if path.steps == 0:
            brake = task.brake or standstill(task.start.position)
            brake = brake if isinstance(brake, Trajectory) else brake.trajectory
            return fit_braking(machine, brake, task.modes)
        return fit_trajectory(machine, path, task.start, task.modes, task.brake, rules, deadline)

    def _assemble_plan(self, path: DiscretePath, motion: FittedMotion, deadline: Deadline) -> Plan:
        """Compute the energy and the manipulability loss of a motion, and assemble its plan.

        The manipulability loss is computed only if its weight is above 0; else it is 0. It is the
        share of the reference area that the velocity polytope lacks, integrated over the length of
        the tip's path. Its unit is therefore m.

        Args:
            path: The path.
            motion: Motion along the path.
            deadline: Instant at which the computation is given up.

        Returns:
            Plan of path, motion, energy [J] and manipulability loss [m]. Its other fields keep
            their defaults.

        Raises:
            DeadlineError: The deadline passed.
        """
        machine, area, shortfall = self._machine, self._task.area, 0.0
        deadline.check("the comparison of motions")
        energy = motion_energy(machine, motion.trajectory, motion.schedule, motion.profiles)
        if area.weight > 0.0:
            along = area_along_motion(machine, motion.trajectory, motion.schedule, deadline)
            shortfall = along.compute_area_loss(area.reference)
        return Plan(path, motion, energy, machine, area_shortfall=shortfall)

    def _set_refused(self, refused: tuple[str, ...]) -> None:
        """Replace the incumbent's list of reasons why S3 (trajectory stage) refused curves.

        The incumbent is the best plan so far; there must be one.

        Args:
            refused: One sentence for each curve.
        """
        assert self._best is not None
        motion = replace(self._best.motion, refused=refused)
        self._best = replace(self._best, motion=motion)

    def _log(
        self,
        proposal: PathProposal,
        outcome: ProposalOutcome,
        rules: FitRules | None = None,
        **values: Any,
    ) -> None:
        """Add an entry on a proposal to the log.

        Args:
            proposal: The proposal.
            outcome: Its outcome.
            rules: Rules of the motion; None: no motion was fitted.
            **values: Further fields of `LogEntry`.
        """
        motion = "" if rules is None else describe_rules(rules)
        self.progress.log.add(proposal.proposer, outcome, proposal.path.cost, motion, **values)

    def _charge_time(self, stage: str) -> None:
        """Add the time since the last call, or since the request, to the time of a stage.

        Args:
            stage: Key in `Plan.seconds`.
        """
        now = perf_counter()
        self._seconds[stage] = self._seconds.get(stage, 0.0) + now - self._since
        self._since = now
