"""Cost of one step of the discrete path: a straight joint-space move in one mode combination.

Cylinder j moves by ΔL_j = L_j(q₁) − L_j(q₀) [m] from posture q₀ to posture q₁. All cylinders take
the same time T [s] (quasi-static):

    T = max( max_j |ΔL_j| / V_max,j , Σ_j A_dir |ΔL_j| / (Q_MP − Σ_j q_leak,j) )
    V_max,j = min(the actuator's V_max, servo pump limit of its mode and direction)

A_dir [m²] is the piston area that fills in the direction of the move. Q_MP [m³/s] is the main
pump's flow, and q_leak,j [m³/s] the leakage of valve j.

Boost depends on four pressures [Pa]: the main pump's pressure P_S, the load pressure p_L, the boost
margin, and the pressure drop m(v) of the valve. The piston speed is v [m/s]. A cylinder that moves
against its load needs boost if p_L + m(v) + margin exceeds P_S at start, middle or end of the step.
A mode combination is consistent if it boosts exactly the joints that need boost. If no combination
that leads to a node is consistent, combinations that also boost other joints are admitted. A step
is inadmissible beyond the highest boost pressure. It is also inadmissible if the tip leaves the
workspace on the way, or if the arm comes too near to an obstacle. A cylinder that moves by no more
than `MAX_HELD_STROKE` is held by its closed valve and needs nothing.

A cylinder that is held for long may also need boost. `HydraulicCoefficients.rest_speed` is the
speed up to which a cylinder counts as held; 0 switches this rule off. A held cylinder needs boost
if p_L + margin exceeds P_S at start, middle or end of the step. If p_L + margin is beyond the
highest boost pressure, the closed valve holds the cylinder without boost.

    E = Σ_j price_j (A_dir |ΔL_j| + q_leak,j T), load taken at the middle of the step

The price is the energy per volume of oil [J/m³ = Pa]. In mode N it is P_S for any load. For a
boosted joint it depends on the energy reading, with η the efficiency of the servo pumps [-]:

- `paper`: p_L/η
- `series`: P_S + (p_supply − P_S)/η with p_supply = p_L + m(v) + margin

In shared boost the most loaded actuator sets p_supply of the rail. Boosted oil never costs less
than P_S, since the main pump feeds the servo pumps. Source: paper, Section 2.2.

A valve leaks as in `hydraulics.compute_valve_leakage`, at p_supply at the middle of the step with
m(V_max). The valve's leakage counts in T and in the reading `series`. In the reading `paper`, E
counts the leakage at P_S in every mode. The reading `series` also counts the slip of the servo
pumps (`hydraulics.compute_slip_flow`): oil that they must raise to p_supply again.
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from mhsb_model import hydraulics
from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.linkages.linkage import cylinder_lengths
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED_MODES, MODE_COUNT, RAIL_MODES, Mode
from mhsb_model.obstacles.clearance import move_is_clear
from mhsb_model.statics import piston_forces, piston_forces_in
from mhsb_model.types import FloatArray, IntArray, ModeArray, frozen
from mhsb_model.workspace import move_stays_in_workspace

MAX_HELD_STROKE = 1e-6
"""Largest stroke of a cylinder that counts as held by its closed valve [m]."""

STEP_INADMISSIBLE = 0  # no step in this pattern
STEP_UNNEEDED_BOOST = 1  # the pattern boosts a joint that does not need it
STEP_CONSISTENT = 2  # the pattern boosts exactly the joints that need it

DURATION_COLUMN, ENERGY_PAPER_COLUMN, ENERGY_SERIES_COLUMN = 0, 1, 2
"""Columns of a step's cost: duration T [s], energy E paper [J], energy E series [J]."""

NO_PATTERN = -1
"""Bit mask `must_boost` of an inadmissible move: all bits are set, so no combination matches."""

EnergyReading = Literal["paper", "series"]
"""Formula for the energy of boosted oil: `paper` is the published one, `series` has main and servo
pump in series.
"""
ENERGY_COLUMN: dict[str, int] = {"paper": ENERGY_PAPER_COLUMN, "series": ENERGY_SERIES_COLUMN}


class Postures(NamedTuple):
    """Postures with their cylinder lengths and forces, from which step costs are computed.

    Attributes:
        posture: Joint positions, shape (count, n) [rad or m].
        length: Cylinder lengths, shape (count, n) [m].
        force: Cylinder forces under gravity, shape (count, n), positive if they resist extension
            [N].
    """

    posture: FloatArray
    length: FloatArray
    force: FloatArray


