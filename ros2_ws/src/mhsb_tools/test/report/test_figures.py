"""The figures are drawn, show something, and lose no peak."""

from __future__ import annotations

from dataclasses import replace

import matplotlib.image
import numpy as np
import pytest
from matplotlib.figure import Figure

from mhsb_model.arm_reports import Estimate
from mhsb_model.figure_style import DOTS_PER_INCH, FIGURE_WIDTH, choose_extreme_points
from mhsb_model.modes import Mode
from mhsb_model.verdict import Verdict
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_tools.moves.move_page import yield_mode_spans
from mhsb_tools.moves.operating_regions import determine_operating_regions
from mhsb_tools.recording.bag_reader import read_recording
from mhsb_tools.recording.recording import TimedValue
from mhsb_tools.report import report_command
from mhsb_tools.report.recorded_run import evaluate_recording
from mhsb_tools.report.time_figures import (
    draw_estimate_panels,
    draw_pressure_limits,
    get_mode_rows,
    group_estimates,
)
from mhsb_tools.report.workspace_figure import _draw_goals

NAMES = ["energy.png", "joints.png", "modes.png", "pressures.png", "tip_error.png", "workspace.png"]


@pytest.fixture(scope="module")
def drawn(run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures")
    regions = determine_operating_regions(run.machine, load_or_build_table(run.machine))
    report_command.draw_all(run, regions, folder)
    return folder


def count_colors(picture):
    return len(np.unique((255 * picture).astype(np.uint32) @ np.array([1, 256, 65536], np.uint32)))


@pytest.mark.parametrize("name", NAMES)
def test_each_figure_has_its_size_and_is_not_blank(drawn, name):
    picture = matplotlib.image.imread(drawn / name)[..., :3]
    if name != "workspace.png":
        assert picture.shape[1] == FIGURE_WIDTH * DOTS_PER_INCH
    assert count_colors(picture) > 50
    inside = picture[100:-100, 150:-150]
    assert np.mean(np.any(inside < 0.99, axis=2)) > 0.01


def test_the_pressure_axis_ends_at_the_pressures_and_reliefs_beyond_it_are_named(run):
    axes = Figure().subplots()
    draw_pressure_limits(run, axes, 0)
    quantity = run.recording.actuators.quantity
    highest = max(
        run.machine.arrays.supply_pressure,
        *(quantity[f"{name}_pressure"].max() for name in ("cap", "rod", "supply")),
    )
    top = 1e6 * axes.get_ylim()[1]
    assert highest < top <= 1.2 * highest
    reliefs = {
        "line": run.machine.config.circuit.line_relief_pressure,
        "chamber": float(run.machine.chamber_reliefs[0]),
    }
    labels = [line.get_label() for line in axes.lines]
    for name, pressure in reliefs.items():
        words = f"{name} relief at {1e-6 * pressure:g} MPa"
        assert (f"{name} relief" in labels) == (pressure <= top)
        assert (words in axes.get_title(loc="left")) == (pressure > top)


def test_a_refused_goal_does_not_hide_an_accepted_one_at_its_place(run):
    accepted = run.goals[0]
    refused = replace(accepted, verdict=replace(accepted.verdict, code=Verdict.NO_STATE, plan=None))
    axes = Figure().subplots()
    _draw_goals(replace(run, goals=(accepted, refused)), axes)
    circle, cross = axes.lines
    assert cross.get_zorder() < circle.get_zorder()
    assert cross.get_markersize() > circle.get_markersize()
    first, second = axes.texts
    assert (first.get_text(), second.get_text()) == ("1", "2")
    axes.figure.draw_without_rendering()
    assert not first.get_window_extent().overlaps(second.get_window_extent())


def test_nothing_half_written_is_left(drawn):
    assert sorted(path.name for path in drawn.iterdir()) == NAMES


def test_a_recording_without_plans_and_reports_is_drawn_all_the_same(idle_bag, machine, tmp_path):
    idle = evaluate_recording(read_recording(idle_bag), machine)
    regions = determine_operating_regions(machine, load_or_build_table(machine))
    report_command.draw_all(idle, regions, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == NAMES


def learnt_in(run):
    """The run with estimates that become known on the way."""
    times = np.linspace(*run.recording.joint_states.time_ns[[0, -1]], 20).astype(np.int64)
    heard = []
    for k, time_ns in enumerate(times):
        spread, known = 2.0 / (1 + k), k > 4
        values = [Estimate("payload", "", 10.0 + spread, spread, known)]
        shared = ("pump_lag", "delay", "valve_lag")
        values += [Estimate(name, "", 0.02, 0.01, known) for name in shared]
        for actuator in run.machine.actuator_names:
            values += [
                Estimate(quantity, actuator, 1.0 - 0.1 * spread, 0.1 * spread, known)
                for quantity in ("friction", "leakage", "valve_gain")
            ]
            values.append(Estimate("overlap", actuator, 0.02, 0.01 * spread, known))
        heard.append(TimedValue(int(time_ns), values))
    return replace(run, recording=replace(run.recording, estimates=tuple(heard)))


def test_what_the_servo_has_learnt_is_drawn_where_it_has_told_it(run, tmp_path):
    regions = determine_operating_regions(run.machine, load_or_build_table(run.machine))
    report_command.draw_all(learnt_in(run), regions, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {*NAMES, "estimates.png"}
    picture = matplotlib.image.imread(tmp_path / "estimates.png")[..., :3]
    assert picture.shape[1] == FIGURE_WIDTH * DOTS_PER_INCH
    assert count_colors(picture) > 50


def test_lag_and_delay_are_drawn_in_ms_and_a_legend_tells_what_pale_means(run):
    learnt, figure = learnt_in(run), Figure(layout="constrained")
    draw_estimate_panels(learnt, group_estimates(learnt), figure)
    labels = {axes.get_ylabel(): axes for axes in figure.axes}
    for label in ("lag of pumps\n[ms]", "delay\n[ms]"):
        assert labels[label].lines[0].get_ydata() == pytest.approx(20.0)
    assert not any("bulk" in label for label in labels)  # of which nothing was told
    told = [text.get_text() for text in figure.legends[0].get_texts()]
    assert sorted(told) == sorted([
        "the whole arm", "actuator 1", "actuator 2", "actuator 3",
        "95 % interval", "the same, not known yet",
    ])  # fmt: skip


def test_thinning_keeps_every_peak():
    values = np.sin(np.linspace(0.0, 20.0, 100_000))
    values[[3_333, 77_777]] = 5.0, -5.0
    rows = choose_extreme_points(values, max_points=500)
    assert len(rows) <= 500
    assert {3_333, 77_777} <= set(rows.tolist())
    assert np.all(np.diff(rows) > 0)


@pytest.mark.parametrize("count", [0, 1, 500])
def test_few_points_are_all_drawn(count):
    np.testing.assert_array_equal(
        choose_extreme_points(np.zeros(count), max_points=500), np.arange(count)
    )


def test_spans_of_modes_cover_the_recording(run):
    time, modes = get_mode_rows(run)
    spans = [(time[begin], time[end], mode) for begin, end, mode in yield_mode_spans(modes[:, 0])]
    assert spans == [
        (0.0, pytest.approx(10.0), Mode.N),
        (pytest.approx(10.0), pytest.approx(12.0), Mode.DB),
    ]
