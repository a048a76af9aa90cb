"""Write a move as an animated GIF: arm with cylinders, modes and supply pressures over time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mhsb_model.errors import ArgumentError
from mhsb_model.figure_style import (
    BLACK,
    GREY,
    JOINT_COLORS,
    MODE_COLOR,
    PALE,
    PATH_COLOR,
    RC_PARAMETERS,
    Axes,
    rgb,
)
from mhsb_model.files.output_folders import replace_file
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, Position
from mhsb_sim.mechanics.linkage_shapes import BARREL_PAINT, compute_planar_bars
from mhsb_tools.moves.move import MoveRecord
from mhsb_tools.moves.move_page import PATH_WIDTH, PER_MPA, draw_mode_bars, yield_path_spans
from mhsb_tools.moves.workspace_drawing import draw_obstacles, draw_workspace_axes

ByteArray = npt.NDArray[np.uint8]

FIGURE_SIZE = (8.0, 4.64)  # width, height [in]
PALETTE_SIZE = 96
"""Number of colours in the palette that all frames share."""

MAX_FRAMES = 5000
"""Largest number of frames of one film. All are in memory at once, 6 GB at the usual width."""

SWATCH_SIZE = 8
"""Height of each swatch in the picture from which the palette is made [pixels]."""
BACKGROUND_COLOR = "#ffffff"

SAMPLES_BETWEEN, CYLINDER_MARGIN = 5, 0.08
"""Room for cylinders on the axes: every fifth instant is examined, and 0.08 m is added."""

BARREL_WIDTH, BAR_WIDTH, LINK_WIDTH = 7.0, 2.5, 5.0
"""Line widths of cylinder barrels, other bars and links [points]."""


@dataclass(frozen=True)
class FilmGoal:
    """A goal of the film and the time from which the arm moves towards it.

    Attributes:
        time: Time in the move's own time [s].
        place: Goal position in `base_link` [m].
    """

    time: float
    place: Position


def write_film(
    move: MoveRecord,
    goals: Sequence[FilmGoal],
    file: Path,
    *,
    speed: float = 1.0,
    rate: float = 12.0,
    width: int = 800,
) -> int:
    """Write a move as an animated GIF.

    The film is written under a temporary name in the same folder and then renamed, so `file` never
    has an incomplete film. All frames are in memory at once.

    Args:
        move: The move to show. Its duration, `speed` and `rate` give the number of frames.
        goals: Goals to mark, in time order. At each instant only the latest one is marked.
        file: GIF file to write; an existing one is replaced.
        speed: Seconds of the move that pass in one second of the film.
        rate: Frames in one second of the film. GIFs store the delay between frames in hundredths of
            a second. The delay is rounded to this unit, and is at least 0.02 s.
        width: Width of the picture [pixels].

    Returns:
        Number of frames written, at least 2.

    Raises:
        ArgumentError: The film would have more than `MAX_FRAMES` frames.
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
    frames = list(_quantize_frames([film.frame(time) for time in times]))
    with replace_file(file) as part, part.open("wb") as stream:
        frames[0].save(
            stream,
            format="GIF",
            save_all=True,
            append_images=frames[1:],
            duration=10 * hundredths,
            loop=0,
            optimize=True,
        )
    return count


