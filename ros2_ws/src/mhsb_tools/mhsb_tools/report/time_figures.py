"""Figures of a recording over time: joints, tip, modes, pressures, energy and estimates."""

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mhsb_model.arm_reports import Estimate
from mhsb_model.figure_style import (
    BLACK,
    BROWN,
    GREEN,
    GREY,
    MODE_COLOR,
    PALE,
    PURPLE,
    TEAL,
    YELLOW,
    Axes,
    Figure,
    draw_line,
    legend_above,
    open_figure,
)
from mhsb_model.modes import BOOSTED_MODES, Mode, count_modules
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_planner.online.settings import CONFIDENCE_SIGMAS, REACHED_TOLERANCE
from mhsb_tools.moves.move_page import (
    PER_MM,
    PER_MPA,
    draw_labelled_mode_bars,
    yield_mode_spans,
)
from mhsb_tools.report.recorded_goals import find_take_over_times
from mhsb_tools.report.recorded_run import EvaluatedRecording


def to_seconds(run: EvaluatedRecording, time_ns: IntArray | int) -> Any:
    """Convert ROS times [ns] to seconds since the recording's first joint state."""
    return (time_ns - run.recording.joint_states.time_ns[0]) / 1e9


def limit_time_axis(run: EvaluatedRecording, axes: Axes) -> None:
    """Set limits and label of the time axis, which spans the recording's joint states."""
    axes.set(
        xlim=(0.0, to_seconds(run, int(run.recording.joint_states.time_ns[-1]))), xlabel="time [s]"
    )


def mark_take_overs(run: EvaluatedRecording, axes: Axes) -> None:
    """Draw a thin vertical line at each time at which the arm began to follow a plan.

    Args:
        run: The evaluated recording.
        axes: Axes to draw on, with time [s since the first joint state] as x.
    """
    for time_ns in find_take_over_times(run.recording).values():
        axes.axvline(
            to_seconds(run, time_ns),
            color=GREY,
            linewidth=0.7,
            linestyle=":",
            label="plan takes over",
        )


@contextmanager
def open_time_figure(
    run: EvaluatedRecording, path: Path, height: float, rows: int, columns: int = 1, **shape: Any
) -> Iterator[np.ndarray]:
    """Open a figure over time, as a context manager, and write it when the block ends.

    After the block, vertical lines mark the times at which plans took over, the time axis spans the
    recording, and a legend above has all labels.

    Args:
        run: The evaluated recording.
        path: PNG file to write.
        height: Height of the figure [in].
        rows: Number of rows of axes.
        columns: Number of columns of axes.
        **shape: Further arguments of `Figure.subplots`.

    Yields:
        Axes with a common time axis [s since the first joint state], shape (rows, columns).
    """
    with open_figure(path, height) as figure:
        axes = figure.subplots(rows, columns, sharex=True, squeeze=False, **shape)
        yield axes
        for each in axes.flat:
            mark_take_overs(run, each)
        for each in axes[-1]:
            limit_time_axis(run, each)
        legend_above(figure, *axes.flat)


def shade_modes(run: EvaluatedRecording, axes: Axes, actuator: int) -> None:
    """Draw a pale band behind each time span in which an actuator is boosted.

    The band has the colour and the label of the mode.

    Args:
        run: The evaluated recording.
        axes: Axes to draw on, with time [s since the first joint state] as x.
        actuator: Index of the actuator, from 0.
    """
    time, modes = get_mode_rows(run)
    for begin, end, mode in yield_mode_spans(modes[:, actuator]):
        if BOOSTED_MODES[mode]:
            axes.axvspan(
                time[begin],
                time[end],
                color=MODE_COLOR[mode],
                alpha=0.25,
                linewidth=0,
                label=f"mode {mode.name}",
            )


def get_mode_rows(run: EvaluatedRecording) -> tuple[FloatArray, ModeArray]:
    """Return the modes of all n actuators over time, with a last row for the recording's end.

    Args:
        run: The evaluated recording.

    Returns:
        Times from which on each row of modes is in force, shape (k,) [s since the first joint
        state], and the rows, shape (k, n). The last row repeats the one before.
    """
    schedule = run.modes
    end_ns = max(int(run.recording.joint_states.time_ns[-1]), schedule.end_ns)
    time_ns = np.append(schedule.stamp_ns + schedule.offset_ns, end_ns)
    return to_seconds(run, time_ns), np.vstack([schedule.modes, schedule.modes[-1:]])


