"""Every command: help with units, one sentence and a non-zero exit on bad arguments."""

import importlib
import json
import os
import re
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from mhsb_tools.executables import SUBCOMMAND_TABLE

ROOT = Path(__file__).resolve().parents[1]

COMMANDS = {
    ("mhsb_tools", "mhsb", "check"): "SI units",
    ("mhsb_planner", "build_table"): "[m]",
    ("mhsb_tools", "mhsb", "build-table"): "[m]",
    ("mhsb_tools", "mhsb", "plan"): "[m]",
    ("mhsb_planner", "goal"): "[m]",
    ("mhsb_tools", "mhsb", "goal"): "[m]",
    ("mhsb_tools", "mhsb", "param"): "kg",
    ("mhsb_tools", "mhsb", "echo"): "SI units",
    ("mhsb_tools", "mhsb", "call"): "[s]",
    ("mhsb_tools", "mhsb", "reproduce"): "in J",
    ("mhsb_planner", "planner_node"): "unit",
    ("mhsb_sim", "sim_node"): "unit",
    ("mhsb_tools", "mhsb", "simulate"): "[m]",
    ("mhsb_tools", "mhsb", "study"): "mm",
    ("mhsb_tools", "mhsb", "compare"): "in mm",
    ("mhsb_tools", "mhsb", "tune"): "[mm]",
    ("mhsb_tools", "mhsb", "record"): "[s",
    ("mhsb_tools", "mhsb", "report"): "BAG",
    ("mhsb_tools", "mhsb", "view"): "[MPa]",
    ("mhsb_tools", "mhsb", "animate"): "[MPa]",
    ("mhsb_tools", "mhsb", "demo"): "[m]",
}

WITHOUT_RESULT = ("planner_node", "sim_node", "view")
"""All others have one, which scripts may read."""

NODES = ("planner_node", "sim_node", "record", "view", "echo")


