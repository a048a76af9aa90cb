"""How the servo pumps follow their commands: their lag and the commands' delay, learnt on the way.

A pump of lag τ that is told Q_cmd i steps late goes, over a window of its steps h,

    ΔQ = θ Σ (Q_cmd(k − i) − Q(k)),        θ = 1 − e^(−h/τ)

with Q measured by its speed. For each delay that may be, θ is found by least squares with a
forgetting of old windows; the delay is the one whose squares are the least. All pumps are of one
make and tell of one θ; what no pump of such a make would do is not learnt from. Commands are as
late for all that is driven. Source: L. Ljung, System Identification, Section 3.2 (first order with
a dead time, a set of models of which the best is taken).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray
from mhsb_sim.records import Record, Records

WINDOW = 10
"""Steps of a window."""

LATEST = 6
"""The longest delay that is looked for, in steps."""

DEVIATION = 0.6
"""Standard deviation of θ before anything is learnt, as a share."""

READING = 4e-3
"""Standard deviation of a window's ΔQ, as a share of full flow: readings, and what a lag is not."""

LEAST_DRIVEN = 0.3
"""Σ (Q_cmd − Q) of a window [full flows] from which on it is learnt from."""

FORGETTING = 0.995
"""Weight that a window loses with each one after it."""

OF_ONE_MAKE = (0.2, 8.0)
"""Lags, in times the machine file's, that are taken for a healthy pump's."""

PLAUSIBLE = 9.0
"""Squares beyond the least, in READING², up to which a delay may still be the true one."""

LEAST_DEVIATION = 0.03
"""Of the lag, as a share, however much has been learnt."""

DRIVE = np.dtype(
    [
        ("step", "f8"),  # s, h
        ("full_flow", "f8"),  # m³/s
        ("largest_change", "f8"),  # m³/s in a step
        ("file", "f8"),  # θ by the machine file
        ("theta", "f8"),  # θ
        ("lag", "f8"),  # s, τ
        ("deviation", "f8"),  # of τ, as a share
        ("delay", "i8"),  # steps
        ("latest", "i8"),  # steps, the longest delay that may be
        ("steps", "i8"),  # of the window so far
    ]
)


class Drives(NamedTuple):
    """What is known of how m servo pumps follow their commands."""

    record: Records  # DRIVE[1]
    sent: FloatArray  # [m, LATEST + 1] m³/s, commands of the last steps, the newest first
    before: FloatArray  # [m, 2] m³/s, Q a step ago, and at the start of the window
    driven: FloatArray  # [m, LATEST + 1] m³/s, Σ (Q_cmd − Q) in the window, for each delay
    squares: FloatArray  # [4, LATEST + 1] Σ x², Σ x y, Σ y² of all windows, in full flows; Σ left
    flow: FloatArray  # [m] m³/s, Q when what is commanded now begins to act
    pending: FloatArray  # [m] m³ that it delivers until then


def drives_of(lag: float, step: float, full_flow: float, slew: float, count: int) -> Drives:
    """Pumps as the machine file has them: lag and step [s], flow [m³/s], slew [m³/s²]."""
    record = np.zeros(1, DRIVE)
    record["step"], record["full_flow"], record["largest_change"] = step, full_flow, slew * step
    record["file"] = record["theta"] = -math.expm1(-step / lag)
    record["lag"], record["deviation"], record["latest"] = lag, DEVIATION, LATEST
    return Drives(
        record=record,
        sent=np.zeros((count, LATEST + 1)),
        before=np.zeros((count, 2)),
        driven=np.zeros((count, LATEST + 1)),
        squares=np.zeros((4, LATEST + 1)),
        flow=np.zeros(count),
        pending=np.zeros(count),
    )


@kernel(borrows=True)
def follow_drives(d: Drives, modules: Records) -> bool:
    """Take a step of all pumps into the window, before they are commanded anew.

    modules: MODULE[m], flows as measured and commands as of the last step. Whether lag and delay
    have been learnt anew.
    """
    own = d.record[0]
    reach = own.largest_change / own.theta
    for k in range(len(modules)):
        flow, sent, last = modules[k].flow, d.sent[k], d.before[k, 0]
        for i in range(LATEST, 0, -1):
            sent[i] = sent[i - 1]
        sent[0] = modules[k].flow_command
        if own.steps == 0:
            d.before[k, 1] = last
            d.driven[k] = 0.0
        for i in range(LATEST + 1):
            d.driven[k, i] += min(max(sent[i] - last, -reach), reach)
        d.before[k, 0] = flow
    own.steps += 1
    learnt = False
    if own.steps == WINDOW:
        own.steps = 0
        for k in range(len(modules)):
            rise = (d.before[k, 0] - d.before[k, 1]) / own.full_flow
            learnt = take(d.squares, d.driven[k], rise, own) or learnt
        if learnt:
            settle_on(own, d.squares)
    for k in range(len(modules)):
        d.flow[k], d.pending[k] = foreseen(own, modules[k].flow, d.sent[k])
    return learnt


@kernel(borrows=True)
def take(squares: FloatArray, driven: FloatArray, rise: float, own: Record) -> bool:
    """Take a pump's window into the squares; whether it tells anything. rise: in full flows."""
    x = driven[own.delay] / own.full_flow
    if abs(x) < LEAST_DRIVEN:
        return False
    least, most = -math.expm1(math.log1p(-own.file) / OF_ONE_MAKE[1]), OF_ONE_MAKE[0]
    if not least < rise / x < -math.expm1(math.log1p(-own.file) / most):
        return False
    for i in range(LATEST + 1):
        x = driven[i] / own.full_flow
        squares[0, i] = FORGETTING * squares[0, i] + x * x
        squares[1, i] = FORGETTING * squares[1, i] + x * rise
        squares[2, i] = FORGETTING * squares[2, i] + rise * rise
    return True


@kernel(borrows=True)
def settle_on(own: Record, squares: FloatArray) -> None:
    """Write the delay with the least squares, the θ and lag that go with it, and their doubts."""
    prior = (READING / (DEVIATION * own.file)) ** 2
    least = math.inf
    left = squares[3]
    for i in range(LATEST + 1):
        weight = squares[0, i] + prior
        theta = (squares[1, i] + prior * own.file) / weight
        left[i] = squares[2, i] - 2.0 * theta * squares[1, i] + theta * theta * squares[0, i]
        left[i] += prior * (theta - own.file) ** 2
        if left[i] < least:
            least, own.delay, own.theta = left[i], i, theta
            own.deviation = max(READING / math.sqrt(weight) / theta, LEAST_DEVIATION)
    for i in range(LATEST + 1):
        if left[i] < least + PLAUSIBLE * READING * READING:
            own.latest = i
    own.lag = -own.step / math.log1p(-own.theta)


@kernel(borrows=True)
def foreseen(own: Record, flow: float, sent: FloatArray) -> tuple[float, float]:
    """Q [m³/s] when the next command begins to act, and the oil [m³] that comes until then.

    flow: Q now; sent: commands [m³/s], the newest first.
    """
    volume = 0.0
    for i in range(own.delay - 1, -1, -1):
        change = own.theta * (sent[i] - flow)
        change = min(max(change, -own.largest_change), own.largest_change)
        volume += own.step * (flow + 0.5 * change)
        flow += change
    return flow, volume