def describe_postures(m: MachineArrays, posture: FloatArray) -> Postures:
    """Describe several postures by cylinder lengths and by piston forces under gravity.

    Args:
        m: Arrays of the machine, with its payload.
        posture: Joint positions, shape (count, n) [rad or m].

    Returns:
        Copy of the postures, with cylinder lengths [m] and piston forces, positive if they resist
        extension [N]. All are read-only, shape (count, n).
    """
    own, force = np.array(posture, order="C"), np.empty(posture.shape)
    piston_forces_in(m, own, force)
    posture = frozen(own)
    return Postures(posture, frozen(cylinder_lengths(m.linkage, posture)), frozen(force))


class HydraulicCoefficients(NamedTuple):
    """Constants of a machine from which step costs and lower bounds are computed.

    Direction 0 is extension, 1 retraction. The pressure of
    `hydraulics.compute_pressure_without_margin` is p_L + m(v) = load · per_area + outlet_pressure +
    valve_drop_factor · v². The load is +F in extension and −F in retraction.

    Attributes:
        supply_pressure: Supply pressure P_S of the main pump [Pa].
        max_boost_pressure: Highest boost pressure [Pa].
        boost_margin: Margin of the supply pressure above p_L + m(v), with boost and in mode N [Pa].
        tank_pressure: Tank pressure p_T [Pa].
        shared_flow: Main pump flow minus the leakage with all joints in mode N [m³/s].
        leakage_flow: Leakage of one valve at P_S [m³/s].
        land_leakage: Share of `leakage_flow` over the lands of the spool [-].
        idle_leakage: Leakage of valves that serve none of the n joints [m³/s].
        efficiency: Efficiency of the servo pumps η [-].
        slip: Slip of one servo pump per pressure rise [m³/(s Pa)].
        modules: Number of booster modules that each mode occupies, shape (modes,).
        area: Piston area A_dir that the supply fills, shape (n, 2) [m²].
        per_area: 1/A_dir, shape (n, 2) [1/m²].
        outlet_pressure: Part of p_L that the tank pressure on the outlet causes, shape (n, 2) [Pa].
        valve_drop_factor: Pressure drop of the valve per speed squared, m(v)/v², shape (n, 2) [Pa
            s²/m²].
        valve_drop_at_v_max: Pressure drop m(V_max), shape (n, 2) [Pa].
        inverse_speed_limit: Inverse of the largest piston speed by mode, shape (n, modes, 2) [s/m].
        boosted: Bit mask of the boosted joints of each combination, shape (patterns,).
        rest_speed: Piston speed up to which a cylinder counts as held and may need boost [m/s]. 0
            switches this rule off.
        other_oil: Oil for motions of other joints, such as a slew [m³]; only lower bounds use it.
        other_time: Least time of the motions of other joints [s]; only lower bounds use it.
    """

    supply_pressure: float
    max_boost_pressure: float
    boost_margin: float
    tank_pressure: float
    shared_flow: float
    leakage_flow: float
    land_leakage: float
    idle_leakage: float
    efficiency: float
    slip: float
    modules: IntArray
    area: FloatArray
    per_area: FloatArray
    outlet_pressure: FloatArray
    valve_drop_factor: FloatArray
    valve_drop_at_v_max: FloatArray
    inverse_speed_limit: FloatArray
    boosted: IntArray
    rest_speed: float
    other_oil: float
    other_time: float