BAD_ARGUMENTS = [
    (("mhsb_planner", "build_table", "--spacing", "-0.05"), "spacing"),
    (("mhsb_planner", "build_table", "--solver", "guess"), "guess"),
    (("mhsb_tools", "mhsb", "plan", "--start", "0.5"), "--start takes"),
    (("mhsb_tools", "mhsb", "plan", "--start", "0.5", "0.1"), "--start X Z and --goal X Z"),
    (("mhsb_tools", "mhsb", "plan", "--start", "1", "0", "0", "--goal", "1", "0"), "give X Z"),
    (("mhsb_tools", "mhsb", "plan", "--case", "9-9"), "must be one of 1-1"),
    (("mhsb_tools", "mhsb", "plan", "--case", "1-1", "--search", "guess"), "--search takes one of"),
    (("mhsb_tools", "mhsb", "plan", "--case", "4-2", "--initial-j3", "9"), "initial J3 must be"),
    (
        ("mhsb_tools", "mhsb", "plan", "--case", "1-1", "--weights", "-1", "0", "2"),
        "from 0 to 1e+06",
    ),
    (
        ("mhsb_tools", "mhsb", "plan", "--case", "1-1", "--payload", "-1"),
        "--payload must be from 0",
    ),
    (("mhsb_tools", "mhsb", "plan", "--case", "1-1", "--plot", "page.jpg"), "must end in .png"),
    (
        ("mhsb_tools", "mhsb", "plan", "--case", "4-1", "--area-weight", "-1"),
        "--area-weight must be",
    ),
    (
        ("mhsb_tools", "mhsb", "plan", "--case", "1-1", "--supply-pressure-range", "9e6", "2e6"),
        "--supply-pressure-range: range must be two finite numbers above 0, the lower one first",
    ),
    (
        (
            "mhsb_tools",
            "mhsb",
            "plan",
            "--case=1-1",
            "--v-max=0.01",
            "--v-max-range",
            "0.01",
            "0.02",
        ),
        "--v-max or --v-max-range, not both",
    ),
    (
        ("mhsb_tools", "mhsb", "plan", "--case", "1-1", "--zone-box", "-0.5", "0.1"),
        "takes X1 Z1 X2 Z2",
    ),
    (
        ("mhsb_tools", "mhsb", "plan", "--case=1-1", "--zone-circle", "0.5", "0", "-1"),
        "radius: must be",
    ),
    (
        ("mhsb_tools", "mhsb", "plan", "--case=1-1", "--zone-sphere", "1", "-1", "0", "1"),
        "does not slew",
    ),
    (
        (
            "mhsb_tools",
            "mhsb",
            "simulate",
            "--goal",
            "0.6",
            "0.1",
            "1",
            "--zone-cylinder",
            *"12345",
        ),
        "--zone-cylinder 1 2 3 4 5: mhsb_arm3 does not slew; give --zone-box X1 Z1 X2 Z2 or",
    ),
    (
        (
            *("mhsb_tools", "mhsb", "simulate", "--machine", str(ROOT / "config/excavator.yaml")),
            *("--goal", "2", "0", "0", "1", "--zone-box", "1", "-1", "2", "1"),
        ),
        "--zone-box: excavator slews and takes X1 Y1 Z1 X2 Y2 Z2, not 1 -1 2 1",
    ),
    (
        ("mhsb_planner", "planner_node", "--ros-args", "-p", "zone_spheres:=[0.5, 0.0, 0.8, 0.1]"),
        "zone_spheres must be empty: this arm moves in x and z; give zone_boxes or zone_circles",
    ),
    (("mhsb_tools", "mhsb", "reproduce", "--scheduler", "nonsense"), "not an address like tcp://"),
    (("mhsb_planner", "build_table", "--scheduler", "x", "--jobs", "2"), "leave it out with"),
    (
        ("mhsb_tools", "mhsb", "study", "--scheduler", "nonsense"),
        "not an address like tcp://10.0.0.2:8786",
    ),
    (("mhsb_tools", "mhsb", "compare", "--scheduler", "nonsense"), "not an address like tcp://"),
    (("mhsb_tools", "mhsb", "tune", "--scheduler", "nonsense"), "not an address like tcp://"),
    (("mhsb_tools", "mhsb", "study", "--goals", "2"), "--goals: goes with --draws"),
    (
        ("mhsb_tools", "mhsb", "study", "--draws", "2", "--goals", "0"),
        "--goals must be from 1 to 1e+06 (is 0)",
    ),
    (("mhsb_planner", "goal", "0.5", "up"), "takes X [Y] Z"),
    (("mhsb_planner", "goal", "0.5"), "give X Z or X Y Z [m], not 0.5"),
    (("mhsb_planner", "goal", "0.5", "0.1", "--timeout", "-1"), "--timeout must be from 0.001"),
    (("mhsb_planner", "goal", "0.5", "0.1", "--tolerance", "-1"), "must be from 0 to 2"),
    (("mhsb_planner", "goal", "0.5", "0.1", "--psi-range", "3", "1"), "not 3 and 1"),
    (("mhsb_planner", "planner_node", "--fast"), "--fast"),
    (("mhsb_tools", "mhsb", "param", "get", "mhsb_planner"), "get takes NODE NAME"),
    (("mhsb_tools", "mhsb", "param", "put", "mhsb_planner"), "takes one of list, get, set"),
    (("mhsb_tools", "mhsb", "echo"), "missing TOPIC"),
    (("mhsb_tools", "mhsb", "call"), "missing SERVICE"),
    (("mhsb_sim", "sim_node", "--ros-args", "-p", "controller:=magic"), "coordinated"),
    (("mhsb_sim", "sim_node", "--ros-args", "-p", "real_time_factor:=2.0"), "publish_clock"),
    (("mhsb_tools", "mhsb", "simulate"), "give --goal X Z T"),
    (("mhsb_tools", "mhsb", "simulate", "--goal", "0.5", "0.1"), "takes X Z T each, not 0.5 0.1"),
    (("mhsb_tools", "mhsb", "simulate", "--goal", "0.6", "0.1", "-3"), "must be within 0.01"),
    (
        ("mhsb_tools", "mhsb", "simulate", "--goal", "0.6", "0.1", "1", "--seed", "-1"),
        "--seed must be",
    ),
    (
        ("mhsb_tools", "mhsb", "simulate", "--goal", "0.6", "0.1", "1", "--controller", "x"),
        "coordinated",
    ),
    (
        ("mhsb_tools", "mhsb", "simulate", "--goal", "0.6", "0.1", "1", "--vary", "weight=2"),
        "no 'weight'",
    ),
    (("mhsb_tools", "mhsb", "study", "--jobs", "0"), "--jobs"),
    (("mhsb_tools", "mhsb", "study", "--draws", "0"), "--draws must be from 1 to 1e+06 (is 0)"),
    (("mhsb_tools", "mhsb", "compare", "--moves", "-1"), "--moves must be from 0"),
    (
        ("mhsb_tools", "mhsb", "compare", "--moves", "3", "--truths", "4"),
        "4 is above the number of random",
    ),
    (("mhsb_tools", "mhsb", "compare", "--weights", "0", "0", "0"), "must not all be 0"),
    (("mhsb_tools", "mhsb", "tune", "--draws", "0", "--variations", "x.yaml"), "nothing is varied"),
    (
        ("mhsb_tools", "mhsb", "simulate", "--goal", "0.6", "0.1", "1", "--audit", "--json"),
        "--audit: leave it out",
    ),
    (
        ("mhsb_tools", "mhsb", "animate", "bag", "--planner", "table", "--output", "x.gif"),
        "been planned alr",
    ),
    (
        (
            "mhsb_tools",
            "mhsb",
            "animate",
            "--case=1-1",
            "--namespace",
            "/left",
            "--output",
            "x.gif",
        ),
        "--namespace /left has no effect: a plan has no topics",
    ),
    (
        ("mhsb_tools", "mhsb", "plan", "--case", "1-1", "--initial-j3", "0.3"),
        "--initial-j3 0.3 has no effect: the table planner takes the postures of the posture table",
    ),
    (
        (
            "mhsb_tools",
            "mhsb",
            "plan",
            "--case=1-1",
            "--planner=integrated",
            "--search",
            "published",
        ),
        "leave it out, or give --planner table or fixed",
    ),
    (
        ("mhsb_tools", "mhsb", "plan", "--case", "1-1", "--weights", "0", "0", "0"),
        "must not all be 0",
    ),
    (("mhsb_tools", "mhsb", "compare", "--weights", "-1", "0", "2"), "from 0 to 1e+06 (is -1"),
    (("mhsb_tools", "mhsb", "tune", "--budget", "0"), "--budget"),
    (("mhsb_tools", "mhsb", "record"), "--output DIR"),
    (
        ("mhsb_tools", "mhsb", "record", "--repair", "x", "--duration", "1"),
        "--duration 1 has no effect",
    ),
    (("mhsb_tools", "mhsb", "record", "--output", "x", "--duration", "-1"), "from 0.001"),
    (("mhsb_tools", "mhsb", "view", "--port", "99999"), "--port"),
    (("mhsb_tools", "mhsb", "animate", "--output", "x.mp4"), "must end in .gif"),
    (("mhsb_tools", "mhsb", "animate", "--output", "x.gif"), "give a recording, or"),
    (
        ("mhsb_tools", "mhsb", "animate", "bag", "--case", "1-1", "--output", "x.gif"),
        "give a recording, or",
    ),
    (
        ("mhsb_tools", "mhsb", "animate", "--case", "1-1", "--output", "x.gif", "--speed", "0"),
        "--speed must be from 1e-06 to 1e+06 (is 0",
    ),
    (
        ("mhsb_tools", "mhsb", "animate", "--case", "1-1", "--output", "x.gif", "--rate", "99"),
        "--rate must be from 0.01 to 50 (is 99",
    ),
    (
        ("mhsb_tools", "mhsb", "animate", "--case", "1-1", "--output", "x.gif", "--width", "9"),
        "--width must be from 200 to 4000 (is 9)",
    ),
    (("mhsb_tools", "mhsb", "demo"), "--output"),
    (
        ("mhsb_tools", "mhsb", "reproduce", "--machine", str(ROOT / "config/mhsb_arm4.yaml")),
        "the machine must have 3 joints, as the paper's (is mhsb_arm4)",
    ),
]

