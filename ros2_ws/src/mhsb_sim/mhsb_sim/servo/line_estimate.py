"""What the oil of boosted lines takes to be compressed, and how much their valves leak.

Over a window in which lines are shut off from the manifold, above its pressure, and pumps alone
feed them,

    ∫ Q dt − Σ A_dir |ΔL| = c Σ C Δp + Σ λ_j ∫ q_leak(p_j) dt

with Q the pumps' measured flow, C what lines, rail and the chambers behind open valves take by the
machine file, A_dir the area of a cylinder's inlet, and q_leak a valve's leakage by the file. c is
the file's bulk modulus in the true one, of all oil alike; λ_j is each valve's own. A line alone
gives one such balance, the rail and all that is joined to it another. A Kalman filter of c and λ,
which wander slowly, takes up window after window; what none has told of keeps its standard
deviation. Where lines are at the manifold's pressure although pumps feed them, they take at least
what these deliver: at rest the balance is learnt from where it tells of more leakage. Source: the
line's balance of oil (H. E. Merritt, Hydraulic Control Systems).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray
from mhsb_sim.circuit.elements import orifice
from mhsb_sim.records import Record, Records
from mhsb_sim.servo.cascade import Servo

WINDOW = 8
"""Steps of a window."""

SQUEEZE_DEVIATION, LEAKAGE_DEVIATION = 0.3, 0.3
"""Standard deviations of c and λ before anything is learnt."""

SQUEEZE_WANDER, LEAKAGE_WANDER = 1e-3, 2e-3
"""Standard deviations by which they may wander in a window."""

FLOW, READING, MODEL = 1.5e-7, 3e-9, 0.1
"""Standard deviations of a window's oil: flow [m³/s] that is not in the balance, a moving piston's
way [m³], and a share of what is compressed."""

LEAST_SQUEEZE, LEAST_LEAKAGE, MOST = 0.4, 0.2, 3.0
"""c and λ that are taken for an estimate."""

SHUT, WIDE = 0.02, 0.9
"""Opening of a join valve or diverter up to which it counts as shut, and from which on as open."""

CLEAR = 1e5
"""Pressure above P_S [Pa] from which on a line's check valve counts as closed."""

JOINED_DROP = 1e5
"""Difference of pressure [Pa] up to which a line counts as one with the rail."""

BALANCE = np.dtype(
    [
        ("steps", "i8"),  # of the window so far
        ("members", "i8"),  # bit j: line j is of it
        ("open", "i8"),  # 1 where the manifold may feed it, too
        ("supplied", "f8"),  # m³, by pumps
        ("moved", "f8"),  # m³, taken by pistons
        ("moving", "f8"),  # 1 where any moved
        ("flow", "f8"),  # m³/s, of pumps a step ago
    ]
)


class Lines(NamedTuple):
    """What is known of n lines; balance n is the rail's with all that is joined to it."""

    believed: FloatArray  # [1 + n] c, λ
    covariance: FloatArray  # [1 + n, 1 + n]
    balances: Records  # BALANCE[n + 1]
    row: FloatArray  # [n + 1, 1 + n] m³, of each balance what c and λ are multiplied by
    before: FloatArray  # [n + 1, 3] Pa, line, cap and rod side a step ago; the last row is the rail
    carried: FloatArray  # [1 + n] working memory


def lines_of(count: int) -> Lines:
    """Lines as the machine file has them, not known well."""
    deviation = np.full(1 + count, LEAKAGE_DEVIATION)
    deviation[0] = SQUEEZE_DEVIATION
    return Lines(
        believed=np.ones(1 + count),
        covariance=np.diag(deviation**2),
        balances=np.zeros(count + 1, BALANCE),
        row=np.zeros((count + 1, 1 + count)),
        before=np.zeros((count + 1, 3)),
        carried=np.zeros(1 + count),
    )


@kernel
def weigh_lines(s: Servo, lines: Lines) -> None:
    """Take a step into all balances, and learn from those whose window is full."""
    n, c = len(s.axes), s.constants[0]
    joined, broken = 0, False
    for j in range(n):
        join = s.actuators[j].join
        drop = abs(s.sensors[j].line_pressure - s.rail_pressure[0])
        if join > WIDE and drop < JOINED_DROP:
            joined |= 1 << j
        elif join > SHUT:
            broken = True
    for j in range(n):
        alone = s.actuators[j].join < SHUT
        flow, feeds = fed(s, 1 << j, False)
        clear = s.sensors[j].line_pressure > c.supply_pressure + CLEAR
        balance(s, lines, j, 1 << j if alone and feeds else 0, 0 if clear else 1, flow)
    flow, feeds = fed(s, joined, True)
    if broken or not feeds:
        joined = 0
    clear = s.rail_pressure[0] > c.supply_pressure + CLEAR
    flow -= c.bleed_conductance * (s.rail_pressure[0] - c.tank_pressure)
    balance(s, lines, n, joined, 0 if clear else 1, flow)
    for j in range(n):
        sensor, before = s.sensors[j], lines.before[j]
        before[0], before[1] = sensor.line_pressure, sensor.cap_pressure
        before[2] = sensor.rod_pressure
    lines.before[n, 0] = s.rail_pressure[0]