def _quantize_frames(frames: list[ByteArray]) -> Iterator[Any]:
    """Yield the frames as images that all share one palette of `PALETTE_SIZE` colours.

    The palette is made from a few frames that are spread evenly over the film, and from a picture
    with all mode colours. No dithering is used, so that static parts do not flicker.

    Args:
        frames: At least one picture, each of shape (height, width, 3), uint8.

    Yields:
        Each frame as a palette image, in order.
    """
    from PIL import Image

    some = np.concatenate([*frames[:: max(1, len(frames) // 4)], _swatches(frames[0].shape[1])])
    palette = Image.fromarray(some).quantize(PALETTE_SIZE, method=Image.Quantize.MEDIANCUT)
    for frame in frames:
        yield Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)


def _swatches(width: int) -> ByteArray:
    """Return a picture with one stripe for each colour that the palette of the film must contain.

    Args:
        width: Width of the picture [pixels].

    Returns:
        The picture, shape (height, width, 3), uint8. Each stripe has `SWATCH_SIZE` rows. The
        colours are the background, the mode colours and the path colours.
    """
    colors = [
        rgb(color) for color in (BACKGROUND_COLOR, *MODE_COLOR.values(), *PATH_COLOR.values())
    ]
    return (
        np.tile(np.array(colors)[:, None] * 255, (SWATCH_SIZE, width, 1)).round().astype(np.uint8)
    )


class _Film:
    """A figure whose static parts are drawn once; moving parts are redrawn for each frame."""

    def __init__(self, move: MoveRecord, goals: Sequence[FilmGoal], width: int) -> None:
        """Draw the parts that do not move and keep them as a background image.

        The left half of the figure shows the plane in which the arm moves. The right half shows the
        actuators' modes and, below them, their supply pressures [MPa], both over time [s].

        Args:
            move: The move to show.
            goals: Goals to mark, in time order.
            width: Width of the picture [pixels].
        """
        import matplotlib as mpl
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self._move, self._goals = move, goals
        with mpl.rc_context(RC_PARAMETERS | {"font.size": 8.5}):
            figure = Figure(FIGURE_SIZE, dpi=width / FIGURE_SIZE[0], layout="constrained")
            self._canvas = FigureCanvasAgg(figure)
            figure.suptitle(move.title, fontsize=10, fontweight="bold")
            left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(1.0, 1.15))[0]
            self._stage = left.subplots()
            modes, pressures = right.subplots(2, 1, sharex=True, height_ratios=(1.0, 1.7))
            self._draw_stage()
            self._draw_modes(modes)
            self._draw_pressures(pressures)
            self._moving = [
                *self._create_moving_artists(),
                *(
                    each.axvline(0.0, color=BLACK, linewidth=1.0, animated=True)
                    for each in (modes, pressures)
                ),
            ]
            self._canvas.draw()
            figure.set_layout_engine("none")
            self._still = self._canvas.copy_from_bbox(figure.bbox)

    def frame(self, time: float) -> ByteArray:
        """Draw the picture of one instant.

        Args:
            time: Time in the move's time [s]. The arm is shown at the first sample at or after
                `time`, or at the last sample if there is none.

        Returns:
            The picture, shape (height, width, 3), uint8.
        """
        row = min(int(np.searchsorted(self._move.time, time)), len(self._move.time) - 1)
        self._update_artists(row, time)
        self._canvas.restore_region(self._still)
        for artist in self._moving:
            artist.axes.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    # Static parts.

    def _draw_stage(self) -> None:
        """Draw the static parts of the left half: workspace, obstacles, pale tip path, legend.

        The limits of the axes are widened so that rods, barrels and levers fit in at every time.
        Only every fifth posture of the move is examined for this, and `CYLINDER_MARGIN` is added.
        """
        axes = self._stage
        draw_workspace_axes(self._move.machine, axes)
        draw_obstacles(self._move.machine, axes, self._move.position)
        axes.plot(*self._move.tip.T, color=PALE, linewidth=3.0)
        machine, rows = self._move.machine, self._move.position[::SAMPLES_BETWEEN]
        places = np.array([_flat(bar) for q in rows for bar in compute_planar_bars(machine, q)])
        for limits, put, values in (
            (axes.get_xlim(), axes.set_xlim, places[..., 0]),
            (axes.get_ylim(), axes.set_ylim, places[..., 1]),
        ):
            put(
                min(limits[0], values.min() - CYLINDER_MARGIN),
                max(limits[1], values.max() + CYLINDER_MARGIN),
            )
        handles = [
            axes.plot([], [], color=PATH_COLOR[mode], linewidth=PATH_WIDTH[mode])[0]
            for mode in Mode
        ]
        names = [f"tip, all in {Mode.N.name}", *(f"one in {mode.name}" for mode in list(Mode)[1:])]
        axes.legend(handles, names, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)

    def _draw_modes(self, axes: Axes) -> None:
        """Draw a bar over time [s] for each actuator, in the colours of its modes, and a legend.

        Args:
            axes: Axes to draw on. The title is set.
        """
        draw_mode_bars(self._move, axes)
        axes.set_title("modes")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize=7.5)

    def _draw_pressures(self, axes: Axes) -> None:
        """Draw each actuator's supply pressure [MPa] over time.

        Args:
            axes: Axes to draw on. Their limits, labels and legend are set as well.
        """
        move = self._move
        for j in range(move.machine.joint_count):
            color, label = JOINT_COLORS[j % len(JOINT_COLORS)], f"actuator {j + 1}"
            axes.plot(move.time, PER_MPA * move.supply[:, j], color=color, label=label)
        top = max(1.5 * move.machine.arrays.supply_pressure, 1.2 * float(move.supply.max()))
        axes.set(
            ylim=(0.0, PER_MPA * top),
            xlim=(move.time[0], move.time[-1]),
            xlabel="time [s]",
            title="supply pressures [MPa]",
        )
        axes.legend(loc="lower right", ncols=3, fontsize=7.5)

    # Moving parts.

    def _create_moving_artists(self) -> list[Any]:
        """Create the Matplotlib artists that change in each frame; they are still empty.

        They are path, bars, links, barrels, goal mark and clock. Each is also stored as an
        attribute of this object, where `_update_artists` finds it.

        Returns:
            The artists in the order in which they are drawn.
        """
        from matplotlib.collections import LineCollection
        from matplotlib.patheffects import Normal, Stroke

        axes = self._stage
        look: dict[str, Any] = {"animated": True, "capstyle": "round"}
        self._path = axes.add_collection(LineCollection([], **look))
        self._bars = axes.add_collection(
            LineCollection([], linewidths=BAR_WIDTH, colors=GREY, **look)
        )
        [self._links] = axes.plot(
            [], [], color="#505050", linewidth=LINK_WIDTH, marker="o", markersize=6, animated=True
        )
        self._barrels = axes.add_collection(LineCollection([], linewidths=BARREL_WIDTH, **look))
        self._barrels.set_path_effects(
            [Stroke(linewidth=BARREL_WIDTH + 2.0, foreground="#505050"), Normal()]  # dark outline
        )
        [self._goal] = axes.plot(
            [], [], marker="o", markersize=9, markerfacecolor="none", markeredgecolor=BLACK,
            markeredgewidth=1.6, linestyle="none", animated=True,
        )  # fmt: skip
        self._clock = axes.text(
            0.98, 0.02, "", transform=axes.transAxes, ha="right", animated=True, fontsize=10
        )
        return [self._path, self._bars, self._links, self._barrels, self._goal, self._clock]

    def _update_artists(self, row: int, time: float) -> None:
        """Set all moving artists to one instant.

        Cylinder barrels get the colour of their actuator's mode. The tip's path from the beginning
        to this instant has the colours of all boosted modes in force at each point. Only the latest
        goal up to this instant is marked; before the first goal there is no mark.

        Args:
            row: Index of the sample to show, in the move's arrays.
            time: Time that clock, cursors and goals show, in the move's time [s].
        """
        move = self._move
        q = move.position[row]
        self._links.set_data(*move.machine.joint_positions(q).T)
        bars = compute_planar_bars(move.machine, q)
        barrels = [bar for bar in bars if bar.color == BARREL_PAINT]
        others = [bar for bar in bars if bar.color != BARREL_PAINT]
        self._bars.set_segments([_flat(bar) for bar in others])
        self._barrels.set_segments([_flat(bar) for bar in barrels])
        modes = move.modes[row, move.machine.slews :].tolist()  # a slewing joint has no barrel
        self._barrels.set_color([MODE_COLOR[Mode(mode)] for mode in modes])
        stretches = list(yield_path_spans(move.modes[: row + 1])) if row > 0 else []
        self._path.set_segments([move.tip[begin : end + 1] for begin, end, _ in stretches])
        self._path.set_color([PATH_COLOR[mode] for *_, mode in stretches])
        self._path.set_linewidth([PATH_WIDTH[mode] for *_, mode in stretches])
        sent = [
            move.machine.project_to_plane(goal.place) for goal in self._goals if goal.time <= time
        ]
        self._goal.set_data(*([[each] for each in sent[-1]] if sent else ([], [])))
        self._clock.set_text(f"{time:.1f} s")
        for cursor in self._moving[-2:]:
            cursor.set_xdata([time, time])


def _flat(bar: Any) -> FloatArray:
    """Return both ends of a bar in the arm's plane.

    Args:
        bar: A bar with end points `start` and `end` (x, y, z) [m].

    Returns:
        Rows start and end, columns x and z [m], shape (2, 2).
    """
    return np.array([bar.start[[0, 2]], bar.end[[0, 2]]])
