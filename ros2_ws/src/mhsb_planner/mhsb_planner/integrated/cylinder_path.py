"""Cost of a cylinder path (a polyline of cylinder lengths) with the best modes along it.

A cylinder path is given by waypoints `via`, shape (points, n) [m]. Each segment is cut into pieces
of limited stroke, and each piece is priced as a step of `s2_step`. Dynamic programming over the
pieces picks the mode combination of each piece. It minimises

    w₁ E + w₂ T + w₃ switches + w₄ M

with energy E [J], time T [s], the number of mode switches and the manipulability loss M [m]
(`manipulability_loss`). A cylinder that stands still is boosted if the main pump's pressure P_S
cannot hold its load. Switches at the end of the path to the modes that hold the arm also count.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_model.hydraulics import needs_boost
from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import tip_position
from mhsb_model.linkages.linkage import find_joint_angle
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.obstacles.clearance import move_is_clear
from mhsb_model.statics import piston_forces
from mhsb_model.types import FloatArray, IntArray, ModeArray, frozen
from mhsb_model.workspace import (
    compute_workspace_excess,
    move_between_tips_stays_in_workspace,
)
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.lower_bound import bound_cost_between
from mhsb_planner.search.manipulability_loss import WITHOUT_AREA, AreaTerm, compute_step_area_loss
from mhsb_planner.search.s2_step import (
    DURATION_COLUMN,
    ENERGY_PAPER_COLUMN,
    ENERGY_SERIES_COLUMN,
    STEP_INADMISSIBLE,
    HydraulicCoefficients,
    NodeMoves,
    Postures,
    StepBuffers,
    compute_hydraulic_coefficients,
    create_step_buffers,
    price_steps_to_node,
)

MAX_PIECE_STROKE = 2e-3
"""Largest stroke of a cylinder within one piece, for an arm of the paper's size [m]."""

WORKSPACE_TOLERANCE = 1e-9
"""Largest distance of the tip outside the workspace [m]. A path that starts farther outside may
stay as far outside.
"""

WORKSPACE_EDGE_DISTANCE = 5e-3
"""Distance from the workspace's edge below which the middle of a piece is checked, too [m]."""

BOOST_RESERVE = 30e3
"""Increase of `HydraulicCoefficients.boost_margin` if the manipulability loss has a weight [Pa].

Boost reduces the velocity polytope's area. With a smaller margin, a motion that deviates slightly
from its path could need boost where the path needs none.
"""

CACHED_MACHINE_COUNT = 4
"""Number of machine objects whose coefficients and numbers of mode switches are kept [-]: one for
V_max, and one for each lower speed that is tried.
"""

MIDDLE_POINT = 2
"""Index in `PathCostBuffers.points` of the posture half-way along a piece."""


class PathCostModel(NamedTuple):
    """Constants from which the cost of a cylinder path follows.

    Attributes:
        machine: Arrays of the machine.
        circuit: Hydraulic coefficients of the machine.
        patterns: Mode combinations, uint8, shape (patterns, n).
        switches: Number of actuators that change their mode between two combinations, shape
            (patterns + 1, patterns). Row: combination before; the last row stands for the modes in
            force at the start. Column: combination after.
        weight: Weights of energy [1/J], time [1/s] and mode switches, shape (3,).
        energy_column: Column of a step's cost with the energy that the cost includes,
            ENERGY_PAPER_COLUMN or ENERGY_SERIES_COLUMN.
        area: Weight w₄ of the manipulability loss and the reference area.
        obstacles: Obstacles as `Obstacles.path_rows`; empty if there are none.
        max_piece_stroke: Largest stroke of a cylinder within one piece [m].
    """

    machine: MachineArrays
    circuit: HydraulicCoefficients
    patterns: ModeArray
    switches: IntArray
    weight: FloatArray
    energy_column: int
    area: AreaTerm
    obstacles: FloatArray
    max_piece_stroke: float


