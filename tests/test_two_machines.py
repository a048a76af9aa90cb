"""Planner and arm with different machine files: refused by name if plans depend on that."""

import pytest
import yaml

from mhsb_model.files.config_files import find_config_file
from mhsb_model.files.machine_files import MACHINE_FILE
from mhsb_model.machine import load_machine
from mhsb_model.verdict import Verdict

UP = 0.55, 0.60


def file_with(path, folder):
    """The suite's machine file with another value at a path of keys."""
    content = yaml.safe_load(find_config_file(MACHINE_FILE).read_text(encoding="utf-8"))
    part = content
    for key in path[:-2]:
        part = part[key]
    part[path[-2]] = path[-1]
    file = folder / "machine.yaml"
    file.write_text(yaml.safe_dump(content, sort_keys=True), encoding="utf-8")
    return file


def verdict_of(observer, start_planner, start_simulator, file):
    """To a goal that is sent as soon as the planner hears it."""
    start_planner()
    start_simulator("--ros-args", "-p", f"machine:={file}")
    observer.until(lambda: observer.is_matched and len(observer.references) > 0)
    return observer.request_verdict(*UP)


def test_an_arm_with_another_link_is_not_planned_for(
    observer, start_planner, start_simulator, tmp_path
):
    file = file_with(("joints", 2, "link", "length", 0.3), tmp_path)
    verdict = verdict_of(observer, start_planner, start_simulator, file)
    assert verdict.code is Verdict.MACHINE
    assert verdict.sentence.count("mhsb_arm3") == 2
    observer.until(lambda: observer.in_force_ns is not None)
    assert observer.in_force_ns == 0


def test_an_arm_with_other_gains_and_payload_is_planned_for(
    observer, start_planner, start_simulator, tmp_path
):
    file = file_with(("servo", "pressure_noise", 2e4), tmp_path)
    verdict = verdict_of(observer, start_planner, start_simulator, file)
    assert verdict.code is Verdict.OK, verdict.sentence
    observer.until(lambda: observer.simulator_reports)
    report = observer.simulator_reports[-1]
    assert (report.machine, report.machine_hash) == ("mhsb_arm3", observer.machine.planning_hash)


@pytest.mark.parametrize(
    ("path", "same"),
    [
        (("payload", "mass", 3.0), True),
        (("name", "another"), True),
        (("circuit", "bulk_modulus", 1e9), True),
        (("servo", "length_noise", 1e-4), True),
        (("workspace", "spacing", 0.06), True),
        (("joints", 0, "limits", "upper", 1.0), False),
        (("joints", 1, "cylinder", "bore", 0.041), False),
        (("joints", 2, "link", "length", 0.3), False),
        (("hydraulics", "main_pump", "pressure", 6e6), False),
        (("motion", "max_piston_jerk", 3.0), False),
        (("workspace", "max_radius", 0.9), False),
    ],
    ids=str,
)
def test_the_hash_is_of_what_planner_and_arm_must_have_alike(machine_of, path, same):
    assert (machine_of(path).planning_hash == machine_of(()).planning_hash) == same


@pytest.fixture
def machine_of(tmp_path):
    """Function (path): the machine with another value, or as it is without one."""
    return lambda path: load_machine(file_with(path, tmp_path) if path else None)
