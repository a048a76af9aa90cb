"""A motion as a table over time, and its modes in words."""

from collections.abc import Iterator
from itertools import chain

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_planner.motion.motion_profile import compute_motion_profile
from mhsb_planner.motion.planned_pressures import compute_planned_supply

MODE_MEANINGS = {
    Mode.N: "main pump alone",
    Mode.DB: "boosted by the actuator's own servo pump",
    Mode.SB: "boosted by servo pumps that share a rail",
}
"""Meaning of each mode in words."""


def format_switches(count: int) -> str:
    """Format a number of mode switches, such as `1 mode switch`."""
    return f"{count} mode switch{'es' if count != 1 else ''}"


def format_mode_intervals(schedule: ModeSchedule, duration: float, actuator: int) -> str:
    """Format the modes of one actuator over a motion as text.

    Args:
        schedule: Mode schedule of the motion. Its times count from the start of the motion.
        duration: Duration of the motion [s].
        actuator: Index of the actuator, from 0.

    Returns:
        Each mode (a name of `Mode`) with the time at which it ends, such as `N until 0.52 s, DB
        until the end`. `N throughout` if the mode does not change. Switches at or after
        `duration` are not listed.
    """
    codes, times = schedule.modes[:, actuator], schedule.offset_ns / SECOND_NS
    begins = np.flatnonzero(np.diff(codes.astype(int), prepend=-1))
    begins = begins[(times[begins] < duration) | (begins == 0)]
    first, *others = (Mode(codes[row]).name for row in begins)
    if not others:
        return f"{first} throughout"
    until = [
        f" until {times[row]:.2f} s, {name}" for row, name in zip(begins[1:], others, strict=True)
    ]
    return f"{first}{''.join(until)} until the end"


def list_columns(machine: Machine) -> list[str]:
    """Return the column titles, with units, of the table whose rows `iterate_rows` yields."""
    joints = list(zip(machine.joint_names, machine.joint_units, strict=True))
    return [
        "time [s]",
        *(
            f"{joint} {quantity} [{unit}{per}]"
            for quantity, per in (("position", ""), ("velocity", "/s"), ("acceleration", "/s^2"))
            for joint, unit in joints
        ),
        *(f"{name} mode" for name in machine.actuator_names),
        *(f"{name} supply pressure [Pa]" for name in machine.actuator_names),
        *(f"tip {axis} [m]" for axis in ("xyz" if machine.slews else "xz")),
    ]


def iterate_rows(
    machine: Machine, trajectory: Trajectory, schedule: ModeSchedule
) -> Iterator[list[float | str]]:
    """Iterate over the points of a trajectory as rows of a table.

    Args:
        machine: The machine.
        trajectory: Joint trajectory.
        schedule: Modes over time.

    Yields:
        One row for each point: time since the first point [s]; positions, then velocities, then
        accelerations of all joints [rad or m, per s and s²]; mode of each actuator as N, DB or SB;
        planned pressure in each actuator's supply line [Pa]; tip in `base_link` [m].
    """
    modes = schedule.modes_at_many(trajectory.stamp_ns + trajectory.offset_ns)
    profile = compute_motion_profile(machine, trajectory.position, trajectory.velocity)
    supply = compute_planned_supply(machine, profile.force, profile.speed, modes)
    tip = machine.tip_in_base(trajectory.position)
    for k, offset_ns in enumerate(trajectory.offset_ns):
        yield [
            float(offset_ns / SECOND_NS),
            *chain.from_iterable(values[k].tolist() for values in trajectory.points),
            *(Mode(code).name for code in modes[k]),
            *supply[k].tolist(),
            *tip[k].tolist(),
        ]
