"""The lower bound, against a hand calculation."""

import numpy as np
import pytest
from tests.support.lower_bounds import energy_lower_bound

START = np.array([0.2, -0.8, -0.3])


def test_nothing_to_do_costs_nothing(machine):
    assert energy_lower_bound(machine, START, START[None, :]) == 0.0


@pytest.mark.parametrize(("change", "area"), [(0.3, 490.87e-6), (-0.3, 377.77e-6)])
def test_one_joint_pays_supply_pressure_for_its_oil_and_the_leakage(machine, change, area):
    goal = START + [change, 0.0, 0.0]
    stroke = abs(machine.cylinder_lengths(goal)[0] - machine.cylinder_lengths(START)[0])
    leakage = 3 * machine.config.hydraulics.valve.leakage_flow
    by_hand = 4e6 * (area * stroke + leakage * stroke / 0.012)
    assert energy_lower_bound(machine, START, goal[None, :]) == pytest.approx(by_hand, rel=1e-4)


def test_the_best_of_several_goal_postures_counts(machine):
    near, far = START + [0.1, 0.0, 0.0], START + [0.6, 0.3, 0.2]
    alone = energy_lower_bound(machine, START, near[None, :])
    assert energy_lower_bound(machine, START, np.array([far, near])) == alone
    assert energy_lower_bound(machine, START, far[None, :]) > alone
