"""Page about one move: path, joints, modes, operating regions, pressures, energy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mhsb_model.figure_style import (
    BLACK,
    BROWN,
    GREEN,
    GREY,
    JOINT_COLORS,
    MODE_COLOR,
    PALE,
    PATH_COLOR,
    PURPLE,
    TEAL,
    YELLOW,
    Axes,
    Figure,
    draw_line,
    open_figure,
    rgb,
)
from mhsb_model.goal import format_position
from mhsb_model.hydraulics import get_shared_hydraulics
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED_MODES, Mode
from mhsb_model.types import FloatArray, ModeArray
from mhsb_planner.motion.limits.usage import compute_speed_limit
from mhsb_tools.moves.move import MoveRecord, move_of_plan
from mhsb_tools.moves.workspace_drawing import (
    draw_arm_at_ends,
    draw_obstacles,
    draw_workspace_axes,
    widen_axes_to_arm,
)

if TYPE_CHECKING:
    from mhsb_planner.plan import Plan

LEFT_WIDTH, COLUMN_WIDTH, PAGE_HEIGHT = 5.0, 3.1, 10.4
"""Width of the left part, width of each actuator's column, and height of the page [in]."""
PER_MM, PER_CM, PER_KN, PER_MPA = 1e3, 1e2, 1e-3, 1e-6
FORCE_SAMPLES = 161
"""Number of forces at which the limits of a region are computed."""
RANGE_MARGIN = 0.15
"""Share by which the axes of force and speed exceed the values of the move."""

PATH_WIDTH = {Mode.N: 2.2, Mode.DB: 2.0, Mode.SB: 5.0}
"""Width of the tip's path for each mode [points]. DB is drawn on SB, so SB is the wider one."""


def draw_move_page(move: MoveRecord, file: Path | None) -> Figure:
    """Draw one page about a move.

    The title ends with the duration, and with the part of it at rest. On the left are the tip's
    path and the energy flow. On the right are joint positions and modes over time. Below them, each
    actuator has its operating region (possible speeds and forces) and its pressures over time.

    Args:
        move: The move.
        file: File to write, such as `move.png`; its suffix chooses the format. If drawing fails, no
            incomplete file is left. None writes no file.

    Returns:
        The page as a matplotlib figure, which is not registered with pyplot.

    Raises:
        FigureFormatError: matplotlib has no format of this suffix.
    """
    n = move.machine.joint_count
    with open_figure(file, PAGE_HEIGHT, LEFT_WIDTH + COLUMN_WIDTH * n) as figure:
        figure.suptitle(move.heading, fontweight="bold")
        left, right = figure.subfigures(
            1, 2, squeeze=False, width_ratios=(LEFT_WIDTH, COLUMN_WIDTH * n)
        )[0]
        path, flow = left.subplots(2, 1, height_ratios=(2.3, 1.0))
        _draw_path(move, path)
        flow.set_title(move.energy_title, fontsize=9)
        draw_energy_flow(move.energy, flow)
        parts = right.subfigures(3, 1, squeeze=False, height_ratios=(1.25, 1.0, 1.0))
        top, regions, pressures = parts[:, 0]
        joints, modes = top.subplots(2, 1, sharex=True, height_ratios=(2.6, 1.0))
        _draw_joints(move, joints)
        _draw_modes(move, modes)
        _draw_regions(move, regions.subplots(1, n, squeeze=False)[0])
        _draw_pressures(move, pressures.subplots(1, n, squeeze=False, sharey=True)[0])
    return figure


def plot_plan(plan: Plan, file: str | Path | None = None, title: str = "") -> Figure:
    """Draw one page about a planned motion.

    Args:
        plan: The plan.
        file: File to write, such as `move.png` or `move.pdf`; its suffix chooses the format. If
            drawing fails, no incomplete file is left. None writes no file.
        title: Title of the page; empty for a title with start, goal and payload.

    Returns:
        The page as a matplotlib figure, which is not registered with pyplot. A notebook shows it if
        it is the last value of a cell.

    Raises:
        FigureFormatError: matplotlib has no format of this suffix.
    """
    ends = plan.machine.tip_in_base(plan.motion.trajectory.position[[0, -1]]).tolist()
    start, goal = (format_position(tip, ".2f") for tip in ends)
    title = title or f"{start} to {goal}, payload {plan.machine.arrays.payload:g} kg"
    move = move_of_plan(plan.machine, plan, tuple(ends[-1]), title)
    return draw_move_page(move, Path(file) if file else None)