UNUSABLE = [
    (("mhsb_tools", "mhsb", "check", "nowhere.yaml"), "nowhere.yaml: cannot be read"),
    (("mhsb_tools", "mhsb", "plan", "--start", "0.5", "-0.1", "--goal", "3", "0"), "workspace"),
    (("mhsb_planner", "planner_node", "--ros-args", "-p", "machine:=/nowhere.yaml"), "nowhere"),
    (("mhsb_planner", "planner_node", "--ros-args", "-p", "table:=/nowhere.npz"), "nowhere"),
    (("mhsb_planner", "planner_node", "--ros-args", "-p", "machine:=/etc/passwd"), "not a machine"),
    (("mhsb_planner", "planner_node", "--ros-args", "-p", "table:=/etc/passwd"), "damaged or not"),
    (("mhsb_sim", "sim_node", "--ros-args", "-p", "machine:=/dev/zero"), "no regular file"),
    (
        ("mhsb_tools", "mhsb", "demo", "--output", "x", "--goals", "/etc/passwd"),
        "not a list of goals",
    ),
    (("mhsb_tools", "mhsb", "study", "--scenarios", "/etc/passwd"), "/etc/passwd: "),
    (
        ("mhsb_tools", "mhsb", "simulate", "--goal", "0.6", "0.1", "1", "--output", "/dev/null"),
        "/dev/null is not a folder; name one for the run",
    ),
    (
        ("mhsb_tools", "mhsb", "study", "--draws", "1", "--output", "/dev/null"),
        "name one for the study",
    ),
    (
        ("mhsb_tools", "mhsb", "plan", "--case", "1-1", "--plot", "/dev/null/x.png"),
        "for the picture",
    ),
    (
        ("mhsb_tools", "mhsb", "simulate", "--goal", "0.6", "0.1", "1", "--plant", "no.yaml"),
        "no.yaml",
    ),
    (("mhsb_tools", "mhsb", "study", "--variations", "nowhere.yaml"), "nowhere.yaml"),
    (("mhsb_tools", "mhsb", "study", "--scenarios", "nowhere.yaml"), "nowhere.yaml"),
    (("mhsb_tools", "mhsb", "report", "nowhere", "--output", "x"), "nowhere"),
    (("mhsb_tools", "mhsb", "view", "nowhere", "--port", "0"), "nowhere is not a folder"),
    (("mhsb_tools", "mhsb", "view", "--machine", "nowhere.yaml"), "nowhere.yaml"),
    (("mhsb_tools", "mhsb", "animate", "nowhere", "--output", "x.gif"), "nowhere is not a folder"),
    (("mhsb_tools", "mhsb", "demo", "--output", "x", "--goals", "nowhere.yaml"), "nowhere.yaml"),
]
"""Arguments in order, but a file cannot be used, or what is asked for cannot be had."""


