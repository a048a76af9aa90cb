"""Files of the config folder are found, and missing ones named."""

import pytest

from mhsb_model.errors import MhsbError
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine


def test_the_machine_file_is_found_wherever_the_suite_runs():
    assert "mhsb_arm3" in find_config_file("mhsb_arm3.yaml").read_text(encoding="utf-8")


def test_a_missing_file_is_named():
    with pytest.raises(MhsbError, match=r"config/nowhere\.yaml is neither"):
        find_config_file("nowhere.yaml")


def test_both_machine_files_of_the_paper_s_arm_differ_in_nothing_but_fitted_values():
    files = [find_config_file(f"{name}.yaml") for name in ("mhsb_arm3", "mhsb_arm3_published")]
    shown, other = ([*path.read_text(encoding="utf-8").splitlines()] for path in files)
    skip = len(other) - len(shown)  # more is said of the second one at its top
    changed = {line for line in other[skip:] if line not in shown and not line.startswith("#")}
    assert changed - {"name: mhsb_arm3_published"}
    assert all("# fitted" in line for line in changed - {"name: mhsb_arm3_published"})
    assert load_machine(files[1]).name == "mhsb_arm3_published"
