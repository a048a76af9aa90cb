"""Cost of one step of the discrete path: a joint-space move between two postures in one pattern.

Cylinder j moves by ΔL_j = L_j(q₁) − L_j(q₀), all cylinders in the same time (quasi-static):

    T = max( max_j |ΔL_j| / V_max,j , Σ_j A_dir |ΔL_j| / (Q_MP − Σ_j q_leak,j) )
    V_max,j = min(the actuator's V_max, servo pump limit of its mode and direction)

A cylinder that moves against its load needs boost where p_L + m(v) + margin exceeds P_S at the
start, middle or end of the step. A pattern is self-consistent if it boosts exactly the joints
that need it. Where, among the patterns that lead to a node, none is, boosting a joint without
need is allowed; beyond the highest boost pressure a step is not possible, nor where the tip leaves
the workspace on the way or the arm comes too near to an obstacle. A cylinder that moves by no more
than `HELD` is held by its closed valve and needs nothing.

A motion boosts what it holds for long: where `Circuit.rest_speed` is above 0, a cylinder that moves
slower is at rest, and needs boost where p_L + margin of its load exceeds P_S at the start, middle
or end of the step, unless that is beyond the highest boost: then its valve alone holds it.

    E = Σ_j price_j (A_dir |ΔL_j| + q_leak,j T), load taken at the middle of the step

Prices: P_S in N, whatever the load. Boosted, reading `paper`: p_L/η; reading `series`:
P_S + (p_supply − P_S)/η with p_supply = p_L + m(v) + margin, for shared boost that of its most
loaded actuator, one rail. Boosted oil never costs less than P_S, since the main pump feeds the
servo pumps. Source: paper, Section 2.2.

A valve leaks as in `hydraulics.leakage`, by p_supply at the middle with m(V_max): so in T and in
the reading `series`. The reading `paper` has it leak as at P_S in E, in every mode.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from mhsb_model import hydraulics
from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED, MODE_COUNT, ON_RAIL, Mode
from mhsb_model.obstacles.clearance import move_is_clear
from mhsb_model.statics import piston_forces
from mhsb_model.types import FloatArray, IntArray, ModeArray, frozen
from mhsb_model.workspace import stays_inside

HELD = 1e-6
"""A cylinder that moves by no more than this is held by its closed valve [m]."""

INADMISSIBLE = 0
WITHOUT_NEED = 1  # some joint is boosted that does not need it
CONSISTENT = 2  # exactly the joints that need boost are boosted

DURATION, ENERGY_PAPER, ENERGY_SERIES = 0, 1, 2
"""Columns of a step's cost: s, J, J."""

NO_PATTERN = -1
"""As a set of joints that must be boosted: more than any pattern boosts."""

EnergyReading = Literal["paper", "series"]
ENERGY_COLUMN: dict[str, int] = {"paper": ENERGY_PAPER, "series": ENERGY_SERIES}


class Postures(NamedTuple):
    """Postures with what steps need of them."""

    posture: FloatArray  # [count, n] rad
    length: FloatArray  # [count, n] m, of the cylinders
    force: FloatArray  # [count, n] N, of the cylinders under gravity


@kernel
def _lengths_and_forces(m: MachineArrays, posture: FloatArray) -> tuple[FloatArray, FloatArray]:
    length = np.empty(posture.shape)
    force = np.empty(posture.shape)
    q = np.empty(posture.shape[1])
    for i in range(len(posture)):
        q[:] = posture[i]
        piston_forces(m, q, force[i])
        for j in range(len(q)):
            length[i, j] = cylinder_length(m.linkage[j], q[j])
    return length, force


def describe(m: MachineArrays, posture: FloatArray) -> Postures:
    """Postures float64[count, n] [rad] with their cylinders' lengths and forces."""
    posture = frozen(posture)
    length, force = _lengths_and_forces(m, posture)
    return Postures(posture, frozen(length), frozen(force))


