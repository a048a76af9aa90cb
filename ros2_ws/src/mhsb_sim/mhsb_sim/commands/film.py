"""A move as an animation: the arm with its cylinders, modes and supply pressures over time."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mhsb_model.errors import ArgumentError
from mhsb_model.figure_style import (
    BLACK,
    GREEN,
    GREY,
    MODE_COLOR,
    PALE,
    PATH_COLOR,
    PURPLE,
    STYLE,
    rgb,
)
from mhsb_model.modes import Mode, strongest
from mhsb_model.types import FloatArray, Position
from mhsb_planner.evaluation.move import Move
from mhsb_planner.evaluation.move_page import draw_mode_bars, spans
from mhsb_planner.evaluation.workspace_drawing import draw_obstacles, draw_workspace_axes
from mhsb_sim.mechanics.linkage_shapes import BARREL_PAINT, bars_in_plane

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from PIL.Image import Image

SIZE = (8.0, 4.64)  # in
PER_MPA = 1e-6
COLORS = 96
"""Of the palette that all frames share."""

MAX_FRAMES = 5000
"""Pictures of one film, which are in memory together: 6 GB of the usual width."""

SWATCH = 8  # dots
WHITE = "#ffffff"

EVERY, BESIDE = 5, 0.08
"""Instants between two that are looked at for the room that cylinders take, and more of it [m]."""

LINES = (BLACK, GREEN, PURPLE, GREY)
BARREL, BAR, LINK = 7.0, 2.5, 5.0
"""Widths of what is drawn of the arm [points]."""


@dataclass(frozen=True)
class Sent:
    """A goal [m] in `base_link`, and from when on the arm goes there, s in the move's time."""

    time: float
    place: Position


def write_film(
    move: Move,
    goals: Sequence[Sent],
    file: Path,
    *,
    speed: float = 1.0,
    rate: float = 12.0,
    width: int = 800,
) -> int:
    """Write a GIF, whole or not at all; returns the number of its frames.

    goals  in the order of their times
    speed  seconds of the move in one of the film
    rate   frames in a second of the film; GIFs count hundredths of a second
    width  of the picture [dots]
    """
    hundredths = max(2, round(100 / rate))
    count = max(2, 1 + int(move.duration / speed * 100 / hundredths))
    if count > MAX_FRAMES:
        raise ArgumentError(
            f"the animation would have {count} pictures of {move.duration:.0f} s, and at most "
            f"{MAX_FRAMES} are made; give --begin and --end, a lower --rate or a higher --speed"
        )
    film = _Film(move, goals, width)
    times = move.time[0] + np.minimum(np.arange(count) * hundredths / 100 * speed, move.duration)
    frames = list(_with_one_palette([film.frame(time) for time in times]))
    part = file.with_name(f"{file.name}.part")
    try:
        with part.open("wb") as stream:
            frames[0].save(
                stream,
                format="GIF",
                save_all=True,
                append_images=frames[1:],
                duration=10 * hundredths,
                loop=0,
                optimize=True,
            )
        os.replace(part, file)
    finally:
        part.unlink(missing_ok=True)
    return count


