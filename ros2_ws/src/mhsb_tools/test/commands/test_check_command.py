"""The check command: text about a machine, and clean refusals."""

import cmath
import json
import math
import re

import numpy as np
import pytest

from mhsb_control import REGISTERED_CONTROLLERS, load_machine
from mhsb_model import command_line
from mhsb_model.circuit.dead_time import compute_dead_time, compute_valve_lag
from mhsb_model.obstacles.zones import Zones
from mhsb_tools.commands import check_command as check
from mhsb_tools.moves.workspace_points import list_workspace_points


@pytest.fixture
def run(capsys):
    """Function (words...) that runs the command: exit code, output and errors."""
    return lambda *words: (command_line.run(check.check, words), *capsys.readouterr())


def test_the_report_accounts_for_every_point_of_the_workspace(machine):
    text = "\n".join(check.format_report(machine))
    held, boosted, heavy, none = (
        int(re.search(rf"(\d+) {words}", text)[1])
        for words in ("are held", "need boost", "are beyond", "have no posture")
    )
    assert held + boosted + heavy + none == 642
    assert held > 0
    assert boosted > 0


def test_the_report_gives_loads_and_moment_arms_of_the_stretched_arm(machine):
    text = "\n".join(check.format_report(machine))
    assert "157.3" in text
    assert "23 mode patterns" in text


def test_the_report_gives_the_length_of_each_cylinder_at_both_ends_of_the_joints_range():
    _, _, crank, bars = load_machine("excavator").config.joints
    text = "\n".join(check.format_report(load_machine("excavator")))
    shown = re.findall(r"([\d.]+) … *([\d.]+)  +[-\d.]+ +[-\d.]+$", text, re.MULTILINE)
    pins = crank.linkage.parent_pin, crank.linkage.child_pin
    for q, length in zip((crank.limits.lower, crank.limits.upper), shown[2], strict=True):
        ends = [
            cmath.rect(p.radius, p.angle + turned) for p, turned in zip(pins, (0, q), strict=True)
        ]
        assert float(length) == pytest.approx(1e3 * abs(ends[0] - ends[1]), abs=0.06)
    four = bars.linkage
    pivot, base, child = (
        cmath.rect(pin.radius, pin.angle)
        for pin in (four.rocker_pivot, four.parent_pin, four.child_pin)
    )
    for q, length in zip((bars.limits.lower, bars.limits.upper), shown[3], strict=True):
        line = child * cmath.exp(1j * q) - pivot
        a, b, d = four.rocker_length, four.coupler_length, abs(line)
        turned = -math.acos((a**2 + d**2 - b**2) / (2 * a * d))  # right of the line
        tip = pivot + a * cmath.exp(1j * (cmath.phase(line) + turned))
        assert float(length) == pytest.approx(1e3 * abs(tip - base), abs=0.06)


def test_the_report_says_once_that_the_arm_cannot_be_straight(machine, slider_crank_machine):
    [remark] = (each for each in check.format_report(machine) if "cannot be straight" in each)
    assert remark == (
        "no error: joint 2 does not reach position 0, so the arm cannot be straight, and its loads "
        "stay below those straight out"
    )
    low, high = (getattr(slider_crank_machine.arrays, name) for name in ("joint_min", "joint_max"))
    assert np.all((low <= 0.0) & (high >= 0.0))
    assert "cannot be straight" not in "\n".join(check.format_report(slider_crank_machine))


def test_the_report_says_why_a_posture_table_reaches_more_points(machine, four_bar_machine):
    remark = "; a posture table searches between them, and may reach a few more"
    for arm, is_missing in ((machine, True), (four_bar_machine, False)):
        assert (remark in "\n".join(check.format_report(arm))) == is_missing


