import pytest

from mhsb_model.trajectory import MotionState
from mhsb_planner.planner import Planner, PlanOptions

OPTIONS = PlanOptions(planner="integrated")
LOW_LEAKAGE = {
    "hydraulics.valve.leakage_flow": 1e-7,
    "hydraulics.main_pump.pressure": 2.5e6,
    "motion.max_piston_speed": 0.03,
}


def plan(machine, table, here, there):
    start = MotionState.at_rest(table.posture[here, 0])
    goal = tuple((table.nodes[there] * table.spacing).tolist())
    return Planner(machine, table).plan(goal, start, options=OPTIONS)


@pytest.mark.parametrize(("here", "there"), [(482, 419), (0, 31)])
def test_a_plan_at_v_max_is_not_dearer_than_one_at_half_of_it(machine, table, here, there):
    quick = machine.with_values(LOW_LEAKAGE)
    slow = quick.changed(max_piston_speed=0.015)
    at_half = plan(slow, table, here, there).cost(OPTIONS)
    assert plan(quick, table, here, there).cost(OPTIONS) <= 1.001 * at_half


def test_no_slower_path_is_searched_if_leakage_costs_more_than_boost_and_switches(machine, table):
    found = plan(machine, table, 0, 31)
    assert found.motion.schedule.switch_count > 0
    assert not any("V_max" in each.proposer for each in found.log.entries)
