"""Tip positions over which an arm may be carried past zones in space: lifted, or drawn in."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.obstacles.clearance import clearances
from mhsb_model.types import FloatArray, frozen
from mhsb_planner.planners.path_planner import Task
from mhsb_planner.search.lower_bound import least_costs_between
from mhsb_planner.search.s2_graph import StepGraph

APART = 3.0
"""Positions that are tried lie so many of the grid's spacings apart, at least."""


def carrying_postures(among: Machine, graph: StepGraph, task: Task) -> Iterator[FloatArray]:
    """Postures of the table, float64[n] rad in the plane, in which the plane may turn all the way.

    among  the arm in its plane, among the shadows of all that it turns past
    task   in the plane

    Those first on the way over which the least cost from the departure to the goal is least; each
    next one has its tip elsewhere.
    """
    postures, tips = _at_nodes(graph)
    rows = among.obstacles.path_rows
    clear = clearances(among.arrays, rows, frozen(postures))[0] >= 0.0
    postures, tips = postures[clear], tips[clear]
    if len(postures) == 0:
        return
    weights = task.options.weights
    weight = frozen(np.array([weights.energy, weights.time, weights.switches]))
    lengths = frozen(np.array([among.cylinder_lengths(q) for q in postures]))
    ends = among.cylinder_lengths(task.departure), _lengths_near(graph, task.goal)
    over = [least_costs_between(graph.circuit, end, lengths, weight) for end in ends]
    left = np.argsort(over[0] + over[1], kind="stable")
    while len(left) > 0:
        best = left[0]
        yield postures[best]
        away = np.linalg.norm(tips[left] - tips[best], axis=1)
        left = left[away >= APART * graph.table.spacing]


def _at_nodes(graph: StepGraph) -> tuple[FloatArray, FloatArray]:
    """The table's postures with all in N, and their tips, float64[nodes, 2] m."""
    postures = graph.table.posture[:, 0]
    feasible = np.isfinite(postures).all(axis=1)
    tips = graph.table.nodes[feasible].astype(np.float64) * graph.table.spacing
    return postures[feasible], tips


def _lengths_near(graph: StepGraph, goal: tuple[float, ...]) -> FloatArray:
    """Cylinder lengths [m] in the table's posture whose tip is nearest to the goal."""
    postures, tips = _at_nodes(graph)
    nearest = np.argmin(np.linalg.norm(tips - np.array(goal), axis=1))
    return graph.machine.cylinder_lengths(postures[nearest])