class Circuit(NamedTuple):
    """A machine's numbers in the form in which step costs need them.

    Direction 0 is extension, 1 retraction. `hydraulics.pressure_against` is taken apart into what
    a direction fixes: p_L + m(v) = load · per_area + outlet + valve · v², the load being ±F.
    """

    supply_pressure: float  # Pa
    max_boost_pressure: float  # Pa
    boost_margin: float  # Pa
    tank_pressure: float  # Pa
    shared_flow: float  # m³/s, main pump less leakage with all in N
    leakage_flow: float  # m³/s, one valve in N
    idle_leakage: float  # m³/s, of valves beside those of the n joints
    efficiency: float  # of the servo pumps
    area: FloatArray  # [n, 2] A_dir [m²]
    per_area: FloatArray  # [n, 2] 1/A_dir [1/m²]
    outlet: FloatArray  # [n, 2] p_L without load, from the tank pressure on the outlet [Pa]
    valve: FloatArray  # [n, 2] m(v)/v² [Pa s²/m²]
    valve_at_top: FloatArray  # [n, 2] m(V_max) [Pa]
    pace: FloatArray  # [n, modes, 2] 1/V_max by mode [s/m]
    boosted: IntArray  # [patterns] bit j is set where joint j is boosted
    rest_speed: float  # below it a cylinder is held in boost where P_S is too little [m/s]
    other_oil: float  # m³ that what moves beside the n joints takes in all, for bounds alone
    other_time: float  # s that it takes, likewise


@kernel
def circuit_of(m: MachineArrays, patterns: ModeArray) -> Circuit:
    """The numbers of a machine and its patterns uint8[patterns, n]."""
    n = len(m.cap_area)
    area = np.empty((n, 2))
    outlet = np.empty((n, 2))
    valve = np.empty((n, 2))
    valve_at_top = np.empty((n, 2))
    pace = np.empty((n, MODE_COUNT, 2))
    oil = hydraulics.oil_of(m)
    for j in range(n):
        cap, rod = m.cap_area[j], m.rod_area[j]
        for d in range(2):
            sign = 1.0 - 2.0 * d
            area[j, d] = hydraulics.inlet_area(cap, rod, sign)
            outlet[j, d] = hydraulics.load_pressure(cap, rod, m.tank_pressure, 0.0, sign)
            valve[j, d] = hydraulics.valve_margin(m.valve_coefficient[j], cap, rod, sign)
            valve_at_top[j, d] = valve[j, d] * m.max_piston_speed[j] ** 2
            for mode in range(MODE_COUNT):
                pumped = hydraulics.highest_flow(oil, m.modules_per_mode[mode])
                pace[j, mode, d] = 1.0 / min(m.max_piston_speed[j], pumped / area[j, d])
    boosted = np.zeros(len(patterns), dtype=np.int64)
    for p in range(len(patterns)):
        for j in range(n):
            boosted[p] |= np.int64(BOOSTED[patterns[p, j]]) << j
    return Circuit(
        m.supply_pressure,
        m.max_boost_pressure,
        m.boost_margin,
        m.tank_pressure,
        m.main_pump_flow - n * m.leakage_flow,
        m.leakage_flow,
        m.idle_leakage,
        m.servo_pump_efficiency,
        area,
        1.0 / area,
        outlet,
        valve,
        valve_at_top,
        pace,
        boosted,
        0.0,
        0.0,
        0.0,
    )


@kernel(borrows=True)
def _hold_pressure(c: Circuit, j: int, force: float) -> float:
    """p_L of a cylinder that holds its load [Pa]."""
    d = 0 if force > 0.0 else 1
    return abs(force) * c.per_area[j, d] + c.outlet[j, d]


