"""The payload that an arm has learnt, as plans are made for it."""

from __future__ import annotations

from collections.abc import Sequence

from mhsb_model.arm_reports import Estimate

INTERVAL = 1.96
"""Standard deviations to either side within which the truth is in 95 % of all cases."""

NARROW = 0.1
"""Half of that interval, as a share of the payload, from which on it is planned with."""

ANOTHER = 0.03
"""Share of the payload by which it has to change before plans are made for another: each takes new
prices of all steps."""


def payload_to_plan_with(estimates: Sequence[Estimate], before: float | None) -> float | None:
    """The payload [kg] to plan with from now on; `before`, or None, where nothing better is known.

    before: kg, what has been planned with so far of what was learnt.
    """
    for each in estimates:
        if each.quantity != "payload" or not each.known or each.value <= 0.0:
            continue
        narrow = INTERVAL * each.deviation <= NARROW * each.value
        if narrow and (before is None or abs(each.value - before) > ANOTHER * before):
            return each.value
    return before
