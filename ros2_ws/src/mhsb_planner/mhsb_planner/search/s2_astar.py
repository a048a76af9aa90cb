"""The exact search: A* over nodes and mode combinations, which can be paused and continued.

A state is a node and the mode combination of arrival. The cost of a step therefore depends only on
the states that it leaves and reaches. The heuristic of `lower_bound` is consistent, so that an
expanded state is final. If rounding makes a later path cheaper, the state is expanded again.

All states of one posture have the same steps to other states. A state is skipped if it is cheaper
to reach another state of its posture and to switch modes there. Numbers of mode switches obey the
triangle inequality, so the other state leads to all successors at no greater cost.

The loop differs from that of `integrated.lattice_search` in two points: all steps of a posture are
priced when one of its states is first expanded, and of paths at equal cost the one with fewer steps
is kept.
"""

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.records import Records
from mhsb_model.types import FloatArray, IntArray
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
    SearchState,
    create_open_list,
    pop_first_state,
    record_path_to,
    trace_path_to_goal,
)
from mhsb_planner.search.s2_edge_costs import (
    NOT_PRICED,
    Edges,
    StepCostModel,
    compute_max_step_count,
    price_steps,
)
from mhsb_planner.search.s2_query import Query
from mhsb_planner.search.s2_start_goal_edges import JoiningSteps
from mhsb_planner.search.s2_step import (
    DURATION_COLUMN,
    HydraulicCoefficients,
    StepBuffers,
    create_step_buffers,
)


class PostureLabels(NamedTuple):
    """Lower bound and cheapest state so far of each posture, in one exact search.

    Attributes:
        remaining: Lower bound on the cost to the goal, shape (postures,). NaN means that it is not
            computed yet.
        cheapest: Mode combination of the posture's cheapest state so far, shape (postures,).
            NO_STATE if no state of the posture has been reached.
    """

    remaining: FloatArray
    cheapest: IntArray


class ExactSearchInput(NamedTuple):
    """Problem of one search, as arrays for the kernel `expand`.

    Attributes:
        from_start: Steps that leave the start. NO_STATE as the reached state means the goal.
        to_goal: Steps to the goal, sorted by the posture that they leave.
        goal_first: Steps of posture i to the goal are goal_first[i] to goal_first[i + 1] - 1, shape
            (postures + 1,).
        circuit: Hydraulic coefficients of the machine, for lower bounds.
        length: Cylinder lengths of the graph's postures, shape (postures, n) [m].
        goal_length: Cylinder lengths of the goal postures that steps lead to, shape (goals, n) [m].
        posture_of_state: Posture of each state of the graph, shape (states,).
        switches: Number of actuators that change their mode from one combination (row) to another
            (column), shape (patterns + 1, patterns). The last row stands for the modes in force at
            the start.
        weight: Weights of energy [1/J], time [1/s] and switches [-], shape (3,).
        column: Column of the energy in step costs, ENERGY_PAPER_COLUMN or ENERGY_SERIES_COLUMN.
    """

    from_start: JoiningSteps
    to_goal: JoiningSteps
    goal_first: IntArray
    circuit: HydraulicCoefficients
    length: FloatArray
    goal_length: FloatArray
    posture_of_state: IntArray
    switches: IntArray
    weight: FloatArray
    column: int


class LeavingSteps(NamedTuple):
    """Steps that leave the state being expanded: rows `first` to `last` - 1 of a list.

    Attributes:
        state: State that each step of the list reaches; NO_STATE is the goal.
        pattern: Index of the mode combination of each step.
        cost: Cost of each step, shape (steps, 3): duration [s], energy by the published model
            (`paper`) [J], energy with the pumps in series (`series`) [J].
        first: First row.
        last: Last row plus 1.
    """

    state: IntArray
    pattern: IntArray
    cost: FloatArray
    first: int
    last: int


@kernel(borrows=True, forceinline=True)
def _is_dominated(
    cost: float, depth: int, states: Records[SearchState], other: int, switching: float
) -> bool:
    """Return whether another state of the same posture makes it needless to expand a state.

    Let c be the cost of the path to the state, and o the cost of the path to the other state. The
    state is useless if o < c and o + switching < c. If o + switching equals c, it is useless if the
    other path has no more steps.

    Args:
        cost: Cost c of the path to the state.
        depth: Number of steps of the path to the state.
        states: Records of all states.
        other: Number of the other state.
        switching: Cost of the mode switches from the other state's combination to this state's
            combination.

    Returns:
        True if the state need not be expanded.
    """
    known = states[other]
    through = known.cost + switching
    return known.cost < cost and (through < cost or (through == cost and known.depth <= depth))


