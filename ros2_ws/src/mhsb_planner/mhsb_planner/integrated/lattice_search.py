"""A* over lattice points in the space of cylinder lengths and mode combinations.

A state is a lattice point and the mode combination in which it was reached. The heuristic is the
least of the lower bounds `least_move_cost` to the goal postures. It is consistent. A goal posture
is reached from the lattice points around it. Steps are priced only when no path that seems cheaper
is left (`deferred_steps`).

A lattice point is reached when the search first looks at a step to it, even if the step is
discarded. Only reached points have a place in the search's memory (`lattice_points`). A large
lattice therefore takes little time to create.

The loop differs from that of `search.s2_astar` in two points: it takes deferred steps and states in
turn, by their estimates, and paths that reach a cost limit are discarded.
"""

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.copying import copy_row
from mhsb_model.kernels.kernel import kernel
from mhsb_model.statics import piston_forces
from mhsb_model.types import FloatArray
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.integrated.cylinder_path import (
    PathCostBuffers,
    PathCostModel,
    count_switches_to_hold,
    least_move_cost,
    price_piece,
)
from mhsb_planner.integrated.deferred_steps import (
    NO_STEP,
    STEP_COUNT,
    DeferredSteps,
    create_deferred_steps,
    defer_step,
    take_due_step,
)
from mhsb_planner.integrated.lattice import NO_POINT, Lattice, find_neighbour, is_around
from mhsb_planner.integrated.lattice_points import (
    ROW_COUNT,
    STATE_COUNT,
    LatticePoints,
    create_lattice_points,
    find_slot,
    find_state,
    with_more_room,
    with_more_rows,
)
from mhsb_planner.search.lower_bound import bound_cost_to_nearest
from mhsb_planner.search.open_list import (
    ARRAYS_FULL,
    EXPANDED_COUNT,
    GENERATED_COUNT,
    GOAL_FOUND,
    NO_STATE,
    SEARCH_EXHAUSTED,
    SEARCH_PAUSED,
    WAITING_COUNT,
    ExpandedState,
    OpenList,
    create_open_list,
    enlarge_open_list,
    pop_first_state,
    record_path_to,
    trace_path_to_goal,
)
from mhsb_planner.search.s2_step import DURATION_COLUMN, STEP_INADMISSIBLE, Postures

FIRST_EXPANSION_BATCH, MAX_EXPANSION_BATCH = 20, 400
"""Number of steps and states to take before the first look at the clock, and largest number between
two looks.
"""

GOAL_ROW = -1
"""Row that stands for the goal postures, all of which are one state."""

DEFERRED_STEPS_PER_ROW = 8
"""Number of deferred steps for which there is room at first, per row for a lattice point [-]."""

FIRST_ROWS = 1000
"""Number of rows for lattice points, and of states, at first. Each doubles when the search needs
more.
"""


class LatticeProblem(NamedTuple):
    """Problem of a lattice search: the cheapest path over a lattice to one of several goals.

    Attributes:
        cost_model: Cost model of the cylinder path.
        lattice: The lattice, which contains the start.
        goals: Goal postures in which the path may end.
    """

    cost_model: PathCostModel
    lattice: Lattice
    goals: Postures


class SearchRule(NamedTuple):
    """Which paths an A* search keeps, and in which order it expands their ends.

    Attributes:
        cost_limit: Paths of this cost or more are discarded.
        heuristic_weight: Heuristic weight w ≥ 1. The path costs at most w times as much as the
            cheapest one; a larger w finds it earlier.
        reachability_only: If true, steps to lattice points that have a state already are skipped.
            This finds some path fastest, but not a cheap one.
    """

    cost_limit: float
    heuristic_weight: float
    reachability_only: bool


class StepTarget(NamedTuple):
    """Lattice point or goal posture to which a step leads.

    Attributes:
        row: Row of the lattice point; GOAL_ROW for a goal posture.
        lower_bound: Lower bound on the cost from the target to the goal.
    """

    row: int
    lower_bound: float


