"""The moves of a recording: when they begin and end, and what their pages are drawn from."""

from dataclasses import replace

import numpy as np
import pytest

from mhsb_model.modes import Mode
from mhsb_tools.recording.bag_format import BagError
from mhsb_tools.recording.bag_reader import read_recording
from mhsb_tools.recording.recording import ActuatorTable
from mhsb_tools.report import report_command
from mhsb_tools.report.recorded_moves import cut_into_moves, get_whole_run_as_move
from mhsb_tools.report.recorded_run import evaluate_recording


def test_a_move_lasts_from_its_take_over_to_the_next_or_to_its_rest(run):
    moves = cut_into_moves(run)
    taken_over = sorted(goal.taken_over_ns for goal in run.goals if goal.taken_over_ns)
    assert len(moves) == len(taken_over) > 1
    for move, begin, end in zip(moves[:-1], taken_over, taken_over[1:], strict=False):
        assert move.duration <= (end - begin) / 1e9 + 1e-9
    for move, goal in zip(moves, [each for each in run.goals if each.taken_over_ns], strict=True):
        assert move.goals == (goal.verdict.goal.position,)
        assert f"({goal.verdict.goal.x:.4g}, {goal.verdict.goal.z:.4g}) m" in move.title


def test_a_move_has_what_was_recorded_at_its_instants(run):
    whole, begin_ns = get_whole_run_as_move(run, "all")
    table = run.recording.actuators
    rows = np.isin(table.time_ns, begin_ns + (1e9 * whole.time).round().astype(np.int64))
    assert len(whole.time) > 1000
    np.testing.assert_array_equal(whole.force[-1], table.quantity["force"][rows][-1])
    np.testing.assert_allclose(
        whole.reference[-1], run.recording.references.position[-1], atol=1e-9
    )
    assert whole.modes[-1, 0] == Mode.DB
    assert np.abs(whole.position - whole.reference).max() < 3e-3


def test_a_recorded_move_says_how_long_it_rests_at_its_end(run):
    *_, last = cut_into_moves(run)  # moves from 6 s up to the sample before 10 s, then rests
    assert last.heading.endswith("reached: 4.49 s, the last 0.5 s at rest")


def test_without_reports_of_the_pumps_no_measured_energy_is_named(idle_bag, machine):
    idle = evaluate_recording(read_recording(idle_bag), machine)
    whole, _ = get_whole_run_as_move(idle, "all")
    assert whole.energy_title.startswith("energy: not measured; drawn by the planner's model:")


def test_the_energy_of_a_move_closes(run):
    energy = get_whole_run_as_move(run, "all")[0].energy
    given = -sum(value for value in energy.values() if value < 0.0)
    assert abs(sum(energy.values())) < 1e-6 * given


def test_a_recording_without_hydraulic_states_says_so(run):
    nothing = ActuatorTable(np.empty(0, dtype=np.int64), {})
    without = replace(run, recording=replace(run.recording, actuators=nothing))
    assert cut_into_moves(without) == []
    with pytest.raises(BagError, match="no actuator_states"):
        get_whole_run_as_move(without, "all")


def test_each_move_gets_its_page(run, tmp_path):
    report_command.draw_moves(run, tmp_path)
    files = list(tmp_path.iterdir())
    count = len(cut_into_moves(run))
    assert {file.name for file in files} == {f"move_{k + 1}.png" for k in range(count)}
    assert all(file.stat().st_size > 10_000 for file in files)
    assert count > 0


def test_a_recording_without_goals_has_no_moves(run):
    assert cut_into_moves(replace(run, goals=())) == []
