"""One page about one move: path, joints, modes, operating regions, pressures, energy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mhsb_model.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    MODE_COLOR,
    PATH_COLOR,
    PURPLE,
    draw_line,
    rgb,
    written_figure,
)
from mhsb_model.hydraulics import oil_of
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode, strongest
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.evaluation.energy_flow import draw_energy_flow
from mhsb_planner.evaluation.move import Move
from mhsb_planner.evaluation.workspace_drawing import (
    BORDER,
    draw_arm,
    draw_obstacles,
    draw_workspace_axes,
)
from mhsb_planner.motion.s3_limits import speed_limit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

JOINT_COLORS = (BLACK, GREEN, PURPLE, GREY)
"""None of those that stand for modes."""

LEFT, COLUMN, HEIGHT = 5.0, 3.1, 10.4  # in
PER_MM, PER_CM, PER_KN, PER_MPA = 1e3, 1e2, 1e-3, 1e-6
FORCES = 161
MARGIN = 0.15
"""Of force and speed beyond what the move took, as a share of it."""


def draw_move_page(move: Move, file: Path) -> None:
    """Write the page as PNG."""
    n = move.machine.joint_count
    with written_figure(file, HEIGHT, LEFT + COLUMN * n) as figure:
        figure.suptitle(move.title, fontweight="bold")
        left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(LEFT, COLUMN * n))[0]
        path, flow = left.subplots(2, 1, height_ratios=(2.3, 1.0))
        _draw_path(move, path)
        flow.set_title(f"energy, by {move.counted}")
        draw_energy_flow(move.energy, flow)
        parts = right.subfigures(3, 1, squeeze=False, height_ratios=(1.25, 1.0, 1.0))
        top, regions, pressures = parts[:, 0]
        joints, modes = top.subplots(2, 1, sharex=True, height_ratios=(2.6, 1.0))
        _draw_joints(move, joints)
        _draw_modes(move, modes)
        _draw_regions(move, regions.subplots(1, n, squeeze=False)[0])
        _draw_pressures(move, pressures.subplots(1, n, squeeze=False, sharey=True)[0])


# --- Path, joints, modes -------------------------------------------------------------------------


def _draw_path(move: Move, axes: Axes) -> None:
    from matplotlib.patheffects import Normal, Stroke

    draw_workspace_axes(move.machine, axes)
    draw_obstacles(move.machine, axes, move.position)
    for row, style, label in ((0, "--", "arm at the start"), (-1, "-", "arm at the end")):
        draw_arm(move.machine, move.position[row], axes, linestyle=style, label=label)
    _show_all_of_the_arm(move, axes)
    tip = move.tip
    for begin, end, mode in spans(strongest(move.modes)):
        axes.plot(*tip[begin : end + 1].T, color=PATH_COLOR[mode], linewidth=2.6)
    for mode in Mode:
        who = "all actuators" if mode is Mode.N else "an actuator"
        axes.plot([], [], color=PATH_COLOR[mode], linewidth=2.6, label=f"tip, {who} in {mode.name}")
    several = len(move.goals) > 1
    for number, (place, who) in enumerate(_places(move.goals_in_plane), start=1):
        axes.plot(
            *place, marker="o", markersize=9, markerfacecolor="white", markeredgecolor=BLACK,
            linestyle="none", label="goal" if number == 1 else None, zorder=4,
        )  # fmt: skip
        if several:
            axes.annotate(
                who, place, (7, 7), textcoords="offset points", fontsize=10, fontweight="bold",
                path_effects=[Stroke(linewidth=3.0, foreground="white"), Normal()], zorder=5,
            )  # fmt: skip
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.09), fontsize=8, ncols=2)


def _show_all_of_the_arm(move: Move, axes: Axes) -> None:
    """Widen the axes where a joint lies beyond the workspace at either end."""
    ends = [move.machine.joint_positions(move.position[k]) for k in (0, -1)]
    low, high = np.vstack(ends).min(axis=0) - BORDER, np.vstack(ends).max(axis=0) + BORDER
    for limits, put, least, most in (
        (axes.get_xlim(), axes.set_xlim, low[0], high[0]),
        (axes.get_ylim(), axes.set_ylim, low[1], high[1]),
    ):
        put(min(limits[0], least), max(limits[1], most))


def _places(goals: Sequence[tuple[float, float]]) -> list[tuple[tuple[float, float], str]]:
    """Each place of goals once, with the numbers that they have in their order."""
    numbers: dict[tuple[float, float], list[str]] = {}
    for number, place in enumerate(goals, start=1):
        numbers.setdefault(place, []).append(str(number))
    return [(place, ", ".join(who)) for place, who in numbers.items()]


def _draw_joints(move: Move, axes: Axes) -> None:
    shown = np.where(move.machine.arrays.slides, PER_CM, np.degrees(1.0))
    for j in range(move.machine.joint_count):
        color = JOINT_COLORS[j % len(JOINT_COLORS)]
        label = f"joint {j + 1}"
        draw_line(axes, move.time, shown[j] * move.position[:, j], color=color, label=label)
        if move.reference is not None:
            wanted = shown[j] * move.reference[:, j]
            draw_line(axes, move.time, wanted, color=color, linewidth=2.6, alpha=0.25)
    telescope = ", extension [cm]" if move.machine.has_telescope else ""
    axes.set_ylabel(f"joint angle [°]{telescope}")
    pale = "" if move.reference is None else "; pale: reference"
    axes.set_title(f"joints{pale}")
    axes.legend(loc="upper right", ncols=move.machine.joint_count, fontsize=8)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.18 * (high - low))  # room for the legend


def _draw_modes(move: Move, axes: Axes) -> None:
    draw_mode_bars(move, axes)
    axes.set_xlim(move.time[0], move.time[-1])
    axes.set_xlabel("time [s]")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, title="mode")


def draw_mode_bars(move: Move, axes: Axes) -> None:
    """A bar for each actuator in the colours of its modes over time, which have their labels."""
    n = move.machine.joint_count
    for j in range(n):
        for begin, end, mode in spans(move.modes[:, j]):
            since, until = move.time[begin], move.time[end]
            axes.broken_barh([(since, until - since)], (j - 0.4, 0.8), color=MODE_COLOR[mode])
    for mode in Mode:
        axes.broken_barh([], (0, 0), color=MODE_COLOR[mode], label=mode.name)
    axes.set_yticks(range(n), [f"actuator {j + 1}" for j in range(n)])
    axes.set_ylim(n - 0.4, -0.6)
    axes.grid(visible=False)


def spans(mode: ModeArray) -> Iterator[tuple[int, int, Mode]]:
    """First row, first row of the next one, and mode of each stretch of uint8[k]."""
    edges = [0, *(np.flatnonzero(np.diff(mode.astype(int))) + 1).tolist(), len(mode) - 1]
    for begin, end in pairwise(edges):
        if end > begin:
            yield begin, end, Mode(int(mode[begin]))


# --- Operating regions ---------------------------------------------------------------------------


def mode_limits(
    machine: Machine, actuator: int, mode: Mode, forces: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest piston speed [m/s] in a mode, by cylinder force float64[k] N.

    What valve, pressure and servo pumps allow (`s3_limits.speed_limit`); that the main pump's flow
    is shared among all actuators comes on top.
    """
    m, oil = machine.arrays, oil_of(machine.arrays)
    own = tuple(
        float(each[actuator]) for each in (m.valve_coefficient, m.cap_area, m.rod_area)
    )
    modules = int(m.modules_per_mode[mode])
    lowest, highest = (
        np.array([side * speed_limit(oil, *own, float(f), side, modules) for f in forces])
        for side in (-1.0, 1.0)
    )
    return lowest, highest