@kernel(borrows=True, forceinline=True)
def _load_point(
    t: PathCostModel, known: LatticePoints, lattice: Lattice, row: int, points: Postures, i: int
) -> None:
    """Write a reached lattice point to points[i]: lengths, joint positions and piston forces.

    The forces are computed at the first call for the point and stored in known.force.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        known: Data of the lattice points that the search has reached, one row for each point. Its
            forces are written in place.
        lattice: The lattice.
        row: Row of the point in `known`.
        points: Postures with cylinder lengths and forces, changed in place.
        i: Index of the posture to write: 0 for the origin of a step, 1 for its target.
    """
    for j in range(len(lattice.shape)):
        points.length[i, j] = lattice.length[j, known.indices[row, j]]
        points.posture[i, j] = lattice.angle[j, known.indices[row, j]]
    if math.isnan(known.force[row, 0]):
        piston_forces(t.machine, points.posture[i], known.force[row])
    copy_row(points.force[i], known.force[row])


@kernel(borrows=True)
def _add_row(problem: LatticeProblem, known: LatticePoints, number: int, slot: int) -> int:
    """Assign the next free row to a lattice point that has none.

    Args:
        problem: Cost model, lattice and goals.
        known: Data of the lattice points that the search has reached, changed in place. A row must
            be free.
        number: Number of the lattice point.
        slot: Slot of the point in the hash table.

    Returns:
        The row.
    """
    t, lattice, goals = problem
    row: int = known.counts[ROW_COUNT]
    known.counts[ROW_COUNT] += 1
    known.table[slot] = row + 1
    rest, length = number, known.force[row]
    for j in range(len(lattice.shape)):
        index = rest // lattice.stride[j]
        rest -= index * lattice.stride[j]
        known.indices[row, j] = index
        length[j] = lattice.length[j, index]
    point = known.records[row]
    point.number = number
    point.remaining = bound_cost_to_nearest(t.circuit, length, goals.length, t.weight)
    point.cost = math.inf
    point.pattern = 0
    point.newest = NO_STATE
    length[0] = math.nan  # the forces are not computed yet
    return row


@kernel(borrows=True)
def _relax_step(
    t: PathCostModel,
    f: OpenList,
    known: LatticePoints,
    origin: ExpandedState,
    target: StepTarget,
    pattern: int,
    cost: float,
    weight: float,
) -> bool:
    """Record a step to one state if it makes this state cheaper.

    A state is a lattice point and the mode combination of arrival. The target can also be reached
    from the cheapest state of the same lattice point, by mode switches alone. The step is discarded
    if these mode switches, or the path known to the target, cost no more. Otherwise the target gets
    the cost, and `origin` as its parent. It enters the open list, or its place in the list is
    updated.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        f: Open list and state records, changed in place.
        known: Data of the lattice points that the search has reached. The cheapest state of the
            target's point is updated in place, and a missing state is created.
        origin: State from which the step leads.
        target: Lattice point or goal to which the step leads.
        pattern: Index of the mode combination of the step.
        cost: Cost of the path from the start to the target.
        weight: Heuristic weight.

    Returns:
        True if the step was recorded.
    """
    row: int = target.row
    state: int = len(f.states) - 1
    if row != GOAL_ROW:
        point = known.records[row]
        if cost >= point.cost + t.weight[2] * t.switches[point.pattern, pattern]:
            return False
        state = find_state(known, row, pattern)
        if cost < point.cost:
            point.cost = cost
            point.pattern = pattern
    if cost >= f.states[state].cost:
        return False
    record_path_to(f, state, origin.state, origin.next_depth, cost, weight * target.lower_bound)
    return True


