"""Combination of a path in the arm's plane with a slew motion into a path of the whole arm.

Gravity does not load a slew, so postures and modes are chosen for the plane alone. Whenever the
slew turns, it takes its oil at the main pump's pressure.
"""

from dataclasses import dataclass, replace

import numpy as np

from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.planners.path_planner import PathRequest
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.slewing.slew_distribution import (
    STROKE_ROUNDING,
    compute_path_oil,
    compute_slew_stroke,
    distribute_stroke,
)

REST_STEP = -1
"""Index that marks a step in which the slew turns alone and all other joints rest."""


@dataclass(frozen=True, eq=False)
class SlewMotion:
    """Slew motion along a planar path of k steps, in p ≥ k steps of the whole arm."""

    step: IntArray
    """Index of the path step in each step of the whole arm, int64[p], ascending.

    REST_STEP marks a step in which the slew turns alone."""

    angle: FloatArray
    """Slew angle at the start and after each step of the whole arm, float64[p + 1], [rad]."""

    duration: FloatArray
    """Duration of each step of the whole arm, float64[p], [s]."""

    @property
    def path_index(self) -> IntArray:
        """Index of the path's posture at the start and after each step of the whole arm.

        int64[p + 1], in ascending order.
        """
        return np.append(0, np.cumsum(self.step != REST_STEP))


def compute_even_turning(
    machine: Machine, path: DiscretePath, start_angle: float, end_angle: float
) -> SlewMotion:
    """Compute a slew motion at an even speed along a planar path, without regard to zones.

    The slew's piston has the same speed in all steps, except where its largest speed or the main
    pump's flow only allows a lower speed. If the slew cannot keep up with the path, all steps
    become longer by one factor. If the path has no steps, the slew turns alone, as quickly as
    possible.

    Args:
        machine: The whole arm, which slews.
        path: Path in the arm's plane.
        start_angle: Slew angle at the start of the path [rad].
        end_angle: Slew angle at the end of the path [rad].

    Returns:
        Slew motion with one step for each path step. For a path without steps: one step in which
        the slew turns alone, or no step if the two slew angles are equal.
    """
    way, m = compute_slew_stroke(machine, start_angle, end_angle), machine.arrays
    flow = m.main_pump_flow - machine.joint_count * m.leakage_flow
    if path.steps == 0 and way > STROKE_ROUNDING:
        step, duration, oil = np.array([REST_STEP]), np.zeros(1), np.zeros(1)
    else:
        step, duration = np.arange(path.steps), path.duration
        oil = compute_path_oil(machine.planar_arm, path.posture)
    share, longer = distribute_stroke(
        way, duration, oil, m.max_piston_speed[0], flow, m.cap_area[0]
    )
    done = (
        np.append(0.0, np.cumsum(share)) / way
        if way > STROKE_ROUNDING
        else np.zeros(len(share) + 1)
    )
    return SlewMotion(step, (1.0 - done) * start_angle + done * end_angle, longer)


def find_rest_steps(turning: SlewMotion, via_step: int | None) -> IntArray:
    """Find the steps of the whole arm before which the joints in the plane must come to rest.

    Steps in which the slew turns alone may follow each other. The joints must rest before the first
    of these steps, unless it is step 0, and before the step that follows the last of them. They
    must also rest before the step after a via point.

    Args:
        turning: Slew motion along a path.
        via_step: Index of the path step after a via point; None if there is none.

    Returns:
        Indices of steps of the whole arm in ascending order.
    """
    alone = turning.step == REST_STEP
    before = np.flatnonzero(alone[1:] != alone[:-1]) + 1
    if via_step is not None:
        before = np.union1d(before, np.flatnonzero(turning.step == via_step))
    return before


def combine_with_slew(
    machine: Machine, request: PathRequest, path: DiscretePath, turning: SlewMotion
) -> DiscretePath:
    """Combine a planar path and a slew motion into a path of the whole arm.

    Joint 1, the slew, is in mode N throughout. A step in which the slew turns alone has the other
    modes of the path step that follows, or of the last one. In each step the slew's piston of area
    A [m²] moves by s [m], and the step becomes longer by ΔT [s]. The energy of the step then grows
    by

        ΔE = P_S (A s + n q_leak ΔT)

    P_S is the main pump's pressure [Pa] and q_leak the leakage flow of each of n valves [m³/s]. The
    cost grows by the weighted sums of ΔE and ΔT.

    Args:
        machine: The whole arm, which slews.
        request: Path request of the whole arm, for weights and start modes.
        path: Path in the arm's plane.
        turning: Slew motion along the path.

    Returns:
        Path of the whole arm. Postures and modes have the slew as their first column. Tip positions
        are (x, y, z) in `base_link` [m].
    """
    m, n, weights = machine.arrays, machine.joint_count, request.options.weights
    rests, moves = turning.step == REST_STEP, np.maximum(turning.step, 0)
    at = turning.path_index
    length = [cylinder_length(m.linkage[0], angle) for angle in turning.angle]
    way = np.abs(np.diff(length))

    def spread_over_steps(values: FloatArray) -> FloatArray:
        """Assign a quantity of the path's steps to the steps of the whole arm.

        Args:
            values: Value of each path step, float64[k].

        Returns:
            Value of each step of the whole arm, float64[p]; 0 in steps in which the slew turns
            alone.
        """
        return np.where(rests, 0.0, values[moves]) if path.steps else np.zeros(len(rests))

    # A rest has the modes of the path step that follows, or of the last one.
    if path.steps > 0:
        modes = path.modes[np.minimum(at[:-1], path.steps - 1)]
    else:
        modes = np.repeat(path.start_modes[None, :], len(rests), axis=0)
    later = turning.duration - spread_over_steps(path.duration)
    added = m.supply_pressure * (m.cap_area[0] * way + n * m.leakage_flow * later)
    dearer = weights.energy * added.sum() + weights.time * later.sum()
    return replace(
        path,
        tip=machine.convert_to_base(path.tip[at], turning.angle),
        posture=np.column_stack([turning.angle, path.posture[at]]),
        modes=np.insert(modes, 0, Mode.N, axis=1),
        duration=turning.duration,
        energy=spread_over_steps(path.energy) + added,
        energy_series=spread_over_steps(path.energy_series) + added,
        cost=path.cost + float(dearer),
        start_modes=request.modes.modes,
    )