@kernel(borrows=True)
def expand(
    open_list: OpenList,
    labels: PostureLabels,
    cost_model: StepCostModel,
    edges: Edges,
    buffers: StepBuffers,
    search_input: ExactSearchInput,
    limit: int,
) -> int:
    """Run the kernel of the exact search: expand up to `limit` states.

    A state is a workspace node and the mode combination of arrival. The first call expands the
    start. The steps that leave a posture are priced with `cost_model` when they are first needed,
    and appended to `edges`. A state is useless if mode switches from another state of the same
    posture reach it as cheaply. A useless state does not enter the open list. A state that becomes
    useless in the list is removed without expansion; it still counts towards `limit`. The caller
    must hold the lock `PricedSteps.guard()`.

    Tested against scipy.sparse.csgraph.dijkstra on the same graph.

    Args:
        open_list: Open list and records of all states. Written in place.
        labels: Lower bounds and cheapest combinations per posture. Written in place.
        cost_model: Data for pricing steps.
        edges: Steps priced so far. New steps are written in place if there is room.
        buffers: Working memory for pricing steps, overwritten.
        search_input: Start, goal, weights, and numbers of mode switches.
        limit: Largest number of states to take from the open list, including the start.

    Returns:
        SEARCH_PAUSED if the limit is reached, GOAL_FOUND if the cheapest path is found,
        SEARCH_EXHAUSTED if no state is left. ARRAYS_FULL means that `edges` may lack room for the
        steps of one more posture. No state is lost then; the caller enlarges `edges` and calls
        again.
    """
    states, counts = open_list.states, open_list.counts
    owner, patterns = search_input.posture_of_state, len(cost_model.patterns)
    to_goal, goal_first = search_input.to_goal, search_input.goal_first
    state: int
    here: SearchState
    for _ in range(limit):
        if counts[EXPANDED_COUNT] == 0:
            origin = ExpandedState(NO_STATE, patterns, 0.0, 1)
            first = search_input.from_start
            steps = LeavingSteps(first.state, first.pattern, first.cost, 0, len(first.state))
            counts[EXPANDED_COUNT] += 1
            _relax_steps(open_list, labels, search_input, origin, steps)
            continue
        if counts[WAITING_COUNT] == 0:
            return SEARCH_EXHAUSTED
        state = open_list.heap[0]
        if state == len(states) - 1:
            pop_first_state(open_list)
            return GOAL_FOUND
        posture, own = owner[state], state % patterns  # state = node · patterns + pattern
        cheapest, here = labels.cheapest[posture], states[state]
        switching = search_input.weight[2] * search_input.switches[cheapest, own]
        if _is_dominated(here.cost, here.depth, states, state - own + cheapest, switching):
            pop_first_state(open_list)
            continue
        if edges.first[posture] == NOT_PRICED and not _add_edges(
            cost_model, edges, posture, buffers
        ):
            return ARRAYS_FULL
        pop_first_state(open_list)
        origin = ExpandedState(state, own, here.cost, here.depth + 1)
        counts[EXPANDED_COUNT] += 1
        begin, end = edges.first[posture], edges.last[posture]
        steps = LeavingSteps(edges.state, edges.pattern, edges.cost, begin, end)
        _relax_steps(open_list, labels, search_input, origin, steps)
        begin, end = goal_first[posture], goal_first[posture + 1]
        if begin < end:
            steps = LeavingSteps(to_goal.state, to_goal.pattern, to_goal.cost, begin, end)
            _relax_steps(open_list, labels, search_input, origin, steps)
    return SEARCH_PAUSED


@kernel(inline="always")
def _add_edges(cost_model: StepCostModel, edges: Edges, posture: int, buffers: StepBuffers) -> bool:
    """Price the steps that leave a posture, and append them to the graph's edges.

    Args:
        cost_model: Data for pricing steps.
        edges: Steps priced so far. Written in place.
        posture: Number of the posture.
        buffers: Working memory, overwritten.

    Returns:
        False if `edges` may have too little room for the steps; nothing is written then.
    """
    found = edges.used[0]
    room = compute_max_step_count(cost_model.layout, cost_model.patterns)
    if found + room > len(edges.state):
        return False
    edges.used[0] = price_steps(
        cost_model, posture, buffers, edges.state, edges.pattern, edges.cost, found
    )
    edges.first[posture], edges.last[posture] = found, edges.used[0]
    return True