@kernel(borrows=True)
def _price_step_to(
    t: PathCostModel,
    w: PathCostBuffers,
    f: OpenList,
    known: LatticePoints,
    origin: ExpandedState,
    target: StepTarget,
    rule: SearchRule,
) -> bool:
    """Price a step, and record it in each mode combination in which it makes a state cheaper.

    The step leads from w.points[0] to w.points[1]. The cost of a step to a goal posture includes
    the switches to the modes that hold the arm there. In each combination the step is discarded if
    the cost up to the target plus the target's lower bound reaches the cost limit.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        w: Working memory with both postures; all else in it is overwritten.
        f: Open list and state records, changed in place.
        known: Data of the lattice points that the search has reached, changed in place.
        origin: State from which the step leads.
        target: Lattice point or goal posture to which the step leads.
        rule: Cost limit and heuristic weight.

    Returns:
        True if the step was recorded in any combination.
    """
    admitted = price_piece(t, w, 0)
    if admitted == STEP_INADMISSIBLE:
        return False
    cost, least, gained = w.scratch.cost, target.lower_bound, False
    for p in range(len(t.patterns)):
        if w.scratch.status[p] == admitted:
            there = (
                origin.cost
                + t.weight[0] * cost[p, t.energy_column]
                + t.weight[1] * cost[p, DURATION_COLUMN]
            )
            switches = t.switches[origin.pattern, p]
            if target.row == GOAL_ROW:
                switches += count_switches_to_hold(t.machine, w.points.force[1], t.patterns[p])
            there += t.weight[2] * switches + w.shortfall[p]
            if there + least < rule.cost_limit:
                weight = rule.heuristic_weight
                gained = _relax_step(t, f, known, origin, target, p, there, weight) or gained
    return gained


@kernel(inline="always")
def _step_to_goal(
    problem: LatticeProblem,
    w: PathCostBuffers,
    f: OpenList,
    known: LatticePoints,
    origin: ExpandedState,
    k: int,
    rule: SearchRule,
) -> None:
    """Price the step from a lattice point to a goal posture; record the cheapest path to the goal.

    A lower bound on the cost of the path over this step is computed first. The step is skipped if
    the bound reaches the cost limit or the cost of the cheapest known path.

    Args:
        problem: Cost model, lattice and goals.
        w: Working memory with the point in w.points[0]; all else in it is overwritten.
        f: Open list and state records, changed in place.
        known: Data of the lattice points that the search has reached. If the step is recorded,
            known.reached[0] becomes k.
        origin: State of the lattice point from which the step leads.
        k: Index of the goal posture, which must be within one lattice step of the point.
        rule: Cost limit; paths of this cost or more are discarded.
    """
    goals = problem.goals
    cost = origin.cost + least_move_cost(problem.cost_model, w.points.length[0], goals.length[k])
    if cost >= min(rule.cost_limit, f.states[len(f.states) - 1].cost):
        return
    for j in range(goals.length.shape[1]):
        w.points.posture[1, j] = goals.posture[k, j]
        w.points.length[1, j] = goals.length[k, j]
        w.points.force[1, j] = goals.force[k, j]
    target = StepTarget(GOAL_ROW, 0.0)
    if _price_step_to(problem.cost_model, w, f, known, origin, target, rule):
        known.reached[0] = k


@kernel(borrows=True, forceinline=True)
def _is_useless(
    t: PathCostModel,
    f: OpenList,
    known: LatticePoints,
    pattern: int,
    row: int,
    cost: float,
    rule: SearchRule,
) -> bool:
    """Return whether a step to a lattice point is of no use, by a lower bound on its cost.

    It is of no use in three cases:

    - It leads to no path below the cost limit, or to none cheaper than the known path to the goal.
    - It costs no less than the cheapest state of the point, plus the mode switches from there to
      the modes of the expanded state. The step then makes no state of the point cheaper.
    - The point has a state already, with `reachability_only`.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        f: Open list and state records.
        known: Data of the lattice points that the search has reached.
        pattern: Mode combination of the state from which the step leads.
        row: Row of the point to which it leads.
        cost: Lower bound on the cost of the path from the start over this step.
        rule: Cost limit, and `reachability_only`.

    Returns:
        True if the step need not be priced.
    """
    point = known.records[row]
    if rule.reachability_only and point.cost < math.inf:
        return True
    if cost >= point.cost + t.weight[2] * t.switches[pattern, point.pattern]:
        return True
    goal_cost = f.states[len(f.states) - 1].cost
    return cost + point.remaining >= min(rule.cost_limit, goal_cost)


