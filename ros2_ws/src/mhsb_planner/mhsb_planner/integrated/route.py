"""What a route costs: a polygon in the space of cylinder lengths, with the best modes along it.

A route is cut into pieces, each a step with the costs of `s2_step`. Which pattern each piece is
run in is decided by dynamic programming over the pieces: least w₁ E + w₂ T + w₃ switches, and
w₄ M where the polytope's area counts (`area_shortfall`). Loads that are held are boosted as in the
motion, and the switches to the modes that hold the arm at the end count.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.hydraulics import needs_boost
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import tip_position, tip_positions
from mhsb_model.linkages.linkage import joint_angle
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.obstacles.clearance import move_is_clear
from mhsb_model.statics import piston_forces
from mhsb_model.types import FloatArray, IntArray, ModeArray, frozen
from mhsb_model.workspace import node_set_excess
from mhsb_planner.search.area_shortfall import WITHOUT_AREA, AreaTerm, price_shortfall
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.lower_bound import least_cost_between
from mhsb_planner.search.s2_step import (
    DURATION,
    ENERGY_PAPER,
    ENERGY_SERIES,
    INADMISSIBLE,
    Circuit,
    Postures,
    Scratch,
    circuit_of,
    middle_forces,
    new_scratch,
    steps_to_node,
)

PIECE = 2e-3
"""Longest stroke of a cylinder within one piece, of an arm of the paper's size [m]."""

ROUNDING = 1e-9
"""The tip may lie this far outside the workspace [m]; farther only where it comes from there."""

NEAR = 5e-3
"""Within this of the workspace's edge a piece is looked at more closely [m]."""

BOOST_RESERVE = 30e3
"""Where the polytope's area counts, boost is taken for needed this much earlier [Pa]: it takes area
away, and a motion follows its route too loosely to avoid it by less."""

REST_SPEED = 2e-4
"""Below this a piston holds its load, for S3 and S4, too: `motion.s3_limits.DEAD_BAND` [m/s]."""

HALF_WAY = 2


class Terms(NamedTuple):
    """By what routes are priced.

    switches  int64[patterns + 1, patterns], actuators that change their mode from one pattern
              to another; the last row from the modes in force at the start
    weight    float64[3], of energy [1/J], time [1/s] and mode switches
    column    of the energy reading in a step's cost
    area      w₄ and the area that counts as full
    obstacles `Obstacles.path_rows`
    piece     longest stroke of a cylinder within one piece [m]
    """

    machine: MachineArrays
    circuit: Circuit
    patterns: ModeArray
    switches: IntArray
    weight: FloatArray
    column: int
    area: AreaTerm
    obstacles: FloatArray
    piece: float


def terms(
    machine: Machine,
    start_modes: ModeArray,
    weight: FloatArray,
    column: int,
    area: AreaTerm = WITHOUT_AREA,
) -> Terms:
    """Terms for routes that begin with the modes uint8[n] in force."""
    patterns = machine.patterns
    before = np.vstack([patterns, start_modes[None, :]])
    switches = np.count_nonzero(before[:, None, :] != patterns[None, :, :], axis=2)
    circuit = circuit_of(machine.arrays, patterns)._replace(rest_speed=REST_SPEED)
    if area.weight > 0.0:
        circuit = circuit._replace(boost_margin=circuit.boost_margin + BOOST_RESERVE)
    return Terms(
        machine.arrays,
        circuit,
        patterns,
        frozen(switches),
        frozen(weight),
        column,
        area,
        machine.obstacles.path_rows,
        PIECE * machine.scale,
    )


def patient(t: Terms) -> Terms:
    """The same where leakage costs nothing, for there is time anyway."""
    return t._replace(circuit=t.circuit._replace(leakage_flow=0.0, idle_leakage=0.0))


class Memory(NamedTuple):
    """Working memory of one thread, so that pricing allocates nothing."""

    scratch: Scratch
    points: Postures  # [3], both ends of the piece and half-way
    middle: FloatArray  # [1, n] cylinder forces half-way [N]
    owner: IntArray  # [2, patterns] for each point: all patterns end in this posture
    value: FloatArray  # [2, patterns + 1] least cost to both points by pattern of arrival; the
    # last is that of the modes in force at the start
    shortfall: FloatArray  # [patterns] w₄ M of the piece