LEAST_DISTANCE = 1e-2
"""Smallest distance on the logarithmic axis [mm]; smaller ones are drawn there."""


def draw_joints(run: EvaluatedRecording, path: Path) -> None:
    """Draw position, reference and position error of each joint over time, and write the figure.

    The error is the measured position minus the reference; it is drawn only at times with a
    reference. Positions are in deg and errors in mrad; for telescopes, both are in mm. Vertical
    lines mark the times at which plans took over.

    Args:
        run: The evaluated recording.
        path: PNG file to write.
    """
    n = run.machine.joint_count
    states, references = run.recording.joint_states, run.recording.references
    both = np.isin(states.time_ns, run.tip.time_ns)
    reference, _, _ = run.reference.sample_many(states.time_ns[both])
    error = 1e3 * (states.position[both] - reference)
    with open_time_figure(run, path, 1.2 + 2.0 * n, n, 2) as axes:
        for j, (angles, errors) in enumerate(axes):
            slides = run.machine.arrays.slides[j]
            shown = PER_MM if slides else np.degrees(1.0)
            for table, label, color, width in (
                (states, "measured", PALE, 3.5),
                (references, "reference", BLACK, 1.0),
            ):
                draw_line(
                    angles,
                    to_seconds(run, table.time_ns),
                    shown * table.position[:, j],
                    color=color,
                    linewidth=width,
                    label=label,
                )
            angles.set_ylabel(f"joint {j + 1} [{'mm' if slides else 'deg'}]")
            draw_line(
                errors,
                to_seconds(run, states.time_ns[both]),
                error[:, j],
                color=PURPLE,
                linewidth=0.9,
                label="measured − reference",
            )
            errors.set_ylabel(f"error [{'mm' if slides else 'mrad'}]")


def draw_tip_error(run: EvaluatedRecording, path: Path) -> None:
    """Draw the tip's distance from its reference and from its goal over time; write the figure.

    The upper axes show the distance from the reference [mm]. A dashed line is its root mean square,
    from the first to the last motion of the reference. The lower axes show the distance from the
    goal of the plan in force [mm], on a logarithmic scale. Distances below LEAST_DISTANCE are drawn
    at LEAST_DISTANCE. A line marks the distance that counts as reached.

    Args:
        run: The evaluated recording.
        path: PNG file to write.
    """
    time_ns = run.tip.time_ns
    error = PER_MM * run.tip.error
    goal_time_ns, distance = compute_goal_distance(run)
    with open_time_figure(run, path, 5.2, 2) as ((upper,), (lower,)):
        draw_line(upper, to_seconds(run, time_ns), error, color=GREEN, label="tip from reference")
        if np.any(run.tip.moving):
            rms = np.sqrt(np.mean(error[run.tip.moving] ** 2))
            upper.axhline(rms, color=PURPLE, linestyle="--", label=f"root mean square {rms:.2f} mm")
        upper.set_ylabel("tracking error [mm]")
        upper.set_ylim(bottom=0.0)
        draw_line(
            lower,
            to_seconds(run, goal_time_ns),
            np.maximum(PER_MM * distance, LEAST_DISTANCE),
            color=BLACK,
            label="tip from goal",
        )
        lower.axhline(
            PER_MM * REACHED_TOLERANCE, color=GREEN, linestyle="-.", label="counts as reached"
        )
        lower.set(
            ylim=(LEAST_DISTANCE, 2.0 * PER_MM * run.machine.config.workspace.max_radius),
            yscale="log",
            ylabel="distance to goal [mm]",
        )


def compute_goal_distance(run: EvaluatedRecording) -> tuple[IntArray, FloatArray]:
    """Compute the distance of the measured tip from its goal at each time.

    At each time, the goal of the plan in force counts. Times before the first plan took over are
    left out.

    Args:
        run: The evaluated recording.

    Returns:
        ROS times, int64 (k,) [ns], and distances at these times, shape (k,) [m]. Both are empty if
        no plan took over.
    """
    taken_over = sorted(
        (goal.taken_over_ns, goal.verdict.goal.position)
        for goal in run.goals
        if goal.taken_over_ns is not None
    )
    since_ns = np.array([since for since, _ in taken_over], dtype=np.int64)
    row = np.searchsorted(since_ns, run.tip.time_ns, "right") - 1
    sent = row >= 0
    if not taken_over:
        return run.tip.time_ns[sent], np.empty(0)
    at = np.array([position for _, position in taken_over])
    away = run.tip.measured[sent] - at[row[sent]]
    return run.tip.time_ns[sent], np.linalg.norm(away, axis=1)


