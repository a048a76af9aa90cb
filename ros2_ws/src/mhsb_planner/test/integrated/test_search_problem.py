"""Lower bounds on the cost to each goal posture."""

import numpy as np
import pytest

from mhsb_model.modes import Mode
from mhsb_planner.integrated.search_problem import SearchProblem
from mhsb_planner.search.lower_bound import bound_costs_between
from mhsb_planner.search.s2_search import PathQuery, Weights


@pytest.mark.parametrize("boosted", [False, True], ids=["from N", "from DB"])
def test_the_bound_on_a_goal_has_the_switches_to_its_holding_modes(
    machine, posture_within, boosted
):
    weak = machine.changed(supply_pressure=0.4 * machine.arrays.supply_pressure)
    random, held = np.random.default_rng(7), set()
    modes = np.full(3, Mode.DB if boosted else Mode.N, dtype=np.uint8)
    for _ in range(5):
        start, end = posture_within(weak, random), posture_within(weak, random)
        goal = tuple(map(float, weak.tip_position(end)))
        task = SearchProblem.create(weak, PathQuery(start, modes, goal, Weights(0.5, 1.0, 2.0)))
        t, goals = task.cost_model, task.goals
        moves = bound_costs_between(t.circuit, task.start_lengths, goals.length, t.weight)
        m = weak.arrays
        for k, posture in enumerate(goals.posture):
            force = weak.piston_forces(posture)
            load = np.where(
                force > 0.0,
                (force + m.rod_area * m.tank_pressure) / m.cap_area,
                (-force + m.cap_area * m.tank_pressure) / m.rod_area,
            )
            boost = (force != 0.0) & (load + m.boost_margin > m.supply_pressure)
            switches = np.count_nonzero(boost != boosted)
            held.add(switches)
            expected = moves[k] + t.weight[2] * switches
            assert task.goal_lower_bounds[k] == pytest.approx(expected, rel=1e-12)
    assert len(held) > 1