@kernel(inline="always")
def _defer_step(
    problem: LatticeProblem,
    w: PathCostBuffers,
    f: OpenList,
    known: LatticePoints,
    deferred: DeferredSteps,
    origin: ExpandedState,
    number: int,
    rule: SearchRule,
) -> None:
    """Put the step from an expanded state to a neighbouring lattice point among the deferred steps.

    A step is dropped instead if a lower bound on its cost shows that it is useless (`_is_useless`).
    A point that the search reaches for the first time gets a row in `known` in either case.

    Args:
        problem: Cost model, lattice and goals.
        w: Working memory of the thread. Row 0 of its points must hold the expanded point.
        f: Open list and state records.
        known: Data of the lattice points that the search has reached, changed in place.
        deferred: Steps that wait to be priced, changed in place.
        origin: The expanded state.
        number: Number of the neighbouring point.
        rule: Cost limit, heuristic weight, and `reachability_only`.
    """
    t, lattice, _ = problem
    slot = find_slot(known.table, known.records, number)
    row: int = known.table[slot] - 1
    if row < 0:
        row = _add_row(problem, known, number, slot)
    for j in range(len(lattice.shape)):
        w.points.length[1, j] = lattice.length[j, known.indices[row, j]]
    cost = origin.cost + least_move_cost(t, w.points.length[0], w.points.length[1])
    if _is_useless(t, f, known, origin.pattern, row, cost, rule):
        return
    least = rule.heuristic_weight * known.records[row].remaining
    defer_step(deferred, origin.state, row, cost, least)


@kernel(inline="always")
def _price_deferred_step(
    problem: LatticeProblem,
    w: PathCostBuffers,
    f: OpenList,
    known: LatticePoints,
    deferred: DeferredSteps,
    number: int,
    rule: SearchRule,
) -> None:
    """Price a step that was deferred, if it may still be of use.

    The step may reach several states of the point, one in each mode combination. Those that become
    cheaper enter the open list.

    Args:
        problem: Cost model, lattice and goals.
        w: Working memory of the thread, overwritten.
        f: Open list and state records, changed in place.
        known: Data of the lattice points that the search has reached, changed in place.
        deferred: Steps that wait to be priced.
        number: Number of the step in `deferred.records`.
        rule: Cost limit, heuristic weight, and `reachability_only`.
    """
    t, lattice, _ = problem
    step = deferred.records[number]
    row: int = step.row
    origin: ExpandedState = _get_origin(t, f, known, step.origin)
    if _is_useless(t, f, known, origin.pattern, row, step.cost, rule):
        return
    start: int = 0
    if origin.state != NO_STATE:
        start = known.states[origin.state].row
    _load_point(t, known, lattice, start, w.points, 0)
    _load_point(t, known, lattice, row, w.points, 1)
    f.counts[GENERATED_COUNT] += 1
    _price_step_to(t, w, f, known, origin, StepTarget(row, known.records[row].remaining), rule)


@kernel(inline="always")
def _get_origin(t: PathCostModel, f: OpenList, known: LatticePoints, state: int) -> ExpandedState:
    """Describe the state in which a step starts.

    It is the state that the search expands, or the origin of a deferred step. A deferred step has
    been found earlier and is priced now.

    Args:
        t: Cost model: machine, hydraulics, cost weights, mode combinations and obstacles.
        f: Open list and state records.
        known: Data of the lattice points that the search has reached.
        state: Number of the state; NO_STATE stands for the start.

    Returns:
        Number of the state, mode combination of arrival, and cost from the start. `next_depth` is
        the depth of the states that it leads to: its own depth (steps from the start) + 1. For the
        start, the mode combination is len(t.patterns), the cost 0, and `next_depth` 1.
    """
    pattern, cost, depth = len(t.patterns), 0.0, 0
    if state != NO_STATE:
        pattern, cost = known.states[state].pattern, f.states[state].cost
        depth = f.states[state].depth
    return ExpandedState(state, pattern, cost, depth + 1)


@kernel(borrows=True, forceinline=True)
def _has_room(problem: LatticeProblem, known: LatticePoints, deferred: DeferredSteps) -> bool:
    """Return whether there is room for all neighbours of one more state.

    Args:
        problem: Cost model, lattice and goals.
        known: Data of the lattice points that the search has reached.
        deferred: Steps that wait to be priced.

    Returns:
        True if the rows for lattice points, the states and the deferred steps have enough room.
    """
    moves = len(problem.lattice.moves)
    return (
        known.counts[ROW_COUNT] + moves + 1 <= len(known.records)
        and known.counts[STATE_COUNT] + len(problem.cost_model.patterns) <= len(known.states)
        and deferred.counts[STEP_COUNT] + moves <= len(deferred.records)
    )


