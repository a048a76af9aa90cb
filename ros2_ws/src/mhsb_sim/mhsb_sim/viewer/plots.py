"""Pressures, modes and energy over time, beside the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from viser import GuiApi, uplot

from mhsb_model.figure_style import BLUE, GREEN, ORANGE, PURPLE, VERMILION
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, IntArray
from mhsb_sim.viewer import energy_flow
from mhsb_sim.viewer.moment import NO_NUMBERS, Lines

COLORS = (BLUE, ORANGE, GREEN, PURPLE)
ENERGY_COLORS = (BLUE, VERMILION, ORANGE, GREEN)
LINE_WIDTH = 1.5
ASPECT = 1.9
HEADROOM = 1.2
MODE_STEP = 3
"""Between the lines of two actuators; a mode's line is as far above its actuator's as its code."""


class Plots:
    """Three plots that share their time axis [s], and where the energy went."""

    def __init__(self, gui: GuiApi, machine: Machine) -> None:
        numbers = range(1, machine.joint_count + 1)
        highest = HEADROOM * machine.arrays.max_boost_pressure / 1e6
        self._pressures = _plot(
            gui, "Supply pressure [MPa]", [f"line {k}" for k in numbers], COLORS, (0.0, highest)
        )
        codes = ", ".join(f"{mode.name} +{mode.value}" for mode in Mode)
        top = float(MODE_STEP * machine.joint_count)
        self._modes = _plot(
            gui, f"Modes ({codes})", [f"actuator {k}" for k in numbers], COLORS, (-0.5, top)
        )
        self._energy = _plot(
            gui, "Energy from the pumps to the pistons [J]", energy_flow.NAMES, ENERGY_COLORS
        )
        self._losses: Any = gui.add_markdown(energy_flow.words(NO_NUMBERS))

    def show(self, lines: Lines) -> None:
        """All lines."""
        apart = MODE_STEP * np.arange(lines.modes.shape[1])
        for plot, values in (
            (self._pressures, lines.supply_pressure / 1e6),
            (self._modes, lines.modes + apart),
            (self._energy, lines.energy),
        ):
            plot.data = (lines.time, *_columns(values))
        self._losses.content = energy_flow.words(lines.energy[-1])


def _columns(values: FloatArray | IntArray) -> list[FloatArray]:
    return [np.ascontiguousarray(column, dtype=np.float64) for column in values.T]


def _plot(
    gui: GuiApi,
    title: str,
    labels: Sequence[str],
    colors: Sequence[str],
    between: tuple[float, float] | None = None,
) -> Any:
    """A plot over time, its values `between` two or as far as they go."""
    nothing = np.zeros(1)
    series = [
        uplot.Series(label=label, stroke=colors[k % len(colors)], width=LINE_WIDTH)
        for k, label in enumerate(labels)
    ]
    return gui.add_uplot(
        data=(nothing, *[nothing] * len(labels)),
        series=(uplot.Series(label="time [s]"), *series),
        title=title,
        scales={
            "x": uplot.Scale(time=False, auto=True),
            "y": uplot.Scale(range=between) if between else uplot.Scale(auto=True),
        },
        legend=uplot.Legend(show=True),
        aspect=ASPECT,
    )
