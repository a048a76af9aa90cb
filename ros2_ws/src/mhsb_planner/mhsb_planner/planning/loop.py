"""The planning loop, which fits motions to proposed paths and keeps the cheapest motion.

A motion is a trajectory (made by S3) with a mode schedule (made by S4). It follows a discrete path,
or it is a polynomial between the path's ends. The cheapest plan so far is the incumbent.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from time import perf_counter
from types import MappingProxyType
from typing import Any, NamedTuple

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.trajectory import Trajectory, standstill
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.errors import DeadlineError, NoPathError
from mhsb_planner.motion.cavitation import find_cavitations
from mhsb_planner.motion.fitted_motion import FittedMotion
from mhsb_planner.motion.s3_state_to_rest import Steering
from mhsb_planner.motion.s3_trajectory import (
    FitError,
    FitMethod,
    FitRules,
    fit_braking,
    fit_remainder,
    fit_trajectory,
)
from mhsb_planner.plan import Plan
from mhsb_planner.plan_log import PlanLog, ProposalOutcome
from mhsb_planner.planners.path_planner import UNEXPLAINED_END, PathProposal, PathRequest
from mhsb_planner.planning.motion_rules import (
    describe_rules,
    fit_rules,
    following_rules,
    list_variant_rules,
)
from mhsb_planner.progress import PlanProgress
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.manipulability_loss import compute_area_along_motion

MIN_MOTION_COST_RATIO = 0.92
"""Smallest expected ratio of a motion's cost to its path's cost without mode switches [-]. A path
is skipped if this ratio times the path's cost without mode switches exceeds the incumbent's cost.
The smallest ratio in 3,254 motions on 165 random moves of five machines was 0.934. With a smaller
value, more motions are fitted in vain.

