"""Positions out of reach are refused before anything that takes long is compiled."""

import re

import numpy as np
import pytest

from mhsb_model.errors import OutOfWorkspaceError
from mhsb_model.machine import load_machine
from mhsb_planner.errors import InfeasibleGoalError
from mhsb_planner.posture.reach_check import check_reach

PSI_OF_SCAN = np.linspace(-np.pi, np.pi, 3600)
"""End-link angles at which postures are looked for independently [rad]."""


@pytest.fixture
def bent(machine):
    """Arm that cannot fold, so that it does not reach all of its workspace."""
    return machine.with_values({"joints.1.limits.lower": -1.9})


def is_refused(arm, position):
    try:
        check_reach(arm, position)
    except (OutOfWorkspaceError, InfeasibleGoalError):
        return True
    return False


def test_positions_in_the_workspace_are_refused_only_if_a_scan_finds_no_posture(bent):
    random, refused = np.random.default_rng(0), 0
    for _ in range(100):
        radius, angle = random.uniform(0.25, 1.029), random.uniform(-1.57, 1.57)
        position = (radius * np.cos(angle), radius * np.sin(angle))
        expected = len(bent.postures(*position, PSI_OF_SCAN)) == 0
        assert is_refused(bent, position) == expected, position
        refused += expected
    assert 0 < refused < 100


@pytest.mark.parametrize(
    ("position", "kind"),
    [((2.0, 0.1), OutOfWorkspaceError), ((0.26, -0.02), InfeasibleGoalError)],
)
def test_a_refusal_names_a_near_point_that_can_be_reached(bent, position, kind):
    with pytest.raises(kind) as caught:
        check_reach(bent, position)
    near = re.search(r"nearest grid point in reach is \((.+), (.+)\) m", str(caught.value))
    node = tuple(float(each) for each in near.groups())
    assert len(bent.postures(*node, PSI_OF_SCAN)) > 0
    distance = np.hypot(node[0] - position[0], node[1] - position[1])
    for x in np.arange(0.0, 1.05, bent.spacing):
        for z in np.arange(-1.0, 1.05, bent.spacing):
            if np.hypot(x - position[0], z - position[1]) < distance - 1e-9:
                assert is_refused(bent, (float(x), float(z)))


def test_an_arm_that_slews_is_checked_in_its_plane():
    excavator = load_machine("excavator")
    tip = tuple(excavator.tip_in_base(np.array(excavator.config.simulation.start_posture)))
    check_reach(excavator, tip)
    with pytest.raises(OutOfWorkspaceError):
        check_reach(excavator, (100.0, 0.0, 0.0))
