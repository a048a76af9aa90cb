"""Energy of a recording against the energy of the plans that it executed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mhsb_planner.motion.energy import compute_motion_energy
from mhsb_tools.recording.recording import TimedValue
from mhsb_tools.report.recorded_energy import compute_energy_record
from mhsb_tools.report.recorded_motion import cut_trajectory


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
    for counter in (energy.main_pump, energy.servo_pumps, energy.planned, energy.planned_series):
        assert counter[0] == 0.0
        assert np.all(np.diff(counter) > 0.0)


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
