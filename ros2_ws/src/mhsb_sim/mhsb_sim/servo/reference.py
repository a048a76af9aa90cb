"""The reference that the servo follows: a trajectory and its mode schedule, now and a bit ahead."""

from __future__ import annotations

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import (
    SECOND_NS,
    MotionState,
    Trajectory,
    quintic_hermite,
    standstill,
)
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_sim.bound_kernel import bind
from mhsb_sim.records import Records
from mhsb_sim.servo.pace import full_pace

AHEAD = 2
"""Number of the point for which modes and forces are prepared."""


class Reference:
    """What the servo is to do now, and ahead.

    Evaluated into `values`, float64[points, 3, n]: now and at evenly spaced times after, of which
    point `AHEAD` is `preview` [s] later; position [rad], velocity [rad/s], acceleration [rad/s²].
    These and the modes, now and `preview` later, are valid after `update`.

    pace    PACE[1], of the trajectory's own time
    wanted  float64[n], velocity [rad/s] that the trajectory has now at full pace
    """

    trajectory: Trajectory
    schedule: ModeSchedule

    def __init__(self, values: FloatArray, preview: float) -> None:
        self._values = values
        self._spacing_ns = round(preview / AHEAD * SECOND_NS)
        self._rows: IntArray = np.zeros(2, dtype=np.int64)
        self.pace = full_pace()
        self.wanted: FloatArray = np.zeros(values.shape[2])

    def follow(self, trajectory: Trajectory, schedule: ModeSchedule, *, planned: bool) -> None:
        """Follow a trajectory with its mode schedule from now on.

        planned: whether it is a plan, which has a stamp while it is executed, or the simulator's
        own way to stop or hold.
        """
        self.trajectory = trajectory
        self.schedule = schedule
        self._planned = planned
        self._evaluate = bind(
            evaluate,
            trajectory.offset_ns,
            trajectory.position,
            trajectory.velocity,
            trajectory.acceleration,
            schedule.offset_ns,
            self._values,
            self._rows,
            self.pace,
            self.wanted,
            integers=2,
        )
        self._rows[:] = -1  # so that the next update reports the modes as changed

    def own_time_ns(self, time_ns: int) -> int:
        """By which the trajectory is followed at `time_ns`: less the delay so far."""
        return time_ns - int(np.rint(self.pace["delay"][0]))

    @property
    def rests(self) -> bool:
        """Whether the trajectory has come to its end."""
        return bool(self.pace["rests"][0])

    def hold(self, time_ns: int, position: FloatArray, modes: ModeArray) -> None:
        """Stand still at `position` [rad] in `modes` from its own time on."""
        schedule = ModeSchedule(time_ns, np.zeros(1, dtype=np.int64), np.atleast_2d(modes))
        self.follow(standstill(position, time_ns), schedule, planned=False)

    def executes_plan(self, time_ns: int) -> bool:
        """Whether a plan is being executed, not ended, stopped or replaced by holding."""
        return self._planned and self.own_time_ns(time_ns) <= self.trajectory.end_ns

    def update(self, time_ns: int) -> bool:
        """Evaluate the reference at `time_ns`; returns whether the modes now or ahead changed."""
        now, ahead = self._rows
        self._evaluate(self._spacing_ns, time_ns - self.trajectory.stamp_ns)
        return bool(now != self._rows[0] or ahead != self._rows[1])

    @property
    def modes(self) -> ModeArray:
        """Modes in force, uint8[n]."""
        return self.schedule.modes[self._rows[0]]

    @property
    def modes_ahead(self) -> ModeArray:
        """Modes in force `preview` later, uint8[n]."""
        return self.schedule.modes[self._rows[1]]

    @property
    def state(self) -> MotionState:
        """Reference position, velocity and acceleration now."""
        position, velocity, acceleration = self._values[0].copy()
        return MotionState(position, velocity, acceleration)

    def at_full_pace(self, time_ns: int) -> MotionState:
        """What the reference would be now if nothing slowed it."""
        if self.pace["rate"][0] == 1.0:
            return self.state
        return self.trajectory.sample(self.own_time_ns(time_ns))


@kernel(borrows=True)
def evaluate(
    offset_ns: IntArray,
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    mode_offset_ns: IntArray,
    values: FloatArray,
    rows: IntArray,
    pace: Records,
    wanted: FloatArray,
    spacing_ns: int,
    since_ns: int,
) -> None:
    """Reference now and ahead: the quintic Hermite between points, and rows of the modes.

    spacing_ns: from point to point; since_ns: now, after the stamp of trajectory and schedule;
    the trajectory's own time is less by the pace's delay. Writes values float64[points, 3, n],
    slowed as the pace is, rows int64[2], now and at point `AHEAD`, and wanted[n]. Oracle:
    Trajectory.sample (test/test_reference.py).
    """
    last = len(offset_ns) - 1
    since_ns -= int(np.rint(pace[0].delay))
    pace[0].rests = 1.0 if since_ns > offset_ns[last] else 0.0
    rate, change = pace[0].rate, pace[0].change
    if rate != 1.0:
        spacing_ns = int(rate * spacing_ns)
    for k in range(2):
        time = since_ns + k * AHEAD * spacing_ns
        rows[k] = max(0, int(np.searchsorted(mode_offset_ns, time, "right")) - 1)
    for k in range(len(values)):
        time = since_ns + k * spacing_ns
        out = values[k]
        if time > offset_ns[last] or last == 0:
            for j in range(position.shape[1]):
                out[0, j], out[1, j], out[2, j] = position[last, j], 0.0, 0.0
                if k == 0:
                    wanted[j] = 0.0
            continue
        time = max(time, 0)
        i = min(int(np.searchsorted(offset_ns, time, "right")) - 1, last - 1)
        h = (offset_ns[i + 1] - offset_ns[i]) / SECOND_NS
        s = (time - offset_ns[i]) / SECOND_NS
        for j in range(position.shape[1]):
            start = (position[i, j], velocity[i, j], acceleration[i, j])
            end = (position[i + 1, j], velocity[i + 1, j], acceleration[i + 1, j])
            out[0, j], out[1, j], out[2, j] = quintic_hermite(s, h, start, end)
            if k == 0:
                wanted[j] = out[1, j]
            if rate != 1.0 or change != 0.0:
                slowing = change * out[1, j] if k == 0 else 0.0
                out[1, j] *= rate
                out[2, j] = rate * rate * out[2, j] + slowing
