"""Machine files: what is read, what is refused and how it is said."""

import pickle
import re

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mhsb_model.errors import MachineFileError, OutOfWorkspaceError
from mhsb_model.files.config_files import find_config_file
from mhsb_model.files.value_paths import set_value
from mhsb_model.machine import load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.schema import BOOSTER_VALUES


@pytest.fixture
def load(content, tmp_path):
    """Loads the content of a machine file after a change to it."""

    def load_changed(change):
        change(content)
        file = tmp_path / "machine.yaml"
        file.write_text(yaml.safe_dump(content), encoding="utf-8")
        return load_machine(file)

    return load_changed


@pytest.mark.parametrize(
    "file",
    ["mhsb_arm3", "mhsb_arm4", "telescope_arm", "excavator", "forestry_crane"],
)
def test_every_value_of_a_machine_file_says_where_it_comes_from(file):
    lines = find_config_file(f"{file}.yaml").read_text(encoding="utf-8").splitlines()
    values = [line for line in lines if re.search(r":\s*[^\s#]", line.split("#")[0])]
    unmarked = [
        line
        for line in values
        if not re.search(r"# (arm3: )?(paper|inferred|fitted|assumption)[:;] \S", line)
        and not re.match(r"\s*(schema_version|name|- kind):", line)
    ]
    assert len(values) > 60
    assert unmarked == []


def test_the_arm_has_the_papers_numbers(machine):
    arrays = machine.arrays
    assert arrays.link_length.tolist() == [0.45, 0.40, 0.179]
    assert arrays.cap_area == pytest.approx(490.9e-6, abs=5e-8)
    assert arrays.rod_area == pytest.approx(377.8e-6, abs=5e-8)
    assert arrays.servo_pump_flow / arrays.cap_area[0] == pytest.approx(8.2e-3, abs=5e-5)
    assert arrays.servo_pump_flow / arrays.rod_area[0] == pytest.approx(10.7e-3, abs=5e-5)
    assert len(machine.patterns) == 23


def test_the_valve_coefficient_reproduces_the_rated_flow_over_one_land(machine):
    valve = machine.config.hydraulics.valve
    flow = machine.arrays.valve_coefficient * np.sqrt(valve.rated_pressure_drop_per_land)
    assert flow == pytest.approx(valve.rated_flow)


def test_valves_and_v_max_are_common_to_all_actuators_that_have_none_of_their_own(machine):
    valve, usual = machine.config.hydraulics.valve, machine.arrays
    own = machine.with_values(
        {
            "joints.0.actuator.rated_flow": 5e-5,
            "joints.1.actuator.rated_flow": 4e-5,
            "joints.1.actuator.rated_pressure_drop_per_land": 1e6,
            "joints.2.actuator.rated_pressure_drop_per_land": 2e6,
            "joints.2.actuator.max_piston_speed": 0.007,
        }
    )
    drop = valve.rated_pressure_drop_per_land
    expected = [5e-5 / np.sqrt(drop), 4e-8, valve.rated_flow / np.sqrt(2e6)]
    np.testing.assert_allclose(own.arrays.valve_coefficient, expected, rtol=1e-14)
    assert own.arrays.max_piston_speed.tolist() == [0.012, 0.012, 0.007]
    assert usual.valve_coefficient.tolist() == [valve.rated_flow / np.sqrt(drop)] * 3
    assert usual.max_piston_speed.tolist() == [0.012] * 3


@given(st.floats(1e-4, 1.0), st.floats(1e-4, 1.0), st.floats(1e-4, 1.0))
def test_a_v_max_asked_for_holds_for_all_but_those_whose_own_is_lower(machine, own, first, asked):
    slower = machine.with_values({"joints.1.actuator.max_piston_speed": own})
    changed = slower.changed(max_piston_speed=first).changed(max_piston_speed=asked)
    assert changed.arrays.max_piston_speed.tolist() == [asked, min(own, asked), asked]


