"""Plots of pressures, modes and energy beside the scene, and the states that they show."""

from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from viser import GuiApi, uplot

from mhsb_model.figure_style import (
    BROWN,
    GREEN,
    PURPLE,
    TEAL,
    YELLOW,
)
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.types import FloatArray, ModeArray
from mhsb_tools.viewer import energy_flow

PLOT_SPAN = 30.0
"""Time before the present one that plots show [s]."""

NO_NUMBERS = np.full(4, np.nan)
"""Energies that are all unknown."""


class Snapshots(NamedTuple):
    """States of an arm with n joints at k instants, as columns; or one state, without the axis k.

    Attributes:
        time: Time of each state, shape (k,) [s].
        supply_pressure: Pressure in the line that feeds each valve, shape (k, n) [Pa]; nan if
            unknown.
        modes: Mode codes in force, uint8 (k, n).
        energy: Energies in the order of `energy_flow.ITEM_NAMES`, shape (k, 4) [J]; nan if unknown.
    """

    time: Any
    supply_pressure: FloatArray
    modes: ModeArray
    energy: FloatArray


class SnapshotHistory:
    """States of the arm from a limited time before the last state on."""

    def __init__(self, span: float) -> None:
        """Create an empty history.

        Args:
            span: Time before the last state for which states are kept [s].
        """
        self._span = span
        self._began = 0.0
        self._moments: deque[Snapshots] = deque()

    def add(self, moment: Snapshots) -> None:
        """Add a state, and discard those that are more than the span older than this one.

        If the new state is earlier than the previous state, as after a restart of the simulator,
        the history is cleared first.

        Args:
            moment: One state.
        """
        kept = self._moments
        if kept and moment.time < kept[-1].time:
            kept.clear()
        if not kept:
            self._began = moment.time
        kept.append(moment)
        while kept[0].time < moment.time - self._span:
            kept.popleft()

    def get_columns(self) -> Snapshots:
        """Return the kept states as columns; the history must not be empty.

        Returns:
            The states in time order. Times [s] count from the first state that was added to the
            empty or cleared history.
        """
        time, *others = (np.array(column) for column in zip(*self._moments, strict=True))
        return Snapshots(time - self._began, *others)


JOINT_COLORS = (TEAL, PURPLE, GREEN, BROWN)
ENERGY_COLORS = (TEAL, BROWN, YELLOW, GREEN)
LINE_WIDTH = 1.5
PLOT_ASPECT = 1.9
HEADROOM_FACTOR = 1.2
"""Upper end of the pressure axis over the largest boost pressure."""

MODE_STEP = 3
"""Vertical distance between the zero lines of two actuators; a mode is drawn its code above it."""


class Plots:
    """Three plots with a common time axis [s], and a sentence on where the energy went."""

    def __init__(self, gui: GuiApi, machine: Machine) -> None:
        """Add empty plots of supply pressures [MPa], modes and energies [J] to the page.

        A text with the energies is added below them.

        Args:
            gui: Controls of the browser.
            machine: The arm; it determines the number of lines and the limits of the pressure axis.
        """
        numbers = range(1, machine.joint_count + 1)
        highest = HEADROOM_FACTOR * machine.arrays.max_boost_pressure / 1e6
        self._pressures = _plot(
            gui,
            "Supply pressure [MPa]",
            [f"line {k}" for k in numbers],
            JOINT_COLORS,
            (0.0, highest),
        )
        codes = ", ".join(f"{mode.name} +{mode.value}" for mode in Mode)
        top = float(MODE_STEP * machine.joint_count)
        self._modes = _plot(
            gui, f"Modes ({codes})", [f"actuator {k}" for k in numbers], JOINT_COLORS, (-0.5, top)
        )
        self._energy = _plot(
            gui, "Energy from the pumps to the pistons [J]", energy_flow.ITEM_NAMES, ENERGY_COLORS
        )
        self._losses: Any = gui.add_markdown(energy_flow.describe_energies(NO_NUMBERS))

    def show(self, lines: Snapshots) -> None:
        """Replace the lines of all plots, and the sentence on the energies at their end.

        Args:
            lines: States of the arm over time, at least one.
        """
        apart = MODE_STEP * np.arange(lines.modes.shape[1])
        for plot, values in (
            (self._pressures, lines.supply_pressure / 1e6),
            (self._modes, lines.modes + apart),
            (self._energy, lines.energy),
        ):
            plot.data = (lines.time, *np.array(values.T, dtype=np.float64, order="C"))
        self._losses.content = energy_flow.describe_energies(lines.energy[-1])


def _plot(
    gui: GuiApi,
    title: str,
    labels: Sequence[str],
    colors: Sequence[str],
    y_limits: tuple[float, float] | None = None,
) -> Any:
    """Add an empty plot over time to the page.

    Args:
        gui: Controls of the browser.
        title: Title of the plot.
        labels: Label of each line.
        colors: Colours of the lines; with more lines than colours, they are used again from the
            first.
        y_limits: Limits of the vertical axis; None fits it to the data.

    Returns:
        Handle of the plot. Its attribute `data` is a sequence of arrays: the times, then the values
        of each line.
    """
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
            "y": uplot.Scale(range=y_limits) if y_limits else uplot.Scale(auto=True),
        },
        legend=uplot.Legend(show=True),
        aspect=PLOT_ASPECT,
    )