@kernel(borrows=True)
def _more_leakage(c: Circuit, need: float) -> float:
    """What a valve leaks more at the supply pressure `need` [Pa] than at P_S [m³/s]."""
    if need <= c.supply_pressure:
        return 0.0
    supply = min(need, c.max_boost_pressure)
    leaks = hydraulics.leakage_at(
        c.leakage_flow, c.supply_pressure, c.tank_pressure, supply
    )
    return leaks - c.leakage_flow


STROKE, DIRECTION, OIL, WORST, MIDDLE, VALVE, LEAK = 0, 1, 2, 3, 4, 5, 6
"""What a pattern's cost needs of each joint's move: |ΔL| [m]; 0 extension, 1 retraction;
A_dir |ΔL| [m³]; largest p_L met against the load at start, middle and end [Pa], −∞ where the load
never opposes or the joint is held; p_L at the middle [Pa]; m(v)/v² [Pa s²/m²]; what its valve leaks
more, boosted by itself [m³/s]."""

MOVE_WIDTH = 7


@kernel(inline="always")
def _is_loaded(move: FloatArray) -> bool:
    """Whether a joint moves, or is held in boost; closed valves hold the others, as in N."""
    return move[STROKE] > HELD or move[WORST] > -math.inf


class Scratch(NamedTuple):
    """Working memory and results of `steps_to_node`, so that it allocates nothing."""

    cost: FloatArray  # [patterns, 3] T [s], E paper [J], E series [J]
    status: IntArray  # [patterns] INADMISSIBLE, WITHOUT_NEED or CONSISTENT
    move: FloatArray  # [postures of a node, n, MOVE_WIDTH]
    must: IntArray  # [postures of a node] bit j: joint j needs boost at any speed
    may: IntArray  # [postures of a node] bit j: joint j may need boost
    middle: FloatArray  # [postures of a node, n] room for their `middle_force`


@kernel
def new_scratch(patterns: ModeArray) -> Scratch:
    """Working memory for one thread."""
    count, n = patterns.shape
    return Scratch(
        np.empty((count, 3)),
        np.empty(count, dtype=np.int64),
        np.empty((count, n, MOVE_WIDTH)),
        np.empty(count, dtype=np.int64),
        np.empty(count, dtype=np.int64),
        np.empty((count, n)),
    )