@kernel
def fed(s: Servo, members: int, rail: bool) -> tuple[float, bool]:
    """Flow of pumps [m³/s] into these lines, and the rail; whether any is in use for them."""
    flow, feeds = 0.0, False
    for k in range(len(s.modules)):
        home, module = s.module_home[k], s.modules[k]
        share = module.to_rail if rail else 0.0
        if home >= 0 and members >> home & 1:
            share += 1.0 - module.to_rail
        flow += share * module.flow
        feeds = feeds or (share > SHUT and s.serves[k] >= 0)
    return flow, feeds


@kernel
def balance(s: Servo, lines: Lines, g: int, members: int, fed_too: int, flow: float) -> None:
    """Take a step into balance g, of these lines.

    fed_too: 1 where the manifold may feed them as well; flow: of pumps into them [m³/s].
    """
    own, row, c, step = lines.balances[g], lines.row[g], s.constants[0], s.gains[0].step
    if members == 0 or own.members != members or own.open != fed_too:
        own.members, own.open, own.steps = members, fed_too, 0
        if members == 0:
            return
    if own.steps == 0:
        row[:] = 0.0
        own.supplied = own.moved = own.moving = 0.0
        own.steps, own.flow = 1, flow
        return
    n = len(s.axes)
    own.supplied += 0.5 * (own.flow + flow) * step
    own.flow = flow
    if g == n:
        row[0] += c.rail_capacity * (s.rail_pressure[0] - lines.before[n, 0])
    for j in range(n):
        if members >> j & 1:
            take_line(s, lines, j, row, own)
    own.steps += 1
    if own.steps <= WINDOW:
        return
    own.steps = 0
    spread = (FLOW * WINDOW * step) ** 2 + own.moving * READING**2 + (MODEL * row[0]) ** 2
    oil = own.supplied - own.moved
    if own.open == 0 or (own.moving == 0.0 and oil > np.dot(row, lines.believed)):
        update(lines, row, oil, spread)


@kernel
def take_line(s: Servo, lines: Lines, j: int, row: FloatArray, own: Record) -> None:
    """Take a step of line j into a balance: what its oil and that of an open chamber are compressed
    by, its leakage, and the way of its piston."""
    axis, cylinder, sensor, c = s.axes[j], s.cylinders[j], s.sensors[j], s.constants[0]
    step, before = s.gains[0].step, lines.before[j]
    row[0] += c.line_capacity * (sensor.line_pressure - before[0])
    leakage, _ = orifice(
        c.leakage_coefficient, sensor.line_pressure - c.tank_pressure, c.laminar_pressure
    )
    row[1 + j] += leakage * step
    if axis.speed > 0.0:
        own.moved += cylinder.cap_area * axis.speed * step
        row[0] += (sensor.cap_pressure - before[1]) / axis.cap_stiffness
    elif axis.speed < 0.0:
        own.moved -= cylinder.rod_area * axis.speed * step
        row[0] += (sensor.rod_pressure - before[2]) / axis.rod_stiffness
    own.moving = max(own.moving, 1.0 if axis.speed != 0.0 else 0.0)


@kernel
def update(lines: Lines, row: FloatArray, oil: float, spread: float) -> None:
    """Kalman filter: oil = row · (c, λ) + noise of that variance [m³, m⁶]."""
    believed, covariance, carried = lines.believed, lines.covariance, lines.carried
    n = len(believed)
    for i in range(n):
        if row[i] != 0.0:
            wander = SQUEEZE_WANDER if i == 0 else LEAKAGE_WANDER
            covariance[i, i] += wander * wander
    away = oil
    for i in range(n):
        carried[i] = 0.0
        for k in range(n):
            carried[i] += covariance[i, k] * row[k]
    for i in range(n):
        spread += row[i] * carried[i]
        away -= row[i] * believed[i]
    for i in range(n):
        least = LEAST_SQUEEZE if i == 0 else LEAST_LEAKAGE
        believed[i] = min(max(believed[i] + carried[i] / spread * away, least), MOST)
        for k in range(n):
            covariance[i, k] -= carried[i] * carried[k] / spread