@pytest.fixture
def told(start_fork, monkeypatch, capfd):
    """Function (package, name, arguments ...) to the exit code and the output of a command.

    Nodes leave their process at the end, and get a fork. The others run in this one, from their
    entry point on: a start takes longer than all that they do here.
    """

    def run(package, name, *arguments):
        if {name, *arguments[:1]} & set(NODES):
            child = start_fork(package, name, *arguments)
            return child.wait(120), child.output
        monkeypatch.setattr(sys, "argv", [name, *arguments])
        entry = getattr(importlib.import_module(f"{package}.executables"), name)
        handler = signal.getsignal(signal.SIGINT)
        capfd.readouterr()
        try:
            code = entry()
        except SystemExit as end:  # of a help
            code = end.code
        finally:
            signal.signal(signal.SIGINT, handler)
        return code, "".join(capfd.readouterr())

    return run


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[-1])
def test_help_tells_the_units_and_json_where_there_is_a_result(told, command):
    code, output = told(*command, "--help")
    assert code == 0
    assert COMMANDS[command] in output
    assert ("--json" in output) is (command[-1] not in WITHOUT_RESULT)
    assert "Traceback" not in output


@pytest.mark.parametrize(
    ("code", "arguments", "words"),
    [(2, *each) for each in BAD_ARGUMENTS] + [(1, *each) for each in UNUSABLE],
)
def test_what_cannot_be_used_is_one_sentence_and_its_exit_code(
    told, tmp_path, monkeypatch, code, arguments, words
):
    monkeypatch.chdir(tmp_path)
    ended, output = told(*arguments)
    assert ended == code, output
    assert words in output
    assert len(output.strip().splitlines()) == 1, output