def test_a_value_of_all_is_found_with_those_that_actuators_have_in_its_place(machine):
    flow, relief = "hydraulics.valve.rated_flow", "circuit.chamber_relief_pressure"
    values = {f"joints.{j}.actuator.rated_flow": 5e-5 for j in (0, 2)}
    own = machine.with_values(values | {"joints.1.actuator.relief_pressure": 1.5e7})
    assert own.list_overriding_paths(flow) == [flow, *values]
    assert own.list_overriding_paths(relief) == [relief, "joints.1.actuator.relief_pressure"]
    assert own.list_overriding_paths("payload.mass") == ["payload.mass"]
    assert machine.list_overriding_paths(flow) == [flow]


def test_the_hash_follows_what_the_planner_depends_on_and_nothing_else(load, machine):
    def stiffer_oil(content):
        content["circuit"]["bulk_modulus"] = 2e9

    def heavier_link(content):
        content["joints"][0]["link"]["mass"] += 1

    def zones(content):
        content["keep_out"] = {"boxes": [{"x_min": 0.7, "z_min": 0, "x_max": 0.8, "z_max": 0.1}]}

    def sticky(content):
        content["joints"][0]["actuator"] = {"friction": 2.0}

    assert load(stiffer_oil).table_hash == machine.table_hash
    assert load(sticky).table_hash == machine.table_hash
    assert load(zones).table_hash == machine.table_hash
    assert load(heavier_link).table_hash != machine.table_hash


def test_the_hash_follows_valves_and_v_max_of_an_actuators_own_where_it_has_them(machine):
    def with_own(**values):
        return machine.with_values({"joints.1.actuator": values}).table_hash

    assert with_own() == with_own(rated_flow=None, relief_pressure=2e7) == machine.table_hash
    own = {"rated_flow": 5e-5, "rated_pressure_drop_per_land": 1e6, "max_piston_speed": 0.01}
    hashes = {with_own(**{name: value}) for name, value in own.items()}
    assert len(hashes - {machine.table_hash}) == 3


def test_changes_give_another_machine_and_leave_the_first(machine):
    other = machine.changed(payload=3.0, supply_pressure=5e6, max_piston_speed=0.02)
    assert other.arrays.payload == 3.0
    assert other.arrays.supply_pressure == 5e6
    assert other.arrays.max_piston_speed.tolist() == [0.02] * 3
    assert machine.arrays.payload == 10.0
    with pytest.raises(MachineFileError, match=r"mass: must be at least 0 kg \(is -1\.0\); rai"):
        machine.changed(payload=-1.0)


def test_zones_are_given_by_any_two_corners_and_replace_those_of_the_file(machine):
    zones = Zones(boxes=((0.9, 0.3, 0.7, 0.1),), tip_circles=((0.5, -0.5, 0.1),))
    changed = machine.changed(zones=zones)
    assert Zones.from_keep_out(changed.config.keep_out) == Zones(
        boxes=((0.7, 0.1, 0.9, 0.3),), tip_circles=((0.5, -0.5, 0.1),)
    )
    assert Zones.from_keep_out(changed.changed(zones=Zones()).config.keep_out) == Zones()
    more = zones.with_added(boxes=[(0.0, 0.9, 0.1, 1.0)], circles=[(0.9, 0.0, 0.05)])
    assert len(machine.changed(zones=more).obstacles.names) == 4
    with pytest.raises(MachineFileError, match=r"x_min: 0\.7 m must be below x_max 0\.7 m"):
        machine.changed(zones=Zones(boxes=((0.7, 0.1, 0.7, 0.3),)))


def test_swapped_limits_are_asked_about_and_nothing_else_is_said_of_the_joint(load):
    def swap(content):
        content["joints"][0]["limits"] = {"lower": 2.0, "upper": -1.5}
        box = {"x_min": 0.8, "x_max": 0.9, "z_min": 0.7, "z_max": 0.6}
        content["keep_out"] = {"boxes": [box]}

    with pytest.raises(MachineFileError) as caught:
        load(swap)
    assert sorted(caught.value.problems) == [
        "joints.0.limits.lower: 2 rad must be below upper -1.5 rad; swapped?",
        "keep_out.boxes.0.z_min: 0.7 m must be below z_max 0.6 m; swapped?",
    ]


