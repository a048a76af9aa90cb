import numpy as np
import pytest

from mhsb_control import select_controllers
from mhsb_model.machine import Machine
from mhsb_planner.kernel_parts import compile_planner
from mhsb_tools.study import draws
from mhsb_tools.study.draw_limits import as_text
from mhsb_tools.study.draws import DrawStudy, as_dicts
from mhsb_tools.study.variations import Variation, load_variations


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """So that no test's time includes it."""
    compile_planner()


def test_a_draw_is_the_same_whenever_it_is_made_and_judges_every_controller(
    machine: Machine,
) -> None:
    study = DrawStudy(machine, load_variations(machine), seed=5, goals=3)  # for the sake of time
    records = study.run_draw(3)
    assert tuple(record.controller for record in records) == select_controllers(machine)
    for record in records:
        assert record.draw == 3
        assert set(record.varied) == set(load_variations(machine))
        assert 0.0 < record.tip_error_rms_mm <= record.tip_error_max_mm
        assert record.relief_opened in (True, False)
        assert 0.0 <= record.time_lost < 5.0
        assert record.interventions > 0 or record.time_lost == 0.0
        assert record.later_percent >= 0.0
        assert 0.0 < record.rest_error_mm <= record.tip_error_max_mm
        assert 0.0 <= record.spool_deviation_percent < 20.0
    assert records[0].varied == records[1].varied
    again = study.run_draw(3)
    assert as_dicts(again) == as_dicts(records)


def test_a_sequence_has_six_goals_and_its_moments_are_moments_of_motion(machine: Machine) -> None:
    study = DrawStudy(machine, load_variations(machine), seed=5)
    sequence = study.draw_sequence(np.random.default_rng((5, 4)))
    assert 0 < len(sequence.commands) <= draws.GOAL_COUNT
    gaps = np.diff([command.stamp_ns for command in sequence.commands]) / 1e9
    assert gaps.min() >= draws.MIN_INTERVAL - 1e-3
    for share in np.linspace(0.0, 1.0, 11):
        time_ns = round(sequence.motion_time(share) * 1e9)
        running = [c for c in sequence.commands if c.stamp_ns <= time_ns][-1]
        assert time_ns <= running.trajectory.end_ns
    assert sequence.motion_time(0.0) < sequence.motion_time(0.5) < sequence.motion_time(1.0)


def test_a_draw_that_throws_is_a_record_that_fails(machine: Machine) -> None:
    odd = {"tank": Variation(keys=("hydraulics.tank_pressure",), value=(9e5, 9e5), source="x")}
    odd["supply"] = Variation(keys=("hydraulics.main_pump.pressure",), value=(5e5, 5e5), source="x")
    records = DrawStudy(machine, odd, seed=0).run_draw(0)
    assert len(records) == len(select_controllers(machine))
    for record in records:
        assert "must be below the supply pressure" in record.failure
        assert record.tip_error_rms_mm is None
    assert any("draw 0: " in line for line in as_text(records))
