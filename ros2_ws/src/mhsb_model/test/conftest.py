"""The suite's own arm, for the tests of the model."""

from pathlib import Path

import pytest
import yaml

from mhsb_model.machine import Machine, default_machine_path, load_machine


@pytest.fixture(scope="session")
def machine() -> Machine:
    return load_machine()


@pytest.fixture
def content() -> dict:
    """Content of the suite's machine file, free to be spoiled."""
    return yaml.safe_load(Path(default_machine_path()).read_text(encoding="utf-8"))
