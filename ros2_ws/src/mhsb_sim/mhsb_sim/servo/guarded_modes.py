"""Which modes are in force where schedule and guard want different ones, within the modules."""

from __future__ import annotations

from collections.abc import Sequence

from mhsb_model.modes import BOOSTED, RANK, Mode, modules_in_use, stronger
from mhsb_model.types import FloatArray, ModeArray


def guarded_modes(
    scheduled: ModeArray,
    asked: ModeArray,
    reserve: FloatArray,
    enough: float,
    modules: int,
    per_mode: Sequence[int],
) -> ModeArray:
    """The modes of a schedule, and boost where the guard asks for it, uint8[n].

    reserve float64[n] Pa: what each actuator would have in N. Where modules are too few, those
    come from actuators that share boost, which keep their own pump, and from those whose reserve is
    more than `enough` [Pa], the most first; then the actuators that lack most are boosted alone.
    Where they do not suffice for the schedule, some being lost, who has most reserve gets less.
    """
    modes = stronger(scheduled, asked)
    spare_first = sorted(range(len(modes)), key=lambda j: -reserve[j])
    for j in spare_first:
        if modules_in_use(modes, per_mode) <= modules:
            return modes
        if BOOSTED[modes[j]] and not BOOSTED[asked[j]] and reserve[j] > enough:
            modes[j] = Mode.N
    for j in spare_first:
        if modules_in_use(modes, per_mode) <= modules:
            return modes
        if modes[j] == Mode.SB:
            modes[j] = Mode.DB
    for j in spare_first:
        if modules_in_use(modes, per_mode) <= modules:
            return modes
        if asked[j] and not BOOSTED[scheduled[j]]:
            modes[j] = Mode.N
    modes = scheduled.copy()
    for weaker in (Mode.DB, Mode.N):
        for j in spare_first:
            if modules_in_use(modes, per_mode) <= modules:
                return modes
            if RANK[modes[j]] > RANK[weaker]:
                modes[j] = weaker
    return modes