@pytest.mark.parametrize(
    ("keys", "value", "sentence"),
    [
        (["hydraulics", "colour"], "red", r"hydraulics\.colour: there is no such key; leave it"),
        (["joints", 0, "link", "length"], 45.0, r"0\.link\.length: must be at most 20 m \(is 45"),
        (["joints", 1, "limits", "lower"], 1.0, r"joints\.1\.limits\.lower: 1 rad must be below"),
        (["joints", 2, "cylinder", "rod"], 0.025, r"joints\.2\.cylinder\.rod: 0\.025 m must be"),
        (["joints", 0, "link", "mass"], -5.0, r"joints\.0\.link\.mass: .*\(is -5\.0\)"),
        (["payload", "mas"], 5.0, r"payload\.mas: there is no such key; did you mean mass\?"),
        (["hydraulics", "valve", "rated_flo"], 1, r"rated_flo: there is no such key; did you mean"),
        (["joints", 0, "linkage", "rocker_lenght"], 0.1, r"did you mean rocker_length\?"),
        (["payload", "mass"], "ten", r"payload\.mass: must be a number, in kg \(is 'ten'\); give"),
        (["joints", 1, "cylinder"], 3, r"cylinder: must be a section with the keys bore, rod \(is"),
        (["payload", "mass"], float("nan"), r"payload\.mass: .*(finite|nan)"),
        (["joints", 0, "limits", "upper"], 2.6, r"joints\.0\.limits: the moment arm falls to"),
        (["keep_out"], {"walls": []}, r"keep_out\.walls: there is no such key; leave it out, or"),
        (["keep_out"], {"link_radii": [0.1]}, r"keep_out\.link_radii: has 1 radii, .* 3 links"),
        (["keep_out"], {"margin": -0.001}, r"keep_out\.margin: must be at least 0 m \(is -0"),
        (["keep_out"], {"ground": 0.1}, r"the ground at z = 0\.1 m is -0\.1 m from joint 1"),
        (
            ["keep_out"],
            {"boxes": [{"x_min": 0.9, "z_min": 0, "x_max": 0.8, "z_max": 0.1}]},
            r"keep_out\.boxes\.0\.x_min: 0\.9 m must be below x_max 0\.8 m",
        ),
        (
            ["keep_out"],
            {"circles": [{"x": 0.1, "z": 0, "radius": 0.098}]},
            r"circle of 0\.098 m around \(0\.1, 0\) m is 0\.002 m from joint 1.*at least 0\.005 m",
        ),
        (["workspace", "max_radius"], 1.2, r"max_radius: 1\.2 m is beyond the reach 1\.029 m"),
        (["workspace", "min_radius"], 1.1, r"min_radius: 1\.1 m must be below"),
        (["hydraulics", "tank_pressure"], 5e5, None),
        (["hydraulics", "main_pump", "pressure"], 1e5, r"tank_pressure: 100000 Pa must be below"),
        (["hydraulics", "modules", "per_mode"], [1, 1, 2], r"per_mode: .* must be 0 for N"),
        (["hydraulics", "modules", "per_mode"], [0, 0, 2], r"per_mode: .* at least 1 for DB"),
        (["hydraulics", "valve", "leakage_flow"], 2e-5, r"all valves leak 6e-05 m³/s"),
        (["joints", 0, "link", "center_of_mass"], 0.5, r"beyond the link's length 0\.45 m"),
        (["joints", 1, "actuator"], {"rated_flow": 0.0}, r"rated_flow: must be at least 1e-10 m³"),
        (["joints", 1, "actuator"], {"rated_flow": 10**60}, r"at most 0\.1 m³/s \(is 1\d{39}\)"),
        (["name"], "ZX200/6", r"name: must be letters A to Z and a to z, digits and '_' only, be"),
        (["name"], "ZX200/6", r"beginning with a letter \(is 'ZX200/6'\); change it"),
        (["name"], "x" * 70, r"name: has 70 characters, must have at most 64 \(is 'x{40}'\)"),
        (["joints", 1, "actuator"], {"rated_flow": 0.2}, r"rated_flow: must be at most 0\.1 m³/s"),
        (
            ["joints", 0, "actuator"],
            {"rated_pressure_drop_per_land": -1.0},
            r"joints\.0\.actuator\.rated_pressure_drop_per_land: must be at least 1 Pa \(is -1",
        ),
        (
            ["joints", 0, "actuator"],
            {"rated_pressure_drop_per_land": 6e7},
            r"rated_pressure_drop_per_land: must be at most 5e\+07 Pa",
        ),
        (
            ["joints", 2, "actuator"],
            {"max_piston_speed": 1e-5},
            r"joints\.2\.actuator\.max_piston_speed: must be at least 0\.0001 m/s",
        ),
        (["joints", 2, "actuator"], {"max_piston_speed": 2}, r"max_piston_speed: must be at most"),
        (
            ["joints", 2, "actuator"],
            {"max_piston_speed": 0.02},
            r"joints\.2\.actuator\.max_piston_speed: 0\.02 m/s is above "
            r"motion\.max_piston_speed 0\.012 m/s, which no actuator exceeds; raise that, and give",
        ),
        (["joints", 0, "actuator"], {"speed": 0.01}, r"actuator\.speed: there is no such key"),
        (["joints", 0, "linkage", "kind"], "wheel", r"0\.linkage: there is no kind 'wheel'; giv"),
        (
            ["joints", 0, "cylinder", "bore"],
            6.3,
            r"bore: must be at most 1 m \(is 6\.3\); in cm or mm\? 6\.3 cm are 0\.063 m",
        ),
        (
            ["joints", 0, "linkage", "parent_pin", "radius"],
            12.0,
            r"radius: must be at most 5 m \(is 12\.0\); in cm or mm\? 12 cm are 0\.12 m",
        ),
        (
            ["hydraulics", "servo_pump", "max_boost_pressure"],
            16,
            r"_pressure: 16 Pa must be above the main pump's 4e\+06 Pa; in MPa\? 16 MPa are",
        ),
        (
            ["hydraulics", "servo_pump", "max_boost_pressure"],
            4e6,
            r"must be above the main pump's 4e\+06 Pa; raise it, or set modules\.count to 0$",
        ),
        (["imperfections"], {"valve_overlap": 12}, r"\(is 12\); in %\? 12 % are 0\.12$"),
        (
            ["imperfections"],
            {"computing_delay": 30},
            r"must be at most 0\.5 s \(is 30\); in ms\? 30 ms are 0\.03 s$",
        ),
    ],
)
def test_a_spoiled_value_is_refused_by_its_path_with_value_and_limit(load, keys, value, sentence):
    def change(content):
        place = content
        for key in keys[:-1]:
            place = place[key]
        place[keys[-1]] = value

    if sentence is None:
        load(change)
        return
    with pytest.raises(MachineFileError, match=sentence):
        load(change)


