"""The lines of docs/hardware.md command what a simulated arm was commanded, from its bag alone."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray
from tests.support.messages import encode_schedule, encode_trajectory

from mhsb_control import REGISTERED_CONTROLLERS
from mhsb_model.trajectory import SECOND_NS
from mhsb_msgs_py import topics
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.recording.bag_format import BagTopic
from mhsb_tools.recording.bag_writer import BagWriter

GOAL = np.array([0.9, -0.6, -0.8])
STEPS = 5000
REPLAY = Path(__file__).parent / "replay_of_signals.py"


def readings(simulator):
    """What the servo reads, by name."""
    signals = simulator._signals
    found = {name: signals.sensors[name] for name in signals.sensors.dtype.names}
    return found | {
        "rail_pressure": signals.rail_pressure, "pump_flow": signals.circuit.modules["flow"]
    }  # fmt: skip


def commands(simulator):
    """What the servo commands, by name."""
    circuit = simulator._signals.circuit
    found = {name: circuit.actuators[name] for name in ("valve_command", "join_command")}
    return found | {name: circuit.modules[name] for name in ("flow_command", "to_rail_command")}


def filled(message):
    """Fill empty lists of points: rosbags takes their padding for surplus bytes."""
    for point in message.points:
        for name in ("velocities", "accelerations", "effort"):
            setattr(point, name, getattr(point, name) or point.positions)
    return message


def record(folder, simulator, plan):
    """Record a plan and all signals of the run that follows it; the patterns of modes on the way.

    The first sample is that of the arm at rest.
    """

    def write(time_ns, values):
        for name, value in values.items():
            data = serialize_message(Float64MultiArray(data=value.tolist()))
            bag.write(f"/{name}", data, time_ns, time_ns)

    names, patterns = simulator.machine.joint_names, set()
    with BagWriter(folder) as bag:
        for name in (*readings(simulator), *commands(simulator)):
            bag.add_topic(BagTopic(f"/{name}", "std_msgs/msg/Float64MultiArray", ""))
        for topic, encode, part in (
            (topics.JOINT_TRAJECTORY, encode_trajectory, plan[0]),
            (topics.MODE_COMMANDS, encode_schedule, plan[1]),
        ):
            bag.add_topic(BagTopic(f"/{topic.name}", topic.type_name, ""))
            data = serialize_message(filled(encode(part, names)))
            bag.write(f"/{topic.name}", data, simulator.time_ns, simulator.time_ns)
        write(simulator.time_ns - simulator.step_ns, readings(simulator))
        simulator.set_plan(*plan)
        for _ in range(STEPS):
            time_ns = simulator.time_ns
            simulator.step()
            write(time_ns, readings(simulator) | commands(simulator))
            patterns.add(tuple(simulator.modes))
    return patterns


@pytest.mark.parametrize("controller", sorted(REGISTERED_CONTROLLERS))
def test_the_lines_of_the_page_command_what_was_recorded(tmp_path, machine, motion, controller):
    simulator = Simulator(machine, controller, start_ns=SECOND_NS)
    plan = motion(simulator.reference, GOAL, simulator.time_ns)
    patterns = record(tmp_path / "bag", simulator, plan)
    assert {0, 1, 2} <= {mode for pattern in patterns for mode in pattern}  # it uses the rail
    replay = [sys.executable, REPLAY, tmp_path / "bag", controller]
    run = subprocess.run(replay, capture_output=True, text=True, timeout=240)
    assert run.returncode == 0, run.stderr
    assert run.stdout == f"{STEPS} samples are commanded as recorded\n"