def cost_model(
    machine: Machine,
    start_modes: ModeArray,
    weight: FloatArray,
    column: int,
    area: AreaTerm = WITHOUT_AREA,
) -> PathCostModel:
    """Build the cost model for cylinder paths that start with given modes.

    The model contains all mode combinations of the machine. A cylinder slower than MAX_HELD_SPEED
    counts as at rest: it must be boosted if the main pump's pressure cannot hold its load. If the
    manipulability loss has a weight, BOOST_RESERVE is added to the boost margin.

    Args:
        machine: The arm without a slewing joint.
        start_modes: Modes in force at the start, uint8, shape (n,).
        weight: Weights of energy [1/J], time [1/s] and mode switches, shape (3,).
        column: Price of boosted oil: ENERGY_PAPER_COLUMN as in the paper, or ENERGY_SERIES_COLUMN
            for servo pumps in series with the main pump.
        area: Weight and reference area of the manipulability loss (lost area of the velocity
            polytope). By default the loss has no weight.

    Returns:
        The cost model.
    """
    patterns, circuit = machine.patterns, _compute_held_coefficients(machine)
    if area.weight > 0.0:
        circuit = circuit._replace(boost_margin=circuit.boost_margin + BOOST_RESERVE)
    return PathCostModel(
        machine.arrays,
        circuit,
        patterns,
        _count_switches(machine, start_modes.tobytes()),
        frozen(weight),
        column,
        area,
        machine.obstacles.path_rows,
        MAX_PIECE_STROKE * machine.relative_size,
    )


@lru_cache(maxsize=CACHED_MACHINE_COUNT)
def _compute_held_coefficients(machine: Machine) -> HydraulicCoefficients:
    """Compute the hydraulic coefficients with which slow cylinders count as held.

    The result is kept for later calls with the same machine object.

    Args:
        machine: The arm without a slewing joint.

    Returns:
        Coefficients whose `rest_speed` is MAX_HELD_SPEED.
    """
    circuit = compute_hydraulic_coefficients(machine.arrays, machine.patterns)
    return circuit._replace(rest_speed=MAX_HELD_SPEED)


@lru_cache(maxsize=CACHED_MACHINE_COUNT)
def _count_switches(machine: Machine, start_modes: bytes) -> IntArray:
    """Count the actuators that change their mode from one mode combination to another.

    The result is kept for later calls with the same machine object and modes.

    Args:
        machine: The arm without a slewing joint; gives the mode combinations.
        start_modes: Codes of the modes in force at the start, one byte for each actuator.

    Returns:
        Counts, read-only, shape (patterns + 1, patterns). Row: combination before; the last row
        stands for `start_modes`. Column: combination after.
    """
    patterns = machine.patterns
    before = np.vstack([patterns, np.frombuffer(start_modes, dtype=np.uint8)])
    return frozen((before[:, None] != patterns).sum(axis=-1))


def without_leakage_cost(t: PathCostModel) -> PathCostModel:
    """Return a copy of the cost model in which leakage and the slip of servo pumps cost nothing.

    The copy suits a slew that takes longer than the path: leakage and slip then cost the same on
    each path.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
    """
    return t._replace(circuit=t.circuit._replace(leakage_flow=0.0, idle_leakage=0.0, slip=0.0))


class PathCostBuffers(NamedTuple):
    """Working memory of one thread, so that pricing allocates nothing.

    Attributes:
        scratch: Cost and status of the last priced piece in each mode combination.
        points: Three postures: rows 0 and 1 are the ends of the piece, row MIDDLE_POINT is
            half-way.
        middle: Piston forces half-way along the piece, shape (1, n) [N].
        owner: Index in `points` of an end of a piece, repeated for each mode combination, shape (2,
            patterns): all entries of row i are i.
        value: Least cost up to points 0 and 1 by mode combination of arrival, shape (2, patterns +
            1). The last column stands for the modes in force at the start.
        shortfall: Cost w₄ M of the priced piece, shape (patterns,).
        parent: Best combination before the last piece of a path, for each combination of this
            piece, shape (patterns,). The value `patterns` stands for the modes in force at the
            start of the path.
    """

    scratch: StepBuffers
    points: Postures
    middle: FloatArray
    owner: IntArray
    value: FloatArray
    shortfall: FloatArray
    parent: IntArray