@pytest.mark.parametrize("joints", [1, 2])
def test_an_arm_that_leaves_nothing_to_plan_is_refused(load, joints):
    def change(content):
        content["joints"] = content["joints"][:joints]
        simulation = content["simulation"]
        simulation["start_posture"] = simulation["start_posture"][:joints]
        content["workspace"]["max_radius"] = 0.4

    with pytest.raises(MachineFileError, match=f"has {joints}, plans are made for 3 or more"):
        load(change)


def version_2(content):
    content["schema_version"] = 2
    for joint in content["joints"]:
        joint["kind"] = "revolute"


def test_a_file_of_version_2_that_names_the_joints_is_the_same_machine(load, machine):
    def rename(content):
        version_2(content)
        content["motion"]["kept_joints"] = [3]

    again = load(rename)
    assert again.config.joints == machine.config.joints
    assert again.kept_joints == machine.kept_joints == (2,)
    assert again.changed(payload=1.0).config.schema_version == 2


def test_kinds_of_joints_that_there_are_not_are_refused_by_name(load):
    def spoil(content):
        version_2(content)
        content["joints"][2]["kind"] = "screw"

    with pytest.raises(MachineFileError) as caught:
        load(spoil)
    (problem,) = caught.value.problems
    assert problem.startswith("joints.2.kind: 'screw' is not one of revolute, prismatic, slew")