@kernel(borrows=True)
def expand(
    problem: LatticeProblem,
    w: PathCostBuffers,
    f: OpenList,
    known: LatticePoints,
    deferred: DeferredSteps,
    rule: SearchRule,
    limit: int,
) -> int:
    """Take up to `limit` steps and states of an A* search over a lattice; call again to continue.

    A state is a lattice point and the mode combination of arrival. The first call expands the
    start. To expand a state means to find the steps to all neighbours of its point. Each of these
    steps is priced later, when no state or other step has a lower estimate of the whole path's
    cost. Steps to the goal postures around the point are priced at once. Their costs include the
    switches to the modes that hold the arm there.

    The unit tests compare the result with scipy.sparse.csgraph.dijkstra on the same points and
    steps.

    Args:
        problem: Cost model, lattice and goal postures.
        w: Working memory of the thread, overwritten.
        f: Open list and state records, changed in place; the last state is the goal.
        known: Data of the lattice points that the search has reached, changed in place.
        deferred: Steps that wait to be priced, changed in place.
        rule: Cost limit, heuristic weight, and `reachability_only`.
        limit: Largest number of deferred steps and states together to take in this call. A state is
            taken but not expanded if another state of the same point and a mode switch cost less.

    Returns:
        SEARCH_PAUSED after `limit` steps and states, GOAL_FOUND, or SEARCH_EXHAUSTED if there is no
        path below the cost limit. ARRAYS_FULL means that `known` or `deferred` have too little room
        for the neighbours of the next state. The caller must then add room and call again.
    """
    t, lattice, goals = problem
    state: int
    row: int
    for _ in range(limit):
        if not _has_room(problem, known, deferred):
            return ARRAYS_FULL
        state = NO_STATE
        if f.counts[EXPANDED_COUNT] == 0:
            slot = find_slot(known.table, known.records, lattice.start)
            row = _add_row(problem, known, lattice.start, slot)
            deferred.start_bound[0] = known.records[row].remaining
        else:
            estimate = math.inf
            if f.counts[WAITING_COUNT] > 0:
                state = f.heap[0]
                estimate = f.states[state].estimate
            due = take_due_step(deferred, estimate)
            if due != NO_STEP:
                _price_deferred_step(problem, w, f, known, deferred, due, rule)
                continue
            state = pop_first_state(f)
            if state == NO_STATE:
                return SEARCH_EXHAUSTED
            if state == len(f.states) - 1:
                return GOAL_FOUND
            row = known.states[state].row
            point = known.records[row]
            switches = t.switches[point.pattern, known.states[state].pattern]
            if f.states[state].cost > point.cost + t.weight[2] * switches:
                continue
        origin = _get_origin(t, f, known, state)
        f.counts[EXPANDED_COUNT] += 1
        _load_point(t, known, lattice, row, w.points, 0)
        at = known.indices[row]
        for move in lattice.moves:
            number = find_neighbour(lattice, at, move)
            if number != NO_POINT:
                _defer_step(problem, w, f, known, deferred, origin, number, rule)
        for k in range(len(goals.length)):
            if is_around(lattice, at, goals.length[k]):
                _step_to_goal(problem, w, f, known, origin, k, rule)
    return SEARCH_PAUSED