@kernel(borrows=True)
def steps_to_node(
    c: Circuit,
    patterns: ModeArray,
    start: Postures,
    i: int,
    end: Postures,
    first: int,
    count: int,
    owner: IntArray,
    middle_force: FloatArray,
    s: Scratch,
) -> int:
    """All steps from posture i of `start` to one node, each pattern ending in its own posture.

    first, count  the node's postures: first … first + count − 1 of `end`
    owner         int64[patterns], the one of them in which a step in that pattern ends
    middle_force  float64[count, n] as `middle_forces` gives them [N]

    Writes s.cost and s.status; the steps with the status returned may be taken, none where it
    is INADMISSIBLE. Oracle: the formulas above in plain NumPy.
    """
    area, per_area, outlet, pace = c.area, c.per_area, c.outlet, c.pace
    valve, valve_at_top, boosted = c.valve, c.valve_at_top, c.boosted
    highest, margin, efficiency = c.max_boost_pressure, c.boost_margin, c.efficiency
    start_length, start_force = start.length, start.force
    end_length, end_force = end.length, end.force
    cost, status, move, must, may, _ = s
    n = patterns.shape[1]
    for k in range(count):
        must[k] = may[k] = 0
        if math.isnan(middle_force[k, 0]):
            must[k] = NO_PATTERN
            continue
        shortest = 0.0
        if c.rest_speed > 0.0:
            for j in range(n):
                delta = end_length[first + k, j] - start_length[i, j]
                shortest = max(shortest, abs(delta) * pace[j, Mode.N, 0 if delta > 0.0 else 1])
        for j in range(n):
            delta = end_length[first + k, j] - start_length[i, j]
            d = 0 if delta > 0.0 else 1
            sign = 1.0 - 2.0 * d
            at_middle = sign * middle_force[k, j]
            load = max(sign * start_force[i, j], at_middle, sign * end_force[first + k, j])
            worst = -math.inf
            if load > 0.0 and abs(delta) > HELD:
                worst = load * per_area[j, d] + outlet[j, d]
                if worst + margin > c.supply_pressure:
                    must[k] |= 1 << j
                if worst + margin + valve_at_top[j, d] > c.supply_pressure:
                    may[k] |= 1 << j
            move[k, j, STROKE] = abs(delta)
            move[k, j, DIRECTION] = d
            move[k, j, OIL] = area[j, d] * abs(delta)
            move[k, j, WORST] = worst
            move[k, j, MIDDLE] = at_middle * per_area[j, d] + outlet[j, d]
            move[k, j, VALVE] = valve[j, d]
            move[k, j, LEAK] = 0.0
            if abs(delta) > HELD:
                need = move[k, j, MIDDLE] + valve_at_top[j, d] + margin
                move[k, j, LEAK] = _more_leakage(c, need)
            if shortest > 0.0 and abs(delta) <= c.rest_speed * shortest:
                held = _hold_pressure(c, j, middle_force[k, j])
                worst = max(held, _hold_pressure(c, j, start_force[i, j]))
                worst = max(worst, _hold_pressure(c, j, end_force[first + k, j]))
                if c.supply_pressure < worst + margin <= highest:
                    must[k] |= 1 << j
                    may[k] |= 1 << j
                    move[k, j, WORST] = worst
                    move[k, j, MIDDLE] = held
                    move[k, j, VALVE] = 0.0
                    move[k, j, LEAK] = _more_leakage(c, held + margin)
    for wanted in (CONSISTENT, WITHOUT_NEED):
        best = INADMISSIBLE
        for p in range(len(patterns)):
            status[p] = INADMISSIBLE
            k = owner[p] - first
            if must[k] & ~boosted[p] or (wanted == CONSISTENT and boosted[p] & ~may[k]):
                continue
            # The price of move k in pattern p.
            duration = volume = rail_leak = 0.0
            shared = c.shared_flow
            for j in range(n):
                d, mode = int(move[k, j, DIRECTION]), patterns[p, j]
                duration = max(duration, move[k, j, STROKE] * pace[j, mode, d])
                volume += move[k, j, OIL]
                if ON_RAIL[mode]:
                    rail_leak = max(rail_leak, move[k, j, LEAK])
                elif BOOSTED[mode]:
                    shared -= move[k, j, LEAK]
            if rail_leak > 0.0:
                for j in range(n):
                    if ON_RAIL[patterns[p, j]] and _is_loaded(move[k, j]):
                        shared -= rail_leak
            if shared <= 0.0:
                continue
            duration = max(duration, volume / shared)
            found = CONSISTENT
            rail = 0.0
            for j in range(n):
                needed = False
                if _is_loaded(move[k, j]):
                    speed = move[k, j, STROKE] / duration
                    reserve = move[k, j, VALVE] * speed * speed + margin
                    worst = move[k, j, WORST] + reserve
                    if worst > highest:
                        found = INADMISSIBLE
                        break
                    needed = worst > c.supply_pressure
                    if ON_RAIL[patterns[p, j]]:
                        rail = max(rail, move[k, j, MIDDLE] + reserve)
                if needed and not BOOSTED[patterns[p, j]]:
                    found = INADMISSIBLE
                    break
                if BOOSTED[patterns[p, j]] and not needed:
                    found = WITHOUT_NEED
            if found == INADMISSIBLE:
                continue
            paper_sum = series_sum = c.supply_pressure * c.idle_leakage * duration
            for j in range(n):
                paper = series = c.supply_pressure
                more = 0.0
                if BOOSTED[patterns[p, j]] and _is_loaded(move[k, j]):
                    supply, more = rail, rail_leak
                    if not ON_RAIL[patterns[p, j]]:
                        more = move[k, j, LEAK]
                        speed = move[k, j, STROKE] / duration
                        supply = move[k, j, MIDDLE] + move[k, j, VALVE] * speed * speed + margin
                    paper = max(paper, move[k, j, MIDDLE] / efficiency)
                    series += max(0.0, supply - c.supply_pressure) / efficiency
                oil = move[k, j, OIL] + c.leakage_flow * duration
                paper_sum += paper * oil
                series_sum += series * (oil + more * duration)
            cost[p, DURATION] = duration
            cost[p, ENERGY_PAPER] = paper_sum
            cost[p, ENERGY_SERIES] = series_sum
            status[p] = found
            best = max(best, found)
        if best == wanted:
            return best
    return INADMISSIBLE


