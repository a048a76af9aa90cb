from pathlib import Path

import pytest

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import Machine
from mhsb_sim.errors import PlantFileError
from mhsb_sim.simulation.plant_files import check_plant, load_plant


def written(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "plant.yaml"
    file.write_text(text, encoding="utf-8")
    return file


def test_a_plant_file_names_what_differs(machine: Machine, tmp_path: Path) -> None:
    lines = (
        "payload: {mass: 12}",
        "joints: {1: {link: {mass: 3.7}}}",
        "imperfections: {valve_overlap: 0.01}",
    )
    plant = load_plant(machine, written(tmp_path, "\n".join(lines)))
    assert plant.arrays.payload == 12.0
    assert plant.arrays.link_mass[1] == 3.7
    assert plant.arrays.link_mass[0] == machine.arrays.link_mass[0]
    assert plant.config.imperfections.valve_overlap == 0.01
    assert plant.config.circuit == machine.config.circuit


def test_a_whole_machine_file_is_a_plant_file(machine: Machine) -> None:
    plant = load_plant(machine, find_config_file("mhsb_arm3.yaml"))
    assert plant.config == machine.config


def test_the_realistic_plant_is_of_the_suites_build_and_differs(machine: Machine) -> None:
    plant = load_plant(machine, find_config_file("realistic_plant.yaml"))
    check_plant(machine, plant)
    assert plant.config.imperfections.sensors.length == "encoder_16_bit"
    gain = plant.arrays.valve_coefficient / machine.arrays.valve_coefficient
    assert gain == pytest.approx(0.9, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is no plant file: it is to name what differs in schema_version, name"),
        ("secret: 1", "is no plant file"),
        ("circuit: {softness: 1.0}", "circuit.softness: there is no such key"),
        ("circuit: {bulk_modulus: -1.0}", "circuit.bulk_modulus: must be at least 100000 Pa"),
        ("joints: {7: {link: {mass: 1.0}}}", "there is no '7'; valid are 0, 1, 2"),
        ("cicuit: {bulk_modulus: 1.0e+9}", "cicuit: there is no such key; did you mean circuit?"),
        ("payload: {mass: 9}\nmotion: {}\ntool: 1", "tool: there is no such key; leave it out, or"),
        ("name: arm\nsecret: 1", "is no plant file"),
        ("schema_version: 2", "is not a machine file: it lacks name"),
        ("payload: [", "is not YAML"),
    ],
)
def test_a_file_that_is_none_is_refused_in_a_sentence(
    machine: Machine, tmp_path: Path, text: str, sentence: str
) -> None:
    with pytest.raises(PlantFileError) as error:
        load_plant(machine, written(tmp_path, text))
    assert sentence in str(error.value)
    assert str(error.value).startswith(f"plant file {tmp_path}/plant.yaml: ")
    assert "secret" not in str(error.value)