def test_plan_takes_negative_numbers_and_prints_json_and_a_page(start, tmp_path):
    page = tmp_path / "new" / "page.png"
    child = start(
        *("mhsb_tools", "mhsb", "plan", "--start", "0.55", "-0.05", "--goal", "0.55", "-0.60"),
        *("--planner", "table", "--plot", page, "--json"),
    )
    assert child.wait(180) == 0, child.output
    assert page.read_bytes().startswith(b"\x89PNG")
    plan = json.loads(child.output)
    assert plan["path"][0] == pytest.approx([0.55, -0.05])
    assert plan["path"][-1] == pytest.approx([0.55, -0.60])
    assert len(plan["modes"]) == len(plan["joint_path"]) - 1 == len(plan["path"]) - 1
    assert all(max(abs(a[0] - b[0]), abs(a[1] - b[1])) < 0.0501 for a, b in pairwise(plan["path"]))
    assert plan["energy_discrete_j"] >= plan["lower_bound_j"] > 0
    assert plan["energy_j"] > 0
    assert plan["duration_s"] > 1
    assert {"search", "fit", "total"} <= set(plan["timings_ms"])


@pytest.mark.slow
def test_plan_chooses_the_supply_pressure_and_prints_what_it_looked_at(start):
    child = start(
        *("mhsb_tools", "mhsb", "plan", "--start", "0.55", "-0.05", "--goal", "0.60", "0.10"),
        *("--weights", "0.5", "0", "2", "--area-weight", "100", "--planner", "integrated"),
        *("--supply-pressure-range", "3.5e6", "5e6", "--json"),
    )
    assert child.wait(180) == 0, child.output
    plan = json.loads(child.output)
    costs = {each["supply_pressure_pa"]: each["cost"] for each in plan["operating_points"]}
    assert min(costs) == 3.5e6
    assert max(costs) == 5e6
    assert costs[plan["supply_pressure_pa"]] == min(costs.values())
    assert 0 < plan["area_m2_s2"] < 2 * plan["area_reference_m2_s2"]
    weighed = 0.5 * plan["energy_j"] + 100 * plan["area_shortfall_m"]
    assert min(costs.values()) == pytest.approx(weighed + 2.0 * plan["switches_scheduled"])


def test_a_goal_that_nobody_hears_is_told_as_json_with_what_to_do(start):
    child = start("mhsb_planner", "goal", "0.5", "0.1", "--timeout", "0.2", "--json")
    assert child.wait() == 3
    told = json.loads(child.output)
    assert told["verdict"] is told["execution"] is None
    assert "ros2 run mhsb_planner planner_node" in told["trouble"]