PRESSURE_HEADROOM = 1.15
"""Upper end of the pressure axis over the highest pressure [-]."""
Planned = tuple[FloatArray, str, str, str]
"""Planned energy to draw: values [J], label, colour and line style."""


def draw_modes(run: EvaluatedRecording, path: Path) -> None:
    """Draw the actuators' modes and the number of booster modules in use over time.

    The upper panel has a bar for each actuator, coloured by mode. The lower panel shows the number
    of modules in use and the number that the machine has. Vertical lines mark the times at which
    plans took over.

    Args:
        run: The evaluated recording.
        path: PNG file to write.
    """
    n = run.machine.joint_count
    heights = (0.5 * n, 1.0)
    with open_time_figure(run, path, 2.4 + 0.5 * n, 2, height_ratios=heights) as (
        (bars,),
        (modules,),
    ):
        labels = {mode: f"mode {mode.name}" for mode in Mode}
        draw_labelled_mode_bars(*get_mode_rows(run), labels, bars)
        _draw_modules(run, modules)


def _draw_modules(run: EvaluatedRecording, axes: Axes) -> None:
    """Draw how many booster modules are in use over time [s].

    Args:
        run: The evaluated recording.
        axes: Axes to draw on. A dashed line marks the number of modules that the machine has.
            Limits, ticks and label of the y axis are set.
    """
    fitted = run.machine.config.hydraulics.modules
    time, modes = get_mode_rows(run)
    used = [count_modules(row, fitted.per_mode) for row in modes]
    axes.step(time, used, where="post", color=BLACK, label="booster modules in use")
    axes.axhline(fitted.count, color=GREY, linestyle="--", label="modules fitted")
    axes.set_ylim(-0.2, fitted.count + 0.4)
    axes.set_yticks(range(fitted.count + 1))
    axes.set_ylabel("modules")


def draw_pressures(run: EvaluatedRecording, path: Path) -> None:
    """Draw each actuator's chamber and supply pressures [MPa] over time, and write the figure.

    There is a panel for each actuator. A dashed line marks the main pump's pressure P_S. Further
    lines mark the relief pressures of supply line and chambers; if one is beyond the axis,
    the panel's title names it. Coloured bands mark times in a boosted mode, vertical lines the
    times at which plans took over.

    Args:
        run: The evaluated recording.
        path: PNG file to write.
    """
    n = run.machine.joint_count
    table = run.recording.actuators
    time = to_seconds(run, table.time_ns)
    lines = (
        ("cap_pressure", "cap-side chamber", GREEN),
        ("rod_pressure", "rod-side chamber", PURPLE),
        ("supply_pressure", "supply line", BLACK),
    )
    with open_time_figure(run, path, 1.2 + 2.4 * n, n, sharey=True) as axes:
        for j, each in enumerate(axes[:, 0]):
            shade_modes(run, each, j)
            for quantity, label, color in lines:
                draw_line(
                    each,
                    time,
                    PER_MPA * table.quantity[quantity][:, j],
                    color=color,
                    linewidth=1.0,
                    label=label,
                )
            draw_pressure_limits(run, each, j)
            each.set_ylabel(f"actuator {j + 1} [MPa]")


def draw_pressure_limits(run: EvaluatedRecording, axes: Axes, actuator: int) -> None:
    """Set the pressure axis of one actuator's panel [MPa], and draw P_S and relief pressures.

    The axis goes from 0 to PRESSURE_HEADROOM times the highest pressure of all actuators, or times
    P_S if that is higher. P_S, the main pump's pressure, is a dashed line. The relief pressures of
    supply line and chambers are lines if they are on the axis. Otherwise the title names them.

    Args:
        run: The evaluated recording.
        axes: Axes of the actuator.
        actuator: Index of the actuator, from 0.
    """
    normal, quantity = run.machine.arrays.supply_pressure, run.recording.actuators.quantity
    seen = [quantity[name] for name in ("cap_pressure", "rod_pressure", "supply_pressure")]
    highest = PRESSURE_HEADROOM * max(normal, np.max(seen, initial=0.0))
    axes.axhline(PER_MPA * normal, color=GREY, linestyle="--", label="main pump, $P_S$")
    beyond = []
    for pressure, label, style in (
        (run.machine.config.circuit.line_relief_pressure, "line relief", "--"),
        (float(run.machine.chamber_reliefs[actuator]), "chamber relief", "-."),
    ):
        if pressure <= highest:
            axes.axhline(PER_MPA * pressure, color=BROWN, linestyle=style, label=label)
        else:
            beyond.append(f"{label} at {PER_MPA * pressure:g} MPa")
    axes.set_title(", ".join(beyond), loc="left", fontsize=8, color=GREY)
    axes.set_ylim(0.0, PER_MPA * highest)


