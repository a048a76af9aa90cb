"""Mode schedules: zero-order hold over integer times."""

from dataclasses import replace

import numpy as np
import pytest

from mhsb_model.mode_schedule import LONG_AGO_NS, ModeSchedule

SCHEDULE = ModeSchedule(100, [0, 10, 30], [[0, 0], [1, 0], [2, 1]])


@pytest.mark.parametrize(
    ("time", "modes"),
    [(0, [0, 0]), (100, [0, 0]), (109, [0, 0]), (110, [1, 0]), (130, [2, 1]), (10**12, [2, 1])],
)
def test_a_row_is_in_force_from_its_time_until_the_next(time, modes):
    assert SCHEDULE.modes_at(time).tolist() == modes
    assert SCHEDULE.modes_at_many(np.array([time]))[0].tolist() == modes


def test_switches_count_every_actuator_that_changes():
    assert SCHEDULE.switch_count == 3


def test_a_schedule_knows_when_each_actuator_was_last_switched():
    assert SCHEDULE.find_last_switches(99).tolist() == [LONG_AGO_NS, LONG_AGO_NS]
    assert SCHEDULE.find_last_switches(110).tolist() == [110, LONG_AGO_NS]
    assert SCHEDULE.find_last_switches(10**12).tolist() == [130, 130]
    later = ModeSchedule(100, [0, 10], [[0, 0], [1, 0]], [40, 90])
    assert later.find_last_switches(105).tolist() == [40, 90]
    assert replace(later, stamp_ns=105).find_last_switches(115).tolist() == [115, 90]
    with pytest.raises(ValueError, match="one time for each actuator"):
        ModeSchedule(100, [0], [[0, 0]], [40])


def test_another_stamp_moves_all_times():
    later = replace(SCHEDULE, stamp_ns=105)
    assert later.modes_at(114).tolist() == [0, 0]
    assert later.end_ns == SCHEDULE.end_ns + 5


@pytest.mark.parametrize(
    ("offset", "modes", "sentence"),
    [
        ([], [], "at least one row"),
        ([5], [[0]], "start at 0"),
        ([0, 0], [[0], [1]], "increase strictly"),
        ([0], [[0], [1]], "one row of actuators for each time"),
        ([0], [[3]], "must be 0 .N., 1 .DB. or 2 .SB."),
    ],
)
def test_a_malformed_schedule_is_refused_with_a_sentence(offset, modes, sentence):
    with pytest.raises(ValueError, match=sentence):
        ModeSchedule(0, offset, modes)
