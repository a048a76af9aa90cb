"""Modes in force if the schedule and the reference governor want different ones."""

from __future__ import annotations

from collections.abc import Sequence

from mhsb_model.modes import BOOSTED_MODES, MODE_RANKS, Mode, modules_in_use, stronger
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

    Each actuator first gets the stronger of its two modes, in the order N, DB, SB. If these modes
    need more modules than there are, actuators lose modules one by one until the modules suffice.
    Within each of these steps, the actuator with the largest reserve comes first:

    1. A boosted actuator without a request returns to mode N if its reserve exceeds
        `release_reserve`.
    2. Shared boost (SB) becomes decoupled boost (DB), so that the actuator keeps one pump.
    3. An actuator with a request returns to mode N if the schedule does not boost it.

    If all three steps do not suffice, all requests are dropped. Modes of the schedule are then
    lowered one by one, first SB to DB, then DB to N. This happens if modules have failed.

    Args:
        scheduled: Modes of the schedule, uint8[n].
        requested: Modes that the reference governor requests, uint8[n]; N if it requests nothing.
        reserve: Supply pressure in mode N less the pressure that each actuator needs [Pa],
            float64[n].
        release_reserve: Reserve above which an actuator can do without boost [Pa].
        modules: Number of booster modules that work.
        per_mode: Number of modules that each mode takes, by mode code.

    Returns:
        Modes in force, uint8[n].
    """
    modes = stronger(scheduled, requested)
    spare_first = sorted(range(len(modes)), key=lambda j: -reserve[j])
    for j in spare_first:
        if modules_in_use(modes, per_mode) <= modules:
            return modes
        if (
            BOOSTED_MODES[modes[j]]
            and not BOOSTED_MODES[requested[j]]
            and reserve[j] > release_reserve
        ):
            modes[j] = Mode.N
    for j in spare_first:
        if modules_in_use(modes, per_mode) <= modules:
            return modes
        if modes[j] == Mode.SB:
            modes[j] = Mode.DB
    for j in spare_first:
        if modules_in_use(modes, per_mode) <= modules:
            return modes
        if requested[j] and not BOOSTED_MODES[scheduled[j]]:
            modes[j] = Mode.N
    modes = scheduled.copy()
    for weaker in (Mode.DB, Mode.N):
        for j in spare_first:
            if modules_in_use(modes, per_mode) <= modules:
                return modes
            if MODE_RANKS[modes[j]] > MODE_RANKS[weaker]:
                modes[j] = weaker
    return modes
