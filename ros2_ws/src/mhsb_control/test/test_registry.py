"""Each controller declares its section of the machine file, and the registry checks all of them."""

import pickle
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import Field

from mhsb_control import REGISTERED_CONTROLLERS, load_machine, read_gains, registry
from mhsb_control.independent import IndependentController
from mhsb_model import machine as machines
from mhsb_model.circuit.dead_time import compute_dead_time
from mhsb_model.errors import MachineFileError
from mhsb_model.files.config_files import find_config_file
from mhsb_model.files.machine_files import MACHINE_FILE
from mhsb_model.schema import DEFAULT_PREVIEW, Gain, Section

OLD_FILE = Path(__file__).with_name("excavator_of_before.yaml")
LOADERS = (load_machine, machines.load_machine)


def changed_file(folder: Path, **servo: Any) -> Path:
    """The suite's own arm with other keys in `servo`; None leaves one out."""
    content = yaml.safe_load(find_config_file(MACHINE_FILE).read_text(encoding="utf-8"))
    for key, value in servo.items():
        if value is None:
            del content["servo"][key]
        else:
            content["servo"][key] = value
    file = folder / "arm.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return file


@pytest.mark.parametrize("load", LOADERS)
def test_a_file_with_all_gains_gives_what_it_gave_before(load: Any) -> None:
    machine = load(OLD_FILE)
    assert machine.planning_hash.startswith("0e1ae4bbe82deb8ab704d84a")
    assert machine.table_hash.startswith("62087e2a32b98b8ca4d41682")
    assert machine.planar_arm.table_hash.startswith("3e024a304b773ddc91bb3f1e")
    assert machine.servo_preview == machine.planar_arm.servo_preview == 0.0862
    assert read_gains(machine, "coordinated").model_dump() == {
        "position_gain": 0.324, "integral_gain": 0.1, "force_bandwidth": 0.278,
        "force_damping": 4.0, "pressure_gain": 2.55, "preview": 0.0862, "allowed_rise": 1.32e5,
        "pump_response": 0.205,
    }  # fmt: skip
    assert read_gains(machine, "independent").model_dump() == {
        "position_gain": 1.22, "integral_gain": 0.0, "force_bandwidth": 0.368,
        "force_damping": 4.0, "nominal_valve_drop": 0.18, "pressure_gain": 157.0,
        "pressure_integral_gain": 915.0, "supply_margin": 1.32e5,
    }  # fmt: skip


@pytest.mark.parametrize("load", LOADERS)
def test_a_file_without_gains_has_those_of_the_suites_own_arm(load: Any, tmp_path: Path) -> None:
    bare, own = load(changed_file(tmp_path, coordinated=None, independent=None)), load()
    for name in REGISTERED_CONTROLLERS:
        gains = read_gains(own, name)
        assert read_gains(bare, name) in (gains, gains.model_copy(update={"integral_gain": 0.0}))
    assert bare.servo_preview == DEFAULT_PREVIEW == own.servo_preview
    assert bare.planning_hash == own.planning_hash


@pytest.mark.parametrize("load", LOADERS)
@pytest.mark.parametrize(("section", "delay"), [(None, 0.2), ({}, 0.2), ({"rate": 50.0}, 0.2),
                         ({"expected_delay": 0.4}, 0.4)])  # fmt: skip
def test_the_dead_time_does_not_depend_on_the_loader(
    load: Any, section: dict[str, float] | None, delay: float, tmp_path: Path
) -> None:
    given = {} if section is None else {"lag_compensated": section}
    machine = load(changed_file(tmp_path, **given))
    blind = machine.with_values({"imperfections.sensors.pressure": "none"})
    assert compute_dead_time(blind) == blind.expected_delay == delay
    assert compute_dead_time(machine) == 0.0


@pytest.mark.parametrize("load", LOADERS)
def test_a_delay_that_is_no_number_is_refused_by_each_loader(load: Any, tmp_path: Path) -> None:
    file = changed_file(tmp_path, lag_compensated={"expected_delay": "soon"})
    with pytest.raises(MachineFileError, match=r"lag_compensated\.expected_delay: must be a"):
        load(file)