def test_the_report_tells_what_an_actuator_has_of_its_own(machine):
    own = machine.with_values(
        {
            "joints.1.actuator": {"rated_flow": 5e-5, "max_piston_speed": 0.008},
            "joints.2.actuator": {
                "rated_pressure_drop_per_land": 1e6,
                "friction": 2.0,
                "relief_pressure": 1.5e7,
            },
        }
    ).changed(payload=9.0)
    told = [line for line in check.format_report(own) if "of its own" in line]
    assert told == [
        "actuator 2 has of its own: valve of 3.00 L/min, piston speed of at most 8.0 mm/s",
        "actuator 3 has of its own: rated drop of 1.00 MPa at each land, 2 times the friction, "
        "chambers relieved at 15.0 MPa",
    ]
    assert check.collect_facts(own)["joints"][1]["own"] == {
        "rated_flow": 5e-5,
        "max_piston_speed": 0.008,
    }
    assert not any("of its own" in line for line in check.format_report(machine))


def test_the_report_says_that_a_long_delay_is_not_compensated(machine):
    for delay, is_named in ((0.06, False), (0.15, True)):
        text = "\n".join(
            check.format_report(machine.with_values({"imperfections.computing_delay": delay}))
        )
        assert ("computing_delay is 150 ms" in text) == is_named
        assert ("use lag_compensated" in text) == is_named


def test_the_report_has_the_dead_time_of_machines_without_pressure_sensors(machine):
    assert "ahead" not in "\n".join(check.format_report(machine))
    arm = load_machine("excavator_1to14")
    [line] = (each for each in check.format_report(arm) if "ahead" in each)
    delay, lag = arm.config.imperfections.computing_delay, compute_valve_lag(arm)
    assert line == (
        f"its servo needs a plan {1e3 * compute_dead_time(arm):.0f} ms ahead: computing delay and "
        f"valve lag are {1e3 * delay:.0f} ms and {1e3 * lag:.0f} ms, at least "
        f"{1e3 * arm.expected_delay:.0f} ms are expected"
    )


def test_a_machine_without_boosters_is_not_told_of_boost(machine):
    arm = machine.changed(module_count=0)
    lines = check.format_report(arm)
    assert re.search(r"no booster modules, all actuators are always in N$", "\n".join(lines), re.M)
    assert not re.search(r"boost(?!er modules)|DB|SB|module extends|pattern", "\n".join(lines))
    with_boosters, without = (check.collect_facts(each)["workspace"] for each in (machine, arm))
    assert without["boosted"] == 0
    assert without["too_heavy"] == with_boosters["boosted"] + with_boosters["too_heavy"]
    assert f"  {without['too_heavy']} are beyond the supply pressure" in lines


def test_the_report_tells_each_joints_kind_of_linkage(machine, slider_crank_machine):
    for arm, kind in ((machine, "four_bar"), (slider_crank_machine, "slider_crank")):
        text = "\n".join(check.format_report(arm))
        assert re.findall(r"^ +[123]  (\w+) ", text, re.MULTILINE) == 3 * [kind]


def test_four_bars_leave_no_point_of_the_workspace_without_a_posture(four_bar_machine):
    text = "\n".join(check.format_report(four_bar_machine))
    assert "  0 have no posture" in text


def test_the_report_tells_what_zones_leave_of_the_workspace(machine):
    assert "clear of" not in "\n".join(check.format_report(machine))
    upper_half = machine.changed(zones=Zones(tip_boxes=((-1.0, 0.05, 2.0, 2.0),)))
    text = "\n".join(check.format_report(upper_half))
    left, reached = map(int, re.search(r"(\d+) of (\d+) points that can be reached", text).groups())
    assert reached == 642 - int(re.search(r"(\d+) have no posture", text)[1])
    below = [z for x, z in list_workspace_points(machine) if z <= 0.045]
    assert len(below) - (642 - reached) <= left <= len(below)


def test_the_command_prints_the_report_of_the_suites_arm(run):
    code, output, _ = run()
    assert code == 0
    assert output.startswith("mhsb_arm3: 3 joints")


def test_the_report_has_the_hash_that_nodes_and_estimates_files_report(machine, slewing_machine):
    for arm in (machine, slewing_machine):
        assert check.collect_facts(arm)["machine_hash"] == arm.planning_hash
        assert check.format_report(arm)[0] == (
            f"{arm.name}: {arm.joint_count} joints; machine_hash {arm.planning_hash[:12]}, "
            f"posture table {arm.planar_arm.table_hash[:12]}"
        )


