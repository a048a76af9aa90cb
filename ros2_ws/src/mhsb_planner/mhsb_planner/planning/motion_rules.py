"""Rules by which the trajectory stage (S3) fits motions to a path.

There are two methods. A polynomial joins the ends of the path. A followed path keeps the path's
piston speeds, and each change of speed is a ramp (`motion.s3_trajectory`).
"""

from dataclasses import replace

from mhsb_planner.motion.fitted_motion import FittedMotion
from mhsb_planner.motion.s3_candidates import FOLLOWED_SPEED_EXCESS
from mhsb_planner.motion.s3_trajectory import FitMethod, FitRules, TrajectoryKind
from mhsb_planner.planners.options import PlanOptions
from mhsb_planner.planners.registry import get_planner
from mhsb_planner.search.discrete_path import DiscretePath

FASTER_RAMP_FACTORS = (0.72, 0.85)
"""Factors on the duration of the shortest ramps, for variants with faster ramps [-]. The second
factor is tried if the first gives no cheaper motion. The shortest ramps use half of the admissible
acceleration and jerk, because two ramps may coincide. Ramps that do not coincide can be faster.
"""

LAST_RAMP_FACTOR = 0.72
"""Factor on the duration of the last ramp alone [-]. A braked load needs no supply pressure, so the
last ramp may be shorter than the others, as far as the return chamber's relief valve allows.
"""

SLOWER_RAMP_FACTORS = (1.5, 2.2)
"""Factors on the duration of the shortest ramps, for variants with slower ramps if inertia requires
boost [-]. The second factor is tried if the first gives no cheaper motion.
"""

VARIED_STRETCH = 1.2
"""Largest factor by which a variant with other ramps may be stretched in time [-]; a longer variant
is seldom cheaper.
"""

SHORT_MOTION_TIME_FACTOR = 1.5
"""Shortest duration of a motion to a moving goal, as a factor on the goal's period [-]."""


def fit_rules(options: PlanOptions, of_path: TrajectoryKind | None = None) -> FitRules:
    """Return the rules by which the first motion of a path is made.

    A motion is a polynomial or follows the path. The first of these that names a method decides:
    the options, `of_path`, the planner. V_max is the allowed piston speed. A polynomial may exceed
    it by `options.max_speed_excess` if the options, or else the planner, also name the polynomial.
    In all other cases, only FOLLOWED_SPEED_EXCESS is allowed.

    Args:
        options: Options of the plan.
        of_path: Method for this path, unless the options name a method; None means the method of
            the planner that the options name.

    Returns:
        The rules. Each via point is a tuple of the tip's coordinates and the tolerance [m]. The
        shortest duration is SHORT_MOTION_TIME_FACTOR times the period of the goals [s].
    """
    own = options.trajectory or get_planner(options.planner).trajectory
    kind = options.trajectory or of_path or own
    asked = kind == own == "polynomial"
    return FitRules(
        trajectory=kind,
        max_excess=options.max_speed_excess if asked else FOLLOWED_SPEED_EXCESS,
        min_duration=SHORT_MOTION_TIME_FACTOR * options.period,
        via_points=tuple((*point, options.via_tolerance) for point in options.via),
    )


def following_rules(rules: FitRules) -> FitRules:
    """Return the default rules for following a path, with two values taken from other rules.

    Args:
        rules: Rules from which `min_duration` and `via_points` are taken.
    """
    return replace(
        FitRules.create_following(), min_duration=rules.min_duration, via_points=rules.via_points
    )


def list_variant_rules(
    path: DiscretePath,
    motion: FittedMotion,
    rules: FitRules,
    options: PlanOptions,
    *,
    may_follow: bool,
) -> list[tuple[FitRules, ...]]:
    """List rules for variants of a motion: other motions along its path, which may be cheaper.

    - For a motion with ramps, from rest: all ramps shortened by FASTER_RAMP_FACTORS and, if time
      has a weight, only the last ramp shortened by LAST_RAMP_FACTOR.
    - For a polynomial that was slowed to keep the limits: following the path, if `may_follow` is
      True and `rules` do not ask for a polynomial only.
    - For a followed path with more mode switches than planned (because inertia required boost):
      ramps lengthened by SLOWER_RAMP_FACTORS.

    Ramps are not varied for a moving goal (with a period).

    Args:
        path: The path. Only `switches` is read.
        motion: Motion along the path.
        rules: Rules by which it was fitted.
        options: Options of the plan.
        may_follow: Whether the path may be followed instead of a polynomial.

    Returns:
        Groups of rules for further fits. The rules of a group are alternatives in the order of
        trial: after one has given a cheaper motion, the rest need not be tried.
    """
    followed = following_rules(rules)
    varied = replace(followed, stepped=False, max_stretch=VARIED_STRETCH)
    stays = options.period == 0.0  # for a moving goal there is no time
    groups: list[tuple[FitRules, ...]] = []
    if stays and motion.method == FitMethod.RAMPED and not motion.braked:
        groups.append(tuple(_with_ramps(varied, each) for each in FASTER_RAMP_FACTORS))
        if options.weights.time > 0.0:
            groups.append((replace(varied, last_ramp_factor=LAST_RAMP_FACTOR),))
    if motion.method == FitMethod.POLYNOMIAL:
        if motion.stretch > 1.0 and not rules.polynomial_only and may_follow:
            groups.append((followed,))
    elif stays and motion.scheduled.switch_count > path.switches:
        groups.append(tuple(_with_ramps(varied, each) for each in SLOWER_RAMP_FACTORS))
    return groups


def _with_ramps(rules: FitRules, factor: float) -> FitRules:
    """Return rules with a fixed factor on the duration of the shortest ramps [-]."""
    return replace(rules, ramp_factor=factor, max_ramp_factor=factor)


def describe_rules(rules: FitRules) -> str:
    """Describe in a few words which motion the rules ask for, for the log.

    Args:
        rules: The rules.

    Returns:
        Method, then each factor on the ramps that is not 1, such as `followed, ramps x 0.72`.
    """
    words: str = rules.trajectory
    if rules.ramp_factor != 1.0:
        words += f", ramps x {rules.ramp_factor:g}"
    if rules.last_ramp_factor != 1.0:
        words += f", last ramp x {rules.last_ramp_factor:g}"
    return words