def draw_energy(run: EvaluatedRecording, path: Path) -> None:
    """Draw measured and planned energy and power over time, and write the figure.

    The upper panel stacks the measured energies of main pump and servo pumps [J] since the first
    report of the simulator. One line shows the energy by the planner's model, another the energy
    that one pump at constant pressure takes. The title has the last values, and the saving. The
    lower panel shows the mean power between consecutive reports [W]. Title and powers are left out
    if there are fewer than two reports.

    Args:
        run: The evaluated recording.
        path: PNG file to write.
    """
    energy = run.energy
    time = to_seconds(run, energy.time_ns)
    pressure = PER_MPA * energy.one_pump_pressure
    planned: list[Planned] = [
        (energy.one_pump, f"one pump at constant {pressure:.1f} MPa (highest need)", BLACK, "-"),
        (energy.planned_series, "planner's model of what was followed", PURPLE, "--"),
    ]
    with open_time_figure(run, path, 6.0, 2, height_ratios=(3, 2)) as ((upper,), (lower,)):
        upper.stackplot(
            time,
            energy.main_pump,
            energy.servo_pumps,
            colors=(TEAL, YELLOW),
            alpha=0.7,
            linewidth=0,
            labels=("measured, main pump", "measured, servo pumps"),
        )
        for total, label, color, style in planned:
            upper.plot(time, total, color=color, linestyle=style, label=label)
        upper.set_ylabel("energy [J]")
        upper.set_ylim(bottom=0.0)
        if len(time) > 1:
            _draw_power(lower, time, np.vstack([energy.main_pump, energy.measured]), planned)
            upper.set_title(energy.describe_saving())
        lower.set_ylabel("power [W]")
        lower.set_ylim(bottom=0.0)


def _draw_power(axes: Axes, time: FloatArray, measured: FloatArray, planned: list[Planned]) -> None:
    """Draw measured and planned mean power [W] between consecutive reports of the simulator.

    The powers of main pump and servo pumps are stacked. Each planned energy gives a line.

    Args:
        axes: Axes to draw on. Axis labels, and labels for a legend, are not set.
        time: Time of each report, shape (k,) [s], k ≥ 2.
        measured: Energy delivered up to each report, by the main pump (row 0) and by all pumps (row
            1), shape (2, k) [J].
        planned: Energies planned up to each report, each an array of shape (k,) [J] with label,
            colour and line style. The label is not used.
    """
    span = np.diff(time)
    main_pump, all_pumps = np.diff(measured) / span
    axes.stairs(main_pump, time, fill=True, color=TEAL, alpha=0.7, linewidth=0)
    axes.stairs(
        all_pumps, time, baseline=main_pump, fill=True, color=YELLOW, alpha=0.7, linewidth=0
    )
    for total, _, color, style in planned:
        axes.stairs(np.diff(total) / span, time, baseline=None, color=color, linestyle=style)


PANEL_LABELS = {
    "payload": ("payload [kg]", 1.0),
    "friction": ("friction [times the file's]", 1.0),
    "leakage": ("leakage [times the file's]", 1.0),
    "overlap": ("overlap [% of the stroke]", 100.0),
    "valve_gain": ("valve gain [times the file's]", 1.0),
    "bulk_modulus": ("bulk modulus [times the file's]", 1.0),
    "pump_lag": ("lag of pumps [ms]", 1e3),
    "delay": ("delay [ms]", 1e3),
    "valve_lag": ("lag of valves [ms]", 1e3),
}
"""Label of each drawn quantity, and factor from its SI unit to the unit of the label."""

JOINT_COLORS = (GREEN, PURPLE, BROWN, TEAL)
BAND_OPACITY, WIDE_BAND_OPACITY = 0.22, 0.07
"""Opacity of an interval, and of one that the motion has not determined yet."""