@kernel
def new_memory(t: Terms) -> Memory:
    """Working memory for these terms."""
    count, n = t.patterns.shape
    points = Postures(np.empty((3, n)), np.empty((3, n)), np.empty((3, n)))
    owner = np.zeros((2, count), dtype=np.int64)
    owner[1, :] = 1
    return Memory(
        new_scratch(t.patterns),
        points,
        np.empty((1, n)),
        owner,
        np.empty((2, count + 1)),
        np.zeros(count),
    )


@kernel(borrows=True)
def place(m: MachineArrays, points: Postures, i: int, length: FloatArray, near: int) -> None:
    """Put the posture with the cylinder lengths `length` [m] at points[i].

    near: the point whose angles are close, for the inversion to start from.
    """
    for j in range(len(length)):
        points.length[i, j] = length[j]
        points.posture[i, j] = joint_angle(
            m.linkage[j], length[j], m.joint_min[j], m.joint_max[j], points.posture[near, j]
        )
    piston_forces(m, points.posture[i], points.force[i])


@kernel(borrows=True)
def _outside(m: MachineArrays, posture: FloatArray) -> float:
    """How far the tip lies outside the workspace [m]; negative within it."""
    x, z = tip_position(m, posture)
    return node_set_excess(m, x, z)


@kernel(borrows=True)
def _leaves_workspace(m: MachineArrays, points: Postures, here: int) -> bool:
    """Whether the tip gets out of the workspace from points[here] to the other, or further out.

    Near the edge also half-way in cylinder lengths: `middle_forces` looks at a straight line in
    joint space, beside which a route curves.
    """
    begin, end = _outside(m, points.posture[here]), _outside(m, points.posture[1 - here])
    allowed = max(ROUNDING, begin)
    if end > allowed:
        return True
    if max(begin, end) < -NEAR:
        return False
    for j in range(points.length.shape[1]):
        length = 0.5 * (points.length[0, j] + points.length[1, j])
        points.posture[HALF_WAY, j] = joint_angle(
            m.linkage[j], length, m.joint_min[j], m.joint_max[j], points.posture[here, j]
        )
    return _outside(m, points.posture[HALF_WAY]) > allowed


@kernel(borrows=True)
def price_piece(t: Terms, w: Memory, here: int) -> int:
    """Price the step from w.points[here] to the other one in all patterns.

    Into w.scratch and w.shortfall. Returns the status of the steps that may be taken, as
    `s2_step.steps_to_node`.
    """
    there = 1 - here
    m, posture = t.machine, w.points.posture
    if _leaves_workspace(m, w.points, here):
        return INADMISSIBLE
    if len(t.obstacles) > 0 and not move_is_clear(
        m, t.obstacles, posture[here], posture[there], True
    ):
        return INADMISSIBLE
    middle_forces(m, posture[here], posture, there, w.middle)
    status = steps_to_node(
        t.circuit,
        t.patterns,
        w.points,
        here,
        w.points,
        there,
        1,
        w.owner[there],
        w.middle,
        w.scratch,
    )
    if t.area.weight > 0.0 and status != INADMISSIBLE:
        price_shortfall(
            m,
            t.area,
            posture[here],
            posture[there],
            t.patterns,
            w.scratch.status,
            status,
            w.shortfall,
        )
    return status


@kernel
def pieces_between(start: FloatArray, end: FloatArray, piece: float) -> int:
    """Into how many pieces of at most so many metres a straight move between lengths[n] is cut."""
    stroke = 0.0
    for j in range(len(start)):
        stroke = max(stroke, abs(end[j] - start[j]))
    return max(1, math.ceil(stroke / piece - 1e-9))


@kernel(borrows=True)
def least_step(t: Terms, start: FloatArray, end: FloatArray) -> float:
    """Least cost of any way between two cylinder lengths[n], in any modes."""
    return least_cost_between(t.circuit, start, end, t.weight)


@kernel(borrows=True)
def _cost_of(t: Terms, w: Memory, p: int) -> float:
    """w₁ E + w₂ T + w₄ M of the piece priced in pattern p."""
    cost = w.scratch.cost
    return (
        t.weight[0] * cost[p, t.column] + t.weight[1] * cost[p, DURATION] + w.shortfall[p]
    )


