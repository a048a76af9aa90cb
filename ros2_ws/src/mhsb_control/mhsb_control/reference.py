"""The reference of the servo: a trajectory and its mode schedule, evaluated now and ahead."""

from typing import NamedTuple

import numpy as np

from mhsb_control.speed_scaling import SpeedScaling, build_full_speed_scaling
from mhsb_model.kernels.bound_kernel import bind_kernel
from mhsb_model.kernels.kernel import kernel
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.records import Records
from mhsb_model.trajectory import (
    SECOND_NS,
    JointMotion,
    MotionState,
    Trajectory,
    quintic_hermite,
)
from mhsb_model.types import FloatArray, IntArray, ModeArray

PREVIEW_POINT = 2
"""Index of the reference point for which modes and forces are prepared."""


class EvaluatedReference(NamedTuple):
    """Arrays into which `evaluate_reference` writes.

    Attributes:
        values: Positions, velocities and accelerations at present and ahead, float64[points, 3, n].
        mode_rows: Index of the mode schedule's row in force now, and at point `PREVIEW_POINT`,
            int64[2].
        full_speed_velocity: Present velocity without speed scaling, float64[n], [rad/s or m/s].
        command_values: Positions, velocities and accelerations at `command_times`, float64[k, 3,
            n].
        command_times: Times from now at full speed, float64[k], [s]. They are only read.
    """

    values: FloatArray
    mode_rows: IntArray
    full_speed_velocity: FloatArray
    command_values: FloatArray
    command_times: FloatArray


