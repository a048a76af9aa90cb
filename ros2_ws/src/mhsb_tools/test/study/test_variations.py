from pathlib import Path

import numpy as np
import pytest

from mhsb_model.errors import MhsbError
from mhsb_model.files.yaml_files import YamlFileError
from mhsb_model.machine import Machine
from mhsb_tools.study.variations import draw_machine, load_variations, scale_values

RANGES = {
    "payload": ("factor", (0.7, 1.3)),
    "friction": ("factor", (0.5, 2.0)),
    "bulk_modulus": ("value", (0.6e9, 1.6e9)),
    "valve_gain": ("factor", (0.8, 1.2)),
    "overlap": ("value", (0.0, 0.03)),
    "delay": ("value", (0.0, 0.005)),
    "leakage": ("factor", (0.5, 1.5)),
    "pump_lag": ("factor", (0.5, 3.0)),
    "supply_sag": ("value", (3.3e6, 4.0e6)),
    "sag_start": ("moment", (0.0, 1.0)),
    "sag_duration": ("value", (2.0, 2.0)),
    "length_sensors": ("choice", "encoder_16_bit"),
    "pressure_sensors": ("choice", "industrial"),
    "pump_speed_sensors": ("choice", "resolver"),
}
"""What the suite promises to bear; not to be narrowed."""


def test_the_suites_variations_are_the_promised_ones(machine: Machine) -> None:
    found = load_variations(machine)
    assert list(found) == list(RANGES)
    for name, (kind, expected) in RANGES.items():
        assert getattr(found[name], kind) == expected
        assert found[name].source


def test_draws_fill_their_ranges_evenly_and_independently(machine: Machine) -> None:
    variations = load_variations(machine)
    random = np.random.default_rng(1)
    drawn = [
        draw_machine(machine, variations, random, lambda share: 10.0 * share) for _ in range(300)
    ]
    names = [name for name, (kind, _) in RANGES.items() if kind != "choice"]
    values = np.array([[float(of[name]) for name in names] for _, of in drawn])
    for column, name in zip(values.T, names, strict=True):
        kind, (low, high) = RANGES[name]
        scale = 10.0 if kind == "moment" else 1.0
        assert scale * low <= column.min() <= column.max() <= scale * high
        assert np.mean(column) == pytest.approx(scale * (low + high) / 2, rel=0.1)
    spread = [k for k, name in enumerate(names) if name != "sag_duration"]
    correlation = np.corrcoef(values[:, spread].T) - np.eye(len(spread))
    assert np.abs(correlation).max() < 0.25
    plant, of = drawn[0]
    assert plant.arrays.payload == pytest.approx(of["payload"] * machine.arrays.payload)
    assert plant.config.imperfections.supply_sag.pressure == of["supply_sag"]
    assert plant.config.imperfections.supply_sag.fall == 0.05
    assert plant.config.imperfections.sensors.length == "encoder_16_bit"


def test_a_factor_goes_by_a_variations_name_or_by_a_path(machine: Machine) -> None:
    factors = {"friction": 2.0, "joints.0.link.mass": 1.1, "circuit.land_length": 1.2}
    plant = scale_values(machine, factors, load_variations(machine))
    oil = machine.config.circuit
    assert plant.config.circuit.coulomb_friction == 2.0 * oil.coulomb_friction
    assert plant.config.circuit.viscous_friction == 2.0 * oil.viscous_friction
    assert plant.config.circuit.land_length == pytest.approx(1.2 * 0.05)  # not in the file
    assert plant.arrays.link_mass[0] == pytest.approx(1.1 * machine.arrays.link_mass[0])
    assert plant.arrays.link_mass[1] == machine.arrays.link_mass[1]


def test_a_factor_on_what_is_common_is_one_on_what_actuators_have_in_its_place(
    machine: Machine,
) -> None:
    own = machine.with_values({"joints.1.actuator.rated_flow": 5e-5})
    variations = load_variations(own)
    usual = own.config.hydraulics.valve.rated_flow
    plants = [scale_values(own, {"valve_gain": 0.8}, variations)]
    plant, drawn = draw_machine(own, variations, np.random.default_rng(3), float)
    factors = [0.8, float(drawn["valve_gain"])]
    for factor, each in zip(factors, [*plants, plant], strict=True):
        assert each.config.joints[1].actuator.rated_flow == pytest.approx(factor * 5e-5)
        assert each.config.hydraulics.valve.rated_flow == pytest.approx(factor * usual)
        np.testing.assert_allclose(
            each.arrays.valve_coefficient / own.arrays.valve_coefficient, factor
        )


@pytest.mark.parametrize(
    ("factors", "sentence"),
    [
        ({"weight": 2.0}, "weight: there is no 'weight'; valid are schema_version"),
        ({"circuit.softness": 2.0}, "there is no 'softness'; valid are bulk_modulus"),
        ({"circuit.free_air": 2.0}, "circuit.free_air is 0, whatever the factor 2"),
        ({"circuit.valves.piston_seal": 2.0}, "there is no 'valves'"),
        ({"overlap": 2.0}, "imperfections.valve_overlap is 0, whatever the factor 2"),
        ({"name": 2.0}, "name is no number"),
        ({"payload": -1.0}, "payload.mass: must be at least 0 kg"),
    ],
)
def test_a_factor_that_makes_no_sense_is_refused_in_a_sentence(
    machine: Machine, factors: dict[str, float], sentence: str
) -> None:
    with pytest.raises(MhsbError) as error:
        scale_values(machine, factors, load_variations(machine))
    assert sentence in str(error.value)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "names no variation"),
        ("a: {keys: [payload.mass], factor: [1, 2]}", "a.source: is missing; add it"),
        ("a: {keys: [payload.mass], source: x}", "needs exactly one of factor, value"),
        ("a: {keys: [payload.mass], factor: [2, 1], source: x}", "has its higher end first"),
        ("a: {keys: [payload.weight], factor: [1, 2], source: x}", "there is no 'weight'"),
        ("a: {keys: [circuit.bulk_modulus], value: [-1, -1], source: x}", "at least 100000 Pa"),
    ],
)
def test_a_file_that_makes_no_sense_is_refused_in_a_sentence(
    machine: Machine, tmp_path: Path, text: str, sentence: str
) -> None:
    file = tmp_path / "variations.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(MhsbError) as error:
        load_variations(machine, file)
    assert sentence in str(error.value)


def test_a_missing_file_is_named(machine: Machine, tmp_path: Path) -> None:
    with pytest.raises(YamlFileError, match=r"nowhere\.yaml"):
        load_variations(machine, tmp_path / "nowhere.yaml")