@kernel(borrows=True)
def _advance(t: Terms, w: Memory, here: int, parent: IntArray) -> float:
    """Take the piece from w.points[here], reached at w.value[here], to the other point.

    parent  int64[patterns], written: the pattern before, for each in which the piece may be run

    Returns the least cost so far, inf where there is no step.
    """
    status = price_piece(t, w, here)
    if status == INADMISSIBLE:
        return math.inf
    value, after = w.value[here], w.value[1 - here]
    w_switch = t.weight[2]
    after[:] = math.inf
    least = math.inf
    for p in range(len(t.patterns)):
        if w.scratch.status[p] != status:
            continue
        best = math.inf
        for o in range(len(value)):
            arrived = value[o] + w_switch * t.switches[o, p]
            if arrived < best:
                best = arrived
                parent[p] = o
        after[p] = best + _cost_of(t, w, p)
        least = min(least, after[p])
    return least


@kernel(borrows=True)
def switches_to_hold(m: MachineArrays, force: FloatArray, modes: ModeArray) -> int:
    """Actuators that change their mode to hold the loads force[n] [N], from modes[n]."""
    count = 0
    for j in range(len(force)):
        hold = Mode.DB if needs_boost(m, j, force[j], 0.0) else Mode.N
        if modes[j] != hold:
            count += 1
    return count


@kernel(borrows=True)
def _ended(t: Terms, w: Memory, at: int) -> float:
    """Least cost at w.points[at], the switches to the holding modes there included.

    They are added to w.value[at].
    """
    least = math.inf
    for p in range(len(t.patterns)):
        count = switches_to_hold(t.machine, w.points.force[at], t.patterns[p])
        w.value[at, p] += t.weight[2] * count
        least = min(least, w.value[at, p])
    return least


@kernel
def begin_route(t: Terms, w: Memory, length: FloatArray, posture: FloatArray) -> None:
    """Be at the start of a route, with the modes in force there."""
    w.points.posture[0] = posture
    w.points.length[0] = length
    piston_forces(t.machine, posture, w.points.force[0])
    w.value[0, :] = math.inf
    w.value[0, -1] = 0.0


@kernel
def continue_route(
    t: Terms, w: Memory, via: FloatArray, limit: float, parent: IntArray, ends: bool = True
) -> float:
    """Go on from w.points[0], which is at via[0], through the lengths via[points, n] [m].

    limit   costs that reach it do not matter: inf is returned
    parent  int64[pieces or 1, patterns], written: before which pattern each piece's pattern was;
            with one row only the last piece's are kept
    ends    whether the arm then rests, and is to be held

    Returns the least cost so far, from the start of the route on, inf where there is no way;
    otherwise w.points[0] and w.value[0] are at the end then.
    """
    rest = 0.0
    for s in range(len(via) - 1):
        rest += least_step(t, via[s], via[s + 1])
    here, row = 0, 0
    length = np.empty(via.shape[1])
    least = 0.0
    for s in range(len(via) - 1):
        count = pieces_between(via[s], via[s + 1], t.piece)
        piece = least_step(t, via[s], via[s + 1]) / count
        for k in range(1, count + 1):
            for j in range(len(length)):
                length[j] = via[s, j] + (via[s + 1, j] - via[s, j]) * k / count
            place(t.machine, w.points, 1 - here, length, here)
            least = _advance(t, w, here, parent[row])
            rest -= piece
            if least + rest >= limit:
                return math.inf
            here = 1 - here
            row = row + 1 if row + 1 < len(parent) else 0
    if ends:
        least = _ended(t, w, here)
        if least >= limit:
            return math.inf
    if here == 1:
        w.points.posture[0] = w.points.posture[1]
        w.points.length[0] = w.points.length[1]
        w.points.force[0] = w.points.force[1]
        w.value[0] = w.value[1]
    return least


@kernel
def price_route(
    t: Terms, w: Memory, via: FloatArray, start: FloatArray, limit: float
) -> float:
    """Least cost of the route through the lengths via[points, n] [m]; inf where there is none.

    start  float64[n] rad, the posture at via[0]
    limit  costs that reach it do not matter: inf is returned
    """
    begin_route(t, w, via[0], start)
    return continue_route(t, w, via, limit, np.empty((1, len(t.patterns)), dtype=np.int64))