# --- Path, joints, modes -------------------------------------------------------------------------


def _draw_path(move: MoveRecord, axes: Axes) -> None:
    """Draw the tip's path in the arm's plane, with workspace, obstacles, arm and goals.

    The path has the colours of all boosted modes in force. The arm is drawn at the start and at the
    end. Goals have numbers if there are several. The axes get a legend and are widened if the arm
    does not fit in.

    Args:
        move: The move.
        axes: Axes to draw on.
    """
    from matplotlib.patheffects import Normal, Stroke

    draw_workspace_axes(move.machine, axes)
    draw_obstacles(move.machine, axes, move.position)
    draw_arm_at_ends(move.machine, move.position, axes)
    widen_axes_to_arm(move.machine, move.position[[0, -1]], axes)
    draw_tip_path(move.tip, move.modes, axes)
    several = len(move.goals) > 1
    goals = [tuple(move.machine.project_to_plane(goal).tolist()) for goal in move.goals]
    for number, (place, who) in enumerate(_places(goals), start=1):
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


def draw_tip_path(tip: FloatArray, modes: ModeArray, axes: Axes, what: str = "tip") -> None:
    """Draw the tip's path in the colours of all boosted modes in force, with labels for a legend.

    Args:
        tip: Positions (x, z), shape (k, 2) [m].
        modes: Modes of n actuators at these positions, shape (k, n).
        axes: Axes to draw on.
        what: First word of the labels.
    """
    for begin, end, mode in yield_path_spans(modes):
        axes.plot(*tip[begin : end + 1].T, color=PATH_COLOR[mode], linewidth=PATH_WIDTH[mode])
    for mode in Mode:
        who = "an actuator" if BOOSTED_MODES[mode] else "all actuators"
        label = f"{what}, {who} in {mode.name}"
        axes.plot([], [], color=PATH_COLOR[mode], linewidth=PATH_WIDTH[mode], label=label)


def yield_path_spans(modes: ModeArray) -> Iterator[tuple[int, int, Mode]]:
    """Yield the stretches of a path to draw in the colour of each mode, in the order of drawing.

    A boosted mode has the stretches in which at least one actuator has it. Stretches of DB and SB
    overlap where actuators differ. N has the stretches in which all actuators have it.

    Args:
        modes: Modes of n actuators at k instants, shape (k, n).

    Yields:
        First row, end and mode of each stretch, as `yield_mode_spans`. N comes first and DB last.
    """
    normal = np.all(modes == Mode.N, axis=1)
    for mode, shown in (
        (Mode.N, normal),
        (Mode.SB, np.any(modes == Mode.SB, axis=1)),
        (Mode.DB, np.any(modes == Mode.DB, axis=1)),
    ):
        other = Mode.DB if mode is Mode.N else Mode.N
        spans = yield_mode_spans(np.where(shown, mode, other))
        yield from (span for span in spans if span[-1] is mode)


def _places(goals: Sequence[tuple[float, float]]) -> list[tuple[tuple[float, float], str]]:
    """Group goals by their position.

    Args:
        goals: Goal positions (x, z) [m] in order.

    Returns:
        Each different position once, in the order of first occurrence, with the numbers of its
        goals (from 1) as text such as `1, 3`.
    """
    numbers: dict[tuple[float, float], list[str]] = {}
    for number, place in enumerate(goals, start=1):
        numbers.setdefault(place, []).append(str(number))
    return [(place, ", ".join(who)) for place, who in numbers.items()]


def _draw_joints(move: MoveRecord, axes: Axes) -> None:
    """Draw the joint positions over time, and the reference as a pale line if the move has one.

    Angles are in degrees, extensions of telescopes in cm.

    Args:
        move: The move.
        axes: Axes to draw on. Labels, title, legend and the limits of y are set.
    """
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


def _draw_modes(move: MoveRecord, axes: Axes) -> None:
    """Draw the mode of each actuator over time, with a legend beside the axes.

    Args:
        move: The move.
        axes: Axes to draw on.
    """
    draw_mode_bars(move, axes)
    axes.set(xlim=(move.time[0], move.time[-1]), xlabel="time [s]")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, title="mode")