def test_plan_keeps_out_of_several_zones_and_tells_why_a_goal_is_in_one(start_fork):
    arguments = ("mhsb_tools", "mhsb", "plan", "--start", "0.55", "-0.05", "--goal", "0.55", "0.60")
    zones = ("--zone-box", "0.65", "0.1", "0.9", "0.3", "--zone-circle", "0.2", "-0.6", "0.1")
    around = start_fork(*arguments, *zones, "--json")
    told = start_fork(*arguments, *zones)
    inside = start_fork(*arguments, *zones, "--zone-box", "0.7", "0.8", "0.5", "0.5")
    assert around.wait(180) == 0, around.output
    path = json.loads(around.output)["path"]
    assert not any(0.65 < x < 0.9 and 0.1 < z < 0.3 for x, z in path)
    assert told.wait(180) == 0, told.output
    assert (
        "links count as lines, because the machine file has no keep_out.link_radii" in told.output
    )
    assert inside.wait(180) != 0
    assert "50 mm deep in the keep-out box (0.5, 0.5) … (0.7, 0.8) m" in inside.output


def test_a_case_of_the_paper_brings_its_weights(start_fork):
    hurried, saving = (
        start_fork("mhsb_tools", "mhsb", "plan", "--case", case, "--json")
        for case in ("1-2", "1-1")
    )
    assert hurried.wait(180) == saving.wait(180) == 0
    hurried, saving = json.loads(hurried.output), json.loads(saving.output)
    assert hurried["duration_discrete_s"] <= saving["duration_discrete_s"]
    assert hurried["energy_discrete_j"] >= saving["energy_discrete_j"]


def test_simulate_is_repeatable_and_accounts_for_all_energy(start, start_fork, tmp_path):
    there, on = ("0.6", "0.1", "2.0"), ("0.55", "-0.3", "3.0")
    simulate = ("mhsb_tools", "mhsb", "simulate", "--zone-circle", "0.458", "-0.316", "0.01")
    first = start(*simulate, "--goal", *there, *on, "--output", tmp_path, "--audit")
    second = start_fork(*simulate, "--goal", *there, "--goal", *on, "--json")
    assert first.wait(180) == 0, first.output
    assert second.wait(180) == 0, second.output
    summary = json.loads((tmp_path / "summary.json").read_text())
    again = json.loads(second.output)
    for run in (summary, again):
        del run["real_time_factor"]
        for goal in run["goals"]:
            del goal["plan_ms"]
    assert summary == again
    assert summary["reference_jump_max_rad"] <= 1e-6
    [warning] = summary["goals"][0]["warnings"]
    assert re.match(r"the arm starts \d\.\d+ mm deep in the keep-out circle", warning)
    assert f"warning: to (0.6, 0.1) m: {warning}" in first.output
    energy_gap, volume_gap = re.findall(r"unaccounted for.*\((\S+) % of delivered", first.output)
    assert abs(float(energy_gap)) < 0.1
    assert abs(float(volume_gap)) < 0.1
    assert (tmp_path / "move.png").stat().st_size > 10_000
    assert (tmp_path / "samples.csv").read_text().startswith("time,reference_1,reference_2")


def test_an_arm_that_does_not_get_there_is_told_and_fails(start_fork, tmp_path):
    child = start_fork(
        *("mhsb_tools", "mhsb", "simulate", "--goal", "0.55", "0.6", "8", "--vary", "payload=5"),
        *("--output", tmp_path, "--json"),
    )
    assert child.wait(180) == 1, child.output
    assert "the goal (0.55, 0.6) m is missed: the tip is" in child.output
    [goal] = json.loads((tmp_path / "summary.json").read_text())["goals"]
    assert goal["goal_distance_mm"] > 100.0


