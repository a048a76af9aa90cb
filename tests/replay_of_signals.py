"""Run the lines of docs/hardware.md on a bag of a machine's signals, and compare all commands.

    python tests/replay_of_signals.py BAG CONTROLLER

Simulator, planner, MuJoCo and ROS cannot be imported here. The first sample of the bag has no
commands.
"""

import re
import sys
from pathlib import Path

import numpy as np

ABSENT = ("mujoco", "rclpy", "mhsb_sim", "mhsb_planner", "mhsb_msgs_py", "mhsb_tools")
sys.modules.update(dict.fromkeys(ABSENT))  # to import one of them is an error now

from rosbags.rosbag2 import Reader  # noqa: E402
from rosbags.typesys import Stores, get_typestore  # noqa: E402

from mhsb_model.mode_schedule import ModeSchedule  # noqa: E402
from mhsb_model.trajectory import SECOND_NS, Trajectory  # noqa: E402

PAGE = Path(__file__).parents[1] / "docs" / "hardware.md"


def nanoseconds(time):
    """Return a time or a duration of ROS [ns]."""
    return time.sec * SECOND_NS + time.nanosec


def decode_plan(message):
    """Return stamp, times and rows of positions, velocities and accelerations of a message."""
    times = [nanoseconds(point.time_from_start) for point in message.points]
    names = ("positions", "velocities", "accelerations")
    rows = (np.array([getattr(point, name) for point in message.points]) for name in names)
    return nanoseconds(message.header.stamp), times, *rows


def read_bag(folder):
    """Return the plan's two parts, and the samples in time order: time and values by name."""
    store, plan, samples = get_typestore(Stores.ROS2_JAZZY), {}, {}
    with Reader(folder) as reader:
        for connection, time_ns, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            name = connection.topic.removeprefix("/")
            if hasattr(message, "points"):
                plan[name] = decode_plan(message)
            else:
                samples.setdefault(time_ns, {"time_ns": time_ns})[name] = message.data
    stamp_ns, times, modes, *_ = plan["mode_commands"]
    plan = Trajectory(*plan["joint_trajectory"]), ModeSchedule(stamp_ns, times, modes)
    return plan, [samples[time_ns] for time_ns in sorted(samples)]


def main(bag, controller):
    """Run the lines and exit with a sentence if a command differs from the recorded one."""
    (trajectory, schedule), samples = read_bag(bag)
    commanded = iter(samples[1:])

    def compare(*commands):
        recorded = next(commanded)
        for record in commands:
            for name in record.dtype.names:
                if not np.array_equal(record[name], recorded[name]):
                    sys.exit(
                        f"{name} at {recorded['time_ns']} ns: {record[name]}, {recorded[name]}"
                    )

    given = {
        "machine_file": None,
        "start_ns": samples[1]["time_ns"],
        "trajectory": trajectory,
        "schedule": schedule,
        "samples": iter(samples),
        "send": compare,
    }
    [lines] = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    exec(lines.replace('"coordinated"', repr(controller)), given)
    print(f"{len(samples) - 1 - len(list(commanded))} samples are commanded as recorded")


if __name__ == "__main__":
    main(*sys.argv[1:])