def new_path_cost_buffers(t: PathCostModel) -> PathCostBuffers:
    """Allocate the working memory in which cylinder paths are priced by a cost model.

    Args:
        t: Cost model; its numbers of mode combinations and joints give the shapes.

    Returns:
        Buffers with undefined contents, except `owner` (row i holds i) and `shortfall` (all 0).
    """
    count, n = t.patterns.shape
    points = Postures(np.empty((3, n)), np.empty((3, n)), np.empty((3, n)))
    owner = np.zeros((2, count), dtype=np.int64)
    owner[1, :] = 1
    return PathCostBuffers(
        create_step_buffers(t.patterns),
        points,
        np.empty((1, n)),
        owner,
        np.empty((2, count + 1)),
        np.zeros(count),
        np.empty(count, dtype=np.int64),
    )


@kernel(borrows=True)
def place_posture(
    m: MachineArrays, points: Postures, i: int, length: FloatArray, guess: int
) -> None:
    """Write the posture that has given cylinder lengths into points[i].

    If a cylinder length is out of reach within the joint limits, the joint is placed at the nearer
    limit. Row i of `points.length` gets the given lengths even then.

    Args:
        m: Arrays of the machine.
        points: Postures, cylinder lengths and piston forces. Row i of each of these three arrays is
            written in place.
        i: Index of the posture to write.
        length: Cylinder lengths, shape (n,) [m].
        guess: Index of a posture in `points` close to the wanted one; Newton's method starts there.
    """
    for j in range(len(length)):
        points.length[i, j] = length[j]
        points.posture[i, j] = find_joint_angle(
            m.linkage[j], length[j], m.joint_min[j], m.joint_max[j], points.posture[guess, j]
        )
    piston_forces(m, points.posture[i], points.force[i])


@kernel(inline="always")
def _leaves_workspace(m: MachineArrays, points: Postures, here: int) -> bool:
    """Return whether the tip leaves the workspace between points[here] and points[1 - here].

    Both ends of the move are checked. If an end is nearer to the edge than WORKSPACE_EDGE_DISTANCE,
    the posture half-way in cylinder lengths is checked, too. An excess of WORKSPACE_TOLERANCE is
    allowed. A move that starts farther outside must not increase its excess. Last, the straight
    move in joint space is checked (`move_between_tips_stays_in_workspace`).

    Args:
        m: Arrays of the machine.
        points: Three postures: both ends in rows 0 and 1. Row 2 may be overwritten.
        here: Index of the start, 0 or 1.

    Returns:
        True if the move leaves the workspace.
    """
    start, goal = points.posture[here], points.posture[1 - here]
    tips = tip_position(m, start), tip_position(m, goal)
    begin, end = (
        compute_workspace_excess(m, tips[0][0], tips[0][1]),
        compute_workspace_excess(m, tips[1][0], tips[1][1]),
    )
    allowed = max(WORKSPACE_TOLERANCE, begin)
    if end > allowed:
        return True
    if max(begin, end) >= -WORKSPACE_EDGE_DISTANCE:
        for j in range(points.length.shape[1]):
            length = 0.5 * (points.length[0, j] + points.length[1, j])
            points.posture[MIDDLE_POINT, j] = find_joint_angle(
                m.linkage[j], length, m.joint_min[j], m.joint_max[j], start[j]
            )
        x, z = tip_position(m, points.posture[MIDDLE_POINT])
        if compute_workspace_excess(m, x, z) > allowed:
            return True
    return not move_between_tips_stays_in_workspace(m, start, goal, tips)