def _draw_regions(move: Move, panels: np.ndarray) -> None:
    for j, axes in enumerate(panels):
        low, high = _widened(move.force[:, j], 400.0)
        forces = np.linspace(min(low, 0.0), max(high, 0.0), FORCES)
        for mode in (Mode.N, Mode.SB, Mode.DB):  # the narrower one above
            slow, fast = (PER_MM * each for each in mode_limits(move.machine, j, mode, forces))
            axes.fill_betweenx(PER_KN * forces, slow, fast, color=_pale(mode), linewidth=0)
            for limit in (slow, fast):
                axes.plot(limit, PER_KN * forces, color=PATH_COLOR[mode], linewidth=0.8)
        for begin, end, mode in spans(move.modes[:, j]):
            rows = slice(begin, end + 1)
            axes.plot(
                PER_MM * move.speed[rows, j],
                PER_KN * move.force[rows, j],
                color=PATH_COLOR[mode],
                linewidth=2.0,
            )
        seen = (1.0 + MARGIN) * float(np.abs(move.speed[:, j]).max())
        fastest = PER_MM * max(2.0 * float(move.machine.arrays.max_piston_speed[j]), seen)
        axes.set_xlim(-fastest, fastest)
        axes.set_ylim(PER_KN * forces[0], PER_KN * forces[-1])
        axes.axvline(0.0, color=GREY, linewidth=0.6)
        axes.set_xlabel("piston speed [mm/s]")
        axes.set_title(f"actuator {j + 1}: operating region")
    panels[0].set_ylabel("cylinder force [kN]")


def _pale(mode: Mode) -> tuple[float, ...]:
    """A mode's colour on a surface, on which its lines can be seen."""
    return tuple(0.5 + 0.5 * each for each in rgb(MODE_COLOR[mode]))


def _widened(values: FloatArray, least: float) -> tuple[float, float]:
    """Range of values with a margin of a share, or of `least`."""
    low, high = float(values.min()), float(values.max())
    room = max(MARGIN * (high - low), least)
    return low - room, high + room


# --- Pressures -----------------------------------------------------------------------------------


def _draw_pressures(move: Move, panels: np.ndarray) -> None:
    for j, axes in enumerate(panels):
        for begin, end, mode in spans(move.modes[:, j]):
            if mode is not Mode.N:
                axes.axvspan(move.time[begin], move.time[end], color=_pale(mode), linewidth=0)
        supply = PER_MPA * move.supply[:, j]
        draw_line(axes, move.time, supply, color=BLACK, label="supply line", linewidth=1.4)
        colors = iter((BLUE, GREEN, PURPLE))
        for (name, pressure), color in zip(move.chambers.items(), colors, strict=False):
            draw_line(axes, move.time, PER_MPA * pressure[:, j], color=color, label=name)
        normal = PER_MPA * move.machine.arrays.supply_pressure
        axes.axhline(normal, color=GREY, linestyle="--", linewidth=0.9, label="main pump, $P_S$")
        axes.set_xlim(move.time[0], move.time[-1])
        axes.set_xlabel("time [s]")
        axes.set_title(f"actuator {j + 1}: pressures")
    panels[0].set_ylabel("pressure [MPa]")
    top = max(1.3 * PER_MPA * move.machine.arrays.supply_pressure, panels[0].get_ylim()[1])
    panels[0].set_ylim(min(0.0, panels[0].get_ylim()[0]), 1.25 * top)
    panels[0].legend(loc="upper left", fontsize=7.5, ncols=2)
