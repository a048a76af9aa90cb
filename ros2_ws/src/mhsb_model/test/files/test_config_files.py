"""Files of the config folder are found, and missing ones named."""

import pytest

from mhsb_model.errors import MhsbError
from mhsb_model.files.config_files import config_file


def test_the_machine_file_is_found_wherever_the_suite_runs():
    assert "mhsb_arm3" in config_file("mhsb_arm3.yaml").read_text(encoding="utf-8")


def test_a_missing_file_is_named():
    with pytest.raises(MhsbError, match=r"config/nowhere\.yaml is neither"):
        config_file("nowhere.yaml")