@kernel(borrows=True)
def price_piece(t: PathCostModel, w: PathCostBuffers, here: int) -> int:
    """Price the straight move between two postures in all mode combinations.

    The move leads from w.points[here] to w.points[1 - here]. It is inadmissible if the tip leaves
    the workspace, the arm comes too near to an obstacle, or no mode combination can do it. A
    combination may be used if it boosts exactly the joints that need boost. If no such combination
    is admissible, combinations that boost further joints may be used.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        w: Working memory of the thread. Writes w.scratch (duration, energies and status by
            combination) and w.middle (piston forces half-way) in place. Also writes w.shortfall, if
            the manipulability loss has a weight, and may write row MIDDLE_POINT of w.points.
        here: Index of the start in w.points, 0 or 1.

    Returns:
        STEP_INADMISSIBLE, or the status of the combinations that may be used: a combination p may
        be used if w.scratch.status[p] equals the result.
    """
    there = 1 - here
    m, posture = t.machine, w.points.posture
    if _leaves_workspace(m, w.points, here):
        return STEP_INADMISSIBLE
    if len(t.obstacles) > 0 and not move_is_clear(
        m, t.obstacles, posture[here], posture[there], True
    ):
        return STEP_INADMISSIBLE
    for j in range(posture.shape[1]):
        posture[MIDDLE_POINT, j] = 0.5 * (posture[here, j] + posture[there, j])
    piston_forces(m, posture[MIDDLE_POINT], w.middle[0])
    moves = NodeMoves(w.points, here, w.points, there, 1, w.owner[there], w.middle)
    status = price_steps_to_node(t.circuit, t.patterns, moves, w.scratch)
    if t.area.weight > 0.0 and status != STEP_INADMISSIBLE:
        compute_step_area_loss(
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


@kernel(borrows=True)
def piece_count(start: FloatArray, end: FloatArray, piece: float) -> int:
    """Return the number of equal pieces into which a straight move of the cylinders is cut.

    Args:
        start: Cylinder lengths at the start, shape (n,) [m].
        end: Cylinder lengths at the end, shape (n,) [m].
        piece: Largest stroke of a cylinder within one piece [m].

    Returns:
        The smallest number with which no cylinder moves by more than `piece` in a piece, at least
        1.
    """
    stroke = 0.0
    for j in range(len(start)):
        stroke = max(stroke, abs(end[j] - start[j]))
    return max(1, math.ceil(stroke / piece - 1e-9))


@kernel
def cut_into_pieces(via: FloatArray, piece: float) -> tuple[FloatArray, IntArray]:
    """Cut each segment of a cylinder path into equal pieces of limited stroke.

    Args:
        via: Waypoints, shape (points, n) [m].
        piece: Largest stroke of a cylinder within one piece [m].

    Returns:
        Cylinder lengths at the end of each piece, shape (pieces, n) [m], and the number of pieces
        of each segment, shape (points - 1,).
    """
    count = np.empty(len(via) - 1, dtype=np.int64)
    for s in range(len(count)):
        count[s] = piece_count(via[s], via[s + 1], piece)
    end, row = np.empty((count.sum(), via.shape[1])), 0
    for s in range(len(count)):
        for k in range(1, count[s] + 1):
            for j in range(via.shape[1]):
                end[row, j] = via[s, j] + (via[s + 1, j] - via[s, j]) * k / count[s]
            row += 1
    return end, count


@kernel(inline="always")
def least_move_cost(t: PathCostModel, start: FloatArray, end: FloatArray) -> float:
    """Return the lower bound on the cost of any path between two vectors of cylinder lengths."""
    return bound_cost_between(t.circuit, start, end, t.weight)


@kernel(inline="always")
def _piece_cost(t: PathCostModel, w: PathCostBuffers, p: int) -> float:
    """Return w₁ E + w₂ T + w₄ M of the piece that was priced last, in mode combination p."""
    cost = w.scratch.cost
    return (
        t.weight[0] * cost[p, t.energy_column]
        + t.weight[1] * cost[p, DURATION_COLUMN]
        + w.shortfall[p]
    )


@kernel(inline="always")
def _extend_by_piece(t: PathCostModel, w: PathCostBuffers, here: int) -> float:
    """Extend the least costs of a path by one piece, for each mode combination of arrival.

    The piece leads from w.points[here] to w.points[1 - here]. For each admissible combination p of
    the piece:

        after[p] = min over o of (value[o] + w₃ switches[o, p]) + w₁ E[p] + w₂ T[p] + w₄ M[p]

    value[o] is the least cost of a path to the piece's start that arrives in combination o.
    switches[o, p] is the number of mode switches from o to p. The weights of the cost are w₁ to w₄.
    E, T and M are the piece's energy, duration and manipulability loss. `value` is w.value[here],
    which is read. `after` is w.value[1 - here], which is written; inadmissible combinations get
    inf. w.parent gets the best o for each admissible p; its other entries stay as they are.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        w: Working memory of the thread, changed in place.
        here: Index of the piece's start in w.points, 0 or 1.

    Returns:
        Least of after[p]; inf if the piece is inadmissible, and w.value is then unchanged.
    """
    status = price_piece(t, w, here)
    if status == STEP_INADMISSIBLE:
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
                w.parent[p] = o
        after[p] = best + _piece_cost(t, w, p)
        least = min(least, after[p])
    return least


@kernel(borrows=True)
def count_switches_to_hold(m: MachineArrays, force: FloatArray, modes: ModeArray) -> int:
    """Count the actuators that must change their mode to hold the arm at rest.

    An actuator holds its load in mode N (main pump alone) if the main pump's pressure suffices.
    Otherwise it holds the load in mode DB (its own servo pump).

    Args:
        m: Arrays of the machine.
        force: Piston forces at rest, shape (n,) [N].
        modes: Modes with which the arm arrives at rest, shape (n,).

    Returns:
        Number of actuators whose mode differs from their holding mode.
    """
    count = 0
    for j in range(len(force)):
        hold = Mode.DB if needs_boost(m, j, force[j], 0.0) else Mode.N
        if modes[j] != hold:
            count += 1
    return count


@kernel(inline="always")
def _add_holding_switches(t: PathCostModel, w: PathCostBuffers, at: int) -> float:
    """Add the cost of switching to the modes that hold the arm at rest in posture w.points[at].

    An actuator holds its load in mode N, or in mode DB if the load needs boost. The costs of the
    mode combinations in w.value[at] are increased in place. The last column is not changed: it
    stands for the modes before the first piece, and no piece arrives in them.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        w: Working memory of the thread.
        at: Index of the path's last posture in w.points, 0 or 1.

    Returns:
        Least cost of the whole path.
    """
    least = math.inf
    for p in range(len(t.patterns)):
        count = count_switches_to_hold(t.machine, w.points.force[at], t.patterns[p])
        w.value[at, p] += t.weight[2] * count
        least = min(least, w.value[at, p])
    return least


@kernel(inline="always")
def begin_path(
    t: PathCostModel, w: PathCostBuffers, length: FloatArray, posture: FloatArray
) -> None:
    """Set the working memory to the start of a cylinder path.

    Writes posture, cylinder lengths and piston forces at the start to row 0 of w.points. Writes the
    costs to w.value[0]. The cost is 0 in the last column, which stands for the modes in force at
    the start. It is inf in the columns of the mode combinations.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        w: Working memory of the thread, changed in place.
        length: Cylinder lengths at the start, shape (n,) [m].
        posture: Joint positions at the start, shape (n,) [rad or m].
    """
    copy_row(w.points.posture[0], posture)
    copy_row(w.points.length[0], length)
    piston_forces(t.machine, posture, w.points.force[0])
    w.value[0, :] = math.inf
    w.value[0, -1] = 0.0


@kernel
def continue_path(
    t: PathCostModel,
    w: PathCostBuffers,
    via: FloatArray,
    limit: float,
    rests_at_end: bool,
) -> float:
    """Add the cost of further waypoints to a cylinder path that ends at w.points[0].

    Each segment is cut into pieces, and dynamic programming picks a mode combination for each
    piece. Afterwards w.points[0] and w.value[0] describe the last waypoint. If the result is inf,
    their content is undefined.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        w: Working memory of the thread, as `begin_path` or an earlier call left it; changed in
            place.
        via: Waypoints, shape (points, n) [m]; the first is w.points[0].
        limit: Cost at which the path is given up. The cost so far, plus a lower bound on the rest
            of `via`, is compared with it.
        rests_at_end: True if the arm rests at the last waypoint. Switches to the modes that hold
            the arm at this waypoint then count.

    Returns:
        Least cost from the start of the whole path to the last waypoint. Inf if a piece is
        inadmissible or the limit is reached. 0 if `via` has one waypoint only and the arm does not
        rest there.
    """
    rest = 0.0
    for s in range(len(via) - 1):
        rest += least_move_cost(t, via[s], via[s + 1])
    end, count = cut_into_pieces(via, t.max_piece_stroke)
    here, row, least = 0, 0, 0.0
    for s in range(len(count)):
        piece = least_move_cost(t, via[s], via[s + 1]) / count[s]
        for _ in range(count[s]):
            place_posture(t.machine, w.points, 1 - here, end[row], here)
            least = _extend_by_piece(t, w, here)
            rest -= piece
            if least + rest >= limit:
                return math.inf
            here, row = 1 - here, row + 1
    if rests_at_end:
        least = _add_holding_switches(t, w, here)
        if least >= limit:
            return math.inf
    if here == 1:
        copy_row(w.points.posture[0], w.points.posture[1])
        copy_row(w.points.length[0], w.points.length[1])
        copy_row(w.points.force[0], w.points.force[1])
        copy_row(w.value[0], w.value[1])
    return least


@kernel
def price_path(
    t: PathCostModel, w: PathCostBuffers, via: FloatArray, start: FloatArray, limit: float
) -> float:
    """Compute the least cost of a whole cylinder path over all sequences of mode combinations.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        w: Working memory of the thread, overwritten.
        via: Waypoints, shape (points, n) [m].
        start: Joint positions at via[0], shape (n,) [rad or m].
        limit: Cost at which the path is given up; a lower bound on the path's cost is compared with
            it.

    Returns:
        The cost; inf if the path is inadmissible or its cost reaches the limit.
    """
    begin_path(t, w, via[0], start)
    return continue_path(t, w, via, limit, True)


@kernel
def compute_costs_to_go(
    t: PathCostModel, w: PathCostBuffers, via: FloatArray, start: FloatArray
) -> FloatArray:
    """Compute the least remaining cost from each waypoint of a cylinder path to rest at its end.

    The cost includes mode switches between pieces, and at the end to the modes that hold the arm.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        w: Working memory of the thread, overwritten.
        via: Waypoints, shape (points, n) [m].
        start: Joint positions at via[0], shape (n,) [rad or m].

    Returns:
        Cost by waypoint and by the mode combination in which the waypoint is reached, shape
        (points, patterns). Inf means that no admissible sequence of modes continues from the
        waypoint. The first row is all inf, since it is not computed.
    """
    end, count = cut_into_pieces(via, t.max_piece_stroke)
    patterns, here = len(t.patterns), 0
    cost = np.full((len(end), patterns), np.inf)
    begin_path(t, w, via[0], start)
    for row in range(len(end)):
        place_posture(t.machine, w.points, 1 - here, end[row], here)
        status = price_piece(t, w, here)
        for p in range(patterns):
            if status != STEP_INADMISSIBLE and w.scratch.status[p] == status:
                cost[row, p] = _piece_cost(t, w, p)
        here = 1 - here
    ahead = np.full((len(via), patterns), np.inf)
    for p in range(patterns):
        switches = count_switches_to_hold(t.machine, w.points.force[here], t.patterns[p])
        ahead[-1, p] = t.weight[2] * switches
    after, before, row = ahead[-1].copy(), np.empty(patterns), len(end)
    for s in range(len(via) - 2, 0, -1):
        for _ in range(count[s]):
            row -= 1
            before[:] = np.inf
            for p in range(patterns):
                there = cost[row, p] + after[p]
                if there < np.inf:
                    for o in range(patterns):
                        before[o] = min(before[o], there + t.weight[2] * t.switches[o, p])
            copy_row(after, before)
        copy_row(ahead[s], after)
    return ahead


class PathPieces(NamedTuple):
    """Pieces of an admissible cylinder path, in the cheapest sequence of mode combinations.

    Attributes:
        cost: Cost of the path [-].
        tip: Tip positions at the ends of the pieces, shape (pieces + 1, 2) [m].
        posture: Joint positions at the ends of the pieces, shape (pieces + 1, n) [rad or m].
        pattern: Index of the mode combination of each piece, shape (pieces,).
        price: Cost of each piece, shape (pieces, 3): duration [s], energy in the reading `paper`
            [J], energy in the reading `series` [J].
        holding_switches: Number of switches after the last piece, to the modes that hold the arm.
    """

    cost: float
    tip: FloatArray
    posture: FloatArray
    pattern: IntArray
    price: FloatArray
    holding_switches: int


@kernel
def compute_pieces(
    t: PathCostModel, w: PathCostBuffers, via: FloatArray, start: FloatArray
) -> tuple[float, FloatArray, FloatArray, IntArray, FloatArray, int]:
    """Cut a cylinder path into pieces, and choose the cheapest sequence of mode combinations.

    The cost equals the result of `price_path` to the last bit.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        w: Working memory of the thread, overwritten.
        via: Waypoints, shape (points, n) [m]. Segments are cut into pieces of t.max_piece_stroke.
        start: Joint positions at via[0], shape (n,) [rad or m].

    Returns:
        Fields of `PathPieces` in their order. If the path is inadmissible, the cost is inf and the
        arrays are undefined.
    """
    end, _ = cut_into_pieces(via, t.max_piece_stroke)
    pieces, patterns, here = len(end), len(t.patterns), 0
    parent = np.empty((pieces, patterns), dtype=np.int64)
    every, posture = np.empty((pieces, patterns, 3)), np.empty((pieces + 1, via.shape[1]))
    pattern, price = np.empty(pieces, dtype=np.int64), np.empty((pieces, 3))
    tip = np.empty((pieces + 1, 2))
    begin_path(t, w, via[0], start)
    copy_row(posture[0], start)
    tip[0, 0], tip[0, 1] = tip_position(t.machine, start)
    for row in range(pieces):
        place_posture(t.machine, w.points, 1 - here, end[row], here)
        if _extend_by_piece(t, w, here) == math.inf:
            return math.inf, tip, posture, pattern, price, 0
        copy_row(parent[row], w.parent)
        for p in range(patterns):
            copy_row(every[row, p], w.scratch.cost[p])
        here = 1 - here
        copy_row(posture[row + 1], w.points.posture[here])
        tip[row + 1, 0], tip[row + 1, 1] = tip_position(t.machine, posture[row + 1])
    cost = _add_holding_switches(t, w, here)
    last = np.argmin(w.value[here, :-1])
    pattern[-1] = last
    for k in range(pieces - 1, -1, -1):
        copy_row(price[k], every[k, pattern[k]])
        if k > 0:
            pattern[k - 1] = parent[k, pattern[k]]
    holding = count_switches_to_hold(t.machine, w.points.force[here], t.patterns[last])
    return cost, tip, posture, pattern, price, holding


def to_discrete_path(
    t: PathCostModel,
    pieces: PathPieces,
    cost: float,
    start_modes: ModeArray,
    statistics: SearchStatistics,
) -> DiscretePath:
    """Convert a cylinder path to a discrete path, one step for each piece.

    The path also counts the switches to the modes that hold the arm at its end.

    The arrays `pieces.tip` and `pieces.posture` become read-only, because the result shares them.

    Args:
        t: Cost model by which the pieces were computed; gives the mode combinations.
        pieces: Pieces of the path.
        cost: Cost of the path, stored as it is.
        start_modes: Modes in force at the start, shape (n,).
        statistics: Statistics of the search, stored as they are.

    Returns:
        The discrete path.
    """
    price, modes = frozen(pieces.price.T), frozen(t.patterns[pieces.pattern])
    for own in (pieces.tip, pieces.posture):
        own.setflags(write=False)  # the path then needs no copies
    return DiscretePath(
        tip=pieces.tip,
        posture=pieces.posture,
        modes=modes,
        duration=price[DURATION_COLUMN],
        energy=price[ENERGY_PAPER_COLUMN],
        energy_series=price[ENERGY_SERIES_COLUMN],
        cost=cost,
        start_modes=start_modes,
        statistics=statistics,
        holding_switches=pieces.holding_switches,
    )
