"""A path in the arm's plane with the turning of that plane: a path of the whole arm.

Gravity asks nothing of a slew, so that postures and modes are chosen in the plane alone, and the
slew takes its oil at P_S whenever it turns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, IntArray
from mhsb_planner.planners.path_planner import Task
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.slewing.sharing_out import NOTHING, path_oil, shared_out, slew_way

RESTS = -1


@dataclass(frozen=True, eq=False)
class Turning:
    """How the plane turns along a path of k steps in it.

    step      int64[p], of the path that each step of the whole arm takes, in order; RESTS where the
              plane's joints rest and the slew alone turns
    angle     float64[p + 1], of the slew, at the ends of these steps [rad]
    duration  float64[p], of these steps [s]
    """

    step: IntArray
    angle: FloatArray
    duration: FloatArray

    @property
    def places(self) -> IntArray:
        """Where on the path each end of a step is, int64[p + 1]."""
        return np.append(0, np.cumsum(self.step != RESTS))


def turning_evenly(machine: Machine, path: DiscretePath, began: float, ended: float) -> Turning:
    """In the time that the path takes, or as little longer as it needs (`sharing_out`)."""
    way, m = slew_way(machine, began, ended), machine.arrays
    flow = m.main_pump_flow - machine.joint_count * m.leakage_flow
    if path.steps == 0 and way > NOTHING:
        step, duration, oil = np.array([RESTS]), np.zeros(1), np.zeros(1)
    else:
        step, duration = np.arange(path.steps), path.duration
        oil = path_oil(machine.plane, path.posture)
    share, longer = shared_out(way, duration, oil, m.max_piston_speed[0], flow, m.cap_area[0])
    done = np.append(0.0, np.cumsum(share)) / way if way > NOTHING else np.zeros(len(share) + 1)
    return Turning(step, (1.0 - done) * began + done * ended, longer)


def corners(turning: Turning, corner: int | None) -> IntArray:
    """Numbers of the steps before which the plane's joints stop for the slew or go on after it.

    corner  number of the step of the path after a corner of its own, which is one of them; None:
            there is none
    """
    alone = turning.step == RESTS
    before = np.flatnonzero(alone[1:] != alone[:-1]) + 1
    if corner is not None:
        before = np.union1d(before, np.flatnonzero(turning.step == corner))
    return before


def turned(machine: Machine, task: Task, path: DiscretePath, turning: Turning) -> DiscretePath:
    """The path of the whole arm; joint 1 is in N throughout.

    machine, task  the whole arm, and what is asked of it
    path           in its plane
    """
    m, n, weights = machine.arrays, machine.joint_count, task.options.weights
    rests, moves = turning.step == RESTS, np.maximum(turning.step, 0)
    at = turning.places
    length = [cylinder_length(m.linkage[0], angle) for angle in turning.angle]
    way = np.abs(np.diff(length))

    def of_steps(values: FloatArray) -> FloatArray:
        """What the path has for each step; nothing where it rests."""
        return np.where(rests, 0.0, values[moves]) if path.steps else np.zeros(len(rests))

    if path.steps > 0:  # while it rests, in the modes of the step that follows, or of the last
        modes = path.modes[np.minimum(at[:-1], path.steps - 1)]
    else:
        modes = np.repeat(path.start_modes[None, :], len(rests), axis=0)
    later = turning.duration - of_steps(path.duration)
    added = m.supply_pressure * (m.cap_area[0] * way + n * m.leakage_flow * later)
    dearer = weights.energy * added.sum() + weights.time * later.sum()
    return replace(
        path,
        tip=machine.in_base(path.tip[at], turning.angle),
        posture=np.column_stack([turning.angle, path.posture[at]]),
        modes=np.insert(modes, 0, Mode.N, axis=1),
        duration=turning.duration,
        energy=of_steps(path.energy) + added,
        energy_series=of_steps(path.energy_series) + added,
        cost=path.cost + float(dearer),
        start_modes=task.modes.modes,
    )
