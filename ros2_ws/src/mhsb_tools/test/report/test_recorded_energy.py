"""Energy of a recording against the energy of the plans that it executed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.motion.energy import compute_motion_energy
from mhsb_tools.recording.recording import TimedValue
from mhsb_tools.report.recorded_energy import compute_energy_record
from mhsb_tools.report.recorded_motion import cut_trajectory
from mhsb_tools.report.recorded_moves import cut_into_moves


def test_a_motion_costs_what_its_published_plan_costs(run):
    path, schedule = run.recording.trajectories[0], run.recording.schedules[0]
    planned = compute_motion_energy(run.machine, path, schedule)
    executed = compute_motion_energy(
        run.machine, cut_trajectory(run.reference, path.stamp_ns, path.end_ns), run.modes
    )
    assert executed.paper == pytest.approx(planned.paper, rel=1e-6)
    assert executed.series == pytest.approx(planned.series, rel=1e-6)


def test_energies_grow_from_zero_at_the_first_report(run):
    energy = run.energy
    assert len(energy.time_ns) == 12
    counters = energy.main_pump, energy.servo_pumps, energy.planned_series, energy.one_pump
    for counter in (*counters, energy.planned):
        assert counter[0] == 0.0
        assert np.all(np.diff(counter) > 0.0)


def test_one_pump_fills_all_strokes_and_leaks_at_the_highest_needed_pressure(run, story):
    pressure = story.needed_pressure
    assert run.energy.one_pump_pressure == pytest.approx(pressure, rel=1e-4)
    assert run.energy.one_pump[-1] == pytest.approx(story.energy_at(pressure), rel=1e-3)


def test_the_saving_compares_the_model_with_one_pump(run, story):
    own, other = story.energy(series=True), story.energy_at(story.needed_pressure)
    words = "saves" if own < other else "costs"
    text = run.energy.describe_saving()
    assert text.startswith(f"132.0 J measured; by the planner's model {own:.1f} J, {words} ")
    assert f" {100 * abs(1.0 - own / other):.0f} % " in text
    assert f" {story.needed_pressure / 1e6:.1f} MPa for this motion (" in text


def test_a_move_counts_parts_of_the_time_between_reports(run):
    steps = 12.0 - np.diff(run.energy.planned_series)  # measured minus model, from 0.5 s on
    first = int(run.recording.joint_states.time_ns[0])
    begin, end = first + 6 * SECOND_NS, first + 21 * SECOND_NS // 2
    excess = 0.5 * steps[5] + steps[6:10].sum()
    assert run.energy.compute_excess(begin, end) == pytest.approx(excess, rel=1e-9)
    path = cut_trajectory(run.reference, begin, end)
    measured = compute_motion_energy(run.machine, path, run.modes).series + excess
    *_, last = cut_into_moves(run)
    words = last.energy_title.split()
    assert float(words[1]) == pytest.approx(measured, abs=1.0)
    assert words[2:5] == ["J", "measured;", "drawn"]
    assert np.isnan(run.energy.compute_excess(first, end))


def test_a_restart_of_the_simulator_is_left_out_of_both(run):
    whole = run.energy
    restarted = tuple(
        TimedValue(each.time_ns, replace(each.value, main_pump_j=each.value.main_pump_j - 150.0))
        if index >= 6
        else each
        for index, each in enumerate(run.recording.simulator_reports)
    )
    recording = replace(run.recording, simulator_reports=restarted)
    energy = compute_energy_record(recording, run.machine, run.reference, run.modes)
    assert energy.main_pump[-1] == whole.main_pump[-1] - 10.0
    lost = whole.planned[6] - whole.planned[5]
    assert energy.planned[-1] == pytest.approx(whole.planned[-1] - lost)


def test_reports_beyond_the_references_do_not_count(run):
    early = TimedValue(0, replace(run.recording.simulator_reports[0].value, sim_time_ns=0))
    recording = replace(run.recording, simulator_reports=(early, *run.recording.simulator_reports))
    energy = compute_energy_record(recording, run.machine, run.reference, run.modes)
    np.testing.assert_array_equal(energy.time_ns, run.energy.time_ns)