class LatticeSearch:
    """Resumable A* search over a lattice from its start to goal postures.

    Attributes:
        exhausted: True if the last call of `search` ended because no path costs less than its
            limit.
    """

    exhausted = False

    def __init__(
        self,
        t: PathCostModel,
        memory: PathCostBuffers,
        lattice: Lattice,
        goals: Postures,
    ) -> None:
        """Prepare the search without expanding anything.

        Args:
            t: Cost model by which steps are priced.
            memory: Working memory of the thread.
            lattice: The lattice, which contains the start.
            goals: Goal postures in which the path may end.
        """
        self._problem, self._memory = LatticeProblem(t, lattice, goals), memory
        moves, patterns = len(lattice.moves), len(t.patterns)
        rows, states = max(FIRST_ROWS, moves + 1), max(FIRST_ROWS, patterns)
        self._open_list = create_open_list(states)
        self._known = create_lattice_points(len(lattice.shape), rows, states)
        self._deferred = create_deferred_steps(DEFERRED_STEPS_PER_ROW * rows)

    @property
    def expanded_count(self) -> int:
        """Number of states expanded so far."""
        return int(self._open_list.counts[EXPANDED_COUNT])

    @property
    def reached_count(self) -> int:
        """Number of lattice points that the search has looked at, discarded steps included."""
        return int(self._known.counts[ROW_COUNT])

    @property
    def priced_count(self) -> int:
        """Number of lattice steps priced so far."""
        return int(self._open_list.counts[GENERATED_COUNT])

    @property
    def cost(self) -> float:
        """Cost of the cheapest path to a goal so far, by `t` of the constructor; inf before."""
        return self._open_list.goal_cost

    def search(
        self,
        cost_limit: float,
        max_expansions: int,
        deadline: Deadline = NO_DEADLINE,
        heuristic_weight: float = 1.0,
        reachability_only: bool = False,
    ) -> tuple[FloatArray, int] | None:
        """Search for a path below a cost limit; a further call continues the search.

        The attribute `exhausted` becomes True if no path costs less than the limit, otherwise
        False. The search's memory is enlarged as needed.

        Args:
            cost_limit: Paths of this cost or more are discarded.
            max_expansions: Largest number of states to expand in all calls together.
            deadline: Instant after which the search pauses; it may be continued.
            heuristic_weight: Heuristic weight w ≥ 1. The path costs at most w times as much as the
                cheapest one, unless `reachability_only` is set.
            reachability_only: If true, steps to lattice points that have a state already are
                skipped. The search then finds some path fastest, but not a cheap one.

        Returns:
            Waypoints of the path from the start to the goal posture, shape (points, n) [m], and the
            index of that goal posture. None if there is no path below `cost_limit`, or none was
            found before `max_expansions` or the deadline.
        """
        status, rule = SEARCH_PAUSED, SearchRule(cost_limit, heuristic_weight, reachability_only)
        for portion in deadline.portions(FIRST_EXPANSION_BATCH, MAX_EXPANSION_BATCH):
            status = expand(
                self._problem,
                self._memory,
                self._open_list,
                self._known,
                self._deferred,
                rule,
                min(portion, max_expansions - self.expanded_count),
            )
            if status == ARRAYS_FULL:
                self._add_room()
            elif status != SEARCH_PAUSED or self.expanded_count >= max_expansions:
                break
        self.exhausted = status == SEARCH_EXHAUSTED
        return self._read_path() if status == GOAL_FOUND else None

    def _add_room(self) -> None:
        """Double the memory for rows, states and deferred steps.

        Each of the three is doubled only if it would be more than half full after the next state.
        """
        known, deferred, t = self._known, self._deferred, self._problem.cost_model
        moves = len(self._problem.lattice.moves)
        rows, states = known.counts.tolist()
        if 2 * (rows + moves + 1) > len(known.records):
            self._known = with_more_rows(self._known)
        if 2 * (states + len(t.patterns)) > len(known.states):
            self._known = self._known._replace(states=with_more_room(known.states))
            self._open_list = enlarge_open_list(self._open_list)
        if 2 * (deferred.counts[STEP_COUNT] + moves) > len(deferred.records):
            self._deferred = deferred._replace(records=with_more_room(deferred.records))

    def _read_path(self) -> tuple[FloatArray, int]:
        """Read the path that has been found from the state records.

        Returns:
            Waypoints, shape (points, n) [m], the start first and the goal posture last; and the
            index of the goal posture.
        """
        lattice, way = self._problem.lattice, trace_path_to_goal(self._open_list)
        rows = self._known.states["row"][way[:-1]]
        index = self._known.indices[np.append(0, rows)]
        corners = lattice.length[np.arange(len(lattice.shape)), index]
        goal = int(self._known.reached[0])
        return np.vstack([corners, self._problem.goals.length[goal]]), goal