def draw_mode_bars(move: MoveRecord, axes: Axes) -> None:
    """Draw a bar for each actuator over time, in the colours of its modes.

    No legend is drawn here. All modes of the machine are labelled, so that the caller can add a
    complete legend.

    Args:
        move: The move.
        axes: Axes to draw on, with time [s] as x. Ticks and limits of y are replaced.
    """
    labels = {mode: mode.name for mode in list_available_modes(move.machine)}
    draw_labelled_mode_bars(move.time, move.modes, labels, axes)


def draw_labelled_mode_bars(
    time: FloatArray, modes: ModeArray, labels: Mapping[Mode, str], axes: Axes
) -> None:
    """Draw a bar for each of n actuators over time, the first one on top, coloured by its mode.

    Args:
        time: Instants, increasing, shape (k,) [s].
        modes: Modes from each instant on, shape (k, n); the last row is not drawn.
        labels: Text for a legend of each mode that is to have one.
        axes: Axes to draw on, with time [s] as x. Ticks and limits of y are replaced.
    """
    count = modes.shape[1]
    for j in range(count):
        for begin, end, mode in yield_mode_spans(modes[:, j]):
            span = time[begin], time[end] - time[begin]
            axes.broken_barh([span], (j - 0.4, 0.8), color=MODE_COLOR[mode])
    for mode, label in labels.items():
        axes.broken_barh([], (0, 0), color=MODE_COLOR[mode], label=label)
    axes.set_yticks(range(count), [f"actuator {j + 1}" for j in range(count)])
    axes.set_ylim(count - 0.4, -0.6)
    axes.grid(visible=False)


def list_available_modes(machine: Machine) -> list[Mode]:
    """Return the modes for which the machine has booster modules enough, in the order of `Mode`."""
    return [mode for mode in Mode if mode in machine.patterns]


def yield_mode_spans(mode: ModeArray) -> Iterator[tuple[int, int, Mode]]:
    """Yield the stretches of rows in which a mode stays the same, in order.

    Args:
        mode: Mode at each of k instants, such as that of one actuator, shape (k,), uint8.

    Yields:
        For each stretch its first row, its end and its mode. The end is the first row of the next
        stretch, so that lines drawn up to it have no gaps. For the last stretch, the end is the
        last row k − 1. A last stretch of one row only is not yielded.
    """
    edges = [0, *(np.flatnonzero(np.diff(mode.astype(int))) + 1).tolist(), len(mode) - 1]
    for begin, end in pairwise(edges):
        if end > begin:
            yield begin, end, Mode(int(mode[begin]))


# --- Operating regions ---------------------------------------------------------------------------