Courses = dict[tuple[str, str], list[tuple[float, Estimate]]]
"""Estimates over time: by quantity and actuator, pairs of time [s] and estimate."""


def draw_estimates(run: EvaluatedRecording, path: Path) -> None:
    """Draw the servo's estimates of machine parameters over time, and write the figure.

    There is a panel for each quantity in PANEL_LABELS that has estimates. Each estimate has its 95
    % interval, which is paler while the motion has not yet determined the quantity.

    Args:
        run: The evaluated recording; it must have estimates of at least one quantity in
            PANEL_LABELS.
        path: PNG file to write.
    """
    courses = group_estimates(run)
    with open_figure(path, 1.0 + 1.3 * len(_find_drawn_quantities(courses))) as figure:
        draw_estimate_panels(run, courses, figure)


def group_estimates(run: EvaluatedRecording) -> Courses:
    """Collect the servo's estimates in a recording by quantity and actuator.

    Args:
        run: The evaluated recording.

    Returns:
        A dictionary. The key is a pair: name of the quantity and name of the actuator. The name of
        the actuator is empty for a quantity of the whole arm. The value is a list of pairs in time
        order: time [s since the first joint state] and estimate.
    """
    courses: Courses = defaultdict(list)
    for timed in run.recording.estimates:
        for each in timed.value:
            courses[each.quantity, each.actuator].append((to_seconds(run, timed.time_ns), each))
    return courses


def _find_drawn_quantities(estimate_series: Courses) -> list[str]:
    """Return the quantities that have estimates and a panel, in the order of PANEL_LABELS."""
    return [
        quantity
        for quantity in PANEL_LABELS
        if any(quantity == name for name, _ in estimate_series)
    ]


def draw_estimate_panels(run: EvaluatedRecording, estimate_series: Courses, figure: Figure) -> None:
    """Draw a panel over time for each estimated quantity, and one legend for all.

    The 95 % interval is drawn as a band, which is paler while the motion has not yet determined the
    quantity. The panels have the units of PANEL_LABELS; quantities that are not in it are left out.

    Args:
        run: The evaluated recording, for the time axis.
        estimate_series: Estimates over time, by quantity and actuator, as `group_estimates` returns
            them. At least one quantity must be in PANEL_LABELS.
        figure: Figure that receives the panels.
    """
    drawn = _find_drawn_quantities(estimate_series)
    panels = figure.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0]
    for axes, quantity in zip(panels, drawn, strict=True):
        _draw_quantity(quantity, estimate_series, axes)
    for label, alpha in (
        ("95 % interval", BAND_OPACITY),
        ("the same, not known yet", WIDE_BAND_OPACITY),
    ):
        panels[-1].fill_between([], [], color=BLACK, alpha=alpha, linewidth=0, label=label)
    limit_time_axis(run, panels[-1])
    legend_above(figure, *panels)


def _draw_quantity(quantity: str, estimate_series: Courses, axes: Axes) -> None:
    """Draw the estimates of one quantity over time.

    Each actuator, or the whole arm, has a line and a band for the 95 % interval. The band is paler
    while the motion has not yet determined the quantity (`known` is False). Values are converted
    from SI to the unit in PANEL_LABELS.

    Args:
        quantity: Key of PANEL_LABELS.
        estimate_series: Estimates over time, by quantity and actuator, as `group_estimates` returns
            them.
        axes: Axes to draw on, with time [s] as x. The label of the y axis is set.
    """
    label, factor = PANEL_LABELS[quantity]
    owners = [owner for name, owner in estimate_series if name == quantity]
    for number, owner in enumerate(owners):
        time = np.array([moment for moment, _ in estimate_series[quantity, owner]])
        learnt = [each for _, each in estimate_series[quantity, owner]]
        value = factor * np.array([each.value for each in learnt])
        wide = factor * CONFIDENCE_SIGMAS * np.array([each.deviation for each in learnt])
        known = np.array([each.known for each in learnt])
        color = JOINT_COLORS[number % len(JOINT_COLORS)] if owner else BLACK
        who = owner.replace("_", " ") if owner else "the whole arm"
        axes.plot(time, value, color=color, label=who)
        for which, alpha in ((known, BAND_OPACITY), (~known, WIDE_BAND_OPACITY)):
            axes.fill_between(
                time, value - wide, value + wide, where=which, color=color, alpha=alpha, linewidth=0
            )
    axes.set_ylabel(label.replace(" [", "\n["))
