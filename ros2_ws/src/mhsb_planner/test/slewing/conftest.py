"""An excavator with thick links, and a move of half a turn to its left."""

import numpy as np
import pytest

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine, load_machine
from mhsb_planner.planner import Planner
from mhsb_planner.posture.s1_global_search import build_posture_table, find_postures_at

BEGIN = (2.6, -1.5, -0.8)


@pytest.fixture(scope="session")
def excavator() -> Machine:
    radii = {"keep_out.link_radii": [0.12, 0.10, 0.08]}
    return load_machine(find_config_file("excavator.yaml")).with_values(radii)


@pytest.fixture(scope="session")
def begin(excavator) -> np.ndarray:
    """Posture with the tip at BEGIN [rad]."""
    place = excavator.convert_to_plane(BEGIN, 0.0)
    return np.append(place.slew, find_postures_at(excavator.planar_arm, *place.tip).posture[0])


@pytest.fixture(scope="session")
def digging(excavator) -> Planner:
    """On a table of 0.36 m; not to be kept changed."""
    return Planner(
        excavator, build_posture_table(excavator.planar_arm, spacing=3 * excavator.spacing)
    )
