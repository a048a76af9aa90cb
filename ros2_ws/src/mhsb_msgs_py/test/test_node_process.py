"""The life of a node's process: a clean end on signals, one sentence on bad ROS arguments."""

from __future__ import annotations

import re
import signal
import sys
from pathlib import Path

import pytest

BODY = """
import sys
import rclpy
from mhsb_model.command_line import run
from mhsb_msgs_py.node_process import spin_node

def make_node():
    node = rclpy.create_node("idle")
    node.declare_parameter("seed", 1)
    print("ready as", node.get_fully_qualified_name(), flush=True)
    return node

def idle() -> int:
    return spin_node(make_node)

sys.exit(run(idle, node=True))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_node_with_code_0_and_without_a_word(start_process, tmp_path, number):
    script = tmp_path / "idle.py"
    script.write_text(BODY)
    child = start_process(sys.executable, script, "--ros-args", "-r", "__ns:=/left")
    child.wait_for("ready as /left/idle")
    assert child.stop(number) == 0
    assert child.output == "ready as /left/idle\n"


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
def test_a_signal_before_the_node_is_served_ends_it_just_as_well(start_process, tmp_path, number):
    script = tmp_path / "idle.py"
    at_once = f"    import os, signal; os.kill(os.getpid(), signal.{number})\n    return node"
    script.write_text(BODY.replace("    return node", at_once))
    child = start_process(sys.executable, script)
    assert child.wait() == 0
    assert child.output == "ready as /idle\n"


def test_a_node_whose_destruction_never_ends_and_keeps_pythons_lock_ends_all_the_same(
    start_process, tmp_path
):
    script = tmp_path / "idle.py"
    stuck = "    import ctypes; node.destroy_node = ctypes.PyDLL(None).pause\n    return node"
    script.write_text(BODY.replace("    return node", stuck))
    child = start_process(sys.executable, script)
    child.wait_for("ready")
    assert child.stop(signal.SIGTERM) == 1
    assert child.output == "ready as /idle\n"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["-r", "nonsense"], "Couldn't parse remap rule: '-r nonsense'. Error: "),
        (["--unheard-of"], "unknown arguments ['--unheard-of']"),
        (["-p", "seed:=high"], "seed"),
    ],
)
def test_ros_arguments_that_cannot_be_used_are_told_in_one_line(
    start_process, tmp_path, arguments, sentence
):
    script = tmp_path / "idle.py"
    script.write_text(BODY)
    child = start_process(sys.executable, script, "--ros-args", *arguments)
    assert child.wait() == 2
    assert child.output.startswith("idle: after --ros-args: ")
    assert sentence in child.output
    assert len(child.output.splitlines()) == 1


def test_a_parameter_that_the_node_does_not_have_is_told(start_process, tmp_path):
    script = tmp_path / "idle.py"
    script.write_text(BODY)
    child = start_process(sys.executable, script, "--ros-args", "-p", "sede:=3", "-p", "seed:=3")
    child.wait_for("there is no parameter sede: it is ignored; did you mean seed?")
    assert child.stop(signal.SIGINT) == 0
    assert child.output.count("there is no parameter") == 1


@pytest.mark.parametrize(
    ("environment", "sentence"),
    [
        ({"FASTRTPS_DEFAULT_PROFILES_FILE": "/nowhere.xml"}, "/nowhere.xml, which cannot be read"),
        ({"ROS_DOMAIN_ID": "home"}, "not an integral number; give a number from 0 to 101"),
    ],
)
def test_an_environment_that_ros_cannot_use_is_told_in_one_line(
    start_process, tmp_path, environment, sentence
):
    script = tmp_path / "idle.py"
    script.write_text(BODY)
    child = start_process(sys.executable, script, environment=environment)
    assert child.wait() == 1
    assert sentence in child.output
    assert len(child.output.splitlines()) == 1


HOLES = """
    import numpy as np
    from mhsb_msgs_py import node_process

    def resident():
        return 4096 * int(open("/proc/self/statm").read().split()[1])

    before = resident()
    blocks = [np.ones(4_000) for _ in range(2_000)]  # 64 MB
    node.last_block = blocks.pop()
    del blocks
    node_process.RELEASE_PERIOD = 0.2
    print("holes", before, resident(), flush=True)
    return node"""


def test_a_node_returns_free_memory_below_a_block_in_use(start_process, eventually, tmp_path):
    script = tmp_path / "idle.py"
    script.write_text(BODY.replace("    return node", HOLES))
    child = start_process(sys.executable, script)
    before, with_holes = map(int, child.wait_for(r"holes (\d+) (\d+)").groups())
    assert with_holes > before + 50_000_000
    statm = Path(f"/proc/{child.process.pid}/statm")
    eventually(lambda: 4096 * int(statm.read_text().split()[1]) < before + 10_000_000)
    assert child.stop(signal.SIGTERM) == 0


STARTING = """
import glob
import os
import time
import rclpy
from mhsb_msgs_py.node_process import spin_node

def make_node():
    node = rclpy.create_node("starting")
    own = [os.readlink(link) for link in glob.glob("/proc/self/fd/*") if os.path.exists(link)]
    print("shares", [name for name in own if name.startswith("/dev/shm/fastrtps_")], flush=True)
    time.sleep(30)

def main():
    return spin_node(make_node)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_node_that_is_ended_while_it_starts_leaves_no_shared_memory(
    start_process, tmp_path, number
):
    (tmp_path / "starting.py").write_text(STARTING)
    code = (
        "import sys; sys.path.append(sys.argv[1]); from mhsb_model.process import make_node_entry; "
    )
    words = (sys.executable, "-c", code + "make_node_entry('starting')()", tmp_path)
    own_transports = {  # the suite's profile has no shared memory
        "FASTRTPS_DEFAULT_PROFILES_FILE": "",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    child = start_process(*words, environment=own_transports)
    shared = re.findall(r"fastrtps_[0-9a-f]+(?=_el)", child.wait_for("shares .*").group())
    assert shared
    assert child.stop(number) == 0
    left = [file.name for file in Path("/dev/shm").glob("fastrtps_*")]
    assert not any(file.startswith(name) for file in left for name in shared)
