import numpy as np

from mhsb_tools.viewer.plots import SnapshotHistory, Snapshots


def moment(time: float) -> Snapshots:
    return Snapshots(time, np.full(3, 4e6), np.zeros(3, dtype=np.uint8), np.full(4, time))


def test_plots_look_back_for_their_span_and_count_from_the_beginning():
    history = SnapshotHistory(2.0)
    for time in (100.0, 101.0, 102.0, 103.0):
        history.add(moment(time))
    lines = history.get_columns()
    np.testing.assert_array_equal(lines.time, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(lines.energy[:, 0], [101.0, 102.0, 103.0])
    assert lines.supply_pressure.shape == lines.modes.shape == (3, 3)


def test_time_that_goes_back_begins_anew():
    history = SnapshotHistory(2.0)
    for time in (100.0, 101.0, 5.0, 6.0):
        history.add(moment(time))
    np.testing.assert_array_equal(history.get_columns().time, [0.0, 1.0])
