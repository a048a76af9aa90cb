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
from mhsb_model.types import FloatArray, IntArray
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
        ("rail", "f8"),  # 1 for the rail's
    ]
)


class Lines(NamedTuple):
    """What is known of n lines; balance n is the rail's with all that is joined to it."""

    believed: FloatArray  # [1 + n] c, λ
    covariance: FloatArray  # [1 + n, 1 + n]
    balances: Records  # BALANCE[n + 1]
    row: FloatArray  # [n + 1, 1 + n] m³, of each balance what c and λ are multiplied by
    before: FloatArray  # [n + 1, 3] Pa, line, cap and rod side a step ago; the last row is the rail
    taken: FloatArray  # [n + 1, 3] m³ in this step: by compression, leakage, the piston; likewise
    fed: FloatArray  # [n + 1, 2] m³/s, of pumps into each line alone; 1 where one of them is in use
    carried: FloatArray  # [1 + n] working memory


def lines_of(count: int) -> Lines:
    """Lines as the machine file has them, not known well."""
    deviation = np.full(1 + count, LEAKAGE_DEVIATION)
    deviation[0] = SQUEEZE_DEVIATION
    balances = np.zeros(count + 1, BALANCE)
    balances["rail"][count] = 1.0
    return Lines(
        believed=np.ones(1 + count),
        covariance=np.diag(deviation**2),
        balances=balances,
        row=np.zeros((count + 1, 1 + count)),
        before=np.zeros((count + 1, 4)),
        taken=np.zeros((count + 1, 3)),
        fed=np.zeros((count + 1, 2)),
        carried=np.zeros(1 + count),
    )


@kernel(inline="always")
def weigh_lines(s: Servo, lines: Lines) -> None:
    """Take a step into all balances, and learn from those whose window is full.

    Writes what each valve leaks by the machine file, too.
    """
    n, c, step, rail = len(s.axes), s.constants[0], s.gains[0].step, s.rail_pressure[0]
    feed(s.modules, s.module_home, s.serves, lines.fed)
    joined, broken = 0, False
    for j in range(n):
        join = s.actuators[j].join
        if join > WIDE and abs(s.sensors[j].line_pressure - rail) < JOINED_DROP:
            joined |= 1 << j
        elif join > SHUT:
            broken = True
        take_line(s.axes[j], s.cylinders[j], s.sensors[j], c, step, lines.before[j], lines.taken[j])
    lines.taken[n, 0] = c.rail_capacity * (rail - lines.before[n, 0])
    lines.before[n, 0] = rail
    for g in range(n + 1):
        flow, feeds, pressure, members = lines.fed[g, 0], lines.fed[g, 1] > 0.0, rail, joined
        if g < n:
            pressure = s.sensors[g].line_pressure
            members = 1 << g if feeds and s.actuators[g].join < SHUT else 0
        else:
            flow -= c.bleed_conductance * (rail - c.tank_pressure)
            for j in range(n):
                if joined >> j & 1:
                    flow += lines.fed[j, 0]
                    feeds = feeds or lines.fed[j, 1] > 0.0
            if broken or not feeds:
                members = 0
        fed_too = 0 if pressure > c.supply_pressure + CLEAR else 1
        own, row = lines.balances[g], lines.row[g]
        if balance(own, row, lines.taken, members, fed_too, flow, step):
            spread = (FLOW * WINDOW * step) ** 2 + own.moving * READING**2 + (MODEL * row[0]) ** 2
            oil = own.supplied - own.moved
            if fed_too == 0 or (own.moving == 0.0 and oil > np.dot(row, lines.believed)):
                update(lines, row, oil, spread)


@kernel(borrows=True)
def feed(modules: Records, module_home: IntArray, serves: IntArray, fed: FloatArray) -> None:
    """Write what pumps feed into each line alone and into the rail, [n + 1, 2] as `Lines.fed`."""
    fed[:] = 0.0
    rail = len(fed) - 1
    for k in range(len(modules)):
        home, to_rail = module_home[k], modules[k].to_rail
        fed[rail, 0] += to_rail * modules[k].flow
        if home >= 0:
            fed[home, 0] += (1.0 - to_rail) * modules[k].flow
        if serves[k] >= 0:
            if to_rail > SHUT:
                fed[rail, 1] = 1.0
            if home >= 0 and 1.0 - to_rail > SHUT:
                fed[home, 1] = 1.0


@kernel(borrows=True)
def balance(
    own: Record,
    row: FloatArray,
    taken: FloatArray,
    members: int,
    fed_too: int,
    flow: float,
    step: float,
) -> bool:
    """Take a step [s] into a balance of these lines; whether its window is full.

    taken: as `Lines.taken`; fed_too: 1 where the manifold may feed them as well; flow: of pumps
    into them [m³/s].
    """
    if members == 0 or own.members != members or own.open != fed_too:
        own.members, own.open, own.steps = members, fed_too, 0
        if members == 0:
            return False
    if own.steps == 0:
        row[:] = 0.0
        own.supplied = own.moved = own.moving = 0.0
        own.steps, own.flow = 1, flow
        return False
    n = len(taken) - 1
    own.supplied += 0.5 * (own.flow + flow) * step
    own.flow = flow
    if own.rail > 0.0:
        row[0] += taken[n, 0]
    for j in range(n):
        if members >> j & 1:
            row[0] += taken[j, 0]
            row[1 + j] += taken[j, 1]
            own.moved += taken[j, 2]
            own.moving = max(own.moving, 1.0 if taken[j, 2] != 0.0 else 0.0)
    own.steps += 1
    if own.steps <= WINDOW:
        return False
    own.steps = 0
    return True


@kernel(borrows=True)
def take_line(
    axis: Record,
    cylinder: Record,
    sensor: Record,
    c: Record,
    step: float,
    before: FloatArray,
    taken: FloatArray,
) -> None:
    """Write what a line takes in a step: what its oil and that of an open chamber are compressed
    by, its leakage, and the way of its piston; before, taken: its rows as in `Lines`."""
    line, cap, rod = sensor.line_pressure, sensor.cap_pressure, sensor.rod_pressure
    axis.leakage, _ = orifice(c.leakage_coefficient, line - c.tank_pressure, c.laminar_pressure)
    taken[0] = c.line_capacity * (line - before[0])
    taken[1] = axis.leakage * step
    taken[2] = 0.0
    if axis.speed > 0.0:
        taken[0] += (cap - before[1]) / axis.cap_stiffness
        taken[2] = cylinder.cap_area * (sensor.length - before[3])
    elif axis.speed < 0.0:
        taken[0] += (rod - before[2]) / axis.rod_stiffness
        taken[2] = cylinder.rod_area * (before[3] - sensor.length)
    before[0], before[1], before[2], before[3] = line, cap, rod, sensor.length


@kernel(borrows=True)
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