@pytest.mark.parametrize(
    ("curve", "problem"),
    [
        (
            [[0, 0], [0.5, 0.6], [0.5, 0.8], [1, 1]],
            "[0.5, 0.8] does not lie above [0.5, 0.6] in both",
        ),
        (
            [[0, 0], [0.5, 0.6], [0.7, 0.6], [1, 1]],
            "[0.7, 0.6] does not lie above [0.5, 0.6] in both",
        ),
        ([[0.2, 0], [1, 1]], "it goes from [0.2, 0.0] to [1.0, 1.0]"),
        ([[0, 0], [0.63, 0.95]], "it goes from [0.0, 0.0] to [0.63, 0.95]"),
    ],
)
@pytest.mark.parametrize("key", ["valve_curve", "valve_curve_retracting"])
def test_a_curve_of_a_valve_that_does_not_rise_from_0_to_1_is_refused(key, curve, problem):
    with pytest.raises(MachineFileError) as refused:
        load_machine().with_values({f"imperfections.{key}": curve})
    [told] = refused.value.problems
    assert told == (
        f"imperfections.{key}: pairs [stroke beyond the overlap, opening] must rise from [0, 0] to "
        f"[1, 1], and {problem}; give both as shares, in rising order"
    )


def test_a_curve_in_percent_is_refused_for_each_number_beyond_its_range():
    with pytest.raises(MachineFileError) as refused:
        load_machine().with_values({"imperfections.valve_curve": [[0, 0], [63, 95]]})
    for problem, (column, value) in zip(refused.value.problems, ((0, 63), (1, 95)), strict=True):
        assert problem.startswith(f"imperfections.valve_curve.1.{column}: must be")
        assert f"(is {value})" in problem


def test_a_curve_with_one_point_or_three_numbers_in_a_point_is_refused():
    for curve in ([[0, 0]], [[0, 0, 0], [1, 1, 1]]):
        with pytest.raises(MachineFileError, match=r"imperfections\.valve_curve"):
            load_machine().with_values({"imperfections.valve_curve": curve})


def test_a_retracting_spool_has_the_common_curve_unless_it_has_its_own():
    common, own = ((0.0, 0.0), (0.4, 0.2), (1.0, 1.0)), ((0.0, 0.0), (0.5, 0.8), (1.0, 1.0))
    machine = load_machine()
    assert machine.config.imperfections.curves == (None, None)
    one = machine.with_values({"imperfections.valve_curve": common})
    assert one.config.imperfections.curves == (common, common)
    two = one.with_values({"imperfections.valve_curve_retracting": own})
    assert two.config.imperfections.curves == (common, own)
    three = machine.with_values({"imperfections.valve_curve_retracting": own})
    assert three.config.imperfections.curves == (None, own)


def test_compensated_valves_limit_the_planned_speed_of_both_directions():
    machine = load_machine()
    m, rated = machine.arrays, machine.config.hydraulics.valve
    kept = 2e2  # Pa
    slow = machine.with_values({"hydraulics.valve.compensated_drop": kept})
    root = np.sqrt(kept / rated.rated_pressure_drop_per_land)
    np.testing.assert_allclose(
        slow.arrays.max_piston_speed, rated.rated_flow * root / m.cap_area, rtol=1e-12
    )
    assert np.all(slow.arrays.max_piston_speed < m.max_piston_speed)
    usual = machine.with_values({"hydraulics.valve.compensated_drop": 7e5})
    assert np.array_equal(usual.arrays.max_piston_speed, m.max_piston_speed)
    assert usual.planning_hash != machine.planning_hash


