"""Estimates files: what was learnt comes back, and what does not fit is refused in a sentence."""

import numpy as np
import pytest
import yaml

from mhsb_control import load_machine, make_controller
from mhsb_control.controller import ServoSignals
from mhsb_control.errors import EstimatesFileError, UnknownControllerError
from mhsb_control.estimates_file import (
    DirectionResponse,
    check_estimates_file_is_writable,
    read_estimates_file,
    write_estimates_file,
)
from mhsb_control.registry import check_keeps_estimates
from mhsb_model.circuit.components import describe_components
from mhsb_model.errors import ArgumentError
from mhsb_model.files.config_files import find_config_file


@pytest.fixture(scope="module")
def machine():
    return load_machine(find_config_file("excavator_1to14.yaml"))


def build_controller(machine, learnt=None, name="lag_compensated"):
    step = machine.config.simulation.step
    modes = np.zeros(machine.joint_count, dtype=np.uint8)
    signals = ServoSignals.at_rest(describe_components(machine, step), modes)
    return make_controller(name, machine, signals, learnt)


@pytest.fixture
def taught(machine):
    """A controller that knows all curves, with another dead band for each."""
    controller = build_controller(machine)
    for j, axis in enumerate(controller.axes):
        for side, curve in enumerate(axis.curves):
            for speed in np.tile(np.linspace(0.1, 1.0, 10), 10) * curve.speeds[7]:
                curve.learn(speed, 0.1 + 0.05 * j + 0.1 * side + 5.0 * speed, 0.2)
        axis.delay.delay, axis.delay.is_known = 0.3 + 0.02 * j, j != 2
    return controller


def test_what_was_learnt_comes_back_with_its_uncertainty(machine, taught, tmp_path):
    file = tmp_path / "learnt.yaml"
    assert read_estimates_file(file, machine) is None
    write_estimates_file(file, machine, taught.get_learnt())
    assert [each.name for each in tmp_path.iterdir()] == ["learnt.yaml"]
    again = build_controller(machine, read_estimates_file(file, machine))
    for old, new in zip(taught.axes, again.axes, strict=True):
        assert new.delay.is_known == old.delay.is_known
        expected = old.delay.delay if old.delay.is_known else 0.2
        assert new.delay.delay == pytest.approx(expected, abs=1e-4)
        for before, after in zip(old.curves, new.curves, strict=True):
            assert after.commands == pytest.approx(before.commands, abs=1e-5)
            deviations = [np.sqrt(np.diag(each.covariance)) for each in (before, after)]
            assert deviations[1] == pytest.approx(deviations[0], abs=1e-5)
            assert np.linalg.eigvalsh(after.covariance).min() > 0.0
            assert after.known_speed == pytest.approx(before.known_speed, abs=1e-5)
            assert after.known_speed >= after.speeds[7]  # no speed limit is left
    assert [each.known for each in again.estimates] == [each.known for each in taught.estimates]


def test_a_file_says_machine_date_and_units(machine, taught, tmp_path):
    file = tmp_path / "learnt.yaml"
    write_estimates_file(file, machine, taught.get_learnt())
    text = file.read_text()
    assert "Speeds in m/s" in text
    content = yaml.safe_load(text)
    assert content["machine"] == "excavator_1to14"
    assert content["machine_hash"] == machine.planning_hash
    assert content["date"].endswith("Z")
    assert set(content["actuators"]) == set(machine.actuator_names)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("delay: 0.3", "delay: 3000.3", "actuator_1.delay: must be at most 1 .is 3000.3."),
        ("delay: 0.3", "delay: [", "is not YAML"),
        ("commands: [", "commands: [0.9, ", "must have equal lengths"),
        ("speeds: [0", "speeds: [9", "must increase"),
        ("date:", "dates:", "date: is missing"),
        (
            "machine_hash: ",
            "machine_hash: 0",
            "the machine excavator_1to14 .0.*, not to exc",
        ),
        (
            'machine: "excavator_1to14"',
            'machine: "excavator"',
            "the machine excavator .*, not to excavator_1to14",
        ),
        ("  actuator_1:", "  actuator_9:", "must have the actuators actuator_1"),
    ],
)
def test_what_does_not_fit_is_refused(machine, taught, tmp_path, old, new, sentence):
    file = tmp_path / "learnt.yaml"
    write_estimates_file(file, machine, taught.get_learnt())
    file.write_text(file.read_text().replace(old, new, 1))
    with pytest.raises(EstimatesFileError, match=sentence) as found:
        read_estimates_file(file, machine)
    assert str(found.value).startswith(f"estimates file {file}: ")
    assert "delete this one so that the servo learns anew" in str(found.value)
    assert "\n" not in str(found.value)


def test_curves_with_close_knots_come_back(machine, taught, tmp_path):
    learnt, file = taught.get_learnt(), tmp_path / "learnt.yaml"
    steep = DirectionResponse(
        speeds=(0.0, 1e-7, 0.5), commands=(0.25, 0.25000004, 0.8), deviations=(1e-5,) * 3,
        known_speed=0.5,
    )  # fmt: skip
    learnt = {name: each.model_copy(update={"extending": steep}) for name, each in learnt.items()}
    write_estimates_file(file, machine, learnt)
    assert read_estimates_file(file, machine)["actuator_1"].extending == steep


def test_a_write_that_fails_is_one_sentence_and_leaves_nothing(machine, taught, tmp_path):
    folder = tmp_path / "learnt.yaml"
    folder.mkdir()
    with pytest.raises(EstimatesFileError, match=r"learnt\.yaml: it cannot be written: Is a dir"):
        write_estimates_file(folder, machine, taught.get_learnt())
    assert list(tmp_path.iterdir()) == [folder]


def test_an_unknown_controller_is_named_as_such():
    with pytest.raises(UnknownControllerError, match="there is no controller 'lag'"):
        check_keeps_estimates("lag")


def test_a_folder_that_is_not_there_and_other_controllers_are_refused(machine, taught, tmp_path):
    with pytest.raises(EstimatesFileError, match="its folder does not exist; create it"):
        read_estimates_file(tmp_path / "no" / "learnt.yaml", machine)
    with pytest.raises(ArgumentError, match="keeps no estimates; leave it out, or use lag_comp"):
        build_controller(load_machine(), taught.get_learnt(), "coordinated")


def test_a_file_that_cannot_be_written_is_found_before_and_one_that_can_is_left_alone(tmp_path):
    file = tmp_path / "learnt.yaml"
    check_estimates_file_is_writable(file)
    assert list(tmp_path.iterdir()) == []
    file.write_text("kept")
    check_estimates_file_is_writable(file)
    assert file.read_text() == "kept"
    (tmp_path / "learnt.yaml.part").mkdir()  # root may write everywhere, but not a folder
    with pytest.raises(EstimatesFileError, match="it cannot be written: Is a directory"):
        check_estimates_file_is_writable(file)