@kernel
def costs_ahead(t: Terms, w: Memory, via: FloatArray, start: FloatArray) -> FloatArray:
    """Least cost from each corner of a possible route to its end, float64[points, patterns].

    By the pattern in which the corner is reached; that of the start does not matter, and inf stands
    for it. The switches from one pattern to the next and to the holding modes are in it.
    """
    pieces, patterns = 0, len(t.patterns)
    for s in range(len(via) - 1):
        pieces += pieces_between(via[s], via[s + 1], t.piece)
    cost = np.full((pieces, patterns), np.inf)
    begin_route(t, w, via[0], start)
    length = np.empty(via.shape[1])
    here, row = 0, 0
    for s in range(len(via) - 1):
        count = pieces_between(via[s], via[s + 1], t.piece)
        for k in range(1, count + 1):
            for j in range(len(length)):
                length[j] = via[s, j] + (via[s + 1, j] - via[s, j]) * k / count
            place(t.machine, w.points, 1 - here, length, here)
            status = price_piece(t, w, here)
            for p in range(patterns):
                if status != INADMISSIBLE and w.scratch.status[p] == status:
                    cost[row, p] = _cost_of(t, w, p)
            here, row = 1 - here, row + 1
    ahead = np.full((len(via), patterns), np.inf)
    for p in range(patterns):
        count = switches_to_hold(t.machine, w.points.force[here], t.patterns[p])
        ahead[-1, p] = t.weight[2] * count
    after, before = ahead[-1].copy(), np.empty(patterns)
    for s in range(len(via) - 2, 0, -1):
        for _ in range(pieces_between(via[s], via[s + 1], t.piece)):
            row -= 1
            before[:] = np.inf
            for p in range(patterns):
                there = cost[row, p] + after[p]
                if there < np.inf:
                    for o in range(patterns):
                        before[o] = min(before[o], there + t.weight[2] * t.switches[o, p])
            after[:] = before
        ahead[s] = after
    return ahead


@kernel
def _best_patterns(t: Terms, w: Memory, via: FloatArray, start: FloatArray) -> IntArray:
    """The pattern of every piece of a route on which there is a way, int64[pieces]."""
    pieces = 0
    for s in range(len(via) - 1):
        pieces += pieces_between(via[s], via[s + 1], t.piece)
    parent = np.empty((pieces, len(t.patterns)), dtype=np.int64)
    begin_route(t, w, via[0], start)
    continue_route(t, w, via, math.inf, parent)
    pattern = np.empty(pieces, dtype=np.int64)
    pattern[-1] = np.argmin(w.value[0, :-1])
    for k in range(pieces - 1, 0, -1):
        pattern[k - 1] = parent[k, pattern[k]]
    return pattern


@kernel
def _unrolled(
    t: Terms, w: Memory, via: FloatArray, start: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Postures at the ends of all pieces, the pieces' best patterns, and their costs in these."""
    pattern = _best_patterns(t, w, via, start)
    begin_route(t, w, via[0], start)
    posture = np.empty((len(pattern) + 1, via.shape[1]))
    cost = np.empty((len(pattern), 3))
    posture[0] = start
    here, row = 0, 0
    for s in range(len(via) - 1):
        count = pieces_between(via[s], via[s + 1], t.piece)
        for k in range(1, count + 1):
            length = via[s] + (via[s + 1] - via[s]) * k / count
            place(t.machine, w.points, 1 - here, length, here)
            price_piece(t, w, here)
            cost[row] = w.scratch.cost[pattern[row]]
            here, row = 1 - here, row + 1
            posture[row] = w.points.posture[here]
    return posture, pattern, cost


def path_of(
    t: Terms,
    w: Memory,
    via: FloatArray,
    cost: float,
    start: FloatArray,
    start_modes: ModeArray,
    lower_bound: float,
    statistics: SearchStatistics,
) -> DiscretePath:
    """The discrete path of a route, piece by piece, with the best modes.

    start  float64[n] rad, the posture at via[0]
    cost   of the route
    """
    posture, pattern, of_step = _unrolled(t, w, via, start)
    return DiscretePath(
        tip=tip_positions(t.machine, posture),
        posture=posture,
        modes=t.patterns[pattern],
        duration=of_step[:, DURATION],
        energy=of_step[:, ENERGY_PAPER],
        energy_series=of_step[:, ENERGY_SERIES],
        cost=cost,
        start_modes=start_modes,
        lower_bound=lower_bound,
        statistics=statistics,
    )