def _with_one_palette(frames: list[FloatArray]) -> Iterator[Image]:
    """Pictures uint8[h, w, 3] with the colours of some of them; what stands still stays so."""
    from PIL import Image

    some = np.concatenate([*frames[:: max(1, len(frames) // 4)], _swatches(frames[0].shape[1])])
    palette = Image.fromarray(some).quantize(COLORS, method=Image.Quantize.MEDIANCUT)
    for frame in frames:
        yield Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)


def _swatches(width: int) -> FloatArray:
    """A stripe of each colour that must not be missing in a palette, uint8[h, width, 3]."""
    colors = [rgb(color) for color in (WHITE, *MODE_COLOR.values(), *PATH_COLOR.values())]
    return np.tile(np.array(colors)[:, None] * 255, (SWATCH, width, 1)).round().astype(np.uint8)


class _Film:
    """What stands still, drawn once, and what moves, drawn anew for each frame."""

    def __init__(self, move: Move, goals: Sequence[Sent], width: int) -> None:
        import matplotlib as mpl
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self._move, self._goals = move, goals
        with mpl.rc_context(STYLE | {"font.size": 8.5}):
            figure = Figure(SIZE, dpi=width / SIZE[0], layout="constrained")
            self._canvas = FigureCanvasAgg(figure)
            figure.suptitle(move.title, fontsize=10, fontweight="bold")
            left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(1.0, 1.15))[0]
            self._stage = left.subplots()
            modes, pressures = right.subplots(2, 1, sharex=True, height_ratios=(1.0, 1.7))
            self._draw_stage()
            self._draw_modes(modes)
            self._draw_pressures(pressures)
            self._moving = [*self._arm(), *(_cursor(each) for each in (modes, pressures))]
            self._canvas.draw()
            figure.set_layout_engine("none")
            self._still = self._canvas.copy_from_bbox(figure.bbox)

    def frame(self, time: float) -> FloatArray:
        """The picture at a time of the move, uint8[h, w, 3]."""
        row = min(int(np.searchsorted(self._move.time, time)), len(self._move.time) - 1)
        self._pose(row, time)
        self._canvas.restore_region(self._still)
        for artist in self._moving:
            artist.axes.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    # What stands still.

    def _draw_stage(self) -> None:
        axes = self._stage
        draw_workspace_axes(self._move.machine, axes)
        draw_obstacles(self._move.machine, axes, self._move.position)
        axes.plot(*self._move.tip.T, color=PALE, linewidth=3.0)
        machine, rows = self._move.machine, self._move.position[::EVERY]
        places = np.array([_flat(bar) for q in rows for bar in bars_in_plane(machine, q)])
        for limits, put, values in (
            (axes.get_xlim(), axes.set_xlim, places[..., 0]),
            (axes.get_ylim(), axes.set_ylim, places[..., 1]),
        ):
            put(min(limits[0], values.min() - BESIDE), max(limits[1], values.max() + BESIDE))
        handles = [axes.plot([], [], color=PATH_COLOR[mode], linewidth=2.5)[0] for mode in Mode]
        names = [f"tip, all in {Mode.N.name}", *(f"one in {mode.name}" for mode in list(Mode)[1:])]
        axes.legend(handles, names, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)

    def _draw_modes(self, axes: Axes) -> None:
        draw_mode_bars(self._move, axes)
        axes.set_title("modes")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize=7.5)

    def _draw_pressures(self, axes: Axes) -> None:
        move = self._move
        for j in range(move.machine.joint_count):
            color, label = LINES[j % len(LINES)], f"actuator {j + 1}"
            axes.plot(move.time, PER_MPA * move.supply[:, j], color=color, label=label)
        top = max(1.5 * move.machine.arrays.supply_pressure, 1.2 * float(move.supply.max()))
        axes.set_ylim(0.0, PER_MPA * top)
        axes.set_xlim(move.time[0], move.time[-1])
        axes.set_xlabel("time [s]")
        axes.set_title("supply pressures [MPa]")
        axes.legend(loc="lower right", ncols=3, fontsize=7.5)

    # What moves.

    def _arm(self) -> list[Any]:
        from matplotlib.collections import LineCollection

        axes = self._stage
        look: dict[str, Any] = {"animated": True, "capstyle": "round"}
        self._path = axes.add_collection(LineCollection([], linewidths=2.5, **look))
        self._bars = axes.add_collection(LineCollection([], linewidths=BAR, colors=GREY, **look))
        [self._links] = axes.plot(
            [], [], color="#505050", linewidth=LINK, marker="o", markersize=6, animated=True
        )
        self._barrels = axes.add_collection(LineCollection([], linewidths=BARREL, **look))
        self._barrels.set_path_effects(_outlined())
        [self._goal] = axes.plot(
            [], [], marker="o", markersize=9, markerfacecolor="none", markeredgecolor=BLACK,
            markeredgewidth=1.6, linestyle="none", animated=True,
        )  # fmt: skip
        self._clock = axes.text(
            0.98, 0.02, "", transform=axes.transAxes, ha="right", animated=True, fontsize=10
        )
        return [self._path, self._bars, self._links, self._barrels, self._goal, self._clock]

    def _pose(self, row: int, time: float) -> None:
        """Put everything that moves to its place."""
        move = self._move
        q = move.position[row]
        self._links.set_data(*move.machine.joint_positions(q).T)
        bars = bars_in_plane(move.machine, q)
        barrels = [bar for bar in bars if bar.paint == BARREL_PAINT]
        others = [bar for bar in bars if bar.paint != BARREL_PAINT]
        self._bars.set_segments([_flat(bar) for bar in others])
        self._barrels.set_segments([_flat(bar) for bar in barrels])
        modes = move.modes[row, move.machine.slews :].tolist()  # what slews has no barrel
        self._barrels.set_color([MODE_COLOR[Mode(mode)] for mode in modes])
        stretches = list(spans(strongest(move.modes[: row + 1]))) if row > 0 else []
        self._path.set_segments([move.tip[begin : end + 1] for begin, end, _ in stretches])
        self._path.set_color([PATH_COLOR[mode] for *_, mode in stretches])
        sent = [move.machine.from_the_side(goal.place) for goal in self._goals if goal.time <= time]
        self._goal.set_data(*([[each] for each in sent[-1]] if sent else ([], [])))
        self._clock.set_text(f"{time:.1f} s")
        for cursor in self._moving[-2:]:
            cursor.set_xdata([time, time])


def _flat(bar: Any) -> FloatArray:
    """Both ends of a bar in the arm's plane, float64[2, 2] m."""
    return np.array([bar.start[[0, 2]], bar.end[[0, 2]]])


def _cursor(axes: Axes) -> Any:
    return axes.axvline(0.0, color=BLACK, linewidth=1.0, animated=True)


def _outlined() -> list[Any]:
    from matplotlib.patheffects import Normal, Stroke

    return [Stroke(linewidth=BARREL + 2.0, foreground="#505050"), Normal()]