def test_new_keys_of_valves_and_sensors_are_left_out_of_a_file_without_them():
    content = load_machine().config.model_dump(mode="json")
    assert "compensated_drop" not in content["hydraulics"]["valve"]
    assert not any("curve" in key for key in content["imperfections"])
    assert not any("angle" in key for key in content["imperfections"]["sensors"])


def test_a_joint_without_its_kind_and_useless_kept_joints_are_told_at_once(load):
    def spoil(content):
        version_2(content)
        del content["joints"][0]["kind"]
        content["motion"]["kept_joints"] = [2, 4]

    with pytest.raises(MachineFileError) as caught:
        load(spoil)
    missing, kept = caught.value.problems
    assert missing.startswith("joints.0.kind: is missing")
    assert kept.startswith("motion.kept_joints: [2, 4] must be 1 different ones")


def test_the_four_joint_arm_of_the_suite_loads():
    arm = load_machine(find_config_file("mhsb_arm4.yaml"))
    assert arm.joint_count == 4
    assert arm.patterns.shape == (50, 4)
    assert arm.kept_joints == (2, 3)


BOOSTER_KEYS = [
    "hydraulics.servo_pump",
    "hydraulics.modules.per_mode",
    *(f"circuit.{key}" for key in BOOSTER_VALUES["circuit"]),
]


def without_booster_keys(content, count):
    """Remove all keys of booster modules, and set how many are fitted."""
    content["hydraulics"]["modules"]["count"] = count
    for path in BOOSTER_KEYS:
        *sections, key = path.split(".")
        section = content
        for name in sections:
            section = section[name]
        del section[key]


def test_a_machine_without_boosters_needs_none_of_their_keys(load):
    arm = load(lambda content: without_booster_keys(content, 0))
    assert arm.arrays.max_boost_pressure == arm.arrays.supply_pressure
    assert arm.patterns.shape == (1, arm.joint_count)
    again = pickle.loads(pickle.dumps(arm)).changed(payload=1.0)
    assert again.planning_hash == arm.planning_hash


def test_an_empty_section_of_servo_pumps_is_one_that_was_left_out(load):
    def empty(content):
        without_booster_keys(content, 0)
        content["hydraulics"]["servo_pump"] = None

    arm = load(empty)
    assert arm.arrays.max_boost_pressure == arm.arrays.supply_pressure


def test_a_machine_without_boosters_keeps_the_booster_values_that_its_file_has(load):
    arm = load(lambda content: content["hydraulics"]["modules"].update(count=0))
    pump, rail = arm.config.hydraulics.servo_pump, arm.config.circuit.rail_volume
    assert (pump.max_flow, rail) != (
        BOOSTER_VALUES["servo_pump"]["max_flow"],
        BOOSTER_VALUES["circuit"]["rail_volume"],
    )


@pytest.mark.parametrize(
    ("key", "value", "problem"),
    [
        ("hydraulics.main_pump.pressure", "high", "hydraulics.main_pump.pressure: must be a numb"),
        ("hydraulics.main_pump.pressure", 6e7, "hydraulics.main_pump.pressure: must be at most"),
        ("hydraulics.main_pump", None, "hydraulics.main_pump: must be a section"),
        ("circuit", 3, "circuit: must be a section"),
    ],
)
def test_a_machine_without_boosters_is_asked_for_none_of_their_keys_beside_another_problem(
    load, key, value, problem
):
    def spoil(content):
        without_booster_keys(content, 0)
        set_value(content, key, value)

    with pytest.raises(MachineFileError) as caught:
        load(spoil)
    assert len(caught.value.problems) == 1
    assert caught.value.problems[0].startswith(problem)


def test_a_machine_with_boosters_needs_all_their_keys(load):
    with pytest.raises(MachineFileError) as caught:
        load(lambda content: without_booster_keys(content, 1))
    assert sorted(problem.partition(": ")[0] for problem in caught.value.problems) == sorted(
        BOOSTER_KEYS
    )
    assert all(": is missing; add it" in problem for problem in caught.value.problems)