def compute_mode_limits(
    machine: Machine, actuator: int, mode: Mode, forces: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the range of piston speeds that a mode allows at given piston forces.

    The valve, the supply pressure and the flow of the servo pumps limit the speed. The flow of the
    main pump, which all actuators share, is not considered.

    Args:
        machine: The arm.
        actuator: Index of the actuator, from 0.
        mode: Mode of the actuator.
        forces: Piston forces, positive if the load resists extension [N], shape (k,).

    Returns:
        Lowest speed (negative, retracting) and highest speed (positive, extending) [m/s], each of
        shape (k,).
    """
    m, oil = machine.arrays, get_shared_hydraulics(machine.arrays)
    own = tuple(float(each[actuator]) for each in (m.valve_coefficient, m.cap_area, m.rod_area))
    modules = int(m.modules_per_mode[mode])
    lowest, highest = (
        np.array([side * compute_speed_limit(oil, *own, float(f), side, modules) for f in forces])
        for side in (-1.0, 1.0)
    )
    return lowest, highest


def _draw_regions(move: MoveRecord, panels: np.ndarray) -> None:
    """Draw for each actuator the mode that each speed and force needs, and the move itself.

    The areas have the colour of the weakest mode (N < DB < SB) that allows a piston speed at a
    force; white is impossible. The move is a line that has the colours of its modes. The axis of
    forces shows 0 and all forces of the move, with a margin of at least 400 N. The axis of speeds
    shows twice V_max, or more if the move is faster. The figure gets a legend below the panels,
    with a column for each mode.

    Args:
        move: The move.
        panels: Axes, one for each actuator: piston speed [mm/s] as x, piston force [kN] as y.
            Limits and titles are set.
    """
    modes = list_available_modes(move.machine)
    for j, axes in enumerate(panels):
        low, high = _range_with_margin(move.force[:, j], 400.0)
        forces = np.linspace(min(low, 0.0), max(high, 0.0), FORCE_SAMPLES)
        for layer, mode in enumerate(reversed(modes)):  # weaker modes cover stronger ones
            slow, fast = (
                PER_MM * each for each in compute_mode_limits(move.machine, j, mode, forces)
            )
            axes.fill_betweenx(
                PER_KN * forces, slow, fast, color=_pale(mode), linewidth=0, zorder=1 + layer / 10
            )
        for begin, end, mode in yield_mode_spans(move.modes[:, j]):
            rows = slice(begin, end + 1)
            axes.plot(
                PER_MM * move.speed[rows, j],
                PER_KN * move.force[rows, j],
                color=PATH_COLOR[mode],
                linewidth=2.0,
            )
        seen = (1.0 + RANGE_MARGIN) * float(np.abs(move.speed[:, j]).max())
        fastest = PER_MM * max(2.0 * float(move.machine.arrays.max_piston_speed[j]), seen)
        axes.set(xlim=(-fastest, fastest), ylim=(PER_KN * forces[0], PER_KN * forces[-1]))
        axes.axvline(0.0, color=GREY, linewidth=0.6)
        axes.set(xlabel="piston speed [mm/s]", title=f"actuator {j + 1}: operating region")
    panels[0].set_ylabel("cylinder force [kN]")
    for mode in modes:
        panels[0].fill_betweenx([], [], [], color=_pale(mode), label=f"{mode.name} is enough")
        label = f"the move, in {mode.name}"
        panels[0].plot([], [], color=PATH_COLOR[mode], linewidth=2.0, label=label)
    figure = panels[0].get_figure(root=False)
    entries = panels[0].get_legend_handles_labels()
    figure.legend(*entries, loc="outside lower center", ncols=len(modes))


def _pale(mode: Mode) -> tuple[float, ...]:
    """Return a mode's colour lightened for a surface on which lines of the mode stay visible."""
    return tuple(0.5 + 0.5 * each for each in rgb(MODE_COLOR[mode]))


def _range_with_margin(values: FloatArray, least: float) -> tuple[float, float]:
    """Return the range of values with a margin at both ends.

    The margin is 15 % of the difference between largest and smallest value, but not less than
    `least`.

    Args:
        values: At least one value.
        least: Smallest margin, in the unit of the values.

    Returns:
        Lower and upper end.
    """
    low, high = float(values.min()), float(values.max())
    room = max(RANGE_MARGIN * (high - low), least)
    return low - room, high + room


# --- Pressures -----------------------------------------------------------------------------------


def _draw_pressures(move: MoveRecord, panels: np.ndarray) -> None:
    """Draw the pressures of each actuator [MPa] over time.

    They are the pressure in the supply line and the first three of `move.chambers`. Times in a
    boosted mode have a background in the colour of the mode. A dashed line marks the main pump's
    pressure P_S. The supply line is wide and drawn first, so that equal pressures stay visible on
    it. The first panel has the legend, for which all panels have room at the top.

    Args:
        move: The move.
        panels: Axes, one for each actuator, with a shared y axis.
    """
    for j, axes in enumerate(panels):
        for begin, end, mode in yield_mode_spans(move.modes[:, j]):
            if mode is not Mode.N:
                axes.axvspan(move.time[begin], move.time[end], color=_pale(mode), linewidth=0)
        supply = PER_MPA * move.supply[:, j]
        draw_line(axes, move.time, supply, color=BLACK, label="supply line", linewidth=3.0)
        colors = iter((GREEN, PURPLE, BROWN))
        for (name, pressure), color in zip(move.chambers.items(), colors, strict=False):
            draw_line(axes, move.time, PER_MPA * pressure[:, j], color=color, label=name)
        normal = PER_MPA * move.machine.arrays.supply_pressure
        axes.axhline(normal, color=GREY, linestyle="--", linewidth=0.9, label="main pump, $P_S$")
        axes.set(
            xlim=(move.time[0], move.time[-1]),
            xlabel="time [s]",
            title=f"actuator {j + 1}: pressures",
        )
    panels[0].set_ylabel("pressure [MPa]")
    top = max(1.3 * PER_MPA * move.machine.arrays.supply_pressure, panels[0].get_ylim()[1])
    panels[0].set_ylim(min(0.0, panels[0].get_ylim()[0]), 1.25 * top)
    panels[0].legend(loc="upper left", fontsize=7.5, ncols=2)


GIVEN_BY_LOADS = "given by sinking loads"
"""Name of the work on the loads if it is negative: the loads then give the energy."""

ITEM_COLORS = {
    "main pump": TEAL,
    "servo pumps": YELLOW,
    "work on the loads": GREEN,
    GIVEN_BY_LOADS: GREEN,
    "throttling": BROWN,
    "leakage": PURPLE,
    "oil to the tank": GREY,
    "servo pump losses": YELLOW,
    "friction": BLACK,
    "compression": PALE,
}
"""Colour of each part of the energy; the order is that in the diagram, from the top."""
LEAST_SHARE = 0.004
"""Share of all energy below which a part is not drawn."""

BAR_WIDTH = 0.05
SOURCE_POSITION, SINK_POSITION = 0.30, 0.62
"""Horizontal positions of the two columns of bars, as shares of the width."""

BAND_GAP = 0.045
"""Gap between two bands on the right, as a share of the height."""

LEAST_PITCH = 0.125
"""Least distance between two labels, as a share of the height."""

LABEL_DISTANCE = 0.03
"""Distance of a label from its bar, as a share of the width."""


def draw_energy_flow(energy: Mapping[str, float], axes: Axes) -> None:
    """Draw bands from the sources of energy on the left to its uses on the right.

    Each part has a label with its name, its energy [J] and its share of all energy that the sources
    give [%]. Parts of at most 0.4 % of that total are left out. If no part gives energy, only the
    text "no energy" is drawn.

    Args:
        energy: Energy by name [J], positive if the part uses energy, negative if it gives energy.
            Pumps give energy, and loads that sink give energy, too. Names that are not in
            `ITEM_COLORS` come last, in a pale colour.
        axes: Axes to draw on. Their scales are replaced.
    """
    axes.set_axis_off()
    axes.set(xlim=(0.0, 1.0), ylim=(1.0, 0.0))
    if energy.get("work on the loads", 0.0) < 0.0:
        energy = {**energy, GIVEN_BY_LOADS: energy["work on the loads"], "work on the loads": 0.0}
    total = sum(-value for value in energy.values() if value < 0.0)
    if total <= 0.0:
        axes.text(0.5, 0.5, "no energy", ha="center")
        return
    given = _parts(energy, -1.0, total)
    taken = _parts(energy, 1.0, total)
    scale = (1.0 - BAND_GAP * max(len(taken) - 1, 0)) / max(sum(taken.values()), total)
    heights = scale * np.array(list(given.values()))
    tops = (1.0 - heights.sum()) / 2 + np.cumsum([0.0, *heights[:-1]])
    _draw_column(given, tops, heights, total, -1, axes)
    _draw_takers(taken, total, scale, axes)


def _parts(energy: Mapping[str, float], sign: float, total: float) -> dict[str, float]:
    """Select the parts that give energy, or those that take it, in the order of the diagram.

    Args:
        energy: Energy by name [J], negative if the part gives energy.
        sign: −1 selects the parts that give, 1 those that take.
        total: Sum of the energies that all parts give [J].

    Returns:
        Positive amounts by name [J]. Amounts of at most `LEAST_SHARE` of `total` are left out.
    """
    order = [
        *(name for name in ITEM_COLORS if name in energy),
        *(name for name in energy if name not in ITEM_COLORS),
    ]
    parts = {name: sign * energy[name] for name in order}
    return {name: value for name, value in parts.items() if value > LEAST_SHARE * total}


def _draw_takers(taken: Mapping[str, float], total: float, scale: float, axes: Axes) -> None:
    """Draw a bar with a label for each use of energy on the right, and a band that leads to it.

    Labels are right of the bars, with name, energy [J] and percentage of `total`. The bands start
    at the column of sources on the left, one below the other. The bars have gaps of BAND_GAP.

    Args:
        taken: Energy of each use [J], in order from the top.
        total: Sum of the energies of all sources [J], for the percentages in the labels.
        scale: Height of a bar, as a share of the axes' height, per energy [1/J].
        axes: Axes to draw on; x goes from 0 to 1, and y from 1 (bottom) to 0 (top).
    """
    heights = np.array([scale * value for value in taken.values()])
    above = np.cumsum([0.0, *heights[:-1]])
    leaves, tops = (1.0 - heights.sum()) / 2 + above, above + BAND_GAP * np.arange(len(heights))
    for name, leave, top, height in zip(taken, leaves, tops, heights, strict=True):
        _draw_band(leave, top, height, name, axes)
    _draw_column(taken, tops, heights, total, 1, axes)


def label_places(middles: FloatArray) -> FloatArray:
    """Choose heights for the labels of bars so that the labels do not overlap.

    Args:
        middles: Middle of each bar, as a share of the axes' height from the top, increasing, shape
            (k,).

    Returns:
        Height of each label, in the same unit and order, shape (k,). Each is as near to the middle
        of its bar as the labels before it and the axes' ends allow. Neighbours are at least
        LEAST_PITCH apart, or 1/k if that is smaller.
    """
    pitch = min(LEAST_PITCH, 1.0 / max(len(middles), 1))
    own = pitch * np.arange(len(middles))
    lowest = 1.0 - pitch / 2 - own[-1] if len(middles) else 0.0
    # After subtracting k times the pitch, heights need only be non-decreasing: a running maximum.
    free = np.clip(middles - own, pitch / 2, lowest)
    return np.asarray(np.maximum.accumulate(free) + own)


def _draw_column(
    parts: Mapping[str, float],
    tops: FloatArray,
    heights: FloatArray,
    total: float,
    side: int,
    axes: Axes,
) -> None:
    """Draw a bar for each source or use of energy, and beside it a label with a thin line to it.

    A label has name, energy [J] and share of the total [%].

    Args:
        parts: Energy by name [J]; the name selects the colour of the bar.
        tops: Upper edge of each bar, as a share of the axes' height from the top, shape (k,),
            aligned with `parts`.
        heights: Height of each bar, in the same unit, shape (k,).
        total: Sum of the energies of all sources [J], for the percentages.
        side: −1 draws the column of sources with labels on its left, 1 that of uses with labels on
            its right.
        axes: Axes to draw on; x goes from 0 to 1, and y from 1 (bottom) to 0 (top).
    """
    left = SINK_POSITION if side > 0 else SOURCE_POSITION - BAR_WIDTH
    colors = [ITEM_COLORS.get(name, PALE) for name in parts]
    axes.bar(left, heights, BAR_WIDTH, tops, align="edge", color=colors, linewidth=0)
    edge, middles = left + BAR_WIDTH * (side > 0), tops + heights / 2
    for (name, value), middle, height in zip(
        parts.items(), middles, label_places(middles), strict=True
    ):
        near, far = edge + side * 0.005, edge + side * LABEL_DISTANCE
        axes.plot([near, far], [middle, height], color=GREY, linewidth=0.6)
        text = f"{name}\n{value:.0f} J, {100 * value / total:.0f} %"
        where = "left" if side > 0 else "right"
        axes.text(
            far + side * 0.008, height, text, ha=where, va="center", fontsize=8, linespacing=1.05
        )


def _draw_band(left_edge: float, right_edge: float, height: float, name: str, axes: Axes) -> None:
    """Draw a band from the left column of bars to the right one.

    It has the same height everywhere, and horizontal tangents at both ends.

    Args:
        left_edge: Upper edge at the left column, as a share of the axes' height from the top.
        right_edge: Upper edge at the right column, in the same unit.
        height: Height of the band, in the same unit.
        name: Part of the energy; it selects the colour.
        axes: Axes to draw on; x goes from 0 to 1, and y from 1 (bottom) to 0 (top).
    """
    along = np.linspace(0.0, 1.0, 60)
    shift = left_edge + (right_edge - left_edge) * (3.0 - 2.0 * along) * along**2
    x = SOURCE_POSITION + (SINK_POSITION - SOURCE_POSITION) * along
    color = ITEM_COLORS.get(name, PALE)
    axes.fill_between(x, shift, shift + height, color=color, alpha=0.35, linewidth=0)