@kernel(borrows=True)
def _relax_steps(
    open_list: OpenList,
    labels: PostureLabels,
    search_input: ExactSearchInput,
    origin: ExpandedState,
    steps: LeavingSteps,
) -> None:
    """Record every step that leads to a state more cheaply than the path known so far.

    At equal cost a path with fewer steps counts as cheaper. A state is a node with the mode
    combination of arrival. The same state can be reached by mode switches in the cheapest known
    state of its posture. The step is not recorded if that path is cheaper, or as cheap with no more
    steps. Otherwise the state enters the open list, or its place in the list is updated.

    Args:
        open_list: Open list and records of all states. Written in place.
        labels: Lower bound of each posture, and mode combination of its cheapest state. Written in
            place.
        search_input: Goal, weights, mode switches, and data for lower bounds.
        origin: State that the steps leave, with the cost of the path to this state.
        steps: The steps; all are counted as generated.
    """
    states, owner = open_list.states, search_input.posture_of_state
    w_energy, w_time, w_switch = search_input.weight
    switches, column = search_input.switches, search_input.column
    sink, depth = len(states) - 1, origin.next_depth
    there: SearchState
    other: int
    open_list.counts[GENERATED_COUNT] += steps.last - steps.first
    for e in range(steps.first, steps.last):
        target, arrival = steps.state[e], steps.pattern[e]
        if target == NO_STATE:
            target = sink
        cost = w_energy * steps.cost[e, column] + w_time * steps.cost[e, DURATION_COLUMN]
        cost += w_switch * switches[origin.pattern, arrival]
        cost += origin.cost
        there = states[target]
        if cost > there.cost or (cost == there.cost and depth >= there.depth):
            continue
        least = 0.0
        if target != sink:
            posture = owner[target]
            cheapest = labels.cheapest[posture]
            other, switching = target - arrival + cheapest, w_switch * switches[cheapest, arrival]
            if cheapest == NO_STATE or cost < states[other].cost:
                labels.cheapest[posture] = arrival
            elif _is_dominated(cost, depth, states, other, switching):
                continue
            if math.isnan(labels.remaining[posture]):
                labels.remaining[posture] = bound_cost_to_nearest(
                    search_input.circuit,
                    search_input.length[posture],
                    search_input.goal_length,
                    search_input.weight,
                )
            least = labels.remaining[posture]
        there.step = e
        record_path_to(open_list, target, origin.state, depth, cost, least)


class ExactSearch:
    """Exact search for the cheapest path; if paths cost the same, for one with the fewest steps."""

    first_portion, portion = 50, 2000

    def __init__(self, query: Query) -> None:
        """Prepare a search without expanding anything.

        Args:
            query: Problem to solve: graph, start, goal and weights.
        """
        self._query = query
        layout = query.graph.layout
        self._open_list = create_open_list(layout.posture_of_state.size)
        postures, reached = len(layout.posture), np.zeros(len(query.goal.postures.length), bool)
        reached[query.to_goal.end] = True
        self._buffers = create_step_buffers(query.graph.table.patterns)
        self._labels = PostureLabels(np.full(postures, np.nan), np.full(postures, NO_STATE))
        self._search_input = ExactSearchInput(
            from_start=query.from_start,
            to_goal=query.to_goal,
            goal_first=query.goal_first,
            circuit=query.graph.circuit,
            length=query.graph.postures.length,
            goal_length=query.goal.postures.length[reached],
            posture_of_state=layout.posture_of_state.ravel(),
            switches=np.vstack([query.graph.switches, query.start_switches]),
            weight=query.weight,
            column=query.energy_column,
        )

    @property
    def expanded(self) -> int:
        """Number of states expanded so far."""
        return int(self._open_list.counts[EXPANDED_COUNT])

    @property
    def generated(self) -> int:
        """Number of steps examined so far."""
        return int(self._open_list.counts[GENERATED_COUNT])

    @property
    def cost(self) -> float:
        """Cost of the path found; inf as long as no path is found."""
        return self._open_list.goal_cost

    def expand(self, limit: int) -> int:
        """Expand up to `limit` states, and price their steps if necessary; call again to continue.

        The priced steps are stored in the graph. Its arrays are enlarged if necessary. The call
        holds the lock of the graph's steps until it returns.

        Args:
            limit: Largest number of states to take from the open list, skipped states included.

        Returns:
            SEARCH_PAUSED if the limit is reached, GOAL_FOUND, or SEARCH_EXHAUSTED if there is no
            path.
        """
        steps, end = self._query.graph.steps, self.expanded + limit
        with steps.guard():
            while True:
                status = expand(
                    self._open_list,
                    self._labels,
                    steps.cost_model,
                    steps.edges,
                    self._buffers,
                    self._search_input,
                    end - self.expanded,
                )
                if status != ARRAYS_FULL:
                    return int(status)
                steps.grow(
                    compute_max_step_count(steps.cost_model.layout, steps.cost_model.patterns)
                )

    def trace_path(self) -> tuple[IntArray, IntArray]:
        """Return the states and steps of the path that the search has found.

        Returns:
            Numbers of the states between start and goal, shape (k - 1,): node · patterns + pattern.
            Numbers of the k steps, shape (k,), as rows of three lists. The first step is a row of
            `Query.from_start`, even if it is the only step. The last of several steps is a row of
            `Query.to_goal`. All others are rows of the graph's edges.
        """
        way = trace_path_to_goal(self._open_list)
        return way[:-1], self._open_list.states["step"][way].astype(np.int64)