def test_all_problems_are_reported_at_once(load):
    def spoil(content):
        content["joints"][0]["cylinder"]["bore"] = -1
        content["gravity"] = "strong"
        del content["motion"]

    with pytest.raises(MachineFileError) as caught:
        load(spoil)
    assert len(caught.value.problems) == 3


def test_problems_of_a_four_bar_are_told_by_their_path_in_the_file(load):
    def spoil(content):
        content["joints"][1]["linkage"]["rocker_length"] = -0.1
        del content["joints"][1]["linkage"]["coupler_length"]

    with pytest.raises(MachineFileError) as caught:
        load(spoil)
    paths = [problem.split(":")[0] for problem in caught.value.problems]
    assert "joints.1.linkage.rocker_length" in paths
    assert "joints.1.linkage.coupler_length" in paths


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (b"a: [", "is not YAML"),
        (b"\xff\xfe\x00", "not text|is not YAML"),
        (b"", "is not a machine file: it lacks schema_version, name"),
        (b"root:x:0:0:root", "is not a machine file: it lacks schema_version, name"),
        (b"users: [{name: me, password: secret}]", "is not a machine file"),
    ],
)
def test_a_file_that_is_no_machine_is_refused_with_one_sentence(tmp_path, text, sentence):
    file = tmp_path / "machine.yaml"
    file.write_bytes(text)
    with pytest.raises(MachineFileError, match=sentence):
        load_machine(file)


def test_a_key_that_is_not_known_is_named_and_its_value_is_not(load):
    def spoil(content):
        content["api_key"] = "secret"
        content["name"] = "9 lives"

    with pytest.raises(MachineFileError) as caught:
        load(spoil)
    assert "api_key: there is no such key" in str(caught.value)
    assert "9 lives" in str(caught.value)
    assert "secret" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(MachineFileError, match=r"nowhere\.yaml: cannot be read: No such file"):
        load_machine(tmp_path / "nowhere.yaml")


def test_an_unknown_name_comes_with_the_nearest_machine_of_the_suite():
    for name, near in (("excavatr", "excavator"), ("telescop_arm", "telescope_arm")):
        with pytest.raises(MachineFileError, match=rf"such file .*; did you mean {near}\?$"):
            load_machine(name)
    for name in ("qqq", "folder/excavatr", "excavatr.yaml"):
        with pytest.raises(MachineFileError) as caught:
            load_machine(name)
        assert "did you mean" not in str(caught.value)


@pytest.mark.parametrize("name", ["machine", "telescope_machine"])
def test_tips_joints_and_links_of_many_postures_are_those_of_each(request, name):
    arm = request.getfixturevalue(name)
    postures = np.random.default_rng(2).uniform(arm.arrays.joint_min, arm.arrays.joint_max, (50, 3))
    each = [arm.tip_position(q) for q in postures]
    np.testing.assert_array_equal(arm.tip_positions(postures), each)
    ends = [arm.joint_positions(q)[-1] for q in postures]
    np.testing.assert_allclose(ends, each, atol=1e-14)
    psi = [arm.end_link_angle(q) for q in postures]
    np.testing.assert_allclose(arm.link_angles(postures)[:, -1], psi, atol=1e-14)


@pytest.mark.parametrize(
    ("x", "z", "sentence"),
    [
        (-0.1, 0.5, "x must be at least 0 m"),
        (0.1, 0.1, r"0\.1414 m from the base must be within 0\.25 … 1\.029 m"),
        (1.0, 1.0, r"1\.414 m from the base"),
    ],
)
def test_tip_positions_outside_the_workspace_are_refused(machine, x, z, sentence):
    with pytest.raises(OutOfWorkspaceError, match=sentence):
        machine.check_in_workspace((x, z))


def test_the_rim_of_the_workspace_belongs_to_it(machine):
    machine.check_in_workspace((1.029, 0.0))
    machine.check_in_workspace((0.0, 0.25))