def test_the_command_draws_the_workspace(run, tmp_path):
    file = tmp_path / "pictures" / "workspace.png"
    for name in ("forestry_crane", "excavator_1to14"):
        code, _, _ = run(name, "--plot", str(file))
        assert code == 0
        assert file.read_bytes().startswith(b"\x89PNG")
        file.unlink()
    assert run("excavator", "--plot", "page.jpg")[2].endswith("must end in .png\n")


def test_a_missing_file_is_one_sentence_and_a_failure(run):
    code, _, errors = run("nowhere.yaml")
    assert code != 0
    assert len(errors.strip().splitlines()) == 1
    assert "nowhere.yaml" in errors


def test_json_has_the_numbers_of_the_text_in_si_units(machine, run):
    code, output, errors = run("--json")
    assert code == 0, errors
    found = json.loads(output)
    workspace = found["workspace"]
    kinds = ("held", "boosted", "too_heavy", "no_posture")
    assert sum(workspace[kind] for kind in kinds) == workspace["points"] == 642
    assert f"{workspace['boosted']} need boost" in "\n".join(check.format_report(machine))
    assert found["hash"] == machine.table_hash
    assert found["hydraulics"]["supply_pressure_pa"] == machine.arrays.supply_pressure
    torque = machine.gravity_torque(np.zeros(3))
    shown = [joint["straight_out_torque_nm"] for joint in found["joints"]]
    assert shown[1] is None  # straight is outside of its range
    np.testing.assert_allclose([shown[0], shown[2]], [torque[0], torque[2]])


def test_a_telescope_is_told_in_millimetres_and_newtons(telescope_machine):
    text = "\n".join(check.format_report(telescope_machine))
    assert re.search(r"3  direct +0\.0 … 250\.0 mm +- +330\.0 … +580\.0 +-?0\.0 N", text)
    found = check.collect_facts(telescope_machine)
    assert found["joints"][2]["range_m"] == [0.0, 0.25]
    assert found["workspace"]["held"] + found["workspace"]["boosted"] > 650


def test_the_report_says_what_a_pole_leaves_at_many_angles_of_the_slew(
    slewing_machine, monkeypatch
):
    pole = Zones(tip_cylinders=((0.3, 0.4, -0.2, 0.3, 0.15),))
    arm = slewing_machine.changed(zones=pole)
    facts = check.collect_facts(arm)
    monkeypatch.setattr(check, "collect_facts", {arm: facts}.get)  # counting takes seconds
    left, reached = facts["keep_out"]["left"], facts["keep_out"]["reached"]
    assert check.format_report(arm)[-1] == (
        f"  {left} of {reached} points that can be reached are left, {100 * left / reached:.0f} %, "
        "counted at 72 angles of the slew"
    )


def test_it_names_the_controllers_that_suit_the_sensors(machine, run):
    names: dict[bool, list[str]] = {True: [], False: []}
    for name, kind in REGISTERED_CONTROLLERS.items():
        names[getattr(kind, "reads_pressures", True)].append(name)
    assert check.collect_facts(machine)["controllers"] == names[True]
    code, output, errors = run("excavator_1to14")
    assert code == 0, errors
    facts = check.collect_facts(load_machine("excavator_1to14"))
    assert facts["default_controller"] == "lag_compensated"
    suitable = ", ".join(names[False]).replace("lag_compensated", "lag_compensated (default)")
    assert f"controllers that suit its length sensors alone: {suitable}\n" in output


def test_a_valve_of_no_kind_and_a_wrong_key_of_a_valve_are_refused(tmp_path, machine, run):
    own = machine.with_values({"circuit.valves": {"fuse": {}, "piston_seal": {"leakage": 1e-9}}})
    file = tmp_path / "own.yaml"
    file.write_text(json.dumps(own.config.model_dump(mode="json")))
    code, _, errors = run(str(file))
    assert code == 1
    assert "circuit.valves.fuse: no such kind of valve" in errors
    assert "circuit.valves.piston_seal.leakage" in errors