@kernel
def middle_forces(
    m: MachineArrays, start: FloatArray, end: FloatArray, first: int, force: FloatArray
) -> None:
    """Cylinder forces half-way from start[n] to end[first …], written to force[count, n] [N].

    Not a number where the tip leaves the workspace on the way: such a move is no step.
    """
    middle = np.empty(len(start))
    for k in range(len(force)):
        if not stays_inside(m, start, end[first + k]):
            force[k] = math.nan
            continue
        for j in range(len(start)):
            middle[j] = 0.5 * (start[j] + end[first + k, j])
        piston_forces(m, middle, force[k])


@kernel(borrows=True)
def bar_collisions(
    m: MachineArrays,
    obstacles: FloatArray,
    start: FloatArray,
    end: FloatArray,
    first: int,
    force: FloatArray,
) -> None:
    """Make `force` not a number also where the arm comes too near to an obstacle on the way.

    obstacles  `Obstacles.path_rows`
    """
    if len(obstacles) == 0:
        return
    for k in range(len(force)):
        if not move_is_clear(m, obstacles, start, end[first + k], False):
            force[k] = math.nan


@dataclass(frozen=True, eq=False)
class StepCosts:
    """One step between two postures, in every pattern.

    admissible     bool[patterns]
    duration       float64[patterns], s; NaN where not admissible, as all of the following
    energy         float64[patterns], J, reading `paper`
    energy_series  float64[patterns], J, reading `series`
    """

    admissible: np.ndarray
    duration: FloatArray
    energy: FloatArray
    energy_series: FloatArray


def step_costs(
    machine: Machine, start: FloatArray, end: FloatArray, rest_speed: float = 0.0
) -> StepCosts:
    """Costs of the step from posture `start` to posture `end` [rad], wherever these lie.

    rest_speed  of the `Circuit` [m/s]
    """
    arrays, patterns = machine.arrays, machine.patterns
    from_start = describe(arrays, np.array([start], dtype=np.float64))
    to_end = describe(arrays, np.array([end], dtype=np.float64))
    middle = np.empty((1, machine.joint_count))
    middle_forces(arrays, from_start.posture[0], to_end.posture, 0, middle)
    obstacles = machine.obstacles.path_rows
    bar_collisions(arrays, obstacles, from_start.posture[0], to_end.posture, 0, middle)
    owner = np.zeros(len(patterns), dtype=np.int64)
    scratch = new_scratch(patterns)
    circuit = circuit_of(arrays, patterns)._replace(rest_speed=rest_speed)
    status = steps_to_node(circuit, patterns, from_start, 0, to_end, 0, 1, owner, middle, scratch)
    admissible = (scratch.status == status) & (status != INADMISSIBLE)
    cost = np.where(admissible[:, None], scratch.cost, np.nan)
    return StepCosts(
        frozen(admissible),
        frozen(cost[:, DURATION]),
        frozen(cost[:, ENERGY_PAPER]),
        frozen(cost[:, ENERGY_SERIES]),
    )


def warm_up(machine: Machine) -> None:
    """Compile the kernels of this module."""
    step_costs(machine, machine.arrays.joint_min, machine.arrays.joint_max)
