"""Slewing: a path in the arm's plane, and the turning of that plane in the same time.

Gravity asks nothing of a slew, so that postures and modes are chosen in the plane alone, and the
slew takes its oil at P_S whenever it turns. Between the path's steps it is shared out at one speed,
as far as V_max and what the main pump has left in each step allow; where that is not enough, all
steps take longer by one factor λ:

    sᵢ = min(v λtᵢ, V_max λtᵢ, (Q λtᵢ − Vᵢ)/A),  Σ sᵢ = |ΔL|,  Q = Q_MP − n q_leak

with the steps' durations tᵢ and the oil Vᵢ that they take, and of the slew its piston's way |ΔL|
and area A.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mhsb_model.linkages.linkage import cylinder_length
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import MotionState
from mhsb_model.types import FloatArray
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.planners.path_planner import Candidate, Meanwhile, Task
from mhsb_planner.search.discrete_path import DiscretePath

HALVINGS = 50
"""Of the interval in which a speed or a factor is known to be."""

NOTHING = 1e-9
"""A way of the slew's piston that is rounding [m]."""


class Slewing:
    """How an arm gets from a task's departure to an angle of its slew, whatever its plane does.

    in_plane  the task for the plane alone; of an arm that does not slew the task itself
    """

    def __init__(self, machine: Machine, task: Task, slew: float | None) -> None:
        self._machine, self._task, self._slew = machine, task, slew
        self._way = 0.0 if slew is None else slew_way(machine, task.departure[0], slew)
        self.in_plane = task if slew is None else _without_slew(machine, task, slew)

    def along(self, candidate: Candidate) -> Candidate:
        """The same path, the plane turning meanwhile."""
        if self._slew is None:
            return candidate
        return candidate._replace(path=self._turned(candidate.path, self._slew))

    def _turned(self, path: DiscretePath, slew: float) -> DiscretePath:
        """A path in the plane, joint 1 added in N, up to the angle `slew` [rad]."""
        machine, way = self._machine, self._way
        m, n = machine.arrays, machine.joint_count
        if path.steps == 0 and way > NOTHING:
            path = _resting(path)
        flow = m.main_pump_flow - n * m.leakage_flow
        oil = path_oil(machine.plane, path.posture)
        share, longer = shared_out(
            way, path.duration, oil, m.max_piston_speed[0], flow, m.cap_area[0]
        )
        done = np.append(0.0, np.cumsum(share)) / way if way > NOTHING else np.zeros(len(share) + 1)
        angle = (1.0 - done) * self._task.departure[0] + done * slew
        leaks = n * m.leakage_flow * (longer - path.duration)
        added = m.supply_pressure * (m.cap_area[0] * share + leaks)
        weights = self._task.options.weights
        dearer = weights.energy * added.sum() + weights.time * (longer - path.duration).sum()
        return replace(
            path,
            tip=machine.in_base(path.tip, angle),
            posture=np.column_stack([angle, path.posture]),
            modes=np.insert(path.modes, 0, Mode.N, axis=1),
            duration=longer,
            energy=path.energy + added,
            energy_series=path.energy_series + added,
            cost=path.cost + float(dearer),
            start_modes=self._task.modes.modes,
        )


def slew_way(machine: Machine, began: float, ended: float) -> float:
    """How far the slew's piston goes between two of its angles [rad], |ΔL| [m]."""
    row = machine.arrays.linkage[0]
    return abs(cylinder_length(row, float(ended)) - cylinder_length(row, float(began)))


def slewing_meanwhile(machine: Machine, began: float, ended: float) -> Meanwhile:
    """What slewing between two angles [rad] takes: A |ΔL|, and |ΔL|/V_max at least."""
    way, m = slew_way(machine, began, ended), machine.arrays
    return Meanwhile(float(m.cap_area[0] * way), float(way / m.max_piston_speed[0]))


def _without_slew(machine: Machine, task: Task, slew: float) -> Task:
    """What is asked of the plane alone; how a moving start comes to rest is for the whole arm."""
    start, modes = task.start, task.modes
    return replace(
        task,
        start=MotionState(start.position[1:], start.velocity[1:], start.acceleration[1:]),
        modes=StartModes(modes.modes[1:], modes.age[1:]),
        brake=None,
        departure=task.departure[1:],
        meanwhile=slewing_meanwhile(machine, start.position[0], slew),
    )


def _resting(path: DiscretePath) -> DiscretePath:
    """A path without steps as one of a single step, in which the plane's joints rest."""
    return replace(
        path,
        tip=np.repeat(path.tip, 2, axis=0),
        posture=np.repeat(path.posture, 2, axis=0),
        modes=path.start_modes[None, :],
        duration=np.zeros(1),
        energy=np.zeros(1),
        energy_series=np.zeros(1),
    )


def path_oil(machine: Machine, posture: FloatArray) -> FloatArray:
    """Σ A_dir |ΔL| between each of the postures float64[k + 1, n] and the next, float64[k] m³."""
    a = machine.arrays
    way = np.diff([machine.cylinder_lengths(q) for q in posture], axis=0)
    return np.where(way > 0.0, a.cap_area * way, -a.rod_area * way).sum(axis=1)


def shared_out(
    way: float, duration: FloatArray, oil: FloatArray, fastest: float, flow: float, area: float
) -> tuple[FloatArray, FloatArray]:
    """What of its way [m] the slew's piston goes in each step, and how long that lasts [s].

    duration [s] and oil [m³] of the steps float64[k] without it; its V_max [m/s] and area [m²], and
    the flow [m³/s] that it shares with them. See the module.
    """

    def most(factor: float) -> FloatArray:
        """That each step has room for, lasting so many times as long."""
        left = np.maximum(flow * factor * steps - oil, 0.0) / area
        return np.minimum(fastest * factor * steps, left)

    if len(duration) == 0:
        return np.zeros(0), duration
    steps, longer = duration, 1.0
    if not duration.any():
        steps = np.full(len(duration), way / len(duration) / min(fastest, flow / area))
    elif most(1.0).sum() < way:  # some share of V_max and of the flow is always left
        enough = 1.0 + (way / min(fastest, flow / area) + oil.sum() / flow) / duration.sum()
        longer = _least(lambda factor: most(factor).sum() >= way, 1.0, enough)
    room, steps = most(longer), longer * steps
    speed = _least(lambda v: np.minimum(v * steps, room).sum() >= way, 0.0, fastest)
    share = np.minimum(speed * steps, room)
    return share * (way / share.sum() if way > 0.0 else 0.0), steps


def _least(holds: Callable[[float], bool], low: float, high: float) -> float:
    """The least number from which on `holds`, known to lie between these."""
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high