The same number is the least ratio of the cheapest path's cost to the incumbent's cost at which the
incumbent counts as near that path. Otherwise slower paths are always searched.
"""

NEAR_BEST_COST_FACTOR = 1.03
"""Variants of a motion are fitted if its cost is at most this factor times the incumbent's cost
[-].
"""

COMPARED_SHARE = 1.0 / 3.0
"""Share of the remaining time for fitting a motion to a baseline's path while there is no motion
[-]. If a fit takes longer, the motion is long, and the planner's own search will find a shorter
path.
"""

MIN_REPLACEMENT_GAIN = 0.02
"""Least saving for which another motion replaces the remainder of the plan in force, as a share of
the remainder's cost [-].
"""

MIN_SLOWER_GAIN = 0.01
"""Least expected gain for which slower paths are searched, as a share of the incumbent's cost [-].
"""

ALLOWED_DELAY_SHARE = 0.1
"""Largest additional duration of a cheaper motion, as a share of the period of the goals [-]."""


class PostponedVariants(NamedTuple):
    """First motion whose variants (motions by other rules) are to be fitted after the next path.

    Attributes:
        proposal: Proposal of the first path.
        motion: Motion along the path.
        rules: Rules by which `motion` was fitted.
        cost: Cost of the plan with `motion` [-].
    """

    proposal: PathProposal
    motion: FittedMotion
    rules: FitRules
    cost: float


class PlanningLoop:
    """Loop over the proposals for one request, for one call of `choose_best`.

    Attributes:
        progress: State of the loop that the proposers read, such as `has_motion`. Only the loop
            changes it.
    """

    def __init__(
        self, machine: Machine, request: PathRequest, deadline: Deadline, log: PlanLog
    ) -> None:
        """Prepare the loop, without an incumbent (best plan so far).

        Args:
            machine: The whole arm.
            request: The request.
            deadline: Instant at which the plan is due.
            log: Log, to which the loop and the proposers of paths add entries.
        """
        self._machine, self._request = machine, request
        self.progress = PlanProgress(deadline, log=log)
        self._best: Plan | None = None
        self._refused: FitError | None = None
        self._cheapest_path_cost = math.inf
        self._cut_short: DeadlineError | None = None
        self._postponed: PostponedVariants | None = None
        self._seconds = {"search": 0.0, "fit": 0.0, "energy": 0.0}
        self._since = log.began

    def start_with_remainder(self, remainder: Trajectory) -> None:
        """Make the remainder of the plan in force the first incumbent (best plan so far).

        It must be called before `choose_best`. If the remainder breaks a limit or the deadline has
        passed, there is no incumbent, and the reason is logged. Even then, the time since the
        request is stored as the time of the first motion.

        Args:
            remainder: Remainder of the plan in force, with stamp 0.
        """
        request, log = self._request, self.progress.log
        rules = fit_rules(request.options)
        try:
            motion = fit_remainder(
                self._machine, remainder, request.modes, rules, self.progress.deadline
            )
            end = remainder.position[-1]
            path = DiscretePath.create_without_steps(
                self._machine.tip_position(end), end, request.modes.modes, 0.0
            )
            cost = self._keep(self._assemble_plan(path, motion, NO_DEADLINE))
            log.add("plan in force", ProposalOutcome.TAKEN, motion_cost=cost)
        except (FitError, DeadlineError) as error:
            log.add("plan in force", ProposalOutcome.REFUSED, reason=str(error))
        self._charge_time("fit")
        self._seconds["first_motion"] = self._since - log.began

    def choose_best(self, proposals: Iterable[PathProposal]) -> Plan:
        """Fit motions to proposed paths, and return the plan with the cheapest motion.

        An error of a proposer, or the deadline, ends the loop. The error is raised only if there is
        no motion; otherwise it is logged, and the incumbent is returned.

        Args:
            proposals: Path proposals, requested one after the other.

        Returns:
            The plan, with log, cavitations and times of its stages [s]. `out_of_time` of its path's
            statistics says whether the time ran out.

        Raises:
            FitError: No path has a motion within the limits; the error of the first path is raised.
            DeadlineError: The time was up before there was a motion.
            Exception: A proposer has failed, and there is no motion; the proposer's error is
                raised.
            ValueError: The planner proposed nothing and raised nothing, which is a fault of the
                planner.
        """
        in_time = True
        try:
            for proposal in self._yield_until_failure(proposals):
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
            self._log_failure(error)
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

    def _yield_until_failure(self, proposals: Iterable[PathProposal]) -> Iterator[PathProposal]:
        """Yield proposals until their source ends or fails.

        If it fails and there is a motion, the error is logged and the proposals end.

        Args:
            proposals: Path proposals, requested one after the other.

        Yields:
            The proposals.

        Raises:
            DeadlineError: The source had no more time, with or without a motion.
            Exception: The source has failed, and there is no motion. Errors have any type.
        """
        try:
            yield from proposals
        except Exception as error:  # a planner of a user's own may raise errors of any type
            if self._best is None:
                raise
            self._log_failure(error)
            if isinstance(error, DeadlineError):
                raise

    def _log_failure(self, error: Exception) -> None:
        """Log an error that ended the planner after a motion had been found.

        Args:
            error: The error. The outcome is NO_PATH for a NoPathError or DeadlineError, because the
                planner only found no further path. It is FAILED for any other error.
        """
        has_ended = isinstance(error, NoPathError | DeadlineError)
        outcome = ProposalOutcome.NO_PATH if has_ended else ProposalOutcome.FAILED
        self.progress.log.add_failure(self._request.options.planner, error, outcome)

    def _no_motion_error(self) -> Exception:
        """Return the error that explains why no path has a motion.

        Returns:
            DeadlineError if the time was up, because other paths might have had a motion. Otherwise
            the FitError of the first path. ValueError if there was no path, which is a fault of the
            planner.
        """
        if self._cut_short is None and self.progress.search_deadline.has_passed:
            return DeadlineError("making motions of paths")
        return self._cut_short or self._refused or ValueError(UNEXPLAINED_END)

    def _consider(self, proposal: PathProposal) -> None:
        """Fit a motion to a path and, if it is promising, its variants; keep the best motion.

        1. The path is skipped if MIN_MOTION_COST_RATIO times its cost without mode switches exceeds
           the cost of the incumbent (best plan so far).
        2. One motion is fitted: a polynomial, or a motion that follows the path, depending on
           options, path and planner (`fit_rules`). If it is to be a polynomial and there is no
           incumbent, a motion that follows the path is fitted first, because this is faster. The
           polynomial then replaces this motion even if it costs more, unless the polynomial had to
           be slowed to keep the limits.
        3. If the motion costs at most NEAR_BEST_COST_FACTOR times as much as the incumbent,
           variants of the motion are fitted, such as one with faster ramps. With a deadline, the
           variants of the first motion wait until the next path has its motion.

        After step 2, `progress.min_speed_factor` is set (`_estimate_min_speed_factor`).

        Args:
            proposal: The proposal.

        Raises:
            DeadlineError: The deadline of the plan passed.
            FitError: The path has no motion, there is no incumbent, and one curve must lead from
                the moving start to the goal (`_is_steering`).
        """
        path, options, best = proposal.path, self._request.options, self._best
        switches = path.switches + path.holding_switches
        estimate = path.cost - options.weights.switches * switches
        if estimate > self.progress.max_path_cost:
            self._log(proposal, ProposalOutcome.SKIPPED)
            return
        rules, followed = fit_rules(options, proposal.trajectory), None
        if best is None and self._may_follow_instead(path, rules):  # faster to fit
            followed = self._fit_and_keep(proposal, following_rules(rules))
            rules = replace(rules, polynomial_only=followed is not None)
        motion = self._fit_and_keep(proposal, rules) or followed
        if path.steps > 0:
            self._cheapest_path_cost = min(self._cheapest_path_cost, path.cost)
        self.progress.min_speed_factor = self._estimate_min_speed_factor()
        if motion is not None and best is None and self.progress.has_deadline and self._best:
            cost = self._best.cost(options)
            self._postponed = PostponedVariants(proposal, motion, rules, cost)
            return
        self._try_postponed_variants()
        if motion is not None:
            self._try_variants(proposal, motion, rules)

    def _estimate_min_speed_factor(self) -> float:
        """Estimate the factor on V_max below which slower motions will not be cheaper.

        At f times its speed, the incumbent's path takes up to 1/f times as long and leaks up to 1/f
        times as much. Slowing saves at most the cost of boosts and mode switches. So the slower
        motion may be cheaper if

            L (1/f − 1) < S,   that is   f > L/(L + S)

        L is the cost of leakage and time during the incumbent's path, without its ramps (changes of
        speed) [-]. S is the cost of boosts and mode switches, less the gain that is worth a search
        (MIN_SLOWER_GAIN) [-].

        Returns:
            L / (L + S) times the incumbent's largest piston speed over V_max, at most 1 [-]. It is
            1 if S is not positive. It is 0 if there is no incumbent (best plan so far), or if the
            incumbent costs much more than the cheapest path (MIN_MOTION_COST_RATIO).
        """
        best, options = self._best, self._request.options
        cost = math.inf if best is None else best.cost(options)
        if best is None or self._cheapest_path_cost < MIN_MOTION_COST_RATIO * cost:
            return 0.0
        weights, energy, path = options.weights, best.energy, best.path
        boosts = max(0.0, best.chosen_energy(options) - energy.main_pump)
        saved = weights.energy * boosts + weights.switches * best.motion.scheduled.switch_count
        saved -= MIN_SLOWER_GAIN * cost
        lost = weights.energy * energy.leakage + weights.time * best.duration
        if path.steps > 0:
            lost *= min(1.0, float(path.duration.sum()) / best.duration)
        speed = min(1.0, 1.0 + best.motion.speed_excess)
        return speed * lost / (lost + saved) if saved > 0.0 else 1.0

    def _try_postponed_variants(self) -> None:
        """Fit the postponed variants of the first motion, if there are any; do so only once.

        Variants are motions along the same path by other rules. They are not fitted if the first
        motion costs more than NEAR_BEST_COST_FACTOR times as much as the incumbent (best plan so
        far).

        Raises:
            DeadlineError: The deadline of the plan passed.
        """
        postponed, best = self._postponed, self._best
        if postponed is None or best is None:
            return
        self._postponed = None
        if postponed.cost <= NEAR_BEST_COST_FACTOR * best.cost(self._request.options):
            self._try_variants(postponed.proposal, postponed.motion, postponed.rules)

    def _try_variants(self, proposal: PathProposal, motion: FittedMotion, rules: FitRules) -> None:
        """Fit the variants of a motion to its path, and keep each that beats the incumbent.

        The incumbent is the best plan so far. Variants are motions by other rules, such as faster
        ramps (`list_variant_rules`). The variants come in groups; in a group, the trials end as
        soon as a variant becomes the incumbent. The list `refused` of a motion has the curves that
        its fit refused, with reasons. If a variant becomes the incumbent, its list begins with the
        list of `motion`.

        Args:
            proposal: Proposal with the path.
            motion: Motion along the path.
            rules: Rules by which `motion` was fitted.

        Raises:
            DeadlineError: The deadline of the plan passed.
        """
        path, may_follow = proposal.path, self._may_follow_instead(proposal.path, rules)
        for group in list_variant_rules(
            path, motion, rules, self._request.options, may_follow=may_follow
        ):
            for other in group:
                before = self._best
                if self._fit_and_keep(proposal, other) is not None and self._best is not before:
                    assert self._best is not None
                    self._set_refused(motion.refused + self._best.motion.refused)
                    break

    def _may_follow_instead(self, path: DiscretePath, rules: FitRules) -> bool:
        """Return whether a path may be followed although the rules ask for a polynomial.

        Args:
            path: The path. Only `steps` is read.
            rules: Rules for its motion. Only `trajectory` is read.

        Returns:
            True if the rules ask for a polynomial, the options name no method, and the path has
            steps. Always False if one curve must lead from the moving start to the goal
            (`_is_steering`).
        """
        free = self._request.options.trajectory is None and path.steps > 0
        return free and rules.trajectory == "polynomial" and not self._is_steering

    @property
    def _is_steering(self) -> bool:
        """True if one curve must lead from the moving start to the goal.

        `Planner` requests this if the plan in force ends soon and near the goal.
        """
        return isinstance(self._request.brake, Steering)

    def _fit_and_keep(self, proposal: PathProposal, rules: FitRules) -> FittedMotion | None:
        """Fit a motion to a path, and make its plan the incumbent if it is better.

        The incumbent is the best plan so far. Better means cheaper, with stricter rules for goals
        with a period and for a plan in force (`_replaces`). Rules with `polynomial_only` ask for a
        polynomial along the incumbent's path. This polynomial becomes the incumbent even if it
        costs more, unless it had to be slowed to keep the limits. If it is refused, the incumbent's
        `refused` gets the reasons.

        The method also updates the log and the times of the stages. The first motion sets
        `progress.has_motion` and `progress.reserve` [s], the time that is kept for fitting a motion
        to the last path found.

        Args:
            proposal: Proposal with the path.
            rules: Rules for the fit.

        Returns:
            A motion whose variants (motions along its path by other rules) should be tried, or
            None:

            - The fitted motion, if it is now the incumbent or costs at most NEAR_BEST_COST_FACTOR
              times as much as the incumbent.
            - The incumbent's motion, if a polynomial by `polynomial_only` was refused.

        Raises:
            DeadlineError: The deadline of the plan passed.
            FitError: The path has no motion, there is no incumbent, and one curve must lead from
                the moving start to the goal (`_is_steering`).
        """
        began, best, options = self._since, self._best, self._request.options
        motion = self._fit(proposal, rules)
        if motion is None:
            return best.motion if best is not None and rules.polynomial_only else None
        plan = self._assemble_plan(
            proposal.path, motion, NO_DEADLINE if best is None else self.progress.deadline
        )
        self._charge_time("comparison" if proposal.for_comparison else "energy")
        if best is None:
            self._seconds["first_motion"] = self._since - self.progress.log.began
            took = (self._since - began) / (1 + len(motion.refused))
            self.progress.reserve = max(self.progress.reserve, took)
        published = rules.polynomial_only and motion.stretch <= 1.0
        cost = plan.cost(options)
        if best is None or published or self._replaces(plan, best):
            self._log(proposal, ProposalOutcome.TAKEN, rules, motion_cost=cost)
            self._keep(plan)
            return motion
        self._log(proposal, ProposalOutcome.DEARER, rules, motion_cost=cost)
        return motion if cost <= NEAR_BEST_COST_FACTOR * best.cost(options) else None

    def _keep(self, plan: Plan) -> float:
        """Make a plan the incumbent (best plan so far), and update `progress` for the searches.

        `has_motion` becomes True, and `max_path_cost` the cost divided by MIN_MOTION_COST_RATIO.

        Args:
            plan: The plan.

        Returns:
            Its cost [-].
        """
        cost = plan.cost(self._request.options)
        self._best = plan
        self.progress.has_motion = True
        self.progress.max_path_cost = cost / MIN_MOTION_COST_RATIO
        return cost

    def _replaces(self, plan: Plan, best: Plan) -> bool:
        """Return whether a plan is sufficiently better than the incumbent to replace it.

        The plan must be cheaper. Two more conditions apply in special cases:

        - If goals follow each other with a period: the plan lasts longer than the incumbent by at
          most ALLOWED_DELAY_SHARE times the period.
        - If the incumbent is the remainder of the plan in force: the plan saves at least
          MIN_REPLACEMENT_GAIN times the incumbent's cost.

        Args:
            plan: The plan.
            best: Incumbent.

        Returns:
            True if the plan replaces the incumbent.
        """
        options = self._request.options
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
        """Fit a motion to a path within the time allowed, and log the reason if there is none.

        The fit may take all the remaining time. If there is no motion yet and the path is for
        comparison, it may take only COMPARED_SHARE of this time. The time is added to a stage's
        time. If a polynomial by `polynomial_only` is refused, the incumbent's `refused` gets the
        reasons.

        Args:
            proposal: Proposal with the path.
            rules: Rules for the fit.

        Returns:
            The motion. None if no motion keeps the limits; `_refused` then has the first such
            error. Also None if the share of the time is over; `_cut_short` then has the error.

        Raises:
            DeadlineError: The deadline of the plan passed.
            FitError: The path has no motion, no plan has been found before, and one curve must lead
                from the moving start to the goal (`_is_steering`).
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
        """Fit a motion to a path by S3. If the path has no steps, the motion only brakes to rest.

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
        request, machine = self._request, self._machine
        if path.steps == 0:
            brake = request.brake or standstill(request.start.position)
            brake = brake if isinstance(brake, Trajectory) else brake.trajectory
            return fit_braking(machine, brake, request.modes)
        return fit_trajectory(
            machine, path, request.start, request.modes, request.brake, rules, deadline
        )

    def _assemble_plan(self, path: DiscretePath, motion: FittedMotion, deadline: Deadline) -> Plan:
        """Compute the energy and the manipulability loss of a motion, and assemble its plan.

        The manipulability loss M [m] is the share of the reference area that the velocity polytope
        lacks, integrated over the tip's path. If the weight of M is 0, M is not computed and stays
        0.

        Args:
            path: The path.
            motion: Motion along the path.
            deadline: Instant at which the computation is given up; NO_DEADLINE for a first motion.

        Returns:
            Plan of path, motion, energy [J] and manipulability loss [m]. Its other fields keep
            their defaults.

        Raises:
            DeadlineError: The deadline passed.
        """
        machine, area, shortfall = self._machine, self._request.area, 0.0
        deadline.check("the comparison of motions")
        if area.weight > 0.0:
            along = compute_area_along_motion(machine, motion.trajectory, motion.schedule, deadline)
            shortfall = along.compute_area_loss(area.reference)
        reading = self._request.options.energy_reading
        return Plan(path, motion, motion.energy, machine, reading, area_shortfall=shortfall)

    def _set_refused(self, refused: tuple[str, ...]) -> None:
        """Replace the incumbent's list of reasons why curves were refused in its fit.

        There must be an incumbent (best plan so far).

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
            outcome: Outcome of the proposal.
            rules: Rules of the motion; None if no motion was fitted.
            **values: Further fields of `LogEntry`.
        """
        motion = "" if rules is None else describe_rules(rules)
        self.progress.log.add(proposal.proposer, outcome, proposal.path.cost, motion, **values)

    def _charge_time(self, stage: str) -> None:
        """Add the time since the previous call to the time of a stage.

        The first call adds the time since the request.

        Args:
            stage: Key in `Plan.seconds`.
        """
        now = perf_counter()
        self._seconds[stage] = self._seconds.get(stage, 0.0) + now - self._since
        self._since = now