class ReferencePreview:
    """Reference of the servo, evaluated at present and at a few points ahead.

    `update` writes positions [rad or m], velocities and accelerations of the joints into
    `values`, float64[points, 3, n]. The points are evenly spaced in time; the first is now, and
    point `PREVIEW_POINT` is `preview` [s] later. Values and modes are valid after `update`.

    Attributes:
        trajectory: The trajectory that is followed.
        schedule: Its mode schedule.
        speed_scaling: State of the speed scaling, SpeedScaling[1].
        full_speed_velocity: Present velocity of the trajectory without speed scaling, float64[n],
            [rad/s or m/s].
    """

    trajectory: Trajectory
    schedule: ModeSchedule

    def __init__(
        self,
        values: FloatArray,
        preview: float,
        command_values: FloatArray | None = None,
        command_times: FloatArray | None = None,
    ) -> None:
        """Prepare the reference; call `follow` before the first `update`.

        Args:
            values: Array that `update` writes in place, float64[points, 3, n]: positions,
                velocities and accelerations of n joints at evenly spaced times from now on.
            preview: Time from now to point `PREVIEW_POINT` [s].
            command_values: Array that `update` writes in place, float64[k, 3, n]: positions,
                velocities and accelerations at `command_times`. None if there are no such times.
            command_times: Times from now, float64[k], [s], which are read at every `update`. None
                if there are no such times.
        """
        self._values = values
        count = values.shape[2]
        self._command_values = np.zeros((0, 3, count)) if command_values is None else command_values
        self._command_times = np.zeros(0) if command_times is None else command_times
        self._spacing_ns = round(preview / PREVIEW_POINT * SECOND_NS)
        self._rows: IntArray = np.zeros(2, dtype=np.int64)
        self.speed_scaling = build_full_speed_scaling()
        self.full_speed_velocity: FloatArray = np.zeros(values.shape[2])

    def follow(self, trajectory: Trajectory, schedule: ModeSchedule, *, planned: bool) -> None:
        """Follow a trajectory with its mode schedule from now on.

        The values change at the next `update`, which then returns True. Rate and delay of the speed
        scaling are kept.

        Args:
            trajectory: Trajectory to be followed.
            schedule: Its mode schedule.
            planned: Whether the trajectory is a plan. False for a stop or a hold that the arm makes
                itself; `executes_plan` then returns False.
        """
        self.trajectory = trajectory
        self.schedule = schedule
        self._planned = planned
        self._evaluate = bind_kernel(
            evaluate_reference,
            trajectory.offset_ns,
            trajectory.points,
            schedule.offset_ns,
            EvaluatedReference(
                self._values,
                self._rows,
                self.full_speed_velocity,
                self._command_values,
                self._command_times,
            ),
            self.speed_scaling,
            integer_count=2,
        )
        self._rows[:] = -1  # so that the next update reports the modes as changed

    def compute_trajectory_time_ns(self, time_ns: int) -> int:
        """Return the time at which the trajectory is evaluated for a time of the servo.

        This is the servo's time minus the delay that speed scaling has accumulated.

        Args:
            time_ns: Time of the servo [ns].

        Returns:
            Time at which the trajectory is evaluated, on the same clock [ns].
        """
        return time_ns - int(np.rint(self.speed_scaling["delay"][0]))

    @property
    def has_ended(self) -> bool:
        """True if the trajectory had ended at the last `update`."""
        return bool(self.speed_scaling["rests"][0])

    def executes_plan(self, time_ns: int) -> bool:
        """Return whether the arm is executing a plan.

        Args:
            time_ns: Present time of the servo [ns].

        Returns:
            True if the arm follows a plan whose trajectory has not ended. A stop or a hold is no
            plan. The delay by speed scaling postpones the end.
        """
        return self._planned and self.compute_trajectory_time_ns(time_ns) <= self.trajectory.end_ns

    def update(self, time_ns: int) -> bool:
        """Evaluate the reference and its modes now and at the points ahead.

        Args:
            time_ns: Present time of the servo [ns].

        Returns:
            True if the mode schedule's row that applies now, or at point `PREVIEW_POINT`, has
            changed since the previous call. True at the first call after `follow`.
        """
        now, ahead = self._rows
        self._evaluate(self._spacing_ns, time_ns - self.trajectory.stamp_ns)
        return bool(now != self._rows[0] or ahead != self._rows[1])

    @property
    def modes(self) -> ModeArray:
        """Modes of the mode schedule now, uint8[n]; the mode guard is not taken into account."""
        return self.schedule.modes[self._rows[0]]

    @property
    def modes_ahead(self) -> ModeArray:
        """Modes of the mode schedule at point `PREVIEW_POINT`, uint8[n]."""
        return self.schedule.modes[self._rows[1]]

    @property
    def state(self) -> MotionState:
        """Position, velocity and acceleration of the reference at present, with speed scaling."""
        position, velocity, acceleration = self._values[0].copy()
        return MotionState(position, velocity, acceleration)

    def sample_at_full_speed(self, time_ns: int) -> MotionState:
        """Return the trajectory's present state as if there were no speed scaling.

        Speed scaling changes velocity and acceleration of the reference, but not the path. The
        returned values belong to the trajectory at the present position. At rate 1, they are the
        state of the last `update`.

        Args:
            time_ns: Present time of the servo [ns].

        Returns:
            State of the trajectory at `compute_trajectory_time_ns(time_ns)`.
        """
        if self.speed_scaling["rate"][0] == 1.0:
            return self.state
        return self.trajectory.sample(self.compute_trajectory_time_ns(time_ns))