def test_a_run_whose_estimates_cannot_be_written_is_refused_before_it_begins(start_fork, tmp_path):
    child = start_fork(
        *("mhsb_tools", "mhsb", "simulate", "--machine", "excavator_1to14", "--output", tmp_path),
        *("--goal", "0.5", "0.1", "1", "--estimates-file", "/proc/learnt.yaml"),
    )
    assert child.wait(180) != 0
    assert "estimates file /proc/learnt.yaml: it cannot be written: " in child.output
    assert "Traceback" not in child.output
    assert not (tmp_path / "summary.json").exists()


def test_an_interrupt_while_a_goal_is_on_its_way_tells_that_it_stays(start, arm):
    arm.until(lambda: arm.is_matched)
    child = start("mhsb_planner", "goal", "0.55", "0.60", "--wait", "--timeout", "30")
    child.wait_for("OK: the tip goes to", 30)
    assert child.stop(signal.SIGINT) == 130
    assert child.output.splitlines()[-1] == (
        "goal: interrupted; the goal stays, and the arm goes there; the planner's ~/stop ends that"
    )
    assert "Traceback" not in child.output


def test_an_interrupt_of_a_long_command_is_told_in_one_sentence(start, tmp_path):
    child = start(
        *("mhsb_planner", "build_table", "--spacing", "0.005", "--jobs", "2"),
        *("--output", tmp_path / "table.npz"),
    )
    child.wait_for("posture table", 120)
    assert child.stop(signal.SIGINT, 120) == 130
    assert child.output.endswith("build_table: interrupted; no result was kept\n")
    assert "Traceback" not in child.output
    assert not (tmp_path / "table.npz").exists()


def test_the_help_of_mhsb_lists_all_subcommands_and_tests_try_each(told):
    code, output = told("mhsb_tools", "mhsb")
    assert code == 0
    assert re.findall(r"^  ([a-z-]+)  ", output, re.MULTILINE) == list(SUBCOMMAND_TABLE)
    assert {command[2] for command in COMMANDS if "mhsb" in command} == set(SUBCOMMAND_TABLE)


def test_an_unknown_subcommand_is_answered_with_the_nearest_or_with_all(told):
    assert told("mhsb_tools", "mhsb", "pln") == (
        2,
        "mhsb: no subcommand 'pln'; did you mean plan?\n",
    )
    code, output = told("mhsb_tools", "mhsb", "--verbose")
    assert code == 2
    assert ", ".join(SUBCOMMAND_TABLE) in output


@pytest.mark.parametrize("text", ["--help", "--version", "--completion"])
def test_a_reader_of_mhsb_who_goes_away_ends_it_without_a_word(text):
    read, write = os.pipe()
    os.close(read)
    mhsb = [sys.executable, "-P", "-m", "mhsb_tools.executables", "mhsb", text]
    with os.fdopen(write, "wb") as output:
        run = subprocess.run(mhsb, stdout=output, stderr=subprocess.PIPE, timeout=120)
    assert (run.returncode, run.stderr) == (141, b"")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("mhsb st", ["study"]),
        ("mhsb check --j", ["--json"]),
        ("mhsb plan --planner int", ["integrated"]),
    ],
)
def test_bash_completes_subcommands_options_and_choices(line, words):
    typed = line.split(" ")
    script = f"""
        eval "$(mhsb --completion)"; compopt() {{ :; }}
        COMP_WORDS=({line}) COMP_CWORD={len(typed) - 1}; _mhsb_complete; echo "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True)
    assert done.stdout.split() == words, done.stderr


def test_a_command_that_is_not_there_is_answered_with_those_that_are():
    script = "scripts/bin/ros2 run mhsb_planner plam; scripts/bin/ros2 run mhsb_plan goal"
    run = subprocess.run(["bash", "-c", script], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 1
    first, second = run.stderr.splitlines()
    assert "'plam'" in first
    assert {"plan", "goal", "build_table"} <= set(first.rstrip(".").split())
    assert "packages are mhsb_planner, mhsb_sim and mhsb_tools" in second
