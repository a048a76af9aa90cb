"""Combination of the schedule's modes with the boost that the reference governor requests."""

from collections.abc import Sequence

from mhsb_model.modes import BOOSTED_MODES, MODE_RANKS, Mode, choose_stronger_modes, count_modules
from mhsb_model.types import FloatArray, ModeArray


def combine_modes(
    scheduled: ModeArray,
    requested: ModeArray,
    reserve: FloatArray,
    release_reserve: float,
    modules: int,
    per_mode: Sequence[int],
) -> ModeArray:
    """Combine scheduled modes with requested boost, within the number of booster modules.

    The modes are N (main pump alone), DB (boost by the own servo pump) and SB (boost from the
    shared rail). N is the weakest and SB the strongest mode. Each actuator first gets the stronger
    of its two modes. If these modes need more modules than there are, modes are lowered one
    actuator at a time, until the modules suffice:

    1. A boosted actuator without a request goes to N if its reserve exceeds `release_reserve`.
    2. An actuator in SB goes to DB.
    3. An actuator with a request goes to N if the schedule does not boost it.

    Each of these three steps begins with the actuator that has the largest reserve. If modules have
    failed, the three steps may not suffice. Then all requests are ignored, and the scheduled modes
    are lowered one actuator at a time in the same order. First SB becomes DB, then DB becomes N.

    Args:
        scheduled: Modes of the schedule, uint8[n].
        requested: Modes that the reference governor requests, uint8[n]; N if it requests nothing.
        reserve: Supply pressure in mode N minus the pressure that each actuator needs, float64[n],
            [Pa].
        release_reserve: Reserve above which an actuator can do without boost [Pa].
        modules: Number of booster modules that work.
        per_mode: Number of modules that one actuator in mode N, DB or SB takes.

    Returns:
        Modes in force in a new array, uint8[n].
    """
    modes = choose_stronger_modes(scheduled, requested)
    spare_first = sorted(range(len(modes)), key=lambda j: -reserve[j])
    for j in spare_first:
        if count_modules(modes, per_mode) <= modules:
            return modes
        if (
            BOOSTED_MODES[modes[j]]
            and not BOOSTED_MODES[requested[j]]
            and reserve[j] > release_reserve
        ):
            modes[j] = Mode.N
    for j in spare_first:
        if count_modules(modes, per_mode) <= modules:
            return modes
        if modes[j] == Mode.SB:
            modes[j] = Mode.DB
    for j in spare_first:
        if count_modules(modes, per_mode) <= modules:
            return modes
        if requested[j] and not BOOSTED_MODES[scheduled[j]]:
            modes[j] = Mode.N
    modes = scheduled.copy()
    for weaker in (Mode.DB, Mode.N):
        for j in spare_first:
            if count_modules(modes, per_mode) <= modules:
                return modes
            if MODE_RANKS[modes[j]] > MODE_RANKS[weaker]:
                modes[j] = weaker
    return modes