@pytest.mark.parametrize(
    ("servo", "sentence"),
    [
        (
            {"coordinated": {"position_gain": -1}},
            "servo.coordinated.position_gain: must be at least 0.0001 (is -1); raise it",
        ),
        (
            {"coordinated": {"allowed_rise": 2e9}},
            "servo.coordinated.allowed_rise: must be at most 1e+09 Pa (is 2000000000.0); lower it",
        ),
        (
            {"independent": {"supply_margin": "wide"}},
            "servo.independent.supply_margin: must be a number, in Pa (is 'wide'); give one",
        ),
        (
            {"independent": {"presure_gain": 1.0}},
            "servo.independent.presure_gain: there is no such key; did you mean pressure_gain?",
        ),
    ],
)
def test_wrong_gains_are_told_as_every_other_wrong_value(
    servo: dict[str, Any], sentence: str, tmp_path: Path
) -> None:
    file = changed_file(tmp_path, **servo)
    with pytest.raises(MachineFileError) as refused:
        load_machine(file)
    assert refused.value.problems == (sentence,)
    unchecked = machines.load_machine(file)  # as the planner does, which has no controller
    with pytest.raises(MachineFileError) as refused:
        read_gains(unchecked, next(iter(servo)))
    assert refused.value.problems == (sentence,)


def test_everything_wrong_is_told_at_once_sections_of_no_controller_too(tmp_path: Path) -> None:
    servo = {"coordinatd": {}, "pressure_noise": -1.0, "coordinated": {"position_gain": 0}}
    with pytest.raises(MachineFileError) as refused:
        load_machine(changed_file(tmp_path, **servo))
    assert refused.value.problems == (
        "servo.pressure_noise: must be at least 0 Pa (is -1.0); raise it",
        "servo.coordinated.position_gain: must be at least 0.0001 (is 0); raise it",
        "servo.coordinatd: there is no such key; did you mean coordinated?",
    )


@pytest.mark.parametrize("load", LOADERS)
def test_the_time_that_plans_count_on_is_checked_without_a_controller(
    load: Any, tmp_path: Path
) -> None:
    with pytest.raises(MachineFileError) as refused:
        load(changed_file(tmp_path, coordinated={"preview": 3.0}))
    sentence = "servo.coordinated.preview: must be at most 1 s (is 3.0); in ms? 3 ms are 0.003 s"
    assert refused.value.problems == (sentence,)


def test_copies_are_checked_as_the_file_was(tmp_path: Path) -> None:
    machine = load_machine(changed_file(tmp_path, independent=None))
    copies = [machine, machine.changed(payload=1.0), pickle.loads(pickle.dumps(machine))]
    for copy in copies:
        other = copy.with_values({"servo.independent.position_gain": 0.5})
        assert read_gains(other, "independent").position_gain == 0.5
        with pytest.raises(MachineFileError, match=r"servo\.independent\.position_gain: must be"):
            copy.with_values({"servo.independent.position_gain": -0.5})


class OwnGains(Section):
    """Gains of a controller that somebody adds."""

    stiffness: Gain = Field(default=2.0, description="of the arm [N/m]")


class OwnController(IndependentController):
    """A controller with a section of its own."""

    gains_section = OwnGains


def test_a_controller_brings_its_own_section(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(REGISTERED_CONTROLLERS, "own", OwnController)
    monkeypatch.setattr(
        registry, "MachineConfigWithGains", registry.build_schema(REGISTERED_CONTROLLERS)
    )
    assert read_gains(load_machine(), "own").stiffness == 2.0
    file = changed_file(tmp_path, own={"stiffness": 3.0})
    assert read_gains(load_machine(file), "own").stiffness == 3.0
    with pytest.raises(MachineFileError, match=r"own\.stiffness: must be at least 0.0001 N/m"):
        load_machine(changed_file(tmp_path, own={"stiffness": 0.0}))
