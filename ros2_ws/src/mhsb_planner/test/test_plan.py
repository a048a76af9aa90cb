"""Summary of a plan, and the table that it writes."""

import csv
import re

import numpy as np
import pytest

from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_planner.errors import RequestError
from mhsb_planner.motion.motion_table import format_mode_intervals
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.search.s2_search import Weights


@pytest.fixture(scope="module")
def plan(machine, table):
    """A motion in which an actuator is boosted for a while."""
    planner = Planner(machine, table)
    start = MotionState.at_rest(table.posture[planner.graph.grid.node_at(0.55, -0.05), 0])
    plan = planner.plan(
        (0.55, 0.60), start, options=PlanOptions(Weights(0, 15, 2), planner="table")
    )
    assert plan.motion.scheduled.switch_count == plan.motion.schedule.switch_count > 0
    return plan


def test_the_gap_is_that_of_the_energy_in_the_reading_of_the_plan(machine, table, plan):
    start = MotionState.at_rest(plan.motion.trajectory.position[0])
    options = PlanOptions(Weights(0, 15, 2), planner="table", energy_reading="series")
    in_series = Planner(machine, table).plan((0.55, 0.60), start, options=options)
    assert in_series.energy.series < 0.999 * in_series.energy.paper
    assert in_series.gap == pytest.approx(in_series.energy.series / in_series.lower_bound - 1)
    assert f"{100 * in_series.gap:.0f} % above the lower bound" in str(in_series)


def test_arguments_of_a_wrong_type_are_refused_in_one_sentence(machine, table):
    planner, posture = Planner(machine, table), machine.config.simulation.start_posture
    start = MotionState.at_rest(posture)
    with pytest.raises(RequestError, match=r"must be a MotionState; at rest: MotionState.at_rest"):
        planner.plan((0.55, 0.60), posture)
    with pytest.raises(RequestError, match=r"must be a Deadline: Deadline.after"):
        planner.plan((0.55, 0.60), start, deadline=0.05)
    with pytest.raises(RequestError, match=r"must be Weights, such as Weights"):
        PlanOptions(weights=(0.5, 0, 2))


def test_the_representation_is_one_short_line(plan):
    words = repr(plan)
    assert "\n" not in words
    assert len(words) < 80
    assert f"{plan.duration:.2f} s, {plan.energy.paper:.1f} J" in words


def test_a_printed_plan_is_a_short_summary_with_the_modes_that_are_driven(plan):
    words = str(plan)
    lines = words.splitlines()
    assert len(lines) < 15
    assert max(map(len, lines)) <= 100
    assert "from (0.550, -0.050) m to (0.550, 0.600) m" in words
    assert f"above the lower bound of {plan.lower_bound:.1f} J" in words
    schedule = plan.motion.schedule
    for j, name in enumerate(plan.machine.actuator_names):
        (line,) = (line for line in lines if f" {name}: " in line)
        changes = np.flatnonzero(np.diff(schedule.modes[:, j].astype(int))) + 1
        changes = changes[schedule.offset_ns[changes] < plan.motion.trajectory.duration_ns]
        ends = [float(end) for end in re.findall(r"until ([\d.]+) s", line)]
        assert ends == pytest.approx(schedule.offset_ns[changes] / SECOND_NS, abs=0.006)
        assert line.endswith("until the end" if len(changes) else "N throughout")


def test_modes_are_intervals_up_to_the_end_of_the_motion():
    schedule = ModeSchedule(0, np.array([0, 1, 2, 4]) * SECOND_NS, [[0, 2], [1, 2], [0, 2], [0, 0]])
    assert format_mode_intervals(schedule, 4.0, 0) == (
        "N until 1.00 s, DB until 2.00 s, N until the end"
    )
    assert format_mode_intervals(schedule, 4.0, 1) == "SB throughout"


def test_the_table_has_the_motion_with_units(plan, tmp_path):
    file = plan.to_csv(str(tmp_path / "new" / "motion.csv"))
    with file.open() as opened:
        rows = list(csv.DictReader(opened))
    trajectory, machine = plan.motion.trajectory, plan.machine
    assert len(rows) == len(trajectory.offset_ns)
    assert [float(row["time [s]"]) for row in rows] == (trajectory.offset_ns / SECOND_NS).tolist()
    for values, quantity in zip(
        trajectory.points,
        ("position [rad]", "velocity [rad/s]", "acceleration [rad/s^2]"),
        strict=True,
    ):
        for j, name in enumerate(machine.joint_names):
            assert [float(row[f"{name} {quantity}"]) for row in rows] == values[:, j].tolist()
    for row, q in zip(rows, trajectory.position, strict=True):
        tip = [float(row["tip x [m]"]), float(row["tip z [m]"])]
        assert tip == pytest.approx(machine.tip_position(q), abs=1e-12)
    for j, name in enumerate(machine.actuator_names):
        for k, row in enumerate(rows):
            mode = Mode[row[f"{name} mode"]]
            assert mode == plan.motion.schedule.modes_at(int(trajectory.offset_ns[k]))[j]
            pressure = float(row[f"{name} supply pressure [Pa]"])
            if mode is Mode.N:
                assert pressure == machine.arrays.supply_pressure
            else:
                assert pressure >= machine.arrays.supply_pressure
