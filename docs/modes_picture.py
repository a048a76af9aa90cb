"""Draw docs/modes.png: how an actuator is supplied in the modes N, DB and SB.

python docs/modes_picture.py
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon, Rectangle

from mhsb_model.figure_style import PATH_COLOR
from mhsb_model.modes import Mode

FILE = Path(__file__).with_name("modes.png")
IDLE = "#b5b5b5"
CHECK_X, VALVE_X, OWN_X, SPARE_X = 0.7, 1.6, 2.5, 4.6
PUMP_Y, MANIFOLD_Y, SERVO_PUMP_Y = 0.0, 0.9, 1.75
RAIL_Y, LINE_Y, VALVE_Y, CYLINDER_Y = 2.7, 3.6, 4.35, 5.25

Route = Sequence[tuple[float, float]]

SUPPLY: Route = ((CHECK_X, PUMP_Y), (CHECK_X, MANIFOLD_Y))
THROUGH_CHECK: Route = ((CHECK_X, MANIFOLD_Y), (CHECK_X, LINE_Y), (VALVE_X, LINE_Y))
TO_OWN: Route = ((CHECK_X, MANIFOLD_Y), (OWN_X, MANIFOLD_Y), (OWN_X, RAIL_Y))
OWN_TO_LINE: Route = ((OWN_X, RAIL_Y), (OWN_X, LINE_Y), (VALVE_X, LINE_Y))
TO_SPARE: Route = ((OWN_X, MANIFOLD_Y), (SPARE_X, MANIFOLD_Y), (SPARE_X, RAIL_Y))
RAIL: Route = ((SPARE_X, RAIL_Y), (VALVE_X, RAIL_Y))
JOIN: Route = ((VALVE_X, RAIL_Y), (VALVE_X, LINE_Y))
INTO_CYLINDER: Route = ((VALVE_X, LINE_Y), (VALVE_X, CYLINDER_Y - 0.25))
EVERYTHING = SUPPLY, THROUGH_CHECK, TO_OWN, OWN_TO_LINE, TO_SPARE, RAIL, JOIN, INTO_CYLINDER

MODES = (
    (
        "N, normal",
        "main pump alone",
        "$p = P_S$",
        PATH_COLOR[Mode.N],
        (SUPPLY, THROUGH_CHECK, INTO_CYLINDER),
    ),
    (
        "DB, decoupled boost",
        "own servo pump in series with the main pump",
        "$p > P_S$",
        PATH_COLOR[Mode.DB],
        (SUPPLY, TO_OWN, OWN_TO_LINE, INTO_CYLINDER),
    ),
    (
        "SB, shared boost",
        "several servo pumps feed a rail",
        "$p > P_S$",
        PATH_COLOR[Mode.SB],
        (SUPPLY, TO_OWN, TO_SPARE, RAIL, JOIN, INTO_CYLINDER),
    ),
)
"""Title, explanation, pressure in the actuator's line, colour, routes with flow, by mode."""


def draw_mode(
    axes: Axes, title: str, text: str, pressure: str, colour: str, active: Sequence[Route]
) -> None:
    """Draw one panel: the whole circuit in grey, and the routes with flow in the mode's colour."""
    for routes, shade, width in ((EVERYTHING, IDLE, 1.5), (active, colour, 3.5)):
        for route in routes:
            axes.plot(*zip(*route, strict=True), color=shade, lw=width, zorder=1 + width)

    def shade(route: Route) -> str:
        return colour if route in active else IDLE

    _pump(axes, CHECK_X, PUMP_Y, colour, "main pump")
    _pump(axes, OWN_X, SERVO_PUMP_Y, shade(TO_OWN), "own\nservo pump")
    _pump(axes, SPARE_X, SERVO_PUMP_Y, shade(TO_SPARE), "spare\nservo pump")
    _check_valve(axes, shade(THROUGH_CHECK))
    _box(axes, VALVE_X, (RAIL_Y + LINE_Y) / 2, (0.34, 0.34), shade(JOIN), "join\nvalve", (-0.8, 0))
    _box(axes, OWN_X, RAIL_Y, (0.3, 0.3), shade(TO_OWN), "diverter", (0.1, 0.35))
    _box(axes, VALVE_X, VALVE_Y, (0.7, 0.4), colour, "servo valve", (0.45, 0))
    axes.add_patch(Rectangle((0.55, CYLINDER_Y - 0.25), 1.9, 0.5, fc="white", ec=colour, lw=2))
    axes.plot([1.9, 1.9], [CYLINDER_Y - 0.25, CYLINDER_Y + 0.25], color=colour, lw=5, zorder=6)
    axes.plot([1.9, 3.0], [CYLINDER_Y, CYLINDER_Y], color=colour, lw=3, zorder=6)
    axes.text(3.1, CYLINDER_Y, "cylinder", va="center")
    axes.text(SPARE_X - 0.6, RAIL_Y + 0.1, "rail", va="bottom")
    axes.text(OWN_X + 0.2, LINE_Y, f"line: {pressure}", weight="bold", va="center")
    axes.text(SPARE_X - 0.05, MANIFOLD_Y - 0.12, "manifold: $P_S$", va="top", ha="right")
    axes.set_title(title, weight="bold", color=colour, fontsize=14)
    axes.text(2.5, CYLINDER_Y + 0.55, text, ha="center")
    axes.set(xlim=(-0.55, 6.0), ylim=(-0.65, CYLINDER_Y + 0.85), aspect="equal")
    axes.axis("off")


def _pump(axes: Axes, x: float, y: float, colour: str, name: str) -> None:
    """Draw a pump as a circle with a triangle that points in the direction of flow."""
    axes.add_patch(Circle((x, y), 0.3, fc="white", ec=colour, lw=2, zorder=6))
    tip = [(x - 0.13, y + 0.1), (x + 0.13, y + 0.1), (x, y + 0.29)]
    axes.add_patch(Polygon(tip, fc=colour, zorder=7))
    axes.text(x + 0.38, y, name, va="center")


def _check_valve(axes: Axes, colour: str) -> None:
    """Draw the check valve: a ball in its seat, open upwards."""
    y = (MANIFOLD_Y + LINE_Y) / 2
    axes.add_patch(Rectangle((CHECK_X - 0.2, y - 0.25), 0.4, 0.5, fc="white", ec="none", zorder=5))
    axes.plot([CHECK_X - 0.2, CHECK_X, CHECK_X + 0.2], [y + 0.1, y - 0.2, y + 0.1], color=colour,
              lw=2, zorder=6)  # fmt: skip
    axes.add_patch(Circle((CHECK_X, y + 0.08), 0.13, fc="white", ec=colour, lw=2, zorder=7))
    axes.text(CHECK_X - 0.28, y, "check\nvalve", va="center", ha="right")


def _box(
    axes: Axes,
    x: float,
    y: float,
    size: tuple[float, float],
    colour: str,
    name: str,
    offset: tuple[float, float],
) -> None:
    """Draw a valve as a box, and its name at an offset from its centre."""
    corner = (x - size[0] / 2, y - size[1] / 2)
    axes.add_patch(Rectangle(corner, *size, fc="white", ec=colour, lw=2, zorder=6))
    axes.text(x + offset[0], y + offset[1], name, va="center")


def main() -> None:
    """Draw all three panels and write the file."""
    figure, panels = plt.subplots(1, 3, figsize=(15, 5.4), layout="constrained")
    for axes, mode in zip(panels, MODES, strict=True):
        draw_mode(axes, *mode)
    figure.savefig(FILE, dpi=90)


if __name__ == "__main__":
    main()
