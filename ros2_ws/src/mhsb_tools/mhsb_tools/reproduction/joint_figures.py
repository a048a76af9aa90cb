"""Figures 6 and 8: joint angles and modes over time, and speed over force of joint 1's cylinder."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mhsb_model import hydraulics
from mhsb_model.figure_style import (
    GREY,
    JOINT_COLORS,
    PATH_COLOR,
    SKY,
    VERMILION,
    Axes,
    legend_above,
    open_figure,
)
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray
from mhsb_planner.result_files import write_rows
from mhsb_tools.moves.move_page import PER_KN, PER_MM, draw_labelled_mode_bars
from mhsb_tools.reproduction.fits import FittedRun, FittedRuns
from mhsb_tools.reproduction.runs import Runs

FIGURE_WIDTH, ROW_HEIGHT = 10.0, 3.6  # in
FORCE_POINTS = 400
"""Number of forces at which valve limits are drawn."""


def draw_joints(
    runs: Runs,
    fits: FittedRuns,
    names: Sequence[str],
    place: Path,
    *,
    load_lines: bool,
) -> None:
    """Draw joint angles and modes of some runs over time, and write the data.

    There is a column for each run. The upper panel has the joint angles [°], the next one a band of
    modes for each actuator. A run without a trajectory has empty panels. Writes a PNG, and a CSV
    file with the sampled trajectories.

    Args:
        runs: All runs of the machine.
        fits: Trajectories that were made for some of the runs.
        names: Names of the runs to draw.
        place: Path of the files without suffix; its folder must exist.
        load_lines: Whether a third row of panels shows piston speed [mm/s] over force [kN] of joint
            1's cylinder.
    """
    rows = 3 if load_lines else 2
    heights = [ROW_HEIGHT, 1.0, ROW_HEIGHT][:rows]
    with open_figure(place.with_suffix(".png"), sum(heights), FIGURE_WIDTH) as figure:
        panels = figure.subplots(
            rows, len(names), squeeze=False, gridspec_kw={"height_ratios": heights}
        )
        for column, name in enumerate(names):
            if name not in fits.by_run:
                continue
            fit = fits.by_run[name]
            angles, modes = panels[0, column], panels[1, column]
            _draw_angles(runs, name, fit, angles)
            _draw_modes(fit, modes)
            modes.sharex(angles)
            if load_lines:
                _draw_load_line(runs[name].machine, fit, 0, panels[2, column])
        legend_above(figure, *panels.ravel())
    header = ("case", "time_s", *_columns(runs.machine))
    write_rows(place.with_suffix(".csv"), header, _rows(fits, names))


def _draw_angles(runs: Runs, name: str, fit: FittedRun, axes: Axes) -> None:
    """Draw the joint angles [°] of a trajectory and of its discrete path over time [s].

    The times of the discrete path are scaled so that it ends together with the trajectory.

    Args:
        runs: All runs of the machine.
        name: Name of the run.
        fit: Trajectory of the run.
        axes: Axes to draw on.
    """
    path = runs[name].path
    for joint, color in zip(range(fit.position.shape[1]), JOINT_COLORS, strict=False):
        label = f"joint {joint + 1}"
        axes.plot(fit.time, np.degrees(fit.position[:, joint]), color=color, label=label)
        if path is not None:
            due = path.time * (fit.duration / path.time[-1])
            axes.plot(
                due,
                np.degrees(path.posture[:, joint]),
                color=VERMILION,
                linewidth=0.8,
                marker=".",
                markersize=3,
                label="discrete path (S2), over the trajectory's duration",
            )
    axes.set(title=f"Case {name}", ylabel="joint angle [°]")
    axes.tick_params(labelbottom=False)


def _draw_modes(fit: FittedRun, axes: Axes) -> None:
    """Draw a horizontal band over time [s] for each actuator, coloured by its mode.

    Args:
        fit: The sampled trajectory.
        axes: Axes to draw on. The ticks of the y axis name the actuators, the first one at the top.
            The label of the x axis is set, and the grid is switched off.
    """
    labels = {mode: f"mode {mode.name}" for mode in Mode if np.any(fit.modes == mode)}
    draw_labelled_mode_bars(fit.time, fit.modes, labels, axes)
    axes.set_yticks(range(fit.modes.shape[1]), [f"J{j + 1}" for j in range(fit.modes.shape[1])])
    axes.set_xlabel("time [s]")


def _draw_load_line(machine: Machine, fit: FittedRun, joint: int, axes: Axes) -> None:
    """Draw piston speed [mm/s] over force [kN] of one cylinder.

    The motion is drawn as points in the colours of the actuator's modes.

    Solid lines show the speeds with a fully open valve at the main pump's pressure P_S and at the
    highest boost pressure. Dashed lines show V_max, the piston speed for planning, in both
    directions.

    Args:
        machine: The arm.
        fit: The sampled trajectory.
        joint: Index of the joint, from 0.
        axes: Axes to draw on. Labels and the limits of y are set.
    """
    force, speed = fit.profile.force[:, joint], fit.profile.speed[:, joint]
    mode = fit.modes[:, joint]
    for each in Mode:
        chosen = mode == each
        axes.plot(
            PER_KN * force[chosen],
            PER_MM * speed[chosen],
            linestyle="none",
            marker=".",
            markersize=3,
            color=PATH_COLOR[each],
            label=f"joint {joint + 1} in {each.name}",
        )
    span = max(1.0, float(np.ptp(force)))
    forces = np.linspace(force.min() - 0.3 * span, force.max() + 0.3 * span, FORCE_POINTS)
    for supply, color, label in (
        (machine.arrays.supply_pressure, GREY, "valve at P_S"),
        (machine.arrays.max_boost_pressure, SKY, "valve at the highest boost pressure"),
    ):
        out, back = _valve_limits(machine, joint, supply, forces)
        axes.plot(PER_KN * forces, PER_MM * out, color=color, label=label)
        axes.plot(PER_KN * forces, PER_MM * back, color=color)
    fastest = PER_MM * float(machine.arrays.max_piston_speed[joint])
    for limit in (fastest, -fastest):
        axes.axhline(limit, color=GREY, linestyle="--", linewidth=0.9, label="V_max of the search")
    axes.set(
        ylim=(-2.2 * fastest, 2.2 * fastest),
        xlabel=f"cylinder force of joint {joint + 1} [kN]",
        ylabel="piston speed [mm/s]",
    )


def _valve_limits(
    machine: Machine, joint: int, supply: float, forces: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the piston speeds with the valve fully open, in both directions.

    Only the valve limits the speed; the flow of the pumps is taken as sufficient.

    Args:
        machine: The arm.
        joint: Index of the joint, from 0.
        supply: Supply pressure at the valve, in any mode [Pa].
        forces: Piston forces, positive if they resist extension [N], shape (k,).

    Returns:
        Speed of extension (positive), and speed of retraction (negative) [m/s], each of shape (k,).
    """
    m = machine.arrays
    k, cap, rod = m.valve_coefficient[joint], m.cap_area[joint], m.rod_area[joint]
    tank = m.tank_pressure
    out = [hydraulics.compute_extension_speed(k, cap, rod, supply, tank, f) for f in forces]
    back = [-hydraulics.compute_retraction_speed(k, cap, rod, supply, tank, f) for f in forces]
    return np.array(out), np.array(back)


def _columns(machine: Machine) -> list[str]:
    """Return the names of a CSV row's values after case and time, in the order of `_rows`."""
    return [
        *(f"{joint}_rad" for joint in machine.joint_names),
        *(f"{actuator}_mode" for actuator in machine.actuator_names),
        *(f"{actuator}_speed_m_s" for actuator in machine.actuator_names),
        *(f"{actuator}_force_n" for actuator in machine.actuator_names),
    ]


def _rows(fits: FittedRuns, names: Sequence[str]) -> Iterator[tuple[Any, ...]]:
    """Yield the CSV rows of the trajectories.

    Args:
        fits: Trajectories that were made for some of the runs.
        names: Names of the runs; those without a trajectory are skipped.

    Yields:
        A row for each sample of each trajectory: name of the run, time [s], joint positions [rad],
        modes, piston speeds [m/s] and forces [N].
    """
    for name in names:
        if name in fits.by_run:
            fit = fits.by_run[name]
            for k, time in enumerate(fit.time):
                yield (
                    name,
                    time,
                    *fit.position[k],
                    *fit.modes[k],
                    *fit.profile.speed[k],
                    *fit.profile.force[k],
                )
