"""The suite's own arm, for the tests of the model."""

import copy

import pytest
import yaml

from mhsb_model.files.config_files import config_file
from mhsb_model.machine import MACHINE_FILE, Machine, load_machine
from mhsb_model.schema import MachineConfig


@pytest.fixture(scope="session")
def machine() -> Machine:
    return load_machine()


@pytest.fixture(scope="session")
def telescope_machine() -> Machine:
    """Two booms, of which the second extends."""
    return load_machine(config_file("telescope_arm.yaml"))


SLEW = {
    "kind": "slew",
    "link": {"length": 0.1, "mass": 20.0, "center_of_mass": -0.05, "inertia": 0.4},
    "limits": {"lower": -2.0, "upper": 2.0},
    "linkage": {"kind": "rack_and_pinion", "pitch_radius": 0.05, "bore": 0.025},
}
"""Of a turntable on which the suite's own arm stands."""


@pytest.fixture
def slewing_content(content: dict) -> dict:
    """Content of the suite's machine file, the arm on a turntable, free to be spoiled."""
    return on_a_turntable(content)


@pytest.fixture(scope="session")
def slewing_machine() -> Machine:
    """The suite's own arm on a turntable."""
    content = yaml.safe_load(config_file(MACHINE_FILE).read_text(encoding="utf-8"))
    return Machine.from_config(MachineConfig.model_validate(on_a_turntable(content)))


def on_a_turntable(content: dict) -> dict:
    """A machine file of three joints with a fourth beneath."""
    for joint in content["joints"]:
        joint["kind"] = "revolute"
    content["joints"].insert(0, copy.deepcopy(SLEW))
    content["schema_version"] = 2
    content["simulation"]["start_posture"].insert(0, 0.0)
    return content


@pytest.fixture
def content() -> dict:
    """Content of the suite's machine file, free to be spoiled."""
    return yaml.safe_load(config_file(MACHINE_FILE).read_text(encoding="utf-8"))
