"""The suite's own arm, for the tests of the model."""

import pytest
import yaml

from mhsb_model.files.config_files import config_file
from mhsb_model.machine import MACHINE_FILE, Machine, load_machine


@pytest.fixture(scope="session")
def machine() -> Machine:
    return load_machine()


@pytest.fixture(scope="session")
def telescope_machine() -> Machine:
    """Two booms, of which the second extends."""
    return load_machine(config_file("telescope_arm.yaml"))


@pytest.fixture
def content() -> dict:
    """Content of the suite's machine file, free to be spoiled."""
    return yaml.safe_load(config_file(MACHINE_FILE).read_text(encoding="utf-8"))