@kernel(borrows=True)
def evaluate_reference(
    offset_ns: IntArray,
    points: JointMotion,
    mode_offset_ns: IntArray,
    reference: EvaluatedReference,
    speed_scaling: Records[SpeedScaling],
    spacing_ns: int,
    since_ns: int,
) -> None:
    """Evaluate the reference at present and ahead, and find its modes.

    Between the trajectory's points the reference is a quintic polynomial. Before the stamp it has
    the first point's state, and after the end it rests at the last point. A trajectory of one point
    rests.

    At the rate s of the speed scaling, velocities are multiplied by s and accelerations by s². The
    accelerations at present and at `command_times` also contain ds/dt times the velocity at full
    speed. Times ahead of now are multiplied by s before the trajectory is evaluated. Tested against
    `Trajectory.sample`.

    Args:
        offset_ns: Times of the trajectory's points after its stamp, int64[k], [ns].
        points: Motion of the joints at these points.
        mode_offset_ns: Times after the stamp from which each row of the mode schedule applies,
            int64[rows], [ns].
        reference: Arrays for states at the reference points and command times, rows of the mode
            schedule, and the velocity at full speed. All but `command_times` are written in place.
        speed_scaling: State of the speed scaling, SpeedScaling[1]. Reads rate and delay. Writes
            `rests` in place: 1 if the trajectory has ended, else 0.
        spacing_ns: Time between two reference points at full speed [ns].
        since_ns: Time from the trajectory's stamp to now [ns]. The kernel subtracts the delay.
    """
    values, rows, full_speed_velocity, command_values, command_times = reference
    since_ns -= int(np.rint(speed_scaling[0].delay))
    speed_scaling[0].rests = 1.0 if since_ns > offset_ns[-1] else 0.0
    rate, change = speed_scaling[0].rate, speed_scaling[0].change
    if rate != 1.0:
        spacing_ns = int(rate * spacing_ns)
    for k in range(2):
        time = since_ns + k * PREVIEW_POINT * spacing_ns
        rows[k] = max(0, int(np.searchsorted(mode_offset_ns, time, "right")) - 1)
    for k in range(len(values)):
        time = since_ns + k * spacing_ns
        evaluate_trajectory(offset_ns, points, time, values[k])
        if k == 0:
            for j in range(len(full_speed_velocity)):
                full_speed_velocity[j] = values[0, 1, j]
        scale_speed(values[k], rate, change if k == 0 else 0.0)
    for k in range(len(command_times)):
        time = since_ns + int(rate * command_times[k] * SECOND_NS)
        evaluate_trajectory(offset_ns, points, time, command_values[k])
        scale_speed(command_values[k], rate, change)


@kernel(borrows=True)
def evaluate_trajectory(
    offset_ns: IntArray, points: JointMotion, time_ns: int, state: FloatArray
) -> None:
    """Evaluate a trajectory at full speed by quintic polynomials between its points.

    Before the stamp, the state is that of the first point. After the last point, or with a single
    point, the joints rest at that point.

    Args:
        offset_ns: Times of the trajectory's points after its stamp, int64[k], [ns].
        points: Motion of the joints at these points.
        time_ns: Time after the stamp [ns].
        state: Position, velocity and acceleration, float64[3, n]. Written in place.
    """
    position, velocity, acceleration = points
    last = len(offset_ns) - 1
    if time_ns > offset_ns[last] or last == 0:
        for j in range(position.shape[1]):
            state[0, j], state[1, j], state[2, j] = position[last, j], 0.0, 0.0
        return
    time_ns = max(time_ns, 0)
    i = min(int(np.searchsorted(offset_ns, time_ns, "right")) - 1, last - 1)
    h = (offset_ns[i + 1] - offset_ns[i]) / SECOND_NS
    s = (time_ns - offset_ns[i]) / SECOND_NS
    for j in range(position.shape[1]):
        start = (position[i, j], velocity[i, j], acceleration[i, j])
        end = (position[i + 1, j], velocity[i + 1, j], acceleration[i + 1, j])
        state[0, j], state[1, j], state[2, j] = quintic_hermite(s, h, start, end)


@kernel(borrows=True)
def scale_speed(state: FloatArray, rate: float, change: float) -> None:
    """Scale a trajectory's velocity by the rate s of the speed scaling, its acceleration by s².

    `change` times the velocity at full speed is added to the acceleration.

    Args:
        state: Position, velocity and acceleration, float64[3, n]. Velocity and acceleration are
            written in place.
        rate: Rate s.
        change: Rate of change ds/dt [1/s].
    """
    if rate == 1.0 and change == 0.0:
        return
    for j in range(state.shape[1]):
        slowing = change * state[1, j]
        state[1, j] *= rate
        state[2, j] = rate * rate * state[2, j] + slowing
