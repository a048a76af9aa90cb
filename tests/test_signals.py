"""SIGINT, SIGTERM and SIGHUP at any moment of a node's life: code 0, and no traceback.

What starts a node blocks these signals until the node can answer them; only within the first
milliseconds, before `env` has blocked them, do they end it in the system's own way.
"""

import os
import random
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

from mhsb_model.verdict import Verdict

ROOT = Path(__file__).parents[1]
NODES = [
    ("mhsb_sim", "sim_node"),
    ("mhsb_planner", "planner_node"),
    ("mhsb_tools", "mhsb", "record"),
]
SIGNALS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
FIRST, LAST = 0.05, 3.0
"""When signals come [s]: from just after the start to well after the node serves."""


@pytest.fixture
def trouble_at(start, tmp_path):
    """Function (node, moment [s], signal, folder of kernels): how a node ends that is started and
    sent a signal, where not with code 0 and without a traceback; else nothing."""

    def run(node, moment, signal_number, kernels=None):
        arguments = ("--output", tmp_path / f"bag_{moment}") if node[-1] == "record" else ()
        chosen = {} if kernels is None else {"NUMBA_CACHE_DIR": str(kernels)}
        child = start(*node, *arguments, environment=chosen)
        time.sleep(moment)
        code = child.stop(signal_number)
        clean = code == 0 and "Traceback" not in child.output
        return "" if clean else f"code {code} after {moment:.2f} s:\n{child.output}"

    return run


def moments(count: int, seed: int, last: float = LAST) -> list[float]:
    """One random moment in each of so many equal parts of the time; seeded [s]."""
    rng = random.Random(seed)
    part = (last - FIRST) / count
    return [FIRST + (index + rng.random()) * part for index in range(count)]


@pytest.mark.parametrize("node", NODES, ids=lambda node: node[-1])
@pytest.mark.parametrize("number", SIGNALS, ids=lambda each: each.name)
def test_a_signal_at_any_moment_ends_a_node_with_code_0(trouble_at, node, number):
    for moment in moments(2, seed=number):
        assert trouble_at(node, moment, number) == ""


@pytest.mark.parametrize("node", NODES[:2], ids=lambda node: node[-1])
def test_a_signal_while_kernels_are_compiled_ends_a_node_with_code_0(trouble_at, node, tmp_path):
    for moment in moments(2, seed=3, last=5.0):
        assert trouble_at(node, moment, signal.SIGINT, tmp_path / "kernels") == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda each: each.name)
def test_a_signal_while_a_plan_is_made_ends_both_nodes_with_code_0(observer, start, number):
    simulator, planner = start("mhsb_sim", "sim_node"), start("mhsb_planner", "planner_node")
    for child in (simulator, planner):
        child.wait_for("ready", 180.0)
    observer.until(lambda: observer.is_matched and len(observer.references) > 0)
    assert observer.request_verdict(0.55, 0.60).code is Verdict.OK
    observer.send(0.55, -0.60)
    observer.serve(0.02)
    for child in (planner, simulator):
        child.process.send_signal(number)
        assert child.stop(number) == 0, child.output  # the second one changes nothing
        assert "Traceback" not in child.output


@pytest.mark.slow
@pytest.mark.parametrize("node", NODES, ids=lambda node: node[-1])
@pytest.mark.parametrize("cold", [False, True], ids=["warm", "cold"])
def test_fifty_signals_over_the_first_eight_seconds(trouble_at, node, cold, tmp_path):
    for index, moment in enumerate(moments(50, seed=8, last=8.0)):
        number = SIGNALS[index % 3]
        kernels = tmp_path / str(index) if cold else None
        assert trouble_at(node, moment, number, kernels) == ""


WRAPPERS = {
    "timeout": "timeout --signal=INT {limit} ros2 run {node}",
    "nohup": "nohup ros2 run {node}",
    "sh": "sh -c 'exec ros2 run {node}'",
    "xargs": "echo run {node} | xargs ros2",
    "env": "env A=1 ros2 run {node}",
}


@pytest.mark.parametrize("wrapper", WRAPPERS)
def test_a_command_that_starts_others_finds_ros2(wrapper):
    line = WRAPPERS[wrapper].format(limit=60, node="mhsb_tools mhsb check config/mhsb_arm3.yaml")
    run = subprocess.run(["bash", "-c", line], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "mhsb_arm3" in run.stdout + run.stderr


def recorder(start_process, tmp_path, prefix=""):
    """A recorder that a shell has started with `&`, once it listens; the shell prints its id."""
    line = f"{prefix} mhsb record --output {tmp_path}/bag & echo id $!; wait $!"
    shell = start_process("bash", "-c", line)
    number = int(shell.wait_for(r"id (\d+)")[1])
    shell.wait_for("recording", 60.0)
    return shell, number


@pytest.mark.parametrize("number", SIGNALS[1:], ids=lambda each: each.name)
def test_the_process_that_a_shell_has_started_is_the_recorder_and_closes_its_file(
    start_process, ros_domain, tmp_path, number
):
    shell, child = recorder(start_process, tmp_path)
    os.kill(child, number)
    assert shell.wait() == 0, shell.output
    assert (tmp_path / "bag" / "metadata.yaml").exists()
    with pytest.raises(ProcessLookupError):
        os.kill(child, 0)


def test_a_recorder_under_nohup_survives_the_end_of_its_terminal(
    start_process, ros_domain, tmp_path
):
    shell, child = recorder(start_process, tmp_path, "nohup")
    os.kill(child, signal.SIGHUP)
    time.sleep(2.0)
    assert shell.process.poll() is None
    os.kill(child, signal.SIGTERM)
    assert shell.wait() == 0, shell.output
    assert (tmp_path / "bag" / "metadata.yaml").exists()


def test_a_demo_whose_terminal_is_closed_ends_with_its_nodes_and_keeps_its_recording(
    start, tmp_path
):
    demo = start("mhsb_tools", "mhsb", "demo", "--output", tmp_path / "demo")
    demo.wait_for("m: OK", 200.0)
    demo.process.send_signal(signal.SIGHUP)
    demo.wait(20.0)
    assert "Traceback" not in demo.output
    assert list((tmp_path / "demo").rglob("metadata.yaml"))
    left = subprocess.run(["ps", "-eo", "pid,sid"], capture_output=True, text=True).stdout
    assert not re.findall(rf"^ *\d+ +{demo.process.pid}$", left, re.MULTILINE)