@kernel
def compute_hydraulic_coefficients(m: MachineArrays, patterns: ModeArray) -> HydraulicCoefficients:
    """Compute the hydraulic coefficients of a machine for its mode combinations.

    Args:
        m: Arrays of the machine.
        patterns: Mode combinations, shape (patterns, n).

    Returns:
        Pressures, leakages and the main pump's flow. For each cylinder and direction: the area, the
        valve drop, and the largest speed in each mode. For each combination: the boosted joints.
        Three fields are 0; the caller may replace them. `rest_speed` is the piston speed up to
        which a cylinder counts as held and may need boost. `other_oil` and `other_time` are oil and
        time for another motion, such as a slew.
    """
    n = len(m.cap_area)
    area = np.empty((n, 2))
    outlet = np.empty((n, 2))
    valve = np.empty((n, 2))
    valve_at_top = np.empty((n, 2))
    pace = np.empty((n, MODE_COUNT, 2))
    oil = hydraulics.get_shared_hydraulics(m)
    for j in range(n):
        cap, rod = m.cap_area[j], m.rod_area[j]
        for d in range(2):
            sign = 1.0 - 2.0 * d
            area[j, d] = hydraulics.inlet_area(cap, rod, sign)
            outlet[j, d] = hydraulics.load_pressure(cap, rod, m.tank_pressure, 0.0, sign)
            valve[j, d] = hydraulics.compute_valve_drop(m.valve_coefficient[j], cap, rod, sign)
            valve_at_top[j, d] = valve[j, d] * m.max_piston_speed[j] ** 2
            for mode in range(MODE_COUNT):
                pumped = hydraulics.get_max_servo_pump_flow(oil, m.modules_per_mode[mode])
                pace[j, mode, d] = 1.0 / min(m.max_piston_speed[j], pumped / area[j, d])
    boosted = np.zeros(len(patterns), dtype=np.int64)
    for p in range(len(patterns)):
        for j in range(n):
            boosted[p] |= np.int64(BOOSTED_MODES[patterns[p, j]]) << j
    return HydraulicCoefficients(
        m.supply_pressure,
        m.max_boost_pressure,
        m.boost_margin,
        m.tank_pressure,
        m.main_pump_flow - n * m.leakage_flow,
        m.leakage_flow,
        m.land_leakage,
        m.external_leakage,
        m.servo_pump_efficiency,
        m.servo_pump_slip,
        m.modules_per_mode,
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
def _hold_pressure(c: HydraulicCoefficients, j: int, force: float) -> float:
    """Compute the supply pressure with which a cylinder at rest holds its load (load pressure).

    The cap side holds a positive force, the rod side any other force.

    Args:
        c: Hydraulic coefficients of the machine.
        j: Index of the joint.
        force: Piston force, positive if it resists extension [N].

    Returns:
        Load pressure without margins [Pa].
    """
    d = 0 if force > 0.0 else 1
    return abs(force) * c.per_area[j, d] + c.outlet_pressure[j, d]


@kernel(borrows=True)
def _compute_extra_leakage(c: HydraulicCoefficients, need: float) -> float:
    """Compute the leakage of a valve beyond its leakage at the main pump's pressure P_S.

    Args:
        c: Hydraulic coefficients of the machine.
        need: Supply pressure that the joint needs [Pa]; limited to the highest boost pressure.

    Returns:
        Additional leakage [m³/s]; 0 if `need` is at most P_S.
    """
    if need <= c.supply_pressure:
        return 0.0
    supply = min(need, c.max_boost_pressure)
    leaks = hydraulics.compute_leakage_at(
        c.leakage_flow, c.land_leakage, c.supply_pressure, c.tank_pressure, supply
    )
    return leaks - c.leakage_flow


(
    STROKE_COLUMN,
    DIRECTION_COLUMN,
    OIL_COLUMN,
    WORST_PRESSURE_COLUMN,
    MIDDLE_PRESSURE_COLUMN,
    VALVE_COLUMN,
    LEAKAGE_COLUMN,
) = 0, 1, 2, 3, 4, 5, 6
"""Columns that describe one joint's part of a move, for its cost in any mode combination.

STROKE: |ΔL| [m]. DIRECTION: 0 extension, 1 retraction. OIL: A_dir |ΔL| [m³]. WORST_PRESSURE:
largest p_L of an opposing load at start, middle and end [Pa]. It is −∞ if no load opposes the
motion, or if the closed valve holds the joint. MIDDLE_PRESSURE: p_L at the middle [Pa]. VALVE:
m(v)/v² [Pa s²/m²]. LEAKAGE: additional leakage of the valve if the joint is boosted by itself
[m³/s].
"""

MOVE_WIDTH = 7
"""Number of columns of one joint's part of a move."""


@kernel(borrows=True, forceinline=True)
def _is_loaded(move: FloatArray) -> bool:
    """Return whether a joint moves, or must be held in boost, during a move.

    All other joints are held by their closed valves. In any mode they cost as much as in mode N.

    Args:
        move: One joint's part of the move, shape (MOVE_WIDTH,), with the columns STROKE_COLUMN to
            LEAKAGE_COLUMN.

    Returns:
        True if the joint's pressure counts in the cost of the step.
    """
    return move[STROKE_COLUMN] > MAX_HELD_STROKE or move[WORST_PRESSURE_COLUMN] > -math.inf


class StepBuffers(NamedTuple):
    """Results and working memory of `price_steps_to_node`, allocated once for many calls.

    Attributes:
        cost: Cost in each combination, shape (patterns, 3): duration [s], energy by the published
            model (`paper`) [J], energy with the pumps in series (`series`) [J].
        status: STEP_INADMISSIBLE, STEP_UNNEEDED_BOOST or STEP_CONSISTENT for each combination,
            shape (patterns,).
        move: Description of each joint's part in the move to each posture, in columns STROKE_COLUMN
            to LEAKAGE_COLUMN, shape (postures of a node, n, MOVE_WIDTH).
        must_boost: Bit mask of joints that need boost even at the lowest speed, shape (postures of
            a node,); NO_PATTERN if the move is inadmissible.
        may_boost: Bit mask of joints that need boost at V_max, shape (postures of a node,).
        middle: Room for the forces at the middle of the moves, shape (postures of a node, n) [N].
    """

    cost: FloatArray
    status: IntArray
    move: FloatArray
    must_boost: IntArray
    may_boost: IntArray
    middle: FloatArray


@kernel(plain=True)
def create_step_buffers(patterns: ModeArray) -> StepBuffers:
    """Allocate the working memory of one thread for `price_steps_to_node`.

    Args:
        patterns: Mode combinations, shape (patterns, n).

    Returns:
        Uninitialised arrays with room for a node with one posture per combination.
    """
    count, n = patterns.shape
    return StepBuffers(
        np.empty((count, 3)),
        np.empty(count, dtype=np.int64),
        np.empty((count, n, MOVE_WIDTH)),
        np.empty(count, dtype=np.int64),
        np.empty(count, dtype=np.int64),
        np.empty((count, n)),
    )


class NodeMoves(NamedTuple):
    """Moves from one posture to all postures of one node.

    Attributes:
        start: Array of postures that contains the posture that the moves leave.
        origin: Row of `start` that the moves leave.
        end: Array of postures that contains the postures of the node.
        first: Row of `end` with the node's first posture.
        posture_count: Number of postures of the node.
        owner: Row of `end` in which the step of each combination ends, shape (patterns,).
        middle_force: Piston forces at the middle of each move, with `posture_count` rows or more,
            shape (…, n) [N]. NaN as the first entry marks an inadmissible move
            (`compute_middle_forces`, `mark_collisions`).
    """

    start: Postures
    origin: int
    end: Postures
    first: int
    posture_count: int
    owner: IntArray
    middle_force: FloatArray


@kernel(borrows=True)
def price_steps_to_node(
    c: HydraulicCoefficients, patterns: ModeArray, moves: NodeMoves, buffers: StepBuffers
) -> int:
    """Compute the costs of the steps from one posture to one node, in all mode combinations.

    The step of a combination ends in the posture that the node has for this combination. A step is
    consistent if its combination boosts exactly the joints that need boost. If no step is
    consistent, steps that also boost other joints are admitted (STEP_UNNEEDED_BOOST).

    Tested against the module's equations in plain NumPy.

    Args:
        c: Hydraulic coefficients of the machine.
        patterns: Mode combinations, shape (patterns, n).
        moves: Posture to leave, and postures of the node with the forces on the way.
        buffers: Results `buffers.cost` and `buffers.status`, and working memory. Written in place.

    Returns:
        Status of the admissible steps: STEP_CONSISTENT or STEP_UNNEEDED_BOOST; STEP_INADMISSIBLE
        means that no step is admissible. Otherwise the combinations p with `buffers.status[p]`
        equal to the result are admissible, and only their rows of `buffers.cost` are valid.
    """
    must, may, boosted = buffers.must_boost, buffers.may_boost, c.boosted
    cost, status = buffers.cost, buffers.status
    for k in range(moves.posture_count):
        _describe_move(c, moves, k, buffers)
    for wanted in (STEP_CONSISTENT, STEP_UNNEEDED_BOOST):
        best = STEP_INADMISSIBLE
        for p in range(len(patterns)):
            status[p] = STEP_INADMISSIBLE
            k = moves.owner[p] - moves.first
            if must[k] & ~boosted[p] or (wanted == STEP_CONSISTENT and boosted[p] & ~may[k]):
                continue
            status[p] = _price_move(c, patterns[p], buffers.move[k], cost[p])
            best = max(best, status[p])
        if best == wanted:
            return best
    return STEP_INADMISSIBLE


@kernel(inline="always")
def _describe_move(
    c: HydraulicCoefficients, moves: NodeMoves, k: int, buffers: StepBuffers
) -> None:
    """Compute stroke, oil and pressures of each joint in a move, and find the joints to boost.

    A joint that is no faster than `c.rest_speed` is described as held if its load must be held in
    boost.

    Args:
        c: Hydraulic coefficients of the machine.
        moves: Moves from one posture to the postures of a node.
        k: Number of the move in `moves`, from 0.
        buffers: `move[k]` (columns STROKE_COLUMN to LEAKAGE_COLUMN of each joint) and two bit masks
            of joints are written in place. Joints in `must_boost[k]` need boost even at the lowest
            speed, joints in `may_boost[k]` at V_max. If `moves.middle_force[k]` (the piston forces
            at the middle of the move) is NaN, the move is inadmissible. `must_boost[k]` is then
            NO_PATTERN, `may_boost[k]` is 0, and `move[k]` is unchanged.
    """
    start, end, i, last = moves.start, moves.end, moves.origin, moves.first + k
    n = moves.middle_force.shape[1]
    buffers.must_boost[k] = buffers.may_boost[k] = 0
    if math.isnan(moves.middle_force[k, 0]):
        buffers.must_boost[k] = NO_PATTERN
        return
    duration = 0.0  # by the speed limits in mode N
    if c.rest_speed > 0.0:
        for j in range(n):
            stroke = end.length[last, j] - start.length[i, j]
            direction = 0 if stroke > 0.0 else 1
            duration = max(duration, abs(stroke) * c.inverse_speed_limit[j, Mode.N, direction])
    for j in range(n):
        delta = end.length[last, j] - start.length[i, j]
        forces = start.force[i, j], moves.middle_force[k, j], end.force[last, j]
        _describe_stroke(c, j, delta, forces, buffers, k)
        if duration > 0.0 and abs(delta) <= c.rest_speed * duration:
            _describe_hold(c, j, forces, buffers, k)


@kernel(inline="always")
def _describe_stroke(
    c: HydraulicCoefficients,
    j: int,
    delta: float,
    forces: tuple[float, float, float],
    buffers: StepBuffers,
    k: int,
) -> None:
    """Compute stroke, oil and pressures of one joint, and find whether it needs boost to move.

    Args:
        c: Hydraulic coefficients of the machine.
        j: Index of the joint.
        delta: Change of the cylinder's length [m].
        forces: Piston forces at start, middle and end, positive if they resist extension [N].
        buffers: `move[k, j]` (columns STROKE_COLUMN to LEAKAGE_COLUMN) is written in place. Bit j
            of `must_boost[k]` is set if the joint needs boost even at the lowest speed. Bit j of
            `may_boost[k]` is set if it needs boost at V_max. Bits are never cleared. In two cases
            no bit is set, and the worst pressure is −inf: no force resists the move, or the stroke
            is at most MAX_HELD_STROKE. Over so short a stroke, the closed valve holds the joint.
            Such a short stroke also has no additional leakage.
        k: Number of the move.
    """
    move, stroke = buffers.move[k, j], abs(delta)
    d = 0 if delta > 0.0 else 1
    sign = 1.0 - 2.0 * d
    at_middle = sign * forces[1]
    load = max(sign * forces[0], at_middle, sign * forces[2])
    worst = -math.inf
    if load > 0.0 and stroke > MAX_HELD_STROKE:
        worst = load * c.per_area[j, d] + c.outlet_pressure[j, d]
        if worst + c.boost_margin > c.supply_pressure:
            buffers.must_boost[k] |= 1 << j
        if worst + c.boost_margin + c.valve_drop_at_v_max[j, d] > c.supply_pressure:
            buffers.may_boost[k] |= 1 << j
    move[STROKE_COLUMN] = stroke
    move[DIRECTION_COLUMN] = d
    move[OIL_COLUMN] = c.area[j, d] * stroke
    move[WORST_PRESSURE_COLUMN] = worst
    move[MIDDLE_PRESSURE_COLUMN] = at_middle * c.per_area[j, d] + c.outlet_pressure[j, d]
    move[VALVE_COLUMN] = c.valve_drop_factor[j, d]
    move[LEAKAGE_COLUMN] = 0.0
    if stroke > MAX_HELD_STROKE:
        need = move[MIDDLE_PRESSURE_COLUMN] + c.valve_drop_at_v_max[j, d] + c.boost_margin
        move[LEAKAGE_COLUMN] = _compute_extra_leakage(c, need)


@kernel(inline="always")
def _describe_hold(
    c: HydraulicCoefficients,
    j: int,
    forces: tuple[float, float, float],
    buffers: StepBuffers,
    k: int,
) -> None:
    """Describe a slow joint as held in boost, if its load must be held in boost.

    The joint must be held in boost if the main pump's pressure P_S cannot hold its load, but the
    highest boost pressure can. Otherwise nothing changes.

    Args:
        c: Hydraulic coefficients of the machine.
        j: Index of the joint.
        forces: Piston forces at start, middle and end, positive if they resist extension [N].
        buffers: The pressures and the leakage in `move[k, j]` are overwritten, and bit j of
            `must_boost[k]` and `may_boost[k]` is set.
        k: Number of the move.
    """
    move = buffers.move[k, j]
    held = _hold_pressure(c, j, forces[1])
    worst = max(held, _hold_pressure(c, j, forces[0]))
    worst = max(worst, _hold_pressure(c, j, forces[2]))
    if c.supply_pressure < worst + c.boost_margin <= c.max_boost_pressure:
        buffers.must_boost[k] |= 1 << j
        buffers.may_boost[k] |= 1 << j
        move[WORST_PRESSURE_COLUMN] = worst
        move[MIDDLE_PRESSURE_COLUMN] = held
        move[VALVE_COLUMN] = 0.0
        move[LEAKAGE_COLUMN] = _compute_extra_leakage(c, held + c.boost_margin)


@kernel(inline="always")
def _price_move(
    c: HydraulicCoefficients, pattern: ModeArray, move: FloatArray, cost: FloatArray
) -> int:
    """Compute duration, energies and status of a move in one mode combination.

    Args:
        c: Hydraulic coefficients of the machine.
        pattern: Mode of each joint, shape (n,).
        move: Columns STROKE_COLUMN to LEAKAGE_COLUMN of each joint's move, shape (n, MOVE_WIDTH).
        cost: Duration [s], energy by the published model (`paper`) [J], energy with the pumps in
            series (`series`) [J], shape (3,). Written in place unless the result is
            STEP_INADMISSIBLE.

    Returns:
        STEP_INADMISSIBLE; STEP_UNNEEDED_BOOST if the combination also boosts a joint that does not
        need it; otherwise STEP_CONSISTENT.
    """
    duration, rail_leak = _compute_duration(c, pattern, move)
    if duration == math.inf:
        return STEP_INADMISSIBLE
    status, rail = _check_pressures(c, pattern, move, duration)
    if status != STEP_INADMISSIBLE:
        paper, series = _compute_energies(c, pattern, move, duration, (rail, rail_leak))
        cost[DURATION_COLUMN] = duration
        cost[ENERGY_PAPER_COLUMN] = paper
        cost[ENERGY_SERIES_COLUMN] = series
    return status


@kernel(inline="always")
def _compute_duration(
    c: HydraulicCoefficients, pattern: ModeArray, move: FloatArray
) -> tuple[float, float]:
    """Compute a move's duration in one mode combination, and the additional leakage at the rail.

    The duration is the longest of several times. Each piston needs time for its stroke at its
    largest speed. The main pump needs time for the oil of all pistons and the leakage of all
    valves.

    Args:
        c: Hydraulic coefficients of the machine.
        pattern: Mode of each joint, shape (n,).
        move: Columns STROKE_COLUMN to LEAKAGE_COLUMN of each joint's move, shape (n, MOVE_WIDTH).

    Returns:
        Duration [s], and leakage of each valve on the shared rail beyond its leakage at the main
        pump's pressure [m³/s]. The duration is inf if leakage takes the whole flow. The additional
        leakage is the largest in LEAKAGE_COLUMN of all joints on the rail; 0 if no joint is on the
        rail.
    """
    duration = volume = rail_leak = 0.0
    shared = c.shared_flow
    for j in range(len(pattern)):
        d, mode = int(move[j, DIRECTION_COLUMN]), pattern[j]
        duration = max(duration, move[j, STROKE_COLUMN] * c.inverse_speed_limit[j, mode, d])
        volume += move[j, OIL_COLUMN]
        if RAIL_MODES[mode]:
            rail_leak = max(rail_leak, move[j, LEAKAGE_COLUMN])
        elif BOOSTED_MODES[mode]:
            shared -= move[j, LEAKAGE_COLUMN]
    if rail_leak > 0.0:
        for j in range(len(pattern)):
            if RAIL_MODES[pattern[j]] and _is_loaded(move[j]):
                shared -= rail_leak
    if shared <= 0.0:
        return math.inf, rail_leak
    return max(duration, volume / shared), rail_leak


@kernel(inline="always")
def _check_pressures(
    c: HydraulicCoefficients, pattern: ModeArray, move: FloatArray, duration: float
) -> tuple[int, float]:
    """Check whether a mode combination boosts exactly the joints that need boost in a move.

    Args:
        c: Hydraulic coefficients of the machine.
        pattern: Mode of each joint, shape (n,).
        move: Columns STROKE_COLUMN to LEAKAGE_COLUMN of each joint's move, shape (n, MOVE_WIDTH).
        duration: Duration of the move [s].

    Returns:
        Status, and supply pressure of the shared rail at the middle of the move [Pa], 0 if no
        loaded joint is on the rail. The status is STEP_INADMISSIBLE if a joint that needs boost is
        not boosted, or needs more than the highest boost pressure. In this case the rail's pressure
        is undefined. The status is STEP_UNNEEDED_BOOST if a joint without need is boosted,
        otherwise STEP_CONSISTENT.
    """
    status, rail = STEP_CONSISTENT, 0.0
    for j in range(len(pattern)):
        boosted, needed = BOOSTED_MODES[pattern[j]], False
        if _is_loaded(move[j]):
            speed = move[j, STROKE_COLUMN] / duration
            reserve = move[j, VALVE_COLUMN] * speed * speed + c.boost_margin
            worst = move[j, WORST_PRESSURE_COLUMN] + reserve
            if worst > c.max_boost_pressure:
                return STEP_INADMISSIBLE, rail
            needed = worst > c.supply_pressure
            if RAIL_MODES[pattern[j]]:
                rail = max(rail, move[j, MIDDLE_PRESSURE_COLUMN] + reserve)
        if needed and not boosted:
            return STEP_INADMISSIBLE, rail
        if boosted and not needed:
            status = STEP_UNNEEDED_BOOST
    return status, rail


@kernel(inline="always")
def _compute_energies(
    c: HydraulicCoefficients,
    pattern: ModeArray,
    move: FloatArray,
    duration: float,
    rail: tuple[float, float],
) -> tuple[float, float]:
    """Compute the energies of an admissible move in one mode combination.

    Args:
        c: Hydraulic coefficients of the machine.
        pattern: Mode of each joint, shape (n,).
        move: Columns STROKE_COLUMN to LEAKAGE_COLUMN of each joint's move, shape (n, MOVE_WIDTH).
        duration: Duration of the move [s].
        rail: Supply pressure of the shared rail [Pa], and leakage of each valve on the rail beyond
            its leakage at P_S [m³/s].

    Returns:
        Energy by the published model (`paper`) and energy with main pump and servo pump in series
        (`series`) [J].
    """
    paper_sum = series_sum = c.supply_pressure * c.idle_leakage * duration
    for j in range(len(pattern)):
        paper = series = c.supply_pressure
        more = 0.0
        if BOOSTED_MODES[pattern[j]] and _is_loaded(move[j]):
            middle = move[j, MIDDLE_PRESSURE_COLUMN]
            supply, more = rail
            if not RAIL_MODES[pattern[j]]:
                more = move[j, LEAKAGE_COLUMN]
                speed = move[j, STROKE_COLUMN] / duration
                supply = middle + move[j, VALVE_COLUMN] * speed * speed + c.boost_margin
            paper = max(paper, middle / c.efficiency)
            rise = max(0.0, supply - c.supply_pressure)
            series += rise / c.efficiency
            slipped = hydraulics.compute_slip_flow(c.slip, c.modules[pattern[j]], rise)
            series_sum += rise / c.efficiency * slipped * duration
        oil = move[j, OIL_COLUMN] + c.leakage_flow * duration
        paper_sum += paper * oil
        series_sum += series * (oil + more * duration)
    return paper_sum, series_sum


@kernel
def compute_middle_forces(
    m: MachineArrays, start: FloatArray, end: FloatArray, first: int, force: FloatArray
) -> None:
    """Compute the piston forces under gravity at the middle of moves that leave one posture.

    Each move is straight in joint space. If the tip leaves the workspace on a move, its forces are
    NaN, which marks it as inadmissible.

    Args:
        m: Arrays of the machine, with its payload.
        start: Joint positions at the start of all moves, shape (n,) [rad or m].
        end: Joint positions, shape (postures, n) [rad or m].
        first: Row of `end` that the first move reaches. Move k reaches row `first` + k.
        force: Forces, positive if they resist extension, shape (moves, n) [N]. Written in place.
            The number of rows is the number of moves.
    """
    middle = np.empty(len(start))
    for k in range(len(force)):
        if not move_stays_in_workspace(m, start, end[first + k]):
            force[k] = math.nan
            continue
        for j in range(len(start)):
            middle[j] = 0.5 * (start[j] + end[first + k, j])
        piston_forces(m, middle, force[k])


@kernel(borrows=True)
def mark_collisions(
    m: MachineArrays,
    obstacles: FloatArray,
    start: FloatArray,
    end: FloatArray,
    first: int,
    force: FloatArray,
) -> None:
    """Write NaN as the forces of moves on which the arm comes too near to an obstacle.

    Args:
        m: Arrays of the machine.
        obstacles: Rows of the obstacles with the margin added, `Obstacles.path_rows`.
        start: Joint positions at the start of all moves, shape (n,) [rad or m].
        end: Joint positions, shape (postures, n) [rad or m].
        first: Row of `end` that the first move reaches; further moves reach the following rows.
        force: Piston forces at the middle of each move, shape (count, n) [N]. Written in place: all
            entries of a colliding move become NaN.
    """
    if len(obstacles) == 0:
        return
    for k in range(len(force)):
        if not move_is_clear(m, obstacles, start, end[first + k], False):
            force[k] = math.nan


@kernel
def _price_steps_of_moves(
    m: MachineArrays,
    obstacles: FloatArray,
    c: HydraulicCoefficients,
    patterns: ModeArray,
    moves: NodeMoves,
    buffers: StepBuffers,
) -> int:
    """Compute the piston forces in the middle of moves, and the costs of the steps.

    The moves lead from one posture to all postures of one node. A step is a move in one mode
    combination.

    Args:
        m: Arrays of the machine.
        obstacles: Rows of the obstacles.
        c: Hydraulic coefficients of the machine.
        patterns: Mode combinations, shape (patterns, n).
        moves: Start posture, and postures of the node. Writes `middle_force` in place.
        buffers: Results `buffers.cost` and `buffers.status`, and working memory. Written in place.

    Returns:
        Value of `buffers.status` that admissible steps have, from `price_steps_to_node`.
    """
    start, end, force = moves.start.posture[moves.origin], moves.end.posture, moves.middle_force
    compute_middle_forces(m, start, end, moves.first, force)
    mark_collisions(m, obstacles, start, end, moves.first, force)
    return price_steps_to_node(c, patterns, moves, buffers)


@dataclass(frozen=True, eq=False)
class StepCosts:
    """Durations and energies of one step in every mode combination.

    Attributes:
        admissible: True for each combination in which the step may be taken, shape (patterns,).
        duration: Duration, shape (patterns,) [s]; NaN if inadmissible.
        energy: Energy in the reading `paper`, shape (patterns,) [J]; NaN if inadmissible.
        energy_series: Energy in the reading `series`, shape (patterns,) [J]; NaN if inadmissible.
    """

    admissible: np.ndarray
    duration: FloatArray
    energy: FloatArray
    energy_series: FloatArray


def compute_step_costs(
    machine: Machine, start: FloatArray, end: FloatArray, rest_speed: float = 0.0
) -> StepCosts:
    """Compute the costs of the step between any two postures in every mode combination.

    The postures need not belong to a posture table. The step is inadmissible in all combinations if
    the tip leaves the workspace or the arm comes too near to an obstacle on the way.

    Args:
        machine: Machine with its payload, mode combinations and obstacles.
        start: Joint positions at the start, shape (n,) [rad or m].
        end: Joint positions at the end, shape (n,) [rad or m].
        rest_speed: Piston speed up to which a cylinder counts as held and may need boost [m/s]. 0
            switches this rule off.

    Returns:
        Admissibility, duration [s] and energies in both readings (`paper`, `series`) [J] by mode
        combination, in the order of `machine.patterns`.
    """
    arrays, patterns = machine.arrays, machine.patterns
    from_start = describe_postures(arrays, np.array([start], dtype=np.float64))
    to_end = describe_postures(arrays, np.array([end], dtype=np.float64))
    middle = np.empty((1, machine.joint_count))
    owner = frozen(np.zeros(len(patterns), dtype=np.int64))
    scratch = create_step_buffers(patterns)
    circuit = compute_hydraulic_coefficients(arrays, patterns)._replace(rest_speed=rest_speed)
    moves = NodeMoves(from_start, 0, to_end, 0, 1, owner, middle)
    obstacles = machine.obstacles.path_rows
    status = _price_steps_of_moves(arrays, obstacles, circuit, patterns, moves, scratch)
    admissible = (scratch.status == status) & (status != STEP_INADMISSIBLE)
    cost = np.where(admissible[:, None], scratch.cost, np.nan)
    return StepCosts(
        frozen(admissible),
        frozen(cost[:, DURATION_COLUMN]),
        frozen(cost[:, ENERGY_PAPER_COLUMN]),
        frozen(cost[:, ENERGY_SERIES_COLUMN]),
    )


def warm_up(machine: Machine) -> None:
    """Compile the kernels that compute the costs of steps.

    Args:
        machine: Machine whose joints and mode combinations give the argument types.
    """
    compute_step_costs(machine, machine.arrays.joint_min, machine.arrays.joint_max)