def test_no_flow_that_the_main_pump_gives_moves_a_joint_faster_than_its_fastest(load):
    machine = load(lambda content: None)
    a, rng = machine.arrays, np.random.default_rng(0)
    for q in rng.uniform(a.joint_min, a.joint_max, (200, 3)):
        arm = np.abs(machine.moment_arms(q))
        for area in (a.cap_area, a.rod_area):
            assert np.all(a.main_pump_flow / (area * arm) <= machine.max_joint_speeds * (1 + 1e-9))


def test_a_machine_sent_to_another_process_is_the_same_and_as_little_to_be_written_to(machine):
    other = pickle.loads(pickle.dumps(machine))
    assert other.config == machine.config
    for here, there in zip(machine.arrays, other.arrays, strict=True):
        np.testing.assert_array_equal(here, there)
        if isinstance(here, np.ndarray):
            assert not there.flags.writeable


def test_a_telescopes_cylinder_is_as_long_as_it_is_out(telescope_machine):
    assert telescope_machine.arrays.slides.tolist() == [False, False, True]
    assert telescope_machine.arrays.joint_max[2] == 0.25
    assert telescope_machine.cylinder_lengths(np.array([0.0, -1.0, 0.2]))[2] == 0.33 + 0.2
    assert telescope_machine.moment_arms(np.array([0.0, -1.0, 0.2]))[2] == 1.0
    arrays = telescope_machine.arrays
    fastest = arrays.main_pump_flow / arrays.rod_area[2]
    assert telescope_machine.max_joint_speeds[2] == pytest.approx(fastest)


def spoilt_telescope(tmp_path, change) -> list[str]:
    """What is told of the telescope's file after a change to its content."""
    content = yaml.safe_load(find_config_file("telescope_arm.yaml").read_text(encoding="utf-8"))
    change(content)
    file = tmp_path / "machine.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(MachineFileError) as caught:
        load_machine(file)
    return caught.value.problems


def test_everything_wrong_with_telescopes_is_told_at_once(tmp_path):
    def spoil(content):
        boom, _, telescope = content["joints"]
        content["joints"] = [telescope, dict(telescope), boom]
        content["schema_version"] = 1
        content["simulation"]["start_posture"] = [0.5, 0.1, 0.0]

    told = "\n".join(spoilt_telescope(tmp_path, spoil))
    for sentence in (
        "joints.0.kind: joint 1 must be revolute",
        "joints.1.kind: two prismatic joints in succession slide along one line",
        "joints: 1 of them are revolute, a chain with a telescope needs at least 2",
        "schema_version: prismatic joints need version 2",
        "simulation.start_posture.0: 0.5 m is outside the joint's limits [0, 0.25] m",
    ):
        assert sentence in told


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        (["limits", "lower"], -0.1, r"joints\.2\.limits\.lower: must be at least 0 m \(is -0\.1\)"),
        (["limits", "lower"], 0.3, r"joints\.2\.limits\.lower: 0\.3 m must be below upper 0\.25 m"),
        (["link", "length"], -0.1, r"joints\.2\.link\.length: must be at least 0 m \(is -0\.1\)"),
        (["linkage", "kind"], "four_bar", r"2\.linkage\.kind: must be 'direct' \(is 'four_bar'\)"),
        (["linkage", "retracted_length"], 0.2, r"from 0\.2 m to 0\.45 m within \[0, 0\.25\] m"),
    ],
)
def test_each_wrong_value_of_a_telescope_has_its_sentence(tmp_path, path, value, sentence):
    def spoil(content):
        section, key = path
        content["joints"][2][section][key] = value

    assert re.search(sentence, "\n".join(spoilt_telescope(tmp_path, spoil)))


def test_start_angles_in_degrees_are_asked_about_and_extensions_in_millimetres(tmp_path):
    def spoil(content):
        content["simulation"]["start_posture"] = [34, -86, 200]

    told = spoilt_telescope(tmp_path, spoil)
    assert any("34 rad is outside the joint's limits" in each for each in told)
    assert any("; in degrees? 34 degrees are 0.5934 rad" in each for each in told)
    assert any("; in mm? 200 mm are 0.2 m" in each for each in told)