@pytest.mark.parametrize(
    ("rate", "speed", "milliseconds"),
    [(10.0, 0.09, 110), (20.0, 0.09, 60), (50.0, 0.09, 30), (50.0, 0.012, 70), (1000.0, 0.05, 30)],
)
def test_the_report_says_how_soon_a_frozen_sensor_is_found(rate, speed, milliseconds):
    """0.6 mm are exceeded by the first reading, the third (0.24 mm each), or after 20 ms."""
    arm = load_machine("excavator_1to14").with_values(
        {"imperfections.sensors.rate": rate, "motion.max_piston_speed": speed}
    )
    [line] = (each for each in check.format_report(arm) if each.startswith("length sensors"))
    assert line == (
        f"length sensors 'encoder_13_bit' read at {rate:g} Hz; at V_max a frozen one is found "
        f"within {milliseconds} ms"
    )
    quiet = arm.with_values({"servo.length_noise": 0.0})
    assert check.collect_facts(quiet)["length_sensors"]["frozen_found_s"] is None


@pytest.mark.parametrize(
    ("sensors", "errors"),
    [
        ({"length": "imu"}, " with 0.1° of noise, 0.5° a minute of drift"),
        (
            {"length": "imu", "angle_noise": 0.0, "angle_drift": np.radians(0.2) / 60.0},
            " with 0.2° a minute of drift",
        ),
        (
            {"angle_noise": np.radians(0.3), "angle_offset": np.radians(1.0)},
            " with 0.3° of noise, 1° of offset",
        ),
        ({"length": "encoder_13_bit"}, ""),
    ],
)
def test_the_report_gives_noise_offset_and_drift_of_angles(machine, sensors, errors):
    keys = {f"imperfections.sensors.{key}": value for key, value in sensors.items()}
    text = "\n".join(check.format_report(machine.with_values(keys)))
    kind = sensors.get("length", "file")
    assert f"length sensors '{kind}' read at 1000 Hz{errors}; " in text


def test_the_report_names_curves_and_compensators_of_the_valves():
    arm = load_machine("excavator_1to14")
    text = "\n".join(check.format_report(arm))
    assert "curve of the valves" not in text
    assert "compensators" not in text
    own = arm.with_values(
        {
            "imperfections.valve_exponent": 1.0,
            "imperfections.valve_curve": [[0, 0], [0.5, 0.1], [0.75, 0.9], [1, 1]],
            "hydraulics.valve.compensated_drop": 7e5,
        }
    )
    text = "\n".join(check.format_report(own))
    # 20 and 30 % of dead band, then 50, 62.5 and 75 % of the stroke that is left
    share = "10, 50, 90 % of the flow at"
    assert f"curve of the valves, extending: {share} 60, 70, 80 % of the command\n" in text
    assert f"curve of the valves, retracting: {share} 65, 74, 82 % of the command\n" in text
    # 2.88 L/min at 3.5 MPa through a bore of 17 mm, 1.44 L/min through one of 12 mm
    assert (
        "pressure compensators keep 0.7 MPa over each edge of the valves: at full command pistons "
        "move at 95, 95, 95 mm/s with every load\n"
    ) in text
    facts = check.collect_facts(own)
    assert facts["compensated_drop_pa"] == 7e5
    assert facts["valve_curves"][0] == facts["valve_curves"][1]


def test_the_report_names_a_declared_delay(machine):
    assert "delay of commands" not in "\n".join(check.format_report(machine))
    late = machine.with_values({"imperfections.computing_delay": 0.02})
    assert "declared delay of commands: 20 ms\n" in "\n".join(check.format_report(late))


def test_the_report_names_dead_bands(machine):
    assert "dead bands" not in "\n".join(check.format_report(machine))
    text = "\n".join(check.format_report(load_machine("excavator_1to14")))
    assert "dead bands of the valves: 20 % of the stroke extending, 30 % retracting\n" in text
